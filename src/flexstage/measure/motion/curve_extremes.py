"""Ranges and widths of a measured curve, less what noise adds to them."""

import math
from dataclasses import dataclass, replace
from typing import Literal, get_args

import numpy as np

from flexstage.arrays import Array, Integers
from flexstage.errors import ModelError
from flexstage.estimate import Estimate
from flexstage.measure.motion.motion_curve import Direction, MotionCurve, position_weights

#: Straight line that a deviation is taken from.
Line = Literal["none", "least_squares", "terminal", "minimum_zone"]
_LINES = get_args(Line)
#: Curves that are simulated to find what noise adds to an extreme.
_TRIALS = 400
_NOISE_NOTE = "less what noise adds to it, {:.2g} {}"


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Extreme:
    """A figure of the largest and smallest of some linear figures of the coefficients.

    It is the largest less the smallest, of `rows`, or with `absolute` the largest magnitude.
    """

    rows: Array
    absolute: bool = False

    @property
    def reach(self) -> float:
        """How many times the misfit counts: misfits at two places add."""
        return 1.0 if self.absolute else math.sqrt(2.0)

    def of(self, coefficients: Array) -> Array:
        values = coefficients @ self.rows.T
        if self.absolute:
            return np.abs(values).max(axis=-1)
        return np.ptp(values, axis=-1)

    def weights(self, coefficients: Array) -> Array:
        """Return the derivative of the figure after the coefficients."""
        values = self.rows @ coefficients
        if self.absolute:
            at = int(np.argmax(np.abs(values)))
            return math.copysign(1.0, values[at]) * self.rows[at]
        return self.rows[int(np.argmax(values))] - self.rows[int(np.argmin(values))]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Zone:
    """The width of the narrowest zone about the values at positions, of one run or of two."""

    position: Array
    rows: Array  # (r g, 2 k)
    reach: float = 1.5

    def of(self, coefficients: Array) -> Array:
        each = [self._contacts(c)[0] for c in np.atleast_2d(coefficients)]
        return np.reshape(each, coefficients.shape[:-1])

    def weights(self, coefficients: Array) -> Array:
        """Return the derivative of the width after the coefficients."""
        return self._contacts(coefficients)[1].ravel() @ self.rows

    def _contacts(self, coefficients: Array) -> tuple[float, Array]:
        values = self.rows @ coefficients
        return zone_contacts(self.position, values.reshape(-1, self.position.size))


def curve_range(
    curve: MotionCurve,
    direction: Direction = "mean",
    *,
    line: Line = "none",
) -> Estimate:
    """Return the largest less the smallest value of a curve, about a line or as it is.

    To first order the range is the difference of the curve at the two places where it is extreme
    (three, about the line of the minimum zone), and so has their uncertainty. An extreme of a noisy
    curve lies too far out; how far is found by simulation about the curve, and taken off.

    Parameters
    ----------
    curve : MotionCurve
        The curve.
    direction : {"forward", "backward", "mean"}
        Which run.
    line : {"none", "least_squares", "terminal", "minimum_zone"}
        Straight line that is taken off: none; the least-squares line; that through the ends; the
        one about which the range is least.

    Returns
    -------
    Estimate
        The range, less what noise adds to it.

    Validity
    --------
    Where noise is as large as the range itself, the interval begins at 0.

    Raises
    ------
    ModelError
        There is no such direction or line.
    """
    # curves that are simulated to find what noise adds: each takes a search of its own
    zone_trials = 120
    if line == "minimum_zone":
        # what a straight line adds changes no zone: without it the noise is told from the shape
        x = curve.grid(201)
        zone = _Zone(position=x, rows=_deviation_rows(curve, direction, "least_squares", x))
        return _estimate(curve, zone, zone_trials)
    rows = _deviation_rows(curve, direction, line, curve.grid())
    return _estimate(curve, _Extreme(rows=rows))


def curve_loop_width(curve: MotionCurve) -> Estimate:
    """Return the largest distance of the backward from the forward curve at equal position.

    Parameters
    ----------
    curve : MotionCurve
        The curve.

    Returns
    -------
    Estimate
        The width, less what noise adds to it.
    """
    x = curve.grid()
    rows = curve.rows(x, "backward") - curve.rows(x, "forward")
    return _estimate(curve, _Extreme(rows=rows, absolute=True))


def line_weights(position: Array, line: Line) -> Array:
    """Return the matrix, shape (g, g), that gives a line from the values of a curve.

    Examples
    --------
    >>> x = np.array([0.0, 1.0, 4.0])
    >>> line_weights(x, "terminal") @ np.array([3.0, 9.0, 11.0])
    array([ 3.,  5., 11.])
    """
    if line not in _LINES or line == "minimum_zone":
        raise ModelError(f"a line is one of {', '.join(_LINES)}, got '{line}'")
    g, w = position.size, position_weights(position)
    if line == "none":
        return np.zeros((g, g))
    if line == "terminal":
        share = (position - position[0]) / (position[-1] - position[0])
        found = np.zeros((g, g))
        found[:, 0] = 1.0 - share
        found[:, -1] += share
        return found
    centred = position - w @ position
    return np.tile(w, (g, 1)) + np.outer(centred, w * centred / (w @ centred**2))


def _deviation_rows(curve: MotionCurve, direction: Direction, line: Line, x: Array) -> Array:
    """Return what coefficients count by in the distances from the line at positions."""
    rows = curve.rows(x, direction)
    return rows - line_weights(x, line) @ rows


def _estimate(curve: MotionCurve, figure: _Extreme | _Zone, trials: int = _TRIALS) -> Estimate:
    coefficients = curve.coefficients.ravel()
    observed = float(figure.of(coefficients))
    noise, wide = (n[:: max(n.shape[0] // trials, 1)] for n in _noise_of_coefficients(curve))
    truth = _shrunk(curve, figure.rows)
    added = float(figure.of(truth + noise).mean() - figure.of(truth))
    found = curve.of_coefficients(figure.weights(coefficients), reach=figure.reach)
    alone = float(np.quantile(figure.of(wide), 0.95))
    return _corrected(found, observed, added, alone)


def _corrected(found: Estimate, observed: float, added: float, alone: float) -> Estimate:
    """Return a figure that cannot be negative less what noise adds to it.

    Noise alone exceeds `alone` once in twenty times: below it the interval begins at 0.
    """
    value = max(observed - added, 0.0)
    note = _NOISE_NOTE.format(added, found.unit) if abs(added) > 1e-3 * observed else found.note
    result = replace(found, value=value, note=note)
    low, high = result.interval()
    return replace(result, bounds=(0.0, high)) if low < 0.0 or observed <= alone else result


def _noise_of_coefficients(curve: MotionCurve) -> tuple[Array, Array]:
    """Simulate errors of the coefficients of a curve.

    Errors of the flattened coefficients as large as they are thought to be, and with the spread of
    Student's t, as so few cycles tell little of how large they are; shape (trials, 2 k).
    """
    rng = np.random.default_rng(np.random.SeedSequence(0, spawn_key=(0,)))
    k = curve.basis.size
    draws = rng.standard_normal((_TRIALS // 2, 2, k))
    parts = []
    for d in (0, 1):
        values, vectors = np.linalg.eigh(curve.structure[d])
        root = vectors * np.sqrt(np.maximum(values, 0.0))
        parts.append(draws[:, d] @ root.T)
    noise = np.hstack(parts)
    freedom = curve.cycles - 1
    wide = noise * np.sqrt(freedom / rng.chisquare(freedom, _TRIALS // 2))[:, None]
    if curve.drift_rate is not None:
        rate = curve.drift_rate
        error = np.outer(rng.standard_normal(_TRIALS // 2), curve.drift_effect.ravel())
        error *= rate.uncertainty
        dof = rate.degrees_of_freedom
        noise = noise + error
        wide = wide + error * np.sqrt(dof / rng.chisquare(dof, _TRIALS // 2))[:, None]
    # with their opposites, so that what is odd in the noise leaves nothing
    return np.vstack((noise, -noise)), np.vstack((wide, -wide))


def _shrunk(curve: MotionCurve, rows: Array) -> Array:
    """Return coefficients from which the share of noise is taken, as James and Stein (1961) do.

    Measured values spread by noise as well as by what is measured: to simulate about them as they
    are would count the noise twice. `rows` are what coefficients count by in the values whose
    spread is looked at, shape (g, 2 k).
    """
    coefficients = curve.coefficients.ravel()
    k = curve.basis.size
    spread = float(np.mean((rows @ coefficients) ** 2))
    of_noise = float(
        np.mean(sum(
            np.einsum("gi,ij,gj->g", rows[:, d * k : (d + 1) * k], curve.structure[d],
                      rows[:, d * k : (d + 1) * k])
            for d in (0, 1)
        ))
    )  # fmt: skip
    if curve.drift_rate is not None:
        drift = rows @ curve.drift_effect.ravel() * curve.drift_rate.uncertainty
        of_noise += float(np.mean(drift**2))
    if spread <= 0.0:
        return coefficients
    return max(1.0 - of_noise / spread, 0.0) ** 0.5 * coefficients


def zone_contacts(position: Array, values: Array) -> tuple[float, Array]:
    """Return the width of the narrowest zone about values, and how it depends on them.

    The zone touches two points on one side and one between them on the other (`narrowest_strip`);
    its width, in the direction of the values, is the distance of the one from the line through the
    two. With several values at each position, shape (r, g); the weights are the derivative of the
    width after the values, in their shape.

    Examples
    --------
    >>> width, weights = zone_contacts(np.array([0.0, 1.0, 4.0]), np.array([0.0, 3.0, 4.0]))
    >>> float(width), weights.tolist()
    (2.0, [-0.75, 1.0, -0.25])
    """
    y = np.asarray(values, dtype=np.float64)
    flat, x = y.ravel(), np.tile(position, y.size // position.size)
    first, second, opposite = narrowest_strip(x, flat)
    share = (x[opposite] - x[first]) / (x[second] - x[first])
    height = flat[opposite] - (1.0 - share) * flat[first] - share * flat[second]
    weights = np.zeros(flat.size)
    sides = math.copysign(1.0, height) * np.array([1.0, share - 1.0, -share])
    # a point may be its own neighbour where two lie one over the other
    np.add.at(weights, [opposite, first, second], sides)
    return abs(float(height)), weights.reshape(y.shape)


def narrowest_strip(x: Array, y: Array) -> tuple[int, int, int]:
    """Return the three points that the strip rests on whose width along y is least.

    It is the longest chord of the convex hull along y, which begins at a corner (Chebyshev's fit of
    a line). Two of the points are on one line, from left to right, and the third is on the other.

    Examples
    --------
    >>> narrowest_strip(np.array([0.0, 1.0, 3.0]), np.array([0.0, 0.7, 0.1]))
    (0, 2, 1)
    """
    # a tilt and a scale change no hull, but the rounding of the cross products
    a, b = x - x.mean(), y - y.mean()
    b = b - float(a @ b / (a @ a)) * a
    b = b / (float(np.abs(b).max()) or 1.0)
    halves = _upper_hull(a, b), _upper_hull(a, -b)
    i, j = (np.concatenate([half[part] for half in halves]) for part in (slice(-1), slice(1, None)))
    slope = (y[j] - y[i]) / (x[j] - x[i])
    # differences first, so that no large ordinate is subtracted from another
    heights = np.abs((y - y[i, None]) - slope[:, None] * (x - x[i, None]))
    opposite = np.argmax(heights, axis=1)
    best = int(np.argmin(heights[np.arange(i.size), opposite]))
    return int(i[best]), int(j[best]), int(opposite[best])


def _upper_hull(x: Array, y: Array) -> Integers:
    """Corners of the upper half of the convex hull, from left to right (Andrew, 1979)."""
    order = np.lexsort((-y, x))
    # of points one over the other the highest alone can be a corner
    order = order[np.concatenate(([True], np.diff(x[order]) > 0.0))]
    hull: list[int] = []
    for k, u, v in zip(order.tolist(), x[order].tolist(), y[order].tolist(), strict=True):
        while len(hull) > 1:
            p, q = hull[-2], hull[-1]
            if (x[q] - x[p]) * (v - y[p]) < (y[q] - y[p]) * (u - x[p]):
                break
            hull.pop()
        hull.append(k)
    return np.array(hull, dtype=np.intp)
