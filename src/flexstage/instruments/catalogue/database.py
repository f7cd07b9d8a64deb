"""A database of this version: opened, led on, read and written; what it says when it fails."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any, Self, TypeVar

from sqlalchemy import Engine
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
from flexstage.instruments.catalogue.migrations import LATEST, migrate, schema_version

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
