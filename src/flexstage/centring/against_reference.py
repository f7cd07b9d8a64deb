"""The table of a scale whose heads are compared with a reference."""

from collections.abc import Iterable

from numpy.typing import ArrayLike

from flexstage.centring.calibration_table import CalibrationTable
from flexstage.centring.separation import (
    best_combination,
    common_motion,
    head_noise,
    separated_table,
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
    >>> import numpy as np
    >>> t = 2.0 * np.pi * np.arange(120) / 120
    >>> heads = np.array([0.0, 1.3])
    >>> read = 5e-6 * np.cos(4.0 * (t + heads[:, np.newaxis]) - 0.4)
    >>> table = against_reference(t, read, heads=heads, orders=range(1, 9), noise=2e-7)
    >>> print(f"{table.harmonic(4)[0] * 1e6:.3f} urad, u = {table.uncertainty[0] * 1e9:.1f} nrad")
    4.605 urad, u = 51.6 nrad
    """
    alpha, sigma = head_noise(heads, noise)
    common = common_motion(alpha, angle=False, axis=axis_motion)
    combination = best_combination(alpha, sigma, orders, common, 0.01)
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
