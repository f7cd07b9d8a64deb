"""Requests of a twin, and of runs and calibrations in a catalogue."""

from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Annotated, Literal

from flexstage.base.errors import ModelError
from flexstage.files.ranges import Range, Seed, Written
from flexstage.files.request import Request
from flexstage.quantities.units import DIMENSIONS


def read_names(text: str) -> tuple[str, ...]:
    """Return names as they are written."""
    return tuple(text.split(",")) if text else ()


def read_address(text: str) -> tuple[str, int]:
    """Return the host to listen on, by default this computer, and the port.

    Examples
    --------
    >>> read_address("0.0.0.0:50000"), read_address("[::1]:0"), read_address("8080")
    (('0.0.0.0', 50000), ('::1', 0), ('127.0.0.1', 8080))
    """
    host, _, port = text.strip().rpartition(":")
    bare = ":" in host and not (host.startswith("[") and host.endswith("]"))
    if bare or not port.isdecimal() or int(port) > _LAST_PORT:
        raise ModelError(
            f"must be a port from 0 to {_LAST_PORT}, optionally after an address, such as 8080, "
            f"0.0.0.0:8080 or [::1]:8080, got '{text[:60]}'"
        )
    return host.removeprefix("[").removesuffix("]") or _LOOPBACK, int(port)


def write_address(address: tuple[str, int]) -> str:
    """Return the text of a host and a port."""
    host, port = address
    if not 0 <= port <= _LAST_PORT:
        raise ValueError
    return f"[{host}]:{port}" if ":" in host else f"{host}:{port}"


_LOOPBACK, _LAST_PORT = "127.0.0.1", 65535
#: Host and port to listen on.
Address = Annotated[tuple[str, int], Written("[HOST:]PORT", read=read_address, write=write_address)]


@dataclass(frozen=True, slots=True, kw_only=True)
class TwinRequest(Request):
    """A simulated stage with a GCS controller."""

    address: Address = (_LOOPBACK, 50000)
    """Address and TCP port to listen on, 0 for any free port (default address: 127.0.0.1); any
    other address lets others on the network move the stage.
    """
    seed: Seed = 0
    """Random seed of the simulated stage."""
    model: Literal["lumped", "superelement"] = "lumped"
    """Model of the mechanics: rigid bodies, or condensed finite elements."""
    servo_rate: Annotated[
        float, DIMENSIONS["frequency"], Range(low=1e3, high=50e3), Written(bare="Hz")
    ] = 10e3
    """Rate of the servo loop, such as "10 kHz"."""
    amplifier: Literal["voltage", "charge"] = "voltage"
    """Amplifier of the piezo stacks; no effect on screw drives."""
    fast: bool = False
    """Advance simulated time by commands instead of real time."""
    identity: (
        Literal[
            "E-727", "E-709", "E-712", "E-725", "E-753", "E-754", "E-516", "E-517", "C-863",
            "C-884", "flexstage",
        ]
        | None
    ) = None  # fmt: skip
    """Controller type that it reports, by which programs choose their driver (default: E-727, or
    C-884 for screws); flexstage: generic type with all commands.
    """
    axes: Annotated[tuple[str, ...], Written("NAMES", read=read_names, write=",".join)] = ()
    """Identifiers of its axes, such as "Z" or "X,Y" (default: 1,2,...)."""
    widths: Annotated[str, Written("FILE")] | None = None
    """Measured necks, as of tolerance: bias and scatter of those of the simulated stage."""
    environment: Path | None = None
    """Description of disturbances in YAML, as of budget, in place of the noise of the simulated
    stage.
    """
    table: Annotated[str, Written("TABLE")] | None = None
    """Description of a rotary table (YAML) that turns with the stage and its scale: its angle, and
    the angles that its heads read, are further sensors.
    """


_SECONDS = {"d": 86_400.0, "h": 3600.0, "min": 60.0}


def read_time(text: str) -> datetime:
    """Return a date, a date and time, or a time ago such as ``7 d``, in UTC.

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
        raise ModelError(f"'{text}' is outside the range of dates in UTC") from None


def _ago(text: str) -> datetime:
    number = text.rstrip("abcdefghijklmnopqrstuvwxyz")
    try:
        seconds = float(number.strip()) * _SECONDS[text[len(number) :]]
        return datetime.now(UTC) - timedelta(seconds=seconds)
    except (KeyError, ValueError, OverflowError):
        raise ModelError(
            f"expected a date such as 2031-05-17, a date and time such as 2031-05-17T09:30, or a "
            f"time ago such as 7d, 12h or 30min, got '{text}'"
        ) from None


_TIME = Annotated[datetime, Written("DATE", read=read_time, write=datetime.isoformat)]


@dataclass(frozen=True, slots=True, kw_only=True)
class OfStage(Request):
    """Selection of a stage."""

    stage: Annotated[str, Written("NAME")] | None = None
    """Only this stage."""
    serial_number: str | None = None
    """Only the stage with this serial number."""


@dataclass(frozen=True, slots=True, kw_only=True)
class RunsRequest(OfStage):
    """Runs, the latest first."""

    test: Annotated[str, Written("KIND")] | None = None
    """Only this kind of test, such as motion."""
    since: _TIME | None = None
    """Only since a date, a date and time (UTC unless a zone is given), or "7 d" for the last seven
    days.
    """
    limit: Annotated[int, Range(low=1)] | None = None
    """Largest number of runs, from the latest."""


@dataclass(frozen=True, slots=True, kw_only=True)
class CalibrationsRequest(OfStage):
    """Calibrations, the latest first."""

    what: Annotated[str, Written("NAME")] | None = None
    """Only this quantity, such as the gain of a sensor."""
    valid_at: _TIME | None = None
    """Only those valid at a date, or a date and time."""
