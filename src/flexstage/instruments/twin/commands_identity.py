"""Commands about the controller itself: identity, help, errors, parameters, reboot."""

from collections.abc import Iterable, Sequence

from flexstage import __version__
from flexstage.instruments.twin import errors_gcs as code
from flexstage.instruments.twin.command import (
    Client,
    GcsCommand,
    Reply,
    chosen,
    fact,
    nothing,
    number,
    unsigned,
    unsigned_or_hex,
)
from flexstage.instruments.twin.errors_gcs import GcsError
from flexstage.instruments.twin.gcs_state import ControllerState, ServoDraft
from flexstage.instruments.twin.parameters import (
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
    GcsCommand("SAI?", "[ALL]", "Get Axis Identifiers", _axis_names),
    GcsCommand("SEP?", "[{<ItemID> <PamID>}]", "Get Parameters As Delivered", _read_delivered),
    GcsCommand("SPA", "{<ItemID> <PamID> <PamValue>}", "Set Volatile Memory Parameters",
               _set_parameters, changes=True),
    GcsCommand("SPA?", "[{<ItemID> <PamID>}]", "Get Volatile Memory Parameters", _read_parameters),
    GcsCommand("TPC?", "", "Get Number Of Output Channels", fact(lambda s: str(len(s.outputs)))),
    GcsCommand("TSC?", "", "Get Number Of Input Channels", fact(lambda s: str(len(s.channels)))),
    GcsCommand("VER?", "", "Get Versions", _versions),
)  # fmt: skip
