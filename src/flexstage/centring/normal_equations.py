"""The normal equations of a fit of harmonics: summed in one pass with little memory, and solved."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from flexstage.arrays import Array
from flexstage.errors import RecordError

#: Samples that are worked on together: their tables stay in the processor's own memory.
_CHUNK = 4096


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class NormalEquations:
    """Sums of the products of the functions that are fitted, with each other and with the values.

    The functions are 1, the turn number where there is a drift, then cosine and sine of each order.
    """

    gram: Array
    """Of the functions with each other, for each group of samples, shape (groups, p, p)."""
    right: Array
    """Of the functions with each column of values, shape (groups, p, m)."""
    squares: Array
    """Of the values with themselves, shape (groups, m)."""


def accumulated(
    turns: Array,
    values: Array,
    orders: Sequence[int],
    *,
    drift: bool,
    weights: Array | None = None,
    bounds: Sequence[int] | None = None,
) -> NormalEquations:
    """Sum over samples what the fit of harmonics needs.

    `turns` is the angle of each sample [turn], `values` columns over it, shape (n, m). A weight of
    zero leaves a sample out. `bounds` are the first sample of each group and the number of samples;
    all are one group without it.

    Products of cosines are cosines of sums and differences of orders: not the products of all pairs
    of functions are summed, but cosines and sines up to twice the highest order, each found from
    the two before it.
    """
    edges = [0, turns.size] if bounds is None else list(bounds)
    highest = max(orders, default=0)
    m = values.shape[1]
    groups = len(edges) - 1
    # rows: cosine and sine of each order; columns: weight, weight x turn, weighted values
    table = np.zeros((groups, 2, 2 * highest + 1, 2 + m))
    drifts = np.zeros((groups, 1 + m))
    squares = np.zeros((groups, m))
    for g in range(groups):
        for start in range(edges[g], edges[g + 1], _CHUNK):
            part = slice(start, min(start + _CHUNK, edges[g + 1]))
            u, y = turns[part], values[part]
            w = np.ones(u.size) if weights is None else weights[part]
            columns = np.column_stack((w, w * u, y * w[:, None]))
            waves = _waves(u, 2 * highest)
            # the values are needed up to the highest order only
            table[g, :, :, :2] += waves @ columns[:, :2]
            table[g, :, : highest + 1, 2:] += waves[:, : highest + 1] @ columns[:, 2:]
            squares[g] += np.einsum("ij,ij->j", y, columns[:, 2:])
            drifts[g] += u @ columns[:, 1:]
    return NormalEquations(
        gram=_gram(table, drifts, orders, drift),
        right=_right(table, drifts, orders, drift),
        squares=squares,
    )


def evaluated(turns: Array, coefficients: Array, orders: Sequence[int], *, drift: bool) -> Array:
    """Return the sum of the functions, in the order of `NormalEquations`, shape (n, m)."""
    # each column in one piece, as what comes after goes through columns
    out = np.empty((coefficients.shape[1], turns.size)).T
    first = 2 if drift else 1
    at = np.asarray(orders, dtype=np.intp)
    for start in range(0, turns.size, _CHUNK):
        part = slice(start, start + _CHUNK)
        waves = _waves(turns[part], max(orders, default=0))
        out[part] = (
            coefficients[0]
            + waves[0, at].T @ coefficients[first::2]
            + waves[1, at].T @ coefficients[first + 1 :: 2]
        )
        if drift:
            out[part] += turns[part, None] * coefficients[1]
    return out


def _waves(turns: Array, highest: int) -> Array:
    """Return cosine and sine of the orders 0 to the highest, shape (2, highest + 1, n)."""
    out = np.empty((2, highest + 1, turns.size))
    out[0, 0], out[1, 0] = 1.0, 0.0
    if highest == 0:
        return out
    # whole turns are taken off while they are exact
    x = 2.0 * np.pi * (turns - np.rint(turns))
    np.cos(x, out=out[0, 1])
    np.sin(x, out=out[1, 1])
    twice = 2.0 * out[0, 1]
    for k in range(2, highest + 1):
        np.multiply(out[:, k - 1], twice, out=out[:, k])
        out[:, k] -= out[:, k - 2]
    return out


def _gram(table: Array, drifts: Array, orders: Sequence[int], drift: bool) -> Array:
    k = np.asarray(orders, dtype=np.intp)
    c, s = table[:, 0, :, 0], table[:, 1, :, 0]
    total, apart = k[:, None] + k[None, :], k[:, None] - k[None, :]
    near = c[:, np.abs(apart)]
    sine = np.sign(apart) * s[:, np.abs(apart)]
    first = 2 if drift else 1
    out = np.zeros((table.shape[0], first + 2 * k.size, first + 2 * k.size))
    out[:, first::2, first::2] = 0.5 * (near + c[:, total])
    out[:, first + 1 :: 2, first + 1 :: 2] = 0.5 * (near - c[:, total])
    # cos(a) sin(b) = (sin(a + b) - sin(a - b)) / 2
    mixed = 0.5 * (s[:, total] - sine)
    out[:, first::2, first + 1 :: 2] = mixed
    out[:, first + 1 :: 2, first::2] = np.swapaxes(mixed, 1, 2)
    edge = [(0, c[:, 0], 0)] + ([(1, table[:, 0, 0, 1], 1)] if drift else [])
    for row, own, column in edge:
        out[:, row, 0] = out[:, 0, row] = own
        for offset, wave in ((first, 0), (first + 1, 1)):
            out[:, row, offset::2] = out[:, offset::2, row] = table[:, wave][:, k, column]
    if drift:
        out[:, 1, 1] = drifts[:, 0]
    return out


def _right(table: Array, drifts: Array, orders: Sequence[int], drift: bool) -> Array:
    k = np.asarray(orders, dtype=np.intp)
    first = 2 if drift else 1
    out = np.zeros((table.shape[0], first + 2 * k.size, table.shape[3] - 2))
    out[:, 0] = table[:, 0, 0, 2:]
    if drift:
        out[:, 1] = drifts[:, 1:]
    out[:, first::2] = table[:, 0, k, 2:]
    out[:, first + 1 :: 2] = table[:, 1, k, 2:]
    return out


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
        """Return what coefficients, shape (p, m), leave of the values, shape (n, m)."""
        fitted = evaluated(self.u, coefficients, self.orders, drift=self.drift)
        return np.subtract(self.y, fitted, out=fitted)

    @property
    def first(self) -> int:
        """Number of coefficients before those of the harmonics."""
        return 2 if self.drift else 1


def solved(equations: NormalEquations, orders: tuple[int, ...]) -> Array:
    """Return the coefficients, shape (p, m); `orders` are for the message."""
    # functions that are more alike than this cannot be told apart in double precision.
    worst_condition = 1e9
    gram = equations.gram.sum(axis=0)
    scale = 1.0 / np.sqrt(np.maximum(np.diag(gram), np.finfo(float).tiny))
    if np.linalg.cond(gram * np.outer(scale, scale)) > worst_condition:
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
