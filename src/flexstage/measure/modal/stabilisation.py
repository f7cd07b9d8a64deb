"""Poles that matrix fractions of rising order find, and which stay where they are."""

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from flexstage.base.arrays import Array, Complex
from flexstage.base.errors import ModelError, RecordError
from flexstage.measure.modal.prepare import deviations
from flexstage.measure.spectra.response import MeasuredResponse

# share of the unit circle that the band covers: its ends stay apart, so that what lies beyond one
# end does not look as if it came after the other
_SHARE = 0.9
# poles with more damping than this belong to the slope of a response rather than to a mode
_MOST_DAMPING = 0.7
_HIGHEST_ORDER = 40


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
    use only the band [Hz], mapped to the unit circle; real ones use all frequencies from 0 to its
    end, mapped to half of it with the negative ones on the other half, and their poles are those
    above the frequency 0.
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
    by_order = []
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
        by_order.append(np.sort_complex(poles + 2j * math.pi * origin))
    return tuple(by_order)


def _moments(
    part: WeightedLines, origin: float, step: float, top: int, real: bool
) -> tuple[Any, Any]:
    """Return sum Y^H W Y over outputs, and L^-1 X^H W Y of each, where L L^H = X^H W X.

    With negative frequencies in addition to the positive ones, all sums are real.

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
                f"the weighted lines of the band do not separate powers of order {top}: lower the "
                "order, or widen the band"
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


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class OrderPoles:
    """The poles of one order that may be physical: decaying, and in the band."""

    order: int
    """The order of the polynomials."""
    poles: Complex
    """Poles, rising in frequency [rad/s], shape (p,)."""
    stable_frequency: NDArray[np.bool_]
    """Whether the order before has a pole within the criterion of frequency, shape (p,)."""
    stable_damping: NDArray[np.bool_]
    """Whether a pole within the criterion of frequency agrees in damping as well, shape (p,)."""

    @property
    def frequency_hz(self) -> Array:
        """Undamped natural frequencies [Hz]."""
        return np.abs(self.poles) / (2.0 * math.pi)

    @property
    def damping_ratio(self) -> Array:
        """Damping ratios [1]."""
        return -self.poles.real / np.abs(self.poles)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Stabilisation:
    """A stabilisation diagram, and the poles that were chosen in it."""

    orders: tuple[OrderPoles, ...]
    """The poles of each order."""
    band: tuple[float, float]
    """Ends of the band [Hz]."""
    poles: Complex
    """Chosen poles, one for each cluster, rising in frequency [rad/s], shape (p,)."""
    persistence: Array
    """The share of the orders, from where a cluster begins, that it is found in [1], shape (p,)."""
    frequency_tolerance: float
    """Relative criterion of frequency [1]."""
    damping_tolerance: float
    """Relative criterion of damping [1]."""

    @property
    def frequency_hz(self) -> Array:
        """Undamped natural frequencies of the chosen poles [Hz]."""
        return np.abs(self.poles) / (2.0 * math.pi)

    @property
    def damping_ratio(self) -> Array:
        """Damping ratios of the chosen poles [1]."""
        return -self.poles.real / np.abs(self.poles)


def stable_poles(
    response: MeasuredResponse,
    *,
    band: tuple[float, float] | None = None,
    orders: Sequence[int] | None = None,
    frequency_tolerance: float = 0.01,
    damping_tolerance: float = 0.05,
    coefficients: Literal["complex", "real"] = "complex",
) -> Stabilisation:
    """Find the poles of a frequency response, and those that stay as the order rises.

    The estimator is the poly-reference least-squares complex frequency one (Guillaume, Verboven,
    Vanlanduit, Van der Auweraer and Peeters, 2003, IMAC XXI), in which each line counts by the
    inverse of its variance where that is known. A pole is stable if the next lower order has one
    within the tolerances. Poles are chosen so: stable poles of all orders are joined to clusters in
    which each has a neighbour within the tolerance of frequency, and within three times that of
    damping; clusters found in at least half of the orders from their first on count, if they hold
    three orders or more, and the pole of each is the median of its members.

    Parameters
    ----------
    response : MeasuredResponse
        The response.
    band : tuple of float, optional
        Ends of the band [Hz]; all frequencies above 0 where not given.
    orders : sequence of int, optional
        Orders of the polynomials, rising: with complex coefficients and one input, each gives one
        pole; 2 to 40 where not given, or fewer with few lines.
    frequency_tolerance : float
        Relative criterion of stability for the frequency [1].
    damping_tolerance : float
        Relative criterion of stability for the damping ratio [1].
    coefficients : {"complex", "real"}
        Complex ones see the band alone; real ones all frequencies from 0 on, and half of their
        poles are the conjugates of the others.

    Returns
    -------
    Stabilisation
        The poles of each order, and the chosen ones.

    Validity
    --------
    Linear and time-invariant; damping ratios below 0.7. With noise and no variance, damping comes
    out too small for weakly excited modes: `fit_modes` refines it. A chosen pole may yet be of the
    noise: `fit_modes` tests it.

    Raises
    ------
    RecordError
        Too few lines are in the band, or a variance is impossible.
    ModelError
        The orders are not rising and positive, or too high for the lines there are.

    Examples
    --------
    >>> f = np.arange(1.0, 200.0, 0.25)
    >>> s, pole = 2j * np.pi * f, -4.7 + 541.0j
    >>> h = (0.3 / (s - pole) + 0.3 / (s - pole.conjugate()))[:, None, None]
    >>> found = stable_poles(MeasuredResponse(
    ...     frequency_hz=f, response=h, inputs=("force",), outputs=("motion",)))
    >>> round(float(found.frequency_hz[0]), 3), round(float(found.damping_ratio[0]), 5)
    (86.106, 0.00869)
    """
    part = response if band is None else response.between(*band)
    if part.frequency_hz[0] == 0.0:
        part = part.between(float(part.frequency_hz[1]), float(part.frequency_hz[-1]))
    f = part.frequency_hz
    if f.size < 8:
        raise RecordError(
            f"poles need at least 8 lines above 0 Hz in the band, got {f.size}: widen the band, or "
            "use longer segments"
        )
    weight = np.ones((f.size, len(part.outputs)))
    deviation = deviations(part)
    if deviation is not None:
        weight = 1.0 / np.mean(deviation**2, axis=2)
        weight /= weight.mean()
    lines = [WeightedLines(frequency_hz=f, response=part.response, weight=weight)]
    return stabilised(
        lines,
        orders=orders,
        band=(float(f[0]), float(f[-1])),
        tolerances=(frequency_tolerance, damping_tolerance),
        coefficients=coefficients,
    )


def stabilised(
    lines: Sequence[WeightedLines],
    *,
    band: tuple[float, float],
    orders: Sequence[int] | None = None,
    tolerances: tuple[float, float] = (0.01, 0.05),
    coefficients: Literal["complex", "real"] = "complex",
) -> Stabilisation:
    """Find stable poles of several sets of lines together.

    All have the same number of inputs; the tolerances are those of frequency and damping [1].
    """
    if orders is None:
        fewest = min(part.frequency_hz.size for part in lines)
        orders = range(2, max(4, min(_HIGHEST_ORDER, fewest // 3)) + 1)
    ladder = [int(order) for order in orders]
    if not ladder or ladder[0] < 1 or any(b <= a for a, b in itertools.pairwise(ladder)):
        raise ModelError(f"orders must be positive and rise, got {ladder}")
    all_poles = poles_by_order(lines, ladder, band, coefficients)
    by_order: list[OrderPoles] = []
    for order, poles in zip(ladder, all_poles, strict=True):
        size = np.abs(poles)
        physical = (
            (poles.real < 0.0)
            & (poles.imag > 0.0)
            & (-poles.real < _MOST_DAMPING * size)
            & (size >= 2.0 * math.pi * band[0])
            & (size <= 2.0 * math.pi * band[1])
        )
        selected = poles[physical]
        selected = selected[np.argsort(np.abs(selected), kind="stable")]
        before = by_order[-1].poles if by_order else selected[:0]
        by_order.append(_compared(order, selected, before, tolerances))
    poles, persistence = _clusters(by_order, tolerances)
    return Stabilisation(
        orders=tuple(by_order),
        band=band,
        poles=poles,
        persistence=persistence,
        frequency_tolerance=tolerances[0],
        damping_tolerance=tolerances[1],
    )


def _compared(
    order: int, poles: Complex, before: Complex, tolerances: tuple[float, float]
) -> OrderPoles:
    near = np.zeros(poles.size, dtype=bool)
    both = np.zeros(poles.size, dtype=bool)
    if before.size and poles.size:
        size, last = np.abs(poles), np.abs(before)
        damping, last_damping = -poles.real / size, -before.real / last
        close = np.abs(size[:, None] / last[None, :] - 1.0) <= tolerances[0]
        agree = np.abs(damping[:, None] / last_damping[None, :] - 1.0) <= tolerances[1]
        near = np.asarray(close.any(axis=1))
        both = np.asarray((close & agree).any(axis=1))
    return OrderPoles(order=order, poles=poles, stable_frequency=near, stable_damping=both)


def _clusters(
    by_order: Sequence[OrderPoles], tolerances: tuple[float, float]
) -> tuple[Complex, Array]:
    """Follow stable poles from order to order, each track taking the nearest of the next one."""
    tracks: list[list[tuple[int, complex]]] = []
    for step, entry in enumerate(by_order):
        free = list(entry.poles[entry.stable_damping])
        for track in tracks:
            if not free:
                break
            last = track[-1][1]
            distance = [_distance(pole, last, tolerances) for pole in free]
            nearest = int(np.argmin(distance))
            if distance[nearest] <= 1.0:
                track.append((step, free.pop(nearest)))
        tracks += [[(step, pole)] for pole in free]
    selected = []
    for track in tracks:
        share = len(track) / (len(by_order) - track[0][0])
        if len(track) >= 3 and share >= 0.5:
            members: Complex = np.array([pole for _, pole in track], dtype=np.complex128)
            selected.append((complex(np.median(members.real), np.median(members.imag)), share))
    selected.sort(key=lambda item: abs(item[0]))
    return (
        np.array([pole for pole, _ in selected], dtype=np.complex128),
        np.array([share for _, share in selected], dtype=np.float64),
    )


def _distance(pole: complex, other: complex, tolerances: tuple[float, float]) -> float:
    frequency = abs(abs(pole) / abs(other) - 1.0) / tolerances[0]
    ratio = (pole.real / abs(pole)) / (other.real / abs(other))
    return max(frequency, abs(ratio - 1.0) / (3.0 * tolerances[1]))
