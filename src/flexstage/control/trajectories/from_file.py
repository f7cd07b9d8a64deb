"""A trajectory from columns of a record."""

from collections.abc import Mapping

import numpy as np

from flexstage.control.trajectories.trajectory import Trajectory, smooth_step
from flexstage.errors import ModelError, RecordError
from flexstage.records import Record

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
