"""Length and direction of a measured vector of two parts, with intervals that hold near zero."""

import math
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from flexstage.arrays import Array
from flexstage.estimate import Estimate


def length_estimate(
    vector: ArrayLike,
    covariance: ArrayLike,
    unit: str,
    *,
    degrees_of_freedom: float = math.inf,
) -> Estimate:
    r"""Return the length of a measured vector of two parts, with a 95 % interval.

    Its interval begins at 0 where the vector could as well be none.

    Noise makes a short vector longer: its length has Rice's distribution (Rice 1944, Bell System
    Technical Journal 23), and ``|v|^2 / u^2`` that of chi squared, not central, with 2 degrees of
    freedom and the parameter A^2 / u^2. The ends of the interval are the lengths A for which what
    was found is at the 2.5 % ends of it, averaged over the variances that are likely where u was
    itself estimated. Far from zero that is Student's interval.

    Validity
    --------
    Near zero, parts that are about equally uncertain: of others, the uncertainty along the vector
    is taken. The interval of a length of about zero holds it in 97.5 % of all cases.

    Examples
    --------
    >>> length = length_estimate((0.3e-6, -0.1e-6), 0.04e-12 * np.eye(2), "m")
    >>> low, high = length.interval()
    >>> print(f"{1e6 * length.value:.2f} um, {1e6 * low:.2f} to {1e6 * high:.2f} um")
    0.32 um, 0.00 to 0.66 um
    """
    # beyond this many standard uncertainties a length is as good as normal.
    far = 8.0
    v = np.asarray(vector, dtype=np.float64)
    cov = np.asarray(covariance, dtype=np.float64)
    length = math.hypot(v[0], v[1])
    # a vector that is none has no direction: the mean over all of them stands for it
    along = v / length if length > 0.0 else np.array([1.0, 1.0]) / math.sqrt(2.0)
    u = math.sqrt(max(float(along @ cov @ along), 0.0))
    bounds = None
    if u > 0.0 and length < far * u:
        bounds = _rice_interval(length, u, degrees_of_freedom)
    return Estimate.of(length, u, unit, degrees_of_freedom=degrees_of_freedom, bounds=bounds)


def direction_estimate(
    vector: ArrayLike,
    covariance: ArrayLike,
    *,
    degrees_of_freedom: float = math.inf,
) -> Estimate:
    r"""Return the direction of a measured vector of two parts, with a 95 % interval.

    It is from the first part towards the second [rad], between -pi and pi; the interval is the
    whole turn where the vector could as well be none.

    The part of the vector across its true direction is normal with mean 0, so that the direction is
    known to within ``arcsin(t u / |v|)``, with Student's t (the way of Fieller 1954, Journal of the
    Royal Statistical Society B 16, for the tangent).

    Validity
    --------
    Compare a direction with the interval modulo a turn. Of parts with unlike uncertainty, that
    across the measured direction is taken.

    Examples
    --------
    >>> phase = direction_estimate((3e-6, 4e-6), 0.01e-12 * np.eye(2))
    >>> print(f"{np.degrees(phase.value):.2f} +- {np.degrees(phase.expanded):.2f} deg")
    53.13 +- 2.25 deg
    """
    from dataclasses import replace

    v = np.asarray(vector, dtype=np.float64)
    cov = np.asarray(covariance, dtype=np.float64)
    length = math.hypot(v[0], v[1])
    value = math.atan2(v[1], v[0])
    if length == 0.0:
        u = math.pi / math.sqrt(3.0)
        bounds = (value - math.pi, value + math.pi)
        return Estimate.of(value, u, "rad", bounds=bounds)
    across = np.array([-v[1], v[0]]) / length
    u = math.sqrt(max(float(across @ cov @ across), 0.0)) / length
    # of a direction that is not known, that of equal chances all round
    known, freedom = min(u, math.pi / math.sqrt(3.0)), degrees_of_freedom
    plain = Estimate.of(value, known, "rad", degrees_of_freedom=freedom)
    half = Estimate.of(value, u, "rad", degrees_of_freedom=freedom).expanded
    reach = math.asin(half) if half < 1.0 else math.pi
    return replace(plain, bounds=(value - reach, value + reach)) if half > 0.1 else plain


def _rice_interval(length: float, u: float, dof: float) -> tuple[float, float]:
    likely = _likely_variances(dof)
    low = _root(lambda a: _share_below(length / u, a, likely) - 0.975, length / u)
    high = _root(lambda a: _share_below(length / u, a, likely) - 0.025, length / u)
    # where even none at all would give more, the interval would shrink to a point
    return u * low, u * max(high, 1.0)


def _likely_variances(dof: float) -> Array:
    """Return variances, all equally likely, where their estimate is 1."""
    from scipy.special import chdtri

    # parts of the distribution of a variance that a probability is averaged over.
    most_shares = 60

    if not math.isfinite(dof) or dof > 1e4:
        return np.ones(1)
    # the better it is known the fewer values stand for it
    shares = min(most_shares, max(8, math.ceil(1200.0 / dof)))
    return dof / np.asarray(chdtri(dof, (np.arange(shares) + 0.5) / shares))


def _share_below(found: float, a: float, variances: Array) -> float:
    """Return how often a length is less than what was found, where the true one is a."""
    from scipy.special import chdtr, chndtr

    square = found**2 / variances
    share = chndtr(square, 2.0, a * a / variances) if a > 0.0 else chdtr(2.0, square)
    return float(np.mean(share))


def _root(excess: Callable[[float], float], scale: float) -> float:
    """Return where a function that falls is zero, from 0 on; 0 where it begins below."""
    from scipy.optimize import brentq

    if excess(0.0) <= 0.0:
        return 0.0
    high = scale + 5.0
    while excess(high) > 0.0:
        high *= 2.0
    found: Any = brentq(excess, 0.0, high, xtol=1e-6)
    return float(found)
