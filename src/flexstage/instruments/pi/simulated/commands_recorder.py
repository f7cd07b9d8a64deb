"""Commands of the data recorder: what, how fast, when, and the records."""

from collections.abc import Sequence

from flexstage.instruments.pi.simulated import errors_gcs as code
from flexstage.instruments.pi.simulated.command import (
    Client,
    GcsCommand,
    Reply,
    array_text,
    fact,
    nothing,
    unsigned,
)
from flexstage.instruments.pi.simulated.commands_identity import identity_line
from flexstage.instruments.pi.simulated.errors_gcs import GcsError
from flexstage.instruments.pi.simulated.gcs_state import ControllerState
from flexstage.instruments.pi.simulated.record_store import RECORD_OPTIONS

#: What starts the recorder, by number.
_TRIGGERS = {
    0: "default setting: start of a waveform, or a blow",
    1: "any command changing target position or open-loop voltage, too",
    2: "next command, with reset to 0",
    4: "immediately",
}


def _tables(state: ControllerState, words: Sequence[str]) -> Sequence[int]:
    if not words:
        return range(1, state.recorder.tables + 1)
    return [_table(state, word) for word in words]


def _table(state: ControllerState, word: str) -> int:
    table = unsigned(word)
    if not 1 <= table <= state.recorder.tables:
        raise GcsError(code.UNKNOWN_RECORD_TABLE)
    return table


def _options(state: ControllerState, _: Client, words: Sequence[str]) -> Reply:
    nothing(words)
    sources = {number: state.recorder.sources(o) for number, o in RECORD_OPTIONS.items()}
    offered = {number: o for number, o in RECORD_OPTIONS.items() if sources[number]}
    return [
        "#RecordOptions",
        "0=Nothing is recorded",
        *(f"{number}={option.text}" for number, option in offered.items()),
        "#TriggerOptions",
        *(f"{number}={text}" for number, text in _TRIGGERS.items()),
        "#Parameters to be set with SPA",
        "0x16000000=Data Recorder Table Rate",
        "0x16000300=Data Recorder Chan Number",
        "#Additional information",
        f"{state.recorder.tables} record tables (TNR?)",
        f"{state.device.recorder.capacity} points in each record table",
        f"Positions are in {state.model.unit}, sensors in um and urad, blows in N and m/s^2",
        "#Sources for Record Options",
        *(f"{number}={' '.join(sources[number])}" for number in offered),
        "end of help",
    ]


def _configure(state: ControllerState, _: Client, words: Sequence[str]) -> Reply:
    if not words or len(words) % 3:
        raise GcsError(code.NUMBER_OF_PARAMETERS)
    given = [
        (_table(state, words[i]), state.recorder.signal(words[i + 1], unsigned(words[i + 2])))
        for i in range(0, len(words), 3)
    ]
    for table, signal in given:
        state.recorder.choose(table, signal)
    return None


def _configuration(state: ControllerState, _: Client, words: Sequence[str]) -> Reply:
    choices = ((table, *state.recorder.choice(table)) for table in _tables(state, words))
    return [f"{table}={source} {option}" for table, source, option in choices]


def _set_trigger(state: ControllerState, _: Client, words: Sequence[str]) -> Reply:
    if not words or len(words) % 3:
        raise GcsError(code.NUMBER_OF_PARAMETERS)
    for word in words[::3]:
        if word != "0":
            _table(state, word)
    triggers = {unsigned(word) for word in words[1::3]}
    if len(triggers) > 1 or not triggers <= set(_TRIGGERS):  # all tables record together
        raise GcsError(code.OUT_OF_RANGE)
    state.recorder.set_trigger(triggers.pop())
    return None


def _trigger(state: ControllerState, _: Client, words: Sequence[str]) -> Reply:
    return [f"{table}={state.recorder.trigger} 0" for table in _tables(state, words)]


def _set_rate(state: ControllerState, _: Client, words: Sequence[str]) -> Reply:
    if len(words) != 1:
        raise GcsError(code.NUMBER_OF_PARAMETERS)
    divider = unsigned(words[0])
    if divider < 1:
        raise GcsError(code.OUT_OF_RANGE)
    state.device.recorder.set_divider(divider)
    return None


def _recorded(state: ControllerState, _: Client, words: Sequence[str]) -> Reply:
    count = state.device.recorder.recorded
    return [
        f"{table}={count if table in state.recorder.kept else 0}" for table in _tables(state, words)
    ]


def _records(state: ControllerState, _: Client, words: Sequence[str]) -> Reply:
    if len(words) == 1:
        raise GcsError(code.NUMBER_OF_PARAMETERS)
    there = state.device.recorder.recorded
    first, count = (unsigned(words[0]), unsigned(words[1])) if words else (1, there)
    tables = [_table(state, word) for word in words[2:]] or sorted(state.recorder.kept)
    if not tables or any(table not in state.recorder.kept for table in tables):
        raise GcsError(code.NOT_RECORDED)
    if not (first >= 1 and count >= 1 and first - 1 + count <= there):
        raise GcsError(code.NOT_RECORDED)
    columns = [state.recorder.column(table, first - 1, count) for table in tables]
    names = []
    for table in tables:
        source, option = state.recorder.source_and_option(state.recorder.kept[table])
        names.append(f"{RECORD_OPTIONS[option].text} {source}")
    return array_text(columns, names, state.recorder.kept_step, identity_line(state))


#: Commands of the data recorder.
RECORDER = (
    GcsCommand("DRC", "{<RecTableID> <Source> <RecOption>}", "Set Data Recorder Configuration",
               _configure, changes=True),
    GcsCommand("DRC?", "[{<RecTableID>}]", "Get Data Recorder Configuration", _configuration),
    GcsCommand("DRL?", "[{<RecTableID>}]", "Get Number Of Recorded Points", _recorded, poll=True),
    GcsCommand("DRR?", "[<StartPoint> <NumberOfPoints> [{<RecTableID>}]]",
               "Get Recorded Data Values", _records),
    GcsCommand("DRT", "{<RecTableID> <TriggerSource> <Value>}", "Set Data Recorder Trigger Source",
               _set_trigger, changes=True),
    GcsCommand("DRT?", "[{<RecTableID>}]", "Get Data Recorder Trigger Source", _trigger),
    GcsCommand("HDR?", "", "Get All Data Recorder Options", _options),
    GcsCommand("RTR", "<RecTableRate>", "Set Record Table Rate", _set_rate, changes=True),
    GcsCommand("RTR?", "", "Get Record Table Rate",
               fact(lambda s: str(s.device.recorder.divider))),
    GcsCommand("TNR?", "", "Get Number Of Record Tables",
               fact(lambda s: str(s.recorder.tables))),
)  # fmt: skip
