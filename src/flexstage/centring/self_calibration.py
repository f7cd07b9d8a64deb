"""The errors of a scale from several heads on it, without any other standard."""

from collections.abc import Iterable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from flexstage.centring.calibration_table import CalibrationTable
from flexstage.centring.separation import (
    best_combination,
    common_motion,
    head_noise,
    separated_table,
)
from flexstage.centring.turn_spectrum import whole_orders


def self_calibration(
    angle: ArrayLike,
    errors: ArrayLike,
    *,
    heads: ArrayLike,
    orders: Iterable[int],
    noise: ArrayLike | None = None,
    axis_motion: bool = False,
    head_uncertainty: float = 0.0,
    blindness: float = 0.01,
    blind_allowance: float = 0.0,
    points: int = 360,
) -> CalibrationTable:
    r"""Return the table of a scale from two or more heads that read it at the same time.

    All heads share the angle of the table, which need not be known: in their differences it drops
    out. The difference of two of them is the error of the scale less itself, shifted, which in the
    Fourier domain is a factor (Probst 2008, Measurement Science and Technology 19; Geckeler, Link,
    Krause and Elster 2014, the same 25),

    .. math:: C_{jn} - C_{1n} = \left(e^{i n \alpha_j} - e^{i n \alpha_1}\right) G_n.

    All differences are used at once, as least squares over the heads with an unknown that they have
    in common. Where the factors of all pairs vanish the heads are blind; such orders are named.

    Parameters
    ----------
    angle : array_like
        Nominal angle of the table at each sample [rad], shape (k,), the same for all heads.
    errors : array_like
        Reading less nominal angle of each head [rad], shape (m, k).
    heads : array_like
        Angles of the heads [rad], shape (m,), at best unevenly spaced.
    orders : iterable of int
        Orders that the table shall hold.
    noise : array_like, optional
        Standard deviation of a reading [rad], one for all or shape (m,); found from what is left
        over, and taken as equal, where not given.
    axis_motion : bool
        Whether the table's axis may move, which is then solved for at every sample: it takes four
        heads or more. Order 1 is then blind, as an eccentric scale and an axis that runs out once
        in a turn read the same.
    head_uncertainty : float
        Standard uncertainty of the angle of each head [rad].
    blindness : float
        An order counts as blind where less than this share of its power is left in the differences
        [1]: at 0.01 the noise is at most ten times that of a comparison with a perfect reference.
    blind_allowance : float
        Standard uncertainty for the orders that are not seen [rad].
    points : int
        Number of points of the table.

    Returns
    -------
    CalibrationTable
        The table, order 1 of which holds the eccentricity as well.

    Validity
    --------
    White noise, and errors of the scale that are periodic in a turn and small: the table must not
    be further from its nominal angle than the errors take to change. Orders that are present but
    not asked for count as noise.

    Raises
    ------
    RecordError
        The readings do not belong together, do not cover the turn, or show none of the orders.
    ModelError
        There are too few heads, or a figure is impossible.

    Examples
    --------
    >>> t = 2.0 * np.pi * np.arange(240) / 240
    >>> heads = np.radians([0.0, 53.0, 171.0])
    >>> table_error = 3e-5 * np.sin(2.0 * t)
    >>> read = table_error + 5e-6 * np.cos(7.0 * (t + heads[:, np.newaxis]))
    >>> table = self_calibration(t, read, heads=heads, orders=range(1, 12), noise=1e-7)
    >>> print(f"{table.harmonic(7)[0] * 1e6:.4f} urad, blind: {table.blind}")
    5.0000 urad, blind: ()
    """
    alpha, sigma = head_noise(heads, noise)
    common = common_motion(alpha, angle=True, axis=axis_motion)
    combination = best_combination(alpha, sigma, orders, common, blindness)
    return separated_table(
        angle,
        errors,
        combination,
        sigma,
        noise_known=noise is not None,
        head_uncertainty=head_uncertainty,
        blind_allowance=blind_allowance,
        points=points,
        method="self-calibration",
    )


def order_visibility(
    heads: ArrayLike, orders: Iterable[int], *, axis_motion: bool = False
) -> NDArray[np.float64]:
    r"""Return how well heads at given angles see each order of a scale's error by themselves.

    .. math:: v_n = \frac1m \sum_j \left|e^{i n \alpha_j} - \overline{e^{i n \alpha}}\right|^2

    The variance of the order is that of a comparison with a perfect reference over v.

    Parameters
    ----------
    heads : array_like
        Angles of the heads [rad], shape (m,).
    orders : iterable of int
        The orders.
    axis_motion : bool
        Whether the table's axis may move.

    Returns
    -------
    numpy.ndarray
        Visibility from 0, blind, to 1 [1], shape (orders,).

    Raises
    ------
    ModelError
        The heads have no finite angles.

    Examples
    --------
    >>> print(np.round(order_visibility(np.radians([0.0, 90.0, 210.0]), range(1, 5)), 3))
    [0.97  0.889 0.444 0.667]
    """
    alpha, _ = head_noise(heads, None)
    n = np.asarray(whole_orders(orders), dtype=np.float64)
    turned = np.exp(1j * np.multiply.outer(alpha, n))
    common = common_motion(alpha, angle=True, axis=axis_motion)
    left = turned - common @ (np.linalg.pinv(common) @ turned)
    return np.asarray(np.sum(np.abs(left) ** 2, axis=0) / alpha.size, dtype=np.float64)
