"""How well a run followed its trajectory: loop width, errors, and what differs between periods."""

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
    """What a run was like."""

    axis: str
    """The axis."""
    time: Array
    """Time of the samples that were compared [s], shape (n,)."""
    reference: Array
    """What was wanted [m], shape (n,)."""
    output: Array
    """What came [m], shape (n,)."""
    whole: Tracking
    """Loop width of the mean period, errors over all periods [m]."""
    per_period_rms: tuple[float, ...]
    """Root mean square of the error of each period [m]."""
    repeatable_rms: float
    """Root mean square of the mean period's error [m]: what learning can still take away."""
    random_rms: float
    """Root mean square of what differs between the periods [m]; not a number for one period."""
    offset: float
    """Mean of the error that was taken off, where that was asked for [m]."""

    def reduction_percent(self, open_loop: "RunTracking") -> float:
        """Return by how much the loop is narrower than that of a run without compensation [%]."""
        return 100.0 * (1.0 - self.whole.loop_width / open_loop.whole.loop_width)


def evaluate_run(
    trajectory: Trajectory,
    axis: str,
    output: ArrayLike,
    *,
    sample_rate_hz: float | None = None,
    skip: int = 0,
    free_offset: bool = False,
) -> RunTracking:
    """Compare whole periods of an output with a trajectory.

    The first sample of the output [m] is that of the trajectory; a last part of a period is left
    out, and so are the first periods to `skip`. With a free offset a constant error is taken off:
    for open loop, whose offset is arbitrary.

    Examples
    --------
    >>> from flexstage.control.trajectory_shapes import sine
    >>> wanted = sine("x", 0.0, 40e-6, 2.0, sample_rate_hz=1e3)
    >>> late = np.roll(np.tile(wanted.positions["x"], 3), 2)
    >>> round(evaluate_run(wanted, "x", late).whole.rms * 1e9)
    355
    """
    rate = trajectory.sample_rate_hz if sample_rate_hz is None else float(sample_rate_hz)
    size = samples_of_period(trajectory, rate)
    came = whole_periods(output, size, skip).ravel()
    periods = came.size // size
    wanted_period = at_times(trajectory, axis, np.arange(size) / rate)
    wanted = np.tile(wanted_period, periods)
    offset = float(np.mean(came - wanted)) if free_offset else 0.0
    error = (came - offset - wanted).reshape(periods, size)
    mean = error.mean(axis=0)
    random = float(np.sqrt(np.mean((error - mean) ** 2) * periods / max(periods - 1, 1)))
    return RunTracking(
        axis=axis,
        time=(skip * size + np.arange(came.size)) / rate,
        reference=wanted + offset,
        output=came,
        whole=_cycles_of(wanted + offset, came, size, error),
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
    """Compare whole periods of a record that began with a trajectory.

    Parameters
    ----------
    record : Record
        The record; its first sample is the first of the trajectory.
    column : str or int
        The column of the reading [m].
    trajectory : Trajectory
        What was wanted.
    axis : str
        The axis.
    skip : int
        First periods that are left out.

    Returns
    -------
    RunTracking
        Errors and loop.

    Raises
    ------
    RecordError
        The column is missing, or there is no whole period.
    """
    reading = record.channel(column).values
    return evaluate_run(trajectory, axis, reading, sample_rate_hz=record.sample_rate_hz, skip=skip)


def samples_of_period(trajectory: Trajectory, sample_rate_hz: float) -> int:
    """Return the whole number of samples of a period at a rate; a RecordError where it is none."""
    count = trajectory.period * sample_rate_hz
    size = round(count)
    if size < 8 or abs(count - size) > 1e-6 * count:
        raise RecordError(
            f"a period of {trajectory.period:g} s is {count:.6g} samples at {sample_rate_hz:g} Hz: "
            "record with a whole number of samples in a period"
        )
    return size


def whole_periods(reading: ArrayLike, size: int, skip: int) -> Array:
    """Return the whole periods of a reading after the first ones, shape (periods, size)."""
    came = np.asarray(reading, dtype=np.float64)
    periods = came.size // size - skip
    if periods < 1:
        raise RecordError(
            f"the reading has {came.size} samples, and {skip} periods of {size} are left out: "
            "there is no whole one to look at; record more periods"
        )
    return came[skip * size : (skip + periods) * size].reshape(periods, size)


def at_times(trajectory: Trajectory, axis: str, time: Array) -> Array:
    """Return the positions of a trajectory that repeats at any times, by a cubic spline [m]."""
    from scipy.interpolate import CubicSpline

    x = np.asarray(trajectory.positions[axis], dtype=np.float64)
    spline = CubicSpline(np.arange(x.size + 1), np.append(x, x[0]), bc_type="periodic")
    at = np.mod(np.asarray(time) * trajectory.sample_rate_hz, x.size)
    return np.asarray(spline(at), dtype=np.float64)


def _cycles_of(wanted: Array, came: Array, size: int, error: Array) -> Tracking:
    """Width of the loop over cycles that begin at the lowest point of the reference."""
    low = int(np.argmin(wanted[:size]))
    bounds = np.arange(low, wanted.size, size)
    if low == 0:
        bounds = np.append(bounds, wanted.size)
    if bounds.size < 2:
        # one period, begun elsewhere: turned so that it begins at its low end
        wanted, came, bounds = np.roll(wanted, -low), np.roll(came, -low), np.array([0, size])
    # the sample after the last is the first again
    made = tracking(np.append(wanted, wanted[0]), np.append(came, came[0]), bounds)
    return Tracking(
        loop_width=made.loop_width,
        rms=float(np.sqrt(np.mean(error**2))),
        largest=float(np.max(np.abs(error))),
    )
