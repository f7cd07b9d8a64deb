"""MATLAB files: versions 4 to 7 by SciPy, version 7.3 as HDF5.

SciPy's reader does not check the type codes and lengths in a file, and a damaged file can end the
process (SciPy 1.17: a type code out of range reads outside its table). The tags are therefore
checked here first: MathWorks, MAT-File Format, 2019, chapter 1.
"""

import struct
import warnings
import zlib
from collections.abc import Container
from pathlib import Path
from typing import Any

import numpy as np

from flexstage.base.errors import RecordError
from flexstage.records.binary_files import read_hdf5
from flexstage.records.columns import FileColumns
from flexstage.records.datasets import (
    Tree,
    chosen_columns,
    most_unpacked,
    reading,
    require_unpacked,
)

_HDF5 = b"\x89HDF\r\n\x1a\n"
_DEEPEST = 12
_MOST_ITEMS = 200


def read_matlab(path: Path, dataset: str | None = None) -> FileColumns:
    """Read the columns of a MATLAB file, of any version.

    `dataset` names variables, ``data.u,data.y``, or a structure, ``data``.
    """
    with path.open("rb") as stream:
        head = stream.read(520)
    if _HDF5 in (head[:8], head[512:520]):
        return read_hdf5(path, dataset)
    from scipy.io import loadmat
    from scipy.io.matlab import matfile_version

    with (
        reading(path, "a MATLAB", ": save it again"),
        warnings.catch_warnings(),
        path.open("rb") as stream,
    ):
        # the version for the reader below, whatever the text at the start of the file
        if matfile_version(stream)[0] != 0:
            stream.seek(0)
            require_sound(stream.read())
        stream.seek(0)
        # it warns of a variable that it cannot read, which is reported as missing
        warnings.simplefilter("ignore")
        variables = loadmat(stream, struct_as_record=True, chars_as_strings=True)
    unread: list[str] = []
    tree = Tree(file_size=path.stat().st_size)
    for name, value in variables.items():
        if not name.startswith("__"):
            _gather(tree, unread, "", name, value)
    if unread and not any(leaf.usable for leaf in tree.leaves):
        raise RecordError(
            f"'{path}' contains objects that only MATLAB reads ({', '.join(unread)}): save their "
            "columns as plain arrays"
        )
    return chosen_columns(tree, dataset)


def _gather(
    tree: Tree, unread: list[str], parent: str, name: str, value: Any, depth: int = 0
) -> None:
    """Gather the arrays, numbers and texts of nested structures and cells."""
    from scipy.io.matlab import MatlabFunction, MatlabOpaque

    if not isinstance(value, np.ndarray) or depth > _DEEPEST:
        return
    fields = value.dtype.names
    if isinstance(value, MatlabOpaque | MatlabFunction):
        unread.append(f"{parent}/{name}" if parent else name)
    elif fields is not None or value.dtype.kind == "O":
        marks = "()" if fields is not None else "{}"
        for i, item in enumerate(value.reshape(-1)[:_MOST_ITEMS]):
            label = name if value.size == 1 else f"{name}{marks[0]}{i + 1}{marks[1]}"
            if fields is None:
                _gather(tree, unread, parent, label, item, depth + 1)
            else:
                path = f"{parent}/{label}" if parent else label
                for field in fields:
                    _gather(tree, unread, path, field, item[field], depth + 1)
    elif value.size == 1 or (value.size and value.dtype.kind not in "US"):
        tree.add(parent, name, value)


# numbers of the types of elements, and of the classes of matrices
_MATRIX, _COMPRESSED = 14, 15
_SIZES = {1: 1, 2: 1, 3: 2, 4: 2, 5: 4, 6: 4, 7: 4, 9: 8, 12: 8, 13: 8}
_NAMES = frozenset((1, 2, 16))
_TEXT_TYPES = frozenset((1, 2, 3, 4, 16, 17, 18))
_CELL, _STRUCT, _OBJECT, _CHAR, _SPARSE, _FUNCTION, _OPAQUE = 1, 2, 3, 4, 5, 16, 17
_NUMERIC = range(6, 16)
_MOST_ENTRIES = 2**32
_DEEPEST_TAG = 40


def _require(sound: bool, fault: str) -> None:
    """Refuse truncated or damaged data."""
    if not sound:
        raise ValueError(fault)


def require_sound(data: bytes) -> None:
    """Refuse a MATLAB 5 file with inconsistent tags, by a ValueError with the reason."""
    order = {b"IM": "<", b"MI": ">"}.get(data[126:128], "")
    _require(bool(order), "its heading is damaged")
    position, unpacked, most = 128, 0, most_unpacked(len(data))
    while position + 8 <= len(data):
        kind, size = struct.unpack_from(f"{order}II", data, position)
        start, position = position + 8, position + 8 + size
        _require(position <= len(data), "it is truncated")
        if kind == _COMPRESSED:
            inner = _inflated(data[start:position], most - unpacked)
            unpacked += len(inner)
            require_unpacked(unpacked, len(data), "the sum of its variables")
            walk = _Tags(inner, order)
            kind, start, end, _ = walk.tag(0, len(inner))
            _require(kind == _MATRIX, "a compressed variable is damaged")
            walk.matrix(start, end, 0)
        else:
            _require(kind == _MATRIX, f"a variable has the unknown type {kind}")
            _Tags(data, order).matrix(start, position, 0)


def _inflated(packed: bytes, most: int) -> bytes:
    """Return an unpacked variable, at most one byte more than allowed."""
    try:
        inner = zlib.decompressobj().decompress(packed, most + 1)
    except zlib.error as error:
        raise ValueError("a compressed variable is damaged") from error
    return inner


class _Tags:
    """Check of the tags of one variable."""

    def __init__(self, data: bytes, order: str) -> None:
        self.data = data
        self.order = order

    def tag(self, at: int, end: int) -> tuple[int, int, int, int]:
        """Return type, start and end of an element, and the start of the next one."""
        _require(at + 8 <= end, "a variable is truncated")
        kind, size = struct.unpack_from(f"{self.order}II", self.data, at)
        if kind >> 16:
            # up to four bytes are in the tag itself
            kind, size, start = kind & 0xFFFF, kind >> 16, at + 4
            following = at + 8
            _require(size <= 4, "a short element is damaged")
        else:
            start = at + 8
            following = start + size + (-size) % 8
        _require(start + size <= end, "an element is longer than its variable")
        return kind, start, start + size, following

    def element(self, at: int, end: int, kinds: Container[int]) -> tuple[int, int, int, int]:
        """Return an element of one of the required types."""
        tag = self.tag(at, end)
        _require(tag[0] in kinds, f"an element has the unexpected type {tag[0]}")
        return tag

    def matrix(self, at: int, end: int, depth: int) -> None:
        """Check a matrix of numbers, texts or other matrices."""
        if at == end:
            return
        _require(depth <= _DEEPEST_TAG, "structures are nested too deeply")
        _, start, stop, at = self.element(at, end, (6,))
        _require(stop - start == 8, "the flags of a variable are damaged")
        (flags,) = struct.unpack_from(f"{self.order}I", self.data, start)
        kind, is_complex = flags & 0xFF, bool(flags & 0x800)
        if kind == _OPAQUE:
            self._opaque(at, end, depth)
            return
        _, start, stop, at = self.element(at, end, (5, 6))
        damaged = "the dimensions of a variable are damaged"
        _require((stop - start) % 4 == 0 and stop - start >= 8, damaged)
        shape = struct.unpack_from(f"{self.order}{(stop - start) // 4}i", self.data, start)
        count = 1
        for n in shape:
            count *= n
            _require(n >= 0 and count <= _MOST_ENTRIES, damaged)
        *_, at = self.element(at, end, _NAMES)
        if kind in _NUMERIC:
            self._numbers(at, end, count, 2 if is_complex else 1)
        elif kind == _CHAR:
            self.element(at, end, _TEXT_TYPES)
        elif kind == _CELL:
            self._items(at, end, count, depth)
        elif kind in (_STRUCT, _OBJECT):
            self._structure(at, end, count, depth, named=kind == _OBJECT)
        elif kind == _SPARSE:
            *_, at = self.element(at, end, (5, 6))
            *_, at = self.element(at, end, (5, 6))
            self.element(at, end, _SIZES)
        else:
            _require(kind == _FUNCTION, f"a variable has the unknown class {kind}")
            self._items(at, end, 1, depth)

    def _numbers(self, at: int, end: int, count: int, parts: int) -> None:
        for _ in range(parts):
            kind, start, stop, at = self.element(at, end, _SIZES)
            _require(
                stop - start == count * _SIZES[kind],
                "the size of a variable contradicts its dimensions",
            )

    def _items(self, at: int, end: int, count: int, depth: int) -> None:
        for _ in range(count):
            _, start, stop, at = self.element(at, end, (_MATRIX,))
            self.matrix(start, stop, depth + 1)

    def _structure(self, at: int, end: int, count: int, depth: int, *, named: bool) -> None:
        if named:
            *_, at = self.element(at, end, _NAMES)
        _, start, stop, at = self.element(at, end, (5, 6))
        width = struct.unpack_from(f"{self.order}i", self.data, start)[0] if stop > start else 0
        _, start, stop, at = self.element(at, end, _NAMES)
        _require(width > 0 and (stop - start) % width == 0, "the names of a structure are damaged")
        self._items(at, end, count * ((stop - start) // width), depth)

    def _opaque(self, at: int, end: int, depth: int) -> None:
        while at < end:
            kind, start, stop, at = self.element(at, end, {*_TEXT_TYPES, *_SIZES, _MATRIX})
            if kind == _MATRIX:
                self.matrix(start, stop, depth + 1)
