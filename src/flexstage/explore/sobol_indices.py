"""Which variable a figure varies with: Sobol' indices, first order and total, with intervals."""

from dataclasses import dataclass

import numpy as np

from flexstage.arrays import Array
from flexstage.errors import ModelError
from flexstage.explore.figures import ROUNDING

#: Largest share of base samples that may hold an impossible stage.
LARGEST_SHARE_LEFT_OUT = 0.05
#: Fewest base samples that intervals are estimated from.
FEWEST = 16


@dataclass(frozen=True, slots=True, kw_only=True)
class SobolIndices:
    """Shares of the variance of figures over a box of variables that are independent and uniform.

    Arrays have a row for each figure and a column for each variable (F, d); NaN in the row of a
    figure that does not vary.
    """

    first: Array
    """Share that varying the variable alone explains, first order."""
    first_low: Array
    """Lower end of its interval."""
    first_high: Array
    """Upper end of its interval."""
    total: Array
    """Share in which the variable has a part, alone or together with others."""
    total_low: Array
    """Lower end of its interval."""
    total_high: Array
    """Upper end of its interval."""
    samples: int
    """Base samples N that the estimate is made of; N (d + 2) stages."""
    left_out: int
    """Base samples that were left out, as one of their stages is impossible."""
    confidence: float
    """Coverage of the intervals."""


def sobol_indices(
    values: Array, seed: int = 0, *, confidence: float = 0.95, resamples: int = 1000
) -> SobolIndices:
    r"""Estimate Sobol' indices from the values at `flexstage.explore.saltelli_points`.

    With :math:`f` less its mean, :math:`V` its variance over all :math:`a` and :math:`b`,

    .. math::

        S_i = \frac{1}{N V} \sum_j f(b_j) \left(f(ab^{(i)}_j) - f(a_j)\right), \qquad
        S_{Ti} = \frac{1}{2 N V} \sum_j \left(f(a_j) - f(ab^{(i)}_j)\right)^2

    (Saltelli, Annoni, Azzini, Campolongo, Ratto and Tarantola 2010, table 2, b and f; the latter is
    Jansen's). Intervals are those between quantiles of the same from base samples drawn with
    replacement (Archer, Saltelli and Sobol' 1997).

    Parameters
    ----------
    values : Array
        Figures (N, d + 2, F) at a, b, and a with the i-th coordinate of b; NaN where impossible.
    seed : int
        Seed of the resampling.
    confidence : float
        Coverage of the intervals.
    resamples : int
        How often the base samples are drawn again.

    Returns
    -------
    SobolIndices
        The indices.

    Validity
    --------
    Variables are independent and uniform over their bounds. Both estimates are free of bias but for
    the division by an estimated variance. The points of a Sobol' sequence lie more evenly than
    independent ones, for which the resampling stands: of smooth functions the intervals are wider
    than they need be. A base sample with an impossible stage is left out, up to 5 % of them, and
    the shares are then those over what is left, where variables are no longer quite independent.

    Raises
    ------
    ModelError
        Too many stages are impossible, or fewer than 16 base samples are left.

    Examples
    --------
    Of the sum of one variable and the double of another, 1/5 and 4/5:

    >>> from flexstage.explore.sampling import saltelli_points
    >>> points = saltelli_points(np.zeros(2), np.ones(2), 1024, seed=1)
    >>> found = sobol_indices((points @ [[1.0], [2.0]]).reshape(1024, 4, 1), seed=1)
    >>> found.first.round(3).tolist(), found.total.round(3).tolist()
    ([[0.2, 0.8]], [[0.2, 0.8]])
    """
    possible = np.isfinite(values).all(axis=(1, 2))
    asked, kept = len(values), int(possible.sum())
    if asked - kept > LARGEST_SHARE_LEFT_OUT * asked:
        raise ModelError(
            f"{asked - kept} of {asked} base samples hold an impossible stage, more than the "
            f"{100.0 * LARGEST_SHARE_LEFT_OUT:g} % that may be left out: Sobol' indices need "
            "bounds between which nearly every stage is possible"
        )
    if kept < FEWEST:
        raise ModelError(
            f"Sobol' indices need {FEWEST} base samples or more, got {kept}: ask for more samples"
        )
    f = values[possible]
    f = f - f[:, :2].mean(axis=(0, 1))
    one = np.ones((1, kept))
    first, total = (part[0] for part in _estimates(f, one))
    counts = np.random.default_rng(seed).multinomial(kept, np.full(kept, 1.0 / kept), resamples)
    drawn = _estimates(f, counts.astype(float))
    ends = [0.5 * (1.0 - confidence), 0.5 * (1.0 + confidence)]
    (first_low, first_high), (total_low, total_high) = (
        np.quantile(part, ends, axis=0) for part in drawn
    )
    size = np.abs(values[possible]).max(axis=(0, 1))
    still = np.ptp(f[:, :2], axis=(0, 1)) <= ROUNDING * size
    for part in (first, first_low, first_high, total, total_low, total_high):
        part[still] = np.nan
    return SobolIndices(
        first=first,
        first_low=first_low,
        first_high=first_high,
        total=total,
        total_low=total_low,
        total_high=total_high,
        samples=kept,
        left_out=asked - kept,
        confidence=confidence,
    )


def _estimates(f: Array, counts: Array) -> tuple[Array, Array]:
    """Return both indices (R, F, d) of samples (N, d + 2, F), each taken so many times (R, N)."""
    n, rest, figures = f.shape
    a, b, ab = f[:, 0], f[:, 1], f[:, 2:]
    shape = (len(counts), rest - 2, figures)

    def mean(x: Array) -> Array:
        return (counts @ x.reshape(n, -1)) / n

    middle = 0.5 * (mean(a) + mean(b))
    # no smaller than rounding: what does not vary is told apart by who calls
    variance = np.maximum(0.5 * (mean(a * a) + mean(b * b)) - middle**2, np.finfo(float).tiny)
    first = mean(b[:, None] * (ab - a[:, None])).reshape(shape) / variance[:, None]
    total = 0.5 * mean((a[:, None] - ab) ** 2).reshape(shape) / variance[:, None]
    return first.swapaxes(1, 2), total.swapaxes(1, 2)
