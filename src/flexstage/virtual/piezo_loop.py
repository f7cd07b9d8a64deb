"""The loop of a piezo stage, one sample after the other: drives, modes, sensors, control.

In sample k the stage is led from the time of sample k - 1 to its own, with what the converters hold
since then. Then it is read. The control takes the reading of sample k - 1, which has just been
converted; what it computes is put out in sample k + 1.

Compiled loops are kept beside this file and not made anew when only the steps of the stacks change:
touch this file then.
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
    """Converters and amplifiers, one row an axis."""

    converter: Array
    """Lowest and highest voltage [V], step of the converter [V] (0 for none), shape (axes, 3)."""
    amplifier: Array
    """Step over time constant [1], largest rate times time constant [V], shape (axes, 2)."""


class ModeArrays(NamedTuple):
    """Modes of the stage with the stacks in place, as they are stepped."""

    force: Array
    """Where a free displacement of 1 m leads each mode, shape (axes, k)."""
    transition: Array
    """From deflection and rate to the same a sample later, shape (4, k)."""
    moments: Array
    """What a force, and its derivative, do in a sample, shape (3, k)."""
    reader: Array
    """What the sensors of the axes see of each mode [1], shape (axes, k)."""


class SensorArrays(NamedTuple):
    """What lies between modes and readings."""

    bow: Array
    """Motion along axis a that another axis causes by its guide, polynomials in the position of
    that axis, from the constant up; entry (a, s), shape (axes, axes, 6).
    """
    gain: Array
    """Reading over motion [1], shape (axes,)."""
    step: float
    """Smallest step of a reading [m]; 0 for none."""


class ServoArrays(NamedTuple):
    """Settings of the control, one row an axis."""

    on: Flags
    """Whether it is on, shape (axes,)."""
    begins: Flags
    """Whether it was off before, shape (axes,); cleared."""
    gains: Array
    """Proportional gain [V/m], integral gain times step [V/m], shape (axes, 2)."""
    filters: NDArray[np.int64]
    """Number of filters, shape (axes,)."""
    sections: Array
    """b0, b1, b2, a1, a2 of each, shape (axes, most, 5)."""


class LoopState(NamedTuple):
    """What the loop remembers beside the stacks; changed in place."""

    axis: Array
    """Of each axis: voltage that its converter holds, voltage to be put out next, voltage of the
    amplifier [V], last reading [m], integral [V], last feedforward [V] (NaN for none), last free
    displacement [m], shape (axes, 7).
    """
    modes: Array
    """Deflections, rates [per sample], and last forces of the modes [m], shape (3, k)."""
    filters: Array
    """Two numbers of each filter, shape (axes, most, 2)."""


class LoopSignals(NamedTuple):
    """What goes into some samples of the loop, and what comes of them, each of shape (axes, n)."""

    command: Array
    """A position [m] where control is on, else a voltage [V]."""
    feedforward: Array
    """Voltage that is added under control [V], NaN for none."""
    drift: Array
    """Drift of the platform [m]; more rows may follow."""
    noise: Array
    """Noise of the sensors [m]; more rows may follow."""
    reading: Array
    """Written: what the sensors read [m]; more rows may follow."""
    position: Array
    """Written: true position [m]."""
    voltage: Array
    """Written: voltage at the stacks [V]."""
    asked: Array
    """Written: voltage that is asked of the amplifiers [V]."""


@compiled
def run_loop(
    drives: DriveArrays,
    stacks: StackArrays,
    memory: StackState,
    modes: ModeArrays,
    sensors: SensorArrays,
    servo: ServoArrays,
    state: LoopState,
    signals: LoopSignals,
) -> None:
    """Run some samples; `memory` and `state` are changed, and what comes of it is written."""
    command, feedforward, drift, noise, reading, position, voltage, asked = signals
    axes, n = command.shape
    rise = np.empty(axes)
    own = np.empty(axes)
    for k in range(n):
        for a in range(axes):
            axis = state.axis[a]
            axis[2] = _amplify(axis[0], axis[2], drives.amplifier[a, 0], drives.amplifier[a, 1])
            voltage[a, k] = axis[2]
            free = step_stack(stacks, memory, a, axis[2])
            rise[a] = free - axis[6]
            axis[6] = free
        _move(modes, state.modes, rise)
        for a in range(axes):
            own[a] = _dot(modes.reader[a], state.modes[0])
        for a in range(axes):
            at = own[a] + drift[a, k]
            for s in range(axes):
                if s != a:
                    at += _polynomial(sensors.bow[a, s], own[s])
            position[a, k] = at
            seen = sensors.gain[a] * at + noise[a, k]
            if sensors.step > 0.0:
                seen = sensors.step * np.round(seen / sensors.step)
            reading[a, k] = seen
        for a in range(axes):
            axis = state.axis[a]
            if servo.on[a]:
                u = _control(
                    servo, drives.converter[a], axis, state.filters[a], a, command[a, k],
                    feedforward[a, k],
                )  # fmt: skip
            else:
                u = min(max(command[a, k], drives.converter[a, 0]), drives.converter[a, 1])
            axis[5] = feedforward[a, k]
            step = drives.converter[a, 2]
            if step > 0.0:
                low = drives.converter[a, 0]
                u = low + step * np.round((u - low) / step)
            asked[a, k] = u
            axis[0] = axis[1]
            axis[1] = u
            axis[3] = reading[a, k]


@compiled
def _amplify(target: float, u: float, h: float, threshold: float) -> float:
    """Follow a held voltage with one pole, and no faster than the threshold allows.

    As `Amplifier` does for any line, ten percent of the whole loop faster.
    """
    e = target - u
    if abs(e) > threshold:
        sign = 1.0 if e > 0.0 else -1.0
        slewing = abs(e) / threshold - 1.0
        if slewing >= h:
            return u + sign * threshold * h
        return target - sign * threshold * math.exp(slewing - h)
    return target - e * math.exp(-h)


@compiled
def _move(modes: ModeArrays, state: Array, rise: Array) -> None:
    """Step all modes, their forces on straight lines."""
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
    """A sum of products, in four sums side by side; the size is a multiple of 4."""
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
    converter: Array,
    axis: Array,
    filters: Array,
    a: int,
    wanted: float,
    feedforward: float,
) -> float:
    """Return the next voltage: filters, then proportional and integral terms, then the range."""
    fresh = servo.begins[a]
    if fresh:
        servo.begins[a] = False
        filters[:] = 0.0
    e = wanted - axis[3]
    for i in range(servo.filters[a]):
        b0, b1, b2, a1, a2 = servo.sections[a, i]
        y = b0 * e + filters[i, 0]
        filters[i, 0] = b1 * e - a1 * y + filters[i, 1]
        filters[i, 1] = b2 * e - a2 * y
        e = y
    forward = 0.0 if np.isnan(feedforward) else feedforward
    before = 0.0 if np.isnan(axis[5]) else axis[5]
    if fresh:
        # the first voltage is the last one
        axis[4] = axis[1] - forward - (servo.gains[a, 0] + servo.gains[a, 1]) * e
    elif np.isnan(feedforward) != np.isnan(axis[5]):
        axis[4] += before - forward
    low, high = converter[0], converter[1]
    integral = axis[4] + servo.gains[a, 1] * e
    u = forward + servo.gains[a, 0] * e + integral
    # at an end of the range it stands still, but it may come back from there
    if not ((u > high and e > 0.0) or (u < low and e < 0.0)):
        axis[4] = integral
    return min(max(u, low), high)


def amplifier_of(drive: ModelDrive) -> Amplifier:
    """Return the amplifier of a drive after checking that it has one, of gain 1."""
    if drive.amplifier is None or drive.amplifier.gain != 1.0:
        raise ModelError(f"drive '{drive.name}' needs an amplifier of gain 1 to be run in a loop")
    return drive.amplifier


def sampled_response(
    model: DynamicModel, drive: str, probe: str, frequency_hz: ArrayLike, *, slope: float
) -> Complex:
    r"""Return reading over voltage asked for [m/V], for small signals, exactly as it is sampled.

    `slope` is that of the stack, without creep [m/V]. With z the shift by one sample, from the
    voltage that is asked for to the position in the same sample:

    .. math:: \frac{Y}{U} = z^{-1} \cdot \frac{(1 - d) z^{-1}}{1 - d z^{-1}} \cdot s \cdot C(z)
              \cdot \sum_i r_i g_i M_i(z)

    converter, amplifier, slope of the stack, creep, modes. A mode and a lag are driven by straight
    lines between the samples, as in the loop itself.
    """
    f = np.asarray(frequency_hz, dtype=np.float64)
    late = np.exp(-2j * np.pi * f * model.step)
    given = model.drive(drive)
    d = math.exp(-model.step / amplifier_of(given).time_constant)
    total = slope * late * (1.0 - d) * late / (1.0 - d * late)
    if given.creep is not None:
        ratio = model.step / given.creep.time_constants
        decay, ramp = decay_share(ratio), ramp_share(ratio)
        lag = decay * late[:, None] + ramp * (1.0 - late[:, None])
        lag /= 1.0 - (1.0 - decay) * late[:, None]
        total = total * (1.0 + lag @ given.creep.lag_gains)
    step = unit_step(model.omega * model.step, model.damping_ratio)
    weights = given.modal_gain * model.probe_shapes[model.row(probe)]
    return total * _sum_of_modes(step, weights, late)


def _sum_of_modes(unit: UnitStep, weights: Array, late: Complex) -> Complex:
    """Sum of the modes, each a state of two that a force on straight lines drives."""
    t, m = unit.transition, unit.moments
    step = late[:, None]
    by_z = m[1] * step + m[2] * (1.0 - step)
    by_v = m[0] * step + m[1] * (1.0 - step)
    # (1 - zz/z) a - zv/z b = by_z;  -vz/z a + (1 - vv/z) b = by_v
    one, four = 1.0 - t[0] * step, 1.0 - t[3] * step
    a = (four * by_z + t[1] * step * by_v) / (one * four - t[1] * t[2] * step**2)
    return a @ weights
