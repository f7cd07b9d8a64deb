"""The tables of a catalogue, as classes; their rows from entries, and entries from rows."""

from dataclasses import fields
from datetime import UTC, datetime
from typing import Any, ClassVar

from sqlalchemy import (
    JSON,
    BigInteger,
    DateTime,
    Double,
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

#: Which tables these are. Whoever changes them counts on: a catalogue of another number is refused.
VERSION = 2


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
    """The tables of a catalogue, on SQLite and PostgreSQL alike."""

    type_annotation_map: ClassVar[dict[Any, Any]] = {
        str: CleanText,
        float: Double,
        datetime: UtcTime,
        dict[str, float]: JSON,
    }


class VersionRow(Base):
    """Which tables these are: one row."""

    __tablename__ = "schema_version"

    version: Mapped[int] = mapped_column(primary_key=True, autoincrement=False)


class StageRow(Base):
    """A stage."""

    __tablename__ = "stages"
    __table_args__ = (UniqueConstraint("name", "serial_number", "hash", "design"),)

    id: Mapped[int] = mapped_column(primary_key=True)
    name: Mapped[str]
    serial_number: Mapped[str]
    design: Mapped[str]
    hash: Mapped[str]


class RunRow(Base):
    """A run."""

    __tablename__ = "runs"
    __table_args__ = (Index("runs_by_start", "started"),)

    id: Mapped[int] = mapped_column(primary_key=True)
    identifier: Mapped[str] = mapped_column(unique=True)
    stage_id: Mapped[int] = mapped_column(ForeignKey("stages.id"))
    started: Mapped[datetime]
    plan: Mapped[str]
    step: Mapped[str]
    kind: Mapped[str]
    axis: Mapped[str]
    operator: Mapped[str]
    note: Mapped[str]
    version: Mapped[str]
    instrument: Mapped[str]
    simulated: Mapped[bool]
    folder: Mapped[str]
    file: Mapped[str]
    sha256: Mapped[str]
    status: Mapped[str]
    samples: Mapped[int] = mapped_column(BigInteger)
    sample_rate_hz: Mapped[float]
    seed: Mapped[str | None]
    lost: Mapped[str]
    stage: Mapped[StageRow] = relationship(lazy="joined", innerjoin=True)


class CalibrationRow(Base):
    """A calibration."""

    __tablename__ = "calibrations"

    id: Mapped[int] = mapped_column(primary_key=True)
    stage_id: Mapped[int] = mapped_column(ForeignKey("stages.id"))
    run_id: Mapped[int | None] = mapped_column(ForeignKey("runs.id"))
    what: Mapped[str]
    value: Mapped[float]
    unit: Mapped[str]
    standard_uncertainty: Mapped[float]
    valid_from: Mapped[datetime]
    note: Mapped[str]
    stage: Mapped[StageRow] = relationship(lazy="joined", innerjoin=True)
    run: Mapped[RunRow | None] = relationship(lazy="joined")


class ModelRow(Base):
    """A model."""

    __tablename__ = "models"

    id: Mapped[int] = mapped_column(primary_key=True)
    stage_id: Mapped[int] = mapped_column(ForeignKey("stages.id"))
    run_id: Mapped[int | None] = mapped_column(ForeignKey("runs.id"))
    kind: Mapped[str]
    file: Mapped[str]
    axis: Mapped[str]
    figures: Mapped[dict[str, float]]
    created: Mapped[datetime]
    sha256: Mapped[str]
    stage: Mapped[StageRow] = relationship(lazy="joined", innerjoin=True)
    run: Mapped[RunRow | None] = relationship(lazy="joined")


#: What rows do not keep as their entries do.
_SPECIAL = frozenset({"stage", "run", "seed", "figures"})


def _plain(kind: type[Any]) -> list[str]:
    """Return the fields of an entry that its row keeps as they are."""
    return [f.name for f in fields(kind) if f.name not in _SPECIAL]


def fill(row: Any, entry: Any) -> None:
    """Give a row what its entry says, but for stage and run."""
    for name in _plain(type(entry)):
        setattr(row, name, getattr(entry, name))
    if isinstance(entry, RunEntry):
        # whole numbers of any size, which no database has
        row.seed = None if entry.seed is None else str(entry.seed)
    if isinstance(entry, ModelEntry):
        row.figures = {clean(k): float(v) for k, v in entry.figures.items()}


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
    for name in _plain(StageEntry):
        asked = asked.where(getattr(StageRow, name) == getattr(entry, name))
    row = session.scalars(asked).first()
    if row is None:
        row = StageRow()
        fill(row, entry)
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


def _kept(kind: type[Any], row: Any) -> dict[str, Any]:
    return {name: getattr(row, name) for name in _plain(kind)}


def stage_entry(row: StageRow) -> StageEntry:
    """Return the entry of a stage."""
    return StageEntry(**_kept(StageEntry, row))


def run_entry(row: RunRow) -> RunEntry:
    """Return the entry of a run."""
    seed = None if row.seed is None else int(row.seed)
    return RunEntry(**_kept(RunEntry, row), seed=seed, stage=stage_entry(row.stage))


def calibration_entry(row: CalibrationRow) -> CalibrationEntry:
    """Return the entry of a calibration."""
    return CalibrationEntry(**_kept(CalibrationEntry, row), **_origin(row))


def model_entry(row: ModelRow) -> ModelEntry:
    """Return the entry of a model."""
    return ModelEntry(**_kept(ModelEntry, row), figures=row.figures, **_origin(row))


def _origin(row: CalibrationRow | ModelRow) -> dict[str, Any]:
    run = row.run.identifier if row.run else ""
    return {"stage": stage_entry(row.stage), "run": run}
