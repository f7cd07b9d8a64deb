"""A PI controller with a stage, as an instrument, and the questions by which it is discovered."""

import time
from collections.abc import Callable, Mapping, Sequence
from typing import Self
from urllib.parse import urlsplit

from flexstage.base.errors import ControllerError, ModelError, NotConnectedError
from flexstage.instruments.connect import longest_silence, options_of
from flexstage.instruments.pi.axis import AxisFacts, PiAxis, tunable
from flexstage.instruments.pi.connection import (
    Connection,
    TransferLimits,
    read_profile,
)
from flexstage.instruments.pi.conversation import GcsClient
from flexstage.instruments.pi.replies import WireUnit, axis_unit
from flexstage.instruments.pi.tables import ChannelFacts, PiRecorder, PiWaves
from flexstage.instruments.protocol import Capability, ChannelMap, Instrument
from flexstage.instruments.transport import (
    DEFAULT_BAUD,
    DEFAULT_PORT,
    GatewayLink,
    SerialLink,
    TcpLink,
    Transport,
)
from flexstage.stage import Screw, Stage
from flexstage.stage.limits import AxisLimits, stage_limits

Range = tuple[float, float]

#: Numbers of tables and samples where a controller does not report them.
_FEW_TABLES, _FEW_SAMPLES = 1, 1024


def _axes(
    connection: Connection, stage: Stage, axes: Mapping[str, str] | None
) -> dict[str, PiAxis]:
    """Return the axes of the stage; `axes` are their identifiers by name."""
    listed = [line.strip() for line in connection.client.ask("SAI?")]
    connection.axes = len(listed)
    identifiers_of = _identifiers(listed, stage, axes)
    outputs = _outputs(connection, stage, listed, identifiers_of)
    facts = [
        _axis(connection, stage, name, identifier, listed.index(identifier), outputs.get(name))
        for name, identifier in identifiers_of.items()
    ]
    if connection.profile.knows("SVO?"):
        identifiers = [axis.identifier for axis in facts]
        states = connection.client.ask_values("SVO?", identifiers)
        connection.servo = {a: bool(on) for a, on in zip(identifiers, states, strict=True)}
    return {axis.name: PiAxis(connection, axis) for axis in facts}


def _identifiers(
    listed: Sequence[str], stage: Stage, axes: Mapping[str, str] | None
) -> dict[str, str]:
    names = [axis.name for axis in stage.axes]
    if axes is None:
        if len(listed) < len(names):
            raise ControllerError(
                f"the controller has {len(listed)} axes ({', '.join(listed)}) and the stage "
                f"{len(names)} ({', '.join(names)}): name the connected axes, such as "
                f"axes={{'{names[0]}': '{listed[0]}'}}"
            )
        return dict(zip(names, listed, strict=False))
    for name, identifier in axes.items():
        if name not in names:
            raise ModelError(f"the stage has no axis '{name}': it has {', '.join(names)}")
        if identifier not in listed:
            raise ControllerError(
                f"the controller has no axis '{identifier}': it has {', '.join(listed)}"
            )
    if not axes or len(set(axes.values())) < len(axes):
        raise ModelError(
            f"each axis of the stage needs a different axis of the controller, got {dict(axes)}"
        )
    return dict(axes)


def _outputs(
    connection: Connection, stage: Stage, listed: Sequence[str], identifiers: Mapping[str, str]
) -> dict[str, str]:
    """Return the number of the piezo channel of each axis that has one.

    Channels belong to axes in their order; axes with screws have none.
    """
    if not connection.profile.knows("VOL?", "SVA"):
        return {}
    screws = {identifiers[n] for n in identifiers if isinstance(stage.drive_of(n), Screw)}
    piezo = [identifier for identifier in listed if identifier not in screws]
    count = len(piezo)
    if connection.profile.knows("TPC?"):
        count = connection.client.ask_whole("TPC?")
    places = {identifier: str(i) for i, identifier in enumerate(piezo, 1) if i <= count}
    return {name: places[i] for name, i in identifiers.items() if i in places}


def _axis(
    connection: Connection, stage: Stage, name: str, identifier: str, index: int, output: str | None
) -> AxisFacts:
    profile = connection.profile
    word = connection.client.ask_texts("PUN?", [identifier])[0] if profile.knows("PUN?") else "um"
    unit = axis_unit(word, identifier, name)
    position = _range(connection, "TMN?", "TMX?", identifier, unit.factor)
    voltage = None if output is None else _range(connection, "VMI?", "VMA?", output, 1.0)
    slew = connection.number_parameter(identifier, r"largest slew-rate.*\[V/s\]") or None
    speed = connection.number_parameter(identifier, r"largest speed.*m/s\]")
    of_controller = AxisLimits(
        position=position,
        voltage=voltage,
        slew=slew if output is not None else None,
        speed=speed * unit.factor if speed else None,
    )
    limits = stage_limits(stage, name).within(of_controller)
    capabilities: set[Capability] = set()
    if profile.knows("MOV", "POS?"):
        capabilities.add(Capability.CLOSED_LOOP)
    if output is not None and limits.voltage is not None:
        capabilities.add(Capability.OPEN_LOOP)
        if Capability.CLOSED_LOOP in capabilities and tunable(profile):
            capabilities.add(Capability.SERVO_TUNING)
        if profile.parameter(r"feed-?forward wave table") is not None:
            capabilities.add(Capability.FEEDFORWARD_TABLE)
    return AxisFacts(
        name=name,
        identifier=identifier,
        index=index,
        output=output,
        unit=unit,
        limits=limits,
        capabilities=frozenset(capabilities),
    )


def _range(connection: Connection, low: str, high: str, name: str, factor: float) -> Range | None:
    if not connection.profile.knows(low, high):
        return None
    ends = [connection.client.ask_values(question, [name])[0] * factor for question in (low, high)]
    if not ends[0] < ends[1]:
        raise ControllerError(
            f"the controller answers {ends[0]:g} to '{low}' and {ends[1]:g} to '{high}' for "
            f"{name}, which is not a range: check its settings"
        )
    return ends[0], ends[1]


def _channels(connection: Connection, axes: Mapping[str, PiAxis]) -> tuple[ChannelFacts, ...]:
    if not connection.profile.knows("TSC?"):
        return ()
    count = connection.client.ask_whole("TSC?")
    names = connection.profile.parameter(r"^channel name")
    units = connection.profile.parameter(r"^channel unit")
    channels = []
    for number in range(1, count + 1):
        name = str(number) if names is None else connection.read_parameter(str(number), names)
        word = "" if units is None else connection.read_parameter(str(number), units)
        turns = word.lower() == "urad"
        unit = _sensor_unit(word, number, next(iter(axes.values())).facts)
        channels.append(
            ChannelFacts(number=number, name=name, unit="rad" if turns else "m", factor=unit)
        )
    return tuple(channels)


def _sensor_unit(word: str, number: int, first: AxisFacts) -> float:
    """Return the SI value of a sensor's unit, by default that of the first axis."""
    if word.lower() == "urad":
        return 1e-6
    if not word:
        return first.unit.factor
    unit: WireUnit = axis_unit(word, f"sensor {number}", first.name)
    return unit.factor


def _recorder(
    connection: Connection,
    axes: Mapping[str, PiAxis],
    channels: Sequence[ChannelFacts],
    base_rate_hz: float,
) -> PiRecorder | None:
    if not connection.profile.knows("DRC", "DRR?", "DRL?", "RTR", "DRT"):
        return None
    tables = (
        connection.client.ask_whole("TNR?") if connection.profile.knows("TNR?") else _FEW_TABLES
    )
    capacity = connection.number_parameter("1", r"data recorder points per table")
    if capacity is None:
        most = connection.number_parameter("1", r"data recorder max points")
        capacity = _FEW_SAMPLES if most is None else most / tables
    return PiRecorder(
        connection,
        axes,
        {c.number: c for c in channels},
        base_rate_hz=base_rate_hz,
        capacity=int(capacity),
        tables=tables,
    )


def _waves(
    connection: Connection,
    axes: Mapping[str, PiAxis],
    base_rate_hz: float,
    recorder: PiRecorder | None,
) -> PiWaves | None:
    if not connection.profile.knows("WAV", "WSL", "WGO", "WGC", "WTR"):
        return None
    tables = connection.number_parameter("1", r"number of waves")
    capacity = connection.number_parameter("1", r"max wave points")
    return PiWaves(
        connection,
        axes,
        base_rate_hz=base_rate_hz,
        capacity=_FEW_SAMPLES * connection.axes if capacity is None else int(capacity),
        tables=connection.axes if tables is None else int(tables),
        on_start=(lambda: None) if recorder is None else recorder.triggered,
    )


class PiController(Instrument):
    """A controller with the General Command Set 2, and its stage.

    Its capabilities follow from the commands and parameters that the controller lists, never from
    its name. Created by `PiController.open`. Only a simulated stage has a hammer: its drives are
    removed for the impacts, and installed again before the next motion.

    Validity: written for the published command set and tested against simulated controllers only,
    never against hardware. Only `MotionAxis.reference` references axes.
    """

    concurrent = True

    def __init__(
        self,
        connection: Connection,
        axes: Mapping[str, PiAxis],
        *,
        recorder: PiRecorder | None,
        waves: PiWaves | None,
        channels: Sequence[ChannelFacts],
    ) -> None:
        self._connection, self._axes = connection, dict(axes)
        #: Its profile, and the client for further commands.
        self.profile, self.client = connection.profile, connection.client
        self.identity = connection.profile.identity
        self._recorder, self._waves = recorder, waves
        #: Its sensors by name if the controller reports it, otherwise by number.
        self.channels = ChannelMap(
            numbers={c.name: c.number for c in channels}, units={c.name: c.unit for c in channels}
        )
        self._factors = {c.number: c.factor for c in channels}

    @classmethod
    def open(
        cls,
        transport: Transport,
        stage: Stage,
        *,
        axes: Mapping[str, str] | None = None,
        transfer: TransferLimits | None = None,
        timeout: float = 2.0,
        clock: Callable[[], float] = time.monotonic,
        sleep: Callable[[float], object] = time.sleep,
    ) -> Self:
        """Discover a controller; this neither moves the stage nor switches anything.

        `axes` are the axes of the controller by the names of the stage's axes, by default in their
        order. The transport is closed if this fails. `timeout` is the longest time without an
        answer [s].
        """
        client = GcsClient(transport, timeout=timeout, clock=clock)
        try:
            connection = Connection(
                client,
                read_profile(client),
                TransferLimits() if transfer is None else transfer,
                clock=clock,
                sleep=sleep,
            )
            mapped = _axes(connection, stage, axes)
            step = connection.number_parameter("1", r"servo update time")
            channels = _channels(connection, mapped)
            recorder = waves = None
            if step is not None and step > 0.0:
                recorder = _recorder(connection, mapped, channels, 1.0 / step)
                waves = _waves(connection, mapped, 1.0 / step, recorder)
        except BaseException:
            client.close()
            raise
        return cls(connection, mapped, recorder=recorder, waves=waves, channels=channels)

    @property
    def capabilities(self) -> frozenset[Capability]:
        capabilities = set(super().capabilities)
        if self._recorder is not None:
            capabilities.add(Capability.DATA_RECORDER)
        if self._waves is not None:
            capabilities.add(Capability.WAVE_GENERATOR)
        if self._factors and self.profile.knows("TSP?"):
            capabilities.add(Capability.CHANNELS)
        if self._can_strike():
            capabilities.add(Capability.IMPACT)
        return frozenset(capabilities)

    @property
    def axes(self) -> Mapping[str, PiAxis]:
        return self._axes

    @property
    def recorder(self) -> PiRecorder:
        if self._recorder is None:
            raise ModelError("this controller has no commands of a data recorder")
        return self._recorder

    @property
    def waves(self) -> PiWaves:
        if self._waves is None:
            raise ModelError("this controller has no commands of a wave generator")
        return self._waves

    def channel(self, number: int) -> float:
        if number not in self._factors or not self.profile.knows("TSP?"):
            raise ModelError(
                f"there is no sensor {number}: the sensors are "
                f"{', '.join(map(str, self._factors)) or 'none'}"
            )
        value = self.client.ask_values("TSP?", [str(number)])[0]
        if not abs(value) < float("inf"):
            raise ControllerError(f"sensor {number} reads {value}: check the sensor and its cable")
        return value * self._factors[number]

    def strike(self, axis: str) -> None:
        if not self._can_strike():
            super().strike(axis)
        if axis not in self._axes:
            raise ModelError(
                f"there is no axis '{axis}': the axes are {', '.join(map(repr, self._axes))}"
            )
        self._connection.remove_drives()
        self._connection.tell(f"IMP {self._axes[axis].facts.identifier}")
        if self._recorder is not None:
            self._recorder.triggered()

    def pause(self, seconds: float) -> None:
        self._connection.pause(seconds)

    def stop(self) -> None:
        self.client.stop()

    def settings(self) -> Mapping[str, str]:
        names = {a.facts.identifier: name for name, a in self._axes.items()}
        return {
            "controller": self.client.identity.strip(),
            "link": self.client.name,
            "axes": ", ".join(f"{name}={identifier}" for identifier, name in names.items()),
            **self._connection.settings(),
        }

    def close(self) -> None:
        try:
            if self.client.connected:
                self._connection.restore_drives()
        except (NotConnectedError, ControllerError):
            pass  # the drives are simulated, and the link is closed anyway
        finally:
            self.client.close()

    def __enter__(self) -> Self:
        """Return itself."""
        return self

    def __exit__(self, *_: object) -> None:
        """Disconnect."""
        self.close()

    def _can_strike(self) -> bool:
        return self.profile.knows("IMP") and self._connection.has_drives


def connect_controller(
    address: object, stage: Stage, *, axes: Mapping[str, str] | None, timeout: float | None
) -> PiController:
    """Connect to a controller by its address, or through an object of the user's own."""
    silence = longest_silence(timeout)
    if not isinstance(address, str):
        link: Transport = GatewayLink(address)
    elif urlsplit(address.strip()).scheme == "serial":
        link = _serial_link(address)
    else:
        link = _network_link(address)
    return PiController.open(link, stage, axes=axes, timeout=silence)


def _network_link(address: str) -> TcpLink:
    """Return the link of ``gcs://HOST:PORT``."""
    parts = urlsplit(address.strip())
    options_of(address, parts, ())
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
    return TcpLink(parts.hostname, DEFAULT_PORT if port is None else port)


def _serial_link(address: str) -> SerialLink:
    """Return the link of ``serial:///dev/ttyUSB0?baud=115200``."""
    parts = urlsplit(address.strip())
    options = options_of(address, parts, ("baud",))
    baud = options.get("baud", str(DEFAULT_BAUD))
    port = parts.netloc or parts.path
    if not port.strip("/") or (parts.netloc and parts.path.strip("/")):
        raise ModelError(f"'{address}' names no port: write serial:///dev/ttyUSB0 or serial://COM3")
    if not baud.isdecimal() or not 300 <= int(baud) <= 12_000_000:
        raise ModelError(f"the baud rate of '{address}' must be 300 to 12000000, got '{baud}'")
    return SerialLink(port, baud=int(baud))
