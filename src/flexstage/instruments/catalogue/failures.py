"""What a database says when it fails, in one sentence."""

from collections.abc import Iterator
from contextlib import contextmanager

from sqlalchemy.exc import DBAPIError, InterfaceError, OperationalError, SQLAlchemyError

from flexstage.errors import NotConnectedError, RecordError


@contextmanager
def telling(address: str) -> Iterator[None]:
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
