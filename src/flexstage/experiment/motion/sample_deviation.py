"""Standard deviation of repeated values, with the interval that chi-squared gives it."""

import math

import numpy as np
from numpy.typing import ArrayLike

from flexstage.errors import RecordError
from flexstage.estimate import Component, Estimate


def spread_estimate(
    values: ArrayLike, *, unit: str, degrees_of_freedom: int | None = None, note: str = ""
) -> Estimate:
    r"""Return the standard deviation of values that were repeated under the same conditions.

    With n values, (n - 1) s^2 / sigma^2 is distributed as chi-squared with n - 1 degrees of
    freedom, which gives the interval; the standard uncertainty of s is s / sqrt(2 (n - 1)) (JCGM
    100:2008, table E.1, approximately). Where degrees of freedom are given, the values are
    residuals, of any shape.

    Examples
    --------
    >>> s = spread_estimate([3.0, 5.0, 4.0, 8.0], unit="um")
    >>> print(f"{s.value:.2f}, {s.bounds[0]:.2f} to {s.bounds[1]:.2f}")
    2.16, 1.22 to 8.05
    """
    x = np.asarray(values, dtype=np.float64)
    freedom = x.size - 1 if degrees_of_freedom is None else degrees_of_freedom
    if freedom < 1 or not np.isfinite(x).all():
        raise RecordError(
            f"a standard deviation needs two finite values at least, got {x.size} values"
        )
    left = x - x.mean() if degrees_of_freedom is None else x
    s = math.sqrt(float(np.sum(left**2)) / freedom)
    from scipy.special import chdtri

    low, high = (s * math.sqrt(freedom / float(chdtri(freedom, p))) for p in (0.025, 0.975))
    part = Component(
        name="repeatability", uncertainty=s / math.sqrt(2.0 * freedom), degrees_of_freedom=freedom
    )
    return Estimate(value=s, unit=unit, components=(part,), bounds=(low, high), note=note)
