r"""Numbers with their derivatives, so that one formula serves for both.

A `Dual` is a value and its derivative in several directions, :math:`x + \epsilon\,\dot x`; sums,
products and quotients follow the rules of calculus (R. E. Wengert, Comm. ACM 7 (1964) 463), exact
to rounding. Functions here take plain arrays as well, and give plain arrays then.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np

from flexstage.base.arrays import Array
from flexstage.base.errors import ModelError
from flexstage.base.lazy import require_extra

# values that differ by less than this of them are one, but for rounding
_EQUAL = 1e-9


def array_namespace(*arrays: Array) -> Any:
    """Return the array namespace of some arrays of one library, by the Python array API standard.

    Raises
    ------
    ModelError
        The library has none of its own (CuPy, PyTorch), and array-api-compat is not installed.
    """
    first = next((a for a in arrays if not isinstance(a, np.generic | float)), None)
    if first is None or isinstance(first, np.ndarray):
        return np
    if hasattr(first, "__array_namespace__"):
        return first.__array_namespace__()
    require_extra("gpu", "array_api_compat", "stages in arrays of this library", ModelError)
    from array_api_compat import array_namespace as compatible

    return compatible(*arrays)


class Dual:
    """A value, shape (..., 1), and its derivative in P directions, shape (..., P)."""

    __slots__ = ("tangent", "value")

    # NumPy then leaves arithmetic with arrays to this class
    __array_ufunc__ = None

    def __init__(self, value: Array, tangent: Array) -> None:
        self.value, self.tangent = value, tangent

    def __getitem__(self, which: Any) -> "Dual":
        return Dual(self.value[which], self.tangent[which])

    def __neg__(self) -> "Dual":
        return Dual(-self.value, -self.tangent)

    def __add__(self, other: Any) -> "Dual":
        x = _dual(other)
        return Dual(self.value + x.value, self.tangent + x.tangent)

    __radd__ = __add__

    def __sub__(self, other: Any) -> "Dual":
        return self + -_dual(other)

    def __rsub__(self, other: Any) -> "Dual":
        return -self + other

    def __mul__(self, other: Any) -> "Dual":
        x = _dual(other)
        return Dual(self.value * x.value, self.tangent * x.value + self.value * x.tangent)

    __rmul__ = __mul__

    def __truediv__(self, other: Any) -> "Dual":
        x = _dual(other)
        value = self.value / x.value
        return Dual(value, (self.tangent - value * x.tangent) / x.value)

    def __rtruediv__(self, other: Any) -> "Dual":
        return _dual(other) / self


def _dual(x: Any) -> Dual:
    if isinstance(x, Dual):
        return x
    value = np.asarray(x, dtype=np.float64)
    return Dual(value, np.zeros(()))


def root(x: Any) -> Any:
    """Return the square root; of what is not positive, nothing (not a number)."""
    if isinstance(x, Dual):
        value = root(x.value)
        return Dual(value, 0.5 * x.tangent / value)
    xp = array_namespace(x)
    return xp.sqrt(xp.where(x > 0.0, x, xp.nan * xp.ones_like(x)))


def magnitude(x: Any) -> Any:
    """Return the absolute value."""
    if isinstance(x, Dual):
        return Dual(np.abs(x.value), np.sign(x.value) * x.tangent)
    return array_namespace(x).abs(x)


def largest_row(x: Any) -> Any:
    """Return the largest value along the first axis; its derivative is that of the active row.

    Of rows equal to rounding it is the mean of the derivatives to either side, as by central
    differences.
    """
    if not isinstance(x, Dual):
        return array_namespace(x).max(x, axis=0)
    value = np.max(x.value, axis=0)
    active = x.value >= value - _EQUAL * np.abs(value)
    least = np.min(np.where(active, x.tangent, np.inf), axis=0)
    most = np.max(np.where(active, x.tangent, -np.inf), axis=0)
    return Dual(value, 0.5 * (least + most))


def largest(values: Sequence[Any], *, by_magnitude: bool = False) -> Any:
    """Return the largest of some values, or that of the largest magnitude with its sign.

    Of equal ones the first; the derivative is that of the active one.
    """
    best = values[0]
    for other in values[1:]:
        a, b = (magnitude(other), magnitude(best)) if by_magnitude else (other, best)
        best = _where(_value(a) > _value(b), other, best)
    return best


def _where(condition: Any, a: Any, b: Any) -> Any:
    if isinstance(a, Dual) or isinstance(b, Dual):
        x, y = _dual(a), _dual(b)
        return Dual(
            np.where(condition, x.value, y.value), np.where(condition, x.tangent, y.tangent)
        )
    return array_namespace(a, b).where(condition, a, b)


def _value(x: Any) -> Array:
    return x.value if isinstance(x, Dual) else x


def singular_values(rows: Sequence[Sequence[Any]], fine: Any = None) -> list[Any]:
    r"""Return the singular values of a matrix given by its entries, falling.

    Their derivative is :math:`\dot\sigma_i = u_i^T \dot A v_i`. Where `fine` is false, the identity
    replaces the matrix, and its values have no meaning.
    """
    flat = [entry for row in rows for entry in row]
    shape = len(rows), len(rows[0])
    if any(isinstance(entry, Dual) for entry in flat):
        duals = [_dual(entry) for entry in flat]
        value = np.stack([d.value[..., 0] for d in duals], axis=-1).reshape(-1, *shape)[0]
        u, sigma, vt = np.linalg.svd(value, full_matrices=False)
        tangent = np.stack(np.broadcast_arrays(*(d.tangent for d in duals))).reshape(*shape, -1)
        slope = np.einsum("ri,rcp,ic->ip", u, tangent, vt)
        return [Dual(sigma[i : i + 1], slope[i]) for i in range(sigma.size)]
    xp = array_namespace(*flat)
    matrix = xp.stack(xp.broadcast_arrays(*flat), axis=-1)
    matrix = xp.reshape(matrix, (-1, *shape))
    if fine is not None:
        usual = xp.eye(*shape, dtype=matrix.dtype)
        matrix = xp.where(fine[:, None, None], matrix, usual)
    values = xp.linalg.svdvals(matrix)
    return [values[:, i] for i in range(min(shape))]


def solved(matrix: Sequence[Sequence[Any]], right: Sequence[Any]) -> list[Any]:
    """Solve a small system whose pivots, in the given order, are not zero.

    Entries and right side are values over the samples; elimination is that of C. F. Gauss.
    """
    a = [[*row, r] for row, r in zip(matrix, right, strict=True)]
    n = len(a)
    for i in range(n):
        for j in range(i + 1, n):
            factor = a[j][i] / a[i][i]
            a[j] = [x - factor * y for x, y in zip(a[j], a[i], strict=True)]
    x: list[Any] = [None] * n
    for i in reversed(range(n)):
        left = a[i][n]
        for j in range(i + 1, n):
            left = left - a[i][j] * x[j]
        x[i] = left / a[i][i]
    return x


def power(x: Any, exponent: float) -> Any:
    """Return a positive value to a power."""
    if isinstance(x, Dual):
        value = x.value**exponent
        return Dual(value, exponent * value / x.value * x.tangent)
    return x**exponent


def where_larger(a: Any, b: Any, then: Any, other: Any) -> Any:
    """Return one value where a is not less than b, another one elsewhere."""
    return _where(_value(a) >= _value(b), then, other)
