"""A trajectory: where the axes are to be, over one period, and which part of it is linear.

And one that is made of the columns of a record.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from flexstage.base.arrays import Array
from flexstage.base.choose import has_no
from flexstage.base.errors import LimitError, ModelError, RecordError
from flexstage.instruments.protocol import Waveform
from flexstage.records import Record
from flexstage.stage.limits import AxisLimits

#: A period is cut to whole samples; a change of the rate above this share is told.
_TOLD = 1e-9
#: Fewer samples in a period show no shape.
_FEWEST = 8


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Trajectory:
    """One period of a motion of one or more axes, which repeats without a jump.

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
    """True where the motion is what it is run for: constant speed of a triangle or a raster (the
    slow axis of one by steps stands still); True throughout for sines. Shape (n,).
    """
    kind: str
    """What it is."""
    overshoot: float = 0.0
    """How far turns lead beyond the linear part at each end [m]; 0 where there are none."""
    notes: tuple[str, ...] = field(default=())
    """What was changed, to be told."""

    def __post_init__(self) -> None:
        self.waveform()  # checks lengths, finiteness and rate
        if np.shape(self.linear) != (self.size,):
            raise ModelError(
                f"the linear part of a trajectory of {self.size} samples must have as many, got "
                f"shape {np.shape(self.linear)}"
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
        """Time after which it repeats [s]."""
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
        """Return the largest speed from one sample to the next, from the end to the start too.

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
        """Refuse a trajectory that leaves the limits of its axes.

        Parameters
        ----------
        limits : Mapping
            Limits by axis; an axis that is not named is not checked.

        Raises
        ------
        LimitError
            A position or a speed is beyond what its axis allows.
        """
        for axis, x in self.positions.items():
            own = limits.get(axis)
            if own is None:
                continue
            low, high = float(np.min(x)), float(np.max(x))
            if own.position is not None and not own.position[0] <= low <= high <= own.position[1]:
                raise LimitError(
                    f"the {self.kind} leads axis '{axis}' from {1e6 * low:.3f} to "
                    f"{1e6 * high:.3f} um, allowed are {1e6 * own.position[0]:.3f} to "
                    f"{1e6 * own.position[1]:.3f} um: make it smaller, or shift it"
                )
            fastest = self.largest_speed(axis)
            if own.speed is not None and fastest > own.speed * (1.0 + 1e-9):
                raise LimitError(
                    f"the {self.kind} moves axis '{axis}' at up to {1e6 * fastest:.4g} um/s, "
                    f"allowed are {1e6 * own.speed:.4g} um/s: lower its rate, or make it smaller"
                )


def period_samples(rate_hz: float, sample_rate_hz: float) -> tuple[int, tuple[str, ...]]:
    """Return the whole number of samples of a period, and a note where that changes the rate.

    Examples
    --------
    >>> period_samples(3.0, 1000.0)
    (333, ('the rate is 3.003 Hz instead of 3 Hz, for a whole number of samples',))
    """
    for name, value in (("rate", rate_hz), ("sample rate", sample_rate_hz)):
        if not (value > 0.0 and math.isfinite(value)):
            raise ModelError(f"the {name} of a trajectory must be positive, got {value!r} Hz")
    count = round(sample_rate_hz / rate_hz)
    if count < _FEWEST:
        raise ModelError(
            f"{rate_hz:g} Hz at {sample_rate_hz:g} samples a second leaves {count} samples of a "
            f"period, at least {_FEWEST} are needed: lower the rate"
        )
    made = sample_rate_hz / count
    if abs(made - rate_hz) <= _TOLD * rate_hz:
        return count, ()
    return count, (
        f"the rate is {made:.6g} Hz instead of {rate_hz:g} Hz, for a whole number of samples",
    )


def delayed(trajectory: Trajectory, delay: float) -> Trajectory:
    """Return a trajectory later by a delay [s], any part of a sample; earlier below 0."""
    n = trajectory.size
    turn = np.exp(-2j * np.pi * np.fft.rfftfreq(n, 1.0 / trajectory.sample_rate_hz) * delay)
    moved = {a: np.asarray(np.fft.irfft(np.fft.rfft(x) * turn, n), dtype=np.float64)
             for a, x in trajectory.positions.items()}  # fmt: skip
    whole = round(delay * trajectory.sample_rate_hz)
    return replace(trajectory, positions=moved, linear=np.roll(trajectory.linear, whole))


def checked_ends(low: float, high: float, axis: str) -> tuple[float, float]:
    """Return the ends of a motion after checking that they rise."""
    if not (math.isfinite(low) and math.isfinite(high) and low < high):
        raise ModelError(f"the ends of the motion of '{axis}' must rise, got {low!r}, {high!r} m")
    return float(low), float(high)


def smooth_step(s: ArrayLike) -> Array:
    r"""Return the minimum-jerk way from 0 to 1.

    .. math:: 10 s^3 - 15 s^4 + 6 s^5

    of T. Flash and N. Hogan (J. Neuroscience 5 (1985) 1688): speed and acceleration are zero at
    both ends, 1.875 and 5.774 at most in between.
    """
    at = np.clip(np.asarray(s, dtype=np.float64), 0.0, 1.0)
    return at**3 * (10.0 - 15.0 * at + 6.0 * at**2)


#: A gap between the end and the start of more than this share of the range is closed or refused.
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
        Samples in a second [Hz], joined by a cubic spline; those of the record where not given.
    close : float, optional
        Time that is added in which the end is led to the start by least jerk [s]. Where not given,
        the end must be the start.

    Returns
    -------
    Trajectory
        One period of it.

    Raises
    ------
    RecordError
        A column is missing, is not in m, or the samples are not even.
    ModelError
        The end is not the start, and no time is given to lead it there.

    Examples
    --------
    >>> from flexstage.records import Channel
    >>> t = np.arange(200) / 1e3
    >>> path = Channel(name="x", values=3e-5 - 2e-5 * np.cos(10.0 * np.pi * t), unit="m")
    >>> made = trajectory_of(Record(channels=(path,), time=t), {"x": "x"}, sample_rate_hz=5e3)
    >>> made.size, round(made.period, 3)
    (1000, 0.2)
    """
    if not record.uniform or record.over != "time":
        raise RecordError(
            f"a trajectory needs even samples over time, and {record.source or 'the record'} has "
            "none: resample it"
        )
    rate = record.sample_rate_hz if sample_rate_hz is None else float(sample_rate_hz)
    added = 0 if close is None else round(close * record.sample_rate_hz)
    if close is not None and added < 2:
        raise ModelError(f"closing a trajectory takes two samples or more, got {close!r} s")
    positions = {}
    for axis, column in columns.items():
        channel = record.channel(column)
        if channel.unit not in ("m", ""):
            raise RecordError(
                f"column '{channel.name}' is in {channel.unit}, a trajectory is in m: give its unit"
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
                f"the path of '{axis}' ends {abs(gap):.3g} m from its start: it would jump there "
                "when it repeats; give a time in which to close it"
            )
        return x
    share = smooth_step(np.arange(1, added + 1) / (added + 1.0))
    return np.concatenate((x, x[-1] + gap * share))


def _resampled(x: np.ndarray, record: Record, rate: float) -> np.ndarray:
    own = record.sample_rate_hz
    if rate == own:
        return np.asarray(x, dtype=np.float64)
    from scipy.interpolate import CubicSpline

    # over the closed period: the sample after the last is the first
    spline = CubicSpline(np.arange(x.size + 1), np.append(x, x[0]), bc_type="periodic")
    count = round(x.size / own * rate)
    return np.asarray(spline(np.arange(count) * (x.size / count)), dtype=np.float64)
