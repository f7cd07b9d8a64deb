"""Trajectories of the axes over one period, and the tracking errors of runs.

Sines, triangles, steps, and columns of a record.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from flexstage.base.arrays import Array
from flexstage.base.choose import has_no
from flexstage.base.errors import LimitError, ModelError, RecordError
from flexstage.control.moves import jerk_limited
from flexstage.hysteresis import Tracking, tracking
from flexstage.instruments.protocol import Waveform
from flexstage.records import Record
from flexstage.stage.limits import AxisLimits

#: A period has an integer number of samples; a relative change of the rate above this is noted.
_SAME_RATE = 1e-9
#: Smallest number of samples in a period.
_FEWEST = 8
#: Fewest samples of a jerk-limited move: fewer are a jump.
_FEWEST_OF_MOVE = 4


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Trajectory:
    """One period of a motion of one or more axes, which repeats without a step.

    Raises
    ------
    ModelError
        The axes differ in length, a value is not finite, or `linear` has another length.
    """

    positions: Mapping[str, Array]
    """Positions by axis [m], shape (n,). The sample after the last one is the first again."""
    sample_rate_hz: float
    """Samples in a second [Hz]."""
    linear: NDArray[np.bool_]
    """True in the useful part: constant speed of a triangle, rests of steps; True everywhere for
    sines. Shape (n,).
    """
    kind: str
    """Kind of the trajectory."""
    overshoot: float = 0.0
    """Travel of the turns beyond the linear part at each end [m]; 0 where there are none."""
    notes: tuple[str, ...] = field(default=())
    """Changes, for the report."""

    def __post_init__(self) -> None:
        self.waveform()  # checks lengths, finiteness and rate
        if np.shape(self.linear) != (self.size,):
            raise ModelError(
                f"the linear part of a trajectory of {self.size} samples must have the same "
                f"length, got shape {np.shape(self.linear)}"
            )

    @property
    def axes(self) -> tuple[str, ...]:
        """Names of the axes."""
        return tuple(self.positions)

    @property
    def size(self) -> int:
        """Number of samples of a period."""
        return len(next(iter(self.positions.values())))

    @property
    def period(self) -> float:
        """Duration of the period [s]."""
        return self.size / self.sample_rate_hz

    @property
    def time(self) -> Array:
        """Times of the samples [s], shape (n,)."""
        return np.arange(self.size) / self.sample_rate_hz

    @property
    def linear_share(self) -> float:
        """Share of the time in the linear part [1]."""
        return float(np.mean(self.linear))

    def largest_speed(self, axis: str) -> float:
        """Return the largest speed between samples, including from the last to the first.

        Parameters
        ----------
        axis : str
            The axis.

        Returns
        -------
        float
            The speed [m/s].

        Raises
        ------
        ModelError
            The trajectory has no such axis.
        """
        if axis not in self.positions:
            raise ModelError(has_no("the trajectory", "axis", axis, self.positions))
        return self.waveform().largest_rate(axis, closed=True)

    def waveform(self) -> Waveform:
        """Return one period of the positions as a waveform.

        Returns
        -------
        Waveform
            The positions [m].
        """
        positions = {a: np.asarray(x, dtype=np.float64) for a, x in self.positions.items()}
        return Waveform(values=positions, sample_rate_hz=self.sample_rate_hz, quantity="position")

    def check(self, limits: Mapping[str, AxisLimits]) -> None:
        """Refuse a trajectory that exceeds the limits of its axes.

        Parameters
        ----------
        limits : Mapping
            Limits by axis; an axis that is not named is not checked.

        Raises
        ------
        LimitError
            A position or a speed exceeds the limits of its axis.
        """
        for axis, x in self.positions.items():
            allowed = limits.get(axis)
            if allowed is None:
                continue
            low, high = float(np.min(x)), float(np.max(x))
            if (
                allowed.position is not None
                and not allowed.position[0] <= low <= high <= allowed.position[1]
            ):
                raise LimitError(
                    f"the {self.kind} moves axis '{axis}' from {1e6 * low:.3f} to "
                    f"{1e6 * high:.3f} um, and its limits are {1e6 * allowed.position[0]:.3f} to "
                    f"{1e6 * allowed.position[1]:.3f} um: make it smaller, or shift it"
                )
            fastest = self.largest_speed(axis)
            if allowed.speed is not None and fastest > allowed.speed * (1.0 + 1e-9):
                raise LimitError(
                    f"the {self.kind} moves axis '{axis}' at up to {1e6 * fastest:.4g} um/s, "
                    f"and its limit is {1e6 * allowed.speed:.4g} um/s: lower its rate, or make it "
                    "smaller"
                )


def period_samples(rate_hz: float, sample_rate_hz: float) -> tuple[int, tuple[str, ...]]:
    """Return the integer number of samples of a period, and a note where that changes the rate.

    Examples
    --------
    >>> period_samples(3.0, 1000.0)
    (333, ('the rate is 3.003 Hz instead of 3 Hz, for an integer number of samples',))
    """
    for name, value in (("rate", rate_hz), ("sample rate", sample_rate_hz)):
        if not (value > 0.0 and math.isfinite(value)):
            raise ModelError(f"the {name} of a trajectory must be positive, got {value!r} Hz")
    count = round(sample_rate_hz / rate_hz)
    if count < _FEWEST:
        raise ModelError(
            f"{rate_hz:g} Hz at {sample_rate_hz:g} samples per second gives {count} samples per "
            f"period, and at least {_FEWEST} are necessary: lower the rate"
        )
    rate = sample_rate_hz / count
    if abs(rate - rate_hz) <= _SAME_RATE * rate_hz:
        return count, ()
    return count, (
        f"the rate is {rate:.6g} Hz instead of {rate_hz:g} Hz, for an integer number of samples",
    )


def delayed(trajectory: Trajectory, delay: float) -> Trajectory:
    """Return a delayed trajectory [s], by any fraction of a sample; earlier below 0."""
    n = trajectory.size
    turn = np.exp(-2j * np.pi * np.fft.rfftfreq(n, 1.0 / trajectory.sample_rate_hz) * delay)
    shifted = {a: np.asarray(np.fft.irfft(np.fft.rfft(x) * turn, n), dtype=np.float64)
             for a, x in trajectory.positions.items()}  # fmt: skip
    shift = round(delay * trajectory.sample_rate_hz)
    return replace(trajectory, positions=shifted, linear=np.roll(trajectory.linear, shift))


def checked_ends(low: float, high: float, axis: str) -> tuple[float, float]:
    """Return the ends of a motion after checking that they rise."""
    if not (math.isfinite(low) and math.isfinite(high) and low < high):
        raise ModelError(f"the ends of the motion of '{axis}' must rise, got {low!r}, {high!r} m")
    return float(low), float(high)


def smooth_step(s: ArrayLike) -> Array:
    r"""Return the minimum-jerk transition from 0 to 1.

    .. math:: 10 s^3 - 15 s^4 + 6 s^5

    of T. Flash and N. Hogan (J. Neuroscience 5 (1985) 1688): speed and acceleration are zero at
    both ends, 1.875 and 5.774 at most in between.
    """
    at = np.clip(np.asarray(s, dtype=np.float64), 0.0, 1.0)
    return at**3 * (10.0 - 15.0 * at + 6.0 * at**2)


#: Travel of a turn beyond the linear part, over speed and duration.
BEYOND = 5.0 / 16.0


def there_and_back(phase: Array, turn: float) -> Array:
    r"""Return a motion from 0 to 1 and back at constant speed, with minimum-jerk turns.

    In a turn of duration :math:`T_t` the speed goes from v to -v as a cubic,

    .. math:: \dot x = v\,(1 - 6 s^2 + 4 s^3), \qquad s = t/T_t,

    which has the smallest mean square jerk of all turns that begin and end at that speed without
    acceleration. It extends :math:`5/16\, v T_t` beyond the linear part; the acceleration is at
    most :math:`3 v/T_t`, the jerk :math:`12 v/T_t^2`.

    The phase is a share of the period, 0 in the middle of the lower turn; `turn` is the duration of
    a turn over half the period, above 0 and at most 1.

    Examples
    --------
    >>> there_and_back(np.array([0.0, 0.25, 0.5]), 0.2).round(6).tolist()
    [0.0, 0.5, 1.0]
    """
    # counted in half periods; the motion is odd about a quarter and even about a half
    t = 2.0 * np.abs(np.asarray(phase, dtype=np.float64) - np.round(phase))
    rising = np.minimum(t, 1.0 - t)
    speed = 1.0 / (1.0 - turn + 2.0 * BEYOND * turn)
    s = np.clip(rising / turn + 0.5, 0.5, 1.0)
    # reversed: the lower turn goes from -v to v
    way = -(s - 2.0 * s**3 + s**4) + BEYOND
    lower = speed * (turn * way + np.maximum(rising - 0.5 * turn, 0.0))
    return np.where(t <= 0.5, lower, 1.0 - lower)


def linear_between_turns(phase: Array, turn: float) -> NDArray[np.bool_]:
    """Return where such a motion has constant speed."""
    t = 2.0 * np.abs(np.asarray(phase, dtype=np.float64) - np.round(phase))
    edge = 0.5 * turn - 1e-9
    return (t >= edge) & (t <= 1.0 - edge)


def turn_share(turn_time: float | None, half_period: float, name: str = "a turn") -> float:
    """Return the duration of a turn or a move over half the period [1]; both are given in s."""
    if turn_time is None:
        return 0.1
    if not 0.0 < turn_time <= half_period * (1.0 + 1e-9):
        raise ModelError(
            f"{name} must last more than 0 s and at most half the period, {half_period:g} s, got "
            f"{turn_time!r} s"
        )
    return min(turn_time / half_period, 1.0)


def triangle(
    axis: str,
    low: float,
    high: float,
    rate_hz: float,
    *,
    sample_rate_hz: float,
    turn_time: float | None = None,
) -> Trajectory:
    """Return a triangle that starts at its lower end, with minimum-jerk turns as corners.

    With the range D, the half period h and the duration T of a turn the speed is
    ``v = D / (h - 3/8 T)``, the acceleration at most ``3 v / T``. The turns are within the range.

    Parameters
    ----------
    axis : str
        The axis.
    low, high : float
        Lowest and highest position [m].
    rate_hz : float
        Periods in a second [Hz].
    sample_rate_hz : float
        Samples in a second [Hz].
    turn_time : float, optional
        Duration of a turn [s] (default: a tenth of the half period).

    Returns
    -------
    Trajectory
        One period; its linear part has constant speed.

    Raises
    ------
    ModelError
        The ends do not rise, a rate is impossible, or the turn is longer than half the period.

    Examples
    --------
    >>> wave = triangle("x", 2e-6, 61.5e-6, 1.0, sample_rate_hz=1e3, turn_time=0.04)
    >>> round(wave.largest_speed("x") * 1e6, 2), round(wave.overshoot * 1e6, 3)
    (122.68, 1.534)
    >>> round(wave.linear_share, 2)
    0.92
    """
    low, high = checked_ends(low, high, axis)
    count, notes = period_samples(rate_hz, sample_rate_hz)
    half = 0.5 * count / sample_rate_hz
    turn = turn_share(turn_time, half)
    phase = np.arange(count) / count
    speed = (high - low) / (half * (1.0 - turn + 2.0 * BEYOND * turn))
    return Trajectory(
        positions={axis: low + (high - low) * there_and_back(phase, turn)},
        sample_rate_hz=float(sample_rate_hz),
        linear=linear_between_turns(phase, turn),
        kind="triangle",
        overshoot=BEYOND * speed * turn * half,
        notes=notes,
    )


def sine(
    axis: str, low: float, high: float, rate_hz: float, *, sample_rate_hz: float
) -> Trajectory:
    """Return a sine that starts at its lower end.

    Parameters
    ----------
    axis : str
        The axis.
    low, high : float
        Lowest and highest position [m].
    rate_hz : float
        Periods in a second [Hz].
    sample_rate_hz : float
        Samples in a second [Hz].

    Returns
    -------
    Trajectory
        One period; the speed is at most ``pi rate (high - low)``.

    Raises
    ------
    ModelError
        The ends do not rise, or a rate is impossible.

    Examples
    --------
    >>> wave = sine("y", 1e-6, 60.5e-6, 50.0, sample_rate_hz=10e3)
    >>> round(wave.largest_speed("y") * 1e3, 2)
    9.34
    """
    low, high = checked_ends(low, high, axis)
    count, notes = period_samples(rate_hz, sample_rate_hz)
    phase = 2.0 * np.pi * np.arange(count) / count
    return Trajectory(
        positions={axis: 0.5 * (low + high) - 0.5 * (high - low) * np.cos(phase)},
        sample_rate_hz=float(sample_rate_hz),
        linear=np.ones(count, dtype=np.bool_),
        kind="sine",
        notes=notes,
    )


def steps(
    axis: str,
    low: float,
    high: float,
    rate_hz: float,
    *,
    sample_rate_hz: float,
    move_time: float | None = None,
) -> Trajectory:
    """Return jerk-limited moves from the lower end to the upper end and back, each with a rest.

    A move over D in the time T has four phases of the jerk ``32 D / T^3``; its speed is at most
    ``2 D / T``. It begins with the period, or with its second half.

    Parameters
    ----------
    axis : str
        The axis.
    low, high : float
        Lowest and highest position [m].
    rate_hz : float
        Periods in a second [Hz].
    sample_rate_hz : float
        Samples in a second [Hz].
    move_time : float, optional
        Duration of a move [s] (default: a tenth of the half period).

    Returns
    -------
    Trajectory
        One period; its linear part is at rest.

    Raises
    ------
    ModelError
        The ends do not rise, a rate is impossible, or a move lasts longer than half the period or
        shorter than four samples.

    Examples
    --------
    >>> wave = steps("x", 5e-6, 15e-6, 10.0, sample_rate_hz=10e3, move_time=4e-3)
    >>> round(wave.largest_speed("x") * 1e3, 2), round(wave.linear_share, 2)
    (5.0, 0.92)
    """
    low, high = checked_ends(low, high, axis)
    count, notes = period_samples(rate_hz, sample_rate_hz)
    half = 0.5 * count / sample_rate_hz
    time = half * turn_share(move_time, half, "a move")
    if time * sample_rate_hz < _FEWEST_OF_MOVE:
        raise ModelError(
            f"a move of {time:.4g} s has {time * sample_rate_hz:.3g} samples at "
            f"{sample_rate_hz:g} Hz, and its four phases need at least {_FEWEST_OF_MOVE}: raise "
            "the sample rate, or lower the rate of the moves"
        )
    jerk = 32.0 * (high - low) / time**3
    way = jerk_limited(high - low, jerk=jerk, sample_rate_hz=sample_rate_hz)[: count // 2]
    index = np.arange(count)
    rise = np.interp(index, np.arange(way.size), way)
    fall = np.interp(index - count // 2, np.arange(way.size), way)
    moving = index % (count - count // 2) < time * sample_rate_hz
    return Trajectory(
        positions={axis: low + rise - fall},
        sample_rate_hz=float(sample_rate_hz),
        linear=~moving,
        kind="steps",
        notes=notes,
    )


#: Largest step from the end to the start of a path, over its range, that needs no closing.
_GAP = 1e-3


def trajectory_of(
    record: Record,
    columns: Mapping[str, str | int],
    *,
    sample_rate_hz: float | None = None,
    close: float | None = None,
) -> Trajectory:
    """Return the trajectory that columns of a record describe.

    Parameters
    ----------
    record : Record
        The record, over time; its columns in m.
    columns : Mapping
        Column by axis: its name, or its number from 0.
    sample_rate_hz : float, optional
        Samples in a second [Hz], by a cubic spline (default: those of the record).
    close : float, optional
        Duration of an additional minimum-jerk move from the end to the start [s]. Without it, the
        end must be the start.

    Returns
    -------
    Trajectory
        One period.

    Raises
    ------
    RecordError
        A column is missing, is not in m, or the samples are not uniform.
    ModelError
        The end is not the start, and no closing time is given.

    Examples
    --------
    >>> from flexstage.records import Channel
    >>> t = np.arange(200) / 1e3
    >>> path = Channel(name="x", values=3e-5 - 2e-5 * np.cos(10.0 * np.pi * t), unit="m")
    >>> motion = trajectory_of(Record(channels=(path,), time=t), {"x": "x"}, sample_rate_hz=5e3)
    >>> motion.size, round(motion.period, 3)
    (1000, 0.2)
    """
    if not record.uniform or record.over != "time":
        raise RecordError(
            f"a trajectory needs uniform sampling over time, and {record.source or 'the record'} "
            "has none: resample it"
        )
    rate = record.sample_rate_hz if sample_rate_hz is None else float(sample_rate_hz)
    added = 0 if close is None else round(close * record.sample_rate_hz)
    if close is not None and added < 2:
        raise ModelError(f"closing a trajectory needs at least two samples, got {close!r} s")
    positions = {}
    for axis, column in columns.items():
        channel = record.channel(column)
        if channel.unit not in ("m", ""):
            raise RecordError(
                f"column '{channel.name}' is in {channel.unit}, and a trajectory is in m: give its "
                "unit"
            )
        positions[axis] = _resampled(_closed(channel.values, added, axis), record, rate)
    size = len(next(iter(positions.values()), ()))
    return Trajectory(
        positions=positions,
        sample_rate_hz=rate,
        linear=np.arange(size) < round(size * record.size / (record.size + added)),
        kind="path from a record",
    )


def _closed(x: np.ndarray, added: int, axis: str) -> np.ndarray:
    gap, step = float(x[0] - x[-1]), float(np.max(np.abs(np.diff(x))))
    if not added:
        if abs(gap) > step + _GAP * float(np.ptp(x)):
            raise ModelError(
                f"the path of '{axis}' ends {abs(gap):.3g} m from its start, which would be a step "
                "when it repeats; give a closing time"
            )
        return x
    share = smooth_step(np.arange(1, added + 1) / (added + 1.0))
    return np.concatenate((x, x[-1] + gap * share))


def _resampled(x: np.ndarray, record: Record, rate: float) -> np.ndarray:
    record_rate = record.sample_rate_hz
    if rate == record_rate:
        return np.asarray(x, dtype=np.float64)
    from scipy.interpolate import CubicSpline

    # over the closed period: the sample after the last is the first
    spline = CubicSpline(np.arange(x.size + 1), np.append(x, x[0]), bc_type="periodic")
    count = round(x.size / record_rate * rate)
    return np.asarray(spline(np.arange(count) * (x.size / count)), dtype=np.float64)


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
