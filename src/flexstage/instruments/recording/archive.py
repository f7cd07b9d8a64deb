"""A stream as an HDF5 file that `read_record` reads: written, read back, then put in place."""

import shutil
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from flexstage.errors import RecordError
from flexstage.files.write import draft_of
from flexstage.instruments.recording.metadata import (
    ENDING,
    LOST,
    RUN,
    RunMetadata,
    read_description,
    run_attributes,
)
from flexstage.instruments.recording.recovery import StreamRecovery, chunks, examine
from flexstage.instruments.recording.stream import StreamHead, in_use
from flexstage.records.write import file_keys, file_label

#: What an HDF5 file holds beside its samples [bytes].
_OVERHEAD = 64 * 1024


def archived(stream: Path, target: Path) -> Path:
    """Write what is whole in a stream as a new HDF5 file, and read it back; the stream stays.

    A dataset for each channel, with its ``unit`` and ``name``; the sample rate, or times where
    samples are missing; what is known of the run. The file appears under its name when all of it is
    on disk and was compared with the stream, bit by bit.
    """
    if target.exists():
        raise RecordError(f"'{target}' exists: no run is written over")
    try:
        found = examine(stream)
        _require_room(stream, target.parent, found)
        with draft_of(target) as draft:
            _write(draft, stream, found)
            _verify(draft, stream, found)
    except RecordError:
        raise
    except (OSError, RuntimeError) as error:  # h5py tells some failures of a disk as the latter
        reason = (str(error).strip().splitlines() or [type(error).__name__])[0][:160]
        raise RecordError(
            f"'{target}' cannot be written ({reason}): the stream '{stream}' stays"
        ) from error
    return target


def rescued(stream: Path, target: Path | None = None, *, remove: bool = False) -> Path:
    """Write what a crash has left of a stream as an HDF5 file, beside it where none is named.

    Refused while another program writes the stream. It may be removed afterwards; one that a disk
    has damaged stays in any case.
    """
    if in_use(stream):
        raise RecordError(
            f"'{stream}' is being written by another program: wait until it ends, or look at it "
            "with --look"
        )
    made = archived(stream, target or stream.with_suffix(".h5"))
    if remove and not examine(stream).damaged_inside:
        stream.unlink()
    return made


def _is_whole(found: StreamRecovery) -> bool:
    """Return whether the samples are evenly spaced, so that the record has no times."""
    return not any(part.kind != "overlap" for part in found.lost)


def _require_room(stream: Path, folder: Path, found: StreamRecovery) -> None:
    """Refuse a disk that is too full; h5py writes tracebacks of its own when it finds that out."""
    columns = len(found.head.channels) + (not _is_whole(found))
    needed = _OVERHEAD + 8 * found.samples * columns
    free = shutil.disk_usage(folder).free
    if free < needed:
        raise RecordError(
            f"'{folder}' has {free / 1e6:.1f} MB of room, and the record needs {needed / 1e6:.1f} "
            f"MB: all {found.samples} samples are safe in '{stream}'; make room, then "
            f"'flexstage runs recover {stream}'"
        )


def _keys(head: StreamHead) -> list[str]:
    return file_keys((name for name, _ in head.channels), (RUN, "time"))


def _write(draft: Path, stream: Path, found: StreamRecovery) -> None:
    import h5py

    head = found.head
    total = found.samples
    whole = _is_whole(found)
    if total < 2:
        raise RecordError(
            f"'{stream}' holds {total} whole samples, and a record needs two: the stream stays"
        )
    with h5py.File(draft, "w", track_order=True) as file:
        _describe(file, found)
        if whole:
            file.attrs["sample_rate_hz"] = head.sample_rate_hz
            times = None
        else:
            # a name that no reader takes for the rate of evenly spaced samples
            file.attrs["nominal_rate_hz"] = head.sample_rate_hz
            times = _dataset(file, "time", "time", "s", total)
        sets = [
            _dataset(file, key, file_label(name, unit), unit, total)
            for key, (name, unit) in zip(_keys(head), head.channels, strict=True)
        ]
        at = 0
        for first, part in chunks(stream, found):
            rows = slice(at, at + part.shape[1])
            for dataset, values in zip(sets, part, strict=True):
                dataset[rows] = values
            if times is not None:
                times[rows] = np.arange(first, first + part.shape[1]) / head.sample_rate_hz
            at = rows.stop


def _describe(file: Any, found: StreamRecovery) -> None:
    for key, value in run_attributes(found.head.run, found.complete, found.notes).items():
        if key == RUN:
            # of any length, and so no attribute; of a fixed one, which Octave reads as well
            file.create_dataset(key, data=np.bytes_(str(value).encode()))
        else:
            file.attrs[key] = value


def _dataset(file: Any, key: str, label: str, unit: str, size: int) -> Any:
    dataset = file.create_dataset(key, shape=(size,), dtype="<f8", track_times=False)
    dataset.attrs["name"] = label
    dataset.attrs["unit"] = unit
    return dataset


def _verify(draft: Path, stream: Path, found: StreamRecovery) -> None:
    """Compare every sample of the file with the stream."""
    import h5py

    with h5py.File(draft, "r") as opened:
        file: Any = opened
        sets = [file[key] for key in _keys(found.head)]
        at = 0
        for _, part in chunks(stream, found):
            rows = slice(at, at + part.shape[1])
            for dataset, values in zip(sets, part, strict=True):
                # as bytes, so that a value that is no number is equal to itself
                if np.asarray(dataset[rows]).tobytes() != values.tobytes():
                    raise RecordError(
                        f"what was read back of '{stream}' is not what was written: the disk may "
                        "be damaged, and the stream stays"
                    )
            at = rows.stop


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
            metadata = read_description(file[RUN][()], path)
            sets = [file[key] for key in file if key not in (RUN, "time")]
            rate = file.attrs.get("sample_rate_hz", file.attrs.get("nominal_rate_hz"))
            return RunFile(
                metadata=metadata,
                channels=tuple((str(d.attrs["name"]), str(d.attrs["unit"])) for d in sets),
                samples=int(sets[0].shape[0]),
                sample_rate_hz=float(rate),
                complete=file.attrs[ENDING] == "complete",
                lost=str(file.attrs.get(LOST, "")),
            )
    except RecordError:
        raise
    except (OSError, RuntimeError, LookupError, TypeError, ValueError, AttributeError) as error:
        reason = (str(error).strip().splitlines() or [type(error).__name__])[0][:120]
        raise RecordError(
            f"'{path}' is no whole HDF5 file of a run of flexstage ({reason})"
        ) from error
