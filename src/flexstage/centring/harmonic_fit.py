"""Harmonics of a record over the turn: what was fitted, with its uncertainty."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from flexstage.arrays import Array
from flexstage.centring.normal_equations import evaluated
from flexstage.centring.outliers import Outlier
from flexstage.errors import RecordError
from flexstage.estimate import Estimate

_TURN = 2.0 * math.pi


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Harmonic:
    """One harmonic: a cos(n theta) + b sin(n theta) = A cos(n theta - phase)."""

    order: int
    """How often it repeats itself in a turn, n."""
    cosine: Estimate
    """a and b."""
    sine: Estimate
    """a and b."""
    amplitude: Estimate
    """A; near zero its interval is not symmetric."""
    phase: Estimate
    """From the cosine towards the sine [rad]."""
    covariance: Array
    """Of a and b, shape (2, 2)."""


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
        """Return offset and harmonics, without drift, at other angles."""
        turns = np.atleast_1d(np.asarray(angle, dtype=np.float64)) / _TURN
        parts = [p for h in self.harmonics for p in (h.cosine.value, h.sine.value)]
        c = np.array([self.offset.value, *parts])[:, None]
        return evaluated(turns, c, self.orders, drift=False)[:, 0]
