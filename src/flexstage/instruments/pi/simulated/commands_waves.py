"""Commands of the wave generator: tables and segments, who runs which, rate, cycles, start."""

import math
from collections.abc import Callable, Sequence

import numpy as np

from flexstage.arrays import Array
from flexstage.instruments.pi.simulated import errors_gcs as code
from flexstage.instruments.pi.simulated.command import (
    LARGEST,
    Client,
    GcsCommand,
    Reply,
    Run,
    array_text,
    chosen,
    fact,
    nothing,
    number,
    pairs,
    printed,
    unsigned,
    unsigned_or_hex,
)
from flexstage.instruments.pi.simulated.commands_identity import identity_line
from flexstage.instruments.pi.simulated.errors_gcs import GcsError
from flexstage.instruments.pi.simulated.gcs_state import ControllerState

#: Bits of the start mode: begin at once; begin each cycle where the one before has ended.
_START, _ONWARD = 1, 1 << 8
_START_MODES = (0, _START, _START | _ONWARD)


def running_bits(state: ControllerState) -> str:
    """Return what ``#9`` answers."""
    running = (state.device.wave_running(axis) for axis in state.generators.values())
    return f"{sum(1 << i for i, runs in enumerate(running) if runs):X}"


def _told(value: Callable[[ControllerState, str, str], str]) -> Run:
    """Return a command that tells something of generators, each given with its axis."""

    def run(state: ControllerState, _: Client, words: Sequence[str]) -> Reply:
        generators = chosen(words, state.generators, code.UNKNOWN_AXIS)
        return [f"{g}={value(state, g, axis)}" for g, axis in generators]

    return run


def _table(state: ControllerState, word: str) -> int:
    table = unsigned(word)
    if not 1 <= table <= state.device.wave_tables:
        raise GcsError(code.UNKNOWN_WAVE_TABLE)
    return table


def _define(state: ControllerState, _: Client, words: Sequence[str]) -> Reply:
    if len(words) < 3:
        raise GcsError(code.NUMBER_OF_WAVE_PARAMETERS)
    table = _table(state, words[0])
    how = words[1].upper()
    if how not in ("X", "&", "+"):
        raise GcsError(code.SYNTAX)
    held = state.waves.size(table) if how == "&" else 0
    room = state.waves.room(table) - held
    samples = segment(words[2].upper(), words[3:], held=held, room=room)
    if how == "&":
        state.waves.append(table, samples)
        return None
    if how == "+":
        # added to what is there; the longer of the two goes on as it is
        there = state.waves.samples(table)
        size = max(there.size, samples.size)
        samples = np.pad(there, (0, size - there.size)) + np.pad(samples, (0, size - samples.size))
        if not np.all(np.abs(samples) <= LARGEST):
            raise GcsError(code.WAVE_OUT_OF_RANGE)
    state.waves.replace(table, samples)
    return None


def _lengths(state: ControllerState, _: Client, words: Sequence[str]) -> Reply:
    if len(words) > 2 or (len(words) == 2 and words[1] != "1"):
        raise GcsError(code.NUMBER_OF_PARAMETERS)
    tables = [_table(state, words[0])] if words else range(1, state.device.wave_tables + 1)
    return [f"{table} 1={state.waves.size(table)}" for table in tables]


def _clear(state: ControllerState, _: Client, words: Sequence[str]) -> Reply:
    if not words:
        raise GcsError(code.NUMBER_OF_PARAMETERS)
    tables = [_table(state, word) for word in words]
    if any(state.waves.in_use(table) for table in tables):
        raise GcsError(code.WAVE_RUNNING)
    for table in tables:
        state.waves.replace(table, np.empty(0))
    return None


def _samples(state: ControllerState, _: Client, words: Sequence[str]) -> Reply:
    if len(words) == 1:
        raise GcsError(code.NUMBER_OF_PARAMETERS)
    tables = [_table(state, word) for word in words[2:]] or state.waves.filled()
    if not tables or any(not state.waves.size(table) for table in tables):
        raise GcsError(code.WAVE_NOT_DEFINED)
    least = min(state.waves.size(table) for table in tables)
    first, count = (unsigned(words[0]), unsigned(words[1])) if words else (1, least)
    if not (first >= 1 and count >= 1 and first - 1 + count <= least):
        raise GcsError(code.WAVE_OUT_OF_RANGE)
    columns = [state.waves.samples(table)[first - 1 : first - 1 + count] for table in tables]
    names = [f"Wave Table {table}" for table in tables]
    step = state.device.wave_rate_divider() / state.device.sample_rate_hz
    return array_text(columns, names, step, identity_line(state))


def _choose(state: ControllerState, _: Client, words: Sequence[str]) -> Reply:
    given = pairs(words, state.generators, code.UNKNOWN_AXIS)
    chosen_tables = [(state.generators[g], unsigned(word)) for g, word in given]
    if any(table > state.device.wave_tables for _, table in chosen_tables):
        raise GcsError(code.UNKNOWN_WAVE_TABLE)
    if any(state.device.wave_running(axis) for axis, _ in chosen_tables):
        raise GcsError(code.WAVE_RUNNING)
    for axis, table in chosen_tables:
        state.device.choose_wave(axis, table, state.device.wave_choice(axis)[1])
    return None


def _set_cycles(state: ControllerState, _: Client, words: Sequence[str]) -> Reply:
    given = pairs(words, state.generators, code.UNKNOWN_AXIS)
    cycles = [(state.generators[g], unsigned(word)) for g, word in given]
    for axis, count in cycles:
        state.device.set_wave_cycles(axis, count)
    return None


def _set_rate(state: ControllerState, _: Client, words: Sequence[str]) -> Reply:
    if not words or len(words) % 3:
        raise GcsError(code.NUMBER_OF_PARAMETERS)
    rates = set()
    for i in range(0, len(words), 3):
        if words[i] != "0" and words[i] not in state.generators:
            raise GcsError(code.UNKNOWN_AXIS)
        rate, interpolation = unsigned(words[i + 1]), unsigned(words[i + 2])
        # straight lines join the samples; steps between them are not simulated
        if rate < 1 or interpolation > 1 or (rate > 1 and interpolation != 1):
            raise GcsError(code.OUT_OF_RANGE)
        rates.add(rate)
    if len(rates) != 1:  # all generators run at one rate
        raise GcsError(code.OUT_OF_RANGE)
    state.device.set_wave_rate_divider(rates.pop())
    return None


def _rate(state: ControllerState, _: Client, words: Sequence[str]) -> Reply:
    if words == ["0"]:
        words = []
    generators = chosen(words, state.generators, code.UNKNOWN_AXIS)
    return [f"{g}={state.device.wave_rate_divider()} 1" for g, _ in generators]


def _start(state: ControllerState, _: Client, words: Sequence[str]) -> Reply:
    given = pairs(words, state.generators, code.UNKNOWN_AXIS)
    modes = {g: unsigned_or_hex(word) for g, word in given}
    if any(mode not in _START_MODES for mode in modes.values()):
        raise GcsError(code.UNKNOWN_START_MODE)
    starting = [state.generators[g] for g, mode in modes.items() if mode]
    stopping = [state.generators[g] for g, mode in modes.items() if not mode]
    onward = [state.generators[g] for g, mode in modes.items() if mode == _START | _ONWARD]
    if any(state.device.wave_running(axis) for axis in starting):
        raise GcsError(code.WAVE_RUNNING)
    if starting:
        state.require_ready(dict.fromkeys(starting, math.nan))
        state.waves.give(starting)
        for axis in starting:
            _require_soft(state, axis)
        state.recorder.run(lambda: state.device.start_waves(starting, onward))
    if stopping:
        state.device.stop_waves(stopping)
    state.start_modes.update(modes)
    return None


def _require_soft(state: ControllerState, axis: str) -> None:
    """Refuse a waveform beyond limits that clients have set."""
    samples = state.device.wave(state.device.wave_choice(axis)[0])
    voltages = not state.device.servo_on(axis)
    for end in (samples.min(), samples.max()):
        state.require_ready({axis: float(end)}, voltages=voltages)


def _set_offsets(state: ControllerState, _: Client, words: Sequence[str]) -> Reply:
    given = pairs(words, state.generators, code.UNKNOWN_AXIS)
    offsets = {state.generators[g]: number(word) for g, word in given}
    if any(state.device.wave_running(axis) for axis in offsets):
        raise GcsError(code.WAVE_RUNNING)
    state.waves.offsets.update(offsets)
    return None


def _record_again(state: ControllerState, _: Client, words: Sequence[str]) -> Reply:
    nothing(words)
    if not any(state.device.wave_running(axis) for axis in state.axes):
        raise GcsError(code.NO_WAVE_CHOSEN)
    state.recorder.now(by_client=False)
    return None


def _capacity(state: ControllerState, _: Client, words: Sequence[str]) -> Reply:
    tables = [_table(state, word) for word in words] or range(1, state.device.wave_tables + 1)
    return [f"{table}={state.waves.room(table)}" for table in tables]


#: Commands of the wave generator.
WAVES = (
    GcsCommand("GWD?", "[<StartPoint> <NumberOfPoints> [{<WaveTableID>}]]", "Get Wave Table Data",
               _samples),
    GcsCommand("TWG?", "", "Get Number Of Wave Generators",
               fact(lambda s: str(len(s.generators)))),
    GcsCommand("WAV", "<WaveTableID> <AppendWave> <WaveType> <WaveTypeParameters>",
               "Set Waveform Definition", _define, changes=True),
    GcsCommand("WAV?", "[<WaveTableID> [<WaveParameterID>]]", "Get Waveform Length", _lengths),
    GcsCommand("WCL", "{<WaveTableID>}", "Clear Wave Table Data", _clear, changes=True),
    GcsCommand("WGC", "{<WaveGenID> <Cycles>}", "Set Number Of Wave Generator Cycles", _set_cycles,
               changes=True),
    GcsCommand("WGC?", "[{<WaveGenID>}]", "Get Number Of Wave Generator Cycles",
               _told(lambda s, _, axis: str(s.device.wave_cycles(axis)))),
    GcsCommand("WGO", "{<WaveGenID> <StartMode>}", "Set Wave Generator Start/Stop Mode", _start,
               changes=True, moves=True),
    GcsCommand("WGO?", "[{<WaveGenID>}]", "Get Wave Generator Start/Stop Mode",
               _told(lambda s, g, a: str(s.start_modes[g] if s.device.wave_running(a) else 0)),
               poll=True),
    GcsCommand("WGR", "", "Start Recording Again While Wave Generator Runs", _record_again,
               changes=True),
    GcsCommand("WMS?", "[{<WaveTableID>}]", "Get Maximum Number Of Wave Table Points", _capacity),
    GcsCommand("WOS", "{<WaveGenID> <Offset>}", "Set Wave Generator Output Offset", _set_offsets,
               changes=True),
    GcsCommand("WOS?", "[{<WaveGenID>}]", "Get Wave Generator Output Offset",
               _told(lambda s, _, axis: printed(s.waves.offsets[axis]))),
    GcsCommand("WSL", "{<WaveGenID> <WaveTableID>}", "Connect Wave Table To Wave Generator",
               _choose, changes=True),
    GcsCommand("WSL?", "[{<WaveGenID>}]", "Get Wave Table Of Wave Generator",
               _told(lambda s, _, axis: str(s.device.wave_choice(axis)[0]))),
    GcsCommand("WTR", "{<WaveGenID> <WaveTableRate> <InterpolationType>}",
               "Set Wave Generator Table Rate", _set_rate, changes=True),
    GcsCommand("WTR?", "[{<WaveGenID>}]", "Get Wave Generator Table Rate", _rate),
)  # fmt: skip
#: Words behind the kind of a segment.
_WORDS = {"SIN_P": 6, "RAMP": 7, "LIN": 6}


def segment(kind: str, words: Sequence[str], *, held: int, room: int) -> Array:
    """Return the samples of a segment, as ``WAV`` describes it, in the unit of the command.

    It is appended to the samples that are `held` in the table; `room` is the most that it can have.

    A segment has a length, and in it a curve that begins at a start point and has a length of its
    own. Before the curve is the offset; behind it the offset too, for a line the offset and the
    amplitude. A curve that reaches over the end of the segment goes on at its start, so that the
    start point of a sine as long as its segment is a phase. Sample i of a curve is its value at i
    over its length: the end of a curve is the start of what follows, and a sine that is repeated
    has no sample twice.

    Examples
    --------
    >>> segment("SIN_P", "4 10 5 4 0 2".split(), held=0, room=100)
    array([ 5., 10., 15., 10.])
    """
    if kind == "PNT":
        return _points(words, held, room)
    if kind not in _WORDS:
        raise GcsError(code.UNKNOWN_WAVE_TYPE)
    if len(words) != _WORDS[kind]:
        raise GcsError(code.NUMBER_OF_WAVE_PARAMETERS)
    size = unsigned(words[0])
    amplitude, offset = number(words[1]), number(words[2])
    curve, start, *rest = (unsigned(word) for word in words[3:])
    if not (1 <= curve <= size and start < size):
        raise GcsError(code.WAVE_OUT_OF_RANGE)
    if size > room:
        raise GcsError(code.WAVE_TOO_LONG)
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


def _points(words: Sequence[str], held: int, room: int) -> Array:
    if len(words) < 3:
        raise GcsError(code.NUMBER_OF_WAVE_PARAMETERS)
    start, size = unsigned(words[0]), unsigned(words[1])
    if size != len(words) - 2:
        raise GcsError(code.NUMBER_OF_WAVE_PARAMETERS)
    # counted in what is appended, or in the whole table: clients do either
    if start not in (1, held + 1):
        raise GcsError(code.WAVE_OUT_OF_RANGE)
    if size > room:
        raise GcsError(code.WAVE_TOO_LONG)
    return np.array([number(word) for word in words[2:]])


def _sine(curve: int, centre: int) -> Array:
    """Return half a cosine up to the centre, and another half down, 0 to 1."""
    if not 1 <= centre < curve:
        raise GcsError(code.WAVE_OUT_OF_RANGE)
    i = np.arange(curve)
    turn = np.where(i < centre, i / centre, 1.0 + (i - centre) / (curve - centre))
    return 0.5 - 0.5 * np.cos(np.pi * turn)


def _ramp(curve: int, rounded: int, centre: int) -> Array:
    """Return a line up to the centre, and another one down, 0 to 1."""
    if not 1 <= centre < curve:
        raise GcsError(code.WAVE_OUT_OF_RANGE)
    return np.concatenate((_line(centre, rounded), 1.0 - _line(curve - centre, rounded)))


def _line(curve: int, rounded: int) -> Array:
    """Return a line from 0 to 1 whose speed grows and falls evenly over its first and last part."""
    if 2 * rounded > curve:
        raise GcsError(code.WAVE_OUT_OF_RANGE)
    i = np.arange(curve, dtype=np.float64)
    if rounded == 0:
        return i / curve
    speed = 1.0 / (curve - rounded)
    up = 0.5 * speed * i * i / rounded
    down = 1.0 - 0.5 * speed * (curve - i) ** 2 / rounded
    even = speed * (i - 0.5 * rounded)
    return np.where(i < rounded, up, np.where(i > curve - rounded, down, even))
