"""From an address to an instrument: a controller, an acquisition card, a simulation."""

from collections.abc import Mapping
from typing import TYPE_CHECKING
from urllib.parse import SplitResult, parse_qsl, urlsplit

from flexstage.errors import ModelError
from flexstage.instruments.protocol import Instrument
from flexstage.stage import Stage

if TYPE_CHECKING:
    from flexstage.instruments.pi.controller import PiController
    from flexstage.instruments.pi.profile import TransferLimits

_FORMS = (
    "gcs://HOST:PORT, serial:///dev/ttyUSB0?baud=115200, twin://?seed=3&model=lumped, or ni://Dev1"
)
_YES_OR_NO = {"1": True, "yes": True, "true": True, "0": False, "no": False, "false": False}
_TWIN = ("seed", "model", "rate", "amplifier", "fast", "scatter", "quiet", "serial_number")
#: Lines that a simulation takes are longer than those of a controller.
_LONG_LINES = 16384
_LONGEST_WAIT = 60.0


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

    Options of a simulated controller: ``seed``, ``model`` (lumped or superelement), ``rate`` of
    its loop [Hz], ``amplifier`` (voltage or charge), ``scatter``, ``quiet``, ``serial_number``, and
    ``fast``: 1, the default, lets its time pass with the commands, 0 in step with real time.

    Examples
    --------
    >>> from contextlib import closing
    >>> with closing(connect("twin://vgtu-piezo?model=lumped&seed=3")) as twin:
    ...     twin.identity.simulated, sorted(twin.axes)
    (True, ['x', 'y'])
    """
    if not isinstance(address, str):
        return _gateway(address, _given(stage, "a gateway"), axes, timeout)
    try:
        parts = urlsplit(address.strip())
    except ValueError as error:
        raise ModelError(_no_address(address)) from error
    if parts.scheme == "gcs":
        return _network(address, parts, _given(stage, address), axes, timeout)
    if parts.scheme == "serial":
        return _serial(address, parts, _given(stage, address), axes, timeout)
    if parts.scheme == "twin":
        return _twin(address, parts, stage, axes, timeout)
    if parts.scheme == "ni":
        return _card(address, _given(stage, address), axes)
    raise ModelError(_no_address(address))


def _network(
    address: str,
    parts: SplitResult,
    stage: Stage,
    axes: Mapping[str, str] | None,
    timeout: float | None,
) -> Instrument:
    from flexstage.instruments.pi.controller import PiController
    from flexstage.instruments.pi.transport import DEFAULT_PORT, TcpLink

    _options(address, parts, ())
    try:
        port = parts.port
    except ValueError as error:
        raise ModelError(
            f"the port of '{address}' must be a number from 1 to 65535, as in gcs://192.168.0.10:"
            f"{DEFAULT_PORT}"
        ) from error
    if not parts.hostname or parts.path.strip("/"):
        raise ModelError(
            f"'{address}' names no host: write gcs://HOST:PORT, as in gcs://127.0.0.1:50000"
        )
    link = TcpLink(parts.hostname, DEFAULT_PORT if port is None else port)
    return PiController.open(link, stage, axes=axes, timeout=_wait(timeout))


def _serial(
    address: str,
    parts: SplitResult,
    stage: Stage,
    axes: Mapping[str, str] | None,
    timeout: float | None,
) -> Instrument:
    from flexstage.instruments.pi.controller import PiController
    from flexstage.instruments.pi.transport import DEFAULT_BAUD, SerialLink

    options = _options(address, parts, ("baud",))
    baud = options.get("baud", str(DEFAULT_BAUD))
    port = parts.netloc or parts.path
    if not port.strip("/") or (parts.netloc and parts.path.strip("/")):
        raise ModelError(f"'{address}' names no port: write serial:///dev/ttyUSB0 or serial://COM3")
    if not baud.isdecimal() or not 300 <= int(baud) <= 12_000_000:
        raise ModelError(f"the baud rate of '{address}' must be 300 to 12000000, got '{baud}'")
    link = SerialLink(port, baud=int(baud))
    return PiController.open(link, stage, axes=axes, timeout=_wait(timeout))


def _gateway(
    gateway: object, stage: Stage, axes: Mapping[str, str] | None, timeout: float | None
) -> Instrument:
    from flexstage.instruments.pi.controller import PiController
    from flexstage.instruments.pi.transport import GatewayLink, is_gateway

    if not is_gateway(gateway):
        raise ModelError(
            f"an instrument is given by its address ({_FORMS}) or by an object with the methods "
            f"send(text) and read(), got a {type(gateway).__name__}"
        )
    return PiController.open(GatewayLink(gateway), stage, axes=axes, timeout=_wait(timeout))


def _twin(
    address: str,
    parts: SplitResult,
    stage: Stage | None,
    axes: Mapping[str, str] | None,
    timeout: float | None,
) -> Instrument:
    from flexstage.designs import design
    from flexstage.instruments.pi.profile import TransferLimits

    options = _options(address, parts, _TWIN)
    name = parts.netloc + parts.path
    if stage is None:
        if not name:
            raise ModelError(
                f"'{address}' names no stage: write twin://vgtu-piezo, or give the stage"
            )
        stage = design(name)
    elif name not in ("", stage.name):
        raise ModelError(
            f"'{address}' is a twin of '{name}', and the stage is '{stage.name}': leave the name "
            "out, as in twin://?seed=3"
        )
    return _simulated(
        stage, options, address, axes, timeout=_wait(timeout, _LONGEST_WAIT),
        transfer=TransferLimits(line_limit=_LONG_LINES),
    )  # fmt: skip


def _simulated(
    stage: Stage,
    options: Mapping[str, str],
    address: str,
    axes: Mapping[str, str] | None,
    *,
    timeout: float,
    transfer: "TransferLimits",
) -> "PiController":
    from flexstage.instruments.pi.controller import PiController
    from flexstage.instruments.pi.simulated.clock import FastTime, Pacemaker
    from flexstage.instruments.pi.simulated.controller import VirtualController
    from flexstage.instruments.pi.simulated.interpreter import Interpreter
    from flexstage.instruments.pi.simulated.session import Loopback
    from flexstage.instruments.pi.transport import InProcess
    from flexstage.virtual.build import virtual_stage

    fast = _flag(options, "fast", True, address)
    seed = int(_number(options, "seed", 0, address, whole=True))
    made = virtual_stage(
        stage,
        model=_one_of(options, "model", ("lumped", "superelement"), address),  # pyright: ignore[reportArgumentType]
        seed=seed,
        sample_rate_hz=_number(options, "rate", 10e3, address),
        amplifier=_one_of(options, "amplifier", ("voltage", "charge"), address),  # pyright: ignore[reportArgumentType]
        quiet=_flag(options, "quiet", False, address),
        scatter=_flag(options, "scatter", True, address),
    )
    serial_number = options.get("serial_number") or f"twin-{seed}"
    device = VirtualController(made, serial_number=serial_number)
    pace = FastTime(device) if fast else Pacemaker(device)
    pace.start()
    conversation = Loopback(Interpreter(device, pace), ends_time=True)
    link = InProcess(conversation, name=f"twin of {stage.name}")
    return PiController.open(link, stage, axes=axes, timeout=timeout, transfer=transfer)


def _card(address: str, stage: Stage, axes: Mapping[str, str] | None) -> Instrument:
    from flexstage.instruments.ni.address import open_address

    return open_address(address, stage, axes=axes)


def _options(address: str, parts: SplitResult, known: tuple[str, ...]) -> dict[str, str]:
    pairs = parse_qsl(parts.query, keep_blank_values=True)
    for key, _ in pairs:
        if key not in known:
            there = f"are {', '.join(known)}" if known else "is none for this kind of address"
            raise ModelError(f"'{address}' has the option '{key}', and there {there}")
    if len(dict(pairs)) < len(pairs):
        raise ModelError(f"'{address}' names an option twice: leave one out")
    return dict(pairs)


def _number(
    options: Mapping[str, str], key: str, usual: float, address: str, *, whole: bool = False
) -> float:
    text = options.get(key)
    if text is None:
        return usual
    try:
        value = float(int(text)) if whole else float(text)
    except (ValueError, OverflowError):
        value = -1.0
    if not 0.0 <= value < float("inf"):
        raise ModelError(
            f"'{key}' of '{address}' must be a {'whole ' if whole else ''}number from 0, got "
            f"'{text}'"
        )
    return value


def _flag(options: Mapping[str, str], key: str, usual: bool, address: str) -> bool:
    text = options.get(key)
    if text is None:
        return usual
    if text.lower() not in _YES_OR_NO:
        raise ModelError(f"'{key}' of '{address}' must be 1 or 0, got '{text}'")
    return _YES_OR_NO[text.lower()]


def _one_of(options: Mapping[str, str], key: str, known: tuple[str, ...], address: str) -> str:
    text = options.get(key, known[0])
    if text not in known:
        raise ModelError(f"'{key}' of '{address}' must be {' or '.join(known)}, got '{text}'")
    return text


def _wait(timeout: float | None, usual: float = 2.0) -> float:
    if timeout is None:
        return usual
    if not 0.0 < timeout < float("inf"):
        raise ModelError(f"the time-out must be positive and finite, got {timeout!r} s")
    return timeout


def _given(stage: Stage | None, address: str) -> Stage:
    if stage is None:
        raise ModelError(f"connecting to {address} needs the stage that is mounted there: give it")
    return stage


def _no_address(address: str) -> str:
    return f"'{address}' is not the address of an instrument: write {_FORMS}"
