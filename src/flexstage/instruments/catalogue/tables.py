"""The tables of a catalogue, made from its entries: a column for each of their fields."""

import hashlib
import json
from collections.abc import Mapping
from dataclasses import fields
from datetime import UTC, datetime
from typing import Any, TypeVar

from sqlalchemy import (
    JSON,
    BigInteger,
    Boolean,
    Column,
    Connection,
    Double,
    ForeignKey,
    Index,
    Integer,
    MetaData,
    Select,
    String,
    Table,
    Text,
    UnicodeText,
    UniqueConstraint,
    insert,
    select,
)
from sqlalchemy.engine import Dialect, Row
from sqlalchemy.types import TypeDecorator

from flexstage.errors import RecordError
from flexstage.instruments.catalogue.entries import (
    CalibrationEntry,
    ModelEntry,
    RunEntry,
    RunStatus,
    StageEntry,
)

#: Which tables these are. Whoever changes them counts on: a catalogue of another number is refused.
VERSION = 3

Entry = TypeVar("Entry", StageEntry, RunEntry, CalibrationEntry, ModelEntry)


class UtcTime(TypeDecorator[datetime]):
    """A date and time in UTC as ISO 8601, as databases differ in zones and parts of a second."""

    impl = String(26)
    cache_ok = True

    def process_bind_param(self, value: datetime | None, dialect: Dialect) -> str | None:
        """Return what the database keeps."""
        if value is None:
            return None
        return value.astimezone(UTC).replace(tzinfo=None).isoformat(timespec="microseconds")

    def process_result_value(self, value: str | None, dialect: Dialect) -> datetime | None:
        """Return what the database kept."""
        return None if value is None else datetime.fromisoformat(value).replace(tzinfo=UTC)


class CleanText(TypeDecorator[str]):
    """A text that every database takes: ``?`` for halves of letters, no zeros."""

    impl = UnicodeText
    cache_ok = True

    def process_bind_param(self, value: str | None, dialect: Dialect) -> str | None:
        """Return what the database keeps."""
        return None if value is None else _clean(value)


class WholeNumber(TypeDecorator[int]):
    """A whole number of any size, which no database has, as a text."""

    impl = Text
    cache_ok = True

    def process_bind_param(self, value: int | None, dialect: Dialect) -> str | None:
        """Return what the database keeps."""
        return None if value is None else str(value)

    def process_result_value(self, value: Any | None, dialect: Dialect) -> int | None:
        """Return what the database kept."""
        return None if value is None else int(value)


class Figures(TypeDecorator[Mapping[str, float]]):
    """Numbers by name."""

    impl = JSON
    cache_ok = True

    def process_bind_param(self, value: Mapping[str, float] | None, dialect: Dialect) -> Any:
        """Return what the database keeps."""
        return None if value is None else {_clean(k): float(v) for k, v in value.items()}


def _clean(text: str) -> str:
    return text.replace("\0", "").encode("utf-8", "replace").decode("utf-8")


#: How a field of an entry is kept, by its type, and whether it may be empty.
_KEPT: dict[Any, tuple[Any, bool]] = {
    str: (CleanText, False),
    RunStatus: (CleanText, False),
    float: (Double, False),
    int: (BigInteger, False),
    int | None: (WholeNumber, True),
    bool: (Boolean, False),
    datetime: (UtcTime, False),
    Mapping[str, float]: (Figures, False),
}
#: The tables by name, on every database alike.
METADATA = MetaData()
VERSIONS = Table(
    "schema_version",
    METADATA,
    Column("version", Integer, primary_key=True, autoincrement=False),
)


def _table(name: str, kind: type[Any], *rules: Any) -> Table:
    """Make a table of entries; the stage and the run of one are rows of tables of their own."""
    columns: list[Column[Any]] = [Column("id", Integer, primary_key=True)]
    for f in fields(kind):
        if f.name == "identifier":
            # what is a key has a length, as not every database takes a text of any
            columns.append(Column(f.name, String(32), nullable=False))
        elif f.type is StageEntry:
            columns.append(Column("stage_id", ForeignKey("stages.id"), nullable=False))
        elif f.name == "run":
            columns.append(Column("run_id", ForeignKey("runs.id")))
        else:
            how, empty = _KEPT[f.type]
            columns.append(Column(f.name, how, nullable=empty))
    return Table(name, METADATA, *columns, *rules)


# the digest stands for all that an entry says: four texts are too long for a key
STAGES = _table(
    "stages",
    StageEntry,
    Column("digest", String(64), nullable=False),
    UniqueConstraint("digest"),
)
RUNS = _table("runs", RunEntry, UniqueConstraint("identifier"), Index("runs_by_start", "started"))
CALIBRATIONS = _table("calibrations", CalibrationEntry)
MODELS = _table("models", ModelEntry)


def question(table: Table) -> Select[Any]:
    """Return the question for the entries of a table, with what they say of stage and run."""
    if table is STAGES:
        return select(STAGES)
    both = table.join(STAGES, table.c.stage_id == STAGES.c.id)
    if "run_id" not in table.c:
        return select(table, STAGES).select_from(both)
    joined = both.outerjoin(RUNS, table.c.run_id == RUNS.c.id)
    return select(table, STAGES, RUNS.c.identifier).select_from(joined)


def entry_of(kind: type[Entry], table: Table, row: Row[Any]) -> Entry:
    """Return the entry that a row of an answer to `question` holds."""
    given = row._mapping
    values: dict[str, Any] = {}
    for f in fields(kind):
        if f.name in table.c:
            values[f.name] = given[table.c[f.name]]
        elif f.type is StageEntry:
            values[f.name] = entry_of(StageEntry, STAGES, row)
        else:
            values[f.name] = given[RUNS.c.identifier] or ""
    return kind(**values)


def values_of(connection: Connection, table: Table, entry: Any) -> dict[str, Any]:
    """Return the columns of an entry; its stage becomes a row where there is none."""
    values = {c.name: getattr(entry, c.name) for c in table.c if hasattr(entry, c.name)}
    if "stage_id" in table.c:
        values["stage_id"] = _stage_id(connection, entry.stage)
    if "run_id" in table.c:
        values["run_id"] = _run_id(connection, entry.run)
    return values


def _stage_id(connection: Connection, entry: StageEntry) -> int | None:
    values = values_of(connection, STAGES, entry)
    said = json.dumps([_clean(text) for text in values.values()])
    digest = hashlib.sha256(said.encode()).hexdigest()
    asked = select(STAGES.c.id).where(STAGES.c.digest == digest)
    found = connection.scalar(asked)
    if found is None:
        connection.execute(insert(STAGES).values(**values, digest=digest))
        found = connection.scalar(asked)
    return found


def _run_id(connection: Connection, identifier: str) -> int | None:
    """Return the number of a run; None where the identifier is empty."""
    if not identifier:
        return None
    found = connection.scalar(select(RUNS.c.id).where(RUNS.c.identifier == identifier))
    if found is None:
        raise RecordError(
            f"run {identifier[:40]} is not in the catalogue: enter it first, with 'flexstage runs "
            "add FOLDER'"
        )
    return found
