"""Functions of position that a measured curve is made of."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from flexstage.arrays import Array
from flexstage.errors import ModelError


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
