"""Addresses of instruments, and the drivers that connect to them."""

import math
from collections.abc import Mapping
from contextlib import suppress
from importlib import import_module
from typing import NamedTuple
from urllib.parse import SplitResult, parse_qsl, urlsplit

from flexstage.base.errors import ModelError
from flexstage.instruments.protocol import Instrument
from flexstage.stage import Stage


class Driver(NamedTuple):
    """Driver of the instruments of a scheme of addresses."""

    form: str
    """Example of an address."""
    module: str
    """Its module; imported on first use."""
    function: str
    """Its function of address and stage, and of `axes` and `timeout` as for `connect`."""
    needs_stage: bool = True
    """Whether it needs the stage in addition to the address."""


_HERE = "flexstage.instruments"
_CONTROLLER = (f"{_HERE}.pi.controller", "connect_controller")
#: Drivers by the scheme of their addresses; a new driver is a line here.
DRIVERS = {
    "gcs": Driver("gcs://HOST:PORT", *_CONTROLLER),
    "serial": Driver("serial:///dev/ttyUSB0?baud=115200", *_CONTROLLER),
    "twin": Driver(
        "twin://?seed=3&model=lumped", f"{_HERE}.pi.simulated.address", "open_twin", False
    ),
    "ni": Driver("ni://Dev1", f"{_HERE}.ni.address", "open_card"),
}

_GATEWAY = Driver("a gateway", *_CONTROLLER)


def connect(
    address: object,
    stage: Stage | None = None,
    *,
    axes: Mapping[str, str] | None = None,
    timeout: float | None = None,
) -> Instrument:
    """Connect to an instrument; this neither moves the stage nor switches anything.

    The address is ``gcs://HOST:PORT`` for a controller in the network or `flexstage twin`,
    ``serial:///dev/ttyUSB0?baud=115200`` or ``serial://COM3`` for one at a serial port,
    ``twin://NAME?seed=3&model=lumped`` for a simulated one in this process, ``ni://Dev1`` for an
    acquisition card (`open_address`); or an object of your own with `send` and `read`.

    `stage` is the connected stage, by default the built-in design in a ``twin://`` address. `axes`
    are the axes of the controller by the names of the stage's axes, by default in their order.
    `timeout` is the longest time without an answer of the controller [s]. Close the instrument
    after use.

    Options of a simulated controller: ``seed``, ``model`` (lumped or superelement), ``servo_rate``
    of its loop [Hz], ``amplifier`` (voltage or charge), ``scatter``, ``quiet``, and ``fast``: 1,
    the default, to advance its time by commands, 0 for real time.

    Examples
    --------
    >>> from contextlib import closing
    >>> with closing(connect("twin://vgtu-piezo?model=lumped&seed=3")) as twin:
    ...     twin.identity.simulated, sorted(twin.axes)
    (True, ['x', 'y'])
    """
    if isinstance(address, str):
        try:
            scheme = urlsplit(address.strip()).scheme
        except ValueError:
            scheme = ""
        if scheme not in DRIVERS:
            raise ModelError(f"'{address}' is not an address of an instrument: write {_forms()}")
        driver, where = DRIVERS[scheme], address
    else:
        driver, where = _GATEWAY, _GATEWAY.form
    if stage is None and driver.needs_stage:
        raise ModelError(f"connecting to {where} needs the stage that is mounted there: name it")
    if driver is _GATEWAY:
        from flexstage.instruments.transport import is_gateway

        if not is_gateway(address):
            raise ModelError(
                f"an instrument is an address ({_forms()}) or an object with the methods "
                f"send(text) and read(), got a {type(address).__name__}"
            )
    opened = getattr(import_module(driver.module), driver.function)
    return opened(address, stage, axes=axes, timeout=timeout)


def _forms() -> str:
    *others, last = (driver.form for driver in DRIVERS.values())
    return f"{', '.join(others)}, or {last}"


_YES_OR_NO = {"1": True, "yes": True, "true": True, "0": False, "no": False, "false": False}


def options_of(
    address: str, parts: SplitResult, known: tuple[str, ...] | None = None
) -> dict[str, str]:
    """Return the options of an address; refuse unknown and repeated ones.

    All options are accepted where none are `known`, for addresses with user-defined names.
    """
    pairs = parse_qsl(parts.query, keep_blank_values=True)
    for key, _ in pairs:
        if known is not None and key not in known:
            allowed = f"options: {', '.join(known)}" if known else "this address has no options"
            raise ModelError(f"'{address}' has the unknown option '{key}' ({allowed})")
    if len(dict(pairs)) < len(pairs):
        raise ModelError(f"'{address}' has an option twice: remove one")
    return dict(pairs)


def whole_number(options: Mapping[str, str], key: str, usual: int, address: str) -> int:
    """Return an option that is a whole number from 0."""
    text = options.get(key)
    if text is None:
        return usual
    with suppress(ValueError, OverflowError):
        value = int(text)
        if 0.0 <= float(value) < math.inf:  # a number with hundreds of digits is refused
            return value
    raise ModelError(f"'{key}' of '{address}' must be a whole number from 0, got '{text}'")


def flag(options: Mapping[str, str], key: str, usual: bool, address: str) -> bool:
    """Return a switch, an option that is 1 or 0."""
    text = options.get(key)
    if text is None:
        return usual
    if text.lower() not in _YES_OR_NO:
        raise ModelError(f"'{key}' of '{address}' must be 1 or 0, got '{text}'")
    return _YES_OR_NO[text.lower()]


def longest_silence(timeout: float | None, usual: float = 2.0) -> float:
    """Return the longest time without an answer [s]."""
    if timeout is None:
        return usual
    if not 0.0 < timeout < float("inf"):
        raise ModelError(f"the timeout must be positive and finite, got {timeout!r} s")
    return timeout
