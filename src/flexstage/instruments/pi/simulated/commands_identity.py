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

#: Longest simulated time that one command leads on by [s].
_LONGEST = 3600.0


def identity_line(state: ControllerState) -> str:
    """Return what ``*IDN?`` answers: vendor, model, serial number and firmware.

    Of a simulation the word ``simulated`` is part. Where it answers as a model the vendor's name is
    part, by which drivers choose.
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
    """Return how parameters are called in the answer, as they were asked for, item and number.

    All of them where none is asked for.
    """
    if not rows:
        all_items = ((item, key) for key, p in PARAMETERS.items() for item in items_of(state, p))
        return [(f"{item} 0x{key:08X}", item, key) for item, key in all_items]
    return [(f"{item} {word}", *_item_and_key(state, item, word)) for item, word in rows]


def _item_and_key(state: ControllerState, item: str, word: str) -> tuple[str, int]:
    key = unsigned_or_hex(word)
    require(key in PARAMETERS, Refusal.UNKNOWN_PARAMETER)
    parameter = PARAMETERS[key]
    # the system is item 0 or 1, to different clients
    item = "1" if parameter.item == "system" and item == "0" else item
    unknown = Refusal.UNKNOWN_CHANNEL if parameter.item == "channel" else Refusal.UNKNOWN
    require(item in items_of(state, parameter), unknown)
    return item, key


def delivered(state: ControllerState) -> dict[tuple[str, int], str]:
    """Return the values of all parameters, which the controller keeps as those of delivery.

    Texts by item and number.
    """
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
    # all of the position control at once: between two numbers it might not be stable
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
#: What an input that has no range of its own reads at most [um, or urad].
_FULL_SCALE = 100.0
#: Range of an axis's sensor over that of its positions; a stage at rest is below them.
_SENSOR_SPAN = 1.5
#: Part of the range of the voltage that is no way to its end.
_AT_END = 1e-6


def _bits(state: ControllerState, axis: str) -> int:
    device = state.device
    return (
        _SERVO * device.servo_on(axis)
        + _MOVING * device.moving(axis)
        + _ON_TARGET * device.on_target(axis)
    )


def status_register(state: ControllerState) -> str:
    """Return what ``#4`` answers."""
    return "0x" + "".join(f"{_bits(state, axis):04X}" for axis in state.axes)


def _registers(state: ControllerState, requested: Sequence[tuple[str, int]]) -> Reply:
    rows = requested or [(axis, 1) for axis in state.axes]
    return [f"{axis} {register}=0x{_bits(state, axis):04X}" for axis, register in rows]


def _overflow(state: ControllerState, axis: str) -> bool:
    """Say whether position control asks for more voltage than there is."""
    if state.axes[axis].kind != "piezo" or not state.device.servo_on(axis):
        return False
    low, high = state.voltage_range(axis)
    slack = _AT_END * (high - low)
    return not low + slack < state.device.voltage(axis) < high - slack


def _normalized(state: ControllerState, channel: str) -> float:
    """Return a reading as a part of the largest one [%], 0 in the middle of its range."""
    reading = state.device.channel(int(channel)) / MICRO
    axes = list(state.axes)
    if int(channel) > len(axes):
        return 100.0 * reading / _FULL_SCALE
    low, high = (end / MICRO for end in state.position_range(axes[int(channel) - 1]))
    return 100.0 * (2.0 * reading - high - low) / (_SENSOR_SPAN * (high - low))


def _digits(state: ControllerState, channel: str) -> int:
    return max(-_DIGITS, min(_DIGITS, round(_DIGITS * _normalized(state, channel) / 100.0)))


def _set_line(state: ControllerState, settings: Sequence[tuple[int, int, str]]) -> None:
    """Keep settings of digital outputs, which nothing is connected to."""
    state.trigger_settings.update({(line, key): word for line, key, word in settings})


def _settings(state: ControllerState, requested: Sequence[tuple[int, int]]) -> Reply:
    known = requested or sorted(state.trigger_settings)
    return [f"{n} {key}={state.trigger_settings.get((n, key), '0')}" for n, key in known] or ["0"]


def _unseen(_: ControllerState, __: object) -> None:
    """Do nothing: no output shows it, and no command asks for it."""


_AXES = "[{<AxisID>}]"
_PARAMETERS = "[{<ItemID> <PamID>}]"
#: Commands about the controller; ``HLP?`` is made from the list of all of them.
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
