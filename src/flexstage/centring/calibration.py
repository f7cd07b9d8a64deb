"""Error tables of a scale, from several heads or from the comparison of two scales."""

import math
from collections.abc import Iterable
from dataclasses import dataclass
from itertools import combinations
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from flexstage.base.arrays import Array, Complex
from flexstage.base.errors import ModelError, RecordError
from flexstage.centring.calibration_table import CalibrationTable, listed, require_points
from flexstage.centring.turns import (
    TurnSpectrum,
    point_variance,
    turn_spectrum,
    whole_orders,
)
from flexstage.files.result import Result


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ScaleReadings:
    """Simultaneous readings of one head or several, over a turn or several."""

    angle: Array
    """Angle of the table at each sample [rad], shape (k,): of a reference if the heads are compared
    with one, else the nominal angle.
    """
    errors: Array
    """Reading minus angle of each head [rad], shape (m, k)."""
    heads: Array
    """Angles of the heads [rad], shape (m,)."""
    noise: ArrayLike | None = None
    """Standard deviation of a reading [rad], one for all or shape (m,); estimated from the
    residuals, and equal for all heads, if not given.
    """
    head_uncertainty: float = 0.0
    """Standard uncertainty of the angle of each head [rad]."""

    def __post_init__(self) -> None:
        alpha = _head_angles(self.heads)
        y = np.atleast_2d(np.asarray(self.errors, dtype=np.float64))
        if y.shape[0] != alpha.size:
            raise RecordError(
                f"there are {alpha.size} heads, but readings of {y.shape[0]}: give a row of "
                "readings for each head"
            )
        noise = _checked_noise(self.noise)
        if noise.ndim and noise.shape != alpha.shape:
            raise ModelError(
                f"the noise must be one value or {alpha.size}, one for each head, got {noise.size}"
            )
        _require_uncertainty(self.head_uncertainty)
        object.__setattr__(self, "angle", np.asarray(self.angle, dtype=np.float64))
        object.__setattr__(self, "errors", y)
        object.__setattr__(self, "heads", alpha)

    @property
    def relative_noise(self) -> Array:
        """Noise of each head [rad], shape (m,); 1 if it is not known."""
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
    r"""Return the table of a scale from simultaneous readings of two or more heads.

    All heads share the angle of the table, which need not be known: it cancels in their
    differences. The difference of two of them is the difference of the scale's error and its
    shifted copy, a factor in the Fourier domain (Probst 2008, Measurement Science and Technology
    19; Geckeler, Link, Krause and Elster 2014, the same 25),

    .. math:: C_{jn} - C_{1n} = \left(e^{i n \alpha_j} - e^{i n \alpha_1}\right) G_n.

    All differences are used at once, as least squares over the heads with a common unknown. The
    heads are blind to orders for which the factors of all pairs vanish; the table lists them.

    Parameters
    ----------
    readings : ScaleReadings
        Readings of the heads, which are preferably unevenly spaced.
    orders : iterable of int
        Orders of the table.
    axis_motion : bool
        Whether the table's axis may move. It is then solved for at every sample, which needs four
        heads or more. Order 1 is then blind, as an eccentric scale and once-per-turn motion of the
        axis give the same readings.
    blindness : float
        An order counts as blind if less than this share of its power remains in the differences
        [1]: at 0.01 the noise is at most ten times that of a comparison with a perfect reference.
    blind_allowance : float
        Standard uncertainty for blind orders [rad].
    points : int
        Number of points of the table.

    Returns
    -------
    CalibrationTable
        The table, whose order 1 includes the eccentricity.

    Validity
    --------
    White noise, and errors of the scale that are periodic in a turn and small: the deviation of the
    table from its nominal angle must be small compared with the period of the errors. Orders that
    are present but not requested count as noise.

    Raises
    ------
    RecordError
        The readings do not match, do not cover the turn, or show none of the orders.
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
    r"""Return the visibility of each order of a scale's error to heads at given angles.

    .. math:: v_n = \frac1m \sum_j \left|e^{i n \alpha_j} - \overline{e^{i n \alpha}}\right|^2

    The variance of the order is that of a comparison with a perfect reference, divided by v.

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
        The angles of the heads are not finite.

    Examples
    --------
    >>> print(np.round(order_visibility(np.radians([0.0, 90.0, 210.0]), range(1, 5)), 3))
    [0.97  0.889 0.444 0.667]
    """
    alpha = _head_angles(heads)
    n = np.asarray(whole_orders(orders), dtype=np.float64)
    return _visibility(alpha[np.newaxis], n, axis_motion)[0]


def _visibility(alpha: Array, n: Array, axis_motion: bool) -> Array:
    """Return the visibility of orders n to arrangements of heads, shape (arrangements, orders)."""
    turned = np.exp(1j * np.multiply.outer(alpha, n))
    common = _common_motion(alpha, angle=True, axis=axis_motion)
    basis, values, _ = np.linalg.svd(common, full_matrices=False)
    basis = basis * (values > 1e-9 * values[:, :1])[:, np.newaxis]
    left = turned - basis @ (np.swapaxes(basis, 1, 2) @ turned)
    return np.asarray(np.sum(np.abs(left) ** 2, axis=1) / alpha.shape[1], dtype=np.float64)


@dataclass(frozen=True, slots=True, kw_only=True)
class HeadArrangement(Result):
    """Angles of heads, and the noise of each order that they give."""

    table_key: ClassVar[str] = "orders"

    heads: Array
    """Angles of the heads [rad], shape (m,)."""
    orders: tuple[int, ...]
    """The orders."""
    gain: Array
    """Uncertainty of the amplitude of each order, over that by one head and a perfect reference
    [1], shape (orders,); at best 1 / sqrt(m).
    """
    examined: int
    """Number of arrangements that were compared."""

    def data(self) -> dict[str, Any]:
        gains = zip(self.orders, self.gain.tolist(), strict=True)
        return {
            "heads_deg": np.degrees(self.heads).round(9).tolist(),
            "largest_gain": float(self.gain.max()),
            "bound": 1.0 / math.sqrt(self.heads.size),
            "examined": self.examined,
            "orders": [{"order": n, "gain": gain} for n, gain in gains],
        }


def best_heads(
    count: int, orders: Iterable[int], *, step: float, axis_motion: bool = False
) -> HeadArrangement:
    r"""Return the angles of heads with the smallest uncertainty of self-calibration.

    The uncertainty of order n, relative to one head and a perfect reference, is

    .. math:: g_n = 1 / \sqrt{m v_n}

    with the visibility v of `order_visibility`, at best :math:`1 / \sqrt m`. The arrangement has
    the smallest largest gain; of equal ones, that with the smallest mean square.

    Parameters
    ----------
    count : int
        Number of heads m.
    orders : iterable of int
        The wanted orders.
    step : float
        Step of the grid of angles [rad], a whole part of a turn. The first head is at 0.
    axis_motion : bool
        Whether the table's axis may move.

    Returns
    -------
    HeadArrangement
        Angles and gains. Turned or mirrored, the arrangement has the same gains.

    Validity
    --------
    White noise, equal for all heads. All arrangements on the grid are compared.

    Raises
    ------
    ModelError
        The number of heads or the step is impossible, there are more than 500 000 arrangements, or
        none shows all orders.

    Examples
    --------
    >>> found = best_heads(4, range(1, 17), step=math.radians(10.0))
    >>> print(np.degrees(found.heads).round(), f"{found.gain.max():.3f}")
    [  0.  20. 210. 320.] 0.640
    """
    # arrangements that take seconds, and those that are compared at once
    most, batch = 500_000, 10_000
    requested = whole_orders(orders)
    n = np.asarray(requested, dtype=np.float64)
    places = round(2.0 * math.pi / step) if 0.0 < step < math.inf else 0
    if places < 2 or abs(places * step - 2.0 * math.pi) > 1e-9:
        raise ModelError(
            f"the step must be a whole part of 360 degrees, got {math.degrees(step):g} degrees"
        )
    least, moving = (4, " with a moving axis") if axis_motion else (2, "")
    if not least <= count <= places:
        raise ModelError(
            f"self-calibration{moving} needs {least} heads or more, and at most one at each of "
            f"{places} angles, got {count}"
        )
    if (number := math.comb(places - 1, count - 1)) > most:
        raise ModelError(
            f"{count} heads at {places} angles have {number} arrangements, at most {most} are "
            "compared: give a larger --step"
        )
    grid: Array = np.asarray(step * np.arange(places), dtype=np.float64)
    numbers = np.array([(0, *others) for others in combinations(range(1, places), count - 1)])
    squares = np.concatenate([
        1.0 / (count * np.maximum(_visibility(grid[numbers[i : i + batch]], n, axis_motion), 1e-12))
        for i in range(0, number, batch)
    ])  # fmt: skip
    # rounded, so that equal ones are equal; of turned and mirrored ones, which are, that with a
    # narrow pair first and the others over the circle
    worst, mean = squares.max(axis=1).round(9), squares.mean(axis=1).round(9)
    heads = grid[numbers[np.lexsort((-numbers[:, -1], numbers[:, 1], mean, worst))[0]]]
    visibility = _visibility(heads[np.newaxis], n, axis_motion)[0]
    if visibility.min() < 1e-9:
        unseen = listed(tuple(k for k, v in zip(requested, visibility, strict=True) if v < 1e-9))
        raise ModelError(
            f"no arrangement of {count} heads on this grid shows all these orders: the best misses "
            f"{unseen}; leave them out of --orders, or give more heads or a smaller --step"
        )
    return HeadArrangement(
        heads=heads,
        orders=requested,
        gain=1.0 / np.sqrt(count * visibility),
        examined=number,
    )


def against_reference(
    readings: ScaleReadings,
    orders: Iterable[int],
    *,
    axis_motion: bool = False,
    points: int = 360,
) -> CalibrationTable:
    r"""Return the table of a scale by comparison of its heads with an angle reference.

    Each head gives a table; their average over the scale has each turned back by its angle,
    :math:`G_n = \sum_j w_j e^{-i n \alpha_j} C_{jn}`, with weights by their noise.

    The other parameters are those of `self_calibration`.

    Parameters
    ----------
    readings : ScaleReadings
        Readings of the heads, over the angle of the reference.
    axis_motion : bool
        Whether the table's axis may move. It is then solved for at every sample, which needs three
        heads or more, and makes them blind to orders that read like a motion.

    Returns
    -------
    CalibrationTable
        The table, whose order 1 includes the eccentricity.

    Validity
    --------
    White noise, errors of the scale that are periodic in a turn, and a reference without error: the
    table includes errors of the reference. To first order it also includes radial motion of the
    axis that is not solved for.

    Raises
    ------
    RecordError
        The readings do not match, or do not cover the turn.
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

    With N evenly spaced heads, the mean of the differences between a reference head and each of
    them is the error of the scale without the orders that are multiples of N (Masuda and Kajitani
    1993, Precision Engineering 15),

    .. math:: \frac1N \sum_j (r_0 - r_j) = g(s) - \frac1N \sum_j g(s + 2 \pi j / N).

    The angle of the table cancels, and no equation is solved.

    The other parameters are those of `self_calibration`.

    Parameters
    ----------
    readings : ScaleReadings
        Readings of N evenly spaced heads, and of the reference head, which may be one of them.
    reference : int
        Number of the reference head, from 0.

    Returns
    -------
    CalibrationTable
        The table, whose order 1 includes the eccentricity.

    Validity
    --------
    As for `flexstage.centring.calibration.self_calibration`, whose least squares use the same
    readings with less noise. Radial motion of the axis cancels in the mean of the heads, but not in
    the reference head: it is in the table.

    Raises
    ------
    RecordError
        The readings do not match, do not cover the turn, or show none of the orders.
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
            f"the reference head must be one of {alpha.size} heads, from 0, got {reference}"
        )
    even = _even_heads(alpha, reference)
    requested = whole_orders(orders)
    n = np.asarray(requested, dtype=np.float64)
    factor = np.zeros(alpha.size)
    factor[reference] = 1.0
    factor[even] -= 1.0 / even.size
    # the transfer factor of each order is removed: it is 1 except for small errors of head angles
    transfer = factor @ np.exp(1j * np.multiply.outer(alpha, n))
    visible = np.array([k % even.size != 0 for k in requested])
    gains = np.where(
        visible, np.multiply.outer(factor, 1.0 / np.where(visible, transfer, 1.0)), 0.0
    )
    common = _common_motion(alpha, angle=True, axis=False)
    combination = _Combination(orders=requested, gains=gains, visible=visible, common=common)
    method = f"equal-division averaging over {even.size} heads"
    return _separated_table(readings, combination, blind_allowance, points, method)


def _even_heads(alpha: np.ndarray, reference: int) -> np.ndarray:
    """Return the heads that divide the turn evenly: all of them, or all but the reference head."""
    # largest deviation from an even division, as a share of the spacing
    tolerance = 1e-3
    every = np.arange(alpha.size)
    for heads in (every, np.delete(every, reference)):
        if heads.size < 2:
            continue
        at = np.sort(np.mod(alpha[heads], 2.0 * np.pi))
        steps = np.diff(np.append(at, at[0] + 2.0 * np.pi))
        even = 2.0 * np.pi / heads.size
        if np.max(np.abs(steps - even)) < tolerance * even:
            return heads
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
    r"""Return the tables of two scales, compared in several relative positions.

    Over a turn in position p, with the second scale turned relative to the first by phi_p,

    .. math:: d_p(\theta) = c_p + g(\theta) - h(\theta + \varphi_p),

    with a constant for each position, as the zero is set again. Each order is solved separately by
    least squares over the positions, :math:`D_{pn} = G_n - H_n e^{i n \varphi_p}`. With m samples
    in m evenly shifted positions it is the rosette method with closure, for all orders of both
    scales (Sim 1984, in "Modern Techniques in Metrology").

    Parameters
    ----------
    angle : array_like
        Angle of the first scale at each sample [rad], shape (k,), the same in all positions.
    differences : array_like
        Reading of the first minus reading of the second scale [rad], shape (p, k).
    positions : array_like
        Angle of the second scale relative to the first [rad], shape (p,).
    orders : iterable of int
        Orders of the tables.
    noise : float, optional
        Standard deviation of a difference [rad]; estimated from the residuals if not given.
    blindness : float
        An order counts as blind if less than this share of its power separates the two scales [1].
    blind_allowance : float
        Standard uncertainty for blind orders [rad].
    points : int
        Number of points of the tables.

    Returns
    -------
    tuple of CalibrationTable
        The tables of the first and of the second scale.

    Validity
    --------
    White noise, small errors, and positions whose uncertainty is small compared with the period of
    the errors. Order 1 includes the eccentricity that turns with each scale; motion of an axis
    between the scales is in the table of the scale with which it turns.

    Raises
    ------
    RecordError
        The differences do not match, do not cover the turn, or show none of the orders.
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
            f"separating two scales needs two positions or more, got {phi.size}: turn one scale "
            "relative to the other and measure again"
        )
    if d.ndim != 2 or d.shape[0] != phi.size:
        raise RecordError(
            f"{phi.size} positions need a row of differences each, got an array of shape {d.shape}"
        )
    requested = whole_orders(orders)
    _require_share(blindness)
    _require_table(requested, points, blind_allowance)
    spectrum = turn_spectrum(angle, d, requested)
    turned: Complex = np.exp(1j * np.multiply.outer(phi, spectrum.orders.astype(np.float64)))
    # least squares with the columns 1 and -e^(i n phi), whose lengths are equal
    mean = turned.mean(axis=0)
    visibility = 1.0 - np.abs(mean) ** 2
    visible = visibility > blindness
    if not visible.any():
        raise RecordError(
            "these positions do not separate the scales at any of the orders: use other angles "
            "between them"
        )
    power = np.where(visible, phi.size * visibility, 1.0)
    first: Complex = np.where(visible, (1.0 - mean * np.conj(turned)) / power, 0.0)
    second: Complex = np.where(visible, (mean.conj()[np.newaxis] - np.conj(turned)) / power, 0.0)
    G = np.sum(first * spectrum.coefficients, axis=0)
    H = np.sum(second * spectrum.coefficients, axis=0)
    sigma_and_freedom = float(_checked_noise(noise)), math.inf
    if noise is None:
        inside = (spectrum.coefficients - (G - H * turned))[:, visible]
        sigma_and_freedom = _noise_of(spectrum, spectrum.residuals, inside, phi.size, 2)
    sigma = sigma_and_freedom[0]
    no_heads = np.zeros((0, G.size), dtype=np.complex128)
    first_table, second_table = (
        _table(
            spectrum, of_scale, sigma * gains, visible, points, no_heads,
            blind_allowance, sigma_and_freedom, "comparison of two scales",
        )
        for of_scale, gains in ((G, first), (H, second))
    )  # fmt: skip
    return first_table, second_table


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Combination:
    r"""Sum over the heads that gives the scale's error, :math:`G_n = \sum_j h_{jn} C_{jn}`."""

    orders: tuple[int, ...]
    """Requested orders."""
    gains: Complex
    """The factors h, shape (m, orders); zero for a blind order."""
    visible: NDArray[np.bool_]
    """Whether each order is visible, shape (orders,)."""
    common: Array
    """Readings of all heads for each common unknown, shape (m, q)."""


def _head_angles(heads: ArrayLike) -> Array:
    alpha = np.atleast_1d(np.asarray(heads, dtype=np.float64))
    if alpha.ndim != 1 or alpha.size == 0 or not np.isfinite(alpha).all():
        raise ModelError("the heads need an angle each, in radians and finite")
    return alpha


def _checked_noise(noise: ArrayLike | None) -> Array:
    """Return the noise of readings, 1 if it is not given."""
    sigma = np.asarray(1.0 if noise is None else noise, dtype=np.float64)
    if not (np.isfinite(sigma).all() and np.all(sigma > 0.0)):
        raise ModelError("the noise must be positive and finite: omit it if unknown")
    return sigma


def _require_share(blindness: float) -> None:
    if not 0.0 < blindness < 1.0:
        raise ModelError(f"the share of blindness must be between 0 and 1, got {blindness!r}")


def _require_uncertainty(u: float) -> None:
    if not 0.0 <= u < math.inf:
        raise ModelError("an uncertainty must be 0 or more and finite")


def _require_table(orders: tuple[int, ...], points: int, blind_allowance: float) -> None:
    _require_uncertainty(blind_allowance)
    require_points(orders[-1], points)


def _common_motion(alpha: Array, *, angle: bool, axis: bool) -> Array:
    r"""Return the readings of all heads for each unknown motion of the table, by column.

    The unknowns are the angle, if it is not known, and x and y, if the axis may move.

    An unknown angle adds 1 to each reading; a radial motion (x, y) of the axis adds
    :math:`(x \sin\alpha_j - y \cos\alpha_j) / R`.
    """
    columns = [np.ones_like(alpha)] if angle else []
    if axis:
        columns += [np.sin(alpha), np.cos(alpha)]
    return np.stack(columns, axis=-1) if columns else np.zeros((*alpha.shape, 0))


def _best_combination(
    readings: ScaleReadings, orders: Iterable[int], common: Array, blindness: float
) -> _Combination:
    r"""Return the combination of least noise that cancels common motion.

    `common` is from `_common_motion`, shape (m, q). An order counts as blind if less than the
    share `blindness` of its power remains without the common motion.

    A head at alpha reads order n as :math:`G_n e^{i n \alpha}`, so that G follows from weighted
    least squares over the heads, with the common motion as further unknowns.
    """
    _require_share(blindness)
    alpha, sigma = readings.heads, readings.relative_noise
    if alpha.size <= common.shape[1]:
        raise ModelError(
            f"{common.shape[1]} unknown motions of the table need at least "
            f"{common.shape[1] + 1} heads, got {alpha.size}"
        )
    requested = whole_orders(orders)
    n = np.asarray(requested, dtype=np.float64)
    # columns of unit noise make ordinary projections weighted
    turned = np.exp(1j * np.multiply.outer(alpha, n)) / sigma[:, np.newaxis]
    basis = _common_basis(common, sigma)
    left = turned - basis @ (basis.T @ turned)
    power = np.sum(np.abs(left) ** 2, axis=0)
    visible = power > blindness * np.sum(np.abs(turned) ** 2, axis=0)
    gains = np.where(visible, np.conj(left) / np.where(visible, power, 1.0), 0.0)
    return _Combination(
        orders=requested,
        gains=np.asarray(gains / sigma[:, np.newaxis], dtype=np.complex128),
        visible=visible,
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
    """Return the table of a combination of heads, with its uncertainty.

    `blind_allowance` is the standard uncertainty for blind orders [rad].
    """
    _require_table(combination.orders, points, blind_allowance)
    if not combination.visible.any():
        raise RecordError(
            f"heads at these angles are blind to all orders by {method}: place them unevenly"
        )
    # blind orders are fitted too, so that they do not count as noise
    spectrum = turn_spectrum(readings.angle, readings.errors, combination.orders)
    G = np.sum(combination.gains * spectrum.coefficients, axis=0)
    scale, freedom = 1.0, math.inf
    if readings.noise is None:
        scale, freedom = _noise_scale(readings, spectrum, combination)
    sigma = readings.relative_noise
    gains = combination.gains * (scale * sigma)[:, np.newaxis]
    shifts = _head_shifts(readings, combination, G)
    noise = float(scale * np.sqrt(np.mean(sigma**2))), freedom
    return _table(
        spectrum, G, gains, combination.visible, points, shifts, blind_allowance, noise, method
    )


def _table(
    spectrum: TurnSpectrum,
    amplitudes: Complex,
    gains: Complex,
    visible: NDArray[np.bool_],
    points: int,
    head_shifts: Complex,
    blind_allowance: float,
    noise: tuple[float, float],
    method: str,
) -> CalibrationTable:
    """Return the table of complex amplitudes of all orders, without the blind ones.

    `gains` are the factors of each curve in them, times its noise; `head_shifts` is their change
    by the standard uncertainty of each head's angle; `noise` is that of one reading [rad], and its
    degrees of freedom.
    """
    n, used, s = spectrum.orders[visible], amplitudes[visible], _points(points)
    rows, order_variance, covariance = point_variance(spectrum, gains, visible, s)
    shifts = head_shifts[:, visible]
    waves = np.exp(1j * np.multiply.outer(s, n.astype(np.float64)))
    head_variance = np.sum(np.real(waves @ shifts.T) ** 2, axis=1)
    curve = np.zeros(points // 2 + 1, dtype=np.complex128)
    curve[n] = used * (0.5 * points)
    return CalibrationTable(
        angle=s,
        error=np.fft.irfft(curve, points),
        uncertainty=np.sqrt(rows + head_variance + blind_allowance**2),
        degrees_of_freedom=noise[1],
        orders=tuple(int(k) for k in n),
        blind=tuple(int(k) for k in spectrum.orders[~visible]),
        cosine=used.real,
        sine=-used.imag,
        order_uncertainty=np.sqrt(order_variance),
        noise=noise[0],
        method=method,
        noise_covariance=covariance,
        head_shifts=np.hstack((shifts.real, -shifts.imag)),
        blind_allowance=blind_allowance,
    )


def _points(count: int) -> Array:
    return np.asarray(2.0 * np.pi * np.arange(count) / count)


def _noise_of(
    spectrum: TurnSpectrum, between: Array, inside: Complex, curves: int, unknowns: int
) -> tuple[float, float]:
    """Return the noise of a reading and its degrees of freedom, from the residuals.

    The residuals are `between` the orders of the fit and `inside` them, of a number of independent
    `curves`, with that number of complex `unknowns` for each order.
    """
    samples = between.shape[1]
    square = float(np.sum(between**2))
    freedom = float(curves * (samples - 2 * spectrum.orders.size - 1))
    if spectrum.spread is None:
        square += 0.5 * samples * float(np.sum(np.abs(inside) ** 2))
        freedom += 2.0 * (curves - unknowns) * inside.shape[1]
    if freedom < 1.0:
        raise RecordError(
            "there are too few samples to estimate the noise: give the noise, or fit fewer orders"
        )
    return math.sqrt(square / freedom), freedom


def _noise_scale(
    readings: ScaleReadings, spectrum: TurnSpectrum, combination: _Combination
) -> tuple[float, float]:
    """Return the noise in units of the relative noise, and its freedom, from the residuals.

    The common motion of the heads is unknown at every sample; the residuals without it are noise,
    both at the orders of the fit and between them.
    """
    # least squares over the heads has the smallest residuals of all combinations; for an order with
    # a smaller share of its power they are rounding errors, not signal
    best = _best_combination(readings, combination.orders, combination.common, blindness=1e-9)
    G = np.sum(best.gains * spectrum.coefficients, axis=0)
    turned = np.exp(1j * np.multiply.outer(readings.heads, spectrum.orders))
    inside = (spectrum.coefficients - G * turned)[:, best.visible]
    sigma = readings.relative_noise
    basis = _common_basis(combination.common, sigma)

    def without_motion(x: NDArray) -> NDArray:
        white = x / sigma[:, np.newaxis]
        return white - basis @ (basis.T @ white)

    between = without_motion(spectrum.residuals)
    return _noise_of(spectrum, between, without_motion(inside), sigma.size - basis.shape[1], 1)


def _head_shifts(readings: ScaleReadings, combination: _Combination, G: Complex) -> Complex:
    """Return the change of each order by the standard uncertainty of each head's angle."""
    if readings.head_uncertainty == 0.0:
        return np.zeros((0, G.size), dtype=np.complex128)
    n = np.asarray(combination.orders, dtype=np.float64)
    turned = np.exp(1j * np.multiply.outer(readings.heads, n))
    return readings.head_uncertainty * combination.gains * turned * (1j * n) * G
