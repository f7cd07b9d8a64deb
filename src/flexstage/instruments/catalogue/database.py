"""A database of this version: opened, led on, read and written; what it says when it fails.

The schema is led on step by step, each from one version to the next. A step is never changed once
it was released: a database somewhere has it. What is new is a new step.
`flexstage.instruments.catalogue.tables` says what the last one leads to.
"""

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any, Self, TypeVar

from sqlalchemy import (
    JSON,
    BigInteger,
    Boolean,
    Column,
    Connection,
    DateTime,
    Double,
    Engine,
    ForeignKey,
    Integer,
    MetaData,
    Table,
    Text,
    UniqueConstraint,
    inspect,
    select,
    text,
)
from sqlalchemy.exc import (
    DBAPIError,
    IntegrityError,
    InterfaceError,
    OperationalError,
    SQLAlchemyError,
)
from sqlalchemy.orm import Session

from flexstage.errors import NotConnectedError, RecordError
from flexstage.instruments.catalogue.address import (
    WRITES,
    address_of,
    catalogue_engine,
    default_catalogue,
    in_memory,
    is_absent_file,
)

_T = TypeVar("_T")
# others may enter the same stage between the question for it and the answer
_TRIES = 8


class Database:
    """A database that holds the tables of this version."""

    def __init__(self, engine: Engine, address: str = "") -> None:
        self._engine = engine
        self._address = address or engine.url.render_as_string(hide_password=True)

    @classmethod
    def open(cls, address: str | None = None, *, make: bool = True) -> Self:
        """Open a catalogue, the user's own where none is named.

        It is made, or led to this version, where that is needed. Where it is not to be made and is
        a file that is absent, it is empty, and none is written.
        """
        where = address or default_catalogue()
        if make or not is_absent_file(where):
            made = cls(catalogue_engine(where))
        else:
            made = cls(in_memory(), address_of(where))
        try:
            made._lead_to_this_version()
        except BaseException:
            made.close()
            raise
        return made

    @property
    def address(self) -> str:
        """Where it is, without a password."""
        return self._address

    def close(self) -> None:
        """Close all links to the database."""
        self._engine.dispose()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _lead_to_this_version(self) -> None:
        with _telling(self.address):
            with self._engine.connect() as connection, connection.begin():
                if schema_version(connection) == LATEST:
                    return
            with self._writing() as connection:
                migrate(connection)

    def read(self, work: Callable[[Session], _T]) -> _T:
        """Do work that only reads."""
        with _telling(self.address), Session(self._engine) as session:
            return work(session)

    def write(self, work: Callable[[Session], _T]) -> _T:
        """Do work in one transaction, again where another program was first."""
        with _telling(self.address):
            for _ in range(_TRIES - 1):
                try:
                    return self._once(work)
                except IntegrityError:
                    continue
            return self._once(work)

    def _once(self, work: Callable[[Session], _T]) -> _T:
        with self._writing() as connection, Session(connection) as session:
            result = work(session)
            session.flush()
            return result

    @contextmanager
    def _writing(self) -> Iterator[Any]:
        link = self._engine.connect().execution_options(**{WRITES: True})
        with link as connection, connection.begin():
            yield connection


@contextmanager
def _telling(address: str) -> Iterator[None]:
    """Turn what a database raises in this block into errors of flexstage."""
    try:
        yield
    except (OperationalError, InterfaceError) as error:
        raise NotConnectedError(
            f"the catalogue {address} cannot be used ({_reason(error)}): runs are safe in their "
            "folders, and 'flexstage runs add FOLDER' enters them later"
        ) from error
    except SQLAlchemyError as error:
        raise RecordError(
            f"the catalogue {address} is not as it should be ({_reason(error)}): is it one of "
            "flexstage?"
        ) from error


def _reason(error: SQLAlchemyError) -> str:
    said = str(error.orig if isinstance(error, DBAPIError) else error).strip().splitlines()
    return (said or [type(error).__name__])[0].strip()[:200]


Step = Callable[[Connection], None]
# any number, so long as every flexstage takes the same: who holds it may change the schema
_LOCK = 5_407_301
_version_table = Table(
    "schema_version", MetaData(), Column("version", Integer, nullable=False, primary_key=True)
)


def _text(name: str) -> Column[str]:
    return Column(name, Text, nullable=False)


def _begin(connection: Connection) -> None:
    """Make the tables of version 1."""
    tables = MetaData()
    time = DateTime(timezone=True)
    Table(
        "stages",
        tables,
        Column("id", Integer, primary_key=True),
        *(_text(n) for n in ("name", "serial_number", "design", "hash")),
        UniqueConstraint("name", "serial_number", "hash", "design"),
    )
    Table(
        "runs",
        tables,
        Column("id", Integer, primary_key=True),
        Column("identifier", Text, nullable=False, unique=True),
        Column("stage_id", ForeignKey("stages.id"), nullable=False),
        Column("started", time, nullable=False),
        *(_text(n) for n in ("plan", "step", "kind", "axis", "operator", "note", "version")),
        _text("instrument"),
        Column("simulated", Boolean, nullable=False),
        *(_text(n) for n in ("folder", "file", "sha256", "status")),
        Column("samples", BigInteger, nullable=False),
        Column("sample_rate_hz", Double, nullable=False),
        Column("seed", Text),
    )
    Table(
        "calibrations",
        tables,
        Column("id", Integer, primary_key=True),
        Column("stage_id", ForeignKey("stages.id"), nullable=False),
        Column("run_id", ForeignKey("runs.id")),
        _text("what"),
        Column("value", Double, nullable=False),
        _text("unit"),
        Column("standard_uncertainty", Double, nullable=False),
        Column("valid_from", time, nullable=False),
        _text("note"),
    )
    Table(
        "models",
        tables,
        Column("id", Integer, primary_key=True),
        Column("stage_id", ForeignKey("stages.id"), nullable=False),
        Column("run_id", ForeignKey("runs.id")),
        *(_text(n) for n in ("kind", "file", "axis")),
        Column("figures", JSON, nullable=False),
        Column("created", time, nullable=False),
        _text("sha256"),
    )
    tables.create_all(connection, checkfirst=False)


def _keep_what_was_lost(connection: Connection) -> None:
    """Let a run say what was lost of it; find runs by their start."""
    connection.execute(text("ALTER TABLE runs ADD COLUMN lost TEXT NOT NULL DEFAULT ''"))
    connection.execute(text("CREATE INDEX runs_by_start ON runs (started)"))


#: The steps, from an empty database on.
STEPS: tuple[Step, ...] = (_begin, _keep_what_was_lost)
#: The version that they lead to.
LATEST = len(STEPS)


def schema_version(connection: Connection) -> int:
    """Return the version of a database: the steps that it has taken, 0 for an empty one."""
    tables = set(inspect(connection).get_table_names())
    if "schema_version" not in tables:
        if {"runs", "stages", "models", "calibrations"} & tables:
            raise RecordError(
                "the database belongs to another program: give the catalogue one of its own"
            )
        return 0
    return connection.scalar(select(_version_table.c.version)) or 0


def migrate(connection: Connection, steps: Sequence[Step] = STEPS) -> int:
    """Lead a database to the last version, in the transaction; return the version that it had."""
    if connection.dialect.name == "postgresql":
        # two programs that open a new database at once: the second waits, and finds it done
        connection.execute(text("SELECT pg_advisory_xact_lock(:key)"), {"key": _LOCK})
    version = schema_version(connection)
    if version > len(steps):
        raise RecordError(
            f"the catalogue is of version {version}, made by a later flexstage, and this one knows "
            f"version {len(steps)}: update flexstage"
        )
    if version == len(steps):
        return version
    for step in steps[version:]:
        step(connection)
    _version_table.create(connection, checkfirst=True)
    connection.execute(_version_table.delete())
    connection.execute(_version_table.insert().values(version=len(steps)))
    return version
