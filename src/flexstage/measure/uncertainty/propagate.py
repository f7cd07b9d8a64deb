"""Influences of a result, and the uncertainty that they give it to first order, with its budget."""

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from flexstage.base.arrays import Array
from flexstage.base.choose import did_you_mean
from flexstage.base.errors import ModelError
from flexstage.quantities.estimate import Component, Estimate

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
        has_one_width = (self.uncertainty is None) != (self.half_width is None)
        has_distribution = self.distribution is None or self.distribution in DISTRIBUTIONS
        for fine, sentence in (
            (math.isfinite(self.value), f"the value must be finite, got {self.value!r}"),
            (has_one_width, "give its uncertainty or its half-width, one of the two"),
            (
                not has_one_width or 0.0 <= (size or 0.0) < math.inf,
                f"its uncertainty must be 0 or more and finite, got {size!r}",
            ),
            (
                self.degrees_of_freedom > 0.0,
                f"the degrees of freedom must be positive, got {self.degrees_of_freedom!r}",
            ),
            (self.kind in ("A", "B"), f"the kind must be A or B, got {self.kind!r}"),
            (
                has_distribution,
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
                f"top over base must be from 0 to 1, got {self.flat_share!r}",
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
        quantiles = _unit_quantile(self.law, generator.random(count), self.flat_share)
        return self.value + u / self._shape * quantiles


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
    >>> from flexstage.quantities.estimate import Component
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
            raise ModelError(f"two influences have the name '{name}': give each its own name")
    matrix = np.eye(len(names))
    pairs: set[frozenset[str]] = set()
    for pair, coefficient in correlations:
        for name in pair:
            if name not in names:
                hint = did_you_mean(name, names)
                raise ModelError(f"a correlation names '{name}', which is not an influence{hint}")
        if pair[0] == pair[1] or frozenset(pair) in pairs:
            raise ModelError(f"the correlation of {' and '.join(pair)} must be given once, of two")
        if not -1.0 <= coefficient <= 1.0:
            raise ModelError(f"a correlation coefficient must be from -1 to 1, got {coefficient!r}")
        pairs.add(frozenset(pair))
        i, j = map(names.index, pair)
        matrix[i, j] = matrix[j, i] = coefficient
    if matrix.size and float(np.linalg.eigvalsh(matrix)[0]) < -1e-9:
        raise ModelError("the correlations contradict one another: no quantities have all")
    return matrix


def groups(matrix: Array) -> tuple[tuple[int, ...], ...]:
    """Return the indices of influences that hang together by their correlations, group by group."""
    left = set(range(matrix.shape[0]))
    result = []
    while left:
        group, edge = set(), {min(left)}
        while edge:
            group |= edge
            edge = {int(j) for i in edge for j in np.flatnonzero(matrix[i])} - group
        left -= group
        result.append(tuple(sorted(group)))
    return tuple(result)


# its square, and a sum of some, is still a number
_LARGEST = 1e150


@dataclass(frozen=True, slots=True, kw_only=True)
class BudgetLine:
    """What one influence contributes to the uncertainty of a result."""

    name: str
    """Name of the influence."""
    value: float
    """Its value, in `unit`."""
    uncertainty: float
    """Its standard uncertainty, in `unit`."""
    unit: str
    """Its unit."""
    degrees_of_freedom: float
    """Those of its uncertainty."""
    distribution: str
    """Its distribution; "exact" of a constant."""
    kind: Literal["A", "B"]
    """Whether it was found from repeated observations (A) or otherwise (B)."""
    sensitivity: float
    """Change of the result with it: the partial derivative."""
    contribution: float
    """Size of sensitivity times uncertainty, in the unit of the result."""
    share: float
    """Part of the variance of the result [1], half of each covariance counted to either of its two:
    all lines sum to 1, and one may be negative.
    """
    source: str = ""
    """Where its figures come from."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Propagated:
    """A result with its uncertainty to first order, and the budget behind it."""

    estimate: Estimate
    """The result; influences that are correlated stand together as one contribution."""
    lines: tuple[BudgetLine, ...]
    """The budget, one line for each influence."""
    notes: tuple[str, ...] = ()
    """What a reader should know."""

    @property
    def value(self) -> float:
        """The result, in its unit."""
        return self.estimate.value

    @property
    def uncertainty(self) -> float:
        """Its combined standard uncertainty, in its unit."""
        return self.estimate.uncertainty

    @property
    def degrees_of_freedom(self) -> float:
        """Effective degrees of freedom of the uncertainty."""
        return self.estimate.degrees_of_freedom

    def interval(self, confidence: float = 0.95) -> tuple[float, float]:
        """Return the coverage interval, by Student's t at the effective degrees of freedom."""
        return self.estimate.interval(confidence)


def propagate(
    function: Callable[..., Any],
    influences: Sequence[Influence],
    correlations: Correlations | None = None,
    *,
    unit: str = "",
) -> Propagated:
    r"""Propagate uncertainties through a function to first order.

    .. math::

        u_c^2(y) = \sum_i\sum_j c_i c_j u_i u_j r_{ij},\quad c_i = \partial f/\partial x_i

    (JCGM 100:2008, equation 16), with effective degrees of freedom by Welch and Satterthwaite
    (G.2b there). Derivatives and sums are GTC's (B. D. Hall, Measurement Standards Laboratory of
    New Zealand), exact to rounding.

    Parameters
    ----------
    function : callable
        The result from the influences, in their order; made of arithmetic and of the functions of
        `flexstage.measure.uncertainty.budget_file`.
    influences : sequence of Influence
        What it depends on.
    correlations : Mapping, optional
        Correlation coefficients by the names of two influences.
    unit : str
        Unit of the result.

    Returns
    -------
    Propagated
        Result and budget.

    Raises
    ------
    ModelError
        There is no influence, the correlations are impossible, or the function has no finite value
        or derivative there.

    Notes
    -----
    Validity: first order. Where the function curves over the uncertainty of an influence, as a
    cosine does about 0, `monte_carlo` tells how far it is off. Correlated influences with finite
    degrees of freedom count as observed together; where those differ, all of a group take the
    least.

    Examples
    --------
    >>> length = Influence(name="l", value=63e-6, uncertainty=3e-9, degrees_of_freedom=9, kind="A")
    >>> gain = Influence(name="c", value=0.0, uncertainty=6.349e-5)
    >>> found = propagate(lambda l, c: l * (1 + c), (length, gain), unit="m")
    >>> print(f"{found.uncertainty:.1e} m, {found.degrees_of_freedom:.0f} degrees of freedom")
    5.0e-09 m, 69 degrees of freedom
    """
    if not influences:
        raise ModelError("a result needs at least one influence, got none")
    matrix = correlation_matrix(influences, (correlations or {}).items())
    value, c = _derivatives(function, influences)
    parts = c * np.array([i.standard_uncertainty for i in influences])
    largest = float(np.abs(parts).max())
    if largest > _LARGEST:
        name = influences[int(np.argmax(np.abs(parts)))].name
        raise ModelError(
            f"influence '{name}' gives an uncertainty of {largest:.3g}, whose square is too large "
            f"for a number (at most {_LARGEST:g} may be squared): use larger units"
        )
    covariances = parts[:, None] * matrix * parts[None, :]
    variance = max(float(covariances.sum()), 0.0)
    shares = covariances.sum(axis=1) / variance if variance > 0.0 else np.zeros_like(c)
    components, notes = [], []
    for group in groups(matrix):
        members = [influences[k] for k in group]
        components.append(_component(members, covariances[np.ix_(group, group)]))
        if len({m.degrees_of_freedom for m in members}) > 1:
            notes.append(
                f"{' and '.join(m.name for m in members)} are correlated and differ in degrees of "
                "freedom: the smallest is used for all"
            )
    lines = (
        _line(*row) for row in zip(influences, c.tolist(), parts.tolist(), shares, strict=True)
    )
    return Propagated(
        estimate=Estimate(value=value, unit=unit, components=tuple(components)),
        lines=tuple(lines),
        notes=tuple(notes),
    )


def _derivatives(
    function: Callable[..., Any], influences: Sequence[Influence]
) -> tuple[float, Array]:
    """Value of a function, and its derivatives by GTC."""
    from GTC import reporting, ureal

    # with an uncertainty of 1 each component is the derivative, even of what is exactly known; its
    # own sums would lose that, and refuse what is correlated and differs in degrees of freedom, has
    # fewer than one, or is exact
    numbers: list[Any] = [ureal(i.value, 1.0) for i in influences]
    try:
        y: Any = function(*numbers)
        value = float(getattr(y, "x", y))
        is_uncertain = hasattr(y, "x")
        c = [float(reporting.u_component(y, x)) if is_uncertain else 0.0 for x in numbers]
    except (ArithmeticError, ValueError, TypeError, RuntimeError) as error:
        raise ModelError(
            f"the result has no value or no derivative at the estimates of its influences: {error}"
        ) from error
    if not (math.isfinite(value) and np.isfinite(c).all()):
        raise ModelError("the result, or its derivative, is not finite at the estimates")
    # a sensitivity of -0 would be printed as such
    return value, np.array(c) + 0.0


def _component(members: Sequence[Influence], covariances: Array) -> Component:
    # correlated estimates are one group of simultaneous observations, with one count of them
    return Component(
        name=", ".join(m.name for m in members),
        uncertainty=math.sqrt(max(float(covariances.sum()), 0.0)),
        degrees_of_freedom=min(m.degrees_of_freedom for m in members),
        kind="A" if any(m.kind == "A" for m in members) else "B",
    )


def _line(influence: Influence, sensitivity: float, part: float, share: float) -> BudgetLine:
    return BudgetLine(
        name=influence.name,
        value=influence.value,
        uncertainty=influence.standard_uncertainty,
        unit=influence.unit,
        degrees_of_freedom=influence.degrees_of_freedom,
        distribution=influence.law if influence.standard_uncertainty > 0.0 else "exact",
        kind=influence.kind,
        sensitivity=sensitivity,
        contribution=abs(part),
        share=float(share),
        source=influence.source,
    )
