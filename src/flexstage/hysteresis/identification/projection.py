"""Linear least squares with some coefficients that must not be negative."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import block_diag, solve_triangular
from scipy.optimize import nnls

from flexstage.base.arrays import Array

#: Share of the largest diagonal element that is added to each, so that columns without samples do
#: not make the equations singular; their coefficients are zero.
_RIDGE = 1e-13


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Normal:
    """Normal equations of a projection, with the nuisance columns eliminated.

    Sums over blocks of samples are sums of these, so that leaving a block out is a subtraction.
    """

    gram: Array
    """Products of all columns with one another: coefficients, then nuisance; shape (m + k, m + k).
    """
    right: Array
    """Products of the columns with the output, shape (m + k,)."""
    square: float
    """Sum of squares of the output."""
    count: int
    """Number of samples."""
    columns: int
    """Number m of columns that belong to the model."""

    def __add__(self, other: "Normal") -> "Normal":
        # nuisance columns of two sections are separate
        m, a, b = self.columns, self.gram.shape[0], other.gram.shape[0]
        gram = np.zeros((a + b - m, a + b - m))
        gram[:a, :a] = self.gram
        gram[:m, :m] += other.gram[:m, :m]
        gram[:m, a:] = other.gram[:m, m:]
        gram[a:, :m] = other.gram[m:, :m]
        gram[a:, a:] = other.gram[m:, m:]
        right = np.concatenate((self.right, other.right[m:]))
        right[:m] += other.right[:m]
        square, count = self.square + other.square, self.count + other.count
        return Normal(gram=gram, right=right, square=square, count=count, columns=m)

    def __sub__(self, block: "Normal") -> "Normal":
        # a block of the same section, with the same nuisance columns
        gram, right = self.gram - block.gram, self.right - block.right
        square, count = self.square - block.square, self.count - block.count
        return Normal(gram=gram, right=right, square=square, count=count, columns=self.columns)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Solution:
    """Coefficients of a projection."""

    coefficients: Array
    """Of the columns of the model, shape (m,)."""
    nuisance: Array
    """Of the nuisance columns, shape (k,)."""


def orthonormal(columns: Array, least: float = 1e-7) -> Array:
    """Return orthonormal columns that span others, as far as those differ by a least share."""
    columns = columns / np.maximum(np.linalg.norm(columns, axis=0), 1e-300)
    basis, sizes, _ = np.linalg.svd(columns, full_matrices=False)
    return basis[:, sizes > least * sizes[0]]


def normal_equations(
    columns: Array, nuisance: Array, y: Array, runs: Sequence[slice] = (slice(None),)
) -> Normal:
    """Return the normal equations of columns (n, m) and nuisance columns (n, k)."""
    m, size = columns.shape[1], columns.shape[1] + nuisance.shape[1]
    gram, right, square, count = np.zeros((size, size)), np.zeros(size), 0.0, 0
    for run in runs:
        c, other, outputs = columns[run], nuisance[run], y[run]
        gram[:m, :m] += c.T @ c
        gram[:m, m:] += c.T @ other
        gram[m:, m:] += other.T @ other
        right[:m] += c.T @ outputs
        right[m:] += other.T @ outputs
        square += float(outputs @ outputs)
        count += outputs.size
    gram[m:, :m] = gram[:m, m:].T
    return Normal(gram=gram, right=right, square=square, count=count, columns=m)


def combined(normal: Normal, to: NDArray[Any]) -> Normal:
    """Return the equations of sums of columns: `to` has a column for each sum, shape (m, s)."""
    sums = np.asarray(block_diag(to, np.eye(normal.right.size - normal.columns)))
    gram, right = sums.T @ normal.gram @ sums, sums.T @ normal.right
    return replace(normal, gram=gram, right=right, columns=to.shape[1])


def group_sums(normal: Normal, factors: Array) -> Normal:
    """Return the equations of a weighted sum of groups of columns.

    All groups have the same number of columns: column j of the sum is the sum of the columns j of
    all groups, each times the factor of its group.
    """
    n, m = normal.columns, normal.columns // factors.size
    summed = np.tensordot(factors, normal.gram[:n].reshape(factors.size, m, -1), axes=1)
    gram = np.empty((m + normal.gram.shape[0] - n,) * 2)
    gram[:m, :m] = np.tensordot(summed[:, :n].reshape(m, factors.size, m), factors, axes=([1], [0]))
    gram[:m, m:] = summed[:, n:]
    gram[m:, :m] = gram[:m, m:].T
    gram[m:, m:] = normal.gram[n:, n:]
    right = np.concatenate((factors @ normal.right[:n].reshape(factors.size, m), normal.right[n:]))
    return replace(normal, gram=gram, right=right, columns=m)


def residual_square(normal: Normal, solution: Solution) -> float:
    """Return the sum of squares of the residual of a solution.

    Exact to rounding of the sum of squares of the output.
    """
    x = np.concatenate((solution.coefficients, solution.nuisance))
    return normal.square - 2.0 * float(normal.right @ x) + float(x @ normal.gram @ x)


def residual_square_of_part(part: Normal, solution: Solution, known: NDArray[np.bool_]) -> float:
    """Return the sum of squares of the residual of rows that a solution was not fitted to.

    Nuisance coefficients that are not known, as no row of their record was fitted, are fitted here.
    """
    m, x = part.columns, np.concatenate((solution.coefficients, solution.nuisance))
    free = np.append(np.zeros(m, dtype=bool), ~known & (np.diag(part.gram)[m:] > 0.0))
    right = part.right[free] - part.gram[free][:, ~free] @ x[~free]
    x[free] = np.linalg.lstsq(part.gram[free][:, free], right, rcond=None)[0]
    return residual_square(part, Solution(coefficients=x[:m], nuisance=x[m:]))


def solve(
    normal: Normal,
    *,
    free: NDArray[np.bool_] | None = None,
    smoothing: Array | None = None,
    least: Array | None = None,
) -> Solution:
    """Minimise the sum of squares over coefficients that are at least zero, or `least`.

    Free coefficients are eliminated first, then the rest is a problem of non-negative least squares
    (C. L. Lawson, R. J. Hanson, Solving Least Squares Problems, 1974, chapter 23), whose optimum is
    the global one. Nuisance coefficients are always free. Smoothing is added to the Gram matrix of
    the others, (m, m).
    """
    m = normal.columns
    gram = normal.gram.copy()
    if smoothing is not None:
        gram[:m, :m] += smoothing
    least = np.zeros(m) if least is None else least
    scale = np.sqrt(np.maximum(np.diag(gram), 1e-300))
    right = (normal.right - gram[:, :m] @ least) / scale
    gram /= scale
    gram /= scale[:, None]
    is_free = np.ones(gram.shape[0], dtype=bool)
    is_free[:m] = False if free is None else free
    x = np.zeros(gram.shape[0])
    inner = gram[is_free][:, is_free]
    np.fill_diagonal(inner, inner.diagonal() + _RIDGE)
    across = gram[is_free][:, ~is_free]
    every = np.linalg.solve(inner, np.column_stack((right[is_free], across)))
    free_part, coupling = every[:, 0], every[:, 1:]
    if across.size:
        reduced = gram[~is_free][:, ~is_free] - across.T @ coupling
        x[~is_free] = _non_negative(reduced, right[~is_free] - across.T @ free_part)
    x[is_free] = free_part - coupling @ x[~is_free]
    x /= scale
    return Solution(coefficients=least + x[:m], nuisance=x[m:])


def _non_negative(gram: Array, right: Array) -> Array:
    # the search ends at a gradient that is small by itself, not by the size of the output
    size = float(np.max(np.abs(right), initial=0.0))
    if size == 0.0:
        return np.zeros(right.size)
    gram = 0.5 * (gram + gram.T)
    largest = max(float(np.diag(gram).max()), 1e-300)
    ridge = _RIDGE * largest
    while True:
        try:
            factor = np.linalg.cholesky(gram + ridge * np.eye(right.size))
            break
        except np.linalg.LinAlgError:  # rounding has made it indefinite
            if not ridge < largest:
                raise
            ridge *= 10.0
    target = solve_triangular(factor, right / size, lower=True)
    return size * nnls(factor.T, target, maxiter=50 * right.size)[0]
