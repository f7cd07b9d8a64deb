"""The errors of a scale by equal-division averaging: one head against the mean of even ones."""

from collections.abc import Iterable

import numpy as np
from numpy.typing import ArrayLike

from flexstage.centring.calibration_table import CalibrationTable
from flexstage.centring.separation import Combination, common_motion, head_noise, separated_table
from flexstage.centring.turn_spectrum import whole_orders
from flexstage.errors import ModelError

#: By how much the heads may stand off an even division [rad], as a share of their distance.
_UNEVEN = 1e-3


def equal_division(
    angle: ArrayLike,
    errors: ArrayLike,
    *,
    heads: ArrayLike,
    orders: Iterable[int],
    reference: int = 0,
    noise: float | None = None,
    head_uncertainty: float = 0.0,
    blind_allowance: float = 0.0,
    points: int = 360,
) -> CalibrationTable:
    r"""Return the table of a scale by equal-division averaging.

    With N heads evenly spaced, the mean of the differences of a reference head from each of them
    is the error of the scale itself, less its orders that are multiples of N (Masuda and Kajitani
    1993, Precision Engineering 15),

    .. math:: \frac1N \sum_j (r_0 - r_j) = g(s) - \frac1N \sum_j g(s + 2 \pi j / N).

    The angle of the table drops out, and no equation is solved.

    Parameters
    ----------
    angle : array_like
        Nominal angle of the table at each sample [rad], shape (k,), the same for all heads.
    errors : array_like
        Reading less nominal angle of each head [rad], shape (m, k).
    heads : array_like
        Angles of the heads [rad], shape (m,): N evenly spaced ones, of which the reference head may
        be one, or stand beside them.
    orders : iterable of int
        Orders that the table shall hold.
    reference : int
        Which of the heads is the reference head, from 0.
    noise : float, optional
        Standard deviation of a reading [rad]; found from what is left over where not given.
    head_uncertainty : float
        Standard uncertainty of the angle of each head [rad].
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
    As of `flexstage.centring.self_calibration.self_calibration`, whose least squares use the same
    readings with less noise. A radial motion of the axis drops out of the mean of the heads, but
    not out of the reference head: it is in the table.

    Raises
    ------
    RecordError
        The readings do not belong together, do not cover the turn, or show none of the orders.
    ModelError
        The heads are not evenly spaced, or a figure is impossible.

    Examples
    --------
    >>> t = 2.0 * np.pi * np.arange(240) / 240
    >>> heads = 2.0 * np.pi * np.arange(5) / 5 + 0.3
    >>> read = 5e-6 * np.cos(7.0 * (t + heads[:, np.newaxis]))
    >>> table = equal_division(t, read, heads=heads, orders=range(1, 12), noise=1e-7)
    >>> print(f"{table.harmonic(7)[0] * 1e6:.4f} urad, blind: {table.blind}")
    5.0000 urad, blind: (5, 10)
    """
    alpha, sigma = head_noise(heads, None if noise is None else float(noise))
    if not 0 <= reference < alpha.size:
        raise ModelError(
            f"the reference head is one of {alpha.size} heads, from 0, got {reference}"
        )
    even = _even_heads(alpha, reference)
    asked = whole_orders(orders)
    n = np.asarray(asked, dtype=np.float64)
    factor = np.zeros(alpha.size)
    factor[reference] = 1.0
    factor[even] -= 1.0 / even.size
    # what the combination makes of each order is undone: it is 1 but for the heads' small errors
    transfer = factor @ np.exp(1j * np.multiply.outer(alpha, n))
    seen = np.array([k % even.size != 0 for k in asked])
    gains = np.where(seen, np.multiply.outer(factor, 1.0 / np.where(seen, transfer, 1.0)), 0.0)
    combination = Combination(
        orders=asked,
        heads=alpha,
        gains=gains,
        seen=seen,
        common=common_motion(alpha, angle=True, axis=False),
    )
    return separated_table(
        angle,
        errors,
        combination,
        sigma,
        noise_known=noise is not None,
        head_uncertainty=head_uncertainty,
        blind_allowance=blind_allowance,
        points=points,
        method=f"equal-division averaging over {even.size} heads",
    )


def _even_heads(alpha: np.ndarray, reference: int) -> np.ndarray:
    """Return which heads divide the turn evenly: all of them, or all but the reference head."""
    everyone = np.arange(alpha.size)
    for chosen in (everyone, np.delete(everyone, reference)):
        if chosen.size < 2:
            continue
        at = np.sort(np.mod(alpha[chosen], 2.0 * np.pi))
        steps = np.diff(np.append(at, at[0] + 2.0 * np.pi))
        even = 2.0 * np.pi / chosen.size
        if np.max(np.abs(steps - even)) < _UNEVEN * even:
            return chosen
    raise ModelError(
        "equal-division averaging needs heads that divide the turn evenly, with or without the "
        f"reference head, got {', '.join(f'{a:.5g}' for a in np.degrees(alpha))} degrees: use "
        "self-calibration"
    )
