"""The catalogue of stages, runs, calibrations and models, and its entries of run folders."""

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self, TypeVar

from sqlalchemy import Connection, Engine, Select, Table, insert, inspect, select, update
from sqlalchemy.exc import (
    DBAPIError,
    IntegrityError,
    InterfaceError,
    OperationalError,
    SQLAlchemyError,
)

from flexstage.base.errors import FlexstageError, NotConnectedError, RecordError
from flexstage.base.provenance import file_hash
from flexstage.files.request import request_fields, request_of
from flexstage.instruments.catalogue.database import (
    CALIBRATIONS,
    METADATA,
    MODELS,
    RUNS,
    STAGES,
    VERSION,
    VERSIONS,
    WRITES,
    Entry,
    address_of,
    catalogue_engine,
    default_catalogue,
    entry_of,
    in_memory,
    is_absent_file,
    question,
    values_of,
)
from flexstage.instruments.catalogue.entries import (
    CalibrationEntry,
    ModelEntry,
    RunEntry,
    RunStatus,
    StageEntry,
)
from flexstage.instruments.recording.archive import examine, file_summary
from flexstage.instruments.recording.stream import STREAM_SUFFIX
from flexstage.instruments.requests import CalibrationsRequest, OfStage, RunsRequest

_T = TypeVar("_T")
# other programs may enter the same stage between query and insertion
_TRIES = 8


class Catalogue:
    """Stages, runs, calibrations and models in a database.

    Several programs may read and write it at once. Entries of runs can be restored from the folders
    of the runs, but not calibrations and models. A method raises `NotConnectedError` where the
    database cannot be reached.

    Examples
    --------
    >>> import tempfile
    >>> from datetime import UTC, datetime
    >>> stage = StageEntry(name="vgtu-piezo", serial_number="7")
    >>> start = datetime(2031, 5, 17, 9, 30, tzinfo=UTC)
    >>> run = RunEntry(identifier="0123" * 8, stage=stage, started=start, kind="motion")
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     with Catalogue.open(f"{folder}/catalogue.sqlite") as catalogue:
    ...         entered = catalogue.enter_run(run)
    ...         runs = catalogue.runs(serial_number="7")
    >>> entered, runs == [run]
    (True, True)
    """

    def __init__(self, engine: Engine, address: str = "") -> None:
        self._engine = engine
        self._address = address or engine.url.render_as_string(hide_password=True)

    @classmethod
    def open(cls, address: str | None = None, *, make: bool = True) -> Self:
        """Open a catalogue, by default that of the user.

        With `make`, its tables are created in an empty database. Without, an empty database or a
        missing file is an empty catalogue, and nothing is written. Other versions are refused.
        """
        where = address or default_catalogue()
        if make or not is_absent_file(where):
            opened = cls(catalogue_engine(where))
            try:
                if make:
                    opened._make_tables()
                if make or opened._is_made():
                    return opened
            except BaseException:
                opened.close()
                raise
            opened.close()
        empty = cls(in_memory(), address_of(where))
        empty._make_tables()
        return empty

    @property
    def address(self) -> str:
        """Its address, without a password."""
        return self._address

    def close(self) -> None:
        """Close all connections to the database."""
        self._engine.dispose()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _is_made(self) -> bool:
        return self.read(self._has_tables)

    def _make_tables(self) -> None:
        def work(connection: Connection) -> None:
            if not self._has_tables(connection):
                METADATA.create_all(connection, checkfirst=False)
                connection.execute(insert(VERSIONS).values(version=VERSION))

        if self._is_made():
            return
        try:
            self.write(work)
        except FlexstageError:
            # if two programs create the tables at once, the second one fails
            if not self._is_made():
                raise

    def _has_tables(self, connection: Connection) -> bool:
        """Return whether a database has the tables of this version; refuse other tables."""
        there = set(inspect(connection).get_table_names())
        if VERSIONS.name in there:
            version = connection.scalar(select(VERSIONS.c.version))
            if version != VERSION:
                raise RecordError(
                    f"the catalogue {self.address} is of version {version}, and this flexstage "
                    f"reads and writes version {VERSION} only: use the flexstage that made it, or "
                    "enter the runs anew, by 'flexstage runs add FOLDER --catalogue URL' with an "
                    "empty database or a new file"
                )
            return True
        if there & set(METADATA.tables):
            raise RecordError(
                "the database belongs to another program: use a separate database for the catalogue"
            )
        return False

    def read(self, work: Callable[[Connection], _T]) -> _T:
        """Carry out work that only reads."""
        with _translated(self.address), self._engine.connect() as connection, connection.begin():
            return work(connection)

    def write(self, work: Callable[[Connection], _T]) -> _T:
        """Carry out work in one transaction; repeat it if another program interfered."""
        with _translated(self.address):
            for _ in range(_TRIES - 1):
                try:
                    return self._once(work)
                except IntegrityError:
                    continue
            return self._once(work)

    def _once(self, work: Callable[[Connection], _T]) -> _T:
        link = self._engine.connect().execution_options(**{WRITES: True})
        with link as connection, connection.begin():
            return work(connection)

    def enter_run(self, entry: RunEntry) -> bool:
        """Enter a run, or update its entry; return whether it is new."""

        def work(connection: Connection) -> bool:
            existing = select(RUNS.c.id).where(RUNS.c.identifier == entry.identifier)
            return _enter(connection, RUNS, entry, existing)

        return self.write(work)

    def enter_calibration(self, entry: CalibrationEntry) -> None:
        """Enter a calibration, in addition to earlier ones.

        Its run must be in the catalogue.
        """
        self.write(
            lambda connection: connection.execute(
                insert(CALIBRATIONS).values(values_of(connection, CALIBRATIONS, entry))
            )
        )

    def enter_model(self, entry: ModelEntry) -> None:
        """Enter a model; it replaces one of the same file of the same run.

        Its run must be in the catalogue.
        """

        def work(connection: Connection) -> bool:
            existing = select(MODELS.c.id).where(MODELS.c.file == entry.file)
            of = RUNS.c.identifier == entry.run if entry.run else MODELS.c.run_id.is_(None)
            return _enter(
                connection, MODELS, entry, existing.outerjoin_from(MODELS, RUNS).where(of)
            )

        self.write(work)

    def stages(self) -> list[StageEntry]:
        """Return all stages, by name and serial number."""
        query = question(STAGES).order_by(STAGES.c.name, STAGES.c.serial_number, STAGES.c.id)
        return self._entries(StageEntry, STAGES, query)

    def runs(self, request: RunsRequest | None = None, **options: Any) -> list[RunEntry]:
        """Return runs, the latest first.

        Options are fields of `RunsRequest`, in place of those of the request, and other fields of
        `RunEntry` with a single value: ``axis="x", status="failed"``.
        """
        request_names = request_fields(RunsRequest)
        values = {
            RUNS.c[n]: options.pop(n)
            for n in tuple(options)
            if n in RUNS.c and n not in request_names
        }
        request = request_of(RunsRequest, request, options)
        values.setdefault(RUNS.c.kind, request.test)
        query = _where(_of_stage(RUNS, request), values)
        if request.since is not None:
            query = query.where(RUNS.c.started >= request.since)
        query = query.order_by(RUNS.c.started.desc(), RUNS.c.id.desc()).limit(request.limit)
        return self._entries(RunEntry, RUNS, query)

    def run(self, identifier: str) -> RunEntry:
        """Return a run by its identifier, or by the start of it if that is unique."""
        prefix = identifier.strip().lower()
        if not prefix or not set(prefix) <= set("0123456789abcdef"):
            raise RecordError(
                "a run is named by the first digits of its identifier, hexadecimal digits such as "
                f"3f9a, got '{identifier[:40]}'"
            )
        query = question(RUNS).where(RUNS.c.identifier.startswith(prefix)).limit(3)
        entries = self._entries(RunEntry, RUNS, query)
        if len(entries) == 1:
            return entries[0]
        if entries:
            raise RecordError(
                f"the identifiers of several runs start with '{prefix}', such as "
                f"{entries[0].identifier} and {entries[1].identifier}: give more digits"
            )
        raise RecordError(
            f"no run of the catalogue has an identifier that starts with '{prefix}': list the runs "
            "with 'flexstage runs'"
        )

    def calibrations(
        self, request: CalibrationsRequest | None = None, **options: Any
    ) -> list[CalibrationEntry]:
        """Return calibrations, the latest first.

        With `valid_at`, only the calibration of each quantity that is valid at this time, the
        latest that started before. Options are fields of `CalibrationsRequest`, in place of those
        of the request.
        """
        request = request_of(CalibrationsRequest, request, options)
        at = request.valid_at
        query = _where(_of_stage(CALIBRATIONS, request), {CALIBRATIONS.c.what: request.what})
        if at is not None:
            query = query.where(CALIBRATIONS.c.valid_from <= at)
        query = query.order_by(CALIBRATIONS.c.valid_from.desc(), CALIBRATIONS.c.id.desc())
        entries = self._entries(CalibrationEntry, CALIBRATIONS, query)
        if at is None:
            return entries
        valid: dict[tuple[str, str, str], CalibrationEntry] = {}
        for entry in entries:
            valid.setdefault((entry.stage.name, entry.stage.serial_number, entry.what), entry)
        return list(valid.values())

    def models(self, *, run: str | None = None) -> list[ModelEntry]:
        """Return models, the latest first; `run` is the identifier of their run."""
        query = _where(question(MODELS), {RUNS.c.identifier: run})
        query = query.order_by(MODELS.c.created.desc(), MODELS.c.id.desc())
        return self._entries(ModelEntry, MODELS, query)

    def _entries(self, kind: type[Entry], table: Table, query: Select[Any]) -> list[Entry]:
        return self.read(
            lambda connection: [entry_of(kind, table, row) for row in connection.execute(query)]
        )


def _of_stage(table: Table, request: OfStage) -> Select[Any]:
    """Return the query for the entries of a stage in a table."""
    stage = {STAGES.c.name: request.stage, STAGES.c.serial_number: request.serial_number}
    return _where(question(table), stage)


def _where(query: Select[Any], values: Mapping[Any, Any]) -> Select[Any]:
    """Restrict a query to values of columns; None for any value."""
    return query.where(*(c == value for c, value in values.items() if value is not None))


def _enter(connection: Connection, table: Table, entry: Any, existing: Select[Any]) -> bool:
    """Insert an entry, or update an existing row; return whether it is new."""
    values = values_of(connection, table, entry)
    number = connection.scalar(existing)
    if number is None:
        connection.execute(insert(table).values(values))
    else:
        connection.execute(update(table).where(table.c.id == number).values(values))
    return number is None


@contextmanager
def _translated(address: str) -> Iterator[None]:
    """Translate database errors in this block into errors of flexstage."""
    try:
        yield
    except (OperationalError, InterfaceError) as error:
        raise NotConnectedError(
            f"the catalogue {address} cannot be used ({_reason(error)}): the runs are saved in "
            "their folders; enter them later with 'flexstage runs add FOLDER'"
        ) from error
    except SQLAlchemyError as error:
        raise RecordError(
            f"the catalogue {address} is not valid ({_reason(error)}): check that it is a "
            "catalogue of flexstage"
        ) from error


def _reason(error: SQLAlchemyError) -> str:
    lines = str(error.orig if isinstance(error, DBAPIError) else error).strip().splitlines()
    return (lines or [type(error).__name__])[0].strip()[:200]


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
    status: RunStatus
    if path.suffix == ".h5":
        summary = file_summary(path)
        metadata, samples, rate = summary.metadata, summary.samples, summary.sample_rate_hz
        status, lost = "complete" if summary.complete else "recovered", summary.lost
    else:
        recovery = examine(path)
        metadata, rate = recovery.head.run, recovery.head.sample_rate_hz
        samples, status, lost = recovery.samples, "failed", "; ".join(recovery.notes)
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
