"""Commands of motion: targets, voltages, position control, speed, limits, stop."""

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
    one,
    pairs,
    printed,
    switch,
)
from flexstage.instruments.pi.simulated.device import Refusal, RefusedError
from flexstage.instruments.pi.simulated.errors_gcs import GcsError
from flexstage.instruments.pi.simulated.gcs_state import MICRO, ControllerState


def halt(state: ControllerState, client: Client, words: Sequence[str] = ()) -> None:
    """Stop axes, and tell the client."""
    axes = [name for name, _ in chosen(words, state.axes, code.UNKNOWN_AXIS)]
    state.device.stop(axes if words else None)
    state.stops += 1
    client.error = code.STOPPED


def moving_bits(state: ControllerState) -> str:
    """Return what ``#5`` answers."""
    return f"{sum(1 << i for i, axis in enumerate(state.axes) if state.device.moving(axis)):X}"


def _stop(state: ControllerState, client: Client, words: Sequence[str]) -> Reply:
    """Stop first, whatever was said with it, and complain then."""
    halt(state, client)
    nothing(words)
    return None


def _halt(state: ControllerState, client: Client, words: Sequence[str]) -> Reply:
    halt(state, client, words)
    return None


def _move(relative: bool) -> Run:
    def run(state: ControllerState, _: Client, words: Sequence[str]) -> Reply:
        given = pairs(words, state.axes, code.UNKNOWN_AXIS)
        targets = {axis: number(word) * state.model.scale for axis, word in given}
        if relative:
            targets = {axis: state.device.target(axis) + v for axis, v in targets.items()}
        state.require_ready(targets)
        state.recorder.move(lambda: state.device.set_targets(targets))
        return None

    return run


def _set_voltage(relative: bool) -> Run:
    def run(state: ControllerState, _: Client, words: Sequence[str]) -> Reply:
        given = pairs(words, state.axes, code.UNKNOWN_AXIS)
        voltages = {axis: number(word) for axis, word in given}
        if relative:
            voltages = {axis: state.device.command(axis) + v for axis, v in voltages.items()}
        state.require_ready(voltages, voltages=True)
        try:
            state.recorder.move(lambda: state.device.set_commands(voltages))
        except RefusedError as error:
            if error.reason is Refusal.OUT_OF_LIMITS:
                raise GcsError(code.VOLTAGE_OUT_OF_LIMITS) from error
            raise
        return None

    return run


def _switch_servo(state: ControllerState, _: Client, words: Sequence[str]) -> Reply:
    given = [(axis, switch(w)) for axis, w in pairs(words, state.axes, code.UNKNOWN_AXIS)]
    for axis, on in given:
        if on and axis in state.disabled:
            raise GcsError(code.SWITCHED_OFF)
    for axis, on in given:
        if on != state.device.servo_on(axis):
            state.device.set_servo(axis, on)
    return None


def _set_speed(state: ControllerState, _: Client, words: Sequence[str]) -> Reply:
    scale = state.model.scale
    given = [(axis, number(w) * scale) for axis, w in pairs(words, state.axes, code.UNKNOWN_AXIS)]
    for axis, speed in given:
        largest = state.axes[axis].limits.speed
        if not speed > 0.0 or (largest is not None and speed > largest * (1.0 + 1e-9)):
            raise GcsError(code.SPEED_OUT_OF_LIMITS)
    for axis, speed in given:
        if axis in state.free_speeds:
            state.free_speeds[axis] = speed
        else:
            state.device.set_speed(axis, speed)
    return None


def _strike(state: ControllerState, _: Client, words: Sequence[str]) -> Reply:
    axis = one(words, state.axes)
    if not state.device.drives_removed():
        raise GcsError(code.NOT_POSSIBLE)
    state.recorder.run(lambda: state.device.strike(axis))
    return None


def of_axes(value: Callable[[ControllerState, str], str]) -> Run:
    """Return a command that tells something of each axis that is named, or of all."""

    def run(state: ControllerState, _: Client, words: Sequence[str]) -> Reply:
        axes = chosen(words, state.axes, code.UNKNOWN_AXIS)
        return [f"{axis}={value(state, axis)}" for axis, _ in axes]

    return run


def _of_outputs(value: Callable[[ControllerState, str], float]) -> Run:
    def run(state: ControllerState, _: Client, words: Sequence[str]) -> Reply:
        outputs = chosen(words, state.outputs, code.UNKNOWN_CHANNEL)
        return [f"{name}={printed(value(state, axis))}" for name, axis in outputs]

    return run


def of_inputs(value: Callable[[ControllerState, int], str]) -> Run:
    """Return a command that tells something of each input that is named, or of those listed."""

    def run(state: ControllerState, _: Client, words: Sequence[str]) -> Reply:
        names = words or list(state.channels)[: state.model.inputs]
        channels = chosen(names, state.channels, code.UNKNOWN_CHANNEL)
        return [f"{name}={value(state, channel.number)}" for name, channel in channels]

    return run


def _input(state: ControllerState, number_of_input: int) -> str:
    return printed(state.device.channel(number_of_input) / MICRO)


def _length(
    value: Callable[[ControllerState, str], float],
) -> Callable[[ControllerState, str], str]:
    return lambda state, axis: printed(value(state, axis) / state.model.scale)


def _flag(value: Callable[[ControllerState, str], bool]) -> Callable[[ControllerState, str], str]:
    return lambda state, axis: str(int(value(state, axis)))


def _speed(state: ControllerState, axis: str) -> float:
    return state.free_speeds.get(axis, state.device.speed(axis))


def _soft(state: ControllerState, axis: str, end: int) -> float:
    return state.soft_positions.get(axis, state.position_range(axis))[end]


def _soft_voltage(state: ControllerState, axis: str, end: int) -> float:
    return state.soft_voltages.get(axis, state.voltage_range(axis))[end]


def _low(state: ControllerState, axis: str) -> float:
    return state.position_range(axis)[0]


def _high(state: ControllerState, axis: str) -> float:
    return state.position_range(axis)[1]


def _voltage_command(state: ControllerState, axis: str) -> str:
    return printed(state.device.command(axis))


def _question(name: str, text: str, run: Run, *, poll: bool = False) -> GcsCommand:
    return GcsCommand(name, "[{<AxisID>}]", text, run, poll=poll)


def _change(name: str, arguments: str, text: str, run: Run) -> GcsCommand:
    return GcsCommand(name, arguments, text, run, changes=True, moves=True)


#: Commands of motion.
MOTION = (
    _question("FRF?", "Get Referencing Result", of_axes(_flag(lambda s, a: s.referenced(a)))),
    GcsCommand("HLT", "[{<AxisID>}]", "Halt Motion Smoothly", _halt),
    _change("IMP", "<AxisID>", "Strike The Stage With A Hammer, Drives Taken Out", _strike),
    _change("MOV", "{<AxisID> <Position>}", "Set Target Position", _move(relative=False)),
    _question("MOV?", "Get Target Position", of_axes(_length(lambda s, a: s.device.target(a)))),
    _change("MVR", "{<AxisID> <Distance>}", "Set Target Relative", _move(relative=True)),
    _question("NLM?", "Get Low Position Soft Limit", of_axes(_length(lambda s, a: _soft(s, a, 0)))),
    _question("ONT?", "Get On-Target State", of_axes(_flag(lambda s, a: s.device.on_target(a))),
              poll=True),
    _question("PLM?", "Get High Position Soft Limit",
              of_axes(_length(lambda s, a: _soft(s, a, 1)))),
    _question("POS?", "Get Real Position", of_axes(_length(lambda s, a: s.device.position(a)))),
    _question("PUN?", "Get Axis Unit", of_axes(lambda s, _: s.model.unit)),
    GcsCommand("STP", "", "Stop All Axes", _stop),
    _change("SVA", "{<AxisID> <Amplitude>}", "Set Open-Loop Voltage", _set_voltage(relative=False)),
    _question("SVA?", "Get Open-Loop Voltage", of_axes(_voltage_command)),
    _change("SVO", "{<AxisID> <ServoState>}", "Set Servo Mode", _switch_servo),
    _question("SVO?", "Get Servo Mode", of_axes(_flag(lambda s, a: s.device.servo_on(a)))),
    _change("SVR", "{<AxisID> <Difference>}", "Set Relative Open-Loop Voltage", _set_voltage(True)),
    _question("TMN?", "Get Minimum Commandable Position", of_axes(_length(_low))),
    _question("TMX?", "Get Maximum Commandable Position", of_axes(_length(_high))),
    GcsCommand("TSP?", "[{<InputID>}]", "Get Input Signal Position", of_inputs(_input)),
    _change("VEL", "{<AxisID> <Velocity>}", "Set Velocity", _set_speed),
    _question("VEL?", "Get Velocity", of_axes(_length(_speed))),
    GcsCommand("VMA?", "[{<OutputID>}]", "Get Maximum Output Voltage",
               _of_outputs(lambda s, a: _soft_voltage(s, a, 1))),
    GcsCommand("VMI?", "[{<OutputID>}]", "Get Minimum Output Voltage",
               _of_outputs(lambda s, a: _soft_voltage(s, a, 0))),
    GcsCommand("VOL?", "[{<OutputID>}]", "Get Voltage Of Output Channel",
               _of_outputs(lambda s, a: s.device.voltage(a))),
)  # fmt: skip
