"""Evaluation of a set of tests: what each gave, and whether two figures differ."""

import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, ClassVar, Literal

from flexstage.base import progress
from flexstage.base.errors import FlexstageError, ModelError, RecordError
from flexstage.base.short_repr import short_repr
from flexstage.experiments.campaign.loading import load_records
from flexstage.experiments.campaign.plan import KINDS, Campaign, Test
from flexstage.experiments.campaign.requests import CharacteriseRequest
from flexstage.files.plain import picked
from flexstage.files.result import Result
from flexstage.quantities.characteristic import (
    Characteristic,
    Characteristics,
    MeasuredCharacteristic,
    one_of_each,
)
from flexstage.quantities.estimate import Estimate
from flexstage.records import Record


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

    def data(self) -> dict[str, Any]:
        """Return it as plain data, in SI units."""
        positioning, ranges = self.details.get("positioning"), self.details.get("ranges", ())
        data: dict[str, Any] = {
            **picked(self.test, "name", "kind=test", "axis", "records"),
            "figures": [f.quantity for f in self.figures],
            "notes": list(self.notes),
        }
        if positioning is not None:
            data["positioning"] = positioning.data()
        if len(ranges) > 1:
            data["ranges"] = [
                {
                    "command": [one.curve.basis.low, one.curve.basis.high],
                    "command_unit": one.curve.position_unit,
                    "cycles": one.of_cycles.size,
                    "stroke": picked(one.stroke, "value", "unit", "uncertainty", "interval"),
                }
                for one in ranges
            ]
        return data


def figure_data(figure: MeasuredCharacteristic) -> dict[str, Any]:
    """Return a measured figure as plain data; it is compared with nothing."""
    return {
        **picked(figure, "quantity", "axis", "value", "unit", "uncertainty", "degrees_of_freedom"),
        **picked(figure, "interval=estimate.interval", "test", "note"),
        "budget": [
            picked(c, "name", "uncertainty", "degrees_of_freedom", "kind")
            for c in figure.components
        ],
        "differences": {},
    }


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Characterisation(Result):
    """What all tests of a stage gave."""

    table_key: ClassVar[str] = "characteristics"

    stage: str = ""
    """Stage file or name of a built-in design; empty where there is none."""
    origin: Literal["measured", "virtual"]
    """Whether the records are measured or simulated."""
    results: tuple[TestResult, ...]
    """What each test gave."""
    figures: tuple[MeasuredCharacteristic, ...]
    """One figure for each quantity and axis: that of the first test that gives it."""
    sources: Mapping[str, str] = field(default_factory=dict)
    """SHA-256 of each file that was read, by its name."""
    notes: tuple[str, ...] = ()
    """Remarks that belong to every figure."""

    __repr__ = short_repr

    def data(self) -> dict[str, Any]:
        return {
            **picked(self, "stage", "origin"),
            "characteristics": [figure_data(figure) for figure in self.figures],
            "tests": [result.data() for result in self.results],
            **picked(self, "sources", "notes"),
        }

    @property
    def characteristics(self) -> Characteristics:
        """The figures as rows of the table that an engineer quotes."""
        return Characteristics(
            replace(f.row, origin=self.origin, note=f.note or f"test '{f.test}'")
            for f in self.figures
        )

    def figure(self, quantity: str, axis: str) -> MeasuredCharacteristic:
        """Return one figure."""
        for figure in self.figures:
            if (figure.quantity, figure.axis) == (quantity, axis):
                return figure
        given = ", ".join(sorted({f"{f.quantity} of {f.axis}" for f in self.figures})) or "nothing"
        raise ModelError(f"no test gave {quantity} of axis '{axis}': there is {given}")


@dataclass(frozen=True, slots=True, kw_only=True)
class Difference:
    """How far one figure is above another."""

    value: float
    """The difference, in the unit of the figures."""
    percent: float | None
    """The same in percent of the reference; None where that is 0."""
    expanded: float | None
    """Expanded uncertainty of the difference at 95 %; None where neither figure has one."""
    significant: bool | None
    """Whether the difference is larger than that; None where it cannot be said."""


def difference(figure: Characteristic, reference: Characteristic) -> Difference:
    """Compare two figures of the same quantity.

    The difference is significant at 95 % where it exceeds its expanded uncertainty, with degrees of
    freedom after Welch and Satterthwaite (JCGM 100:2008, G.4). A figure without uncertainty counts
    as exact beside one that has one: of a model the verdict then asks whether the measurement
    contradicts it, not by how much the model itself may be off.

    Examples
    --------
    >>> measured = Characteristic(quantity="natural_frequency_hz", axis="x", origin="measured",
    ...     value=337.0, unit="Hz", uncertainty=0.4, degrees_of_freedom=9.0)
    >>> model = Characteristic(quantity="natural_frequency_hz", axis="x", origin="solid",
    ...     value=320.9, unit="Hz")
    >>> found = difference(measured, model)
    >>> print(f"{found.percent:.1f} %, significant: {found.significant}")
    5.0 %, significant: True
    """
    if figure.quantity != reference.quantity:
        raise ModelError(
            f"a {figure.quantity} cannot be compared with a {reference.quantity}: choose rows of "
            "one quantity"
        )
    value = float(figure.value - reference.value)
    percent = None if reference.value == 0.0 else float(100.0 * value / abs(reference.value))
    parts = tuple(c.contribution for c in (figure, reference) if c.contribution is not None)
    if not parts:
        return Difference(value=value, percent=percent, expanded=None, significant=None)
    whole = Estimate(value=value, unit=figure.unit, components=parts)
    expanded = whole.coverage_factor * whole.uncertainty
    return Difference(
        value=value, percent=percent, expanded=expanded, significant=bool(abs(value) > expanded)
    )


def evaluate(campaign: Campaign, load: Callable[[Test], list[Record]]) -> Characterisation:
    """Evaluate all tests of a campaign.

    `load` gives the records of a test.

    Examples
    --------
    >>> from flexstage.stage.designs import design
    >>> from flexstage.virtual.as_built import as_built
    >>> from flexstage.experiments.virtual_campaign import virtual_campaign
    >>> made = virtual_campaign(as_built(design("parallelogram"), seed=1), seed=1)
    >>> found = evaluate(made.campaign, lambda test: [made.records[n] for n in test.records])
    >>> stroke = found.figure("output_displacement", "x").estimate
    >>> print(f"{stroke.value * 1e6:.1f} um")
    200.1 um
    """
    results = []
    sources: dict[str, str] = {}
    for k, test in enumerate(campaign.tests):
        with progress.subtask(k / len(campaign.tests), (k + 1) / len(campaign.tests)):
            progress.update(f"test {test.name}"[:17])
            try:
                records = load(test)
                results.append(KINDS[test.test].evaluate(test, records, campaign))
            except FlexstageError as error:
                if f"'{test.name}'" in str(error):
                    raise
                raise type(error)(f"test '{test.name}': {error}") from error
            sources |= {r.source: r.source_hash for r in records if r.source_hash}
    return Characterisation(
        stage=campaign.stage,
        origin=campaign.origin,
        results=tuple(results),
        figures=one_of_each(figure for result in results for figure in result.figures),
        sources=sources,
        notes=campaign.notes,
    )


def characterise(campaign: Campaign, folder: str | os.PathLike[str] = ".") -> Characterisation:
    """Read the files of a campaign, named from a folder, and evaluate its tests.

    What cannot be read or evaluated is named by its test.
    """
    base = Path(folder)
    if not campaign.tests:
        raise RecordError("the campaign has no test: describe one at least")
    return evaluate(campaign, lambda test: load_records(test, base))


def characterise_files(
    files: Sequence[str | os.PathLike[str]], request: CharacteriseRequest
) -> Characterisation:
    """Evaluate measured files as one test."""
    found = characterise(Campaign.of_files([str(file) for file in files], request))
    return replace(found, request=request)
