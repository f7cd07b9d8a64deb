"""An instrument by its address: how an address is read, and who opens what it names."""

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
    """What makes an instrument of an address."""

    form: str
    """An address, as an example."""
    module: str
    """Where it is; imported when it is first used."""
    function: str
    """Takes the address and the stage, and `axes` and `timeout` as `connect` has them."""
    needs_stage: bool = True
    """Whether the address alone does not say which stage is there."""


_HERE = "flexstage.instruments"
#: Drivers by the scheme of their addresses: a new one is a line here.
DRIVERS = {
    "gcs": Driver("gcs://HOST:PORT", f"{_HERE}.pi.controller", "open_network"),
    "serial": Driver("serial:///dev/ttyUSB0?baud=115200", f"{_HERE}.pi.controller", "open_serial"),
    "twin": Driver(
        "twin://?seed=3&model=lumped", f"{_HERE}.pi.simulated.address", "open_twin", False
    ),
    "ni": Driver("ni://Dev1", f"{_HERE}.ni.address", "open_card"),
}

_GATEWAY = Driver("a gateway", f"{_HERE}.pi.controller", "open_gateway")


def connect(
    address: object,
    stage: Stage | None = None,
    *,
    axes: Mapping[str, str] | None = None,
    timeout: float | None = None,
) -> Instrument:
    """Connect to an instrument; nothing moves and nothing is switched by it.

    The address is ``gcs://HOST:PORT`` for a controller in the network or `flexstage twin`,
    ``serial:///dev/ttyUSB0?baud=115200`` or ``serial://COM3`` for one at a serial port,
    ``twin://NAME?seed=3&model=lumped`` for a simulated one in this process, ``ni://Dev1`` for an
    acquisition card (`open_address`); or it is an object of your own with `send` and `read`.

    The stage is the one that is connected; the built-in design of the name in a ``twin://`` address
    where not given. `axes` names the controller's axis by the name of the stage's; they are taken
    in their order where not given. `timeout` is the longest silence of a controller [s]. Close the
    instrument when done.

    Options of a simulated controller: ``seed``, ``model`` (lumped or superelement), ``servo_rate``
    of its loop [Hz], ``amplifier`` (voltage or charge), ``scatter``, ``quiet``, ``serial_number``,
    and ``fast``: 1, the default, lets its time pass with the commands, 0 in step with real time.

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
            raise ModelError(f"'{address}' is not the address of an instrument: write {_forms()}")
        driver, where = DRIVERS[scheme], address
    else:
        driver, where = _GATEWAY, _GATEWAY.form
    if stage is None and driver.needs_stage:
        raise ModelError(f"connecting to {where} needs the stage that is mounted there: give it")
    if driver is _GATEWAY:
        from flexstage.instruments.transport import is_gateway

        if not is_gateway(address):
            raise ModelError(
                f"an instrument is given by its address ({_forms()}) or by an object with the "
                f"methods send(text) and read(), got a {type(address).__name__}"
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
    """Return the options of an address; refuse those that its kind has not, and doubled ones.

    Of a kind whose options have names of the user's own none are `known`, and all are taken.
    """
    pairs = parse_qsl(parts.query, keep_blank_values=True)
    for key, _ in pairs:
        if known is not None and key not in known:
            there = f"are {', '.join(known)}" if known else "is none for this kind of address"
            raise ModelError(f"'{address}' has the option '{key}', and there {there}")
    if len(dict(pairs)) < len(pairs):
        raise ModelError(f"'{address}' names an option twice: leave one out")
    return dict(pairs)


def whole_number(options: Mapping[str, str], key: str, usual: int, address: str) -> int:
    """Return an option that is a whole number from 0."""
    text = options.get(key)
    if text is None:
        return usual
    with suppress(ValueError, OverflowError):
        value = int(text)
        if 0.0 <= float(value) < math.inf:  # one of hundreds of digits is none
            return value
    raise ModelError(f"'{key}' of '{address}' must be a whole number from 0, got '{text}'")


def flag(options: Mapping[str, str], key: str, usual: bool, address: str) -> bool:
    """Return an option that is 1 or 0."""
    text = options.get(key)
    if text is None:
        return usual
    if text.lower() not in _YES_OR_NO:
        raise ModelError(f"'{key}' of '{address}' must be 1 or 0, got '{text}'")
    return _YES_OR_NO[text.lower()]


def longest_silence(timeout: float | None, usual: float = 2.0) -> float:
    """Return a time after which an answer is given up [s]."""
    if timeout is None:
        return usual
    if not 0.0 < timeout < float("inf"):
        raise ModelError(f"the time-out must be positive and finite, got {timeout!r} s")
    return timeout
