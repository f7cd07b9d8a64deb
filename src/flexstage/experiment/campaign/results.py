"""What a set of tests gave."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

from flexstage.characteristic import Characteristics, MeasuredCharacteristic
from flexstage.errors import ModelError
from flexstage.estimate import Estimate
from flexstage.experiment.campaign.plan import Campaign, Test
from flexstage.quantities import QUANTITIES
from flexstage.short_repr import short_repr


def figure_of(
    campaign: Campaign, test: Test, quantity: str, estimate: Estimate, note: str
) -> MeasuredCharacteristic:
    """Return what a test gave of a quantity of its axis; the note takes the place of its own."""
    return MeasuredCharacteristic.from_estimate(
        replace(estimate, note=note),
        quantity=quantity,
        axis=test.axis,
        origin=campaign.origin,
        test=test.name,
    )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TestResult:
    """What one test gave."""

    __test__ = False  # a name that the collector of tests would take for its own

    test: Test
    """The test."""
    figures: tuple[MeasuredCharacteristic, ...]
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
    def figures(self) -> tuple[MeasuredCharacteristic, ...]:
        """One figure for each quantity and axis: that of the first test that gives it."""
        first: dict[tuple[str, str], MeasuredCharacteristic] = {}
        for result in self.results:
            for figure in result.figures:
                first.setdefault((figure.quantity, figure.axis), figure)
        order = {quantity: i for i, quantity in enumerate(QUANTITIES)}
        return tuple(sorted(first.values(), key=lambda f: (order[f.quantity], f.axis)))

    @property
    def characteristics(self) -> Characteristics:
        """The figures as rows of the table that an engineer quotes."""
        return Characteristics(
            replace(f.row, origin=self.campaign.origin, note=f.note or f"test '{f.test}'")
            for f in self.figures
        )

    def figure(self, quantity: str, axis: str) -> MeasuredCharacteristic:
        """Return one figure."""
        for figure in self.figures:
            if (figure.quantity, figure.axis) == (quantity, axis):
                return figure
        given = ", ".join(sorted({f"{f.quantity} of {f.axis}" for f in self.figures})) or "nothing"
        raise ModelError(f"no test gave {quantity} of axis '{axis}': there is {given}")
