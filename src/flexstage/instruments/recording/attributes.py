"""What the file of a run says about it, and reading that without its samples."""

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from flexstage.errors import RecordError
from flexstage.files.decoder import read_json
from flexstage.instruments.recording.frames import StreamHead
from flexstage.instruments.recording.metadata import RUN_DESCRIPTION, RunMetadata
from flexstage.records import Record

#: What the whole description is called, in the file and among the attributes of the record.
RUN = "run"
_LOST, _ENDING = "lost", "ending"
# HDF5 keeps attributes in the head of the file, which has room for 64 KiB
_LONGEST = 1000


def run_attributes(head: StreamHead, complete: bool, lost: Sequence[str]) -> dict[str, str]:
    """Return what a record of a run says about it: all as JSON (``run``), and lines of text.

    `lost` says in words what was lost, or came twice.
    """
    lines = {k: _line(v) for k, v in head.run.texts().items()}
    lines[_ENDING] = "complete" if complete else "recovered"
    if lost:
        lines[_LOST] = _line("; ".join(lost))
    return {**lines, RUN: json.dumps(head.run.plain())}


def _line(text: str) -> str:
    """Return a text that HDF5 can hold as an attribute."""
    line = " ".join(text.replace("\0", " ").split())[:_LONGEST]
    return line.encode("utf-8", "replace").decode("utf-8")


def read_metadata(record: Record) -> RunMetadata:
    """Return what is known of a run from its record."""
    if RUN not in record.attributes:
        raise RecordError(
            f"the record '{record.source}' does not say which run it is of: it was not written by "
            "a recording of flexstage"
        )
    return _described(record.attributes[RUN], record.source)


def _described(text: str | bytes, source: str | Path) -> RunMetadata:
    where = f"the description of the run in {source}"
    return read_json(RunMetadata, text, where, RUN_DESCRIPTION)


@dataclass(frozen=True, slots=True, kw_only=True)
class RunFile:
    """What an HDF5 file of a run says about itself."""

    metadata: RunMetadata
    """What is known of the run."""
    channels: tuple[tuple[str, str], ...]
    """Name and unit of each channel."""
    samples: int
    """Samples of each channel."""
    sample_rate_hz: float
    """Samples in a second [Hz]."""
    complete: bool
    """Whether its stream was ended by its writer, and nothing of it was lost."""
    lost: str
    """What was lost, or came twice, in words; empty where nothing was."""


def file_summary(path: str | Path) -> RunFile:
    """Return what an HDF5 file of a run says about itself, without reading its samples."""
    import h5py

    try:
        with h5py.File(path, "r") as opened:
            file: Any = opened
            metadata = _described(file[RUN][()], path)
            sets = [file[key] for key in file if key not in (RUN, "time")]
            rate = file.attrs.get("sample_rate_hz", file.attrs.get("nominal_rate_hz"))
            return RunFile(
                metadata=metadata,
                channels=tuple((str(d.attrs["name"]), str(d.attrs["unit"])) for d in sets),
                samples=int(sets[0].shape[0]),
                sample_rate_hz=float(rate),
                complete=file.attrs[_ENDING] == "complete",
                lost=str(file.attrs.get(_LOST, "")),
            )
    except RecordError:
        raise
    except (OSError, RuntimeError, LookupError, TypeError, ValueError, AttributeError) as error:
        reason = (str(error).strip().splitlines() or [type(error).__name__])[0][:120]
        raise RecordError(
            f"'{path}' is no whole HDF5 file of a run of flexstage ({reason})"
        ) from error
