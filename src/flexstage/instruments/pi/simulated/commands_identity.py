"""Commands about the controller itself: identity, parameters, reboot, state, digital outputs.

Numbers of parameters below 0x70000000 are those of PI's piezo controllers; additional ones of the
simulated controller have the group ``Twin``. The names contain the units, for clients.
"""

import re
from collections.abc import Callable, Sequence
from dataclasses import KW_ONLY, dataclass

from flexstage.base.version import __version__
from flexstage.instruments.pi.simulated.command import (
    GcsCommand,
    Reply,
    number,
    order,
    question,
    switch,
    unsigned,
    unsigned_or_hex,
    value_text,
)
from flexstage.instruments.pi.simulated.device import Refusal, require
from flexstage.instruments.pi.simulated.gcs_state import (
    MICRO,
    NOTCHES,
    ControllerState,
    Draft,
)
from flexstage.instruments.protocol import Capability

_KINDS = {int: "INT", str: "CHAR"}
#: Advances simulated time by the written value [s]; reads the elapsed time.
SIMULATED_TIME = 0x7F000001
Value = float | int | str


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
    get: Callable[[ControllerState, str], Value]
    """Function that returns the value, of state and item."""
    _: KW_ONLY
    set: Callable[[ControllerState, str, str], None] | None = None
    """Function that sets the value, of state, item and word."""
    key: tuple[str, int] | None = None
    """Key of its number in a draft of the position control."""

    @property
    def writable(self) -> bool:
        """Whether it can be set."""
        return self.set is not None or self.key is not None


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
            name = parameter.name
            if parameter.item == "axis":
                name = re.sub(r"\[um\b", "[mm" if state.model.unit == "mm" else "[um", name)
            kind = "FLOAT" if isinstance(value, float) else _KINDS[type(value)]
            words = (0 if parameter.writable else 9, len(items), kind, parameter.group, name)
            lines.append("\t".join((f"0x{identifier:08X}=", *(str(word) for word in words))))
    return [*lines, "end of help"]


def _serial_number(state: ControllerState) -> str:
    return state.device.identity.serial_number or "0"


def _feedforward(state: ControllerState, axis: str, word: str) -> None:
    table = unsigned(word)
    require(table <= state.device.tables.count, Refusal.UNKNOWN_WAVE_TABLE)
    able = Capability.FEEDFORWARD_TABLE in state.axes[axis].capabilities
    require(able, Refusal.NOT_ABLE)
    state.device.choose_wave(axis, state.device.wave_choice(axis)[0], table)


def _tuning(name: str, quantity: str, slot: int = 0, group: str = "Servo") -> Parameter:
    """Return a parameter of the position control."""
    key = quantity, slot
    return Parameter("servo", group, name, lambda s, axis: float(s.servo_draft(axis)[key]), key=key)


def _fixed(item: str, group: str, name: str, value: Value) -> Parameter:
    return Parameter(item, group, name, lambda *_: value)


_CORRECTION = ("Offset [um]", "Gain", "Second Order", "Third Order", "Fourth Order")
_NOTCHES = {
    "frequency": (0x08000100, "Notch Frequency {} [Hz], 0 for none"),
    "rejection": (0x08000200, "Notch Rejection {}: gain at the frequency"),
    "bandwidth": (0x08000300, "Notch Bandwidth {}: twice the damping ratio of the poles"),
}
#: The parameters by number, in ascending order, as they are listed.
PARAMETERS = {
    # the simulated sensors need no correction
    **{0x02000200 + 0x100 * power:
           _fixed("channel", "Sensor", f"Sensor Mech. Correction {power + 1}: {term}",
                  1.0 if power == 1 else 0.0)
       for power, term in enumerate(_CORRECTION)},
    0x05000000: _fixed("channel", "Sensor", "Digital Filter Type, 0 for none", 0),
    0x05000001: _fixed("channel", "Sensor", "Digital Filter Bandwidth [Hz]", 0.0),
    0x05000002: _fixed("channel", "Sensor", "Digital Filter Order", 0),
    # no analogue input can be the target
    0x06000500: Parameter("axis", "Axis", "ADC Channel For Target, 0 for none", lambda *_: 0,
                          set=lambda _, __, word: require(unsigned(word) == 0, Refusal.BAD_VALUE)),
    0x07000000: Parameter("axis", "Servo", "Range Limit min [um]",
                          lambda s, axis: s.position_range(axis)[0] / s.model.scale),
    0x07000001: Parameter("axis", "Servo", "Range Limit max [um]",
                          lambda s, axis: s.position_range(axis)[1] / s.model.scale),
    0x07000200: Parameter("axis", "Servo", "Servo Loop Slew-Rate [um/s]",
                          lambda s, axis: s.device.speed(axis) / s.model.scale,
                          set=lambda s, axis, word:
                          s.device.set_speed(axis, number(word) * s.model.scale)),
    0x07000300: _tuning("Servo Loop P-Term [V/um]", "proportional"),
    0x07000301: _tuning("Servo Loop I-Term [V/(um s)]", "integral"),
    0x07000600: Parameter("axis", "Axis", "Axis Identifier", lambda _, axis: axis),
    0x07000601: Parameter("axis", "Axis", "Axis Unit", lambda s, _: s.model.unit),
    0x07000900: Parameter("axis", "Servo", "On Target Tolerance [um]",
                          lambda s, axis: s.axes[axis].window / s.model.scale),
    0x07000901: Parameter("axis", "Servo", "Settling Time [s]",
                          lambda s, axis: s.axes[axis].settle),
    0x07000A00: Parameter("piezo", "Axis", "Low Voltage [V]",
                          lambda s, axis: s.voltage_range(axis)[0]),
    0x07000A01: Parameter("piezo", "Axis", "High Voltage [V]",
                          lambda s, axis: s.voltage_range(axis)[1]),
    **{base + slot: _tuning(text.format(slot + 1), quantity, slot)
       for quantity, (base, text) in _NOTCHES.items() for slot in range(NOTCHES)},
    0x0E000200: Parameter("system", "System", "Servo Update Time [s]",
                          lambda s, _: 1.0 / s.device.sample_rate_hz),
    0x0F000200: Parameter("axis", "Axis", "Stage Serial Number", lambda s, _: _serial_number(s)),
    0x13000004: Parameter("system", "Wave Generator", "Max Wave Points",
                          lambda s, _: s.device.tables.capacity),
    0x13000109: Parameter("system", "Wave Generator", "Wave Generator Table Rate",
                          lambda s, _: s.device.wave_divider,
                          set=lambda s, _, word: s.device.set_wave_rate_divider(unsigned(word))),
    0x1300010A: Parameter("system", "Wave Generator", "Number Of Waves",
                          lambda s, _: s.device.tables.count),
    0x16000000: Parameter("system", "Data Recorder", "Data Recorder Table Rate",
                          lambda s, _: s.device.recorder.divider,
                          set=lambda s, _, word: s.device.recorder.set_divider(unsigned(word))),
    0x16000200: Parameter("system", "Data Recorder", "Data Recorder Max Points",
                          lambda s, _: s.device.recorder.count * s.device.recorder.capacity),
    0x16000201: Parameter("system", "Data Recorder", "Data Recorder Points Per Table",
                          lambda s, _: s.device.recorder.capacity),
    0x16000300: Parameter("system", "Data Recorder", "Data Recorder Chan Number",
                          lambda s, _: s.recorder.tables,
                          set=lambda s, _, word: s.recorder.use(unsigned(word))),
    # set by SPA itself, after all other parameters
    SIMULATED_TIME: Parameter(
        "system", "Twin",
        "Simulated Time [s]: leads on by the seconds it is set to, where it runs fast",
        lambda s, _: float(s.device.now), set=lambda *_: None),
    0x7F000002: Parameter("system", "Twin",
                          "Simulated Time runs fast: 1, in step with real time: 0",
                          lambda s, _: int(s.pace.fast)),
    0x7F000003: Parameter("system", "Twin", "Drives Taken Out: 0 or 1",
                          lambda s, _: int(s.device.drives_out),
                          set=lambda s, _, word: s.device.remove_drives(switch(word))),
    0x7F000010: _tuning("Servo Loop Low-Pass Frequency [Hz], 0 for none", "lowpass", group="Twin"),
    0x7F000011: Parameter("axis", "Twin", "Feedforward Wave Table [V], 0 for none",
                          lambda s, axis: int(s.device.wave_choice(axis)[1]), set=_feedforward),
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
    0xFFFF0007: Parameter("system", "Firmware", "Firmware Name",
                          lambda s, _: s.device.identity.vendor),
    0xFFFF0008: _fixed("system", "Firmware", "Firmware Version", __version__),
    0xFFFF000D: _fixed("system", "Firmware", "Firmware Description", "simulated controller"),
    0xFFFF000E: _fixed("system", "Firmware", "Firmware Date", "none"),
    0xFFFF000F: Parameter("system", "Firmware", "Firmware Developer",
                          lambda s, _: s.device.identity.vendor),
}  # fmt: skip

#: Longest simulated time of one command [s].
_LONGEST = 3600.0


def identity_line(state: ControllerState) -> str:
    """Return the answer to ``*IDN?``: vendor, model, serial number and firmware.

    It contains the word ``simulated`` for a simulation, and for a controller type the name of the
    vendor, by which programs choose their driver.
    """
    identity = state.device.identity
    vendor, model = identity.vendor, state.model.name or identity.model
    if state.model.name:
        vendor = f"Simulated Physik Instrumente ({vendor})"
    elif identity.simulated and "simulated" not in f"{vendor} {model}":
        model = f"{model} (simulated)"
    fields = (vendor, model, _serial_number(state), identity.firmware or __version__)
    return ", ".join(field.replace(",", " ").replace("\n", " ") for field in fields)


def _versions(state: ControllerState, _: None) -> Reply:
    return [
        f"FW: {state.device.identity.firmware or __version__}",
        f"SIMULATION: flexstage {__version__}",
    ]


def _reboot(state: ControllerState, _: None) -> None:
    state.device.reboot()
    state.forget()


Rows = Sequence[tuple[str, ...]]


def _parameter_rows(state: ControllerState, rows: Rows) -> list[tuple[str, str, int]]:
    """Return the requested parameters: name in the answer, item and number.

    All parameters where none is requested.
    """
    if not rows:
        all_items = ((item, key) for key, p in PARAMETERS.items() for item in items_of(state, p))
        return [(f"{item} 0x{key:08X}", item, key) for item, key in all_items]
    return [(f"{item} {word}", *_item_and_key(state, item, word)) for item, word in rows]


def _item_and_key(state: ControllerState, item: str, word: str) -> tuple[str, int]:
    key = unsigned_or_hex(word)
    require(key in PARAMETERS, Refusal.UNKNOWN_PARAMETER)
    parameter = PARAMETERS[key]
    # clients use 0 or 1 as the item of the system
    item = "1" if parameter.item == "system" and item == "0" else item
    unknown = Refusal.UNKNOWN_CHANNEL if parameter.item == "channel" else Refusal.UNKNOWN
    require(item in items_of(state, parameter), unknown)
    return item, key


def delivered(state: ControllerState) -> dict[tuple[str, int], str]:
    """Return the texts of all parameters as delivered, by item and number."""
    return {
        (item, key): value_text(PARAMETERS[key].get(state, item))
        for _, item, key in _parameter_rows(state, ())
    }


def _read_parameters(state: ControllerState, rows: Rows) -> Reply:
    return [
        f"{called}={value_text(PARAMETERS[key].get(state, item))}"
        for called, item, key in _parameter_rows(state, rows)
    ]


def _read_delivered(state: ControllerState, rows: Rows) -> Reply:
    return [
        f"{called}={state.delivered[item, key]}"
        for called, item, key in _parameter_rows(state, rows)
    ]


def _set_parameters(state: ControllerState, rows: Rows) -> Reply:
    assignments = [(*_item_and_key(state, item, key), word) for item, key, word in rows]
    drafts: dict[str, Draft] = {}
    seconds = 0.0
    for item, key, word in assignments:
        parameter = PARAMETERS[key]
        require(parameter.writable, Refusal.READ_ONLY)
        if key == SIMULATED_TIME:
            seconds += number(word)
            require(0.0 <= seconds <= _LONGEST, Refusal.BAD_VALUE)
            require(state.pace.fast, Refusal.NOT_ABLE)
        elif parameter.key is not None:
            draft = drafts.setdefault(item, state.servo_draft(item))
            draft[parameter.key] = number(word)
    # the complete position control at once: intermediate settings might be unstable
    for axis, draft in drafts.items():
        state.apply_draft(axis, draft)
    for item, key, word in assignments:
        parameter = PARAMETERS[key]
        if parameter.set is not None:
            parameter.set(state, item, word)
    return state.pass_time(seconds) if seconds else None


def _axis_names(state: ControllerState, words: Sequence[str]) -> Reply:
    require(len(words) <= 1, Refusal.NUMBER_OF_PARAMETERS)
    require(words in ([], ["ALL"]), Refusal.SYNTAX)
    return ["".join(state.axes)] if state.model.one_line else list(state.axes)


#: Bits of the status register.
_SERVO, _MOVING, _ON_TARGET = 1 << 12, 1 << 13, 1 << 15
#: Largest number of the converter of an input, 18 bits with sign.
_DIGITS = (1 << 17) - 1
#: Full scale of an input without a range [um, or urad].
_FULL_SCALE = 100.0
#: Range of an axis's sensor over that of its positions; a stage at rest is below them.
_SENSOR_SPAN = 1.5
#: Distance from the end of the voltage range, over the range, that counts as the end.
_AT_END = 1e-6


def _bits(state: ControllerState, axis: str) -> int:
    device = state.device
    return (
        _SERVO * device.servo_on(axis)
        + _MOVING * device.moving(axis)
        + _ON_TARGET * device.on_target(axis)
    )


def status_register(state: ControllerState) -> str:
    """Return the answer to ``#4``."""
    return "0x" + "".join(f"{_bits(state, axis):04X}" for axis in state.axes)


def _registers(state: ControllerState, requested: Sequence[tuple[str, int]]) -> Reply:
    rows = requested or [(axis, 1) for axis in state.axes]
    return [f"{axis} {register}=0x{_bits(state, axis):04X}" for axis, register in rows]


def _overflow(state: ControllerState, axis: str) -> bool:
    """Return whether the voltage of the position control is at an end of its range."""
    if state.axes[axis].kind != "piezo" or not state.device.servo_on(axis):
        return False
    low, high = state.voltage_range(axis)
    slack = _AT_END * (high - low)
    return not low + slack < state.device.voltage(axis) < high - slack


def _normalized(state: ControllerState, channel: str) -> float:
    """Return a reading in per cent of the largest one, 0 at mid-range."""
    reading = state.device.channel(int(channel)) / MICRO
    axes = list(state.axes)
    if int(channel) > len(axes):
        return 100.0 * reading / _FULL_SCALE
    low, high = (end / MICRO for end in state.position_range(axes[int(channel) - 1]))
    return 100.0 * (2.0 * reading - high - low) / (_SENSOR_SPAN * (high - low))


def _digits(state: ControllerState, channel: str) -> int:
    return max(-_DIGITS, min(_DIGITS, round(_DIGITS * _normalized(state, channel) / 100.0)))


def _set_line(state: ControllerState, settings: Sequence[tuple[int, int, str]]) -> None:
    """Store settings of digital outputs, which have no connection."""
    state.trigger_settings.update({(line, key): word for line, key, word in settings})


def _settings(state: ControllerState, requested: Sequence[tuple[int, int]]) -> Reply:
    known = requested or sorted(state.trigger_settings)
    return [f"{n} {key}={state.trigger_settings.get((n, key), '0')}" for n, key in known] or ["0"]


def _unseen(_: ControllerState, __: object) -> None:
    """Do nothing, since no output and no question depend on this."""


_AXES = "[{<AxisID>}]"
_PARAMETERS = "[{<ItemID> <PamID>}]"
#: Commands about the controller.
IDENTITY = (
    question("*IDN?", "", "Get Device Identification", lambda s, _: identity_line(s)),
    question("AOS?", _AXES, "Get Analog Input Offset", lambda *_: 0.0),
    question("CST?", _AXES, "Get Stage Of Axis", lambda s, a: s.axes[a].stage_axis),
    question("CSV?", "", "Get Current Syntax Version", lambda s, _: s.model.syntax),
    order("CTO", "{<TrigOutID> <CTOPam> <Value>}", "Set Configuration Of Trigger Output",
          _set_line),
    GcsCommand("CTO?", "[{<TrigOutID> <CTOPam>}]", "Get Configuration Of Trigger Output",
               _settings),
    GcsCommand("HPA?", "", "Get List Of Available Parameters", lambda s, _: listing(s)),
    question("IDN?", "", "Get Device Identification", lambda s, _: identity_line(s)),
    question("IFC?", "[{<InterfacePam>}]", "Get Interface Parameters",
             lambda s, name: s.interface[name]),
    question("LIM?", _AXES, "Indicate Limit Switches", lambda s, a: s.has_switch(a)),
    question("OVF?", _AXES, "Get Overflow State", _overflow),
    order("RBT", "", "Reboot System", _reboot, moves=True),
    GcsCommand("SAI?", "[ALL]", "Get Axis Identifiers", _axis_names, free=True),
    GcsCommand("SEP?", _PARAMETERS, "Get Parameters As Delivered", _read_delivered),
    GcsCommand("SPA", "{<ItemID> <PamID> <PamValue>}", "Set Volatile Memory Parameters",
               _set_parameters, changes=True),
    GcsCommand("SPA?", _PARAMETERS, "Get Volatile Memory Parameters", _read_parameters),
    GcsCommand("SRG?", "[{<AxisID> <RegisterID>}]", "Query Status Register Value", _registers,
               poll=True),
    question("SSN?", "", "Get Device Serial Number",
             lambda s, _: _serial_number(s)),
    question("TAD?", "[{<InputID>}]", "Get ADC Value Of Input Signal", _digits),
    question("TNS?", "[{<InputID>}]", "Get Normalized Input Signal Value", _normalized),
    question("TPC?", "", "Get Number Of Output Channels", lambda s, _: len(s.outputs)),
    question("TRS?", _AXES, "Indicate Reference Switch", lambda s, a: s.has_switch(a)),
    question("TSC?", "", "Get Number Of Input Channels", lambda s, _: len(s.channels)),
    order("TWC", "", "Clear All Wave Related Triggers", _unseen),
    order("TWS", "{<TrigOutID> <PointNumber> <Switch>}",
          "Set Trigger Line Actions To Waveform Points", _unseen),
    GcsCommand("VER?", "", "Get Versions", _versions),
)  # fmt: skip
