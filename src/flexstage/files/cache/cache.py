"""A cache of arrays on disk, by the content that they were computed from."""

import contextlib
import hashlib
import json
import logging
import os
import struct
import threading
import time
from collections import OrderedDict
from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from flexstage.files.names import user_folder
from flexstage.files.write import draft_of

Entry = Mapping[str, NDArray]
#: Types of arrays as NumPy names them: float, integer, byte, complex, bool.
TYPES = ("<f8", "<i8", "|u1", "<c16", "|b1")
_LOG = logging.getLogger(__name__)

# File: mark, SHA-256 of all that follows, key, length of the header, header, numbers.
_MARK = b"flexstage cache 1\n"
_DIGEST = 32
_LENGTH = struct.Struct("<Q")
_START = len(_MARK) + _DIGEST
_SUFFIX = ".arrays"
_UNFINISHED = ".part"

#: Largest size of a cache on disk [bytes], and the share that remains after trimming.
LIMIT, REMAINS = 500_000_000, 0.8
_MEMORY = 128_000_000
_ABANDONED = 3600.0  # an unfinished file of this age belongs to a dead process [s]


class Cache:
    """Arrays in a directory, one file for each key.

    A checksum covers every byte of a file; a damaged file counts as absent. Writing is atomic:
    processes may share a directory and may end at any moment. If the directory cannot be written,
    the cache warns once in the log and works in memory only.

    The first write creates the directory. `limit` is its largest size: the least recently used
    entries are removed first. `memory` is the largest size of the copy in memory [bytes]. A key has
    64 hexadecimal digits; an entry has arrays of `TYPES` by name.
    """

    def __init__(self, directory: Path, *, limit: int = LIMIT, memory: int = _MEMORY) -> None:
        self.directory = directory
        self.limit = limit
        self._memory = memory
        self._entries: OrderedDict[str, Entry] = OrderedDict()
        self._size = 0
        self._lock = threading.Lock()
        self._untrimmed = False
        self._silent = False

    def load(self, key: str) -> Entry | None:
        """Return the read-only arrays of a key; None for no file or a damaged one."""
        with self._lock:
            if key in self._entries:
                self._entries.move_to_end(key)
                return self._entries[key]
        path = self._path(key)
        try:
            data = path.read_bytes()
        except OSError:
            return None
        entry = _decode(data, key)
        if entry is not None:
            with contextlib.suppress(OSError):  # read-only directory
                os.utime(path)
            self._remember(key, entry)
        return entry

    def store(self, key: str, entry: Entry) -> None:
        """Store the arrays of a key."""
        data = _encode(entry, key)
        self._remember(key, entry)
        try:
            self.directory.mkdir(parents=True, exist_ok=True)
            with draft_of(self._path(key)) as draft, draft.open("wb") as file:
                self._write(file.write, data)
        except OSError as error:
            if not self._silent:
                _LOG.warning("the cache in %s cannot be written: %s", self.directory, error)
                self._silent = True
            return
        self._untrimmed = True

    @staticmethod
    def _write(write: Callable[[bytes], object], data: bytes) -> None:
        write(data)

    def trim(self) -> None:
        """Trim the directory to its limit if anything was written since the last time.

        The least recently used entries and the files of dead processes are removed.
        """
        if not self._untrimmed:
            return
        self._untrimmed = False
        files: list[tuple[float, int, Path]] = []
        now = time.time()
        with contextlib.suppress(OSError):
            for item in os.scandir(self.directory):
                # another process may remove a file at any moment
                with contextlib.suppress(OSError):
                    state = item.stat()
                    if item.name.endswith(_SUFFIX):
                        files.append((state.st_mtime, state.st_size, Path(item.path)))
                    elif item.name.endswith(_UNFINISHED) and now - state.st_mtime > _ABANDONED:
                        Path(item.path).unlink()
        total = sum(size for _, size, _ in files)
        if total <= self.limit:
            return
        for _, size, path in sorted(files):
            if total <= REMAINS * self.limit:
                break
            with contextlib.suppress(OSError):
                path.unlink()
            total -= size

    def _path(self, key: str) -> Path:
        return self.directory / f"{key}{_SUFFIX}"

    def _remember(self, key: str, entry: Entry) -> None:
        size = sum(a.nbytes for a in entry.values())
        if size > self._memory:
            return
        with self._lock:
            if (old := self._entries.pop(key, None)) is not None:
                self._size -= sum(a.nbytes for a in old.values())
            self._entries[key] = entry
            self._size += size
            while self._size > self._memory:
                _, old = self._entries.popitem(last=False)
                self._size -= sum(a.nbytes for a in old.values())


def _encode(entry: Entry, key: str) -> bytes:
    parts, table = [], []
    for name, array in entry.items():
        kind = next(t for t in TYPES if np.dtype(t).kind == array.dtype.kind)
        data = np.asarray(array, dtype=kind)
        table.append([name, kind, list(data.shape)])
        parts.append(data.tobytes())
    header = json.dumps(table).encode()
    body = b"".join((bytes.fromhex(key), _LENGTH.pack(len(header)), header, *parts))
    return _MARK + hashlib.sha256(body).digest() + body


def _decode(data: bytes, key: str) -> Entry | None:
    """Return the arrays of a complete file of a key; None for any other file."""
    view = memoryview(data)[_START:]
    complete = data.startswith(_MARK) and hashlib.sha256(view).digest() == data[len(_MARK) : _START]
    if not complete or view[:_DIGEST] != bytes.fromhex(key):
        return None
    at = _DIGEST + _LENGTH.size
    (length,) = _LENGTH.unpack(view[_DIGEST:at])
    table = json.loads(bytes(view[at : at + length]))
    at += length
    entry: dict[str, NDArray] = {}
    for name, kind, shape in table:
        count = int(np.prod(shape, dtype=np.int64))
        # a view of bytes, so that it cannot be written to
        entry[name] = np.frombuffer(view, dtype=kind, count=count, offset=at).reshape(shape)
        at += count * np.dtype(kind).itemsize
    return entry


_OPEN: dict[Path, Cache] = {}


def open_cache(cache: "Cache | Path | str | bool | None") -> Cache | None:
    """Return a cache: that of the user for True, none for False and None.

    A directory has one cache per process.
    """
    if cache is None or cache is False:
        return None
    if isinstance(cache, Cache):
        return cache
    directory = user_folder("cache") / "computed" if cache is True else Path(cache)
    return _OPEN.setdefault(directory, Cache(directory))
