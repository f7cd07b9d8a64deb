"""A harmonic that stands in the scale, from several heads that see it one after the other."""

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from flexstage.centring.harmonic_fit import Harmonic, HarmonicFit
from flexstage.centring.polar import direction_estimate, length_estimate
from flexstage.estimate import Component, Estimate


def scale_harmonic(
    fits: Sequence[HarmonicFit], angles: NDArray[np.float64], order: int
) -> Harmonic:
    """Return the mean of the harmonics of several heads, over the angle in the scale.

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
    unit = fits[0].unit

    def part(i: int) -> Estimate:
        own = Component(
            name="noise", uncertainty=math.sqrt(covariance[i, i]), degrees_of_freedom=freedom
        )
        return Estimate(value=float(mean[i]), unit=unit, components=(own,))

    return Harmonic(
        order=order,
        cosine=part(0),
        sine=part(1),
        amplitude=length_estimate(mean, covariance, unit, degrees_of_freedom=freedom),
        phase=direction_estimate(mean, covariance, degrees_of_freedom=freedom),
        covariance=covariance,
    )
