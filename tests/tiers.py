"""How much of the same thing `make slow` and `make evidence` do, and what a share may be then."""

from typing import Any

import pytest
from scipy.stats import binom


def sizes(*, slow: object, evidence: object) -> list[Any]:
    """One test body at two sizes: what a change must pass, and what a release must."""
    return [
        pytest.param(*_tuple(slow), marks=pytest.mark.slow, id="part"),
        pytest.param(*_tuple(evidence), marks=pytest.mark.evidence, id="full"),
    ]


def _tuple(values: object) -> tuple[object, ...]:
    return values if isinstance(values, tuple) else (values,)


def limits(
    count: int, low: float, high: float, *, full: int, share: float = 0.95
) -> tuple[float, float]:
    """What share of `count` intervals may hold the truth, where the true share is as stated.

    Of the full number, from low to high. Of fewer, what scatters more is allowed as well: what a
    binomial leaves out in 0.13 % of all cases on either side, as three standard deviations do.
    """
    if count >= full:
        return low, high
    least, most = binom.ppf([0.00135, 0.99865], count, share)
    # between two counts, so that it does not matter whether the limit itself is allowed
    return min(low, float(least - 0.5) / count), max(high, float(most + 0.5) / count)
