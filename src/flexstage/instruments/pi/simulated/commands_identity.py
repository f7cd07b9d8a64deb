"""Commands about the controller itself: identity, parameters, reboot, state, digital outputs."""

from collections.abc import Sequence

from flexstage.base.version import __version__
from flexstage.instruments.pi.simulated.command import (
    GcsCommand,
    Reply,
    number,
    order,
    question,
    unsigned_or_hex,
    value_text,
)
from flexstage.instruments.pi.simulated.device import Refusal, require
from flexstage.instruments.pi.simulated.gcs_state import MICRO, ControllerState, ServoDraft
from flexstage.instruments.pi.simulated.parameters import (
    PARAMETERS,
    SIMULATED_TIME,
    items_of,
    listing,
)

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
    fields = (vendor, model, identity.serial_number or "0", identity.firmware or __version__)
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
    drafts: dict[str, ServoDraft] = {}
    seconds = 0.0
    for item, key, word in assignments:
        parameter = PARAMETERS[key]
        require(parameter.writable, Refusal.READ_ONLY)
        if key == SIMULATED_TIME:
            seconds += number(word)
            require(0.0 <= seconds <= _LONGEST, Refusal.BAD_VALUE)
            require(state.pace.fast, Refusal.NOT_ABLE)
        elif parameter.edit is not None:
            if item not in drafts:
                drafts[item] = state.servo_draft(item)
            parameter.edit(drafts[item], number(word))
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
             lambda s, _: s.device.identity.serial_number or "0"),
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
