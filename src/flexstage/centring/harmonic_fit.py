"""Harmonics over the turn as they were fitted, of one head or of several, with uncertainty."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from flexstage.arrays import Array
from flexstage.centring.normal_equations import evaluated
from flexstage.centring.outliers import Outlier
from flexstage.centring.vector_interval import direction_estimate, length_estimate
from flexstage.errors import RecordError
from flexstage.estimate import Estimate

_TURN = 2.0 * math.pi


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Harmonic:
    """One harmonic: a cos(n theta) + b sin(n theta) = A cos(n theta - phase)."""

    order: int
    """How often it repeats itself in a turn, n."""
    cosine: Estimate
    """Amplitude a of the cosine."""
    sine: Estimate
    """Amplitude b of the sine."""
    amplitude: Estimate
    """A; near zero its interval is not symmetric."""
    phase: Estimate
    """From the cosine towards the sine [rad]."""
    covariance: Array
    """Of a and b, shape (2, 2)."""

    def less(self, earlier: "Harmonic") -> "Harmonic":
        """Return how it differs from the same harmonic of an earlier record."""

        def part(own: Estimate, other: Estimate) -> Estimate:
            before = (replace(c, name=f"{c.name}, before") for c in other.components)
            value = own.value - other.value
            return replace(own, value=value, components=(*own.components, *before))

        cosine, sine = part(self.cosine, earlier.cosine), part(self.sine, earlier.sine)
        freedom = min(self.cosine.degrees_of_freedom, earlier.cosine.degrees_of_freedom)
        return _harmonic(self.order, cosine, sine, self.covariance + earlier.covariance, freedom)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class HarmonicFit:
    """Harmonics of a record over the turn."""

    harmonics: tuple[Harmonic, ...]
    """In rising order."""
    offset: Estimate
    """The mean."""
    drift: Estimate | None
    """Change in a turn; None where it was not fitted."""
    covariance: Array
    """Of a and b of all harmonics, in that order, shape (2 k, 2 k)."""
    residual: Array
    """What is left of each sample, outliers too, shape (n,)."""
    residual_rms: float
    """Root of the mean square of what is left of the samples that were kept, for the number of
    those less that of the coefficients.
    """
    samples: int
    """Number of samples that were kept."""
    turns: float
    """How many turns they go over."""
    outliers: tuple[Outlier, ...]
    """Samples that were set aside."""
    noise: str
    """What the uncertainty rests on: residuals that do not know of each other, their spectrum, or
    how turns differ.
    """
    unit: str
    """Unit of the values."""
    notes: tuple[str, ...]
    """What a reader should know."""
    with_all: "HarmonicFit | None" = None
    """The fit of all samples where more than a hundredth of them were set aside; the covariance and
    the intervals then cover both.
    """

    @property
    def orders(self) -> tuple[int, ...]:
        """Orders of the harmonics."""
        return tuple(h.order for h in self.harmonics)

    def harmonic(self, order: int) -> Harmonic:
        """Return the harmonic of an order."""
        for found in self.harmonics:
            if found.order == order:
                return found
        raise RecordError(
            f"there is no harmonic of order {order}: those fitted are "
            f"{', '.join(map(str, self.orders)) or 'none'}"
        )

    def evaluate(self, angle: ArrayLike) -> Array:
        """Return offset and harmonics, without drift, at other angles [rad]."""
        turns = np.atleast_1d(np.asarray(angle, dtype=np.float64)) / _TURN
        parts = [p for h in self.harmonics for p in (h.cosine.value, h.sine.value)]
        c = np.array([self.offset.value, *parts])[:, None]
        return evaluated(turns, c, self.orders, drift=False)[:, 0]


def scale_harmonic(
    fits: Sequence[HarmonicFit], angles: NDArray[np.float64], order: int
) -> Harmonic:
    """Return the mean of the harmonics of several heads, over the angle in the scale.

    The heads stand at `angles` [rad]; their harmonics are over the angle of the table.

    Each head at alpha sees the scale at theta + alpha: its harmonic is turned by n alpha.

    Validity
    --------
    Heads whose noise is their own. Motion of the axis and errors of the reference of that order are
    in it, less so the more heads there are.

    Examples
    --------
    >>> from flexstage.centring import fit_harmonics
    >>> theta = np.arange(50) * np.pi / 25
    >>> fits = [fit_harmonics(theta, np.cos(2.0 * (theta + a)), orders=3) for a in (0.3, 1.9)]
    >>> print(f"{scale_harmonic(fits, np.array([0.3, 1.9]), 2).cosine.value:.3f}")
    1.000
    """
    found = [f.harmonic(order) for f in fits]
    parts, covariances = [], []
    for h, alpha in zip(found, angles, strict=True):
        c, s = math.cos(order * alpha), math.sin(order * alpha)
        turn = np.array([[c, -s], [s, c]])
        parts.append(turn @ np.array([h.cosine.value, h.sine.value]))
        covariances.append(turn @ h.covariance @ turn.T)
    mean = np.mean(parts, axis=0)
    covariance = np.sum(covariances, axis=0) / len(parts) ** 2
    shares = np.array([float(np.trace(v)) for v in covariances])
    freedoms = np.array([h.cosine.degrees_of_freedom for h in found])
    total = float(shares.sum())
    freedom = float(total**2 / np.sum(shares**2 / freedoms)) if total > 0.0 else math.inf
    return harmonic_of(order, mean, covariance, freedom, fits[0].unit)


def harmonic_of(
    order: int, vector: Array, covariance: Array, freedom: float, unit: str
) -> Harmonic:
    """Return a harmonic from its a and b, which only noise makes uncertain."""

    def part(i: int) -> Estimate:
        u = math.sqrt(covariance[i, i])
        return Estimate.of(float(vector[i]), u, unit, degrees_of_freedom=freedom)

    return _harmonic(order, part(0), part(1), covariance, freedom)


def _harmonic(
    order: int, cosine: Estimate, sine: Estimate, covariance: Array, freedom: float
) -> Harmonic:
    vector, unit = (cosine.value, sine.value), cosine.unit
    return Harmonic(
        order=order,
        cosine=cosine,
        sine=sine,
        amplitude=length_estimate(vector, covariance, unit, degrees_of_freedom=freedom),
        phase=direction_estimate(vector, covariance, degrees_of_freedom=freedom),
        covariance=covariance,
    )
