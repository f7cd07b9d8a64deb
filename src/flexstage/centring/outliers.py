"""Samples that do not belong to the others: found by a robust fit, named, set aside."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from flexstage.arrays import Array
from flexstage.centring.turns import Turns
from flexstage.errors import RecordError
from flexstage.records.quality import RMS_OVER_MEDIAN

# constants of Huber's and Tukey's weights, at which 95 % of the efficiency for normal noise is kept
_HUBER, _TUKEY = 1.345, 4.685
_ROUNDS = 60
#: Up to this share is left out at once, in so many rounds.
FEW, _FEW_ROUNDS = 0.01, 6
#: Share of a residual from which a neighbour, or another turn, has it too.
_SHARED = 0.5


@dataclass(frozen=True, slots=True, kw_only=True)
class Outlier:
    """A sample that was set aside."""

    index: int
    """Its number in the record, from 0."""
    angle: float
    """Its angle [rad]."""
    value: float
    """Its value, in the unit of the record."""
    residual: float
    """How far it is from what the others say, in the same unit."""


def stands_out(residual: Array) -> bool:
    """Say whether a residual is too large for normal noise of the size of the others."""
    size = np.abs(residual)
    return bool(size.max() > _threshold(size.size) * _spread(size))


def without_outliers(
    solve: Callable[[Array], Array],
    start: Array,
    value_size: float,
    turns: Turns,
) -> NDArray[np.bool_]:
    """Return which samples to keep.

    `solve` goes from weights of the samples to residuals of the fit, `start` are those of all
    samples. Residuals within the rounding of `value_size`, the largest of the values, are none.
    More than a quarter of the samples that stand out, most of them alone, are refused.

    What stands out and is alone: what the sample before or after has too, or most other turns at
    the same place, is the scale's, and is kept.

    A few that stand out from the first fit are left out, and the fit is repeated until they are
    the same. Where they are many, weighted least squares is repeated with Huber's weights (Huber
    1964, Annals of Mathematical Statistics 35), then with Tukey's (Beaton and Tukey 1974,
    Technometrics 16). Of normal noise one record in twenty or fewer loses a sample, however long it
    is.
    """
    # more than this share that stands out, most of it alone, is no handful of outliers.
    most = 0.25
    floor = 1e-13 * value_size
    few = _few(solve, start, floor, turns)
    if few is not None:
        return few
    residual = start
    for weigh, rounds in ((_huber, _ROUNDS // 4), (_tukey, _ROUNDS)):
        last = math.inf
        for _ in range(rounds):
            size = np.abs(residual)
            spread = max(_spread(size), floor)
            residual = solve(weigh(size / spread))
            if abs(spread - last) <= 1e-4 * spread:
                break
            last = spread
    near = _near(residual, floor)
    keep = near | _of_the_scale(residual, ~near, turns)
    alone = int(keep.size - keep.sum())
    if near.mean() < 1.0 - most and alone > 0.5 * (near.size - near.sum()):
        raise RecordError(
            f"{near.size - int(near.sum())} of {near.size} samples stand out from the others, "
            f"{alone} of them singly: too many for outliers; check the columns and their units, or "
            "fit without marking outliers"
        )
    return keep


def _few(
    solve: Callable[[Array], Array],
    start: Array,
    floor: float,
    turns: Turns,
) -> NDArray[np.bool_] | None:
    """Return which to keep where a few stand out so far that leaving them out changes no other."""
    residual, last = start, np.ones(start.size, dtype=bool)
    for _ in range(_FEW_ROUNDS):
        near = _near(residual, floor)
        keep = near | _of_the_scale(residual, ~near, turns)
        if np.array_equal(keep, last):
            return keep
        if keep.mean() < 1.0 - FEW:
            return None
        residual, last = solve(keep.astype(np.float64)), keep
    return None


def _near(residual: Array, floor: float) -> NDArray[np.bool_]:
    """Say of each sample whether it does not stand out from the fit."""
    size = np.abs(residual)
    return size <= _threshold(size.size) * max(_spread(size), floor)


def _of_the_scale(residual: Array, suspect: NDArray[np.bool_], turns: Turns) -> NDArray[np.bool_]:
    """Say of each suspect sample whether others have its error too: it is the scale's then."""
    at = np.flatnonzero(suspect)
    out = np.zeros(residual.size, dtype=bool)
    if at.size:
        out[at] = _in_a_run(residual, at, turns) | _repeated(residual, at, turns)
    return out


def _in_a_run(left: Array, at: NDArray[np.intp], turns: Turns) -> NDArray[np.bool_]:
    """Say whether the sample before or after has the error too, or is as near as samples are."""
    # a quarter of a normal distribution is within this many rms of its mean
    quartile = 0.3186393639643752
    order = np.arange(left.size)
    if turns.direction == 0:
        order = np.argsort(turns.angle % (2.0 * math.pi), kind="stable")
    rank = np.empty_like(order)
    rank[order] = np.arange(left.size)
    sign, size = np.sign(left[at]), np.abs(left[at])
    beside = [sign * left[order[(rank[at] + k) % left.size]] for k in (-1, 1)]
    nearest = np.maximum(*beside)
    # white noise of rms s has steps of rms s sqrt(2); each outlier makes two, so not their median
    step = float(np.quantile(np.abs(np.diff(left[order])), 0.25)) / (quartile * math.sqrt(2.0))
    return (nearest > _SHARED * size) | (size - nearest <= _threshold(left.size) * step)


def _repeated(left: Array, at: NDArray[np.intp], turns: Turns) -> NDArray[np.bool_]:
    """Say whether the error is there in most of the other turns that have samples at the place."""
    if turns.direction == 0 or len(turns.bounds) < 3:
        return np.zeros(at.size, dtype=bool)
    place = turns.angle / (2.0 * math.pi) % 1.0
    sign, size = np.sign(left[at]), np.abs(left[at])
    reach = 1.5 * float(np.median(np.abs(np.diff(turns.angle)))) / (2.0 * math.pi)
    there = np.full((len(turns.bounds) - 1, at.size), np.nan)
    for t, (first, end) in enumerate(pairwise(turns.bounds)):
        order = first + np.argsort(place[first:end], kind="stable")
        after = np.searchsorted(place[order], place[at])
        for j in (order[after % order.size], order[after - 1]):
            apart = np.abs(place[j] - place[at])
            near = np.minimum(apart, 1.0 - apart) <= reach
            there[t] = np.where(near, np.fmax(there[t], sign * left[j]), there[t])
        there[t, (at >= first) & (at < end)] = np.nan
    others = np.count_nonzero(np.isfinite(there), axis=0)
    shared = np.count_nonzero(there > _SHARED * size, axis=0)
    return (others > 0) & (2 * shared > others)


def _spread(size: Array) -> float:
    # samples that a median is taken of, at most
    sampled = 50_000
    step = max(1, size.size // sampled)
    return RMS_OVER_MEDIAN * float(np.median(size[::step]))


def _threshold(count: int) -> float:
    """Return the multiple of the rms that one of so many normal values passes once in 40 times."""
    from scipy.special import ndtri

    return max(4.0, -float(ndtri(0.0125 / count)))


def _huber(x: Array) -> Array:
    return np.minimum(1.0, _HUBER / np.maximum(x, _HUBER))


def _tukey(x: Array) -> Array:
    return np.where(x < _TUKEY, (1.0 - (x / _TUKEY) ** 2) ** 2, 0.0)
