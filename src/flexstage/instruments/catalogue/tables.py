"""The tables of a catalogue, as classes."""

from datetime import UTC, datetime
from typing import Any

from sqlalchemy import JSON, BigInteger, DateTime, ForeignKey, Index, Text, UniqueConstraint
from sqlalchemy.engine import Dialect
from sqlalchemy.orm import DeclarativeBase, Mapped, mapped_column, relationship
from sqlalchemy.types import TypeDecorator


class UtcTime(TypeDecorator[datetime]):
    """A date and time in UTC, also where a database knows no zones."""

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
    """Return a text that every database takes."""
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


class Run(Base):
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


class Calibration(Base):
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
    run: Mapped[Run | None] = relationship(lazy="joined")


class Model(Base):
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
    run: Mapped[Run | None] = relationship(lazy="joined")
