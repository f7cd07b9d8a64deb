"""Poles of frequency responses by least squares on a matrix fraction, for many orders at once."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from flexstage.arrays import Array, Complex
from flexstage.errors import ModelError

# share of the unit circle that the band covers: its ends stay apart, so that what lies beyond one
# end does not look as if it came after the other
_SHARE = 0.9


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class WeightedLines:
    """Responses at some frequencies, and how much each counts."""

    frequency_hz: Array
    """Frequencies [Hz], shape (k,)."""
    response: Complex
    """The responses, shape (k, outputs, inputs)."""
    weight: Array
    """What the square of the error of each output counts, shape (k, outputs)."""


def poles_by_order(
    parts: Sequence[WeightedLines],
    orders: Sequence[int],
    band: tuple[float, float],
    coefficients: Literal["complex", "real"] = "complex",
) -> tuple[Complex, ...]:
    """Return the poles that polynomials of rising order find.

    Each row of the response matrix is modelled as H_o(z) = B_o(z) A(z)^-1 with a denominator A of
    all outputs; sum |B_o - H_o A|^2 is made least with the coefficient of the highest power of A
    equal to the unit matrix (Guillaume, Verboven, Vanlanduit, Van der Auweraer and Peeters, 2003, A
    poly-reference implementation of the least-squares complex frequency-domain estimator, IMAC
    XXI). With one input it is the common-denominator estimator. z = exp(-i omega T), in which that
    choice makes poles of the noise unstable (Cauberghe, Guillaume, Verboven, Vanlanduit and Parloo,
    2005, Mechanical Systems and Signal Processing 19). The poles are in rad/s. Complex coefficients
    see the band [Hz] alone, laid round the unit circle; real ones see all frequencies from 0 to its
    end, laid along half of it with the negative ones beside them, and their poles are those above
    the frequency 0.
    """
    inputs = parts[0].response.shape[2]
    top = int(orders[-1])
    lines = sum(p.frequency_hz.size * p.response.shape[1] for p in parts)
    real = coefficients == "real"
    if min(p.frequency_hz.size for p in parts) * (2 if real else 1) <= top + 1 or lines <= 2 * top:
        raise ModelError(
            f"order {top} needs more than {top + 1} lines in the band, got "
            f"{min(p.frequency_hz.size for p in parts)}: lower the order, or widen the band"
        )
    origin = 0.0 if real else band[0]
    step = 1.0 / (2.0 * band[1]) if real else _SHARE / (band[1] - band[0])
    total = np.zeros((top + 1, inputs, top + 1, inputs))
    rows = []
    for part in parts:
        square, cross = _moments(part, origin, step, top, real)
        total = total + square
        rows.append(cross)
    projected = np.concatenate(rows)
    base = total
    found = []
    reached = -1
    for order in orders:
        for k in range(reached + 1, order + 1):
            row = projected[:, k].reshape(projected.shape[0], -1)
            base = base - (row.conj().T @ row).reshape(base.shape)
        reached = order
        roots = _roots(base[: order + 1, :, : order + 1, :], order, inputs)
        roots = roots[np.abs(roots) > 0.0]
        poles: Complex = np.asarray(-np.log(roots) / step, dtype=np.complex128)
        poles = poles[poles.imag > 0.0] if real else _unwrapped(poles, step)
        found.append(np.sort_complex(poles + 2j * math.pi * origin))
    return tuple(found)


def _moments(
    part: WeightedLines, origin: float, step: float, top: int, real: bool
) -> tuple[Any, Any]:
    """Return sum Y^H W Y over outputs, and L^-1 X^H W Y of each, where L L^H = X^H W X.

    With negative frequencies beside the positive ones, all sums are real.

    As row k of the second depends on powers up to k only, its first rows are those of lower orders:
    one set of equations gives all of them.
    """
    from scipy.linalg import solve_triangular, toeplitz

    outputs, inputs = part.response.shape[1:]
    z = np.exp(-2j * math.pi * (part.frequency_hz - origin) * step)
    powers = z[:, None] ** np.arange(-top, top + 1)
    # sums over the lines of w z^(b - a), at all differences of the powers
    plain = part.weight.T @ powers
    first = (part.weight[:, :, None] * part.response).reshape(z.size, -1).T @ powers
    second = np.einsum(
        "koi,koj->kij", part.response.conj() * part.weight[:, :, None], part.response
    )
    both = second.reshape(z.size, -1).T @ powers
    if real:
        plain, first, both = plain.real, first.real, both.real
    difference = np.arange(top + 1)[None, :] - np.arange(top + 1)[:, None] + top
    square = both.reshape(inputs, inputs, -1)[:, :, difference].transpose(2, 0, 3, 1)
    first = first.reshape(outputs, inputs, -1)
    cross = np.empty((outputs, top + 1, top + 1, inputs), dtype=first.dtype)
    for o in range(outputs):
        r = toeplitz(plain[o, top::-1], plain[o, top:])
        # what rounding leaves of a matrix that should be positive definite
        r[np.diag_indices(top + 1)] *= 1.0 + 1e-13
        try:
            lower = np.linalg.cholesky(r)
        except np.linalg.LinAlgError:
            raise ModelError(
                f"the lines of the band, as they are weighted, do not tell powers of order {top} "
                "apart: lower the order, or widen the band"
            ) from None
        s = first[o][:, difference].transpose(1, 2, 0).reshape(top + 1, -1)
        cross[o] = solve_triangular(lower, s, lower=True).reshape(top + 1, top + 1, inputs)
    return square, cross


def _roots(normal: Any, order: int, inputs: int) -> Complex:
    size = order * inputs
    matrix = normal.reshape(size + inputs, size + inputs)
    try:
        rest = np.linalg.solve(matrix[:size, :size], -matrix[:size, size:])
    except np.linalg.LinAlgError:
        rest = np.linalg.lstsq(matrix[:size, :size], -matrix[:size, size:])[0]
    companion = np.zeros((size, size), dtype=matrix.dtype)
    companion[: size - inputs, inputs:] = np.eye(size - inputs)
    # the last block row: z^n = -(A_0 + A_1 z + ...)
    blocks = rest.reshape(order, inputs, inputs).transpose(1, 0, 2)
    companion[size - inputs :, :] = -blocks.reshape(inputs, size)
    return np.linalg.eigvals(companion).astype(np.complex128)


def _unwrapped(poles: Complex, step: float) -> Complex:
    """Lay the angle of poles from just below the band to just above it."""
    turn = 2.0 * math.pi / step
    below = 0.5 * (1.0 - _SHARE) * turn
    return poles.real + 1j * (np.mod(poles.imag + below, turn) - below)
