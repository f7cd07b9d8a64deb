"""Quality of a column of measured values: constant, clipped, coarse or noisy."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from flexstage.base.errors import RecordError
from flexstage.records.record import Record

#: Ratio of the rms of a normal distribution to the median of its absolute values.
RMS_OVER_MEDIAN = 1.4826022185056018


@dataclass(frozen=True, slots=True, kw_only=True)
class Saturation:
    """Samples of a column at its extremes."""

    low: float
    """Minimum, in the unit of the column."""
    high: float
    """Maximum."""
    at_low: int
    """Number of samples at the minimum."""
    at_high: int
    """Number of samples at the maximum."""
    clipped_low: bool
    """Whether the column is probably clipped at the minimum."""
    clipped_high: bool
    """Whether the column is probably clipped at the maximum."""

    @property
    def clipped(self) -> bool:
        """Whether the column is probably clipped at an extreme."""
        return self.clipped_low or self.clipped_high


def _finite(values: ArrayLike, least: int) -> NDArray[np.float64]:
    array = np.asarray(values, dtype=np.float64)
    if array.ndim != 1 or array.size < least or not np.isfinite(array).all():
        raise RecordError(
            f"at least {least} samples are needed, all of them finite, got an array of shape "
            f"{array.shape}"
        )
    return array


def saturation(values: ArrayLike) -> Saturation:
    """Return whether a column is clipped at its minimum or maximum.

    A smooth peak has at most (1 + sqrt 2) times as many samples in its highest converter step as in
    the next, and no more than in the next three. A column counts as clipped if it has three or more
    consecutive samples at an extreme, over four times as many samples there as at the next value
    and, in steps, over twice as many as at the next three.

    Parameters
    ----------
    values : array_like
        The samples, shape (n,).

    Returns
    -------
    Saturation
        Counts, and the assessment.

    Validity
    --------
    A drive at rest at its end counts as clipped, as does a peak flatter than a parabola in coarse
    steps. Soft limiting of an amplifier is not detected. A constant column is not clipped.

    Raises
    ------
    RecordError
        There are fewer than three samples, or one is not finite.

    Examples
    --------
    >>> drive = np.clip(np.sin(np.linspace(0.0, 20.0, 500)), -2.0, 0.83)
    >>> saturation(drive).clipped_high, saturation(drive).clipped_low
    (True, False)
    """
    x = _finite(values, 3)
    levels, counts = np.unique(x, return_counts=True)
    ends = []
    for level, inwards in ((0, counts), (-1, counts[::-1])):
        count, after = int(inwards[0]), inwards[1:4]
        longest = _longest_run(x == levels[level])
        # with few samples per step, a single step is not significant
        rests = after.size > 0 and count > 4 * after[0]
        rests = rests and (after.max() == 1 or count > 2 * after.sum())
        ends.append((count, bool(longest >= 3 and rests)))
    return Saturation(
        low=float(levels[0]),
        high=float(levels[-1]),
        at_low=ends[0][0],
        at_high=ends[1][0],
        clipped_low=ends[0][1],
        clipped_high=ends[1][1],
    )


def _longest_run(where: NDArray[np.bool_]) -> int:
    edges = np.flatnonzero(np.diff(np.concatenate(([False], where, [False]))))
    return int(np.diff(edges)[::2].max()) if edges.size else 0


def quantisation_step(values: ArrayLike) -> float:
    """Return the quantisation step of a column, of which all differences are multiples.

    Parameters
    ----------
    values : array_like
        The samples, shape (n,).

    Returns
    -------
    float
        The step, in the unit of the column; 0 if there is none, or the column is constant.

    Validity
    --------
    It is that of the converter or of the last printed digit, whichever is coarser. Steps below 1e-9
    of the largest value are within the rounding of floats and count as none.

    Raises
    ------
    RecordError
        There are fewer than two samples, or one is not finite.

    Examples
    --------
    >>> quantisation_step([0.25, 1.0, 1.75, 4.0])
    0.75
    """
    levels = np.unique(_finite(values, 2))
    if levels.size < 2:
        return 0.0
    largest = float(np.abs(levels).max())
    # rounding errors of equal differences, and the least step above them
    rounding, floor = 1e-12 * largest, 1e-9 * largest
    gaps = np.diff(levels)
    gaps = gaps[gaps > rounding]
    if gaps.size == 0:
        return 0.0
    step = float(gaps.min())
    # Euclid's algorithm, as the least gap may itself be several steps
    for _ in range(64):
        remainders = np.abs(gaps - step * np.round(gaps / step))
        remainders = remainders[remainders > max(rounding, 1e-4 * step)]
        if remainders.size == 0:
            multiples = np.round((levels - levels[0]) / step)
            return float((levels[-1] - levels[0]) / multiples[-1])
        step = float(remainders.min())
        if step < floor:
            break
    return 0.0


def difference_noise(values: NDArray[np.float64], order: int) -> float:
    """Return the rms of white noise from a difference; 0 if most neighbours are equal.

    A difference of order k of a smooth motion vanishes, and that of white noise of rms s has the
    rms s sqrt((2 k)! / k!^2) (von Neumann, 1941, Annals of Mathematical Statistics 12, for
    k = 1). The median of its absolute values, over 0.6745, replaces the rms, so that spikes do not
    count.

    Parameters
    ----------
    values : numpy.ndarray
        Evenly spaced samples, shape (n,).
    order : int
        The order k of the difference.

    Returns
    -------
    float
        The rms, in the unit of the column; 0 if there are too few samples for the difference.
    """
    if values.size <= order:
        return 0.0
    difference = np.diff(values, n=order) / math.sqrt(math.comb(2 * order, order))
    return RMS_OVER_MEDIAN * float(np.median(np.abs(difference)))


def require_unclipped(record: Record, columns: Sequence[str | int]) -> None:
    """Refuse columns that are clipped, as by the range of a converter.

    Validity
    --------
    That of `saturation`: a noise-free motion at rest at its end also counts as clipped.

    Examples
    --------
    >>> from flexstage.records import Channel
    >>> t = np.arange(400) / 200.0
    >>> y = np.minimum(np.sin(7.0 * t), 0.83)
    >>> record = Record(channels=(Channel(name="pos", values=y, unit="m"),), time=t)
    >>> try:
    ...     require_unclipped(record, ["pos"])
    ... except RecordError as error:
    ...     print(str(error).partition(":")[0])
    column 'pos' is clipped at 0.83 m (80 of 400 samples)
    """
    for selector in columns:
        channel = record.channel(selector)
        if channel.values.size < 3:
            continue
        limits = saturation(channel.values)
        ends = [
            f"{value:.6g}{' ' + channel.unit if channel.unit else ''} ({count} of "
            f"{channel.values.size} samples)"
            for clipped, value, count in (
                (limits.clipped_low, limits.low, limits.at_low),
                (limits.clipped_high, limits.high, limits.at_high),
            )
            if clipped
        ]
        if ends:
            raise RecordError(
                f"column '{channel.name}' is clipped at {' and at '.join(ends)}: widen the range "
                "of its sensor or converter and record it again, or select rows without clipping "
                "by the option rows"
            )


def require_live(record: Record, columns: Sequence[str | int]) -> None:
    """Refuse constant columns, as those of a sensor that is dead or not connected.

    Validity
    --------
    An open input with noise is not detected.

    Examples
    --------
    >>> from flexstage.records import Channel
    >>> t = np.arange(3.0)
    >>> record = Record(channels=(Channel(name="y", values=np.full(3, 0.7), unit="m"),), time=t)
    >>> try:
    ...     require_live(record, ["y"])
    ... except RecordError as error:
    ...     print(str(error).partition(":")[0])
    column 'y' is 0.7 m in all of its 3 samples
    """
    for selector in columns:
        channel = record.channel(selector)
        if (channel.values == channel.values[0]).all():
            unit = f" {channel.unit}" if channel.unit else ""
            raise RecordError(
                f"column '{channel.name}' is {channel.values[0]:.6g}{unit} in all of its "
                f"{channel.values.size} samples: its sensor is dead or not connected; choose "
                "another column, or record it again"
            )
