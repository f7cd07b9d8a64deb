"""Commands of motion: targets, voltages, position control, speed, limits, references, stop."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any

from flexstage.instruments.pi.simulated.command import (
    GcsCommand,
    Reply,
    groups,
    order,
    question,
    switch,
)
from flexstage.instruments.pi.simulated.device import Refusal, RefusedError, require
from flexstage.instruments.pi.simulated.gcs_state import MICRO, ControllerState

#: Tolerance of a client's limit for rounded texts, over the widest range.
_ROUNDING = 1e-6
Value = Callable[[ControllerState, str], Any]


def halt(state: ControllerState, axes: Sequence[str] | None = None) -> Reply:
    """Stop axes, by default all, and report the stop to the client."""
    state.stop(axes)
    raise RefusedError(Refusal.STOPPED)


def moving_bits(state: ControllerState) -> str:
    """Return the answer to ``#5``."""
    return f"{sum(1 << i for i, axis in enumerate(state.axes) if state.device.moving(axis)):X}"


def _stop(state: ControllerState, words: Sequence[str]) -> Reply:
    """Stop first, whatever the arguments are, and refuse them afterwards."""
    state.stop()
    require(not words, Refusal.NUMBER_OF_PARAMETERS)
    raise RefusedError(Refusal.STOPPED)


def _move(relative: bool) -> Callable[[ControllerState, Mapping[str, float]], None]:
    def run(state: ControllerState, values: Mapping[str, float]) -> None:
        device = state.device
        targets = {axis: value * state.model.scale for axis, value in values.items()}
        if relative:
            targets = {axis: device.target(axis) + v for axis, v in targets.items()}
        state.require_ready(targets)
        state.recorder.move(lambda: device.set_targets(targets))

    return run


def _set_voltage(state: ControllerState, voltages: Mapping[str, float]) -> None:
    state.require_ready(voltages, voltages=True)
    state.recorder.move(lambda: state.device.set_commands(voltages))


def _set_zero(state: ControllerState, voltages: Mapping[str, float | None]) -> None:
    """Move through the range in open loop, and set zero at a low voltage."""
    lowest = voltages or dict.fromkeys(state.axes)
    require(all(state.axes[axis].kind == "piezo" for axis in lowest), Refusal.NOT_ABLE)
    state.require_ready(
        {axis: state.voltage_range(axis)[0] if v is None else v for axis, v in lowest.items()},
        voltages=True,
    )
    state.device.set_zero(lowest)


def _switch_servo(state: ControllerState, switches: Mapping[str, bool]) -> None:
    off = {axis for axis, on in switches.items() if on} & state.disabled
    require(not off, Refusal.SWITCHED_OFF)
    for axis, on in switches.items():
        if on != state.device.servo_on(axis):
            state.device.set_servo(axis, on)


def _set_speed(state: ControllerState, values: Mapping[str, float]) -> None:
    speeds = {axis: value * state.model.scale for axis, value in values.items()}
    for axis, speed in speeds.items():
        largest = state.axes[axis].limits.speed
        allowed = speed > 0.0 and (largest is None or speed <= largest * (1.0 + 1e-9))
        require(allowed, Refusal.SPEED_OUT_OF_LIMITS)
    for axis, speed in speeds.items():
        if axis in state.free_speeds:
            state.free_speeds[axis] = speed
        else:
            state.device.set_speed(axis, speed)


def _set_speed_control(state: ControllerState, switches: Mapping[str, bool]) -> None:
    """Limit moves to the speed of the axis, or allow the largest speed."""
    for axis, on in switches.items():
        if on and axis in state.free_speeds:
            state.device.set_speed(axis, state.free_speeds.pop(axis))
        elif not on and axis not in state.free_speeds:
            state.free_speeds[axis] = state.device.speed(axis)
            state.device.set_speed(axis, state.device.largest_speed(axis))


def _soft_limit(of_voltage: bool, end: int) -> Callable[[ControllerState, Any], None]:
    def run(state: ControllerState, values: Mapping[str, float]) -> None:
        changed = {}
        for name, value in values.items():
            axis = state.outputs[name] if of_voltage else name
            widest = state.voltage_range(axis) if of_voltage else state.position_range(axis)
            soft = list(state.soft(axis, of_voltage))
            soft[end] = value * (1.0 if of_voltage else state.model.scale)
            low, high = soft
            slack = _ROUNDING * (widest[1] - widest[0])
            inside = widest[0] - slack <= low < high <= widest[1] + slack
            require(inside, Refusal.SOFT_LIMIT_OUT_OF_RANGE)
            changed[axis] = (low, high)
        (state.soft_voltages if of_voltage else state.soft_positions).update(changed)

    return run


def _set_online(state: ControllerState, words: Sequence[str]) -> Reply:
    """Accept commands over the interface for one channel, by default for all."""
    if len(words) == 1 and state.model.one_line:
        words = [word for name in state.outputs for word in (name, words[0])]
    pairs = groups(words, 2)
    names = [name for name, _ in pairs]
    require(all(name in state.outputs for name in names), Refusal.UNKNOWN_CHANNEL)
    require(len(set(names)) == len(names), Refusal.AXIS_TWICE)
    state.online.update({name: switch(word) for name, word in pairs})
    return None


def _online(state: ControllerState, words: Sequence[str]) -> Reply:
    if state.model.one_line:
        return [str(int(all(state.online.values())))]
    require(all(name in state.outputs for name in words), Refusal.UNKNOWN_CHANNEL)
    return [f"{name}={int(state.online[name])}" for name in words or state.outputs]


def _enable(state: ControllerState, switches: Mapping[str, bool]) -> None:
    """Enable or disable axes; a disabled axis stops and accepts no motion."""
    off = [axis for axis, on in switches.items() if not on]
    if off:
        state.device.stop(off)
    state.disabled = (state.disabled - switches.keys()) | set(off)


def _reference(share: float, missing: Refusal) -> Callable[[ControllerState, Any], None]:
    """Move to a switch at a fraction of the travel; piezo axes have none, and refuse."""

    def run(state: ControllerState, axes: Sequence[str]) -> None:
        require(all(state.has_switch(name) for name in axes), missing)
        ends = {name: state.position_range(name) for name in axes}
        goals = {name: low + share * (high - low) for name, (low, high) in ends.items()}
        state.device.set_targets(goals)
        state.referencing.update(goals)

    return run


def _reference_mode(state: ControllerState, switches: Mapping[str, bool]) -> None:
    """Require a reference move of axes with switches, or allow motion without it."""
    axes = [axis for axis, on in switches.items() if on]
    require(all(state.has_switch(axis) for axis in axes), Refusal.NO_REFERENCE_SENSOR)
    state.reference_mode.update(switches)


def _set_acceleration(name: str) -> Callable[[ControllerState, Any], None]:
    def run(state: ControllerState, values: Mapping[str, float]) -> None:
        require(all(value > 0.0 for value in values.values()), Refusal.BAD_VALUE)
        state.accelerations[name].update(values)

    return run


def _go_home(state: ControllerState, axes: Sequence[str]) -> None:
    targets = {axis: state.homes[axis] for axis in axes}
    state.require_ready(targets)
    state.device.set_targets(targets)


def _strike(state: ControllerState, axes: Sequence[str]) -> None:
    require(state.device.drives_out, Refusal.NOT_ABLE)
    state.recorder.run(lambda: state.device.strike(axes[0]))


def _length(value: Value) -> Value:
    return lambda state, axis: value(state, axis) / state.model.scale


def _of_axes(name: str, text: str, value: Value, *, poll: bool = False) -> GcsCommand:
    return question(name, "[{<AxisID>}]", text, value, poll=poll)


def _of_outputs(name: str, text: str, value: Value) -> GcsCommand:
    """Return a question about outputs, whose value is a function of their axis."""
    return question(name, "[{<OutputID>}]", text, lambda s, out: value(s, s.outputs[out]))


_SWITCHED = "{<AxisID> <State>}"
_AXES = "[{<AxisID>}]"
_RATES = {"ACC": "Acceleration", "DEC": "Deceleration"}
#: Commands of motion.
MOTION = (
    *(order(name, f"{{<AxisID> <{text}>}}", f"Set Closed-Loop {text}", _set_acceleration(name))
      for name, text in _RATES.items()),
    *(_of_axes(f"{name}?", f"Get Closed-Loop {text}", lambda s, a, n=name: s.accelerations[n][a])
      for name, text in _RATES.items()),
    order("ATZ", "[{<AxisID> <LowValue>}]", "Set Automatic Zero Point", _set_zero, moves=True),
    _of_axes("ATZ?", "Get Automatic Zero Point State", lambda s, a: not s.device.zeroing(a),
             poll=True),
    # stored without effect: the simulated amplifiers have no drift
    order("DCO", _SWITCHED, "Set Drift Compensation Mode",
          lambda s, switches: s.drift_compensation.update(switches)),
    _of_axes("DCO?", "Get Drift Compensation Mode", lambda s, a: s.drift_compensation[a]),
    order("DFH", _AXES, "Define Home Position",
          lambda s, axes: s.homes.update({axis: s.device.position(axis) for axis in axes})),
    _of_axes("DFH?", "Get Home Position", _length(lambda s, a: s.homes[a])),
    order("EAX", _SWITCHED, "Enable Axis", _enable),
    _of_axes("EAX?", "Get Axis Enable State", lambda s, a: a not in s.disabled),
    order("FNL", _AXES, "Move To Negative Limit", _reference(0.0, Refusal.NO_LIMIT_SWITCH),
          moves=True),
    order("FPL", _AXES, "Move To Positive Limit", _reference(1.0, Refusal.NO_LIMIT_SWITCH),
          moves=True),
    order("FRF", _AXES, "Move To Reference Switch", _reference(0.5, Refusal.NO_REFERENCE_SENSOR),
          moves=True),
    _of_axes("FRF?", "Get Referencing Result", lambda s, a: s.referenced(a)),
    order("GOH", _AXES, "Go To Home Position", _go_home, moves=True),
    GcsCommand("HLT", _AXES, "Halt Motion Smoothly", halt),
    order("IMP", "<AxisID>", "Strike The Stage With A Hammer, Drives Taken Out", _strike,
          moves=True),
    order("MOV", "{<AxisID> <Position>}", "Set Target Position", _move(relative=False), moves=True),
    _of_axes("MOV?", "Get Target Position", _length(lambda s, a: s.device.target(a))),
    order("MVR", "{<AxisID> <Distance>}", "Set Target Relative", _move(relative=True), moves=True),
    order("NLM", "{<AxisID> <LowLimit>}", "Set Low Position Soft Limit", _soft_limit(False, 0)),
    _of_axes("NLM?", "Get Low Position Soft Limit", _length(lambda s, a: s.soft(a, False)[0])),
    GcsCommand("ONL", "[<OutputID>] <State>", "Set Control Mode", _set_online, changes=True,
               free=True),
    GcsCommand("ONL?", "[{<OutputID>}]", "Get Control Mode", _online, free=True),
    _of_axes("ONT?", "Get On-Target State", lambda s, a: s.device.on_target(a), poll=True),
    order("PLM", "{<AxisID> <HighLimit>}", "Set High Position Soft Limit", _soft_limit(False, 1)),
    _of_axes("PLM?", "Get High Position Soft Limit", _length(lambda s, a: s.soft(a, False)[1])),
    _of_axes("POS?", "Get Real Position", _length(lambda s, a: s.device.position(a))),
    _of_axes("PUN?", "Get Axis Unit", lambda s, _: s.model.unit),
    order("RON", _SWITCHED, "Set Reference Mode", _reference_mode),
    _of_axes("RON?", "Get Reference Mode", lambda s, a: s.reference_mode[a]),
    GcsCommand("STP", "", "Stop All Axes", _stop, free=True),
    order("SVA", "{<AxisID> <Amplitude>}", "Set Open-Loop Voltage", _set_voltage, moves=True),
    _of_axes("SVA?", "Get Open-Loop Voltage", lambda s, a: s.device.command(a)),
    order("SVO", "{<AxisID> <ServoState>}", "Set Servo Mode", _switch_servo, moves=True),
    _of_axes("SVO?", "Get Servo Mode", lambda s, a: s.device.servo_on(a)),
    _of_axes("TCV?", "Get Commanded Velocity", _length(lambda s, a: s.device.speed(a))),
    _of_axes("TMN?", "Get Minimum Commandable Position",
             _length(lambda s, a: s.position_range(a)[0])),
    _of_axes("TMX?", "Get Maximum Commandable Position",
             _length(lambda s, a: s.position_range(a)[1])),
    question("TSP?", "[{<InputID>}]", "Get Input Signal Position",
             lambda s, name: s.device.channel(int(name)) / MICRO),
    order("VCO", _SWITCHED, "Set Velocity Control Mode", _set_speed_control),
    _of_axes("VCO?", "Get Velocity Control Mode", lambda s, a: a not in s.free_speeds),
    order("VEL", "{<AxisID> <Velocity>}", "Set Velocity", _set_speed, moves=True),
    _of_axes("VEL?", "Get Velocity",
             _length(lambda s, a: s.free_speeds.get(a, s.device.speed(a)))),
    order("VMA", "{<OutputID> <MaxVoltage>}", "Set Maximum Output Voltage", _soft_limit(True, 1)),
    _of_outputs("VMA?", "Get Maximum Output Voltage", lambda s, a: s.soft(a, True)[1]),
    order("VMI", "{<OutputID> <MinVoltage>}", "Set Minimum Output Voltage", _soft_limit(True, 0)),
    _of_outputs("VMI?", "Get Minimum Output Voltage", lambda s, a: s.soft(a, True)[0]),
    _of_outputs("VOL?", "Get Voltage Of Output Channel", lambda s, a: s.device.voltage(a)),
)  # fmt: skip
