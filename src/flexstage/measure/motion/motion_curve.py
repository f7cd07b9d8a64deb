"""A reading as a curve over the stroke, forward and backward, its ranges and widths."""

import math
from dataclasses import dataclass, replace
from typing import Literal, get_args

import numpy as np
from numpy.typing import ArrayLike

from flexstage.base.arrays import Array, Integers
from flexstage.base.errors import ModelError
from flexstage.quantities.estimate import Component, Estimate

#: Which run a value is of: forward, backward, or the mean of both.
Direction = Literal["forward", "backward", "mean"]
_WEIGHTS: dict[str, tuple[float, float]] = {
    "forward": (1.0, 0.0),
    "backward": (0.0, 1.0),
    "mean": (0.5, 0.5),
}


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class CurveBasis:
    """Legendre polynomials over a range, or straight pieces between given positions."""

    low: float
    """Lower end of the range."""
    high: float
    """Upper end of the range."""
    order: int
    """Greatest order of the polynomials; with knots, one less than their number."""
    knots: Array | None = None
    """Positions between which the curve is straight, rising, shape (order + 1,)."""

    def __post_init__(self) -> None:
        if not self.high > self.low:
            raise ModelError(
                f"a curve needs a range of positions, got from {self.low:g} to {self.high:g}"
            )

    @property
    def size(self) -> int:
        """Number of functions, k."""
        return self.order + 1

    @property
    def constant(self) -> Array:
        """Coefficients of the function that is 1 everywhere, shape (k,)."""
        if self.knots is not None:
            return np.ones(self.size)
        coefficients = np.zeros(self.size)
        coefficients[0] = 1.0
        return coefficients

    def grid(self, count: int = 401) -> Array:
        """Return even positions over the stroke, `count` of them, and the knots of a staircase."""
        even = np.linspace(self.low, self.high, count)
        return even if self.knots is None else np.union1d(even, self.knots)

    def columns(self, position: ArrayLike) -> Array:
        """Return the functions at positions.

        Examples
        --------
        >>> CurveBasis(low=-2.0, high=2.0, order=2).columns([1.0]).tolist()
        [[1.0, 0.5, -0.125]]
        """
        x = np.asarray(position, dtype=np.float64)
        if self.knots is None:
            s = (2.0 * x - self.low - self.high) / (self.high - self.low)
            return np.asarray(np.polynomial.legendre.legvander(s, self.order), dtype=np.float64)
        functions = np.zeros((x.size, self.size))
        i = np.clip(np.searchsorted(self.knots, x, side="right") - 1, 0, self.order - 1)
        share = np.clip((x - self.knots[i]) / (self.knots[i + 1] - self.knots[i]), 0.0, 1.0)
        rows = np.arange(x.size)
        functions[rows, i] = 1.0 - share
        functions[rows, i + 1] = share
        return functions


def position_weights(position: Array) -> Array:
    """Return what positions count by in a mean over the stroke, by the trapezoidal rule.

    Examples
    --------
    >>> position_weights(np.array([0.0, 1.0, 4.0]))
    array([0.125, 0.5  , 0.375])
    """
    steps = np.diff(position)
    weights = np.zeros(position.size)
    weights[:-1] += 0.5 * steps
    weights[1:] += 0.5 * steps
    return weights / steps.sum()


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class MotionCurve:
    r"""A reading over the stroke, from repeated cycles, free of drift and of offsets of cycles.

    In cycle c the reading is :math:`f_d(x) + r t + o_c` and noise, with one curve f for each
    direction d, a drift rate r and an offset o. Each cycle gives coefficients of its own; their
    mean is the result, and their scatter from cycle to cycle its uncertainty, so that noise which
    is correlated within a cycle counts in full. `fit_motion_curve` makes one.

    Validity
    --------
    Cycles that are equal except for noise, an offset and a linear drift over the record; a
    transient at the beginning must be excluded first (`motion_cycles` has `skip`). A disturbance
    that repeats in each cycle is not separable from the curve.
    """

    basis: CurveBasis
    """Functions of position that the curve is made of, k of them."""
    coefficients: Array
    """Of the forward and of the backward curve, drift removed, shape (2, k)."""
    scatter: Array
    """What each cycle's coefficients differ from them by, shape (c, 2, k)."""
    drift_rate: Estimate | None
    """Rate of the drift, in the unit of the reading over s; None where it was not fitted."""
    drift_effect: Array
    """What the coefficients would grow by for a unit of drift rate left in them [s], shape (2, k).
    """
    structure: Array
    """Covariance of the coefficients for white noise, scaled to the scatter, shape (2, k, k)."""
    noise: float
    """Rms of what a cycle's samples differ from its own curve by."""
    model_error: float
    """Rms of what all cycles have in common and the curve has not; 0 where noise explains it."""
    unit: str = "m"
    """Unit of the reading."""
    position_unit: str = ""
    """Unit of the position."""
    notes: tuple[str, ...] = ()
    """What a reader should know."""

    @property
    def cycles(self) -> int:
        """Number of cycles."""
        return self.scatter.shape[0]

    def grid(self, count: int = 401) -> Array:
        """Return even positions over the stroke.

        Parameters
        ----------
        count : int
            How many, without the knots of a staircase, which are joined to them.

        Returns
        -------
        numpy.ndarray
            Positions, rising.
        """
        return self.basis.grid(count)

    def rows(self, position: ArrayLike, direction: Direction) -> Array:
        """Return what the flattened coefficients count by at positions, shape (n, 2 k).

        Raises
        ------
        ModelError
            There is no such direction, or a position is outside the stroke by more than a
            thousandth of it.
        """
        if direction not in _WEIGHTS:
            raise ModelError(
                f"the direction must be one of {', '.join(_WEIGHTS)}, got '{direction}'"
            )
        x = np.atleast_1d(np.asarray(position, dtype=np.float64))
        low, high = self.basis.low, self.basis.high
        margin = 1e-3 * (high - low)
        if not np.all((x >= low - margin) & (x <= high + margin)):
            raise ModelError(
                f"the curve is known from {low:g} to {high:g} {self.position_unit}, asked for "
                f"{x.min():g} to {x.max():g}"
            )
        columns = self.basis.columns(x)
        forward, backward = _WEIGHTS[direction]
        return np.hstack((forward * columns, backward * columns))

    def value(self, position: ArrayLike, direction: Direction = "mean") -> Array:
        """Return the curve at positions within the stroke, shape (n,)."""
        return self.rows(position, direction) @ self.coefficients.ravel()

    def functional(
        self, weights: ArrayLike, position: ArrayLike, direction: Direction = "mean"
    ) -> Estimate:
        """Return the sum of values at positions times weights, both of shape (n,)."""
        w = np.atleast_1d(np.asarray(weights, dtype=np.float64))
        reach = float(np.linalg.norm(w))
        return self.of_coefficients(w @ self.rows(position, direction), reach=reach)

    def of_coefficients(self, weights: Array, *, reach: float = 1.0) -> Estimate:
        """Return a weighted sum of the flattened coefficients; the weights have shape (2 k,).

        Its uncertainty is from the scatter of the cycles, with one degree of freedom less than
        there are cycles, two less where it depends on the level and a drift was fitted. `reach` is
        the factor on the model error of the curve.
        """
        c = self.cycles
        each = self.scatter.reshape(c, -1) @ weights
        constant = np.tile(self.basis.constant, 2)
        # a functional whose weights cancel to this share of their size does not see offsets
        no_level = 1e-9
        level = abs(float(weights @ constant)) > no_level * float(np.abs(weights).sum())
        lost = 2 if level and self.drift_rate is not None else 1
        parts = [
            Component(
                name="repeatability",
                uncertainty=math.sqrt(float(each @ each) / ((c - lost) * c)),
                degrees_of_freedom=c - lost,
            )
        ]
        if self.drift_rate is not None:
            effect = abs(float(self.drift_effect.ravel() @ weights))
            parts.append(
                Component(
                    name="drift",
                    uncertainty=effect * self.drift_rate.uncertainty,
                    degrees_of_freedom=self.drift_rate.degrees_of_freedom,
                )
            )
        if self.model_error > 0.0:
            parts.append(Component(name="shape", uncertainty=reach * self.model_error, kind="B"))
        return Estimate(
            value=float(weights @ self.coefficients.ravel()),
            unit=self.unit,
            components=tuple(parts),
        )

    def each_cycle(self, weights: Array) -> Array:
        """Return a weighted sum of the coefficients of each cycle, drift removed, shape (c,).

        The weights, of the flattened coefficients, have shape (2 k,).
        """
        return (self.scatter + self.coefficients).reshape(self.cycles, -1) @ weights

    def slope(self, direction: Direction = "mean") -> Estimate:
        """Return the slope of the least-squares line through the curve, with equal weights.

        In the unit of the reading over that of the position.
        """
        x = self.grid()
        w = position_weights(x)
        centred = x - w @ x
        slope = self.functional(w * centred / (w @ centred**2), x, direction)
        unit = f"{self.unit}/{self.position_unit}"
        return slope.times(1.0, "1" if self.unit == self.position_unit else unit)

    def reversal(self) -> Estimate:
        """Return the forward less the backward curve, averaged over the stroke."""
        x = self.grid()
        difference = self.rows(x, "forward") - self.rows(x, "backward")
        return self.of_coefficients(position_weights(x) @ difference)


#: Straight line that a deviation is taken from.
Line = Literal["none", "least_squares", "terminal", "minimum_zone"]
_LINES = get_args(Line)
#: Curves that are simulated to find what noise adds to an extreme.
_TRIALS = 400
_NOISE_NOTE = "corrected for a noise bias of {:.2g} {}"


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Extreme:
    """A figure of the largest and smallest of some linear figures of the coefficients.

    It is the largest less the smallest, of `rows`, or with `absolute` the largest magnitude.
    """

    rows: Array
    absolute: bool = False

    @property
    def reach(self) -> float:
        """Factor on the model error: the errors at two places add."""
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
        # a straight line changes no zone: without it noise and shape are separable
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
        raise ModelError(f"the line must be one of {', '.join(_LINES)}, got '{line}'")
    g, w = position.size, position_weights(position)
    if line == "none":
        return np.zeros((g, g))
    if line == "terminal":
        share = (position - position[0]) / (position[-1] - position[0])
        weights = np.zeros((g, g))
        weights[:, 0] = 1.0 - share
        weights[:, -1] += share
        return weights
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
    estimate = curve.of_coefficients(figure.weights(coefficients), reach=figure.reach)
    alone = float(np.quantile(figure.of(wide), 0.95))
    return _corrected(estimate, observed, added, alone)


def _corrected(estimate: Estimate, observed: float, added: float, alone: float) -> Estimate:
    """Return a figure that cannot be negative less what noise adds to it.

    Noise alone exceeds `alone` once in twenty times: below it the interval begins at 0.
    """
    value = max(observed - added, 0.0)
    note = (
        _NOISE_NOTE.format(added, estimate.unit) if abs(added) > 1e-3 * observed else estimate.note
    )
    result = replace(estimate, value=value, note=note)
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
