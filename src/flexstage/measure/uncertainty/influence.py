"""Quantities that a result depends on: how well each is known, and how two are correlated."""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from flexstage.arrays import Array
from flexstage.choose import did_you_mean
from flexstage.errors import ModelError
from flexstage.estimate import Estimate

#: Distributions of an influence.
DISTRIBUTIONS: tuple[str, ...] = (
    "normal",
    "student",
    "uniform",
    "triangular",
    "arcsine",
    "trapezoidal",
)
_BOUNDED = DISTRIBUTIONS[2:]
#: Correlation coefficient by the names of two influences.
Correlations = Mapping[tuple[str, str], float]


@dataclass(frozen=True, slots=True, kw_only=True)
class Influence:
    """A quantity that a result depends on.

    Its standard uncertainty is given, or the half-width a of the interval that it lies in: then u =
    a/sqrt(3) where it is uniform, a/sqrt(6) triangular, a/sqrt(2) arcsine (as of a sinusoidal
    cycle), a sqrt((1 + b^2)/6) trapezoidal with the top b times as wide as the base (JCGM 100:2008,
    4.3.7 to 4.3.9). Exactly one of `uncertainty` and `half_width` is given.

    Notes
    -----
    Validity: a Monte Carlo run draws a bounded distribution with ends that are exactly known:
    finite degrees of freedom of a half-width count in the first-order propagation alone.

    Examples
    --------
    >>> cycle = Influence(name="room", value=0.0, half_width=0.5, distribution="arcsine", unit="K")
    >>> round(cycle.standard_uncertainty, 4)
    0.3536
    """

    name: str
    """Its name."""
    value: float
    """Its best estimate, in `unit`."""
    uncertainty: float | None = None
    """Its standard uncertainty, in `unit`."""
    half_width: float | None = None
    """Half of the interval that it lies in, in `unit`; in place of the uncertainty."""
    distribution: str | None = None
    """One of `DISTRIBUTIONS`; where not given, ``uniform`` with a half-width, ``student`` with
    finite degrees of freedom of kind A, else ``normal``.
    """
    degrees_of_freedom: float = math.inf
    """How well the uncertainty itself is known: n - 1 of the mean of n observations; infinite where
    it is given.
    """
    unit: str = ""
    """Unit of value and uncertainty."""
    kind: Literal["A", "B"] = "B"
    """Whether it was found from repeated observations (A) or otherwise (B)."""
    flat_share: float = 0.5
    """Top over base of a trapezoid [1]."""
    source: str = ""
    """Where its figures come from."""

    def __post_init__(self) -> None:
        size = self.half_width if self.uncertainty is None else self.uncertainty
        given = (self.uncertainty is None) != (self.half_width is None)
        known = self.distribution is None or self.distribution in DISTRIBUTIONS
        for fine, sentence in (
            (math.isfinite(self.value), f"the value must be finite, got {self.value!r}"),
            (given, "give its uncertainty or its half-width, one of the two"),
            (
                not given or 0.0 <= (size or 0.0) < math.inf,
                f"its uncertainty must be 0 or more and finite, got {size!r}",
            ),
            (
                self.degrees_of_freedom > 0.0,
                f"the degrees of freedom must be positive, got {self.degrees_of_freedom!r}",
            ),
            (self.kind in ("A", "B"), f"the kind must be A or B, got {self.kind!r}"),
            (
                known,
                f"unknown distribution '{self.distribution}': expected one of "
                f"{', '.join(DISTRIBUTIONS)}",
            ),
            (
                self.half_width is None or self.law in _BOUNDED,
                f"a {self.law} distribution has no half-width: give its uncertainty",
            ),
            (
                self.law != "student" or math.isfinite(self.degrees_of_freedom),
                "a Student distribution needs degrees of freedom",
            ),
            (
                0.0 <= self.flat_share <= 1.0,
                f"top over base lies from 0 to 1, got {self.flat_share!r}",
            ),
        ):
            if not fine:
                raise ModelError(f"influence '{self.name}': {sentence}")

    @property
    def law(self) -> str:
        """Its distribution, with what stands where none is given."""
        if self.distribution is not None:
            return self.distribution
        if self.half_width is not None:
            return "uniform"
        repeated = self.kind == "A" and math.isfinite(self.degrees_of_freedom)
        return "student" if repeated else "normal"

    @property
    def standard_uncertainty(self) -> float:
        """Standard uncertainty, in `unit`."""
        if self.uncertainty is not None:
            return self.uncertainty
        return (self.half_width or 0.0) * self._shape

    @property
    def _shape(self) -> float:
        """Standard deviation of the distribution over its half-width [1]."""
        if self.law == "trapezoidal":
            return math.sqrt((1.0 + self.flat_share**2) / 6.0)
        return {"uniform": 1 / math.sqrt(3), "triangular": 1 / math.sqrt(6)}.get(
            self.law, math.sqrt(0.5)
        )

    def draw(self, generator: np.random.Generator, count: int) -> Array:
        """Draw values at random."""
        u = self.standard_uncertainty
        if self.law == "normal":
            return self.value + u * generator.standard_normal(count)
        if self.law == "student":
            # of a mean: its scale, and not its standard deviation, is u (JCGM 101:2008, 6.4.9)
            return self.value + u * generator.standard_t(self.degrees_of_freedom, count)
        drawn = _unit_quantile(self.law, generator.random(count), self.flat_share)
        return self.value + u / self._shape * drawn


def _unit_quantile(law: str, p: Array, flat: float) -> Array:
    """Quantile of a symmetric distribution on -1 to 1."""
    if law == "uniform":
        return 2.0 * p - 1.0
    if law == "arcsine":
        return -np.cos(np.pi * p)
    top = flat if law == "trapezoidal" else 0.0
    # the lower half; the upper one mirrors it
    low = np.minimum(p, 1.0 - p)
    ramp = np.sqrt(2.0 * low * (1.0 - top**2)) - 1.0
    level = (1.0 + top) * low - 0.5 * (1.0 + top)
    x = np.where(low < 0.5 * (1.0 - top) / (1.0 + top), ramp, level)
    return np.where(p < 0.5, x, -x)


def influence_from(estimate: Estimate, name: str) -> Influence:
    """Return a measured value as an influence on another one.

    It is of kind A if one of the contributions is.

    Examples
    --------
    >>> from flexstage.estimate import Component
    >>> noise = Component(name="noise", uncertainty=2e-9, degrees_of_freedom=7)
    >>> influence_from(Estimate(value=3e-6, unit="m", components=(noise,)), "step").law
    'student'
    """
    return Influence(
        name=name,
        value=estimate.value,
        uncertainty=estimate.uncertainty,
        degrees_of_freedom=estimate.degrees_of_freedom,
        unit=estimate.unit,
        kind="A" if any(c.kind == "A" for c in estimate.components) else "B",
    )


def correlation_matrix(
    influences: Sequence[Influence], correlations: Iterable[tuple[tuple[str, str], float]] = ()
) -> Array:
    """Return the correlation matrix of influences.

    Coefficients are given with the names of two influences; those of all other pairs are 0.

    Examples
    --------
    >>> a, b = (Influence(name=n, value=1.0, uncertainty=0.1) for n in "ab")
    >>> float(correlation_matrix((a, b), [(("a", "b"), 0.25)])[1, 0])
    0.25
    """
    names = [i.name for i in influences]
    for name in names:
        if names.count(name) > 1:
            raise ModelError(f"two influences are called '{name}': give each its own name")
    matrix = np.eye(len(names))
    seen: set[frozenset[str]] = set()
    for pair, coefficient in correlations:
        for name in pair:
            if name not in names:
                hint = did_you_mean(name, names)
                raise ModelError(f"a correlation names '{name}', which is no influence{hint}")
        if pair[0] == pair[1] or frozenset(pair) in seen:
            raise ModelError(f"the correlation of {' and '.join(pair)} must be given once, of two")
        if not -1.0 <= coefficient <= 1.0:
            raise ModelError(f"a correlation coefficient lies from -1 to 1, got {coefficient!r}")
        seen.add(frozenset(pair))
        i, j = map(names.index, pair)
        matrix[i, j] = matrix[j, i] = coefficient
    if matrix.size and float(np.linalg.eigvalsh(matrix)[0]) < -1e-9:
        raise ModelError("the correlations contradict one another: no quantities have all")
    return matrix


def groups(matrix: Array) -> tuple[tuple[int, ...], ...]:
    """Return the indices of influences that hang together by their correlations, group by group."""
    left = set(range(matrix.shape[0]))
    found = []
    while left:
        group, edge = set(), {min(left)}
        while edge:
            group |= edge
            edge = {int(j) for i in edge for j in np.flatnonzero(matrix[i])} - group
        left -= group
        found.append(tuple(sorted(group)))
    return tuple(found)
