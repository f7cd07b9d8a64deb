"""Measured values with uncertainty, degrees of freedom and uncertainty components (GUM)."""

import math
from dataclasses import dataclass, replace
from typing import Literal

from flexstage.base.errors import ModelError


@dataclass(frozen=True, slots=True, kw_only=True)
class Component:
    """One contribution to the uncertainty of a value."""

    name: str
    """Source of the contribution."""
    uncertainty: float
    """Standard uncertainty of the value from this source, in the unit of the value."""
    degrees_of_freedom: float = math.inf
    """Degrees of freedom of a statistical estimate; infinite where it is given."""
    kind: Literal["A", "B"] = "A"
    """Type of evaluation: repeated observations (A) or other means (B), JCGM 100:2008, 4.2, 4.3."""

    def __post_init__(self) -> None:
        if not 0.0 <= self.uncertainty < math.inf:
            raise ModelError(
                f"the uncertainty from {self.name} must be 0 or more and finite, got "
                f"{self.uncertainty!r}"
            )
        if not self.degrees_of_freedom > 0.0:
            raise ModelError(
                f"the degrees of freedom of {self.name} must be positive, got "
                f"{self.degrees_of_freedom!r}"
            )


@dataclass(frozen=True, slots=True, kw_only=True)
class Estimate:
    """A measured value with its standard uncertainty.

    Examples
    --------
    >>> noise = Component(name="noise", uncertainty=3e-9, degrees_of_freedom=9)
    >>> length = Estimate(value=63e-6, unit="m", components=(noise,))
    >>> length = length.plus(Component(name="calibration", uncertainty=4e-9, kind="B"))
    >>> print(f"{length.uncertainty:.1e} m, {length.degrees_of_freedom:.0f} degrees of freedom")
    5.0e-09 m, 69 degrees of freedom
    """

    value: float
    """The value."""
    unit: str
    """Unit of the value and of its uncertainty."""
    components: tuple[Component, ...] = ()
    """Independent contributions to its uncertainty."""
    bounds: tuple[float, float] | None = None
    """Ends of its 95 % interval where that is not symmetric about the value, as for a standard
    deviation.
    """
    note: str = ""
    """Condition or remark that belongs to the value."""

    @classmethod
    def of(
        cls,
        value: float,
        uncertainty: float,
        unit: str,
        *,
        source: str = "noise",
        degrees_of_freedom: float = math.inf,
        bounds: tuple[float, float] | None = None,
        note: str = "",
    ) -> "Estimate":
        """Return a value with one uncertainty component of type A.

        Parameters
        ----------
        value, uncertainty : float
            The value and its standard uncertainty, in the unit.
        unit : str
            Their unit.
        source : str
            Source of the uncertainty.
        degrees_of_freedom : float
            Degrees of freedom of the uncertainty.
        bounds : tuple of float, optional
            Ends of its 95 % interval where that is not symmetric.
        note : str
            Condition or remark that belongs to the value.

        Returns
        -------
        Estimate
            The value.
        """
        part = Component(
            name=source, uncertainty=uncertainty, degrees_of_freedom=degrees_of_freedom
        )
        return cls(value=value, unit=unit, components=(part,), bounds=bounds, note=note)

    @classmethod
    def of_deviation(
        cls,
        value: float,
        degrees_of_freedom: float,
        unit: str,
        *,
        source: str = "finite record",
        note: str = "",
    ) -> "Estimate":
        r"""Return a standard deviation, with its bounds by chi-squared.

        Its standard uncertainty is s / sqrt(2 nu) (JCGM 100:2008, table E.1, approximately).

        Parameters
        ----------
        value : float
            The standard deviation s, in the unit.
        degrees_of_freedom : float
            Those of the variance, nu.
        unit : str
            Its unit.
        source : str
            Source of the uncertainty.
        note : str
            Condition or remark that belongs to the value.

        Returns
        -------
        Estimate
            The deviation.
        """
        return cls.of(
            value,
            value / math.sqrt(2.0 * degrees_of_freedom),
            unit,
            source=source,
            degrees_of_freedom=degrees_of_freedom,
            bounds=deviation_bounds(value, degrees_of_freedom),
            note=note,
        )

    @property
    def uncertainty(self) -> float:
        """Standard uncertainty: root of the sum of squares of the components."""
        return math.hypot(*(c.uncertainty for c in self.components))

    @property
    def degrees_of_freedom(self) -> float:
        """Effective degrees of freedom (Welch 1947, Satterthwaite 1946; JCGM 100:2008, G.2b)."""
        u = self.uncertainty
        if u == 0.0:
            return math.inf
        terms = sum((c.uncertainty / u) ** 4 / c.degrees_of_freedom for c in self.components)
        return math.inf if terms == 0.0 else 1.0 / terms

    @property
    def coverage_factor(self) -> float:
        """Factor from standard to expanded uncertainty at 95 %, of Student's t distribution."""
        return _student(self.degrees_of_freedom, 0.95)

    @property
    def expanded(self) -> float:
        """Expanded uncertainty at 95 %: half the width of the interval."""
        low, high = self.interval()
        return 0.5 * (high - low)

    def interval(self, confidence: float = 0.95) -> tuple[float, float]:
        """Return the interval that contains the true value with a given confidence.

        Parameters
        ----------
        confidence : float
            The confidence [1]; `bounds` hold for 0.95 alone.

        Returns
        -------
        tuple of float
            Ends of the interval, in the unit of the value.

        Raises
        ------
        ModelError
            The confidence is not between 0 and 1, or not 0.95 where there are bounds.
        """
        if not 0.0 < confidence < 1.0:
            raise ModelError(f"a confidence must lie between 0 and 1, got {confidence!r}")
        if self.bounds is not None:
            if confidence != 0.95:
                raise ModelError("the interval of this value is known at 0.95 only")
            return self.bounds
        half = _student(self.degrees_of_freedom, confidence) * self.uncertainty
        return self.value - half, self.value + half

    def covers(self, truth: float) -> bool:
        """Return whether the 95 % interval contains a value.

        Parameters
        ----------
        truth : float
            The value.

        Returns
        -------
        bool
            True if it does.
        """
        low, high = self.interval()
        return low <= truth <= high

    def plus(self, *components: Component) -> "Estimate":
        """Return the same value with further independent components of its uncertainty.

        Bounds, if any, move outwards so that the squares of their distances from the value add.

        Parameters
        ----------
        *components : Component
            The further components.

        Returns
        -------
        Estimate
            The value with all components.
        """
        estimate = replace(self, components=(*self.components, *components), bounds=None)
        if self.bounds is None:
            return estimate
        further = replace(self, components=components, bounds=None).expanded if components else 0.0
        low, high = (abs(end - self.value) for end in self.bounds)
        return replace(
            estimate,
            bounds=(
                self.value - math.hypot(low, further),
                self.value + math.hypot(high, further),
            ),
        )

    def times(self, factor: float, unit: str | None = None) -> "Estimate":
        """Return the value times an exact factor.

        Parameters
        ----------
        factor : float
            The factor.
        unit : str, optional
            Unit of the product; the same where not given.

        Returns
        -------
        Estimate
            The product, with all its components.
        """
        scaled = tuple(replace(c, uncertainty=abs(factor) * c.uncertainty) for c in self.components)
        ends = None
        if self.bounds is not None:
            a, b = sorted(factor * end for end in self.bounds)
            ends = (a, b)
        return replace(
            self,
            value=factor * self.value,
            unit=self.unit if unit is None else unit,
            components=scaled,
            bounds=ends,
        )


def deviation_bounds(value: float, degrees_of_freedom: float) -> tuple[float, float]:
    """Return the 95 % interval of a standard deviation by chi-squared.

    Examples
    --------
    >>> [round(end, 3) for end in deviation_bounds(1.0, 10.0)]
    [0.699, 1.755]
    """
    from scipy.special import gammaincinv

    half = 0.5 * degrees_of_freedom
    if not math.isfinite(half):
        return value, value
    high, low = (2.0 * float(gammaincinv(half, p)) for p in (0.025, 0.975))
    return (
        value * math.sqrt(degrees_of_freedom / low),
        value * math.sqrt(degrees_of_freedom / high) if high > 0.0 else math.inf,
    )


def _student(degrees_of_freedom: float, confidence: float) -> float:
    from scipy.special import ndtri, stdtrit

    p = 0.5 + 0.5 * confidence
    return float(ndtri(p) if math.isinf(degrees_of_freedom) else stdtrit(degrees_of_freedom, p))
