"""Evaluation of a campaign: results of its tests, and differences of figures."""

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
from flexstage.experiments.requests import CharacteriseRequest
from flexstage.files.plain import picked
from flexstage.files.result import Result
from flexstage.quantities.characteristic import (
    Characteristic,
    Characteristics,
    MeasuredCharacteristic,
    kind_of,
    one_of_each,
)
from flexstage.quantities.estimate import Estimate
from flexstage.records import Record


def figure_of(
    campaign: Campaign, test: Test, quantity: str, estimate: Estimate, note: str
) -> MeasuredCharacteristic:
    """Return the figure of a quantity of a test's axis; the note replaces that of the estimate."""
    return MeasuredCharacteristic.from_estimate(
        replace(estimate, note=note),
        quantity=quantity,
        axis=test.axis,
        origin=campaign.origin,
        test=test.name,
    )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TestResult:
    """Result of one test."""

    __test__ = False  # a name that the collector of tests would take for its own

    test: Test
    """The test."""
    figures: tuple[MeasuredCharacteristic, ...]
    """Its figures."""
    details: Mapping[str, Any] = field(default_factory=dict)
    """Curves and fits of the figures, for plots, by name."""
    notes: tuple[str, ...] = ()
    """Notes for the report."""

    __repr__ = short_repr

    def data(self) -> dict[str, Any]:
        """Return the result as plain data, in SI units."""
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
    """Return a measured figure as plain data, without comparisons."""
    return {
        **picked(figure, "quantity", "axis", "value", "unit", "uncertainty", "degrees_of_freedom"),
        **picked(figure, "interval=estimate.interval", "test", "note"),
        "kind": kind_of(figure),
        "budget": [
            picked(c, "name", "uncertainty", "degrees_of_freedom", "kind")
            for c in figure.components
        ],
        "differences": {},
    }


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Characterisation(Result):
    """Results of all tests of a stage."""

    table_key: ClassVar[str] = "characteristics"

    stage: str = ""
    """Stage file or name of a built-in design; empty where there is none."""
    origin: Literal["measured", "virtual"]
    """Origin of the records: measured, or virtual for simulated ones."""
    results: tuple[TestResult, ...]
    """Results of the tests."""
    figures: tuple[MeasuredCharacteristic, ...]
    """One figure for each quantity and axis: that of the first test that gives it."""
    sources: Mapping[str, str] = field(default_factory=dict)
    """SHA-256 of each file, by its name."""
    notes: tuple[str, ...] = ()
    """Remarks on all figures."""
    origins: Mapping[str, str] = field(default_factory=dict)
    """Origin of each figure of a simulated stage, by quantity and axis."""

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
        """The figures as rows of a table of characteristics."""
        return Characteristics(
            replace(f.row, origin=self.origin, note=f.note or f"test '{f.test}'")
            for f in self.figures
        )

    def figure(self, quantity: str, axis: str) -> MeasuredCharacteristic:
        """Return one figure."""
        for figure in self.figures:
            if (figure.quantity, figure.axis) == (quantity, axis):
                return figure
        listed = ", ".join(sorted({f"{f.quantity} of {f.axis}" for f in self.figures})) or "nothing"
        raise ModelError(f"no test measured {quantity} of axis '{axis}': available: {listed}")


@dataclass(frozen=True, slots=True, kw_only=True)
class Difference:
    """Difference of one figure from another."""

    value: float
    """The difference, in the unit of the figures."""
    percent: float | None
    """The difference in per cent of the reference; None where that is 0."""
    expanded: float | None
    """Expanded uncertainty of the difference at 95 %; None where neither figure has one."""
    significant: bool | None
    """Whether the difference exceeds that; None without an uncertainty."""


def difference(figure: Characteristic, reference: Characteristic) -> Difference:
    """Compare two figures of the same quantity.

    The difference is significant at 95 % where it exceeds its expanded uncertainty, with degrees of
    freedom by Welch and Satterthwaite (JCGM 100:2008, G.4). A figure without uncertainty is exact
    in a comparison with one that has one. For a model, the test then asks whether the measurement
    contradicts it, not how large the error of the model itself may be.

    Examples
    --------
    >>> measured = Characteristic(quantity="natural_frequency_hz", axis="x", origin="measured",
    ...     value=337.0, unit="Hz", uncertainty=0.4, degrees_of_freedom=9.0)
    >>> model = Characteristic(quantity="natural_frequency_hz", axis="x", origin="solid",
    ...     value=320.9, unit="Hz")
    >>> change = difference(measured, model)
    >>> print(f"{change.percent:.1f} %, significant: {change.significant}")
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
    total = Estimate(value=value, unit=figure.unit, components=parts)
    expanded = total.coverage_factor * total.uncertainty
    return Difference(
        value=value, percent=percent, expanded=expanded, significant=bool(abs(value) > expanded)
    )


def evaluate(campaign: Campaign, load: Callable[[Test], list[Record]]) -> Characterisation:
    """Evaluate all tests of a campaign.

    `load` returns the records of a test.

    Examples
    --------
    >>> from flexstage.stage.designs import design
    >>> from flexstage.virtual.as_built import as_built
    >>> from flexstage.experiments.virtual_campaign import virtual_campaign
    >>> virtual = virtual_campaign(as_built(design("parallelogram"), seed=1), seed=1)
    >>> result = evaluate(virtual.campaign, lambda test: [virtual.records[n] for n in test.records])
    >>> stroke = result.figure("output_displacement", "x").estimate
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
        origins=campaign.origins,
    )


def characterise(campaign: Campaign, folder: str | os.PathLike[str] = ".") -> Characterisation:
    """Read the files of a campaign, relative to a folder, and evaluate its tests.

    Messages about errors name the test.
    """
    base = Path(folder)
    if not campaign.tests:
        raise RecordError("the campaign has no test: describe at least one")
    return evaluate(campaign, lambda test: load_records(test, base))


def characterise_files(
    files: Sequence[str | os.PathLike[str]], request: CharacteriseRequest
) -> Characterisation:
    """Evaluate measured files as one test."""
    result = characterise(Campaign.of_files([str(file) for file in files], request))
    return replace(result, request=request)
