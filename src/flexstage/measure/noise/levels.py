"""Levels of a staircase: where they begin and end, their means, and the drift that they share."""

import itertools
import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from flexstage.arrays import Array, Integers
from flexstage.errors import ModelError, RecordError
from flexstage.estimate import Component, Estimate

#: Parts of a level whose means tell how certain its mean is.
PARTS = 6
#: Rounds in which each change is put to its best place between its neighbours.
_ROUNDS = 30


def levels_of_command(command: ArrayLike, *, tolerance: float = 0.0, shortest: int = 1) -> Integers:
    """Return the bounds of the stretches in which a command stays.

    First sample of each level, and the sample after the last. Changes up to the tolerance, for a
    measured command several times its noise, count as none; stretches shorter than `shortest`, as
    of a ramp between two levels, are given to what follows.

    Examples
    --------
    >>> levels_of_command([0.0, 0.0, 0.0, 0.7, 0.7, 1.4, 1.4, 1.4])
    array([0, 3, 5, 8])
    """
    u = np.asarray(command, dtype=np.float64)
    if u.ndim != 1 or u.size < 2 or not np.isfinite(u).all():
        raise RecordError(f"a command is one finite number for each sample, got shape {u.shape}")
    starts = np.concatenate(([0], np.flatnonzero(np.abs(np.diff(u)) > tolerance) + 1))
    lengths = np.diff(np.append(starts, u.size))
    # the samples of a ramp are the beginning of the level that it leads to
    after_ramp = np.concatenate(([False], lengths[:-1] < shortest))
    keep = ~after_ramp
    keep[0] = True
    bounds = np.append(starts[keep], u.size).astype(np.intp)
    if bounds.size < 3:
        raise RecordError(
            "the command has fewer than two levels: name the column that holds it, or give the "
            "number of levels"
        )
    return bounds


def levels_of_reading(values: ArrayLike, count: int, *, shortest: int = 4) -> Integers:
    """Return the bounds of a given number of levels that fit a reading best.

    Bounds are added one by one, each where it lowers the sum of squares about the level means most,
    and after each all are put to their best places between their neighbours until none moves
    (binary segmentation: Scott and Knott, 1974, Biometrics 30; with refinement). O(n) for each. The
    bounds are the first sample of each level and the sample after the last, shape (count + 1,).

    Validity
    --------
    Steps that stand out of the noise of the mean of a level. The best place of one bound at a time
    is not always the best of all together. Take a drift of more than a step over the record off
    first.

    Examples
    --------
    >>> noise = 0.2 * np.random.default_rng(5).standard_normal(90)
    >>> levels_of_reading(np.repeat([0.0, 1.0, 2.5], [25, 40, 25]) + noise, 3)
    array([ 0, 25, 65, 90])
    """
    y = np.asarray(values, dtype=np.float64)
    if count < 2 or shortest < 1:
        raise ModelError(
            f"a staircase has two levels or more, of one sample or more, got {count}, {shortest}"
        )
    if y.ndim != 1 or y.size < count * shortest or not np.isfinite(y).all():
        raise RecordError(
            f"{count} levels of {shortest} samples need {count * shortest} finite readings at "
            f"least, got an array of shape {y.shape}"
        )
    total = np.concatenate(([0.0], np.cumsum(y - y.mean())))
    bounds = [0, y.size]
    while len(bounds) < count + 1:
        found = [_best(total, a, b, shortest) for a, b in itertools.pairwise(bounds)]
        gain, place = max(found)
        if gain < 0.0:
            raise RecordError(
                f"the reading has no room for {count} levels of {shortest} samples: ask for fewer "
                "or shorter ones"
            )
        bounds = sorted([*bounds, place])
        bounds = _refined(total, bounds, shortest)
    return np.array(bounds, dtype=np.intp)


def _best(total: Array, a: int, b: int, shortest: int) -> tuple[float, int]:
    """Return what a bound between a and b saves at most of the sum of squares, and where it is."""
    at = np.arange(a + shortest, b - shortest + 1)
    if at.size == 0:
        return -1.0, -1
    left, right = total[at] - total[a], total[b] - total[at]
    saved = left**2 / (at - a) + right**2 / (b - at) - (total[b] - total[a]) ** 2 / (b - a)
    i = int(np.argmax(saved))
    return float(saved[i]), int(at[i])


def _refined(total: Array, bounds: list[int], shortest: int) -> list[int]:
    out = list(bounds)
    for _ in range(_ROUNDS):
        before = list(out)
        for i in range(1, len(out) - 1):
            out[i] = _best(total, out[i - 1], out[i + 1], shortest)[1]
        if out == before:
            break
    return out


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LevelFit:
    """Means of levels and one drift for all."""

    means: Array
    """Means of the levels as if all were at the middle of the record, shape (k,)."""
    slope: float
    """Drift in a sample."""
    rest: Array
    """Means of the parts of each level less the fit, shape (k, parts)."""
    covariance: Array
    """Covariance of the means and the slope, shape (k + 1, k + 1)."""
    degrees_of_freedom: float
    """Of that."""

    def combination(self, weights: Array, unit: str) -> Estimate:
        """Return the sum of the steps times weights."""
        by = np.concatenate([np.diff(-weights, prepend=0.0, append=0.0), [0.0]])
        value = float(by[:-1] @ self.means)
        return Estimate(value=value, unit=unit, components=(self._noise(by),))

    def drift(self, rate: float, unit: str) -> Estimate:
        """Return the drift within the levels.

        In the unit of the readings in a second; `rate` in Hz.
        """
        by = np.concatenate([np.zeros(self.means.size), [rate]])
        return Estimate(value=rate * self.slope, unit=f"{unit}/s", components=(self._noise(by),))

    def _noise(self, by: Array) -> Component:
        return Component(
            name="noise",
            uncertainty=math.sqrt(max(float(by @ self.covariance @ by), 0.0)),
            degrees_of_freedom=self.degrees_of_freedom,
        )


def fit_levels(y: Array, spans: Integers) -> LevelFit:
    """Fit means of levels and one drift, to means of parts of the levels.

    The covariance is from what the parts differ from the fit by.
    """
    k = len(spans)
    z, t = np.empty((k, PARTS)), np.empty((k, PARTS))
    for i, (a, b) in enumerate(spans.tolist()):
        length = (b - a) // PARTS
        start = b - PARTS * length
        z[i] = y[start:b].reshape(PARTS, length).mean(axis=1)
        t[i] = start + length * np.arange(PARTS) + 0.5 * (length - 1)
    # longer levels have the surer parts
    weight = np.diff(spans, axis=1) / np.diff(spans, axis=1).mean()
    middle = float(t.mean())
    inner = t - t.mean(axis=1, keepdims=True)
    spread = float(np.sum(weight * inner**2))
    slope = float(np.sum(weight * inner * z)) / spread
    level_z, level_t = z.mean(axis=1), t.mean(axis=1) - middle
    rest = z - level_z[:, None] - slope * inner
    freedom = k * (PARTS - 1) - 1
    variance = float(np.sum(weight * rest**2)) / freedom
    # what neighbouring parts share makes a mean of them less certain; a mean that is taken off
    # makes them look opposed by 1 / parts
    shared = float(np.sum(weight * rest[:, 1:] * rest[:, :-1])) / (k * (PARTS - 1))
    linked = shared / variance + 1.0 / PARTS if variance > 0.0 else 0.0
    if linked > 1.0 / math.sqrt(k * (PARTS - 1)):
        variance *= 1.0 + 2.0 * min(linked, 0.5)
    # levels at the middle of the record: mean less slope times its distance from there
    covariance = np.zeros((k + 1, k + 1))
    covariance[:k, :k] = np.diag(variance / (PARTS * weight[:, 0]))
    lever = np.append(-level_t, 1.0)
    covariance += np.outer(lever, lever) * variance / spread
    return LevelFit(
        means=level_z - slope * level_t,
        slope=slope,
        rest=rest,
        covariance=covariance,
        degrees_of_freedom=float(freedom),
    )


def settled(bounds: ArrayLike, n: int, settling: float) -> Integers:
    """Return the first and after last sample of each level without its start.

    The bounds are the first sample of each level and the sample after the last, shape (k + 1,); the
    stretches have shape (k, 2).
    """
    edges = np.asarray(bounds, dtype=np.intp)
    if not 0.0 <= settling < 1.0:
        raise ModelError(f"the share left out for settling is 0 to below 1, got {settling!r}")
    if edges.ndim != 1 or edges.size < 3 or np.any(np.diff(edges) < 1) or edges[0] < 0:
        raise RecordError("a staircase has two levels or more whose bounds rise from 0")
    if edges[-1] > n:
        raise RecordError(f"the levels end at sample {edges[-1]} of {n}: their bounds are others'")
    starts = edges[:-1] + np.ceil(settling * np.diff(edges)).astype(np.intp)
    spans = np.stack([starts, edges[1:]], axis=1)
    shortest = int(np.diff(spans, axis=1).min())
    if shortest < PARTS:
        raise RecordError(
            f"the shortest level has {shortest} samples after settling, {PARTS} are needed: hold "
            "it for longer, or leave out less"
        )
    return spans
