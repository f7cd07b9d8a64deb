"""Parameters of the simulated controller, read by ``SPA?`` and set by ``SPA``.

Numbers below 0x70000000 are those of PI's piezo controllers; additional ones of the simulated
controller have the group ``Twin``. The names contain the units, for clients.
"""

import re
from collections.abc import Callable, Sequence
from dataclasses import KW_ONLY, dataclass

from flexstage.base.version import __version__
from flexstage.instruments.pi.simulated.command import number, switch, unsigned
from flexstage.instruments.pi.simulated.device import Refusal, require
from flexstage.instruments.pi.simulated.gcs_state import NOTCHES, ControllerState, ServoDraft
from flexstage.instruments.protocol import Capability

_KINDS = {int: "INT", str: "CHAR"}
#: Advances simulated time by the written value [s]; reads the elapsed time.
SIMULATED_TIME = 0x7F000001
Value = float | int | str
Get = Callable[[ControllerState, str], Value]
Set = Callable[[ControllerState, str, str], None]
Edit = Callable[[ServoDraft, float], None]


@dataclass(frozen=True, slots=True)
class Parameter:
    """A parameter."""

    item: str
    """Kind of its items; ``piezo``: an axis with a voltage; ``servo``: an axis with adjustable
    position control.
    """
    group: str
    """Group in the list."""
    name: str
    """Name in the list."""
    get: Get
    """Function that returns the value, of state and item."""
    _: KW_ONLY
    set: Set | None = None
    """Function that sets the value, of state, item and word."""
    edit: Edit | None = None
    """Function that sets a number in a draft of the position control."""

    @property
    def writable(self) -> bool:
        """Whether it can be set."""
        return self.set is not None or self.edit is not None


def items_of(state: ControllerState, parameter: Parameter) -> Sequence[str]:
    """Return the axes or channels that have a parameter, or ``"1"`` for the system."""
    if parameter.item == "system":
        return ("1",)
    if parameter.item == "channel":
        return tuple(state.channels)
    if parameter.item == "piezo":
        return tuple(state.outputs.values())
    return tuple(
        name
        for name, axis in state.axes.items()
        if parameter.item == "axis" or Capability.SERVO_TUNING in axis.capabilities
    )


def listing(state: ControllerState) -> list[str]:
    """Return the answer to ``HPA?``: number, write level, items, type, group, name."""
    lines = ["The following parameters are valid:"]
    for identifier, parameter in PARAMETERS.items():
        items = items_of(state, parameter)
        if items:
            value = parameter.get(state, items[0])
            kind = "FLOAT" if isinstance(value, float) else _KINDS[type(value)]
            name = parameter.name
            if parameter.item == "axis":
                name = re.sub(r"\[um\b", "[mm" if state.model.unit == "mm" else "[um", name)
            words = (0 if parameter.writable else 9, len(items), kind, parameter.group, name)
            lines.append("\t".join((f"0x{identifier:08X}=", *(str(word) for word in words))))
    return [*lines, "end of help"]


def _speed(state: ControllerState, axis: str, word: str) -> None:
    state.device.set_speed(axis, number(word) * state.model.scale)


def _wave_rate(state: ControllerState, _: str, word: str) -> None:
    state.device.set_wave_rate_divider(unsigned(word))


def _record_rate(state: ControllerState, _: str, word: str) -> None:
    state.device.recorder.set_divider(unsigned(word))


def _record_tables(state: ControllerState, _: str, word: str) -> None:
    state.recorder.use(unsigned(word))


def _no_analogue_input(_: ControllerState, __: str, word: str) -> None:
    """Accept only 0, since no analogue input can be the target."""
    require(unsigned(word) == 0, Refusal.BAD_VALUE)


def _drives(state: ControllerState, _: str, word: str) -> None:
    state.device.remove_drives(switch(word))


def _feedforward(state: ControllerState, axis: str, word: str) -> None:
    table = unsigned(word)
    require(table <= state.device.wave_tables, Refusal.UNKNOWN_WAVE_TABLE)
    able = Capability.FEEDFORWARD_TABLE in state.axes[axis].capabilities
    require(able, Refusal.NOT_ABLE)
    state.device.choose_wave(axis, state.device.wave_choice(axis)[0], table)


def _notch(quantity: str, slot: int) -> tuple[Get, Edit]:
    def get(state: ControllerState, axis: str) -> Value:
        return float(getattr(state.servo_draft(axis), quantity)[slot])

    def edit(draft: ServoDraft, value: float) -> None:
        getattr(draft, quantity)[slot] = value

    return get, edit


def _gain(quantity: str) -> tuple[Get, Edit]:
    def get(state: ControllerState, axis: str) -> Value:
        return float(getattr(state.servo_draft(axis), quantity))

    def edit(draft: ServoDraft, value: float) -> None:
        setattr(draft, quantity, value)

    return get, edit


def _serial_number(state: ControllerState, _: str) -> str:
    return state.device.identity.serial_number or "0"


def _vendor(state: ControllerState, _: str) -> str:
    return state.device.identity.vendor


def _facts() -> dict[int, Parameter]:
    """Return the read-only parameters; the simulated sensors need no correction."""
    parameters: dict[int, Parameter] = {}

    def add(identifier: int, item: str, group: str, name: str, get: Get) -> None:
        parameters[identifier] = Parameter(item, group, name, get)

    terms = ("Offset [um]", "Gain", "Second Order", "Third Order", "Fourth Order")
    for order, term in enumerate(terms):
        value = 1.0 if order == 1 else 0.0
        name = f"Sensor Mech. Correction {order + 1}: {term}"
        add(0x02000200 + 0x100 * order, "channel", "Sensor", name, lambda _, __, v=value: v)
    add(0x05000000, "channel", "Sensor", "Digital Filter Type, 0 for none", lambda _, __: 0)
    add(0x05000001, "channel", "Sensor", "Digital Filter Bandwidth [Hz]", lambda _, __: 0.0)
    add(0x05000002, "channel", "Sensor", "Digital Filter Order", lambda _, __: 0)
    window = "On Target Tolerance [um]"
    add(0x07000900, "axis", "Servo", window, lambda s, axis: s.axes[axis].window / s.model.scale)
    add(0x07000901, "axis", "Servo", "Settling Time [s]", lambda s, axis: s.axes[axis].settle)
    add(0x07000A00, "piezo", "Axis", "Low Voltage [V]", lambda s, axis: s.voltage_range(axis)[0])
    add(0x07000A01, "piezo", "Axis", "High Voltage [V]", lambda s, axis: s.voltage_range(axis)[1])
    add(0x0F000200, "axis", "Axis", "Stage Serial Number", _serial_number)
    add(0xFFFF0007, "system", "Firmware", "Firmware Name", _vendor)
    add(0xFFFF0008, "system", "Firmware", "Firmware Version", lambda _, __: __version__)
    add(0xFFFF000D, "system", "Firmware", "Firmware Description", lambda *_: "simulated controller")
    add(0xFFFF000E, "system", "Firmware", "Firmware Date", lambda *_: "none")
    add(0xFFFF000F, "system", "Firmware", "Firmware Developer", _vendor)
    return parameters


def _servo_parameters() -> dict[int, Parameter]:
    parameters: dict[int, Parameter] = {}

    def add(identifier: int, group: str, name: str, both: tuple[Get, Edit]) -> None:
        get, edit = both
        parameters[identifier] = Parameter("servo", group, name, get, edit=edit)

    add(0x07000300, "Servo", "Servo Loop P-Term [V/um]", _gain("proportional"))
    add(0x07000301, "Servo", "Servo Loop I-Term [V/(um s)]", _gain("integral"))
    texts = {
        "frequency": (0x08000100, "Notch Frequency {} [Hz], 0 for none"),
        "rejection": (0x08000200, "Notch Rejection {}: gain at the frequency"),
        "bandwidth": (0x08000300, "Notch Bandwidth {}: twice the damping ratio of the poles"),
    }
    for quantity, (base, text) in texts.items():
        for slot in range(NOTCHES):
            add(base + slot, "Servo", text.format(slot + 1), _notch(quantity, slot))
    add(0x7F000010, "Twin", "Servo Loop Low-Pass Frequency [Hz], 0 for none", _gain("lowpass"))
    return parameters


_PLAIN = {
    0x07000000: Parameter("axis", "Servo", "Range Limit min [um]",
                          lambda s, axis: s.position_range(axis)[0] / s.model.scale),
    0x07000001: Parameter("axis", "Servo", "Range Limit max [um]",
                          lambda s, axis: s.position_range(axis)[1] / s.model.scale),
    0x07000200: Parameter("axis", "Servo", "Servo Loop Slew-Rate [um/s]",
                          lambda s, axis: s.device.speed(axis) / s.model.scale, set=_speed),
    0x07000600: Parameter("axis", "Axis", "Axis Identifier", lambda _, axis: axis),
    0x07000601: Parameter("axis", "Axis", "Axis Unit", lambda s, _: s.model.unit),
    0x0E000200: Parameter("system", "System", "Servo Update Time [s]",
                          lambda s, _: 1.0 / s.device.sample_rate_hz),
    0x13000004: Parameter("system", "Wave Generator", "Max Wave Points",
                          lambda s, _: int(s.device.wave_capacity)),
    0x13000109: Parameter("system", "Wave Generator", "Wave Generator Table Rate",
                          lambda s, _: int(s.device.wave_rate_divider()), set=_wave_rate),
    0x1300010A: Parameter("system", "Wave Generator", "Number Of Waves",
                          lambda s, _: int(s.device.wave_tables)),
    0x16000000: Parameter("system", "Data Recorder", "Data Recorder Table Rate",
                          lambda s, _: int(s.device.recorder.divider), set=_record_rate),
    0x16000200: Parameter("system", "Data Recorder", "Data Recorder Max Points",
                          lambda s, _: int(s.device.recorder.count * s.device.recorder.capacity)),
    0x16000201: Parameter("system", "Data Recorder", "Data Recorder Points Per Table",
                          lambda s, _: int(s.device.recorder.capacity)),
    0x16000300: Parameter("system", "Data Recorder", "Data Recorder Chan Number",
                          lambda s, _: s.recorder.tables, set=_record_tables),
    # set by SPA itself, after all other parameters
    SIMULATED_TIME: Parameter(
        "system", "Twin",
        "Simulated Time [s]: leads on by the seconds it is set to, where it runs fast",
        lambda s, _: float(s.device.now), set=lambda _, __, ___: None),
    0x7F000002: Parameter("system", "Twin",
                          "Simulated Time runs fast: 1, in step with real time: 0",
                          lambda s, _: int(s.pace.fast)),
    0x7F000003: Parameter("system", "Twin", "Drives Taken Out: 0 or 1",
                          lambda s, _: int(s.device.drives_removed()), set=_drives),
    0x7F000011: Parameter("axis", "Twin", "Feedforward Wave Table [V], 0 for none",
                          lambda s, axis: int(s.device.wave_choice(axis)[1]),
                          set=_feedforward),
    0x7F000012: Parameter("axis", "Twin", "Axis Of The Stage",
                          lambda s, axis: s.axes[axis].stage_axis),
    0x7F000013: Parameter("axis", "Twin",
                          "Largest Slew-Rate Of The Voltage [V/s], 0 for none",
                          lambda s, axis: float(s.axes[axis].limits.slew or 0.0)),
    0x7F000014: Parameter("axis", "Twin", "Largest Speed [um/s], 0 for none",
                          lambda s, axis: float(s.axes[axis].limits.speed or 0.0) / s.model.scale),
    0x7F000020: Parameter("channel", "Twin", "Channel Name",
                          lambda s, channel: s.channels[channel].name),
    0x7F000021: Parameter("channel", "Twin", "Channel Unit",
                          lambda s, c: "um" if s.channels[c].unit == "m" else "urad"),
    0x06000500: Parameter("axis", "Axis", "ADC Channel For Target, 0 for none",
                          lambda _, __: 0, set=_no_analogue_input),
}  # fmt: skip
#: The parameters by number, in ascending order.
PARAMETERS: dict[int, Parameter] = dict(
    sorted({**_PLAIN, **_facts(), **_servo_parameters()}.items())
)
