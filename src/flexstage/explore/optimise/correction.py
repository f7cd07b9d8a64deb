"""What a finer model says beyond a coarse one, carried to points nearby."""

from dataclasses import dataclass
from typing import Self

import numpy as np

from flexstage.arrays import Array
from flexstage.explore.optimise.walls import Bools

# a factor beyond which two values are unlike each other: then their difference is carried
_ALIKE = 5.0
# steps shorter than this, in parts of the bounds, say nothing of how the discrepancy changes
_TELLING = 0.01


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Correction:
    """The discrepancy of two models, to first order about a point."""

    at: Array
    """The point, variables from 0 to 1, shape (d,)."""
    factor: Bools
    """Which figures have a factor, and which a difference, shape (m,)."""
    shift: Array
    """Logarithm of the factor, or the difference, there, shape (m,)."""
    slope: Array
    """How that changes with the variables, shape (m, d)."""

    @classmethod
    def none(cls, variables: int, figures: int) -> Self:
        """Return the correction of a model that is taken as it is."""
        return cls(
            at=np.zeros(variables),
            factor=np.ones(figures, dtype=bool),
            shift=np.zeros(figures),
            slope=np.zeros((figures, variables)),
        )

    def at_points(self, points: Array, coarse: Array) -> Array:
        """Return corrected values, shape (S, m), at points (S, d)."""
        shift = self.shift + (points - self.at) @ self.slope.T
        return np.where(self.factor, coarse * np.exp(shift * self.factor), coarse + shift)

    def of_slopes(self, point: Array, coarse: Array, slopes: Array) -> tuple[Array, Array]:
        """Return corrected values (m,) and slopes (m, d) at a point."""
        values = self.at_points(point[None], coarse[None])[0]
        shift = self.shift + self.slope @ (point - self.at)
        factor = np.exp(shift * self.factor)
        scaled = factor[:, None] * slopes + values[:, None] * self.slope
        return values, np.where(self.factor[:, None], scaled, slopes + self.slope)

    def updated(self, point: Array, coarse: Array, fine: Array) -> "Correction":
        """Return the correction that is exact at another point.

        The slope takes the least change by which it explains the old discrepancy too (Broyden 1965,
        Math. Comp. 19, 577, as manifold mapping has it: Echeverria, Hemker 2005).

        Parameters
        ----------
        point : array
            The point, shape (d,).
        coarse, fine : array
            What the two models say there, shape (m,).

        Examples
        --------
        >>> none = Correction.none(1, 1)
        >>> known = none.updated(np.array([0.5]), np.array([300.0]), np.array([330.0]))
        >>> known.at_points(np.array([[0.5], [0.6]]), np.array([[300.0], [310.0]]))
        array([[330.],
               [341.]])
        """
        with np.errstate(divide="ignore", invalid="ignore"):
            ratio = fine / coarse
        factor = np.isfinite(ratio) & (ratio > 1.0 / _ALIKE) & (ratio < _ALIKE)
        shift = np.where(factor, np.log(np.where(factor, ratio, 1.0)), fine - coarse)
        first = not (self.shift.any() or self.slope.any())
        step = point - self.at
        length = float(step @ step)
        slope = self.slope
        if not first and length > _TELLING**2:
            missed = shift - self.shift - slope @ step
            slope = slope + np.outer(missed, step) / length
        slope = np.where((factor == self.factor)[:, None], slope, 0.0)
        return Correction(at=point, factor=factor, shift=shift, slope=slope)
