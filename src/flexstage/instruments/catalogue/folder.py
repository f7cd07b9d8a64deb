"""Catalogue entries of the folder of a run, from its own files only."""

from dataclasses import dataclass
from pathlib import Path

from flexstage.base.errors import FlexstageError, RecordError
from flexstage.base.provenance import file_hash
from flexstage.instruments.catalogue.catalogue import Catalogue
from flexstage.instruments.catalogue.entries import RunEntry, RunStatus, StageEntry
from flexstage.instruments.recording.archive import examine, file_summary
from flexstage.instruments.recording.metadata import RunMetadata
from flexstage.instruments.recording.stream import STREAM_SUFFIX

#: Fields that an entry has in common with the metadata of its run.
_SHARED = ("plan", "step", "kind", "axis", "operator", "note", "version", "seed")


@dataclass(frozen=True, slots=True, kw_only=True)
class Entered:
    """Result of entering a folder."""

    runs: tuple[RunEntry, ...]
    """The runs of the folder."""
    new: int
    """Number of runs that were not in the catalogue before."""
    problems: tuple[str, ...]
    """Runs that could not be entered, with reasons."""


def folder_entries(folder: str | Path) -> tuple[tuple[RunEntry, ...], tuple[str, ...]]:
    """Return the runs of a folder, and messages on files that could not be read.

    A run of which there is only a stream has failed.
    """
    place = Path(folder)
    entries: list[RunEntry] = []
    problems: list[str] = []
    for path in run_files(place):
        try:
            entries.append(_entry(path, place.resolve()))
        except RecordError as error:
            problems.append(str(error))
        except OSError as error:
            problems.append(f"'{path}' cannot be read: {error.strerror or error}")
    return tuple(entries), tuple(problems)


def enter_folder(folder: str | Path, address: str | None = None) -> Entered:
    """Enter all runs of a folder in a catalogue, by default that of the user.

    A failure of the catalogue is reported in the problems, not raised.
    """
    entries, problems = folder_entries(folder)
    new = 0
    all_problems = list(problems)
    try:
        with Catalogue.open(address) as catalogue:
            for entry in entries:
                new += catalogue.enter_run(entry)
    except FlexstageError as error:
        all_problems.append(str(error))
    return Entered(runs=entries, new=new, problems=tuple(all_problems))


def run_files(folder: Path) -> list[Path]:
    """Return the HDF5 files of a run's folder, then the streams without an HDF5 file.

    They are in the folder itself or in its folder ``records``.
    """
    if not folder.is_dir():
        raise RecordError(f"there is no folder '{folder}': give the folder of a run")
    places = [place for place in (folder, folder / "records") if place.is_dir()]
    files = sorted(p for place in places for p in place.iterdir() if not p.name.startswith("."))
    records = [p for p in files if p.suffix == ".h5"]
    streams = [p for p in files if p.suffix == STREAM_SUFFIX]
    return records + [p for p in streams if not p.with_suffix(".h5").exists()]


def _entry(path: Path, folder: Path) -> RunEntry:
    if path.suffix == ".h5":
        summary = file_summary(path)
        status: RunStatus = "complete" if summary.complete else "recovered"
        return _described(
            summary.metadata, path, folder, status, summary.samples, summary.sample_rate_hz,
            summary.lost,
        )  # fmt: skip
    recovery = examine(path)
    return _described(
        recovery.head.run, path, folder, "failed", recovery.samples, recovery.head.sample_rate_hz,
        "; ".join(recovery.notes),
    )  # fmt: skip


def _described(
    metadata: RunMetadata,
    path: Path,
    folder: Path,
    status: RunStatus,
    samples: int,
    rate: float,
    lost: str,
) -> RunEntry:
    if not metadata.identifier:
        raise RecordError(f"'{path}' has no identifier of its run: flexstage did not record it")
    return RunEntry(
        identifier=metadata.identifier,
        stage=StageEntry(
            name=metadata.stage,
            serial_number=metadata.serial_number,
            design=metadata.design,
            hash=metadata.stage_hash,
        ),
        started=metadata.start_time(),
        **{name: getattr(metadata, name) for name in _SHARED},
        instrument=metadata.texts().get("instrument", ""),
        simulated=metadata.instrument.simulated,
        folder=str(folder),
        file=path.resolve().relative_to(folder).as_posix(),
        sha256=file_hash(path),
        status=status,
        samples=samples,
        sample_rate_hz=rate,
        lost=lost,
    )
