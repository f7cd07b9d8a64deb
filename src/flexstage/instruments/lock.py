"""Locks: one program at a time moves a stage. A lock ends with its program."""

import hashlib
import json
import os
import re
import socket
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from pathlib import Path

from flexstage.base.errors import ModelError, NotConnectedError
from flexstage.files.decoder import read_json
from flexstage.files.format import Format
from flexstage.files.names import user_folder
from flexstage.instruments.protocol import Instrument


@dataclass(frozen=True, slots=True, kw_only=True)
class Holder:
    """The program that has locked a stage."""

    pid: int
    """Process identifier."""
    host: str
    """Name of the computer."""
    since: str
    """Date and time of the lock, UTC."""
    program: str
    """Command line of the program."""


_NOTE = Format(noun="note of who holds a stage", error=ModelError, later=True, exact=True)


@contextmanager
def stage_lock(
    serial_number: str, *, directory: Path | None = None, timeout: float = 0.0
) -> Iterator[Path]:
    """Lock a stage for this program.

    If another program has locked it, this waits for `timeout` [s]; `NotConnectedError` then names
    the other program. The operating system releases the lock when the process ends, however it
    ends. The context is the file of the lock.

    Validity: programs of one user on one computer, or all that share ``$FLEXSTAGE_STATE``, on a
    file system with locks. The lock does not stop a program that controls the instrument directly.
    """
    lock_file, note = _files(serial_number, directory)
    mend = "set FLEXSTAGE_STATE to a writable directory on a local disk"
    other = "if this is another stage, give it its own serial number"
    with _locked(lock_file, note, f"stage '{serial_number}'", mend, other, timeout=timeout):
        yield lock_file


@contextmanager
def folder_lock(folder: Path) -> Iterator[None]:
    """Lock the folder of a run for this program, like `stage_lock` a stage.

    The lock is a hidden file in the folder.
    """
    lock_file = folder / ".lock"
    mend = "choose a writable folder on a local disk"
    what = f"the run in '{folder}'"
    with _locked(lock_file, folder / ".lock.json", what, mend, "choose another folder"):
        yield


@contextmanager
def _locked(
    lock_file: Path, note: Path, what: str, mend: str, other: str, *, timeout: float = 0.0
) -> Iterator[None]:
    from filelock import FileLock, Timeout

    try:
        lock_file.parent.mkdir(parents=True, exist_ok=True)
        # The lock belongs to the program, not to the thread that acquired it.
        lock = FileLock(lock_file, thread_local=False)
        lock.acquire(timeout=timeout, poll_interval=0.02)
    except Timeout:
        raise NotConnectedError(_in_use(what, note, other)) from None
    except (OSError, NotImplementedError) as error:
        raise ModelError(
            f"the lock of {what} cannot be created in {lock_file.parent}: {error}; {mend}"
        ) from error
    try:
        _write(note)
        yield
    finally:
        with suppress(OSError):
            note.unlink()
        lock.release()


@contextmanager
def instrument_lock(instrument: Instrument, name: str, *, locked_as: str = "") -> Iterator[None]:
    """Lock the stage of an instrument by its name; a simulated one needs no lock.

    Nothing is done where this program has already locked the stage, under the name `locked_as`.
    """
    if instrument.identity.simulated or name == locked_as:
        yield
        return
    with stage_lock(name):
        yield


def holder(serial_number: str, *, directory: Path | None = None) -> Holder | None:
    """Return the program that has locked a stage, or that locked it last and was killed."""
    return _read(_files(serial_number, directory)[1])


def _files(serial_number: str, directory: Path | None) -> tuple[Path, Path]:
    if not serial_number.strip():
        raise ModelError("the lock of a stage needs a serial number: give one in the plan")
    name = re.sub(r"[^A-Za-z0-9.-]", "_", serial_number)[:60]
    if name != serial_number:  # different serial numbers have different file names
        name += f"-{hashlib.sha256(serial_number.encode()).hexdigest()[:10]}"
    where = user_folder("state") / "locks" if directory is None else directory
    return where / f"stage-{name}.lock", where / f"stage-{name}.json"


def _write(note: Path) -> None:
    me = Holder(
        pid=os.getpid(),
        host=socket.gethostname(),
        since=datetime.now(UTC).isoformat(timespec="seconds"),
        program=" ".join([Path(sys.argv[0] or sys.executable).name, *sys.argv[1:]])[:200],
    )
    part = note.with_suffix(f".{os.getpid()}.part")
    # The lock itself is sufficient: on a full disk only the name of its holder is missing.
    with suppress(OSError):
        part.write_text(json.dumps(asdict(me)), encoding="utf-8")
        part.replace(note)


def _read(note: Path) -> Holder | None:
    with suppress(OSError, ModelError):
        return read_json(Holder, note.read_bytes(), str(note), _NOTE)
    return None


def _in_use(what: str, note: Path, other: str) -> str:
    holder = _read(note)
    program = (
        "another program, whose name is unknown"
        if holder is None
        else f"'{holder.program}' (process {holder.pid} on {holder.host}, since {holder.since})"
    )
    return f"{what} is in use by {program}: end that program first, or {other}"
