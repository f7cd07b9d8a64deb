"""The least-squares problem of harmonics: its functions, and its solution."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from flexstage.arrays import Array
from flexstage.centring.normal_equations import NormalEquations, accumulated, evaluated
from flexstage.errors import RecordError

#: Functions that are more alike than this cannot be told apart in double precision.
_WORST_CONDITION = 1e9


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class HarmonicProblem:
    """Columns of values over turns, and the functions that are fitted to them."""

    u: Array
    """Angle of each sample [turn], shape (n,)."""
    y: Array
    """The values, shape (n, m)."""
    orders: tuple[int, ...]
    """Orders, rising."""
    drift: bool
    """Whether a change in proportion to the angle is fitted."""
    middle: float
    """Middle of the angles [turn], to which the offset belongs."""
    bounds: Sequence[int] | None
    """First sample of each turn and, at the end, the number of samples, where turns are told apart.
    """

    def column(self, j: int) -> "HarmonicProblem":
        """Return the problem of one column alone."""
        return replace(self, y=self.y[:, j : j + 1])

    def sums(self, weights: Array | None) -> NormalEquations:
        """Return the normal equations."""
        return accumulated(
            self.u, self.y, self.orders, drift=self.drift, weights=weights, bounds=self.bounds
        )

    def residual(self, coefficients: Array) -> Array:
        """Return what coefficients leave of the values."""
        fitted = evaluated(self.u, coefficients, self.orders, drift=self.drift)
        return np.subtract(self.y, fitted, out=fitted)

    @property
    def first(self) -> int:
        """Number of coefficients before those of the harmonics."""
        return 2 if self.drift else 1


def solved(equations: NormalEquations, orders: tuple[int, ...]) -> Array:
    """Return the coefficients."""
    gram = equations.gram.sum(axis=0)
    scale = 1.0 / np.sqrt(np.maximum(np.diag(gram), np.finfo(float).tiny))
    if np.linalg.cond(gram * np.outer(scale, scale)) > _WORST_CONDITION:
        raise RecordError(
            f"the samples do not separate the harmonics up to order {orders[-1]}: more than "
            f"{2 * orders[-1]} different angles in a turn are needed, without large gaps; fit "
            "fewer orders"
        )
    return np.linalg.solve(gram, equations.right.sum(axis=0))


def of_column(equations: NormalEquations, j: int) -> NormalEquations:
    """Return the normal equations of one column."""
    return NormalEquations(
        gram=equations.gram,
        right=equations.right[:, :, j : j + 1],
        squares=equations.squares[:, j : j + 1],
    )
