"""What is looked at before the first sample of a waveform: values, slopes, and how it begins.

Texts are rounded: a value may pass the end of a range by a millionth of the range, and is then
taken as the end; a slope may pass its limit by a thousandth.
"""

import numpy as np

from flexstage.arrays import Array
from flexstage.instruments.twin.axis_state import AxisState
from flexstage.instruments.twin.device import Refusal, RefusedError

_VALUE, _SLOPE = 1e-6, 1e-3


def require_within(
    axis: str, values: Array, bounds: tuple[float, float] | None, unit: str
) -> Array:
    """Refuse values [m, or V] outside a range; return them, led to its ends where rounding missed.

    Nothing is refused where the range is not known.
    """
    scale, shown = (1e6, "um") if unit == "m" else (1.0, unit)
    if not np.isfinite(values).all():
        raise RefusedError(Refusal.BAD_VALUE, f"axis '{axis}' cannot be sent to what is no number")
    if bounds is None:
        return values
    low, high = bounds
    slack = _VALUE * (high - low)
    worst = values[np.argmax(np.maximum(low - values, values - high))]
    if not low - slack <= worst <= high + slack:
        raise RefusedError(
            Refusal.OUT_OF_LIMITS,
            f"axis '{axis}' cannot be sent to {worst * scale:g} {shown}: its limits are "
            f"{low * scale:g} to {high * scale:g} {shown}",
        )
    return np.clip(values, low, high)


def check_wave(
    state: AxisState,
    samples: Array,
    cycles: int,
    divider: int,
    present: float,
    *,
    shift: float = 0.0,
) -> Array:
    """Check a waveform whole, and return what is to be run [m, or V].

    It runs `cycles` times, `divider` samples of the loop for one of the table, from where the axis
    stands at present; each cycle begins by `shift` further than the one before [m, or V].

    A step between samples of the table takes the time of one of them, that from where the axis
    stands to the first of them one sample of the loop, however slow the table is.
    """
    axis, unit = state.description.name, "m" if state.servo else "V"
    limits = state.description.limits
    bounds = limits.position if state.servo else limits.voltage
    samples = require_within(axis, samples, bounds, unit)
    if shift and not cycles:
        raise RefusedError(
            Refusal.OUT_OF_LIMITS,
            f"the waveform of axis '{axis}' goes further with each cycle, and has no last one",
        )
    if shift:
        require_within(axis, samples + shift * (cycles - 1), bounds, unit)
    largest = state.largest_rate * state.period
    joined = cycles if not shift else 1  # a cycle begins where the one before has ended
    _check_steps(axis, samples, joined, largest * divider, unit)
    jump = abs(float(samples[0]) - present)
    if jump > largest * (1.0 + _SLOPE):
        scale, shown = _shown(unit)
        raise RefusedError(
            Refusal.OUT_OF_LIMITS,
            f"axis '{axis}' stands at {present * scale:g} {shown}, and its waveform begins at "
            f"{samples[0] * scale:g} {shown}: move it there first",
        )
    return samples


def check_feedforward(
    state: AxisState, voltages: Array, size: int, cycles: int, divider: int
) -> Array:
    """Check the voltages [V] beside a waveform of positions, of as many samples."""
    axis = state.description.name
    if not state.servo:
        raise RefusedError(
            Refusal.SERVO_OFF,
            f"axis '{axis}' has a feedforward table chosen, which runs only beside its control: "
            "switch that on, or choose no feedforward",
        )
    if voltages.size != size:
        raise RefusedError(
            Refusal.BAD_VALUE,
            f"the feedforward of axis '{axis}' has {voltages.size} samples and its waveform "
            f"{size}: they must be as many",
        )
    voltages = require_within(axis, voltages, state.description.limits.voltage, "V")
    _check_steps(axis, voltages, cycles, state.largest_slew * state.period * divider, "V")
    return voltages


def _check_steps(axis: str, values: Array, cycles: int, largest: float, unit: str) -> None:
    steps = np.abs(np.diff(values if cycles == 1 else np.append(values, values[0])))
    if not steps.size or (worst := float(steps.max())) <= largest * (1.0 + _SLOPE):
        return
    k = int(steps.argmax())
    scale, shown = _shown(unit)
    where = f"sample {k + 1}" if k + 1 < values.size else "its last sample, to the first,"
    raise RefusedError(
        Refusal.OUT_OF_LIMITS,
        f"axis '{axis}' cannot follow a step of {worst * scale:g} {shown} from {where} on: "
        f"{largest * scale:g} {shown} is the most in the time of one sample",
    )


def _shown(unit: str) -> tuple[float, str]:
    return (1e6, "um") if unit == "m" else (1.0, unit)
