"""Atomic writing of files; no other module of the package replaces a file."""

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
    """Yield an empty temporary file, which replaces the target at the end of the block.

    If the block fails, it is removed and the target does not change. The target keeps its
    permissions; a new file has the usual ones.
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
    """Write a file atomically.

    If it cannot be written, an `error` is raised, or OSError where none is given.
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
    """Write files into a directory: all of them or none.

    No file is in its place before all are complete. A missing directory is created; names may have
    folders, ``FOLDER/NAME``.
    """
    drafts: list[tuple[Path, Path]] = []
    created: list[Path] = []
    try:
        _make(directory, created)
        for name, content in contents.items():
            target = directory / name
            _make(target.parent, created)
            try:
                draft = _begin(target)
                drafts.append((draft, target))
                draft.write_bytes(content)
                _to_disk(draft)
            except OSError as error:
                # name the target, not the temporary file
                raise type(error)(error.errno, error.strerror, str(target)) from error
        for draft, target in drafts:
            _settle(draft, target, synced=True)
    finally:
        for draft, _ in drafts:
            with contextlib.suppress(FileNotFoundError):
                draft.unlink()
        # folders that are empty after a failure; others are kept
        for folder in reversed(created):
            with contextlib.suppress(OSError):
                folder.rmdir()
    return [target for _, target in drafts]


def require_writable(directory: Path) -> None:
    """Refuse a directory that cannot be written to, before the computation of its content.

    It need not exist and is not created: then the nearest directory above must be writable.
    """
    nearest = directory
    while not nearest.exists() and nearest != nearest.parent:
        nearest = nearest.parent
    if not nearest.is_dir():
        raise NotADirectoryError(errno.ENOTDIR, os.strerror(errno.ENOTDIR), str(nearest))
    try:  # permissions are not enough: some folders accept no file
        tempfile.TemporaryFile(dir=nearest).close()
    except OSError as error:
        message = f"no file can be created there ({error.strerror})"
        raise type(error)(error.errno, message, str(nearest)) from error


def sync_folder(folder: Path) -> None:
    """Flush the names in a folder to disk, where the system supports it."""
    if sys.platform == "win32":
        return
    # some network file systems do not; the files exist anyway
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
        raise OSError(errno.EINVAL, "it is not a regular file and cannot be replaced", str(target))
    handle, name = tempfile.mkstemp(prefix=f".{target.name}.", suffix=".part", dir=target.parent)
    os.close(handle)
    return Path(name)


def _to_disk(draft: Path) -> None:
    with draft.open("r+b") as file:  # some systems flush only writable files
        os.fsync(file.fileno())


def _settle(draft: Path, target: Path, *, synced: bool = False) -> None:
    if not synced:
        _to_disk(draft)
    draft.chmod(target.stat().st_mode & 0o777 if target.exists() else 0o666 & ~_mask())
    draft.replace(target)
    sync_folder(target.parent)


def _mask() -> int:
    # the mask can only be read by setting it
    mask = os.umask(0o077)
    os.umask(mask)
    return mask


def _make(directory: Path, created: list[Path]) -> None:
    """Create a directory and its parents, and record the new ones."""
    missing = []
    while not directory.exists():
        missing.append(directory)
        directory = directory.parent
    for folder in reversed(missing):
        folder.mkdir(exist_ok=True)
        created.append(folder)
