"""Commands of the tables of wave generator (segments, rate, start) and data recorder."""

import math
from collections.abc import Mapping, Sequence

import numpy as np

from flexstage.base.arrays import Array
from flexstage.instruments.pi.simulated.command import (
    GcsCommand,
    Reply,
    array_text,
    groups,
    number,
    order,
    question,
    unsigned,
    within,
)
from flexstage.instruments.pi.simulated.commands_identity import identity_line
from flexstage.instruments.pi.simulated.device import Refusal, require
from flexstage.instruments.pi.simulated.gcs_state import ControllerState
from flexstage.instruments.pi.simulated.record_store import RECORD_OPTIONS

#: Bits of the start mode: start immediately; start each cycle at the end of the previous one.
_START, _ONWARD = 1, 1 << 8
_START_MODES = (0, _START, _START | _ONWARD)


def running_bits(state: ControllerState) -> str:
    """Return the answer to ``#9``."""
    running = (state.device.wave_running(axis) for axis in state.generators.values())
    return f"{sum(1 << i for i, runs in enumerate(running) if runs):X}"


def _table(state: ControllerState, word: str) -> int:
    tables = range(1, state.device.tables.count + 1)
    return within(unsigned(word), tables, Refusal.UNKNOWN_WAVE_TABLE)


def _require_at_rest(state: ControllerState, generators: Sequence[str]) -> None:
    running = any(state.device.wave_running(state.generators[g]) for g in generators)
    require(not running, Refusal.WAVE_RUNNING)


def _define(state: ControllerState, words: Sequence[str]) -> Reply:
    require(len(words) >= 3, Refusal.NUMBER_OF_WAVE_PARAMETERS)
    table, mode = _table(state, words[0]), words[1].upper()
    require(mode in ("X", "&"), Refusal.SYNTAX)
    device = state.device
    present = device.tables.size(table) if mode == "&" else 0
    room = device.tables.room(table) - present
    samples = segment(words[2].upper(), words[3:], present=present, room=room)
    (device.append_wave if mode == "&" else device.set_wave)(table, samples)
    return None


def _clear(state: ControllerState, words: Sequence[str]) -> Reply:
    tables = [_table(state, word) for (word,) in groups(words, 1)]
    device = state.device
    used = [t for a in device.axes if device.wave_running(a) for t in device.wave_choice(a)]
    require(not set(tables) & set(used), Refusal.WAVE_RUNNING)
    for table in tables:
        device.set_wave(table, np.empty(0))
    return None


def _samples(state: ControllerState, words: Sequence[str]) -> Reply:
    require(len(words) != 1, Refusal.NUMBER_OF_PARAMETERS)
    filled = {t: state.device.tables.samples(t) for t in range(1, state.device.tables.count + 1)}
    tables = [_table(state, word) for word in words[2:]] or [t for t in filled if filled[t].size]
    least = min((filled[table].size for table in tables), default=0)
    require(least, Refusal.WAVE_NOT_DEFINED)
    first, count = (unsigned(words[0]), unsigned(words[1])) if words else (1, least)
    inside = first >= 1 and count >= 1 and first - 1 + count <= least
    require(inside, Refusal.WAVE_OUT_OF_RANGE)
    columns = [filled[table][first - 1 : first - 1 + count] for table in tables]
    names = [f"Wave Table {table}" for table in tables]
    step = state.device.wave_divider / state.device.sample_rate_hz
    return array_text(columns, names, step, identity_line(state))


def _choose(state: ControllerState, tables: Mapping[str, int]) -> None:
    _require_at_rest(state, list(tables))
    for generator, table in tables.items():
        axis = state.generators[generator]
        state.device.choose_wave(axis, table, state.device.wave_choice(axis)[1])


def _set_cycles(state: ControllerState, counts: Mapping[str, int]) -> None:
    for generator, count in counts.items():
        state.device.set_wave_cycles(state.generators[generator], count)


def _set_rate(state: ControllerState, words: Sequence[str]) -> Reply:
    rates = set()
    for generator, *numbers in groups(words, 3):
        require(generator == "0" or generator in state.generators, Refusal.UNKNOWN)
        rate, interpolation = (unsigned(word) for word in numbers)
        # interpolation is linear; steps between samples are not simulated
        smooth = interpolation == 1 or (interpolation == 0 and rate == 1)
        require(rate >= 1 and smooth, Refusal.BAD_VALUE)
        rates.add(rate)
    require(len(rates) == 1, Refusal.BAD_VALUE)  # all generators run at one rate
    state.device.set_wave_rate_divider(rates.pop())
    return None


def _start(state: ControllerState, modes: Mapping[str, int]) -> None:
    known = all(mode in _START_MODES for mode in modes.values())
    require(known, Refusal.UNKNOWN_START_MODE)
    starting = [state.generators[g] for g, mode in modes.items() if mode]
    stopping = [state.generators[g] for g, mode in modes.items() if not mode]
    onward = [state.generators[g] for g, mode in modes.items() if mode == _START | _ONWARD]
    _require_at_rest(state, [g for g, mode in modes.items() if mode])
    if starting:
        state.require_ready(dict.fromkeys(starting, math.nan))
        scales = state.wave_scales(starting)
        for axis, (unit, offset) in scales.items():
            _require_soft(state, axis, unit, offset)
        state.recorder.run(lambda: state.device.start_waves(starting, onward, scales))
    if stopping:
        state.device.stop_waves(stopping)
    state.start_modes.update(modes)


def _require_soft(state: ControllerState, axis: str, unit: float, offset: float) -> None:
    """Refuse a waveform beyond the limits of clients."""
    samples = state.device.tables.samples(state.device.wave_choice(axis)[0])
    voltages = not state.device.servo_on(axis)
    for end in (samples.min(), samples.max()):
        state.require_ready({axis: float(end + offset) * unit}, voltages=voltages)


def _started(state: ControllerState, generator: str) -> int:
    running = state.device.wave_running(state.generators[generator])
    return state.start_modes[generator] if running else 0


def _set_offsets(state: ControllerState, offsets: Mapping[str, float]) -> None:
    _require_at_rest(state, list(offsets))
    state.offsets.update({state.generators[g]: offset for g, offset in offsets.items()})


#: Commands of the wave generator.
WAVES = (
    GcsCommand("GWD?", "[<StartPoint> <NumberOfPoints> [{<WaveTableID>}]]", "Get Wave Table Data",
               _samples, free=True),
    GcsCommand("WAV", "<WaveTableID> <AppendWave> <WaveType> <WaveTypeParameters>",
               "Set Waveform Definition", _define, changes=True, free=True),
    GcsCommand("WCL", "{<WaveTableID>}", "Clear Wave Table Data", _clear, changes=True, free=True),
    order("WGC", "{<WaveGenID> <Cycles>}", "Set Number Of Wave Generator Cycles", _set_cycles),
    order("WGO", "{<WaveGenID> <StartMode>}", "Set Wave Generator Start/Stop Mode", _start,
          moves=True),
    question("WGO?", "[{<WaveGenID>}]", "Get Wave Generator Start/Stop Mode", _started, poll=True),
    order("WOS", "{<WaveGenID> <Offset>}", "Set Wave Generator Output Offset", _set_offsets),
    order("WSL", "{<WaveGenID> <WaveTableID>}", "Connect Wave Table To Wave Generator", _choose),
    GcsCommand("WTR", "{<WaveGenID> <WaveTableRate> <InterpolationType>}",
               "Set Wave Generator Table Rate", _set_rate, changes=True, free=True),
)  # fmt: skip
#: Number of words after the kind of a segment.
_WORDS = {"SIN_P": 6, "RAMP": 7, "LIN": 6}


def segment(kind: str, words: Sequence[str], *, present: int, room: int) -> Array:
    """Return the samples of a segment, as ``WAV`` describes it, in the unit of the command.

    It is appended to the `present` number of samples of the table, and has at most `room` samples.

    A segment has a length, and contains a curve with a start point and its own length. Before the
    curve is the offset; after it the offset too, for a line the offset plus the amplitude. A curve
    that exceeds the end of the segment continues at its start, so that the start point of a sine
    with the length of its segment is a phase. Sample i of a curve is its value at i over its
    length: the end of a curve is the start of the next one, and a repeated sine has no duplicate
    samples.

    Examples
    --------
    >>> segment("SIN_P", "4 10 5 4 0 2".split(), present=0, room=100)
    array([ 5., 10., 15., 10.])
    """
    if kind == "PNT":
        return _points(words, present, room)
    require(kind in _WORDS, Refusal.UNKNOWN_WAVE_TYPE)
    require(len(words) == _WORDS[kind], Refusal.NUMBER_OF_WAVE_PARAMETERS)
    size = unsigned(words[0])
    amplitude, offset = number(words[1]), number(words[2])
    curve, start, *rest = (unsigned(word) for word in words[3:])
    require(1 <= curve <= size and start < size, Refusal.WAVE_OUT_OF_RANGE)
    require(size <= room, Refusal.TABLE_FULL)
    if kind == "SIN_P":
        shape = _sine(curve, rest[0])
    elif kind == "RAMP":
        shape = _ramp(curve, rest[0], rest[1])
    else:
        shape = _line(curve, rest[0])
    values = np.zeros(size)
    values[(start + np.arange(curve)) % size] = shape
    if kind == "LIN" and start + curve < size:
        values[start + curve :] = 1.0
    return offset + amplitude * values


def _points(words: Sequence[str], present: int, room: int) -> Array:
    require(len(words) >= 3, Refusal.NUMBER_OF_WAVE_PARAMETERS)
    start, size = unsigned(words[0]), unsigned(words[1])
    require(size == len(words) - 2, Refusal.NUMBER_OF_WAVE_PARAMETERS)
    # counted in the appended samples, or in the complete table: clients use both
    require(start in (1, present + 1), Refusal.WAVE_OUT_OF_RANGE)
    require(size <= room, Refusal.TABLE_FULL)
    return np.array([number(word) for word in words[2:]])


def _sine(curve: int, centre: int) -> Array:
    """Return a half cosine up to the centre, and another one down, 0 to 1."""
    require(1 <= centre < curve, Refusal.WAVE_OUT_OF_RANGE)
    i = np.arange(curve)
    turn = np.where(i < centre, i / centre, 1.0 + (i - centre) / (curve - centre))
    return 0.5 - 0.5 * np.cos(np.pi * turn)


def _ramp(curve: int, rounded: int, centre: int) -> Array:
    """Return a line up to the centre, and another one down, 0 to 1."""
    require(1 <= centre < curve, Refusal.WAVE_OUT_OF_RANGE)
    return np.concatenate((_line(centre, rounded), 1.0 - _line(curve - centre, rounded)))


def _line(curve: int, rounded: int) -> Array:
    """Return a line from 0 to 1 with constant acceleration at its start and end."""
    require(2 * rounded <= curve, Refusal.WAVE_OUT_OF_RANGE)
    i = np.arange(curve, dtype=np.float64)
    if rounded == 0:
        return i / curve
    speed = 1.0 / (curve - rounded)
    up = 0.5 * speed * i * i / rounded
    down = 1.0 - 0.5 * speed * (curve - i) ** 2 / rounded
    even = speed * (i - 0.5 * rounded)
    return np.where(i < rounded, up, np.where(i > curve - rounded, down, even))


#: Trigger options of the recorder, by number.
_TRIGGERS = {
    0: "default setting: start of a waveform, or an impact",
    1: "any command changing target position or open-loop voltage, too",
    2: "next command, with reset to 0",
    4: "immediately",
}


def _record_table(state: ControllerState, word: str) -> int:
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
        f"Positions are in {state.model.unit}, sensors in um and urad, impacts in N and m/s^2",
        "#Sources for Record Options",
        *(f"{number}={' '.join(sources[number])}" for number in offered),
        "end of help",
    ]


def _configure(state: ControllerState, rows: Sequence[tuple[int, str, int]]) -> None:
    signals = {table: state.recorder.signal(source, option) for table, source, option in rows}
    for table, signal in signals.items():
        state.recorder.choose(table, signal)


def _set_trigger(state: ControllerState, words: Sequence[str]) -> Reply:
    rows = groups(words, 3)
    for table, _, _ in rows:
        if table != "0":
            _record_table(state, table)
    triggers = {unsigned(trigger) for _, trigger, _ in rows}
    # all tables record together
    require(len(triggers) == 1 and triggers <= set(_TRIGGERS), Refusal.BAD_VALUE)
    state.recorder.set_trigger(triggers.pop())
    return None


def _recorded(state: ControllerState, table: int) -> int:
    return state.device.recorder.recorded if table in state.recorder.recorded_signals else 0


def _records(state: ControllerState, words: Sequence[str]) -> Reply:
    require(len(words) != 1, Refusal.NUMBER_OF_PARAMETERS)
    available = state.device.recorder.recorded
    first, count = (unsigned(words[0]), unsigned(words[1])) if words else (1, available)
    signals = state.recorder.recorded_signals
    tables = [_record_table(state, word) for word in words[2:]] or sorted(signals)
    recorded = first >= 1 and count >= 1 and first - 1 + count <= available
    require(tables and signals.keys() >= set(tables) and recorded, Refusal.NOT_RECORDED)
    columns = [state.recorder.column(table, first - 1, count) for table in tables]
    names = [state.recorder.title(signals[table]) for table in tables]
    return array_text(columns, names, state.recorder.sample_step, identity_line(state))


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
          lambda s, rates: s.device.recorder.set_divider(rates[0])),
    question("RTR?", "", "Get Record Table Rate", lambda s, _: s.device.recorder.divider),
    question("TNR?", "", "Get Number Of Record Tables", lambda s, _: s.recorder.tables),
)  # fmt: skip
