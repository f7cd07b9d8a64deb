"""Writing files whole or not at all: no other module of the package replaces a file."""

import contextlib
import errno
import os
import sys
import tempfile
from collections.abc import Iterator, Mapping
from pathlib import Path

from flexstage.base.errors import FlexstageError


@contextlib.contextmanager
def draft_of(target: Path) -> Iterator[Path]:
    """Give an empty file beside a place, which is moved there, on disk, when the block is done.

    Where the block fails it goes, and what was in the place stays. A file that was there hands its
    rights on; a new one is as readable as any.
    """
    draft = _begin(target)
    try:
        yield draft
        _settle(draft, target)
    finally:
        with contextlib.suppress(FileNotFoundError):
            draft.unlink()


def write_whole(
    path: str | os.PathLike[str],
    content: bytes | str,
    error: type[FlexstageError] | None = None,
) -> None:
    """Write a file; it appears whole or not at all.

    Where it cannot be written an `error` says so, or the OSError where none is given.
    """
    target = Path(path)
    try:
        with draft_of(target) as draft:
            draft.write_bytes(content.encode("utf-8") if isinstance(content, str) else content)
    except OSError as fault:
        if error is None:
            raise type(fault)(fault.errno, fault.strerror, str(target)) from fault
        reason = fault.strerror or str(fault)
        raise error(f"the file {target} cannot be written: {reason}") from fault


def write_files(directory: Path, contents: Mapping[str, bytes]) -> list[Path]:
    """Write some files into a directory: every one of them, or none.

    None is in its place before all are complete. The directory is made where it does not exist;
    names may have folders inside it, ``FOLDER/NAME``.
    """
    drafts: list[tuple[Path, Path]] = []
    made: list[Path] = []
    try:
        _make(directory, made)
        for name, content in contents.items():
            target = directory / name
            _make(target.parent, made)
            try:
                draft = _begin(target)
                drafts.append((draft, target))
                draft.write_bytes(content)
                _to_disk(draft)
            except OSError as error:
                # the reader knows the file that was wanted, and not the one beside it
                raise type(error)(error.errno, error.strerror, str(target)) from error
        for draft, target in drafts:
            _settle(draft, target, synced=True)
    finally:
        for draft, _ in drafts:
            with contextlib.suppress(FileNotFoundError):
                draft.unlink()
        # those that a failure left empty; the others hold files and stay
        for folder in reversed(made):
            with contextlib.suppress(OSError):
                folder.rmdir()
    return [target for _, target in drafts]


def require_writable(directory: Path) -> None:
    """Refuse a directory that cannot be written to, before the work whose result goes there.

    It need not exist, and is not made: the nearest directory above must take it then.
    """
    nearest = directory
    while not nearest.exists() and nearest != nearest.parent:
        nearest = nearest.parent
    if not nearest.is_dir():
        raise NotADirectoryError(errno.ENOTDIR, os.strerror(errno.ENOTDIR), str(nearest))
    try:  # rights alone do not tell: some folders take no file from anyone
        tempfile.TemporaryFile(dir=nearest).close()
    except OSError as error:
        said = f"no file can be made there ({error.strerror})"
        raise type(error)(error.errno, said, str(nearest)) from error


def sync_folder(folder: Path) -> None:
    """Force the names in a folder to the disk, where the system can."""
    if sys.platform == "win32":
        return
    # some network file systems cannot; the files are there all the same
    with contextlib.suppress(OSError):
        handle = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(handle)
        finally:
            os.close(handle)


def _begin(target: Path) -> Path:
    if target.is_dir():
        raise IsADirectoryError(errno.EISDIR, "it is a directory", str(target))
    if target.exists() and not target.is_file():  # /dev/null would become a file
        raise OSError(errno.EINVAL, "it is no regular file, which could be replaced", str(target))
    handle, name = tempfile.mkstemp(prefix=f".{target.name}.", suffix=".part", dir=target.parent)
    os.close(handle)
    return Path(name)


def _to_disk(draft: Path) -> None:
    with draft.open("r+b") as file:  # some systems force only files to disk that may be written
        os.fsync(file.fileno())


def _settle(draft: Path, target: Path, *, synced: bool = False) -> None:
    if not synced:
        _to_disk(draft)
    draft.chmod(target.stat().st_mode & 0o777 if target.exists() else 0o666 & ~_mask())
    draft.replace(target)
    sync_folder(target.parent)


def _mask() -> int:
    # it can only be read by setting it
    mask = os.umask(0o077)
    os.umask(mask)
    return mask


def _make(directory: Path, made: list[Path]) -> None:
    """Make a directory and those above it, and put down which were not there."""
    missing = []
    while not directory.exists():
        missing.append(directory)
        directory = directory.parent
    for folder in reversed(missing):
        folder.mkdir(exist_ok=True)
        made.append(folder)
