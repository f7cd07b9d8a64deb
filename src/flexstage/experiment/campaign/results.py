"""What a set of tests gave."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from flexstage.characteristic import Characteristic, Characteristics
from flexstage.errors import ModelError
from flexstage.estimate import Estimate
from flexstage.experiment.campaign.plan import Campaign, Test
from flexstage.quantities import QUANTITIES
from flexstage.short_repr import short_repr


@dataclass(frozen=True, slots=True, kw_only=True)
class Figure:
    """One figure of a stage, from one test."""

    quantity: str
    """One of `flexstage.quantities.QUANTITIES`."""
    axis: str
    """The axis, or both, such as ``xy``."""
    estimate: Estimate
    """The value with its uncertainty and where that comes from."""
    test: str
    """Name of the test."""

    def __post_init__(self) -> None:
        known = QUANTITIES.get(self.quantity)
        unit = None if known is None else known.unit
        if unit != self.estimate.unit:
            raise ModelError(
                f"{self.quantity} is held in '{unit}', got an estimate in '{self.estimate.unit}'"
            )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TestResult:
    """What one test gave."""

    __test__ = False  # a name that the collector of tests would take for its own

    test: Test
    """The test."""
    figures: tuple[Figure, ...]
    """Its figures."""
    details: Mapping[str, Any] = field(default_factory=dict)
    """Curves and fits behind them, for drawing, by what they are."""
    notes: tuple[str, ...] = ()
    """What a reader should know."""

    __repr__ = short_repr


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Characterisation:
    """What all tests of a stage gave."""

    campaign: Campaign
    """The tests."""
    results: tuple[TestResult, ...]
    """What each gave, in the same order."""
    sources: Mapping[str, str] = field(default_factory=dict)
    """SHA-256 of each file that was read, by its name."""

    __repr__ = short_repr

    @property
    def figures(self) -> tuple[Figure, ...]:
        """One figure for each quantity and axis: that of the first test that gives it."""
        first: dict[tuple[str, str], Figure] = {}
        for result in self.results:
            for figure in result.figures:
                first.setdefault((figure.quantity, figure.axis), figure)
        order = {quantity: i for i, quantity in enumerate(QUANTITIES)}
        return tuple(sorted(first.values(), key=lambda f: (order[f.quantity], f.axis)))

    @property
    def characteristics(self) -> Characteristics:
        """The figures as rows of the table that an engineer quotes."""
        return Characteristics(
            Characteristic(
                quantity=f.quantity,
                axis=f.axis,
                origin=self.campaign.origin,
                value=f.estimate.value,
                unit=f.estimate.unit,
                uncertainty=f.estimate.uncertainty,
                degrees_of_freedom=_finite(f.estimate.degrees_of_freedom),
                note=f.estimate.note or f"test '{f.test}'",
            )
            for f in self.figures
        )

    def figure(self, quantity: str, axis: str) -> Figure:
        """Return one figure."""
        for figure in self.figures:
            if (figure.quantity, figure.axis) == (quantity, axis):
                return figure
        given = ", ".join(sorted({f"{f.quantity} of {f.axis}" for f in self.figures})) or "nothing"
        raise ModelError(f"no test gave {quantity} of axis '{axis}': there is {given}")


def _finite(value: float) -> float | None:
    return None if value == float("inf") else value
