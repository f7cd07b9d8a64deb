"""Commands about the controller itself: identity, help, errors, parameters, reboot, and state."""

from collections.abc import Iterable, Sequence

from flexstage import __version__
from flexstage.instruments.pi.simulated import errors_gcs as code
from flexstage.instruments.pi.simulated.command import (
    Client,
    GcsCommand,
    Reply,
    chosen,
    fact,
    nothing,
    number,
    pairs,
    printed,
    unsigned,
    unsigned_or_hex,
)
from flexstage.instruments.pi.simulated.commands_motion import of_axes, of_inputs
from flexstage.instruments.pi.simulated.errors_gcs import GcsError
from flexstage.instruments.pi.simulated.gcs_state import MICRO, ControllerState, ServoDraft
from flexstage.instruments.pi.simulated.parameters import (
    PARAMETERS,
    SIMULATED_TIME,
    items_of,
    listing,
    value_text,
)

#: Longest simulated time that one command leads on by [s].
_LONGEST = 3600.0
#: Characters that are commands of their own, as they are listed.
_CHARACTERS = (
    "#4 Request Status Register",
    "#5 Request Motion Status",
    "#7 Request Controller Ready Status",
    "#9 Get Wave Generator Status",
    "#24 Stop All Axes",
)


def identity_line(state: ControllerState) -> str:
    """Return what ``*IDN?`` answers: vendor, model, serial number and firmware.

    Of a simulation the word ``simulated`` is part. Where it answers as a model the vendor's name is
    part, by which drivers choose.
    """
    said = state.device.identity
    vendor, model = said.vendor, state.model.name or said.model
    if state.model.name:
        vendor = f"Simulated Physik Instrumente ({vendor})"
    elif said.simulated and "simulated" not in f"{vendor} {model}":
        model = f"{model} (simulated)"
    fields = (vendor, model, said.serial_number or "0", said.firmware or __version__)
    return ", ".join(field.replace(",", " ").replace("\n", " ") for field in fields)


def _versions(state: ControllerState, _: Client, words: Sequence[str]) -> Reply:
    nothing(words)
    return [
        f"FW: {state.device.identity.firmware or __version__}",
        f"SIMULATION: flexstage {__version__}",
    ]


def help_lines(commands: Iterable[GcsCommand]) -> list[str]:
    """Return what ``HLP?`` answers."""
    listed = [f"{c.name} {c.arguments} {c.text}".replace("  ", " ") for c in commands]
    return ["The following commands are valid:", *_CHARACTERS, *listed, "end of help"]


def _parameters(state: ControllerState, _: Client, words: Sequence[str]) -> Reply:
    nothing(words)
    return listing(state)


def _read_error(_: ControllerState, client: Client, words: Sequence[str]) -> Reply:
    nothing(words)
    number_of_error, client.error = client.error, code.NO_ERROR
    return [str(number_of_error)]


def _level(_: ControllerState, client: Client, words: Sequence[str]) -> Reply:
    if len(words) not in (1, 2):
        raise GcsError(code.NUMBER_OF_PARAMETERS)
    level = unsigned(words[0])
    if level > 1:
        raise GcsError(code.OUT_OF_RANGE)
    if level == 1 and words[1:] != ["advanced"]:
        raise GcsError(code.WRONG_PASSWORD)
    client.level = level
    return None


def _read_level(_: ControllerState, client: Client, words: Sequence[str]) -> Reply:
    nothing(words)
    return [str(client.level)]


def _reboot(state: ControllerState, _: Client, words: Sequence[str]) -> Reply:
    nothing(words)
    state.device.reboot()
    state.forget()
    return None


def _asked(state: ControllerState, words: Sequence[str]) -> list[tuple[str, str, int]]:
    """Return how parameters are called in the answer, as they were asked for, item and number.

    All of them where none is asked for.
    """
    if not words:
        every = ((item, key) for key, p in PARAMETERS.items() for item in items_of(state, p))
        return [(f"{item} 0x{key:08X}", item, key) for item, key in every]
    if len(words) % 2:
        raise GcsError(code.NUMBER_OF_PARAMETERS)
    given = zip(words[::2], words[1::2], strict=True)
    return [(f"{item} {word}", *_found(state, item, word)) for item, word in given]


def _found(state: ControllerState, item: str, word: str) -> tuple[str, int]:
    key = unsigned_or_hex(word)
    parameter = PARAMETERS.get(key)
    if parameter is None:
        raise GcsError(code.UNKNOWN_PARAMETER)
    items = items_of(state, parameter)
    # the system is item 0 or 1, to different clients
    item = "1" if parameter.item == "system" and item == "0" else item
    if item not in items:
        channel = parameter.item == "channel"
        raise GcsError(code.UNKNOWN_CHANNEL if channel else code.UNKNOWN_AXIS)
    return item, key


def delivered(state: ControllerState) -> dict[tuple[str, int], str]:
    """Return the values of all parameters, which the controller keeps as those of delivery.

    Texts by item and number.
    """
    return {
        (item, key): value_text(PARAMETERS[key].get(state, item))
        for _, item, key in _asked(state, ())
    }


def _read_parameters(state: ControllerState, _: Client, words: Sequence[str]) -> Reply:
    return [
        f"{called}={value_text(PARAMETERS[key].get(state, item))}"
        for called, item, key in _asked(state, words)
    ]


def _read_delivered(state: ControllerState, _: Client, words: Sequence[str]) -> Reply:
    return [f"{called}={state.delivered[item, key]}" for called, item, key in _asked(state, words)]


def _set_parameters(state: ControllerState, _: Client, words: Sequence[str]) -> Reply:
    if not words or len(words) % 3:
        raise GcsError(code.NUMBER_OF_PARAMETERS)
    given = [
        (*_found(state, words[i], words[i + 1]), words[i + 2]) for i in range(0, len(words), 3)
    ]
    drafts: dict[str, ServoDraft] = {}
    seconds = 0.0
    for item, key, word in given:
        parameter = PARAMETERS[key]
        if parameter.set is None and parameter.edit is None:
            raise GcsError(code.READ_ONLY)
        if key == SIMULATED_TIME:
            seconds += number(word)
            if not 0.0 <= seconds <= _LONGEST:
                raise GcsError(code.OUT_OF_RANGE)
            if not state.pace.fast:
                raise GcsError(code.NOT_POSSIBLE)
        elif parameter.edit is not None:
            if item not in drafts:
                drafts[item] = state.servo_draft(item)
            parameter.edit(drafts[item], number(word))
    # all of the position control at once: between two numbers it might not be stable
    for axis, draft in drafts.items():
        state.apply_draft(axis, draft)
    for item, key, word in given:
        parameter = PARAMETERS[key]
        if parameter.set is not None:
            parameter.set(state, item, word)
    return state.pass_time(seconds) if seconds else None


def _axis_names(state: ControllerState, _: Client, words: Sequence[str]) -> Reply:
    if words not in ([], ["ALL"]):
        raise GcsError(code.NUMBER_OF_PARAMETERS if len(words) > 1 else code.SYNTAX)
    return ["".join(state.axes)] if state.model.one_line else list(state.axes)


def _name_axes(state: ControllerState, _: Client, words: Sequence[str]) -> Reply:
    given = dict(pairs(words, state.axes, code.UNKNOWN_AXIS))
    if not all(name.isalnum() and len(name) <= 8 for name in given.values()):
        raise GcsError(code.BAD_AXIS_NAME)
    after = [given.get(name, name) for name in state.device.axes]
    if len(set(after)) < len(after):
        raise GcsError(code.AXIS_TWICE)
    state.name_axes(given)
    state.delivered = {
        (given.get(item, item) if PARAMETERS[key].item not in ("system", "channel") else item, key):
        text for (item, key), text in state.delivered.items()
    }  # fmt: skip
    return None


def _stage_names(state: ControllerState, _: Client, words: Sequence[str]) -> Reply:
    axes = chosen(words, state.axes, code.UNKNOWN_AXIS)
    return [f"{name}={axis.stage_axis}" for name, axis in axes]


#: Commands about the controller; ``HLP?`` is made from the list of all of them.
IDENTITY = (
    GcsCommand("*IDN?", "", "Get Device Identification", fact(identity_line)),
    GcsCommand("CCL", "<Level> [<PSWD>]", "Set Command Level", _level),
    GcsCommand("CCL?", "", "Get Command Level", _read_level),
    GcsCommand("CST?", "[{<AxisID>}]", "Get Stage Of Axis", _stage_names),
    GcsCommand("CSV?", "", "Get Current Syntax Version", fact(lambda s: s.model.syntax)),
    GcsCommand("ERR?", "", "Get Error Number", _read_error),
    GcsCommand("HPA?", "", "Get List Of Available Parameters", _parameters),
    GcsCommand("IDN?", "", "Get Device Identification", fact(identity_line)),
    GcsCommand("RBT", "", "Reboot System", _reboot, changes=True, moves=True),
    GcsCommand("SAI", "{<AxisID> <NewIdentifier>}", "Set Axis Identifiers", _name_axes,
               changes=True),
    GcsCommand("SAI?", "[ALL]", "Get Axis Identifiers", _axis_names),
    GcsCommand("SEP?", "[{<ItemID> <PamID>}]", "Get Parameters As Delivered", _read_delivered),
    GcsCommand("SPA", "{<ItemID> <PamID> <PamValue>}", "Set Volatile Memory Parameters",
               _set_parameters, changes=True),
    GcsCommand("SPA?", "[{<ItemID> <PamID>}]", "Get Volatile Memory Parameters", _read_parameters),
    GcsCommand("TPC?", "", "Get Number Of Output Channels", fact(lambda s: str(len(s.outputs)))),
    GcsCommand("TSC?", "", "Get Number Of Input Channels", fact(lambda s: str(len(s.channels)))),
    GcsCommand("VER?", "", "Get Versions", _versions),
)  # fmt: skip
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


def _registers(state: ControllerState, _: Client, words: Sequence[str]) -> Reply:
    if len(words) % 2:
        raise GcsError(code.NUMBER_OF_PARAMETERS)
    given = list(zip(words[::2], words[1::2], strict=True)) or [(a, "1") for a in state.axes]
    for axis, register in given:
        if axis not in state.axes:
            raise GcsError(code.UNKNOWN_AXIS)
        if unsigned(register) != 1:
            raise GcsError(code.OUT_OF_RANGE)
    return [f"{axis} {register}=0x{_bits(state, axis):04X}" for axis, register in given]


def _overflow(state: ControllerState, axis: str) -> str:
    """Say whether position control asks for more voltage than there is."""
    if state.axes[axis].kind != "piezo" or not state.device.servo_on(axis):
        return "0"
    low, high = state.voltage_range(axis)
    slack = _AT_END * (high - low)
    return str(int(not low + slack < state.device.voltage(axis) < high - slack))


def _normalized(state: ControllerState, channel: int) -> float:
    """Return a reading as a part of the largest one [%], 0 in the middle of its range."""
    reading = state.device.channel(channel) / MICRO
    axes = list(state.axes)
    if channel > len(axes):
        return 100.0 * reading / _FULL_SCALE
    low, high = (end / MICRO for end in state.position_range(axes[channel - 1]))
    return 100.0 * (2.0 * reading - high - low) / (_SENSOR_SPAN * (high - low))


def _digits(state: ControllerState, channel: int) -> str:
    return str(max(-_DIGITS, min(_DIGITS, round(_DIGITS * _normalized(state, channel) / 100.0))))


def _interfaces(state: ControllerState, _: Client, words: Sequence[str]) -> Reply:
    facts = {
        "RSBAUD": "0",  # no serial line
        "IPADR": f"{state.host}:{state.port}",
        "IPSTART": "0",
        "IPMASK": "255.255.255.255",
        "MACADR": "00-00-00-00-00-00",
    }
    return [f"{name}={value}" for name, value in chosen(words, facts, code.UNKNOWN_PARAMETER)]


_SWITCHES = of_axes(lambda state, axis: str(int(state.has_switch(axis))))
#: Commands of the controller's state; inputs for the target are none.
STATUS = (
    GcsCommand("AOS?", "[{<AxisID>}]", "Get Analog Input Offset",
               of_axes(lambda _, __: printed(0.0))),
    GcsCommand("IFC?", "[{<InterfacePam>}]", "Get Interface Parameters", _interfaces),
    GcsCommand("LIM?", "[{<AxisID>}]", "Indicate Limit Switches", _SWITCHES),
    GcsCommand("OVF?", "[{<AxisID>}]", "Get Overflow State", of_axes(_overflow)),
    GcsCommand("SRG?", "[{<AxisID> <RegisterID>}]", "Query Status Register Value", _registers,
               poll=True),
    GcsCommand("SSN?", "", "Get Device Serial Number",
               fact(lambda s: s.device.identity.serial_number or "0")),
    GcsCommand("TAD?", "[{<InputID>}]", "Get ADC Value Of Input Signal", of_inputs(_digits)),
    GcsCommand("TNS?", "[{<InputID>}]", "Get Normalized Input Signal Value",
               of_inputs(lambda s, n: printed(_normalized(s, n)))),
    GcsCommand("TRS?", "[{<AxisID>}]", "Indicate Reference Switch", _SWITCHES),
)  # fmt: skip
