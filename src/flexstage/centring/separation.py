"""The errors of a scale out of what several heads on it read: what all methods share."""

import math
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from flexstage.arrays import Array, Complex
from flexstage.centring.calibration_table import CalibrationTable
from flexstage.centring.turn_spectrum import (
    TurnSpectrum,
    point_variance,
    turn_spectrum,
    whole_orders,
)
from flexstage.errors import ModelError, RecordError

#: Share of the power of an order below which what is left of it is rounding, not signal.
_BLINDNESS = 1e-9


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Combination:
    r"""A sum over the heads that gives the scale's error, :math:`G_n = \sum_j h_{jn} C_{jn}`."""

    orders: tuple[int, ...]
    """Orders that are asked for."""
    heads: Array
    """Angles of the heads [rad], shape (m,)."""
    gains: Complex
    """The factors h, shape (m, orders); zero for an order that cannot be seen."""
    seen: NDArray[np.bool_]
    """Whether each order can be seen, shape (orders,)."""
    common: Array
    """What all heads may read together, one column for each unknown, shape (m, q)."""


def head_noise(heads: ArrayLike, noise: ArrayLike | None) -> tuple[Array, Array]:
    """Return the angles of the heads [rad] and the noise of each, 1 where it is not given."""
    alpha = np.atleast_1d(np.asarray(heads, dtype=np.float64))
    if alpha.ndim != 1 or alpha.size == 0 or not np.isfinite(alpha).all():
        raise ModelError("the heads need an angle each, in radians and finite")
    given = np.asarray(1.0 if noise is None else noise, dtype=np.float64)
    if given.ndim and given.shape != alpha.shape:
        raise ModelError(
            f"the noise is one figure or one for each of {alpha.size} heads, got {given.size}"
        )
    sigma = np.broadcast_to(given, alpha.shape).copy()
    if not (np.isfinite(sigma).all() and np.all(sigma > 0.0)):
        raise ModelError("the noise of a head must be positive and finite: leave it out if unknown")
    return alpha, sigma


def common_motion(alpha: Array, *, angle: bool, axis: bool) -> Array:
    r"""Return what an error of the table adds to the readings of all heads together.

    A column for each unknown: the angle where that is not known, x and y where the axis may move.

    An angle that is not known adds 1 to each of them; a radial motion (x, y) of the axis adds
    :math:`(x \sin\alpha_j - y \cos\alpha_j) / R`.
    """
    columns = [np.ones_like(alpha)] if angle else []
    if axis:
        columns += [np.sin(alpha), np.cos(alpha)]
    return np.stack(columns, axis=1) if columns else np.zeros((alpha.size, 0))


def best_combination(
    alpha: Array, sigma: Array, orders: Iterable[int], common: Array, blindness: float
) -> Combination:
    r"""Return the combination of least noise that no common motion gets into.

    `common` is of `common_motion`, shape (m, q), `sigma` the noise of each head [rad]. An order
    counts as blind where less than the share `blindness` of its power is left beside the common
    motion.

    A head at alpha reads order n as :math:`G_n e^{i n \alpha}`, so that G follows by weighted
    least squares over the heads, with the common motion as further unknowns.
    """
    if not 0.0 < blindness < 1.0:
        raise ModelError(f"the share of blindness lies between 0 and 1, got {blindness!r}")
    if alpha.size <= common.shape[1]:
        raise ModelError(
            f"{common.shape[1]} unknown motions of the table need at least "
            f"{common.shape[1] + 1} heads, got {alpha.size}"
        )
    asked = whole_orders(orders)
    n = np.asarray(asked, dtype=np.float64)
    # columns of unit noise, so that ordinary projections are the weighted ones
    turned = np.exp(1j * np.multiply.outer(alpha, n)) / sigma[:, np.newaxis]
    basis = _common_basis(common, sigma)
    left = turned - basis @ (basis.T @ turned)
    power = np.sum(np.abs(left) ** 2, axis=0)
    seen = power > blindness * np.sum(np.abs(turned) ** 2, axis=0)
    gains = np.where(seen, np.conj(left) / np.where(seen, power, 1.0), 0.0)
    return Combination(
        orders=asked,
        heads=alpha,
        gains=np.asarray(gains / sigma[:, np.newaxis], dtype=np.complex128),
        seen=seen,
        common=common,
    )


def _common_basis(common: Array, sigma: Array) -> Array:
    """Orthonormal columns of the common motion, in units of the noise."""
    basis, values, _ = np.linalg.svd(common / sigma[:, np.newaxis], full_matrices=False)
    return basis[:, values > 1e-9 * float(values.max(initial=0.0))]


def separated_table(
    angle: ArrayLike,
    errors: ArrayLike,
    sum_of_heads: Combination,
    sigma: Array,
    *,
    noise_known: bool,
    head_uncertainty: float,
    blind_allowance: float,
    points: int,
    method: str,
) -> CalibrationTable:
    """Return the table that a combination of heads gives, with its uncertainty.

    `errors` are reading less angle of each head [rad], shape (m, k). Where the noise is not known,
    `sigma` is in proportion to it, and its size is found from what is left. `blind_allowance` is
    the standard uncertainty for all that the method cannot see [rad].
    """
    y = np.atleast_2d(np.asarray(errors, dtype=np.float64))
    if y.shape[0] != sum_of_heads.heads.size:
        raise RecordError(
            f"there are {sum_of_heads.heads.size} heads, and readings of {y.shape[0]}: give a row "
            "of readings for each head"
        )
    if not (0.0 <= head_uncertainty < math.inf and 0.0 <= blind_allowance < math.inf):
        raise ModelError("an uncertainty must be 0 or more and finite")
    highest = sum_of_heads.orders[-1]
    if points <= 2 * highest:
        raise ModelError(f"order {highest} needs more than {2 * highest} points, got {points}")
    seen = sum_of_heads.seen
    if not seen.any():
        raise RecordError(
            f"heads at these angles cannot see any of the orders by {method}: place them unevenly"
        )
    # every order, seen or not, is fitted, so that none of them passes for noise
    spectrum = turn_spectrum(angle, y, sum_of_heads.orders)
    G = np.sum(sum_of_heads.gains * spectrum.coefficients, axis=0)
    scale, freedom = 1.0, math.inf
    if not noise_known:
        scale, freedom = _noise_scale(spectrum, sum_of_heads, sigma)
    s = 2.0 * np.pi * np.arange(points) / points
    n = spectrum.orders[seen]
    rows, order_variance = point_variance(
        spectrum, sum_of_heads.gains * (scale * sigma)[:, np.newaxis], seen, s
    )
    rows = rows + _angle_variance(sum_of_heads, G, head_uncertainty, s) + blind_allowance**2
    found = G[seen]
    curve = np.zeros(points // 2 + 1, dtype=np.complex128)
    curve[n] = found * (0.5 * points)
    return CalibrationTable(
        angle=s,
        error=np.fft.irfft(curve, points),
        uncertainty=np.sqrt(rows),
        degrees_of_freedom=freedom,
        orders=tuple(int(k) for k in n),
        blind=tuple(int(k) for k in spectrum.orders[~seen]),
        cosine=found.real,
        sine=-found.imag,
        order_uncertainty=np.sqrt(order_variance),
        noise=float(scale * np.sqrt(np.mean(sigma**2))),
        method=method,
    )


def _noise_scale(
    spectrum: TurnSpectrum, combination: Combination, sigma: Array
) -> tuple[float, float]:
    """Find the noise in units of sigma, and its degrees of freedom, from what is left over.

    What the heads read together is unknown at every sample; what is left beside it belongs to the
    noise, at the orders of the fit as well as between them.
    """
    heads, samples = spectrum.residuals.shape
    n = spectrum.orders
    # least squares over the heads leaves the least, whichever combination the table is made by
    best = best_combination(
        combination.heads, sigma, combination.orders, combination.common, _BLINDNESS
    )
    G = np.sum(best.gains * spectrum.coefficients, axis=0)
    inside = spectrum.coefficients - G * np.exp(1j * np.multiply.outer(combination.heads, n))
    basis = _common_basis(combination.common, sigma)

    def left(x: NDArray) -> NDArray:
        white = x / sigma[:, np.newaxis]
        return white - basis @ (basis.T @ white)

    rest = heads - basis.shape[1]
    outside = float(np.sum(left(spectrum.residuals) ** 2))
    freedom = float(rest * (samples - 2 * n.size - 1))
    if spectrum.spread is None:
        # least squares leaves (rest - 1) complex values of each order that is seen
        outside += 0.5 * samples * float(np.sum(np.abs(left(inside[:, best.seen])) ** 2))
        freedom += 2.0 * (rest - 1) * int(best.seen.sum())
    if freedom < 1.0:
        raise RecordError(
            "there are too few samples to find the noise from: give the noise, or take fewer orders"
        )
    return math.sqrt(outside / freedom), freedom


def _angle_variance(
    combination: Combination, G: Complex, head_uncertainty: float, s: Array
) -> Array:
    """Variance at each angle s from the heads' not standing where they are said to."""
    if head_uncertainty == 0.0:
        return np.zeros(s.size)
    seen = combination.seen
    n = np.asarray(combination.orders, dtype=np.float64)[seen]
    turned = np.exp(1j * np.multiply.outer(combination.heads, n))
    waves = np.exp(1j * np.multiply.outer(s, n))
    shift = np.real(waves @ (combination.gains[:, seen] * turned * (1j * n) * G[seen]).T)
    return head_uncertainty**2 * np.sum(shift**2, axis=1)
