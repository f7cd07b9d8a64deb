"""A reading as a curve over the stroke, forward and backward, with its uncertainty."""

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from flexstage.arrays import Array
from flexstage.errors import ModelError
from flexstage.estimate import Component, Estimate

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
        found = np.zeros(self.size)
        found[0] = 1.0
        return found

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
        found = np.zeros((x.size, self.size))
        i = np.clip(np.searchsorted(self.knots, x, side="right") - 1, 0, self.order - 1)
        share = np.clip((x - self.knots[i]) / (self.knots[i + 1] - self.knots[i]), 0.0, 1.0)
        rows = np.arange(x.size)
        found[rows, i] = 1.0 - share
        found[rows, i + 1] = share
        return found


def position_weights(position: Array) -> Array:
    """Return what positions count by in a mean over the stroke, by the trapezoidal rule.

    Examples
    --------
    >>> position_weights(np.array([0.0, 1.0, 4.0]))
    array([0.125, 0.5  , 0.375])
    """
    steps = np.diff(position)
    found = np.zeros(position.size)
    found[:-1] += 0.5 * steps
    found[1:] += 0.5 * steps
    return found / steps.sum()


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class MotionCurve:
    r"""A reading over the stroke, from repeated cycles, free of drift and of offsets of cycles.

    In cycle c the reading is :math:`f_d(x) + r t + o_c` and noise, with one curve f for each
    direction d, a drift rate r and an offset o. Each cycle gives coefficients of its own; their
    mean is the result, and their scatter from cycle to cycle its uncertainty, so that noise which
    is correlated within a cycle counts in full. `fit_motion_curve` makes one.

    Validity
    --------
    Cycles that are alike but for noise, an offset and a drift that is linear over the record; a
    transient at the beginning is left out before (`motion_cycles` has `skip`). What repeats in each
    cycle cannot be told from the curve.
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
    misfit: float
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
            raise ModelError(f"a direction is one of {', '.join(_WEIGHTS)}, got '{direction}'")
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
        how many times the misfit of the curve counts.
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
        if self.misfit > 0.0:
            parts.append(Component(name="shape", uncertainty=reach * self.misfit, kind="B"))
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
        """Return the slope of the least-squares line through the curve, all positions alike.

        In the unit of the reading over that of the position.
        """
        x = self.grid()
        w = position_weights(x)
        centred = x - w @ x
        found = self.functional(w * centred / (w @ centred**2), x, direction)
        unit = f"{self.unit}/{self.position_unit}"
        return found.times(1.0, "1" if self.unit == self.position_unit else unit)

    def reversal(self) -> Estimate:
        """Return the forward less the backward curve, averaged over the stroke."""
        x = self.grid()
        difference = self.rows(x, "forward") - self.rows(x, "backward")
        return self.of_coefficients(position_weights(x) @ difference)
