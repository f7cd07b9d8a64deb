"""Database of a catalogue: its address, and its tables with a column for each field of an entry.

It is an SQLite file, or any other database that SQLAlchemy supports.
"""

import hashlib
import json
import os
from collections.abc import Mapping
from dataclasses import fields
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, TypeVar

from sqlalchemy import (
    JSON,
    URL,
    BigInteger,
    Boolean,
    Column,
    Connection,
    Double,
    Engine,
    ForeignKey,
    Index,
    Integer,
    MetaData,
    NullPool,
    Select,
    StaticPool,
    String,
    Table,
    Text,
    UnicodeText,
    UniqueConstraint,
    create_engine,
    event,
    insert,
    make_url,
    select,
)
from sqlalchemy.engine import Dialect, Row
from sqlalchemy.exc import ArgumentError
from sqlalchemy.types import TypeDecorator

from flexstage.base.errors import RecordError
from flexstage.files.names import user_folder
from flexstage.instruments.catalogue.entries import (
    CalibrationEntry,
    ModelEntry,
    RunEntry,
    RunStatus,
    StageEntry,
)

#: Version of the tables, to be incremented with every change; other versions are refused.
VERSION = 3

Entry = TypeVar("Entry", StageEntry, RunEntry, CalibrationEntry, ModelEntry)


class UtcTime(TypeDecorator[datetime]):
    """A date and time in UTC as ISO 8601, as databases differ in zones and parts of a second."""

    impl = String(26)
    cache_ok = True

    def process_bind_param(self, value: datetime | None, dialect: Dialect) -> str | None:
        """Return the value for the database."""
        if value is None:
            return None
        return value.astimezone(UTC).replace(tzinfo=None).isoformat(timespec="microseconds")

    def process_result_value(self, value: str | None, dialect: Dialect) -> datetime | None:
        """Return the value from the database."""
        return None if value is None else datetime.fromisoformat(value).replace(tzinfo=UTC)


class CleanText(TypeDecorator[str]):
    """A text that every database accepts: ``?`` for lone surrogates, no null characters."""

    impl = UnicodeText
    cache_ok = True

    def process_bind_param(self, value: str | None, dialect: Dialect) -> str | None:
        """Return the value for the database."""
        return None if value is None else _clean(value)


class WholeNumber(TypeDecorator[int]):
    """An integer of any size, stored as text."""

    impl = Text
    cache_ok = True

    def process_bind_param(self, value: int | None, dialect: Dialect) -> str | None:
        """Return the value for the database."""
        return None if value is None else str(value)

    def process_result_value(self, value: Any | None, dialect: Dialect) -> int | None:
        """Return the value from the database."""
        return None if value is None else int(value)


class Figures(TypeDecorator[Mapping[str, float]]):
    """Numbers by name."""

    impl = JSON
    cache_ok = True

    def process_bind_param(self, value: Mapping[str, float] | None, dialect: Dialect) -> Any:
        """Return the value for the database."""
        return None if value is None else {_clean(k): float(v) for k, v in value.items()}


def _clean(text: str) -> str:
    return text.replace("\0", "").encode("utf-8", "replace").decode("utf-8")


#: Column type of a field of an entry, by the type of the field, and whether it may be null.
_COLUMN_OF: dict[Any, tuple[Any, bool]] = {
    str: (CleanText, False),
    RunStatus: (CleanText, False),
    float: (Double, False),
    int: (BigInteger, False),
    int | None: (WholeNumber, True),
    bool: (Boolean, False),
    datetime: (UtcTime, False),
    Mapping[str, float]: (Figures, False),
}
#: The tables by name, the same on every database.
METADATA = MetaData()
VERSIONS = Table(
    "schema_version",
    METADATA,
    Column("version", Integer, primary_key=True, autoincrement=False),
)


def _table(name: str, kind: type[Any], *rules: Any) -> Table:
    """Return a table of entries; their stages and runs are rows of other tables."""
    columns: list[Column[Any]] = [Column("id", Integer, primary_key=True)]
    for f in fields(kind):
        if f.name == "identifier":
            # a key needs a length, since not every database accepts a key of unlimited text
            columns.append(Column(f.name, String(32), nullable=False))
        elif f.type is StageEntry:
            columns.append(Column("stage_id", ForeignKey("stages.id"), nullable=False))
        elif f.name == "run":
            columns.append(Column("run_id", ForeignKey("runs.id")))
        else:
            column_type, empty = _COLUMN_OF[f.type]
            columns.append(Column(f.name, column_type, nullable=empty))
    return Table(name, METADATA, *columns, *rules)


# the digest represents the entry, since four texts are too long for a key
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
    """Return the query for the entries of a table, with their stages and runs."""
    if table is STAGES:
        return select(STAGES)
    both = table.join(STAGES, table.c.stage_id == STAGES.c.id)
    if "run_id" not in table.c:
        return select(table, STAGES).select_from(both)
    joined = both.outerjoin(RUNS, table.c.run_id == RUNS.c.id)
    return select(table, STAGES, RUNS.c.identifier).select_from(joined)


def entry_of(kind: type[Entry], table: Table, row: Row[Any]) -> Entry:
    """Return the entry of a row of a result of `question`."""
    columns = row._mapping
    values: dict[str, Any] = {}
    for f in fields(kind):
        if f.name in table.c:
            values[f.name] = columns[table.c[f.name]]
        elif f.type is StageEntry:
            values[f.name] = entry_of(StageEntry, STAGES, row)
        else:
            values[f.name] = columns[RUNS.c.identifier] or ""
    return kind(**values)


def values_of(connection: Connection, table: Table, entry: Any) -> dict[str, Any]:
    """Return the columns of an entry; its stage is inserted if it is new."""
    values = {c.name: getattr(entry, c.name) for c in table.c if hasattr(entry, c.name)}
    if "stage_id" in table.c:
        values["stage_id"] = _stage_id(connection, entry.stage)
    if "run_id" in table.c:
        values["run_id"] = _run_id(connection, entry.run)
    return values


def _stage_id(connection: Connection, entry: StageEntry) -> int | None:
    values = values_of(connection, STAGES, entry)
    content = json.dumps([_clean(text) for text in values.values()])
    digest = hashlib.sha256(content.encode()).hexdigest()
    query = select(STAGES.c.id).where(STAGES.c.digest == digest)
    number = connection.scalar(query)
    if number is None:
        connection.execute(insert(STAGES).values(**values, digest=digest))
        number = connection.scalar(query)
    return number


def _run_id(connection: Connection, identifier: str) -> int | None:
    """Return the row number of a run; None where the identifier is empty."""
    if not identifier:
        return None
    number = connection.scalar(select(RUNS.c.id).where(RUNS.c.identifier == identifier))
    if number is None:
        raise RecordError(
            f"run {identifier[:40]} is not in the catalogue: enter it first, with 'flexstage runs "
            "add FOLDER'"
        )
    return number


#: Option of a connection that writes.
WRITES = "flexstage_writes"
# longest wait of a writer of a file for others, and for a connection to a server [s]
_PATIENCE, _LINK = 30, 10
# databases whose drivers have such an option; by default they wait for minutes
_WITH_TIMEOUT = ("postgresql", "mysql", "mariadb")


def default_catalogue() -> str:
    """Return the address of the user's catalogue: ``$FLEXSTAGE_CATALOGUE``, or the default."""
    return os.environ.get("FLEXSTAGE_CATALOGUE") or str(user_folder("data") / "catalogue.sqlite")


def chosen_catalogue(text: str | None) -> str | None:
    """Return the address of a catalogue: none for 'none', by default that of the user.

    An impossible address is refused here; failures to open a catalogue are reported after a run.
    """
    if text is None:
        return default_catalogue()
    if text.casefold() == "none":
        return None
    require_address(text)
    return text


def catalogue_engine(address: str) -> Engine:
    """Return the engine of a catalogue; opens no connection, but creates the folder of a file.

    The address is the path of a file, or a URL of SQLAlchemy: ``sqlite:///PATH``,
    ``postgresql://USER@HOST/DATABASE``, ``mysql+pymysql://USER@HOST/DATABASE``...
    """
    url = _url(address)
    if url.get_backend_name() == "sqlite":
        return _sqlite(url)
    options: dict[str, Any] = {}
    if url.get_backend_name() in _WITH_TIMEOUT and "connect_timeout" not in url.query:
        options["connect_timeout"] = _LINK
    try:
        return create_engine(url, connect_args=options, poolclass=NullPool)
    except ModuleNotFoundError as error:
        raise RecordError(
            f"a catalogue at {url.drivername}://... needs the driver '{error.name}', which is not "
            "installed: install it (for PostgreSQL: pip install 'flexstage[postgresql]')"
        ) from error
    except (ArgumentError, TypeError) as error:
        raise RecordError(
            f"SQLAlchemy does not support the database of the catalogue {address_of(address)}: "
            "give a file, or an address such as postgresql://user@host/database"
        ) from error


def address_of(address: str) -> str:
    """Return the complete address, without its password."""
    return _url(address).render_as_string(hide_password=True)


def is_absent_file(address: str) -> bool:
    """Return whether a catalogue is a file that does not exist."""
    url = _url(address)
    return url.get_backend_name() == "sqlite" and not Path(url.database or "").exists()


def in_memory() -> Engine:
    """Return the engine of an empty catalogue in memory."""
    return _prepared(create_engine("sqlite://", poolclass=StaticPool))


def require_address(address: str) -> None:
    """Refuse an impossible address of a catalogue, or one without a driver; opens nothing."""
    if _url(address).get_backend_name() != "sqlite":
        catalogue_engine(address)


def _url(address: str) -> URL:
    if not address.strip():
        raise RecordError("the address of a catalogue must not be empty: give a file or a URL")
    if "://" not in address:
        return URL.create("sqlite", database=str(Path(address).expanduser()))
    try:
        url = make_url(address)
    except (ArgumentError, ValueError) as error:
        # the address may contain a password, and is not repeated
        raise RecordError(
            "the address of the catalogue is not valid: it must be a file, or an address such as "
            "postgresql://user@host/database"
        ) from error
    if url.get_backend_name() == "sqlite" and url.database in (None, "", ":memory:"):
        raise RecordError(
            f"a catalogue in memory would be lost, got '{address}': give a file (sqlite:///PATH)"
        )
    return url


def _sqlite(url: URL) -> Engine:
    path = Path(url.database or "")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise RecordError(
            f"the folder of the catalogue '{path}' cannot be created: {error.strerror or error}"
        ) from error
    return _prepared(create_engine(url, connect_args={"timeout": _PATIENCE}, poolclass=NullPool))


def _prepared(engine: Engine) -> Engine:
    event.listen(engine, "connect", _connected)
    event.listen(engine, "begin", _begin)
    return engine


def _connected(connection: Any, _record: Any) -> None:
    # only this module begins transactions, so that a change of the schema is one too
    connection.isolation_level = None
    connection.execute("PRAGMA foreign_keys = ON")


def _begin(connection: Connection) -> None:
    # a writer waits at its start: two that had both begun to read would deadlock
    writes = connection.get_execution_options().get(WRITES, False)
    connection.exec_driver_sql("BEGIN IMMEDIATE" if writes else "BEGIN")
