"""The tables of a catalogue, as classes; their rows from entries, and entries from rows."""

from collections.abc import Mapping
from datetime import UTC, datetime
from typing import Any, cast

from sqlalchemy import (
    JSON,
    BigInteger,
    DateTime,
    ForeignKey,
    Index,
    Select,
    Text,
    UniqueConstraint,
    select,
)
from sqlalchemy.engine import Dialect
from sqlalchemy.orm import DeclarativeBase, Mapped, Session, mapped_column, relationship
from sqlalchemy.types import TypeDecorator

from flexstage.errors import RecordError
from flexstage.instruments.catalogue.entries import (
    CalibrationEntry,
    ModelEntry,
    RunEntry,
    StageEntry,
)


class UtcTime(TypeDecorator[datetime]):
    """A date and time in UTC, also where a database knows no zones and keeps it without one."""

    impl = DateTime(timezone=True)
    cache_ok = True

    def process_bind_param(self, value: datetime | None, dialect: Dialect) -> datetime | None:
        """Return what the database keeps."""
        if value is None:
            return None
        utc = value.astimezone(UTC)
        return utc if dialect.name == "postgresql" else utc.replace(tzinfo=None)

    def process_result_value(self, value: Any | None, dialect: Dialect) -> datetime | None:
        """Return what the database kept."""
        if value is None:
            return None
        return value.replace(tzinfo=UTC) if value.tzinfo is None else value.astimezone(UTC)


class CleanText(TypeDecorator[str]):
    """A text that every database takes: without zeros and halves of letters."""

    impl = Text
    cache_ok = True

    def process_bind_param(self, value: str | None, dialect: Dialect) -> str | None:
        """Return what the database keeps."""
        return None if value is None else clean(value)


def clean(text: str) -> str:
    """Return a text that every database takes: ``?`` for halves of letters, no zeros."""
    return text.replace("\0", "").encode("utf-8", "replace").decode("utf-8")


class Base(DeclarativeBase):
    """The tables of this version."""


class StageRow(Base):
    """A stage."""

    __tablename__ = "stages"
    __table_args__ = (UniqueConstraint("name", "serial_number", "hash", "design"),)

    id: Mapped[int] = mapped_column(primary_key=True)
    name: Mapped[str] = mapped_column(CleanText)
    serial_number: Mapped[str] = mapped_column(CleanText)
    design: Mapped[str] = mapped_column(CleanText)
    hash: Mapped[str] = mapped_column(CleanText)


class RunRow(Base):
    """A run."""

    __tablename__ = "runs"
    __table_args__ = (Index("runs_by_start", "started"),)

    id: Mapped[int] = mapped_column(primary_key=True)
    identifier: Mapped[str] = mapped_column(CleanText, unique=True)
    stage_id: Mapped[int] = mapped_column(ForeignKey("stages.id"))
    started: Mapped[datetime] = mapped_column(UtcTime)
    plan: Mapped[str] = mapped_column(CleanText)
    step: Mapped[str] = mapped_column(CleanText)
    kind: Mapped[str] = mapped_column(CleanText)
    axis: Mapped[str] = mapped_column(CleanText)
    operator: Mapped[str] = mapped_column(CleanText)
    note: Mapped[str] = mapped_column(CleanText)
    version: Mapped[str] = mapped_column(CleanText)
    instrument: Mapped[str] = mapped_column(CleanText)
    simulated: Mapped[bool]
    folder: Mapped[str] = mapped_column(CleanText)
    file: Mapped[str] = mapped_column(CleanText)
    sha256: Mapped[str] = mapped_column(CleanText)
    status: Mapped[str] = mapped_column(CleanText)
    samples: Mapped[int] = mapped_column(BigInteger)
    sample_rate_hz: Mapped[float]
    seed: Mapped[str | None] = mapped_column(CleanText)
    lost: Mapped[str] = mapped_column(CleanText, server_default="")
    stage: Mapped[StageRow] = relationship(lazy="joined", innerjoin=True)


class CalibrationRow(Base):
    """A calibration."""

    __tablename__ = "calibrations"

    id: Mapped[int] = mapped_column(primary_key=True)
    stage_id: Mapped[int] = mapped_column(ForeignKey("stages.id"))
    run_id: Mapped[int | None] = mapped_column(ForeignKey("runs.id"))
    what: Mapped[str] = mapped_column(CleanText)
    value: Mapped[float]
    unit: Mapped[str] = mapped_column(CleanText)
    standard_uncertainty: Mapped[float]
    valid_from: Mapped[datetime] = mapped_column(UtcTime)
    note: Mapped[str] = mapped_column(CleanText)
    stage: Mapped[StageRow] = relationship(lazy="joined", innerjoin=True)
    run: Mapped[RunRow | None] = relationship(lazy="joined")


class ModelRow(Base):
    """A model."""

    __tablename__ = "models"

    id: Mapped[int] = mapped_column(primary_key=True)
    stage_id: Mapped[int] = mapped_column(ForeignKey("stages.id"))
    run_id: Mapped[int | None] = mapped_column(ForeignKey("runs.id"))
    kind: Mapped[str] = mapped_column(CleanText)
    file: Mapped[str] = mapped_column(CleanText)
    axis: Mapped[str] = mapped_column(CleanText)
    figures: Mapped[dict[str, float]] = mapped_column(JSON)
    created: Mapped[datetime] = mapped_column(UtcTime)
    sha256: Mapped[str] = mapped_column(CleanText)
    stage: Mapped[StageRow] = relationship(lazy="joined", innerjoin=True)
    run: Mapped[RunRow | None] = relationship(lazy="joined")


_STAGE_FIELDS = ("name", "serial_number", "design", "hash")
_RUN_FIELDS = (
    "identifier",
    "started",
    "plan",
    "step",
    "kind",
    "axis",
    "operator",
    "note",
    "version",
    "instrument",
    "simulated",
    "folder",
    "file",
    "sha256",
    "status",
    "samples",
    "sample_rate_hz",
    "lost",
)


def fill_run(session: Session, row: RunRow, entry: RunEntry) -> None:
    """Give the row of a run what its entry says."""
    row.stage = stage_row(session, entry.stage)
    for name in _RUN_FIELDS:
        setattr(row, name, getattr(entry, name))
    # whole numbers of any size, which no database has
    row.seed = None if entry.seed is None else str(entry.seed)


def of_stage(asked: Select[Any], stage: str | None, serial_number: str | None) -> Select[Any]:
    """Narrow a question to a stage."""
    if stage is not None:
        asked = asked.where(StageRow.name == stage)
    if serial_number is not None:
        asked = asked.where(StageRow.serial_number == serial_number)
    return asked


def stage_row(session: Session, entry: StageEntry) -> StageRow:
    """Return the row of a stage, a new one where there is none."""
    asked = select(StageRow)
    for name in _STAGE_FIELDS:
        asked = asked.where(getattr(StageRow, name) == getattr(entry, name))
    row = session.scalars(asked).first()
    if row is None:
        row = StageRow(**{name: getattr(entry, name) for name in _STAGE_FIELDS})
        session.add(row)
    return row


def run_row(session: Session, identifier: str) -> RunRow | None:
    """Return the row of a run; None where the identifier is empty."""
    if not identifier:
        return None
    row = session.scalar(select(RunRow).where(RunRow.identifier == identifier))
    if row is None:
        raise RecordError(
            f"run {identifier[:40]} is not in the catalogue: enter it first, with 'flexstage runs "
            "add FOLDER'"
        )
    return row


def stage_entry(row: StageRow) -> StageEntry:
    """Return the entry of a stage."""
    return StageEntry(**{name: getattr(row, name) for name in _STAGE_FIELDS})


def run_entry(row: RunRow) -> RunEntry:
    """Return the entry of a run."""
    fields: Mapping[str, Any] = {name: getattr(row, name) for name in _RUN_FIELDS}
    seed = None if row.seed is None else int(row.seed)
    return RunEntry(**fields, seed=seed, stage=stage_entry(row.stage))


def calibration_entry(row: CalibrationRow) -> CalibrationEntry:
    """Return the entry of a calibration."""
    return CalibrationEntry(
        what=row.what,
        value=row.value,
        unit=row.unit,
        standard_uncertainty=row.standard_uncertainty,
        valid_from=row.valid_from,
        stage=stage_entry(row.stage),
        run=row.run.identifier if row.run else "",
        note=row.note,
    )


def model_entry(row: ModelRow) -> ModelEntry:
    """Return the entry of a model."""
    return ModelEntry(
        kind=row.kind,
        file=row.file,
        stage=stage_entry(row.stage),
        created=row.created,
        axis=row.axis,
        figures=cast(Mapping[str, float], row.figures),
        run=row.run.identifier if row.run else "",
        sha256=row.sha256,
    )
