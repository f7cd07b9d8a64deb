"""The uncertainty of a result from those of its influences, to first order, with its budget."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from flexstage.arrays import Array
from flexstage.errors import ModelError
from flexstage.estimate import Component, Estimate
from flexstage.measure.uncertainty.influence import (
    Correlations,
    Influence,
    correlation_matrix,
    groups,
)

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
        `flexstage.measure.uncertainty.expression`.
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
            f"influence '{name}' makes an uncertainty of {largest:.3g}, whose square is too large "
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
                "freedom: all of them take the least"
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
        known = hasattr(y, "x")
        c = [float(reporting.u_component(y, x)) if known else 0.0 for x in numbers]
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
