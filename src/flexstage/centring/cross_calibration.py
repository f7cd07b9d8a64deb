"""Two scales against one another in several relative positions: the errors of both."""

import math
from collections.abc import Iterable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from flexstage.arrays import Array, Complex
from flexstage.centring.calibration_table import CalibrationTable
from flexstage.centring.turn_spectrum import TurnSpectrum, point_variance, turn_spectrum
from flexstage.errors import ModelError, RecordError


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
    _check(phi, d, noise, blindness, blind_allowance)
    spectrum = turn_spectrum(angle, d, orders)
    if points <= 2 * spectrum.orders[-1]:
        raise ModelError(
            f"order {spectrum.orders[-1]} needs more than {2 * spectrum.orders[-1]} points, got "
            f"{points}"
        )
    turned = np.exp(1j * np.multiply.outer(phi, spectrum.orders.astype(np.float64)))
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
    first = np.where(seen, (1.0 - mean * np.conj(turned)) / power, 0.0)
    second = np.where(seen, (mean.conj()[np.newaxis] - np.conj(turned)) / power, 0.0)
    G = np.sum(first * spectrum.coefficients, axis=0)
    H = np.sum(second * spectrum.coefficients, axis=0)
    sigma, freedom = (
        (noise, math.inf) if noise is not None else _noise(spectrum, G - H * turned, seen)
    )
    return (
        _table(spectrum, G, first, seen, sigma, freedom, blind_allowance, points),
        _table(spectrum, H, second, seen, sigma, freedom, blind_allowance, points),
    )


def _check(
    phi: Array, d: Array, noise: float | None, blindness: float, blind_allowance: float
) -> None:
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
    if not 0.0 < blindness < 1.0:
        raise ModelError(f"the share of blindness lies between 0 and 1, got {blindness!r}")
    if noise is not None and not 0.0 < noise < math.inf:
        raise ModelError(f"the noise must be positive and finite, got {noise!r} rad")
    if not 0.0 <= blind_allowance < math.inf:
        raise ModelError("an uncertainty must be 0 or more and finite")


def _noise(spectrum: TurnSpectrum, model: Complex, seen: NDArray[np.bool_]) -> tuple[float, float]:
    """Noise of a difference from what is left, at the orders of the fit and between them."""
    positions, samples = spectrum.residuals.shape
    left = float(np.sum(spectrum.residuals**2))
    freedom = float(positions * (samples - 2 * spectrum.orders.size - 1))
    if spectrum.spread is None:
        inside = (spectrum.coefficients - model)[:, seen]
        left += 0.5 * samples * float(np.sum(np.abs(inside) ** 2))
        freedom += 2.0 * (positions - 2) * int(seen.sum())
    if freedom < 1.0:
        raise RecordError(
            "there are too few samples to find the noise from: give the noise, or take fewer orders"
        )
    return math.sqrt(left / freedom), freedom


def _table(
    spectrum: TurnSpectrum,
    G: Complex,
    gains: Complex,
    seen: NDArray[np.bool_],
    sigma: float,
    freedom: float,
    blind_allowance: float,
    points: int,
) -> CalibrationTable:
    n = spectrum.orders[seen]
    s = 2.0 * np.pi * np.arange(points) / points
    rows, per_order = point_variance(spectrum, sigma * gains, seen, s)
    curve = np.zeros(points // 2 + 1, dtype=np.complex128)
    curve[n] = G[seen] * (0.5 * points)
    return CalibrationTable(
        angle=s,
        error=np.fft.irfft(curve, points),
        uncertainty=np.sqrt(rows + blind_allowance**2),
        degrees_of_freedom=freedom,
        orders=tuple(int(k) for k in n),
        blind=tuple(int(k) for k in spectrum.orders[~seen]),
        cosine=G[seen].real,
        sine=-G[seen].imag,
        order_uncertainty=np.sqrt(per_order),
        noise=sigma,
        method="comparison of two scales",
    )
