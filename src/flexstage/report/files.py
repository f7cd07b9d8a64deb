"""Writing files whole or not at all."""

import contextlib
import errno
import os
import tempfile
from collections.abc import Mapping
from pathlib import Path


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


def write_files(directory: Path, contents: Mapping[str, bytes]) -> list[Path]:
    """Write some files into a directory: every one of them, or none.

    Each is written under another name beside its place and moved there when all are complete, so
    a reader never sees half a file, and a failure leaves what was there before.

    The directory is made where it does not exist; names may have folders inside it,
    ``FOLDER/NAME``.
    """
    drafts: list[tuple[Path, Path]] = []
    made: list[Path] = []
    try:
        _make(directory, made)
        for name, content in contents.items():
            target = directory / name
            if target.is_dir():
                raise IsADirectoryError(f"'{target}' is a directory")
            _make(target.parent, made)
            draft = _draft(target.parent, target, content)
            drafts.append((draft, target))
        for draft, target in drafts:
            draft.replace(target)
    finally:
        for draft, _ in drafts:
            with contextlib.suppress(FileNotFoundError):
                draft.unlink()
        # those that a failure left empty; the others hold files and stay
        for folder in reversed(made):
            with contextlib.suppress(OSError):
                folder.rmdir()
    return [target for _, target in drafts]


def _make(directory: Path, made: list[Path]) -> None:
    """Make a directory and those above it, and put down which were not there."""
    missing = []
    while not directory.exists():
        missing.append(directory)
        directory = directory.parent
    for folder in reversed(missing):
        folder.mkdir(exist_ok=True)
        made.append(folder)


def _draft(directory: Path, target: Path, content: bytes) -> Path:
    try:
        handle, name = tempfile.mkstemp(prefix=f".{target.name}.", suffix=".part", dir=directory)
    except OSError as error:
        # the reader knows the file that was wanted, and not the one beside it
        raise type(error)(error.errno, error.strerror, str(target)) from error
    draft = Path(name)
    try:
        with os.fdopen(handle, "wb") as stream:
            try:
                stream.write(content)
                stream.flush()
                os.fsync(stream.fileno())
            except OSError as error:
                raise type(error)(error.errno, error.strerror, str(target)) from error
        # a draft is private to its owner; a result is as readable as any new file
        mask = os.umask(0)
        os.umask(mask)
        draft.chmod(0o666 & ~mask)
    except BaseException:
        draft.unlink(missing_ok=True)
        raise
    return draft
