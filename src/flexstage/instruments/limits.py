"""Checks of commands against the limits of a stage, before any command is sent.

The checks cover values, slopes and steps of complete waveforms. For rounding, a value may exceed
its range by 1e-9 of the range, and a slope its limit by 1e-9 of the limit.
"""

import math
from collections.abc import Mapping

import numpy as np

from flexstage.base.arrays import Array
from flexstage.base.errors import LimitError, ModelError
from flexstage.instruments.protocol import Quantity, Waveform
from flexstage.stage.limits import AxisLimits

_ROUNDING = 1e-9


def check_position(limits: AxisLimits, value: float, axis: str) -> None:
    """Refuse a position [m] outside the limits of an axis; an unknown range has no limits.

    Examples
    --------
    >>> check_position(AxisLimits(position=(0.0, 1e-4)), 1.2e-4, "x")
    Traceback (most recent call last):
    flexstage.base.errors.LimitError: axis 'x' cannot be sent to 120 um: its limits are 0 to 100 ...
    """
    _check_value(limits, float(value), axis, "position")


def check_voltage(limits: AxisLimits, value: float, axis: str) -> None:
    """Refuse a voltage [V] outside the limits of a drive, or for a drive without voltage.

    Examples
    --------
    >>> check_voltage(AxisLimits(voltage=(-20.0, 120.0)), -20.0, "x")
    """
    _require_voltage(limits, axis)
    _check_value(limits, float(value), axis, "voltage")


def check_waveform(
    limits: Mapping[str, AxisLimits],
    waveform: Waveform,
    *,
    cycles: int = 1,
    start: Mapping[str, float] | None = None,
    tolerance: float = 0.0,
) -> None:
    """Refuse a waveform with a sample, slope or step outside the limits of its axis.

    Every sample is compared with the range of the axis, and every step between samples with its
    speed or slew. So are the step from the last sample to the first where the waveform is repeated,
    and the step from the present value to the first sample, which takes one sample. 0 cycles
    repeat the waveform endlessly. `start` is the present value by axis [m, or V]; axes without one
    are not checked. `tolerance` is added to the allowed first step, such as for the noise of a
    reading.

    Examples
    --------
    >>> ramp = Waveform(values={"x": np.array([0.0, 60.0, 120.0])}, sample_rate_hz=10.0,
    ...                 quantity="voltage")
    >>> check_waveform({"x": AxisLimits(voltage=(0.0, 120.0), slew=600.0)}, ramp)
    >>> check_waveform({"x": AxisLimits(voltage=(0.0, 120.0), slew=600.0)}, ramp, cycles=2)
    Traceback (most recent call last):
    flexstage.base.errors.LimitError: axis 'x' would step by -120 V from the last sample ...
    """
    if cycles < 0:
        raise LimitError(f"the number of cycles must be 0 (endless) or more, got {cycles}")
    quantity = waveform.quantity
    for axis, values in waveform.values.items():
        if axis not in limits:
            raise LimitError(
                f"the waveform moves axis '{axis}', but the axes of the instrument are "
                f"{', '.join(map(repr, limits)) or 'none'}: name one of these"
            )
        allowed, v = limits[axis], np.asarray(values, dtype=np.float64)
        if quantity == "voltage":
            _require_voltage(allowed, axis)
        _check_samples(allowed, v, axis, waveform)
        _check_slopes(allowed, v, axis, waveform)
        if cycles != 1:
            _check_repetition(allowed, float(v[0] - v[-1]), axis, waveform)
        if start is not None and axis in start:
            _check_start(allowed, float(start[axis]), float(v[0]), axis, waveform, tolerance)


def check_feedforward(
    limits: Mapping[str, AxisLimits],
    waveform: Waveform,
    feedforward: Waveform,
    *,
    cycles: int = 1,
) -> None:
    """Refuse a feedforward that is not voltages within their limits for a waveform of positions."""
    if (waveform.quantity, feedforward.quantity) != ("position", "voltage"):
        raise ModelError(
            "a feedforward consists of voltages for a waveform of positions, got "
            f"{feedforward.quantity} for {waveform.quantity}"
        )
    check_waveform(limits, feedforward, cycles=cycles)


def range_of(limits: AxisLimits, quantity: Quantity) -> tuple[float, float] | None:
    """Return the range of voltages [V] or positions [m]; None where it is not known."""
    return limits.voltage if quantity == "voltage" else limits.position


def rate_of(limits: AxisLimits, quantity: Quantity) -> float | None:
    """Return the largest slew [V/s] or speed [m/s]; None where it is not known."""
    return limits.slew if quantity == "voltage" else limits.speed


def _slack(bounds: tuple[float, float]) -> float:
    return _ROUNDING * (bounds[1] - bounds[0])


def _require_voltage(limits: AxisLimits, axis: str) -> None:
    if limits.voltage is None:
        raise LimitError(
            f"axis '{axis}' accepts no voltage, or its voltage range is unknown: command "
            "positions, or give the voltage range of its drive in the stage file"
        )


def _check_value(limits: AxisLimits, value: float, axis: str, quantity: Quantity) -> None:
    if not math.isfinite(value):
        raise LimitError(f"axis '{axis}' cannot be sent to {value}: give a finite {quantity}")
    bounds = range_of(limits, quantity)
    if bounds is None:
        return
    if not bounds[0] - _slack(bounds) <= value <= bounds[1] + _slack(bounds):
        raise LimitError(
            f"axis '{axis}' cannot be sent to {_text(value, quantity)}: its limits are "
            f"{_span(bounds, quantity)}, so choose a {quantity} between them"
        )


def _check_samples(limits: AxisLimits, v: Array, axis: str, waveform: Waveform) -> None:
    bounds = range_of(limits, waveform.quantity)
    if bounds is None:
        return
    slack = _slack(bounds)
    outside = (v < bounds[0] - slack) | (v > bounds[1] + slack)
    if outside.any():
        k = int(np.argmax(outside))
        raise LimitError(
            f"axis '{axis}' would be sent to {_text(float(v[k]), waveform.quantity)} at sample {k} "
            f"({k / waveform.sample_rate_hz:g} s), and its limits are "
            f"{_span(bounds, waveform.quantity)} ({int(outside.sum())} of {v.size} samples are "
            "outside): reduce the amplitude, or shift the mean"
        )


def _check_slopes(limits: AxisLimits, v: Array, axis: str, waveform: Waveform) -> None:
    rate = rate_of(limits, waveform.quantity)
    if rate is None:
        return
    slopes = np.diff(v) * waveform.sample_rate_hz
    fast = np.abs(slopes) > rate * (1.0 + _ROUNDING)
    if fast.any():
        k, quantity = int(np.argmax(fast)), waveform.quantity
        raise LimitError(
            f"axis '{axis}' would change at {_text(abs(float(slopes[k])), quantity)}/s after "
            f"sample {k} ({k / waveform.sample_rate_hz:g} s), and its limit is "
            f"{_text(rate, quantity)}/s; the largest slope is "
            f"{_text(float(np.abs(slopes).max()), quantity)}/s: run it more slowly, or reduce the "
            "amplitude"
        )


def _check_repetition(limits: AxisLimits, step: float, axis: str, waveform: Waveform) -> None:
    rate, quantity = rate_of(limits, waveform.quantity), waveform.quantity
    slope = abs(step) * waveform.sample_rate_hz
    if rate is not None and slope > rate * (1.0 + _ROUNDING):
        raise LimitError(
            f"axis '{axis}' would step by {_text(step, quantity)} from the last sample to the "
            f"first when the waveform repeats, at {_text(slope, quantity)}/s, and its limit is "
            f"{_text(rate, quantity)}/s: end the waveform at its first value, or run it once"
        )


def _check_start(
    limits: AxisLimits,
    present: float,
    first: float,
    axis: str,
    waveform: Waveform,
    tolerance: float,
) -> None:
    rate, quantity = rate_of(limits, waveform.quantity), waveform.quantity
    if not math.isfinite(present):
        raise LimitError(
            f"the {quantity} of axis '{axis}' reads {present}, so its distance from the first "
            "sample of the waveform is unknown: check its sensor and cable"
        )
    if rate is None:
        return
    allowed = rate * (1.0 + _ROUNDING) / waveform.sample_rate_hz + tolerance
    if abs(first - present) > allowed:
        raise LimitError(
            f"axis '{axis}' is at {_text(present, quantity)} and the waveform starts at "
            f"{_text(first, quantity)}, but the first step must not exceed "
            f"{_text(allowed, quantity)}: move the axis there first"
        )


def _text(value: float, quantity: Quantity) -> str:
    return f"{value:.6g} V" if quantity == "voltage" else f"{value * 1e6:.6g} um"


def _span(bounds: tuple[float, float], quantity: Quantity) -> str:
    scale = 1.0 if quantity == "voltage" else 1e6
    return f"{bounds[0] * scale:.6g} to {_text(bounds[1], quantity)}"
