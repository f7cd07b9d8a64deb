"""What is there at a controller: axes, sensors, recorder, wave generator. Only questions."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from flexstage.base.errors import ControllerError, ModelError
from flexstage.instruments.pi.axis import AxisFacts, tunable
from flexstage.instruments.pi.connection import Connection
from flexstage.instruments.pi.recorder import ChannelFacts
from flexstage.instruments.pi.replies import WireUnit, axis_unit
from flexstage.instruments.protocol import Capability
from flexstage.stage import Screw, Stage
from flexstage.stage.limits import AxisLimits, stage_limits

Range = tuple[float, float]

#: Tables and samples where a controller does not say how many it has.
_FEW_TABLES, _FEW_SAMPLES = 1, 1024


@dataclass(frozen=True, slots=True, kw_only=True)
class TableMemory:
    """Tables of a recorder or a wave generator."""

    tables: int
    """How many."""
    capacity: int
    """Samples: of each table of a recorder, over all tables of a wave generator."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Discovery:
    """What is there."""

    axes: tuple[AxisFacts, ...]
    """Axes that the stage has."""
    channels: tuple[ChannelFacts, ...]
    """Sensors."""
    base_rate_hz: float
    """Rate of the loop [Hz]."""
    recorder: TableMemory | None
    """Tables of its recorder; None where there is none."""
    waves: TableMemory | None
    """Tables of its wave generator; None where there is none."""


def discover(
    connection: Connection, stage: Stage, axes: Mapping[str, str] | None = None
) -> Discovery:
    """Ask what is there; `axes` names the controller's axis by the name of the stage's."""
    listed = [line.strip() for line in connection.client.ask("SAI?")]
    chosen = _chosen(listed, stage, axes)
    outputs = _outputs(connection, stage, listed, chosen)
    found = tuple(
        _axis(connection, stage, name, identifier, listed.index(identifier), outputs.get(name))
        for name, identifier in chosen.items()
    )
    if connection.profile.knows("SVO?"):
        identifiers = [axis.identifier for axis in found]
        states = connection.client.ask_values("SVO?", identifiers)
        connection.servo = {a: bool(on) for a, on in zip(identifiers, states, strict=True)}
    step = connection.number_parameter("1", r"servo update time")
    base = 0.0 if step is None or not step > 0.0 else 1.0 / step
    return Discovery(
        axes=found,
        channels=_channels(connection, found),
        base_rate_hz=base,
        recorder=_recorder(connection) if base else None,
        waves=_waves(connection, len(listed)) if base else None,
    )


def _chosen(listed: Sequence[str], stage: Stage, axes: Mapping[str, str] | None) -> dict[str, str]:
    names = [axis.name for axis in stage.axes]
    if axes is None:
        if len(listed) < len(names):
            raise ControllerError(
                f"the controller has {len(listed)} axes ({', '.join(listed)}) and the stage "
                f"{len(names)} ({', '.join(names)}): name those that are connected, as "
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
            f"each axis of the stage needs an axis of the controller of its own, got {dict(axes)}"
        )
    return dict(axes)


def _outputs(
    connection: Connection, stage: Stage, listed: Sequence[str], chosen: Mapping[str, str]
) -> dict[str, str]:
    """Return the number of the piezo channel of each axis that has one.

    Channels belong to axes in their order; axes that the stage moves by screws have none.
    """
    if not connection.profile.knows("VOL?", "SVA"):
        return {}
    screws = {chosen[n] for n in chosen if isinstance(stage.drive_of(n), Screw)}
    piezo = [identifier for identifier in listed if identifier not in screws]
    count = len(piezo)
    if connection.profile.knows("TPC?"):
        count = connection.client.ask_whole("TPC?")
    places = {identifier: str(i) for i, identifier in enumerate(piezo, 1) if i <= count}
    return {name: places[i] for name, i in chosen.items() if i in places}


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
    own = AxisLimits(
        position=position,
        voltage=voltage,
        slew=slew if output is not None else None,
        speed=speed * unit.factor if speed else None,
    )
    limits = stage_limits(stage, name).within(own)
    can: set[Capability] = set()
    if profile.knows("MOV", "POS?"):
        can.add(Capability.CLOSED_LOOP)
    if output is not None and limits.voltage is not None:
        can.add(Capability.OPEN_LOOP)
        if Capability.CLOSED_LOOP in can and tunable(profile):
            can.add(Capability.SERVO_TUNING)
        if profile.parameter(r"feed-?forward wave table") is not None:
            can.add(Capability.FEEDFORWARD_TABLE)
    return AxisFacts(
        name=name,
        identifier=identifier,
        index=index,
        output=output,
        unit=unit,
        limits=limits,
        capabilities=frozenset(can),
    )


def _range(connection: Connection, low: str, high: str, name: str, factor: float) -> Range | None:
    if not connection.profile.knows(low, high):
        return None
    ends = [connection.client.ask_values(question, [name])[0] * factor for question in (low, high)]
    if not ends[0] < ends[1]:
        raise ControllerError(
            f"the controller says '{low}' {ends[0]:g} and '{high}' {ends[1]:g} of {name}, which is "
            "no range: look at its settings"
        )
    return ends[0], ends[1]


def _channels(connection: Connection, axes: Sequence[AxisFacts]) -> tuple[ChannelFacts, ...]:
    if not connection.profile.knows("TSC?"):
        return ()
    count = connection.client.ask_whole("TSC?")
    names = connection.profile.parameter(r"^channel name")
    units = connection.profile.parameter(r"^channel unit")
    found = []
    for number in range(1, count + 1):
        name = str(number) if names is None else connection.read_parameter(str(number), names)
        word = "" if units is None else connection.read_parameter(str(number), units)
        turns = word.lower() == "urad"
        unit = _sensor_unit(word, number, axes)
        found.append(
            ChannelFacts(number=number, name=name, unit="rad" if turns else "m", factor=unit)
        )
    return tuple(found)


def _sensor_unit(word: str, number: int, axes: Sequence[AxisFacts]) -> float:
    """Return the SI value of a sensor's unit; that of the first axis where it names none."""
    if word.lower() == "urad":
        return 1e-6
    if not word:
        return axes[0].unit.factor
    unit: WireUnit = axis_unit(word, f"sensor {number}", axes[0].name)
    return unit.factor


def _recorder(connection: Connection) -> TableMemory | None:
    if not connection.profile.knows("DRC", "DRR?", "DRL?", "RTR", "DRT"):
        return None
    tables = (
        connection.client.ask_whole("TNR?") if connection.profile.knows("TNR?") else _FEW_TABLES
    )
    capacity = connection.number_parameter("1", r"data recorder points per table")
    if capacity is None:
        most = connection.number_parameter("1", r"data recorder max points")
        capacity = _FEW_SAMPLES if most is None else most / tables
    return TableMemory(tables=tables, capacity=int(capacity))


def _waves(connection: Connection, axes: int) -> TableMemory | None:
    if not connection.profile.knows("WAV", "WSL", "WGO", "WGC", "WTR"):
        return None
    tables = connection.number_parameter("1", r"number of waves")
    capacity = connection.number_parameter("1", r"max wave points")
    return TableMemory(
        tables=axes if tables is None else int(tables),
        capacity=_FEW_SAMPLES * axes if capacity is None else int(capacity),
    )
