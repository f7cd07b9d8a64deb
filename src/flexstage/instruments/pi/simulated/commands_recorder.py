"""Commands of the data recorder: what, how fast, when, and the records."""

from collections.abc import Sequence

from flexstage.instruments.pi.simulated.command import (
    GcsCommand,
    Reply,
    array_text,
    groups,
    order,
    question,
    unsigned,
    within,
)
from flexstage.instruments.pi.simulated.commands_identity import identity_line
from flexstage.instruments.pi.simulated.device import Refusal, require
from flexstage.instruments.pi.simulated.gcs_state import ControllerState
from flexstage.instruments.pi.simulated.record_store import RECORD_OPTIONS

#: What starts the recorder, by number.
_TRIGGERS = {
    0: "default setting: start of a waveform, or a blow",
    1: "any command changing target position or open-loop voltage, too",
    2: "next command, with reset to 0",
    4: "immediately",
}


def _table(state: ControllerState, word: str) -> int:
    tables = range(1, state.recorder.tables + 1)
    return within(unsigned(word), tables, Refusal.UNKNOWN_RECORD_TABLE)


def _options(state: ControllerState, _: None) -> Reply:
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


def _configure(state: ControllerState, given: Sequence[tuple[int, str, int]]) -> None:
    signals = {table: state.recorder.signal(source, option) for table, source, option in given}
    for table, signal in signals.items():
        state.recorder.choose(table, signal)


def _set_trigger(state: ControllerState, words: Sequence[str]) -> Reply:
    given = groups(words, 3)
    for table, _, _ in given:
        if table != "0":
            _table(state, table)
    triggers = {unsigned(trigger) for _, trigger, _ in given}
    # all tables record together
    require(len(triggers) == 1 and triggers <= set(_TRIGGERS), Refusal.BAD_VALUE)
    state.recorder.set_trigger(triggers.pop())
    return None


def _recorded(state: ControllerState, table: int) -> int:
    return state.device.recorder.recorded if table in state.recorder.kept else 0


def _records(state: ControllerState, words: Sequence[str]) -> Reply:
    require(len(words) != 1, Refusal.NUMBER_OF_PARAMETERS)
    there = state.device.recorder.recorded
    first, count = (unsigned(words[0]), unsigned(words[1])) if words else (1, there)
    kept = state.recorder.kept
    tables = [_table(state, word) for word in words[2:]] or sorted(kept)
    recorded = first >= 1 and count >= 1 and first - 1 + count <= there
    require(tables and kept.keys() >= set(tables) and recorded, Refusal.NOT_RECORDED)
    columns = [state.recorder.column(table, first - 1, count) for table in tables]
    names = [state.recorder.title(kept[table]) for table in tables]
    return array_text(columns, names, state.recorder.kept_step, identity_line(state))


#: Commands of the data recorder.
RECORDER = (
    order("DRC", "{<RecTableID> <Source> <RecOption>}", "Set Data Recorder Configuration",
          _configure),
    question("DRL?", "[{<RecTableID>}]", "Get Number Of Recorded Points", _recorded, poll=True),
    GcsCommand("DRR?", "[<StartPoint> <NumberOfPoints> [{<RecTableID>}]]",
               "Get Recorded Data Values", _records, free=True),
    GcsCommand("DRT", "{<RecTableID> <TriggerSource> <Value>}", "Set Data Recorder Trigger Source",
               _set_trigger, changes=True, free=True),
    GcsCommand("HDR?", "", "Get All Data Recorder Options", _options),
    order("RTR", "<RecTableRate>", "Set Record Table Rate",
          lambda s, given: s.device.recorder.set_divider(given[0])),
    question("RTR?", "", "Get Record Table Rate", lambda s, _: s.device.recorder.divider),
    question("TNR?", "", "Get Number Of Record Tables", lambda s, _: s.recorder.tables),
)  # fmt: skip
