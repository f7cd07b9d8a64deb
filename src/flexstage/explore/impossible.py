"""Points that are no stage: why, and which bounds would leave them out."""

import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from flexstage.arrays import Array

# what differs between two sentences that say the same of two stages
_NUMBER = re.compile(r"[-+]?\d+(?:\.\d+)?(?:e[-+]?\d+)?", re.IGNORECASE)
#: Fewest impossible points from which a bound is worth naming.
_FEW = 3
#: How much more of the impossible points than of the others a cut takes away, to be named.
_WORTH = 0.5


@dataclass(frozen=True, slots=True, kw_only=True)
class Reason:
    """Why points are no stage."""

    count: int
    """Of how many points it is said."""
    text: str
    """The sentence, as it is said of the first of them."""


@dataclass(frozen=True, slots=True, kw_only=True)
class NarrowerBound:
    """A narrower bound of one variable, which leaves impossible points out."""

    variable: int
    """Place of the variable among those of the sweep."""
    bound: str
    """``low`` or ``high``."""
    value: float
    """The bound [SI]."""
    impossible: float
    """Share of the impossible points that it leaves out [1]."""
    possible: float
    """Share of the others that it leaves out [1]."""


def reasons(faults: Sequence[str]) -> tuple[Reason, ...]:
    """Return why points are no stage, the commonest reason first.

    Sentences that differ in their numbers alone are one reason.

    Examples
    --------
    >>> [found.count for found in reasons(["neck 0.1 mm too thin", "", "neck 0.2 mm too thin"])]
    [2]
    """
    said = [fault for fault in faults if fault]
    kinds = Counter(_NUMBER.sub("#", fault) for fault in said)
    first = {_NUMBER.sub("#", fault): fault for fault in reversed(said)}
    return tuple(Reason(count=n, text=first[kind]) for kind, n in kinds.most_common())


def best_cut(points: Array, faults: Sequence[str]) -> NarrowerBound | None:
    """Return the one bound that best tells impossible points from the others.

    That for which the share of impossible points that it leaves out, less that of the others, is
    largest (Youden 1950); None where no bound reaches a half.

    Examples
    --------
    >>> cut = best_cut(np.linspace(0.0, 1.0, 11)[:, None], ["no"] * 4 + [""] * 7)
    >>> cut.bound, cut.value, cut.impossible, cut.possible
    ('low', 0.4, 1.0, 0.0)
    """
    bad = np.array([bool(fault) for fault in faults])
    n, m = int(bad.sum()), int((~bad).sum())
    if n < _FEW or m == 0:
        return None
    best: tuple[float, NarrowerBound] | None = None
    for i, column in enumerate(points.T):
        values, at = np.unique(column, return_inverse=True)
        # shares below each value but the first, which a bound at that value leaves out
        gone = np.cumsum(np.bincount(at[bad], minlength=len(values)))[:-1] / n
        lost = np.cumsum(np.bincount(at[~bad], minlength=len(values)))[:-1] / m
        for bound, a, b, ends in (
            ("low", gone, lost, values[1:]),
            ("high", 1.0 - gone, 1.0 - lost, values[:-1]),
        ):
            if not len(ends):
                continue
            k = int(np.argmax(a - b))
            worth = float(a[k] - b[k])
            if worth >= _WORTH and (best is None or worth > best[0]):
                cut = NarrowerBound(
                    variable=i,
                    bound=bound,
                    value=float(ends[k]),
                    impossible=float(a[k]),
                    possible=float(b[k]),
                )
                best = worth, cut
    return None if best is None else best[1]
