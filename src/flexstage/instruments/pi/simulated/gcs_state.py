"""State of a simulated GCS controller that all its clients share, in units of the controller."""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import islice

from flexstage.instruments.pi.replies import METRES
from flexstage.instruments.pi.simulated.clock import Pace
from flexstage.instruments.pi.simulated.controller import VirtualController
from flexstage.instruments.pi.simulated.device import AxisDescription, Refusal, require
from flexstage.instruments.pi.simulated.record_store import RecordStore
from flexstage.system.servo import Notch, ServoSettings

#: Commands of controllers with reference or limit switches.
_REFERENCE = frozenset({"FNL", "FPL", "FRF", "LIM?", "RON", "RON?"})
#: Commands of controllers of motors only.
_MOTOR = frozenset({"ACC", "ACC?", "DEC", "DEC?", "DFH", "DFH?", "GOH", "TCV?"})
_ENABLE = frozenset({"EAX", "EAX?"})
_STATUS = frozenset({"SRG?", "TRS?"})
#: Commands of analogue amplifiers with a digital interface.
_ANALOGUE = frozenset({"DCO", "DCO?", "NLM", "ONL", "ONL?", "PLM", "VCO", "VCO?", "VMA", "VMI"})
#: Commands of wave generators.
_WAVES = frozenset({"GWD?", "TWC", "TWS", "WAV", "WCL", "WGC", "WGO", "WGO?", "WOS", "WSL", "WTR"})
#: Commands of digital controllers only.
_DIGITAL = frozenset(
    {"AOS?", "ATZ", "ATZ?", "CTO", "CTO?", "IDN?", "IFC?", "OVF?", "SSN?", "TAD?", "TNS?", "TWC",
     "TWS", "WOS"}
)  # fmt: skip


@dataclass(frozen=True, slots=True, kw_only=True)
class ControllerModel:
    """A type of controller."""

    name: str
    """Name in the answer to ``*IDN?``; empty for the generic type."""
    lacks: frozenset[str] = frozenset()
    """Commands that it answers with error 2."""
    syntax: str = "2.0"
    """Version of the command set, the answer to ``CSV?``."""
    unit: str = "um"
    """Unit of positions, as text."""
    inputs: int | None = None
    """Number of inputs that it lists by default; None for all."""
    axes: int | None = None
    """Number of axes; None for that of the stage."""
    motor: bool = False
    """Whether it drives motors, whose axes must be referenced at a switch first."""

    @property
    def scale(self) -> float:
        """SI value of its unit."""
        return METRES[self.unit.lower()]

    @property
    def one_line(self) -> bool:
        """Whether it lists the axes in one line, as before version 2 of the command set."""
        return self.syntax.startswith("1")


#: Generic type with all commands.
GENERIC = ControllerModel(name="")

_DIGITAL_PIEZO = _REFERENCE | _MOTOR | _ENABLE | _ANALOGUE
_AMPLIFIER = _REFERENCE | _MOTOR | _ENABLE | _STATUS | _DIGITAL
_OF_MOTORS = _ANALOGUE | _WAVES | {"AOS?", "OVF?", "NLM?", "PLM?", "IMP"}

#: Controller types by name; the first is the default, the last that of screws.
MODELS = {
    model.name: model
    for model in (
        ControllerModel(name="E-727", lacks=_DIGITAL_PIEZO | _STATUS | {"FRF?"}),
        ControllerModel(name="E-709", lacks=_DIGITAL_PIEZO, axes=1),
        ControllerModel(name="E-712", lacks=_ANALOGUE | _MOTOR),
        ControllerModel(name="E-725", lacks=_DIGITAL_PIEZO),
        ControllerModel(name="E-753", lacks=_DIGITAL_PIEZO | {"HLT"}, unit="\xb5M", inputs=2,
                        axes=1),
        ControllerModel(name="E-754", lacks=_DIGITAL_PIEZO, inputs=3, axes=1),
        ControllerModel(name="E-516", lacks=_AMPLIFIER, syntax="1.0"),
        ControllerModel(name="E-517", lacks=_AMPLIFIER),
        ControllerModel(name="C-863", lacks=_OF_MOTORS, unit="mm", axes=1, motor=True),
        ControllerModel(name="C-884", lacks=_OF_MOTORS, unit="mm", motor=True),
    )
}  # fmt: skip


#: SI value of micrometres and microradians.
MICRO = 1e-6
#: Number of notches of the position control.
NOTCHES = 4
_OF_NOTCH = ("frequency", "rejection", "bandwidth")
Range = tuple[float, float]


#: Numbers of the position control while single ones are changed, by quantity and number of the
#: notch: proportional [V/um], integral [V/(um s)] and lowpass [Hz, 0 for none]; frequency [Hz],
#: rejection (the gain at it) and bandwidth (twice the damping ratio of the poles) of notches.
Draft = dict[tuple[str, int], float]


def draft_of(settings: ServoSettings) -> Draft:
    """Return settings as a draft.

    A notch with frequency 0 is off; its other two numbers are kept.

    Examples
    --------
    >>> draft = draft_of(ServoSettings(integral=1.9e9, notches=(Notch(frequency_hz=800.0),)))
    >>> draft["integral", 0], draft["frequency", 0], draft["rejection", 0], draft["bandwidth", 0]
    (1900.0, 800.0, 0.02, 1.0)
    """
    draft = {
        ("proportional", 0): settings.proportional * MICRO,
        ("integral", 0): settings.integral * MICRO,
        ("lowpass", 0): settings.lowpass_hz or 0.0,
    }
    notches = [
        (n.frequency_hz, n.zero_damping / n.pole_damping, 2.0 * n.pole_damping)
        for n in settings.notches
    ]
    notches += [(0.0, 0.02, 1.0)] * (NOTCHES - len(notches))
    for slot, numbers in enumerate(notches):
        draft.update({(q, slot): v for q, v in zip(_OF_NOTCH, numbers, strict=True)})
    return draft


def drafted(draft: Draft, settings: ServoSettings) -> ServoSettings:
    """Return settings with the numbers of a draft."""
    slots = [slot for quantity, slot in draft if quantity == "frequency"]
    notches = [tuple(draft[quantity, slot] for quantity in _OF_NOTCH) for slot in slots]
    return replace(
        settings,
        proportional=draft["proportional", 0] / MICRO,
        integral=draft["integral", 0] / MICRO,
        notches=tuple(
            Notch(frequency_hz=f, zero_damping=0.5 * r * b, pole_damping=0.5 * b)
            for f, r, b in notches
            if f != 0.0
        ),
        lowpass_hz=draft["lowpass", 0] or None,
    )


class ControllerState:
    """State of a controller that all its clients share."""

    def __init__(
        self, device: VirtualController, pace: Pace, model: ControllerModel = GENERIC
    ) -> None:
        self.device, self.pace, self.model = device, pace, model
        #: Its address.
        self.host, self.port = "127.0.0.1", 0
        #: Number of stops.
        self.stops = 0
        #: Description by input channel.
        self.channels = {str(channel.number): channel for channel in device.channels}
        #: Texts of the parameters as delivered, by item and number.
        self.delivered: dict[tuple[str, int], str] = {}
        self.axes: dict[str, AxisDescription] = dict(islice(device.axes.items(), model.axes))
        piezo = [name for name, axis in self.axes.items() if axis.kind == "piezo"]
        #: Axis by output channel, by wave generator.
        self.outputs = {str(i): name for i, name in enumerate(piezo, 1)}
        self.generators = {str(i): name for i, name in enumerate(self.axes, 1)}
        self.forget()

    def forget(self) -> None:
        """Restore the state after power-on."""
        #: Offset of the waveform of an axis, in units of the controller.
        self.offsets = dict.fromkeys(self.axes, 0.0)
        #: SI value of the unit, and the offset, of the last waveform of each axis.
        self.wave_units: dict[str, tuple[float, float]] = {}
        self.recorder = RecordStore(self.device, self.axes, self.outputs, self.model.scale)
        #: Drafts with the resulting settings.
        self._drafts: dict[str, tuple[Draft, ServoSettings]] = {}
        #: Limits of clients by axis [m], [V].
        self.soft_positions: dict[str, Range] = {}
        self.soft_voltages: dict[str, Range] = {}
        #: Outputs that accept commands; disabled axes; speeds of axes without speed control [m/s];
        #: axes with drift compensation.
        self.online = dict.fromkeys(self.outputs, True)
        self.disabled: set[str] = set()
        self.free_speeds: dict[str, float] = {}
        self.drift_compensation = dict.fromkeys(self.axes, False)
        #: Axes that need a reference move, and referenced ones; targets of running reference moves
        #: [m]; home positions [m]; accelerations, which have no effect here.
        self.reference_mode = {name: self.has_switch(name) for name in self.axes}
        self.referenced_axes = set[str]() if self.model.motor else set(self.axes)
        self.referencing: dict[str, float] = {}
        self.homes = dict.fromkeys(self.axes, 0.0)
        self.accelerations = {name: dict.fromkeys(self.axes, 1.0) for name in ("ACC", "DEC")}
        #: Start mode of each wave generator; settings of the digital outputs, by line and number.
        self.start_modes = dict.fromkeys(self.generators, 0)
        self.trigger_settings: dict[tuple[int, int], str] = {}

    @property
    def interface(self) -> Mapping[str, str]:
        """Parameters of its interface by name; there is no serial line."""
        return {
            "RSBAUD": "0",
            "IPADR": f"{self.host}:{self.port}",
            "IPSTART": "0",
            "IPMASK": "255.255.255.255",
            "MACADR": "00-00-00-00-00-00",
        }

    def stop(self, axes: Sequence[str] | None = None) -> None:
        """Stop axes, by default all."""
        self.device.stop(axes)
        self.stops += 1

    # positions ------------------------------------------------------------------------------

    def position_range(self, axis: str) -> tuple[float, float]:
        """Return the reachable positions of an axis [m]; -1 to 1 m where they are unknown."""
        return self.axes[axis].limits.position or (-1.0, 1.0)

    def voltage_range(self, axis: str) -> tuple[float, float]:
        """Return the voltages of an axis [V]; both 0 where it has none."""
        return self.axes[axis].limits.voltage or (0.0, 0.0)

    def soft(self, axis: str, of_voltage: bool) -> Range:
        """Return the limits of clients for positions [m] or voltages [V] of an axis.

        Without such limits, these are the widest ones.
        """
        if of_voltage:
            return self.soft_voltages.get(axis, self.voltage_range(axis))
        return self.soft_positions.get(axis, self.position_range(axis))

    def has_switch(self, axis: str) -> bool:
        """Return whether an axis has a reference switch and limit switches."""
        return self.axes[axis].kind == "screw"

    def referenced(self, axis: str) -> bool:
        """Return whether an axis may move: it is referenced, or needs no reference."""
        ended = axis in self.referencing and not self.device.moving(axis)
        # a stopped reference move does not count
        if ended and self.device.target(axis) == self.referencing.pop(axis):
            self.referenced_axes.add(axis)
        return axis in self.referenced_axes or not self.reference_mode[axis]

    def require_ready(self, targets: Mapping[str, float], *, voltages: bool = False) -> None:
        """Refuse a motion of axes that accept none, or beyond the limits of clients."""
        limits = self.soft_voltages if voltages else self.soft_positions
        beyond = Refusal.VOLTAGE_OUT_OF_LIMITS if voltages else Refusal.OUT_OF_LIMITS
        offline = {self.outputs[name] for name, on in self.online.items() if not on}
        for axis, value in targets.items():
            # this error number also means "not referenced"
            require(self.referenced(axis), Refusal.SERVO_OFF)
            require(axis not in self.disabled, Refusal.SWITCHED_OFF)
            require(axis not in offline, Refusal.NOT_ABLE)
            low, high = limits.get(axis, (-math.inf, math.inf))
            inside = low <= value <= high or not math.isfinite(value)
            require(inside, beyond)

    # waveforms ------------------------------------------------------------------------------

    def wave_scales(self, axes: Sequence[str]) -> dict[str, tuple[float, float]]:
        """Return SI unit and offset in which axes that are about to start take their tables.

        Numbers of a table are um where they run as positions, and V where they run as voltages:
        under control, and of a screw, positions. Two axes cannot read one table as different
        quantities, or with different offsets.
        """
        scales = {axis: self._wave_scale(axis) for axis in axes}
        read: dict[int, tuple[float, float]] = {}
        for axis, scale in scales.items():
            table, feedforward = self.device.wave_choice(axis)
            require(table, Refusal.NO_WAVE)
            for number, its in ((table, scale), (feedforward, (1.0, 0.0))):
                if number:
                    require(self.device.tables.samples(number).size, Refusal.WAVE_NOT_DEFINED)
                    same = read.setdefault(number, its) == its
                    require(same, Refusal.WAVE_OUT_OF_RANGE)
        for axis in self.axes:
            if self.device.wave_running(axis):
                table, feedforward = self.device.wave_choice(axis)
                now = {feedforward: (1.0, 0.0), table: self.wave_units.get(axis, (1.0, 0.0))}
                same = all(read.get(number, its) == its for number, its in now.items())
                require(same, Refusal.WAVE_RUNNING)
        self.wave_units.update(scales)
        return scales

    def _wave_scale(self, axis: str) -> tuple[float, float]:
        position = self.axes[axis].kind == "screw" or self.device.servo_on(axis)
        return MICRO if position else 1.0, self.offsets[axis]

    # position control -----------------------------------------------------------------------

    def servo_draft(self, axis: str) -> Draft:
        """Return the settings of an axis's position control as a draft."""
        settings = self.device.servo(axis)
        draft, applied = self._drafts.get(axis, ({}, None))
        # another program may have changed the settings
        return dict(draft) if applied == settings else draft_of(settings)

    def apply_draft(self, axis: str, draft: Draft) -> None:
        """Change the settings of an axis's position control."""
        settings = drafted(draft, self.device.servo(axis))
        settings.sections(self.device.sample_rate_hz)
        self.device.set_servo_settings(axis, settings)
        self._drafts[axis] = draft, self.device.servo(axis)

    # time -----------------------------------------------------------------------------------

    def pass_time(self, seconds: float) -> Iterator[str]:
        """Let simulated time [s] pass in pieces, between which other clients are served."""
        left = seconds
        while left > 0.0:
            piece = min(left, 0.05)
            with self.pace.lock:
                self.pace.pass_time(piece)
            left -= piece
            yield ""
