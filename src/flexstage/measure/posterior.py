r"""Most probable parameters of a model, and their spread after a measurement.

Parameters x are in units of what is known of them before: normal, of mean 0 and covariance 1. With
the whitened residual r(x) of measured less predicted values, the most probable x minimises

.. math:: \Phi = \tfrac12 r^T r + \tfrac12 x^T x

(A. Tarantola, Inverse Problem Theory, SIAM 2005, section 3.2). With the derivatives J of the
whitened prediction there, the covariance is :math:`(J^T J + 1)^{-1}` (Laplace's approximation).
"""

import math
from dataclasses import dataclass
from typing import Protocol, Self

import numpy as np

from flexstage.base.arrays import Array
from flexstage.base.errors import ConvergenceError

FAR = (
    "the most probable parameters are not reached: the measured values may be far from what the "
    "model can give; widen the spread, or check the units"
)
# in standard deviations of what is known after: a step that ends the search, and one over which
# derivatives need not be found again
_CLOSE = 1e-4
_SAME = 1e-2
_ITERATIONS, _BENT_ITERATIONS = 40, 120


class WhitenedProblem(Protocol):
    """Whitened residuals of a model, over parameters of mean 0 and covariance 1."""

    @property
    def size(self) -> int:
        """Number of parameters."""
        ...

    @property
    def bent(self) -> bool:
        """True where full steps may swing, as derivatives change much over a step."""
        ...

    def residual(self, x: Array) -> Array:
        """Return measured less predicted values, whitened by their covariance, shape (m,)."""
        ...

    def residual_or_refused(self, x: Array) -> Array:
        """Return the residuals, infinite where the model is impossible."""
        ...

    def jacobian(self, x: Array) -> Array:
        """Return the derivatives of the whitened prediction, shape (m, p)."""
        ...


def half_square(residual: Array, x: Array) -> float:
    """Return Phi, half of the squares of residuals and parameters.

    Examples
    --------
    >>> half_square(np.array([1.0, 2.0]), np.array([0.5]))
    2.625
    """
    return 0.5 * float(residual @ residual + x @ x)


def most_probable(
    problem: WhitenedProblem, start: Array | None = None
) -> tuple[Array, Array, Array, int]:
    """Search by Gauss and Newton's steps, from the mean or from a start.

    Returned are the most probable parameters; there the whitened residual and the derivatives of
    the whitened prediction; and the number of steps.
    """
    x = np.zeros(problem.size) if start is None else start
    r = problem.residual(x)
    jacobian = problem.jacobian(x)
    for iteration in range(_BENT_ITERATIONS if problem.bent else _ITERATIONS):
        curvature = jacobian.T @ jacobian + np.eye(x.size)
        step: Array = np.linalg.solve(curvature, jacobian.T @ r - x).astype(np.float64)
        # length of the step in standard deviations of what is known after
        length = math.sqrt(float(step @ curvature @ step))
        if length < _CLOSE:
            return x, r, jacobian, iteration
        x, r = _descended(problem, x, r, step)
        if length > _SAME or problem.bent:
            jacobian = problem.jacobian(x)
    raise ConvergenceError(FAR)


def _descended(problem: WhitenedProblem, x: Array, r: Array, step: Array) -> tuple[Array, Array]:
    """Take a step, halved until it descends; in a bent model, until it descends no further."""
    least = half_square(r, x)
    best: tuple[Array, Array] | None = None
    for halvings in range(20):
        there = x + 0.5**halvings * step
        new = problem.residual_or_refused(there)
        cost = half_square(new, there)
        if best is not None and cost >= least:
            return best
        # rounding leaves that much of the cost
        if cost <= least + 1e-9 * (1.0 + least):
            if not problem.bent:
                return there, new
            best, least = (there, new), cost
    if best is not None:
        return best
    raise ConvergenceError(FAR)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Posterior:
    """What is known of parameters after a measurement, in units of what was known before."""

    covariance: Array
    """Covariance of the parameters [1], shape (p, p)."""

    @classmethod
    def of(cls, jacobian: Array) -> Self:
        """Return the posterior for the derivatives of whitened predictions, shape (m, p)."""
        information = jacobian.T @ jacobian
        covariance = np.linalg.inv(information + np.eye(len(information)))
        return cls(covariance=covariance.astype(np.float64))

    @property
    def learned(self) -> Array:
        """Part of the variance of each parameter that the measurements took away [1]."""
        return 1.0 - np.diag(self.covariance)

    @property
    def informed(self) -> float:
        r"""Number of directions that the measurements inform: :math:`p - \mathrm{tr}\,C`.

        Each singular value s of the derivatives adds :math:`s^2/(1 + s^2)` to it (C. D. Rodgers,
        Inverse Methods for Atmospheric Sounding, World Scientific 2000, section 2.4).
        """
        return float(self.learned.sum())

    def spread(self, rows: Array) -> Array:
        """Return the standard deviation of figures with derivatives (f, p), in their units."""
        return np.sqrt(np.einsum("ij,jk,ik->i", rows, self.covariance, rows))

    def remaining(self, target: Array, candidates: Array, noise: Array) -> Array:
        r"""Return the part of a standard deviation that is left after one more measurement.

        A measurement of h with noise s takes :math:`(g^T C h)^2 / (h^T C h + s^2)` from the
        variance :math:`g^T C g` of a wanted figure: the Schur complement of their covariance.

        Parameters
        ----------
        target : array
            Derivatives g of the wanted figure by the parameters, shape (p,).
        candidates : array
            Derivatives h of what may be measured, shape (k, p).
        noise : array
            Standard deviations s of these measurements, shape (k,).

        Returns
        -------
        array
            Standard deviation after each measurement over that before [1], shape (k,).

        Examples
        --------
        >>> known = Posterior(covariance=np.eye(2))
        >>> sums = np.array([[1.0, 1.0], [0.0, 1.0]])
        >>> known.remaining(np.array([1.0, 0.0]), sums, np.zeros(2)).round(3).tolist()
        [0.707, 1.0]
        """
        towards = candidates @ self.covariance
        variance = np.einsum("ij,ij->i", towards, candidates) + noise**2
        variance_before = float(target @ self.covariance @ target)
        gain = np.divide(
            (towards @ target) ** 2, variance, out=np.zeros(len(candidates)), where=variance > 0.0
        )
        return np.sqrt(np.clip(1.0 - gain / variance_before, 0.0, 1.0))
