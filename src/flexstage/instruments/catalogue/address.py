"""Where a catalogue is: a file of SQLite, or a server of PostgreSQL."""

import os
from pathlib import Path
from typing import Any

from sqlalchemy import URL, Connection, Engine, NullPool, StaticPool, create_engine, event, make_url
from sqlalchemy.exc import ArgumentError

from flexstage.errors import RecordError
from flexstage.files.user_folder import user_folder

#: Option of a connection that is going to write.
WRITES = "flexstage_writes"
# how long a writer waits for others, and how long a server may take to answer [s]
_PATIENCE, _ANSWER = 30, 10


def default_catalogue() -> str:
    """Return where the user's catalogue is: ``$FLEXSTAGE_CATALOGUE``, else the platform's place."""
    return os.environ.get("FLEXSTAGE_CATALOGUE") or str(user_folder("data") / "catalogue.sqlite")


def catalogue_engine(address: str) -> Engine:
    """Return what talks to a catalogue; nothing is opened, but the folder of a file is made.

    The address is the path of a file, ``sqlite:///PATH``, or ``postgresql://USER@HOST/DATABASE``.
    """
    url = _url(address)
    if url.get_backend_name() == "sqlite":
        return _sqlite(url)
    try:
        return create_engine(
            url,
            connect_args={"connect_timeout": url.query.get("connect_timeout", str(_ANSWER))},
            pool_pre_ping=True,
        )
    except ModuleNotFoundError as error:
        raise RecordError(
            "a catalogue on PostgreSQL needs its driver: pip install 'flexstage[postgresql]'"
        ) from error


def address_of(address: str) -> str:
    """Return an address in full, without its password."""
    return _url(address).render_as_string(hide_password=True)


def is_absent_file(address: str) -> bool:
    """Return whether a catalogue is a file that is not there."""
    url = _url(address)
    return url.get_backend_name() == "sqlite" and not Path(url.database or "").exists()


def in_memory() -> Engine:
    """Return what talks to an empty catalogue that leaves nothing behind."""
    engine = create_engine("sqlite://", poolclass=StaticPool)
    event.listen(engine, "connect", _prepare)
    event.listen(engine, "begin", _begin)
    return engine


def require_address(address: str) -> None:
    """Refuse what can be no address of a catalogue; nothing is opened or made."""
    _url(address)


def _url(address: str) -> URL:
    if not address.strip():
        raise RecordError("the address of a catalogue must not be empty: give a file or a URL")
    if "://" not in address:
        return URL.create("sqlite", database=str(Path(address).expanduser()))
    try:
        url = make_url(address)
    except (ArgumentError, ValueError) as error:
        # the address may hold a password, and is not repeated
        raise RecordError(
            "the address of the catalogue cannot be understood: it must be a file, or such as "
            "postgresql://user@host/database"
        ) from error
    if url.drivername in ("postgresql", "postgres", "postgresql+psycopg"):
        return url.set(drivername="postgresql+psycopg")
    if url.drivername == "sqlite" and url.database and url.database != ":memory:":
        return url
    raise RecordError(
        "a catalogue is a file (sqlite:///PATH) or on PostgreSQL (postgresql://...), got "
        f"'{url.render_as_string(hide_password=True)}'"
    )


def _sqlite(url: URL) -> Engine:
    path = Path(url.database or "")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise RecordError(
            f"the folder of the catalogue '{path}' cannot be made: {error.strerror or error}"
        ) from error
    engine = create_engine(url, connect_args={"timeout": _PATIENCE}, poolclass=NullPool)
    event.listen(engine, "connect", _prepare)
    event.listen(engine, "begin", _begin)
    return engine


def _prepare(connection: Any, _record: Any) -> None:
    # transactions are begun here and by nobody else, so that a change of the schema is one too
    connection.isolation_level = None
    connection.execute("PRAGMA foreign_keys = ON")


def _begin(connection: Connection) -> None:
    # a writer waits at its start: two that had both begun to read could never go on
    writes = connection.get_execution_options().get(WRITES, False)
    connection.exec_driver_sql("BEGIN IMMEDIATE" if writes else "BEGIN")
