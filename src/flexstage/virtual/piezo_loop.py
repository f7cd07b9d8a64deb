"""The control loop of a piezo stage, sample by sample: drives, modes, sensors, servo.

In sample k the stage moves from the time of sample k - 1 to its own, with the voltages that the
converters have held since then. Then the sensors read it. The servo uses the reading of sample
k - 1, which has just been converted; its result is put out in sample k + 1.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from flexstage.base.arrays import Array, Complex
from flexstage.base.errors import ModelError
from flexstage.hysteresis.chain.amplifier import Amplifier
from flexstage.hysteresis.chain.lag import decay_share, ramp_share
from flexstage.hysteresis.chain.modal import UnitStep, unit_step
from flexstage.hysteresis.compiled import compiled
from flexstage.hysteresis.dynamic_model import DynamicModel, ModelDrive
from flexstage.virtual.stack import StackArrays, StackState, step_stack

Flags = NDArray[np.bool_]


class DriveArrays(NamedTuple):
    """Converters and amplifiers; each of shape (axes,)."""

    lowest: Array
    """Lowest voltage of the converter [V]."""
    highest: Array
    """Highest voltage of the converter [V]."""
    resolution: Array
    """Step of the converter [V]; 0 for none."""
    step_ratio: Array
    """Time step over time constant of the amplifier [1]."""
    slew_threshold: Array
    """Error above which the amplifier slews: largest rate times time constant [V]."""


class ModeArrays(NamedTuple):
    """Modes of the stage with its stacks in place, stepped exactly."""

    force: Array
    """Static deflection of each mode for a free displacement of 1 m, and for a unit of each source
    of disturbance, shape (axes + sources, k).
    """
    transition: Array
    """Deflection and rate after a sample by those before: zz, zv, vz, vv, shape (4, k)."""
    moments: Array
    """Response to a force and to its derivative over a sample, shape (3, k)."""
    reader: Array
    """Shape of each mode at the sensors of the axes [1], shape (axes, k)."""


class SensorArrays(NamedTuple):
    """Guide errors and sensors, between the modes and the readings."""

    guide: Array
    """Motion along axis a that the guide of axis s adds: polynomials in the position of s, from the
    constant up; entry (a, s), shape (axes, axes, 6).
    """
    gain: Array
    """Reading over motion [1], shape (axes,)."""
    resolution: float
    """Smallest step of a reading [m]; 0 for none."""


class ServoArrays(NamedTuple):
    """Settings of the servos."""

    on: Flags
    """Servo on, shape (axes,)."""
    begins: Flags
    """Servo off in the sample before; the loop clears it, shape (axes,)."""
    gains: Array
    """Proportional gain, and integral gain times the time step [V/m], shape (axes, 2)."""
    filters: NDArray[np.int64]
    """Number of filters, shape (axes,)."""
    sections: Array
    """b0, b1, b2, a1, a2 of each filter, shape (axes, filters, 5)."""


class ServoState(NamedTuple):
    """State of the servos; changed in place."""

    integral: Array
    """Integral term [V], shape (axes,)."""
    feedforward: Array
    """Last feedforward [V], NaN for none, shape (axes,)."""
    filters: Array
    """State of each filter, shape (axes, filters, 2)."""


class LoopState(NamedTuple):
    """State of the loop but for the stacks; changed in place."""

    output: Array
    """Voltage that the converter puts out now [V], shape (axes,)."""
    next: Array
    """Voltage that the converter puts out next [V], shape (axes,)."""
    voltage: Array
    """Voltage behind the amplifier [V], shape (axes,)."""
    reading: Array
    """Last reading [m], shape (axes,)."""
    free: Array
    """Last free displacement of the stack [m], then value of each source, (axes + sources,)."""
    modes: Array
    """Deflections, rates [per sample] and last forces of the modes [m], shape (3, k)."""
    servo: ServoState
    """State of the servos."""


class LoopSignals(NamedTuple):
    """Signals over n samples of the loop, each of shape (axes, n) or with more rows."""

    command: Array
    """Input: position [m] under servo control, else voltage [V]."""
    feedforward: Array
    """Input: voltage added under servo control [V], NaN for none."""
    drift: Array
    """Input: drift of the platform [m]."""
    noise: Array
    """Input: noise of the sensors [m]."""
    hum: Array
    """Input: noise of the voltages behind the amplifiers [V]."""
    forced: Array
    """Input: sources of disturbance, shape (sources, n)."""
    reading: Array
    """Output: reading of the sensors [m]."""
    position: Array
    """Output: true position [m]."""
    voltage: Array
    """Output: voltage at the stacks [V]."""
    requested: Array
    """Output: voltage requested of the amplifiers [V]."""


@compiled
def run_loop(
    drives: DriveArrays,
    stacks: StackArrays,
    stack_state: StackState,
    modes: ModeArrays,
    sensors: SensorArrays,
    servo: ServoArrays,
    state: LoopState,
    signals: LoopSignals,
) -> None:
    """Run the samples of the signals; the states change in place."""
    axes, n = signals.command.shape
    rise = np.empty(state.free.size)
    local = np.empty(axes)  # positions by the modes alone
    for k in range(n):
        for a in range(axes):
            u = _amplify(
                state.output[a], state.voltage[a], drives.step_ratio[a], drives.slew_threshold[a]
            )
            state.voltage[a] = u
            u += signals.hum[a, k]
            signals.voltage[a, k] = u
            free = step_stack(stacks, stack_state, a, u)
            rise[a] = free - state.free[a]
            state.free[a] = free
        for s in range(axes, rise.size):
            rise[s] = signals.forced[s - axes, k] - state.free[s]
            state.free[s] = signals.forced[s - axes, k]
        _step_modes(modes, state.modes, rise)
        for a in range(axes):
            local[a] = _dot(modes.reader[a], state.modes[0])
        for a in range(axes):
            position = local[a] + signals.drift[a, k]
            for s in range(axes):
                if s != a:
                    position += _polynomial(sensors.guide[a, s], local[s])
            signals.position[a, k] = position
            reading = sensors.gain[a] * position + signals.noise[a, k]
            if sensors.resolution > 0.0:
                reading = sensors.resolution * np.round(reading / sensors.resolution)
            signals.reading[a, k] = reading
        for a in range(axes):
            low, high = drives.lowest[a], drives.highest[a]
            command, feedforward = signals.command[a, k], signals.feedforward[a, k]
            if servo.on[a]:
                e = command - state.reading[a]
                u = _control(servo, state.servo, a, e, state.next[a], feedforward, low, high)
            else:
                u = min(max(command, low), high)
            state.servo.feedforward[a] = feedforward
            step = drives.resolution[a]
            if step > 0.0:
                u = low + step * np.round((u - low) / step)
            signals.requested[a, k] = u
            state.output[a] = state.next[a]
            state.next[a] = u
            state.reading[a] = signals.reading[a, k]


@compiled
def _amplify(target: float, u: float, ratio: float, threshold: float) -> float:
    """Return the voltage of a one-pole amplifier of limited slew rate, a sample later.

    This is `Amplifier` for a held input; ten percent of the time of the whole loop is saved.
    """
    e = target - u
    if abs(e) > threshold:
        sign = 1.0 if e > 0.0 else -1.0
        slewing = abs(e) / threshold - 1.0
        if slewing >= ratio:
            return u + sign * threshold * ratio
        return target - sign * threshold * math.exp(slewing - ratio)
    return target - e * math.exp(-ratio)


@compiled
def _step_modes(modes: ModeArrays, state: Array, rise: Array) -> None:
    """Step all modes by a sample, their forces straight in time."""
    z, v, f = state[0], state[1], state[2]
    t, m = modes.transition, modes.moments
    for i in range(z.size):
        df = modes.force[0, i] * rise[0]
        for a in range(1, rise.size):
            df += modes.force[a, i] * rise[a]
        at, speed, last = z[i], v[i], f[i]
        z[i] = (t[0, i] * at + t[1, i] * speed) + (m[1, i] * last + m[2, i] * df)
        v[i] = (t[2, i] * at + t[3, i] * speed) + (m[0, i] * last + m[1, i] * df)
        f[i] = last + df


@compiled
def _dot(x: Array, y: Array) -> float:
    """Sum of products, in four partial sums; the size is a multiple of 4."""
    s0 = s1 = s2 = s3 = 0.0
    for i in range(0, x.size, 4):
        s0 += x[i] * y[i]
        s1 += x[i + 1] * y[i + 1]
        s2 += x[i + 2] * y[i + 2]
        s3 += x[i + 3] * y[i + 3]
    return (s0 + s1) + (s2 + s3)


@compiled
def _polynomial(c: Array, x: float) -> float:
    total = c[5]
    for i in range(4, -1, -1):
        total = total * x + c[i]
    return total


@compiled
def _control(
    servo: ServoArrays,
    state: ServoState,
    a: int,
    e: float,
    last: float,
    feedforward: float,
    low: float,
    high: float,
) -> float:
    """Return the next voltage of an axis for an error: filters, PI terms, limits.

    `last` is the voltage that is put out next, `low` and `high` are the limits [V].
    """
    proportional, integral_gain = servo.gains[a]
    filters = state.filters[a]
    first = servo.begins[a]
    if first:
        servo.begins[a] = False
        filters[:] = 0.0
    for i in range(servo.filters[a]):
        b0, b1, b2, a1, a2 = servo.sections[a, i]
        y = b0 * e + filters[i, 0]
        filters[i, 0] = b1 * e - a1 * y + filters[i, 1]
        filters[i, 1] = b2 * e - a2 * y
        e = y
    before = state.feedforward[a]
    forward = 0.0 if np.isnan(feedforward) else feedforward
    if first:
        # bumpless: the first voltage is the last one
        integral = last - forward - (proportional + integral_gain) * e
        state.integral[a] = integral
    elif np.isnan(feedforward) != np.isnan(before):
        state.integral[a] += (0.0 if np.isnan(before) else before) - forward
    integral = state.integral[a] + integral_gain * e
    u = forward + proportional * e + integral
    # anti-windup: at a limit the integral stops, but it may return
    if not ((u > high and e > 0.0) or (u < low and e < 0.0)):
        state.integral[a] = integral
    return min(max(u, low), high)


def amplifier_of(drive: ModelDrive) -> Amplifier:
    """Return the amplifier of a drive after checking that it has one, of gain 1."""
    if drive.amplifier is None or drive.amplifier.gain != 1.0:
        raise ModelError(f"drive '{drive.name}' needs an amplifier of gain 1 to run in a loop")
    return drive.amplifier


def sampled_response(
    model: DynamicModel, drive: str, probe: str, frequency_hz: ArrayLike, *, slope: float
) -> Complex:
    r"""Return the sampled response of the reading to the requested voltage [m/V], small signals.

    `slope` is that of the stack, without creep [m/V]. With z the shift by one sample, from the
    requested voltage to the position in the same sample:

    .. math:: \frac{Y}{U} = z^{-1} \cdot \frac{(1 - d) z^{-1}}{1 - d z^{-1}} \cdot s \cdot C(z)
              \cdot \sum_i r_i g_i M_i(z)

    The factors are converter, amplifier, slope of the stack, creep and modes. Inputs of modes and
    lags are straight lines between the samples, as in the loop.
    """
    f = np.asarray(frequency_hz, dtype=np.float64)
    late = np.exp(-2j * np.pi * f * model.step)
    model_drive = model.drive(drive)
    creep = model_drive.creep
    d = math.exp(-model.step / amplifier_of(model_drive).time_constant)
    total = slope * late * (1.0 - d) * late / (1.0 - d * late)
    if creep is not None:
        ratio = model.step / creep.time_constants
        decay, ramp = decay_share(ratio), ramp_share(ratio)
        lag = decay * late[:, None] + ramp * (1.0 - late[:, None])
        lag /= 1.0 - (1.0 - decay) * late[:, None]
        total = total * (1.0 + lag @ creep.lag_gains)
    step = unit_step(model.omega * model.step, model.damping_ratio)
    weights = model_drive.modal_gain * model.probe_shapes[model.row(probe)]
    return total * _sum_of_modes(step, weights, late)


def _sum_of_modes(unit: UnitStep, weights: Array, late: Complex) -> Complex:
    """Return the sampled response of all modes to a force of straight lines."""
    t, m = unit.transition, unit.moments
    step = late[:, None]
    by_z = m[1] * step + m[2] * (1.0 - step)
    by_v = m[0] * step + m[1] * (1.0 - step)
    # (1 - zz/z) a - zv/z b = by_z;  -vz/z a + (1 - vv/z) b = by_v
    one, four = 1.0 - t[0] * step, 1.0 - t[3] * step
    a = (four * by_z + t[1] * step * by_v) / (one * four - t[1] * t[2] * step**2)
    return a @ weights
