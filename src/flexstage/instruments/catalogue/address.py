"""Where a catalogue is: a file of SQLite, or any other database that SQLAlchemy reaches."""

import os
from pathlib import Path
from typing import Any

from sqlalchemy import URL, Connection, Engine, NullPool, StaticPool, create_engine, event, make_url
from sqlalchemy.exc import ArgumentError

from flexstage.errors import RecordError
from flexstage.files.names import user_folder

#: Option of a connection that is going to write.
WRITES = "flexstage_writes"
# how long a writer of a file waits for others, and how long a link to a server may take [s]
_PATIENCE, _LINK = 30, 10
# databases whose drivers have such an option; by themselves they wait for minutes
_WITH_TIMEOUT = ("postgresql", "mysql", "mariadb")


def default_catalogue() -> str:
    """Return where the user's catalogue is: ``$FLEXSTAGE_CATALOGUE``, else the platform's place."""
    return os.environ.get("FLEXSTAGE_CATALOGUE") or str(user_folder("data") / "catalogue.sqlite")


def chosen_catalogue(text: str | None) -> str | None:
    """Return the catalogue that a text names: none for 'none', the user's where nothing is said.

    What cannot be opened is told behind a run; what can never be a catalogue is refused here.
    """
    if text is None:
        return default_catalogue()
    if text.casefold() == "none":
        return None
    require_address(text)
    return text


def catalogue_engine(address: str) -> Engine:
    """Return what talks to a catalogue; nothing is opened, but the folder of a file is made.

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
            f"SQLAlchemy knows no such database as the catalogue {address_of(address)}: give a "
            "file, or such as postgresql://user@host/database"
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
    return _prepared(create_engine("sqlite://", poolclass=StaticPool))


def require_address(address: str) -> None:
    """Refuse what can be no address of a catalogue or has no driver; nothing is opened or made."""
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
        # the address may hold a password, and is not repeated
        raise RecordError(
            "the address of the catalogue cannot be understood: it must be a file, or such as "
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
            f"the folder of the catalogue '{path}' cannot be made: {error.strerror or error}"
        ) from error
    return _prepared(create_engine(url, connect_args={"timeout": _PATIENCE}, poolclass=NullPool))


def _prepared(engine: Engine) -> Engine:
    event.listen(engine, "connect", _connected)
    event.listen(engine, "begin", _begin)
    return engine


def _connected(connection: Any, _record: Any) -> None:
    # transactions are begun here and by nobody else, so that a change of the schema is one too
    connection.isolation_level = None
    connection.execute("PRAGMA foreign_keys = ON")


def _begin(connection: Connection) -> None:
    # a writer waits at its start: two that had both begun to read could never go on
    writes = connection.get_execution_options().get(WRITES, False)
    connection.exec_driver_sql("BEGIN IMMEDIATE" if writes else "BEGIN")
