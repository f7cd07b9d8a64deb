"""Turns of a record, and harmonics of curves sampled over them."""

import math
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from flexstage.base.arrays import Array, Complex
from flexstage.base.errors import RecordError

_TURN = 2.0 * math.pi


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Turns:
    """Unwrapped angles of a record, and the beginnings of its turns."""

    angle: Array
    """Unwrapped angle of each sample [rad], shape (n,)."""
    direction: int
    """Overall direction of the angle, -1 or 1; 0 for unordered samples."""
    count: float
    """Number of turns of the samples, including the step from the last to the first."""
    bounds: tuple[int, ...]
    """First sample of each turn and, at the end, the number of samples. The last turn is at least
    half of one, or part of that before it.
    """
    coverage: float
    """Share of a turn that has samples [1]: 1 minus the largest gap, plus the usual gap."""

    @property
    def full(self) -> int:
        """Number of full turns, or 1 for part of one."""
        return max(1, math.floor(self.count * (1.0 + 0.5 / self.angle.size)))

    def readings(self) -> tuple[Array, Array]:
        """Return how often the angle of each sample is read, and its turn less their mean turn."""
        v, half = np.abs(self.angle - self.angle[0]) / _TURN, 0.5 * self.count / self.angle.size
        number = np.floor(v + half)
        readings = np.floor(v.max() + half - (v - number)) + 1.0
        return readings, self.direction * (number - 0.5 * (readings - 1.0))


def find_turns(angle: ArrayLike) -> Turns:
    """Unwrap an angle, and find the turns.

    The angle [rad] rises or falls. An angle over more than a turn is taken as unwrapped. Otherwise
    a step of more than half a turn is a wrap. The angle of unordered samples is unchanged.

    Validity
    --------
    Neighbouring samples less than half a turn apart. Jitter does not matter.

    Examples
    --------
    >>> turns = find_turns(np.radians([350.0, 110.0, 230.0, 350.5, 110.5, 229.0]))
    >>> print(f"{turns.count:.2f} turns, the last angle is {np.degrees(turns.angle[-1]):.0f} deg")
    2.00 turns, the last angle is 949 deg
    """
    raw = np.asarray(angle, dtype=np.float64)
    if raw.ndim != 1 or raw.size < 2 or not np.isfinite(raw).all():
        raise RecordError(
            f"an angle needs two samples or more, all of them finite, got shape {raw.shape}"
        )
    if raw.max() == raw.min():
        raise RecordError(f"the angle is {raw[0]:g} in all samples: the table did not turn")
    u = raw / _TURN
    steps = np.diff(u)
    if u.max() - u.min() <= 1.0 + 1e-6 + float(np.median(np.abs(steps))):
        wrapped = steps - np.rint(steps)
        forward = float(np.sum(wrapped))
        # the steps of unordered samples cancel
        if abs(forward) >= 0.5 * float(np.abs(wrapped).sum()):
            u = u[0] + np.concatenate(([0.0], np.cumsum(wrapped)))
            # the sum accumulates rounding errors: the fraction is that of the angle itself
            u = raw / _TURN + np.rint(u - raw / _TURN)
    return _described(u)


def _described(u: Array) -> Turns:
    steps = np.diff(u)
    net, way = float(u[-1] - u[0]), float(np.abs(steps).sum())
    ordered = abs(net) >= 0.5 * way
    gaps = np.diff(np.sort(u % 1.0))
    gap = max(float(gaps.max()), 1.0 - float(gaps.sum()))
    usual = min(gap, 1.0 / max(1, places(u)))
    coverage = 1.0 - gap + usual
    if not ordered:
        return Turns(
            angle=_TURN * u, direction=0, count=max(1.0, float(np.ptp(u))),
            bounds=(0, u.size), coverage=coverage,
        )  # fmt: skip
    count = abs(net) * u.size / (u.size - 1)
    number = np.floor(np.abs(u - u[0]) + 1e-9 * count)
    full_turns = max(1, round(count))
    # the first sample of each turn, whatever the jitter
    reached = np.maximum.accumulate(number)
    starts = [int(np.searchsorted(reached, k)) for k in range(full_turns)]
    bounds = (*sorted(set(starts)), u.size)
    return Turns(
        angle=_TURN * u, direction=1 if net > 0.0 else -1, count=count,
        bounds=bounds, coverage=coverage,
    )  # fmt: skip


def places(u: Array) -> int:
    """Return the approximate number of different angles [turn] in a turn."""
    return int(np.unique(np.rint((u % 1.0) * 1e6)).size)


def unwrap_error(error: ArrayLike) -> Array:
    """Remove full turns from errors that are differences of two wrapped angles.

    The errors [rad] are then within half a turn of their mean direction.

    Validity
    --------
    Errors within less than half a turn of each other.

    Examples
    --------
    >>> print(np.degrees(unwrap_error(np.radians([0.02, -359.97, 360.01, -0.01]))).round(3))
    [ 0.02  0.03  0.01 -0.01]
    """
    raw = np.asarray(error, dtype=np.float64)
    if not np.isfinite(raw).all():
        raise RecordError("an error must be finite in all samples")
    if raw.size == 0 or float(np.ptp(raw)) < 0.5 * _TURN:
        return raw.copy()
    turned = np.exp(2j * math.pi * raw / _TURN)
    middle = float(np.angle(turned.mean()))
    return raw - _TURN * np.rint((raw - middle) / _TURN)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TurnSpectrum:
    r"""Harmonics of several curves sampled at the same angles.

    .. math:: y_j(\theta) = o_j + \mathrm{Re} \sum_n C_{jn} e^{i n \theta}
    """

    orders: NDArray[np.int64]
    """The orders n, shape (n,)."""
    coefficients: Complex
    """Complex amplitudes C, cosine minus i times sine, shape (curves, n)."""
    residuals: Array
    """Residuals of the curves, shape (curves, k)."""
    spread: Array | None = None
    """Covariance of the real, then the imaginary parts of a curve's amplitudes for noise of
    variance 1 in each sample, shape (2 n, 2 n); None if it is 2 / k times the unit matrix, as for
    uniform sampling.
    """


def whole_orders(orders: Iterable[int]) -> tuple[int, ...]:
    """Return distinct orders in rising order."""
    listed = list(orders)
    bad = [n for n in listed if isinstance(n, bool) or int(n) != n or n < 1]
    if bad or not listed:
        raise RecordError(
            "orders must be whole numbers of 1 or more, got "
            f"{'none' if not listed else repr(bad[0])}"
        )
    return tuple(sorted({int(n) for n in listed}))


def turn_spectrum(angle: ArrayLike, curves: ArrayLike, orders: Iterable[int]) -> TurnSpectrum:
    """Return the harmonics of curves by least squares, or by the equivalent Fourier transform.

    Angles [rad] may be in any order, over one turn or several; a gap of more than a tenth of a turn
    is refused. `curves` has the shape (curves, k).

    Validity
    --------
    Orders that are not fitted must be absent or orthogonal to the others. They are orthogonal if
    full turns are sampled uniformly, with more than twice as many samples as the highest order.

    Examples
    --------
    >>> t = 2.0 * np.pi * np.arange(36) / 36
    >>> spectrum = turn_spectrum(t, [3.0 * np.cos(2.0 * t) + 0.7 * np.sin(5.0 * t)], (2, 5))
    >>> print(f"{spectrum.coefficients[0, 0].real:.3f}, {spectrum.coefficients[0, 1].imag:.3f}")
    3.000, -0.700
    """
    theta, y = np.asarray(angle, dtype=np.float64), np.asarray(curves, dtype=np.float64)
    if y.ndim != 2 or theta.shape != y.shape[1:] or theta.size < 3:
        raise RecordError(
            "a turn needs an angle for each sample, and a row of samples for each curve, got "
            f"shapes {theta.shape} and {y.shape}"
        )
    if not (np.isfinite(theta).all() and np.isfinite(y).all()):
        raise RecordError("angles and readings must be finite: remove samples that are not")
    n = np.asarray(whole_orders(orders), dtype=np.int64)
    per_turn = _uniform(theta)
    if per_turn is None:
        return _fitted(theta, y, n)
    if 2 * n[-1] >= per_turn:
        raise RecordError(
            f"order {n[-1]} needs more than {2 * n[-1]} samples in a turn, got {per_turn}"
        )
    return _transformed(theta, y, n, per_turn)


def point_variance(
    spectrum: TurnSpectrum, gains: Complex, visible: NDArray[np.bool_], at: Array
) -> tuple[Array, Array, Array | None]:
    """Return the variance of a sum of curves at angles [rad], and the mean variance of each order.

    `gains` are factors of each curve and order, times the noise of the curve; `visible` is True for
    the orders in the sum. The third value is the covariance of the cosines, then the sines of the
    sum; None if they are independent, with the variance of their order.
    """
    h = gains[:, visible]
    if spectrum.spread is None:
        per_order = (2.0 / spectrum.residuals.shape[1]) * np.sum(np.abs(h) ** 2, axis=0)
        return np.full(at.size, float(per_order.sum())), per_order, None
    keep = np.flatnonzero(np.concatenate((visible, visible)))
    Q = spectrum.spread[np.ix_(keep, keep)]
    covariance = np.zeros_like(Q)
    for row in h:
        a, b = np.diag(row.real), np.diag(row.imag)
        T = np.block([[a, -b], [b, a]])
        covariance += T @ Q @ T.T
    phase = np.multiply.outer(at, spectrum.orders[visible].astype(np.float64))
    waves = np.hstack((np.cos(phase), -np.sin(phase)))
    per_order = np.diag(covariance).reshape(2, -1).mean(axis=0)
    rows = np.einsum("ij,jk,ik->i", waves, covariance, waves, optimize=True)
    # the sine is minus the imaginary part
    sign = np.repeat((1.0, -1.0), h.shape[1])
    return rows, per_order, covariance * np.outer(sign, sign)


def _uniform(theta: Array) -> int | None:
    """Return the samples per turn if full turns were sampled uniformly and in order, else None."""
    steps = np.diff(theta)
    step = float(steps.mean())
    if step == 0.0 or np.max(np.abs(steps - step)) > 1e-9 * abs(step):
        return None
    per_turn = 2.0 * np.pi / abs(step)
    samples = round(per_turn)
    off = abs(per_turn - samples) * theta.size / max(samples, 1)
    uniform = samples >= 3 and theta.size % samples == 0 and off < 1e-9 * theta.size
    return samples if uniform else None


def _transformed(theta: Array, y: Array, n: NDArray[np.int64], per_turn: int) -> TurnSpectrum:
    mean = y.reshape(y.shape[0], -1, per_turn).mean(axis=1)
    spectrum = np.fft.rfft(mean, axis=1) * (2.0 / per_turn)
    # the transform counts samples from 0, rising; a turn may begin anywhere and run backwards
    falling = theta[1] < theta[0]
    coefficients = spectrum[:, n]
    coefficients = (np.conj(coefficients) if falling else coefficients) * np.exp(-1j * n * theta[0])
    fitted = np.zeros_like(spectrum)
    fitted[:, n] = spectrum[:, n]
    fitted[:, 0] = spectrum[:, 0]
    fit = np.fft.irfft(fitted * (0.5 * per_turn), per_turn, axis=1)
    residuals = y - np.tile(fit, (1, theta.size // per_turn))
    return TurnSpectrum(orders=n, coefficients=coefficients, residuals=residuals)


def _fitted(theta: Array, y: Array, n: NDArray[np.int64]) -> TurnSpectrum:
    # the largest share of a turn that may lie between two neighbouring samples
    widest_gap = 0.1
    # largest condition number of the normal equations at which harmonics are separable
    worst_condition = 1e6
    at = np.sort(np.mod(theta, 2.0 * np.pi))
    gap = float(np.max(np.diff(np.append(at, at[0] + 2.0 * np.pi))))
    if gap > widest_gap * 2.0 * np.pi:
        raise RecordError(
            f"the angles have a gap of {np.degrees(gap):.3g} degrees, at most "
            f"{360.0 * widest_gap:g} are allowed: measure a full turn, and give the angles in "
            "radians"
        )
    phase = np.multiply.outer(theta, n.astype(np.float64))
    X = np.hstack((np.ones((theta.size, 1)), np.cos(phase), -np.sin(phase)))
    if theta.size < X.shape[1]:
        raise RecordError(
            f"{n.size} orders and a mean need at least {X.shape[1]} samples, got {theta.size}"
        )
    normal = X.T @ X
    if np.linalg.cond(normal) > worst_condition:
        raise RecordError(
            "the angles do not separate the orders: fit fewer orders, or sample more uniformly"
        )
    inverse: Array = np.asarray(np.linalg.inv(normal), dtype=np.float64)
    solution, *_ = np.linalg.lstsq(X, y.T, rcond=None)
    real, imaginary = np.split(solution[1:], 2)
    return TurnSpectrum(
        orders=n,
        coefficients=(real + 1j * imaginary).T,
        residuals=y - (X @ solution).T,
        spread=inverse[1:, 1:],
    )


def code_faults(angle: ArrayLike, codes: ArrayLike, number: int) -> list[str]:
    """Return sentences on codes of a turn that were never read, or read at two places.

    Angles [rad] in any order, codes from 0 to `number` - 1. Nothing is said of fewer than four
    samples for each code, between which a code could be missed.

    Validity
    --------
    Errors of the scale that change by less than two steps from a code to the next ones.

    Examples
    --------
    >>> t = 2.0 * np.pi * (np.arange(640) + 0.5) / 640
    >>> codes = np.floor(t / (2.0 * np.pi) * 64)
    >>> code_faults(t, np.where(codes == 17, 16, codes), 64)
    ['1 code of 64 is never read: 17']
    """
    # largest distance of the samples of one code [steps]
    widest = 4.0
    least_samples = 4
    theta, read = np.asarray(angle, dtype=np.float64), np.asarray(codes)
    read = np.mod(np.floor(read).astype(np.int64), number)
    counted = np.bincount(read, minlength=number)
    turns = max(1.0, float(np.ptp(theta)) / _TURN)
    if read.size < least_samples * number * turns:
        return []
    # mean direction of the samples of each code, and their largest distance from it
    x, y = np.cos(theta), np.sin(theta)
    middle = np.arctan2(np.bincount(read, y, number), np.bincount(read, x, number))[read]
    off = np.abs(np.arctan2(np.sin(theta - middle), np.cos(theta - middle)))
    far = np.zeros(number)
    np.maximum.at(far, read, off)
    doubled = np.flatnonzero(far > 0.5 * widest * _TURN / number)
    return [
        f"{len(faulty)} code{'s' if len(faulty) > 1 else ''} of {number} "
        f"{'are' if len(faulty) > 1 else 'is'} {what}: {_first(faulty)}"
        for faulty, what in (
            (np.flatnonzero(counted == 0), "never read"),
            (doubled, "read at two places"),
        )
        if faulty.size
    ]


def _first(faulty: NDArray[np.int64]) -> str:
    most = 8
    listed = ", ".join(map(str, faulty[:most]))
    return f"{listed} and {faulty.size - most} more" if faulty.size > most else listed
