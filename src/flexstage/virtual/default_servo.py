"""Settings of a position control as a stage is delivered: slow enough to be safe."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from flexstage.arrays import Array
from flexstage.hysteresis.dynamic_model import DynamicModel, ModelDrive
from flexstage.system.servo import Notch, ServoSettings
from flexstage.virtual.piezo_loop import sampled_response
from flexstage.virtual.piezo_stage import PiezoAxis, stack_of

#: Largest of |1 / (1 + L)|: by it the gain may double (6 dB) before the loop is unstable.
_SENSITIVITY = 1.6
#: Part of the gain that would reach this.
_MODEST = 0.7
_NOTCH_DAMPING = 0.5
_GRID = 4000


def delivered_settings(
    model: DynamicModel, parts: Sequence[PiezoAxis], sample_rate_hz: float
) -> list[PiezoAxis]:
    """Give each axis an integral control with a notch at the mode that it excites most.

    Notes
    -----
    Validity: each axis by itself, at the steepest slope of its major loop, with all modes and the
    delay of the loop.
    """
    model = replace(model, step=1.0 / sample_rate_hz)
    natural = model.omega / (2.0 * np.pi)
    frequency = np.geomspace(0.1, 0.499 * sample_rate_hz, _GRID)
    # and close to each mode, whose peak is narrower than any grid
    near = natural[natural < 0.49 * sample_rate_hz]
    fine = near[:, None] * (1.0 + 0.05 * np.linspace(-1.0, 1.0, 201) ** 3)
    frequency = np.sort(np.concatenate((frequency, fine.ravel())))
    frequency = frequency[frequency < 0.5 * sample_rate_hz]
    out = []
    for part in parts:
        drive = model.drive(part.drive)
        response = sampled_response(
            model, part.drive, part.probe, frequency, slope=largest_slope(drive)
        ) * np.exp(-2j * np.pi * frequency / sample_rate_hz)
        weights = drive.modal_gain * model.probe_shapes[model.row(part.probe)]
        notches = _notch(np.abs(weights), natural, sample_rate_hz)
        unit = ServoSettings(integral=1.0, notches=notches)
        loop = response * unit.response(frequency, sample_rate_hz)
        settings = ServoSettings(integral=_MODEST * _largest_gain(loop), notches=notches)
        out.append(replace(part, settings=settings))
    return out


def largest_slope(drive: ModelDrive) -> float:
    """Return the steepest slope of the major loop of a virtual stack, without creep [m/V]."""
    low, high = drive.input_range or (0.0, 1.0)
    line = np.linspace(low, high, 300)
    u = np.concatenate([line, line[::-1], line, line[::-1]])
    du, dw = np.diff(u), np.diff(stack_of(drive).simulate(u).values)
    return float(np.max(dw[du != 0.0] / du[du != 0.0]))


def _notch(size: Array, frequency_hz: Array, sample_rate_hz: float) -> tuple[Notch, ...]:
    size[frequency_hz > 0.4 * sample_rate_hz] = 0.0
    if not np.any(size):
        return ()
    return (
        Notch(
            frequency_hz=float(frequency_hz[int(np.argmax(size))]),
            zero_damping=0.02,
            pole_damping=_NOTCH_DAMPING,
        ),
    )


def _largest_gain(loop: NDArray[np.complex128]) -> float:
    """Return the gain at which the sensitivity reaches its bound, coming from zero."""

    def peak(gain: float) -> float:
        return float(np.max(1.0 / np.abs(1.0 + gain * loop)))

    gain = 1e-3 / float(np.max(np.abs(loop)))
    while peak(gain) < _SENSITIVITY:
        gain *= 1.03
    low, high = gain / 1.03, gain
    for _ in range(40):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if peak(middle) < _SENSITIVITY else (low, middle)
    return low
