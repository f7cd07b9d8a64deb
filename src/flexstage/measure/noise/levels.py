"""Levels of a staircase: where they begin and end, their means, and the drift that they share."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from flexstage.arrays import Array, Integers
from flexstage.errors import ModelError, RecordError
from flexstage.estimate import Estimate

#: Parts of a level whose means tell how certain its mean is.
PARTS = 6


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
        raise RecordError("the command has fewer than two levels: name the column that holds it")
    return bounds


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
        return self._estimate(float(by[:-1] @ self.means), by, unit)

    def drift(self, rate: float, unit: str) -> Estimate:
        """Return the drift within the levels.

        In the unit of the readings in a second; `rate` in Hz.
        """
        by = np.concatenate([np.zeros(self.means.size), [rate]])
        return self._estimate(rate * self.slope, by, f"{unit}/s")

    def _estimate(self, value: float, by: Array, unit: str) -> Estimate:
        uncertainty = math.sqrt(max(float(by @ self.covariance @ by), 0.0))
        return Estimate.of(value, uncertainty, unit, degrees_of_freedom=self.degrees_of_freedom)


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
