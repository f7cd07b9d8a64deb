"""The mean of several heads: which errors of the scale are left in it, and the table it gives."""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from flexstage.centring.calibration_table import CalibrationTable
from flexstage.centring.separation import (
    Combination,
    best_combination,
    common_motion,
    head_noise,
    separated_table,
)
from flexstage.centring.turn_spectrum import whole_orders
from flexstage.errors import ModelError


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class HeadAveraging:
    """What the mean of several heads leaves of the errors of scale and axis."""

    heads: NDArray[np.float64]
    """Angles of the heads [rad], shape (m,)."""
    weights: NDArray[np.float64]
    """Their weights, of sum 1, shape (m,)."""
    orders: tuple[int, ...]
    """Orders of the errors of the scale."""
    transfer: NDArray[np.complex128]
    """Complex share of each order that is left [1], shape (orders,)."""
    axis_motion: NDArray[np.float64]
    """What is left of a radial motion of the axis in x and in y, times the radius [1], shape (2,).
    """
    noise: float
    """Noise of the mean over that of one head [1]."""

    def remaining(self, share: float = 1e-9) -> tuple[int, ...]:
        """Return the orders of which more than this share is left."""
        return tuple(n for n, h in zip(self.orders, self.transfer, strict=True) if abs(h) > share)


def head_averaging(
    heads: ArrayLike, orders: Iterable[int], *, weights: ArrayLike | None = None
) -> HeadAveraging:
    r"""Return what the weighted mean of several heads leaves of each order of the scale's error.

    .. math:: H_n = \sum_j w_j e^{i n \alpha_j}

    of which m evenly spaced heads of equal weight leave the multiples of m alone.

    Parameters
    ----------
    heads : array_like
        Angles of the heads [rad], shape (m,).
    orders : iterable of int
        The orders.
    weights : array_like, optional
        Weights of the heads, of any sum but 0, shape (m,); equal where not given.

    Returns
    -------
    HeadAveraging
        Shares that are left, by order.

    Validity
    --------
    To first order in the errors. The eccentricity of the scale is of order 1.

    Raises
    ------
    ModelError
        The weights do not belong to the heads, or their sum is 0.

    Examples
    --------
    >>> four = head_averaging(np.radians([0.0, 90.0, 180.0, 270.0]), range(1, 10))
    >>> four.remaining()
    (4, 8)
    >>> shifted = head_averaging(np.radians([0.0, 91.0, 180.0, 271.0]), range(1, 10))
    >>> print(f"{abs(shifted.transfer[1]):.4f}")
    0.0175
    """
    alpha, _ = head_noise(heads, None)
    w = np.ones_like(alpha) if weights is None else np.asarray(weights, dtype=np.float64)
    if w.shape != alpha.shape or not np.isfinite(w).all():
        raise ModelError(f"the mean of {alpha.size} heads needs as many finite weights")
    total = float(w.sum())
    if abs(total) <= 1e-12 * float(np.abs(w).sum()):
        raise ModelError("the sum of the weights must not be 0")
    w = w / total
    asked = whole_orders(orders)
    n = np.asarray(asked, dtype=np.float64)
    return HeadAveraging(
        heads=alpha,
        weights=w,
        orders=asked,
        transfer=np.asarray(w @ np.exp(1j * np.multiply.outer(alpha, n)), dtype=np.complex128),
        axis_motion=np.array([w @ np.sin(alpha), -(w @ np.cos(alpha))]),
        noise=float(np.sqrt(np.sum(w**2))),
    )


def against_reference(
    angle: ArrayLike,
    errors: ArrayLike,
    *,
    heads: ArrayLike,
    orders: Iterable[int],
    noise: ArrayLike | None = None,
    axis_motion: bool = False,
    head_uncertainty: float = 0.0,
    points: int = 360,
) -> CalibrationTable:
    r"""Return the table of a scale from heads that are compared with a reference of angle.

    Each head gives the table by itself; they are averaged over the scale, each turned back by its
    angle, :math:`G_n = \sum_j w_j e^{-i n \alpha_j} C_{jn}`, with weights by their noise.

    Parameters
    ----------
    angle : array_like
        Angle of the reference at each sample [rad], shape (k,).
    errors : array_like
        Reading less angle of each head [rad], shape (m, k), or (k,) for one head.
    heads : array_like
        Angles of the heads [rad], shape (m,).
    orders : iterable of int
        Orders that the table shall hold.
    noise : array_like, optional
        Standard deviation of a reading [rad], one for all or shape (m,); found from what is left
        over, and taken as equal, where not given.
    axis_motion : bool
        Whether the table's axis may move, which is then solved for at every sample: it takes three
        heads or more, and makes them blind to orders that they read like a motion.
    head_uncertainty : float
        Standard uncertainty of the angle of each head [rad].
    points : int
        Number of points of the table.

    Returns
    -------
    CalibrationTable
        The table, order 1 of which holds the eccentricity as well.

    Validity
    --------
    White noise, errors of the scale that are periodic in a turn, and a reference without error: the
    reference's own error is in the table. To first order, a radial motion of the axis that is not
    solved for is in the table as well.

    Raises
    ------
    RecordError
        The readings do not belong together, or do not cover the turn.
    ModelError
        The heads, their noise or the number of points are impossible.

    Examples
    --------
    >>> t = 2.0 * np.pi * np.arange(120) / 120
    >>> heads = np.array([0.0, 1.3])
    >>> read = 5e-6 * np.cos(4.0 * (t + heads[:, np.newaxis]) - 0.4)
    >>> table = against_reference(t, read, heads=heads, orders=range(1, 9), noise=2e-7)
    >>> print(f"{table.harmonic(4)[0] * 1e6:.3f} urad, u = {table.uncertainty[0] * 1e9:.1f} nrad")
    4.605 urad, u = 51.6 nrad
    """
    alpha, sigma = head_noise(heads, noise)
    common = common_motion(alpha, angle=False, axis=axis_motion)
    combination: Combination = best_combination(alpha, sigma, orders, common, 0.01)
    return separated_table(
        angle,
        errors,
        combination,
        sigma,
        noise_known=noise is not None,
        head_uncertainty=head_uncertainty,
        blind_allowance=0.0,
        points=points,
        method="comparison with a reference",
    )
