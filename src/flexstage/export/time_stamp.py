"""The time that stands in exported files."""

import datetime

from flexstage.errors import ModelError

#: Stands where no time is given, so that the same stage gives the same bytes.
NO_TIME = "1970-01-01T00:00:00"


def read_time(time_stamp: str) -> datetime.datetime:
    """Read a time stamp.

    Examples
    --------
    >>> read_time("2031-05-06T07:08:09").year
    2031
    """
    try:
        return datetime.datetime.fromisoformat(time_stamp)
    except ValueError:
        raise ModelError(
            f"a time stamp must be a date and a time such as '2031-05-06T07:08:09', got "
            f"'{time_stamp}'"
        ) from None
