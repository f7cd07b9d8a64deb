"""Tracking errors of a run: loop width, errors, and their repeatable and random parts."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from flexstage.base.arrays import Array
from flexstage.base.errors import RecordError
from flexstage.control.trajectory import Trajectory
from flexstage.hysteresis import Tracking, tracking
from flexstage.records import Record


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RunTracking:
    """Tracking errors of a run."""

    axis: str
    """The axis."""
    time: Array
    """Times of the compared samples [s], shape (n,)."""
    reference: Array
    """The reference [m], shape (n,)."""
    output: Array
    """The output [m], shape (n,)."""
    total: Tracking
    """Loop width of the mean period, errors over all periods [m]."""
    per_period_rms: tuple[float, ...]
    """Root mean square of the error of each period [m]."""
    repeatable_rms: float
    """Root mean square of the mean period's error [m], which learning can still remove."""
    random_rms: float
    """Root mean square of the differences between the periods [m]; NaN for one period."""
    offset: float
    """Mean error that was subtracted, where requested [m]."""

    def reduction_percent(self, open_loop: "RunTracking") -> float:
        """Return the reduction of the loop width against a run without compensation [%]."""
        return 100.0 * (1.0 - self.total.loop_width / open_loop.total.loop_width)


def evaluate_run(
    trajectory: Trajectory,
    axis: str,
    output: ArrayLike,
    *,
    sample_rate_hz: float | None = None,
    skip: int = 0,
    free_offset: bool = False,
) -> RunTracking:
    """Compare complete periods of an output with a trajectory.

    The first sample of the output [m] is that of the trajectory; an incomplete last period is
    ignored, and so are the first `skip` periods. With a free offset a constant error is
    subtracted: for open loop, whose offset is arbitrary.

    Examples
    --------
    >>> from flexstage.control.trajectory import sine
    >>> reference = sine("x", 0.0, 40e-6, 2.0, sample_rate_hz=1e3)
    >>> late = np.roll(np.tile(reference.positions["x"], 3), 2)
    >>> round(evaluate_run(reference, "x", late).total.rms * 1e9)
    355
    """
    rate = trajectory.sample_rate_hz if sample_rate_hz is None else float(sample_rate_hz)
    size = samples_of_period(trajectory, rate)
    readings = whole_periods(output, size, skip).ravel()
    periods = readings.size // size
    one_period = at_times(trajectory, axis, np.arange(size) / rate)
    reference = np.tile(one_period, periods)
    offset = float(np.mean(readings - reference)) if free_offset else 0.0
    error = (readings - offset - reference).reshape(periods, size)
    mean = error.mean(axis=0)
    random = float(np.sqrt(np.mean((error - mean) ** 2) * periods / max(periods - 1, 1)))
    return RunTracking(
        axis=axis,
        time=(skip * size + np.arange(readings.size)) / rate,
        reference=reference + offset,
        output=readings,
        total=_cycles_of(reference + offset, readings, size, error),
        per_period_rms=tuple(float(r) for r in np.sqrt(np.mean(error**2, axis=1))),
        repeatable_rms=float(np.sqrt(np.mean(mean**2))),
        random_rms=random if periods > 1 else float("nan"),
        offset=offset,
    )


def evaluate_record(
    record: Record,
    column: str | int,
    trajectory: Trajectory,
    axis: str,
    *,
    skip: int = 0,
) -> RunTracking:
    """Compare complete periods of a record that began with a trajectory.

    Parameters
    ----------
    record : Record
        The record; its first sample is the first of the trajectory.
    column : str or int
        The column of the reading [m].
    trajectory : Trajectory
        The reference.
    axis : str
        The axis.
    skip : int
        First periods that are skipped.

    Returns
    -------
    RunTracking
        Errors and loop.

    Raises
    ------
    RecordError
        The column is missing, or there is no complete period.
    """
    reading = record.channel(column).values
    return evaluate_run(trajectory, axis, reading, sample_rate_hz=record.sample_rate_hz, skip=skip)


def samples_of_period(trajectory: Trajectory, sample_rate_hz: float) -> int:
    """Return the number of samples of a period at a rate; `RecordError` if it is not whole."""
    count = trajectory.period * sample_rate_hz
    size = round(count)
    if size < 8 or abs(count - size) > 1e-6 * count:
        raise RecordError(
            f"a period of {trajectory.period:g} s is {count:.6g} samples at {sample_rate_hz:g} Hz: "
            "record with an integer number of samples per period"
        )
    return size


def whole_periods(reading: ArrayLike, size: int, skip: int) -> Array:
    """Return the complete periods of a reading after the first ones, shape (periods, size)."""
    readings = np.asarray(reading, dtype=np.float64)
    periods = readings.size // size - skip
    if periods < 1:
        raise RecordError(
            f"the reading has {readings.size} samples, and {skip} periods of {size} are skipped: "
            "no complete period remains; record more periods"
        )
    return readings[skip * size : (skip + periods) * size].reshape(periods, size)


def at_times(trajectory: Trajectory, axis: str, time: Array) -> Array:
    """Return the positions of a periodic trajectory at any times, by a cubic spline [m]."""
    from scipy.interpolate import CubicSpline

    x = np.asarray(trajectory.positions[axis], dtype=np.float64)
    spline = CubicSpline(np.arange(x.size + 1), np.append(x, x[0]), bc_type="periodic")
    at = np.mod(np.asarray(time) * trajectory.sample_rate_hz, x.size)
    return np.asarray(spline(at), dtype=np.float64)


def _cycles_of(reference: Array, output: Array, size: int, error: Array) -> Tracking:
    """Return the loop width over cycles that begin at the lowest point of the reference."""
    low = int(np.argmin(reference[:size]))
    bounds = np.arange(low, reference.size, size)
    if low == 0:
        bounds = np.append(bounds, reference.size)
    if bounds.size < 2:
        # one period, begun elsewhere: turned so that it begins at its low end
        reference, output, bounds = (
            np.roll(reference, -low),
            np.roll(output, -low),
            np.array([0, size]),
        )
    # the sample after the last is the first again
    cycle_tracking = tracking(
        np.append(reference, reference[0]), np.append(output, output[0]), bounds
    )
    return Tracking(
        loop_width=cycle_tracking.loop_width,
        rms=float(np.sqrt(np.mean(error**2))),
        largest=float(np.max(np.abs(error))),
    )
