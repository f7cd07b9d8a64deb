"""A database of runs: opened, made, read and written; what it says when it fails."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Self, TypeVar

from sqlalchemy import Connection, Engine, insert, inspect, select
from sqlalchemy.exc import (
    DBAPIError,
    IntegrityError,
    InterfaceError,
    OperationalError,
    SQLAlchemyError,
)

from flexstage.errors import FlexstageError, NotConnectedError, RecordError
from flexstage.instruments.catalogue.address import (
    WRITES,
    address_of,
    catalogue_engine,
    default_catalogue,
    in_memory,
    is_absent_file,
)
from flexstage.instruments.catalogue.tables import METADATA, VERSION, VERSIONS

_T = TypeVar("_T")
# others may enter the same stage between the question for it and the answer
_TRIES = 8


class Database:
    """A database that holds the tables of `flexstage.instruments.catalogue.tables`."""

    def __init__(self, engine: Engine, address: str = "") -> None:
        self._engine = engine
        self._address = address or engine.url.render_as_string(hide_password=True)

    @classmethod
    def open(cls, address: str | None = None, *, make: bool = True) -> Self:
        """Open a catalogue, the user's own where none is named.

        Its tables are made in an empty database. Where they are not to be made, an empty database,
        or a file that is absent, is an empty catalogue, and nothing is written. One of another
        version is refused.
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
        """Where it is, without a password."""
        return self._address

    def close(self) -> None:
        """Close all links to the database."""
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
            # of two programs that make them at once the second fails, and finds them made
            if not self._is_made():
                raise

    def _has_tables(self, connection: Connection) -> bool:
        """Return whether a database has the tables of this version; refuse all but an empty one."""
        there = set(inspect(connection).get_table_names())
        if VERSIONS.name in there:
            found = connection.scalar(select(VERSIONS.c.version))
            if found != VERSION:
                raise RecordError(
                    f"the catalogue {self.address} is of version {found}, and this flexstage reads "
                    f"and writes version {VERSION} only: use the flexstage that made it, or "
                    "enter the runs anew, by 'flexstage runs add FOLDER --catalogue URL' with an "
                    "empty database or a new file"
                )
            return True
        if there & set(METADATA.tables):
            raise RecordError(
                "the database belongs to another program: give the catalogue one of its own"
            )
        return False

    def read(self, work: Callable[[Connection], _T]) -> _T:
        """Do work that only reads."""
        with _telling(self.address), self._engine.connect() as connection, connection.begin():
            return work(connection)

    def write(self, work: Callable[[Connection], _T]) -> _T:
        """Do work in one transaction, again where another program was first."""
        with _telling(self.address):
            for _ in range(_TRIES - 1):
                try:
                    return self._once(work)
                except IntegrityError:
                    continue
            return self._once(work)

    def _once(self, work: Callable[[Connection], _T]) -> _T:
        with self._writing() as connection:
            return work(connection)

    @contextmanager
    def _writing(self) -> Iterator[Connection]:
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
