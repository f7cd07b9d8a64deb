"""Commands that set up a controller: zero, limits, modes, references of axes; digital outputs."""

from collections.abc import Callable, Sequence

from flexstage.instruments.pi.simulated import errors_gcs as code
from flexstage.instruments.pi.simulated.command import (
    Client,
    GcsCommand,
    Reply,
    Run,
    chosen,
    nothing,
    number,
    pairs,
    printed,
    switch,
    unsigned,
)
from flexstage.instruments.pi.simulated.commands_motion import of_axes
from flexstage.instruments.pi.simulated.device import Refusal, RefusedError
from flexstage.instruments.pi.simulated.errors_gcs import GcsError
from flexstage.instruments.pi.simulated.gcs_state import ControllerState


def _set_zero(state: ControllerState, _: Client, words: Sequence[str]) -> Reply:
    """Go through the range with control off, and count from where a low voltage leads to."""
    words = words or [word for axis in state.axes for word in (axis, "NAN")]
    given = pairs(words, state.axes, code.UNKNOWN_AXIS)
    if any(state.axes[axis].kind != "piezo" for axis, _ in given):
        raise GcsError(code.NOT_POSSIBLE)
    lowest = {axis: None if word.upper() == "NAN" else number(word) for axis, word in given}
    state.require_ready(
        {axis: state.voltage_range(axis)[0] if v is None else v for axis, v in lowest.items()},
        voltages=True,
    )
    try:
        state.device.set_zero(lowest)
    except RefusedError as error:
        if error.reason is Refusal.OUT_OF_LIMITS:
            raise GcsError(code.VOLTAGE_OUT_OF_LIMITS) from error
        raise
    return None


def _soft_limit(of_voltage: bool, high: bool) -> Run:
    def run(state: ControllerState, _: Client, words: Sequence[str]) -> Reply:
        known = state.outputs if of_voltage else state.axes
        unknown = code.UNKNOWN_CHANNEL if of_voltage else code.UNKNOWN_AXIS
        limits = state.soft_voltages if of_voltage else state.soft_positions
        changed = dict(limits)
        for name, word in pairs(words, known, unknown):
            axis = state.outputs[name] if of_voltage else name
            widest = state.voltage_range(axis) if of_voltage else state.position_range(axis)
            value = number(word) * (1.0 if of_voltage else state.model.scale)
            now = changed.get(axis, widest)
            soft = (now[0], value) if high else (value, now[1])
            slack = 1e-6 * (widest[1] - widest[0])
            if not widest[0] - slack <= soft[0] < soft[1] <= widest[1] + slack:
                raise GcsError(code.SOFT_LIMIT_OUT_OF_RANGE)
            changed[axis] = soft
        limits.update(changed)
        return None

    return run


def _set_online(state: ControllerState, _: Client, words: Sequence[str]) -> Reply:
    """Take commands over the interface: of one channel, or of all where none is named."""
    if len(words) == 1 and state.model.one_line:
        given = [(name, words[0]) for name in state.outputs]
    else:
        given = pairs(words, state.outputs, code.UNKNOWN_CHANNEL)
    switched = {name: switch(word) for name, word in given}
    state.online.update(switched)
    return None


def _online(state: ControllerState, _: Client, words: Sequence[str]) -> Reply:
    if state.model.one_line:
        return [str(int(all(state.online.values())))]
    outputs = chosen(words, state.outputs, code.UNKNOWN_CHANNEL)
    return [f"{name}={int(state.online[name])}" for name, _ in outputs]


def _set_speed_control(state: ControllerState, _: Client, words: Sequence[str]) -> Reply:
    """Let moves keep to the speed of the axis, or be as fast as the axis can."""
    given = [(axis, switch(w)) for axis, w in pairs(words, state.axes, code.UNKNOWN_AXIS)]
    for axis, on in given:
        if on and axis in state.free_speeds:
            state.device.set_speed(axis, state.free_speeds.pop(axis))
        elif not on and axis not in state.free_speeds:
            state.free_speeds[axis] = state.device.speed(axis)
            state.device.set_speed(axis, state.device.largest_speed(axis))
    return None


def _set_drift_compensation(state: ControllerState, _: Client, words: Sequence[str]) -> Reply:
    """Keep what is set: the simulated amplifiers have no drift to be compensated."""
    given = {axis: switch(w) for axis, w in pairs(words, state.axes, code.UNKNOWN_AXIS)}
    state.drift_compensation.update(given)
    return None


def _enable(state: ControllerState, _: Client, words: Sequence[str]) -> Reply:
    """Enable axes; an axis that is switched off stops and takes no motion."""
    given = {axis: switch(w) for axis, w in pairs(words, state.axes, code.UNKNOWN_AXIS)}
    off = [axis for axis, on in given.items() if not on]
    if off:
        state.device.stop(off)
    state.disabled = (state.disabled - given.keys()) | set(off)
    return None


def _reference(share: float, missing: int) -> Run:
    """Go to a switch at a part of the travel; piezo axes have none, and refuse."""

    def run(state: ControllerState, _: Client, words: Sequence[str]) -> Reply:
        axes = chosen(words, state.axes, code.UNKNOWN_AXIS)
        if not all(state.has_switch(name) for name, _ in axes):
            raise GcsError(missing)
        ends = {name: state.position_range(name) for name, _ in axes}
        goals = {name: low + share * (high - low) for name, (low, high) in ends.items()}
        state.device.set_targets(goals)
        state.referencing.update(goals)
        return None

    return run


def _reference_mode(state: ControllerState, _: Client, words: Sequence[str]) -> Reply:
    """Let axes with switches move without a reference move, or only after one."""
    given = {axis: switch(w) for axis, w in pairs(words, state.axes, code.UNKNOWN_AXIS)}
    if any(on and not state.has_switch(axis) for axis, on in given.items()):
        raise GcsError(code.NO_REFERENCE_SENSOR)
    state.reference_mode.update(given)
    return None


def _set_acceleration(name: str) -> Run:
    def run(state: ControllerState, _: Client, words: Sequence[str]) -> Reply:
        given = {axis: number(w) for axis, w in pairs(words, state.axes, code.UNKNOWN_AXIS)}
        if not all(value > 0.0 for value in given.values()):
            raise GcsError(code.OUT_OF_RANGE)
        state.accelerations[name].update(given)
        return None

    return run


def _acceleration(name: str) -> Run:
    return of_axes(lambda state, axis: printed(state.accelerations[name][axis]))


def _define_home(state: ControllerState, _: Client, words: Sequence[str]) -> Reply:
    axes = chosen(words, state.axes, code.UNKNOWN_AXIS)
    state.homes.update({axis: state.device.position(axis) for axis, _ in axes})
    return None


def _go_home(state: ControllerState, _: Client, words: Sequence[str]) -> Reply:
    targets = {axis: state.homes[axis] for axis, _ in chosen(words, state.axes, code.UNKNOWN_AXIS)}
    state.require_ready(targets)
    state.device.set_targets(targets)
    return None


def _flag(value: Callable[[ControllerState, str], bool]) -> Run:
    return of_axes(lambda state, axis: str(int(value(state, axis))))


def _change(name: str, arguments: str, text: str, run: Run, *, moves: bool = False) -> GcsCommand:
    return GcsCommand(name, arguments, text, run, changes=True, moves=moves)


def _question(name: str, text: str, run: Run) -> GcsCommand:
    return GcsCommand(name, "[{<AxisID>}]", text, run)


_SWITCHED = "{<AxisID> <State>}"
_RATES = {"ACC": "Acceleration", "DEC": "Deceleration"}
#: Commands of the set-up.
SETUP = (
    _change("ATZ", "[{<AxisID> <LowValue>}]", "Set Automatic Zero Point", _set_zero, moves=True),
    GcsCommand("ATZ?", "[{<AxisID>}]", "Get Automatic Zero Point State",
               _flag(lambda s, a: not s.device.zeroing(a)), poll=True),
    _change("DCO", _SWITCHED, "Set Drift Compensation Mode", _set_drift_compensation),
    _question("DCO?", "Get Drift Compensation Mode", _flag(lambda s, a: s.drift_compensation[a])),
    _change("EAX", _SWITCHED, "Enable Axis", _enable),
    _question("EAX?", "Get Axis Enable State", _flag(lambda s, a: a not in s.disabled)),
    *(_change(name, _SWITCHED, f"Set Closed-Loop {text}", _set_acceleration(name))
      for name, text in _RATES.items()),
    *(_question(f"{name}?", f"Get Closed-Loop {text}", _acceleration(name))
      for name, text in _RATES.items()),
    _change("DFH", "[{<AxisID>}]", "Define Home Position", _define_home),
    _question("DFH?", "Get Home Position",
              of_axes(lambda s, a: printed(s.homes[a] / s.model.scale))),
    _change("FNL", "[{<AxisID>}]", "Move To Negative Limit",
            _reference(0.0, code.NO_LIMIT_SWITCH), moves=True),
    _change("FPL", "[{<AxisID>}]", "Move To Positive Limit",
            _reference(1.0, code.NO_LIMIT_SWITCH), moves=True),
    _change("FRF", "[{<AxisID>}]", "Move To Reference Switch",
            _reference(0.5, code.NO_REFERENCE_SENSOR), moves=True),
    _change("GOH", "[{<AxisID>}]", "Go To Home Position", _go_home, moves=True),
    _change("NLM", "{<AxisID> <LowLimit>}", "Set Low Position Soft Limit",
            _soft_limit(of_voltage=False, high=False)),
    _change("ONL", "[<OutputID>] <State>", "Set Control Mode", _set_online),
    GcsCommand("ONL?", "[{<OutputID>}]", "Get Control Mode", _online),
    _change("PLM", "{<AxisID> <HighLimit>}", "Set High Position Soft Limit",
            _soft_limit(of_voltage=False, high=True)),
    _change("RON", _SWITCHED, "Set Reference Mode", _reference_mode),
    _question("RON?", "Get Reference Mode", _flag(lambda s, a: s.reference_mode[a])),
    _question("TCV?", "Get Commanded Velocity",
              of_axes(lambda s, a: printed(s.device.speed(a) / s.model.scale))),
    _change("VCO", _SWITCHED, "Set Velocity Control Mode", _set_speed_control),
    _question("VCO?", "Get Velocity Control Mode", _flag(lambda s, a: a not in s.free_speeds)),
    _change("VMA", "{<OutputID> <MaxVoltage>}", "Set Maximum Output Voltage",
            _soft_limit(of_voltage=True, high=True)),
    _change("VMI", "{<OutputID> <MinVoltage>}", "Set Minimum Output Voltage",
            _soft_limit(of_voltage=True, high=False)),
)  # fmt: skip
#: Digital outputs, which nothing is connected to: their settings are kept and told.
_LINES = 3
#: Settings of a line: width, axis, kind, lowest and highest position, polarity, offset.
_SETTINGS = range(1, 12)


def _line(word: str) -> int:
    line = unsigned(word)
    if not 1 <= line <= _LINES:
        raise GcsError(code.OUT_OF_RANGE)
    return line


def _triples(words: Sequence[str]) -> list[Sequence[str]]:
    if not words or len(words) % 3:
        raise GcsError(code.NUMBER_OF_PARAMETERS)
    return [words[i : i + 3] for i in range(0, len(words), 3)]


def _set_points(state: ControllerState, _: Client, words: Sequence[str]) -> Reply:
    given = {}
    for line, point, on in _triples(words):
        at = unsigned(point)
        if not 1 <= at <= state.device.wave_capacity:
            raise GcsError(code.OUT_OF_RANGE)
        given[_line(line), at] = switch(on)
    state.trigger_points.update(given)
    return None


def _clear_points(state: ControllerState, _: Client, words: Sequence[str]) -> Reply:
    nothing(words)
    state.trigger_points.clear()
    return None


def _points(state: ControllerState, _: Client, words: Sequence[str]) -> Reply:
    lines = [_line(word) for word in words] or range(1, _LINES + 1)
    found = [(n, p) for n, p in sorted(state.trigger_points) if n in lines]
    return [f"{n} {p}={int(state.trigger_points[n, p])}" for n, p in found] or ["0"]


def _set_line(state: ControllerState, _: Client, words: Sequence[str]) -> Reply:
    given = {}
    for line, setting, word in _triples(words):
        key = unsigned(setting)
        if key not in _SETTINGS:
            raise GcsError(code.OUT_OF_RANGE)
        number(word)
        given[_line(line), key] = word
    state.trigger_settings.update(given)
    return None


def _settings(state: ControllerState, _: Client, words: Sequence[str]) -> Reply:
    if len(words) % 2:
        raise GcsError(code.NUMBER_OF_PARAMETERS)
    asked = [(_line(a), unsigned(b)) for a, b in zip(words[::2], words[1::2], strict=True)]
    for key in asked:
        if key[1] not in _SETTINGS:
            raise GcsError(code.OUT_OF_RANGE)
    known = asked or sorted(state.trigger_settings)
    return [f"{n} {key}={state.trigger_settings.get((n, key), '0')}" for n, key in known] or ["0"]


#: Commands of the digital outputs.
TRIGGERS = (
    GcsCommand("CTO", "{<TrigOutID> <CTOPam> <Value>}", "Set Configuration Of Trigger Output",
               _set_line, changes=True),
    GcsCommand("CTO?", "[{<TrigOutID> <CTOPam>}]", "Get Configuration Of Trigger Output",
               _settings),
    GcsCommand("TWC", "", "Clear All Wave Related Triggers", _clear_points, changes=True),
    GcsCommand("TWS", "{<TrigOutID> <PointNumber> <Switch>}",
               "Set Trigger Line Actions To Waveform Points", _set_points, changes=True),
    GcsCommand("TWS?", "[{<TrigOutID>}]", "Get Trigger Line Actions At Waveform Points", _points),
)  # fmt: skip
