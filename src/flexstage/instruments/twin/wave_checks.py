"""What is looked at before the first sample of a waveform: values, slopes, and how it begins.

Texts are rounded: a value may pass the end of a range by a millionth of the range, and is then
taken as the end; a slope may pass its limit by a thousandth.
"""

import numpy as np
from numpy.typing import NDArray

from flexstage.instruments.twin.axis_state import AxisState
from flexstage.instruments.twin.device import Refusal, RefusedError

__all__ = ["check_feedforward", "check_wave", "require_within"]

Array = NDArray[np.float64]

_VALUE, _SLOPE = 1e-6, 1e-3


def require_within(
    axis: str, values: Array, bounds: tuple[float, float] | None, unit: str
) -> Array:
    """Refuse values outside a range.

    Parameters
    ----------
    axis : str
        The axis, for the sentence.
    values : numpy.ndarray
        Values [m, or V], shape (n,).
    bounds : tuple of float, optional
        The range; nothing is refused where it is not known.
    unit : {"m", "V"}
        Their unit.

    Returns
    -------
    numpy.ndarray
        The values, those beyond an end by rounding led to it.

    Raises
    ------
    RefusedError
        A value is no number, or outside the range.
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
    """Check a waveform whole.

    A step between samples of the table takes the time of one of them, that from where the axis
    stands to the first of them one sample of the loop, however slow the table is.

    Parameters
    ----------
    state : AxisState
        The axis.
    samples : numpy.ndarray
        The table [m, or V], shape (n,).
    cycles : int
        How often it runs; the step from its end to its start counts where that is not once.
    divider : int
        Samples of the loop for one of the table.
    present : float
        Where the axis stands [m, or V].
    shift : float
        How much further each cycle begins than the one before [m, or V].

    Returns
    -------
    numpy.ndarray
        What is to be run.

    Raises
    ------
    RefusedError
        A value, a slope or the first step is outside the limits.
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
    """Check the voltages beside a waveform of positions.

    Parameters
    ----------
    state : AxisState
        The axis.
    voltages : numpy.ndarray
        The table [V], shape (n,).
    size : int
        Samples of the waveform.
    cycles : int
        How often it runs.
    divider : int
        Samples of the loop for one of the table.

    Returns
    -------
    numpy.ndarray
        What is to be added.

    Raises
    ------
    RefusedError
        There is no control beside it, the lengths differ, or a value or slope is outside the
        limits.
    """
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
