"""The schema of a catalogue, step by step: each step leads from one version to the next.

A step is never changed once it was released: a database somewhere has it. What is new is a new
step. `flexstage.instruments.catalogue.tables` says what the last one leads to.
"""

from collections.abc import Callable, Sequence

from sqlalchemy import (
    JSON,
    BigInteger,
    Boolean,
    Column,
    Connection,
    DateTime,
    Double,
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

from flexstage.errors import RecordError

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
