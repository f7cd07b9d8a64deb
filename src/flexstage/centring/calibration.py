"""Tables of a scale's errors, from several heads on it or from two scales against one another."""

import math
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from flexstage.base.arrays import Array, Complex
from flexstage.base.errors import ModelError, RecordError
from flexstage.centring.calibration_table import CalibrationTable
from flexstage.centring.turns import (
    TurnSpectrum,
    point_variance,
    turn_spectrum,
    whole_orders,
)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ScaleReadings:
    """What one head or several read of a scale at the same time, over a turn or several."""

    angle: Array
    """Angle of the table at each sample [rad], shape (k,): that of a reference where the heads are
    compared with one, else a nominal one.
    """
    errors: Array
    """Reading less angle of each head [rad], shape (m, k)."""
    heads: Array
    """Where the heads stand [rad], shape (m,)."""
    noise: ArrayLike | None = None
    """Standard deviation of a reading [rad], one for all or shape (m,); found from what is left
    over, and taken as equal, where not given.
    """
    head_uncertainty: float = 0.0
    """Standard uncertainty of the angle of each head [rad]."""

    def __post_init__(self) -> None:
        alpha = _head_angles(self.heads)
        y = np.atleast_2d(np.asarray(self.errors, dtype=np.float64))
        if y.shape[0] != alpha.size:
            raise RecordError(
                f"there are {alpha.size} heads, and readings of {y.shape[0]}: give a row of "
                "readings for each head"
            )
        noise = _checked_noise(self.noise)
        if noise.ndim and noise.shape != alpha.shape:
            raise ModelError(
                f"the noise is one figure or one for each of {alpha.size} heads, got {noise.size}"
            )
        _require_uncertainty(self.head_uncertainty)
        object.__setattr__(self, "angle", np.asarray(self.angle, dtype=np.float64))
        object.__setattr__(self, "errors", y)
        object.__setattr__(self, "heads", alpha)

    @property
    def relative_noise(self) -> Array:
        """Noise of each head [rad]; 1 where it is not known, shape (m,)."""
        return np.broadcast_to(_checked_noise(self.noise), self.heads.shape)


def self_calibration(
    readings: ScaleReadings,
    orders: Iterable[int],
    *,
    axis_motion: bool = False,
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
    readings : ScaleReadings
        Readings of the heads, which are at best unevenly spaced.
    orders : iterable of int
        Orders that the table shall hold.
    axis_motion : bool
        Whether the table's axis may move, which is then solved for at every sample: it takes four
        heads or more. Order 1 is then blind, as an eccentric scale and an axis that runs out once
        in a turn read the same.
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
    >>> readings = ScaleReadings(angle=t, errors=read, heads=heads, noise=1e-7)
    >>> table = self_calibration(readings, range(1, 12))
    >>> print(f"{table.harmonic(7)[0] * 1e6:.4f} urad, blind: {table.blind}")
    5.0000 urad, blind: ()
    """
    common = _common_motion(readings.heads, angle=True, axis=axis_motion)
    combination = _best_combination(readings, orders, common, blindness)
    return _separated_table(readings, combination, blind_allowance, points, "self-calibration")


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
    alpha = _head_angles(heads)
    n = np.asarray(whole_orders(orders), dtype=np.float64)
    turned = np.exp(1j * np.multiply.outer(alpha, n))
    common = _common_motion(alpha, angle=True, axis=axis_motion)
    left = turned - common @ (np.linalg.pinv(common) @ turned)
    return np.asarray(np.sum(np.abs(left) ** 2, axis=0) / alpha.size, dtype=np.float64)


def against_reference(
    readings: ScaleReadings,
    orders: Iterable[int],
    *,
    axis_motion: bool = False,
    points: int = 360,
) -> CalibrationTable:
    r"""Return the table of a scale from heads that are compared with a reference of angle.

    Each head gives the table by itself; they are averaged over the scale, each turned back by its
    angle, :math:`G_n = \sum_j w_j e^{-i n \alpha_j} C_{jn}`, with weights by their noise.

    Parameters that are not described here are those of `self_calibration`.

    Parameters
    ----------
    readings : ScaleReadings
        Readings of the heads, over the angle of the reference.
    axis_motion : bool
        Whether the table's axis may move, which is then solved for at every sample: it takes three
        heads or more, and makes them blind to orders that they read like a motion.

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
    >>> readings = ScaleReadings(angle=t, errors=read, heads=heads, noise=2e-7)
    >>> table = against_reference(readings, range(1, 9))
    >>> print(f"{table.harmonic(4)[0] * 1e6:.3f} urad, u = {table.uncertainty[0] * 1e9:.1f} nrad")
    4.605 urad, u = 51.6 nrad
    """
    common = _common_motion(readings.heads, angle=False, axis=axis_motion)
    combination = _best_combination(readings, orders, common, 0.01)
    return _separated_table(readings, combination, 0.0, points, "comparison with a reference")


def equal_division(
    readings: ScaleReadings,
    orders: Iterable[int],
    *,
    reference: int = 0,
    blind_allowance: float = 0.0,
    points: int = 360,
) -> CalibrationTable:
    r"""Return the table of a scale by equal-division averaging.

    With N heads evenly spaced, the mean of the differences of a reference head from each of them
    is the error of the scale itself, less its orders that are multiples of N (Masuda and Kajitani
    1993, Precision Engineering 15),

    .. math:: \frac1N \sum_j (r_0 - r_j) = g(s) - \frac1N \sum_j g(s + 2 \pi j / N).

    The angle of the table drops out, and no equation is solved.

    Parameters that are not described here are those of `self_calibration`.

    Parameters
    ----------
    readings : ScaleReadings
        Readings of N evenly spaced heads, of which the reference head may be one, or stand beside
        them.
    reference : int
        Which of the heads is the reference head, from 0.

    Returns
    -------
    CalibrationTable
        The table, order 1 of which holds the eccentricity as well.

    Validity
    --------
    As of `flexstage.centring.calibration.self_calibration`, whose least squares use the same
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
    >>> readings = ScaleReadings(angle=t, errors=read, heads=heads, noise=1e-7)
    >>> table = equal_division(readings, range(1, 12))
    >>> print(f"{table.harmonic(7)[0] * 1e6:.4f} urad, blind: {table.blind}")
    5.0000 urad, blind: (5, 10)
    """
    alpha = readings.heads
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
    common = _common_motion(alpha, angle=True, axis=False)
    combination = _Combination(orders=asked, gains=gains, seen=seen, common=common)
    method = f"equal-division averaging over {even.size} heads"
    return _separated_table(readings, combination, blind_allowance, points, method)


def _even_heads(alpha: np.ndarray, reference: int) -> np.ndarray:
    """Return which heads divide the turn evenly: all of them, or all but the reference head."""
    # by how much they may stand off an even division, as a share of their distance
    uneven = 1e-3
    everyone = np.arange(alpha.size)
    for chosen in (everyone, np.delete(everyone, reference)):
        if chosen.size < 2:
            continue
        at = np.sort(np.mod(alpha[chosen], 2.0 * np.pi))
        steps = np.diff(np.append(at, at[0] + 2.0 * np.pi))
        even = 2.0 * np.pi / chosen.size
        if np.max(np.abs(steps - even)) < uneven * even:
            return chosen
    raise ModelError(
        "equal-division averaging needs heads that divide the turn evenly, with or without the "
        f"reference head, got {', '.join(f'{a:.5g}' for a in np.degrees(alpha))} degrees: use "
        "self-calibration"
    )


def cross_calibration(
    angle: ArrayLike,
    differences: ArrayLike,
    *,
    positions: ArrayLike,
    orders: Iterable[int],
    noise: float | None = None,
    blindness: float = 0.01,
    blind_allowance: float = 0.0,
    points: int = 360,
) -> tuple[CalibrationTable, CalibrationTable]:
    r"""Return the tables of two scales that were compared in several relative positions.

    Over a turn in position p, the second scale turned on the first by phi_p,

    .. math:: d_p(\theta) = c_p + g(\theta) - h(\theta + \varphi_p),

    with a constant of its own in each position, as the zero is set anew. Every order is solved by
    itself by least squares over the positions, :math:`D_{pn} = G_n - H_n e^{i n \varphi_p}`. With
    m samples in m positions, evenly shifted, it is the rosette with its closure: all orders of both
    scales are found (Sim 1984, in "Modern Techniques in Metrology").

    Parameters
    ----------
    angle : array_like
        Angle of the first scale at each sample [rad], shape (k,), the same in all positions.
    differences : array_like
        Reading of the first less reading of the second scale [rad], shape (p, k).
    positions : array_like
        By how much the second scale is turned on the first [rad], shape (p,).
    orders : iterable of int
        Orders that the tables shall hold.
    noise : float, optional
        Standard deviation of a difference [rad]; found from what is left over where not given.
    blindness : float
        An order counts as blind where less than this share of its power tells one scale from the
        other [1].
    blind_allowance : float
        Standard uncertainty for the orders that are not seen [rad].
    points : int
        Number of points of the tables.

    Returns
    -------
    tuple of CalibrationTable
        The tables of the first and of the second scale.

    Validity
    --------
    White noise, small errors, and positions that are known far better than the errors change. Order
    1 holds the eccentricity of each scale, as far as it goes with the scale; what an axis between
    them does in a turn is in the table of the scale that it turns with.

    Raises
    ------
    RecordError
        The differences do not belong together, do not cover the turn, or show none of the orders.
    ModelError
        There are fewer than two positions, or a figure is impossible.

    Examples
    --------
    >>> t = 2.0 * np.pi * np.arange(36) / 36
    >>> shift = t[:, np.newaxis]
    >>> d = 4e-6 * np.sin(3.0 * t) - 7e-6 * np.cos(5.0 * (t + shift))
    >>> first, second = cross_calibration(t, d, positions=t, orders=range(1, 18), noise=1e-7)
    >>> print(f"{first.harmonic(3)[1] * 1e6:.4f} and {second.harmonic(5)[0] * 1e6:.4f} urad")
    4.0000 and 7.0000 urad
    """
    phi = np.atleast_1d(np.asarray(positions, dtype=np.float64))
    d = np.asarray(differences, dtype=np.float64)
    if phi.ndim != 1 or phi.size < 2 or not np.isfinite(phi).all():
        raise ModelError(
            f"separating two scales needs two positions or more, got {phi.size}: turn one of "
            "them on the other and measure again"
        )
    if d.ndim != 2 or d.shape[0] != phi.size:
        raise RecordError(
            f"there are {phi.size} positions: give a row of differences for each, got an array of "
            f"shape {d.shape}"
        )
    asked = whole_orders(orders)
    _require_share(blindness)
    _require_table(asked, points, blind_allowance)
    spectrum = turn_spectrum(angle, d, asked)
    turned: Complex = np.exp(1j * np.multiply.outer(phi, spectrum.orders.astype(np.float64)))
    # least squares with the columns 1 and -e^(i n phi), whose lengths are equal
    mean = turned.mean(axis=0)
    visibility = 1.0 - np.abs(mean) ** 2
    seen = visibility > blindness
    if not seen.any():
        raise RecordError(
            "these positions cannot separate the scales at any of the orders: turn them by other "
            "angles"
        )
    power = np.where(seen, phi.size * visibility, 1.0)
    first: Complex = np.where(seen, (1.0 - mean * np.conj(turned)) / power, 0.0)
    second: Complex = np.where(seen, (mean.conj()[np.newaxis] - np.conj(turned)) / power, 0.0)
    G = np.sum(first * spectrum.coefficients, axis=0)
    H = np.sum(second * spectrum.coefficients, axis=0)
    found = float(_checked_noise(noise)), math.inf
    if noise is None:
        inside = (spectrum.coefficients - (G - H * turned))[:, seen]
        found = _noise_of(spectrum, spectrum.residuals, inside, phi.size, 2)
    first_table, second_table = (
        _table(
            spectrum, of_scale, found[0] * gains, seen, points, 0.0, blind_allowance, found,
            "comparison of two scales",
        )
        for of_scale, gains in ((G, first), (H, second))
    )  # fmt: skip
    return first_table, second_table


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Combination:
    r"""A sum over the heads that gives the scale's error, :math:`G_n = \sum_j h_{jn} C_{jn}`."""

    orders: tuple[int, ...]
    """Orders that are asked for."""
    gains: Complex
    """The factors h, shape (m, orders); zero for an order that cannot be seen."""
    seen: NDArray[np.bool_]
    """Whether each order can be seen, shape (orders,)."""
    common: Array
    """What all heads may read together, one column for each unknown, shape (m, q)."""


def _head_angles(heads: ArrayLike) -> Array:
    alpha = np.atleast_1d(np.asarray(heads, dtype=np.float64))
    if alpha.ndim != 1 or alpha.size == 0 or not np.isfinite(alpha).all():
        raise ModelError("the heads need an angle each, in radians and finite")
    return alpha


def _checked_noise(noise: ArrayLike | None) -> Array:
    """Return the noise of readings, 1 where it is not given."""
    sigma = np.asarray(1.0 if noise is None else noise, dtype=np.float64)
    if not (np.isfinite(sigma).all() and np.all(sigma > 0.0)):
        raise ModelError("the noise must be positive and finite: leave it out if unknown")
    return sigma


def _require_share(blindness: float) -> None:
    if not 0.0 < blindness < 1.0:
        raise ModelError(f"the share of blindness lies between 0 and 1, got {blindness!r}")


def _require_uncertainty(u: float) -> None:
    if not 0.0 <= u < math.inf:
        raise ModelError("an uncertainty must be 0 or more and finite")


def _require_table(orders: tuple[int, ...], points: int, blind_allowance: float) -> None:
    _require_uncertainty(blind_allowance)
    highest = orders[-1]
    if points <= 2 * highest:
        raise ModelError(f"order {highest} needs more than {2 * highest} points, got {points}")


def _common_motion(alpha: Array, *, angle: bool, axis: bool) -> Array:
    r"""Return what an error of the table adds to the readings of all heads together.

    A column for each unknown: the angle where that is not known, x and y where the axis may move.

    An angle that is not known adds 1 to each of them; a radial motion (x, y) of the axis adds
    :math:`(x \sin\alpha_j - y \cos\alpha_j) / R`.
    """
    columns = [np.ones_like(alpha)] if angle else []
    if axis:
        columns += [np.sin(alpha), np.cos(alpha)]
    return np.stack(columns, axis=1) if columns else np.zeros((alpha.size, 0))


def _best_combination(
    readings: ScaleReadings, orders: Iterable[int], common: Array, blindness: float
) -> _Combination:
    r"""Return the combination of least noise that no common motion gets into.

    `common` is of `_common_motion`, shape (m, q). An order counts as blind where less than the
    share `blindness` of its power is left beside the common motion.

    A head at alpha reads order n as :math:`G_n e^{i n \alpha}`, so that G follows by weighted
    least squares over the heads, with the common motion as further unknowns.
    """
    _require_share(blindness)
    alpha, sigma = readings.heads, readings.relative_noise
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
    return _Combination(
        orders=asked,
        gains=np.asarray(gains / sigma[:, np.newaxis], dtype=np.complex128),
        seen=seen,
        common=common,
    )


def _common_basis(common: Array, sigma: Array) -> Array:
    """Orthonormal columns of the common motion, in units of the noise."""
    basis, values, _ = np.linalg.svd(common / sigma[:, np.newaxis], full_matrices=False)
    return basis[:, values > 1e-9 * float(values.max(initial=0.0))]


def _separated_table(
    readings: ScaleReadings,
    combination: _Combination,
    blind_allowance: float,
    points: int,
    method: str,
) -> CalibrationTable:
    """Return the table that a combination of heads gives, with its uncertainty.

    `blind_allowance` is the standard uncertainty for all that the method cannot see [rad].
    """
    _require_table(combination.orders, points, blind_allowance)
    if not combination.seen.any():
        raise RecordError(
            f"heads at these angles cannot see any of the orders by {method}: place them unevenly"
        )
    # every order, seen or not, is fitted, so that none of them passes for noise
    spectrum = turn_spectrum(readings.angle, readings.errors, combination.orders)
    G = np.sum(combination.gains * spectrum.coefficients, axis=0)
    scale, freedom = 1.0, math.inf
    if readings.noise is None:
        scale, freedom = _noise_scale(readings, spectrum, combination)
    sigma = readings.relative_noise
    gains = combination.gains * (scale * sigma)[:, np.newaxis]
    turned = _angle_variance(readings, combination, G, points)
    noise = float(scale * np.sqrt(np.mean(sigma**2))), freedom
    return _table(
        spectrum, G, gains, combination.seen, points, turned, blind_allowance, noise, method
    )


def _table(
    spectrum: TurnSpectrum,
    amplitudes: Complex,
    gains: Complex,
    seen: NDArray[np.bool_],
    points: int,
    head_variance: Array | float,
    blind_allowance: float,
    noise: tuple[float, float],
    method: str,
) -> CalibrationTable:
    """Return the table of complex amplitudes of all orders, of which some were seen.

    `gains` are the factors of each curve in them, times its noise; `noise` is that of one reading
    [rad], and its degrees of freedom.
    """
    n, found, s = spectrum.orders[seen], amplitudes[seen], _points(points)
    rows, order_variance = point_variance(spectrum, gains, seen, s)
    curve = np.zeros(points // 2 + 1, dtype=np.complex128)
    curve[n] = found * (0.5 * points)
    return CalibrationTable(
        angle=s,
        error=np.fft.irfft(curve, points),
        uncertainty=np.sqrt(rows + head_variance + blind_allowance**2),
        degrees_of_freedom=noise[1],
        orders=tuple(int(k) for k in n),
        blind=tuple(int(k) for k in spectrum.orders[~seen]),
        cosine=found.real,
        sine=-found.imag,
        order_uncertainty=np.sqrt(order_variance),
        noise=noise[0],
        method=method,
    )


def _points(count: int) -> Array:
    return np.asarray(2.0 * np.pi * np.arange(count) / count)


def _noise_of(
    spectrum: TurnSpectrum, between: Array, inside: Complex, rest: int, unknowns: int
) -> tuple[float, float]:
    """Return the noise of a reading and its degrees of freedom, from what is left over.

    It is left `between` the orders of the fit and `inside` them, of `rest` curves that know nothing
    of each other, less so many complex `unknowns` of each order.
    """
    samples = between.shape[1]
    left = float(np.sum(between**2))
    freedom = float(rest * (samples - 2 * spectrum.orders.size - 1))
    if spectrum.spread is None:
        left += 0.5 * samples * float(np.sum(np.abs(inside) ** 2))
        freedom += 2.0 * (rest - unknowns) * inside.shape[1]
    if freedom < 1.0:
        raise RecordError(
            "there are too few samples to find the noise from: give the noise, or take fewer orders"
        )
    return math.sqrt(left / freedom), freedom


def _noise_scale(
    readings: ScaleReadings, spectrum: TurnSpectrum, combination: _Combination
) -> tuple[float, float]:
    """Find the noise in units of the relative one, and its degrees of freedom, from what is left.

    What the heads read together is unknown at every sample; what is left beside it belongs to the
    noise, at the orders of the fit as well as between them.
    """
    # least squares over the heads leaves the least, whichever combination the table is made by; of
    # an order with a smaller share of its power what is left is rounding, not signal
    best = _best_combination(readings, combination.orders, combination.common, blindness=1e-9)
    G = np.sum(best.gains * spectrum.coefficients, axis=0)
    turned = np.exp(1j * np.multiply.outer(readings.heads, spectrum.orders))
    inside = (spectrum.coefficients - G * turned)[:, best.seen]
    sigma = readings.relative_noise
    basis = _common_basis(combination.common, sigma)

    def left(x: NDArray) -> NDArray:
        white = x / sigma[:, np.newaxis]
        return white - basis @ (basis.T @ white)

    rest = sigma.size - basis.shape[1]
    return _noise_of(spectrum, left(spectrum.residuals), left(inside), rest, 1)


def _angle_variance(
    readings: ScaleReadings, combination: _Combination, G: Complex, points: int
) -> Array:
    """Variance at each point from the heads' not standing where they are said to."""
    if readings.head_uncertainty == 0.0:
        return np.zeros(points)
    seen = combination.seen
    n = np.asarray(combination.orders, dtype=np.float64)[seen]
    turned = np.exp(1j * np.multiply.outer(readings.heads, n))
    waves = np.exp(1j * np.multiply.outer(_points(points), n))
    shift = np.real(waves @ (combination.gains[:, seen] * turned * (1j * n) * G[seen]).T)
    return readings.head_uncertainty**2 * np.sum(shift**2, axis=1)
