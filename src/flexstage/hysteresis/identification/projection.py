"""Linear least squares with some coefficients that must not be negative."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_triangular
from scipy.optimize import nnls

__all__ = ["Normal", "Solution", "normal_equations", "solve"]

Array = NDArray[np.float64]

#: Share of the largest diagonal element that is added to each, so that columns which no sample has
#: exercised do not make the equations singular; they then get nothing.
_RIDGE = 1e-13


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Normal:
    """Normal equations of a projection, with the nuisance columns eliminated.

    Sums over blocks of samples are sums of these, so that leaving a block out is a subtraction.

    Parameters
    ----------
    gram : numpy.ndarray
        Products of all columns with one another: coefficients, then nuisance; shape (m + k, m + k).
    right : numpy.ndarray
        Products of the columns with the output, shape (m + k,).
    square : float
        Sum of squares of the output.
    count : int
        Number of samples.
    columns : int
        Number m of columns that belong to the model.
    """

    gram: Array
    right: Array
    square: float
    count: int
    columns: int

    def __add__(self, other: "Normal") -> "Normal":
        # nuisance columns of two sections stand side by side
        m, a, b = self.columns, self.gram.shape[0], other.gram.shape[0]
        gram = np.zeros((a + b - m, a + b - m))
        gram[:a, :a] = self.gram
        gram[:m, :m] += other.gram[:m, :m]
        gram[:m, a:] = other.gram[:m, m:]
        gram[a:, :m] = other.gram[m:, :m]
        gram[a:, a:] = other.gram[m:, m:]
        right = np.concatenate((self.right, other.right[m:]))
        right[:m] += other.right[:m]
        return Normal(
            gram=gram,
            right=right,
            square=self.square + other.square,
            count=self.count + other.count,
            columns=m,
        )

    def __sub__(self, block: "Normal") -> "Normal":
        # a block of the same section, with the same nuisance columns
        return Normal(
            gram=self.gram - block.gram,
            right=self.right - block.right,
            square=self.square - block.square,
            count=self.count - block.count,
            columns=self.columns,
        )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Solution:
    """Coefficients of a projection.

    Parameters
    ----------
    coefficients : numpy.ndarray
        Of the columns of the model, shape (m,).
    nuisance : numpy.ndarray
        Of the nuisance columns, shape (k,).
    """

    coefficients: Array
    nuisance: Array


def normal_equations(columns: Array, nuisance: Array, y: Array) -> Normal:
    """Return the normal equations of some samples.

    Parameters
    ----------
    columns : numpy.ndarray
        Columns of the model, shape (n, m).
    nuisance : numpy.ndarray
        Further columns, of any sign, shape (n, k).
    y : numpy.ndarray
        Output, shape (n,).

    Returns
    -------
    Normal
        The equations.
    """
    every = np.concatenate((columns, nuisance), axis=1)
    return Normal(
        gram=every.T @ every,
        right=every.T @ y,
        square=float(y @ y),
        count=y.size,
        columns=columns.shape[1],
    )


def solve(
    normal: Normal, *, free: NDArray[np.bool_] | None = None, smoothing: Array | None = None
) -> Solution:
    """Minimise the sum of squares over coefficients that are not negative.

    Free coefficients are eliminated first, then the rest is a problem of non-negative least squares
    (C. L. Lawson, R. J. Hanson, Solving Least Squares Problems, 1974, chapter 23), whose optimum is
    the global one.

    Parameters
    ----------
    normal : Normal
        The equations.
    free : numpy.ndarray, optional
        Which coefficients may be negative, shape (m,); none where not given. The nuisance
        coefficients always may.
    smoothing : numpy.ndarray, optional
        Matrix added to the Gram matrix of the coefficients, shape (m, m).

    Returns
    -------
    Solution
        The coefficients.
    """
    m = normal.columns
    gram = normal.gram.copy()
    if smoothing is not None:
        gram[:m, :m] += smoothing
    scale = np.sqrt(np.maximum(np.diag(gram), 1e-300))
    gram /= np.outer(scale, scale)
    right = normal.right / scale
    loose = np.ones(gram.shape[0], dtype=bool)
    loose[:m] = False if free is None else free
    bound = np.flatnonzero(~loose)
    loose = np.flatnonzero(loose)
    x = np.zeros(gram.shape[0])
    inner = gram[np.ix_(loose, loose)] + _RIDGE * np.eye(loose.size)
    coupling = np.linalg.solve(inner, gram[np.ix_(loose, bound)])
    own = np.linalg.solve(inner, right[loose])
    if bound.size:
        reduced = gram[np.ix_(bound, bound)] - gram[np.ix_(bound, loose)] @ coupling
        rest = right[bound] - gram[np.ix_(bound, loose)] @ own
        x[bound] = _non_negative(reduced, rest)
    x[loose] = own - coupling @ x[bound]
    x /= scale
    return Solution(coefficients=x[:m], nuisance=x[m:])


def _non_negative(gram: Array, right: Array) -> Array:
    # the search ends at a gradient that is small by itself, not by the size of the output
    size = float(np.max(np.abs(right), initial=0.0))
    if size == 0.0:
        return np.zeros(right.size)
    return size * _non_negative_of_unit_size(0.5 * (gram + gram.T), right / size)


def _non_negative_of_unit_size(gram: Array, right: Array) -> Array:
    ridge = _RIDGE * max(float(np.diag(gram).max()), 1e-300)
    for _ in range(8):
        try:
            factor = np.linalg.cholesky(gram + ridge * np.eye(gram.shape[0]))
            break
        except np.linalg.LinAlgError:  # rounding has made it indefinite
            ridge *= 10.0
    else:
        values, vectors = np.linalg.eigh(gram)
        root = np.sqrt(np.maximum(values, ridge))
        target = (vectors.T @ right) / root
        return nnls((vectors * root).T, target, maxiter=50 * right.size)[0]
    target = solve_triangular(factor, right, lower=True)
    return nnls(factor.T, target, maxiter=50 * right.size)[0]
