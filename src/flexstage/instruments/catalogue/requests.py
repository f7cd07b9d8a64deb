"""What is asked of a catalogue: runs and calibrations."""

from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from typing import Annotated

from flexstage.errors import ModelError
from flexstage.files.ranges import Range, Written
from flexstage.files.request import Request

_SECONDS = {"d": 86_400.0, "h": 3600.0, "min": 60.0}


def read_time(text: str) -> datetime:
    """Return a date, a date and time, or how long ago: ``7 d``, in UTC.

    Examples
    --------
    >>> read_time("2031-05-17T09:30").isoformat()
    '2031-05-17T09:30:00+00:00'
    """
    word = text.strip()
    try:
        time = datetime.fromisoformat(word)
    except ValueError:
        return _ago(word)
    if time.tzinfo is None:
        return time.replace(tzinfo=UTC)
    try:
        return time.astimezone(UTC)
    except OverflowError:  # before the first year, or after the last one
        raise ModelError(f"'{text}' is no time that can be told in UTC") from None


def _ago(text: str) -> datetime:
    number = text.rstrip("abcdefghijklmnopqrstuvwxyz")
    try:
        seconds = float(number.strip()) * _SECONDS[text[len(number) :]]
        return datetime.now(UTC) - timedelta(seconds=seconds)
    except (KeyError, ValueError, OverflowError):
        raise ModelError(
            f"expected a date such as 2031-05-17, a date and time such as 2031-05-17T09:30, or how "
            f"long ago, such as 7d, 12h or 30min, got '{text}'"
        ) from None


_TIME = Annotated[datetime, Written("TIME", read=read_time, write=datetime.isoformat)]


@dataclass(frozen=True, slots=True, kw_only=True)
class OfStage(Request):
    """What belongs to a stage."""

    stage: Annotated[str, Written("NAME")] | None = None
    """Only this stage."""
    serial_number: str | None = None
    """Only the stage with this serial number."""


@dataclass(frozen=True, slots=True, kw_only=True)
class RunsRequest(OfStage):
    """Runs, the latest first."""

    kind: Annotated[str, Written("KIND")] | None = None
    """Only this kind of test, such as motion."""
    since: _TIME | None = None
    """Only since a date, a date and time (UTC unless a zone is given), or "7 d" for the last seven
    days.
    """
    limit: Annotated[int, Range(low=1)] | None = None
    """Largest number of runs, the latest ones."""


@dataclass(frozen=True, slots=True, kw_only=True)
class CalibrationsRequest(OfStage):
    """Calibrations, the latest first."""

    what: Annotated[str, Written("NAME")] | None = None
    """Only this quantity, such as the gain of a sensor."""
    valid_at: _TIME | None = None
    """Only those valid at a date, or a date and time."""
