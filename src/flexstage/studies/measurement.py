"""Comparison of measurements with models, publications and the description of a drive."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, ClassVar

from flexstage.base.errors import StageError
from flexstage.experiments.campaign.results import Difference, difference, figure_data
from flexstage.files.plain import picked
from flexstage.files.result import Result
from flexstage.quantities.characteristic import (
    Characteristic,
    Characteristics,
    MeasuredCharacteristic,
    comparable,
)
from flexstage.quantities.quantity import display
from flexstage.quantities.units import readable
from flexstage.stage import PiezoStack, Stage
from flexstage.system import analyse_axis

if TYPE_CHECKING:
    from flexstage.experiments.campaign.results import Characterisation
    from flexstage.experiments.results import PlanResult
    from flexstage.hysteresis import Identification


#: Quantities with unsigned measured values.
_RANGES = frozenset(("parasitic_rotation",))


@dataclass(frozen=True, slots=True, kw_only=True)
class MeasuredRow:
    """A measured figure and its differences from references."""

    figure: MeasuredCharacteristic
    """The figure."""
    references: Mapping[str, Characteristic]
    """References by origin."""
    differences: Mapping[str, Difference]
    """Differences of the figure from the references that it is comparable with, by origin."""
    source: str = ""
    """Origin of a figure of a simulated stage: published, model, scatter or assumed, with what."""

    @property
    def source_kind(self) -> str:
        """Kind of this origin, its first word; empty for a measured figure."""
        return self.source.partition(":")[0]

    def data(self) -> dict[str, Any]:
        """Return the row as plain data."""
        differences = {
            origin: {
                "reference": self.references[origin].value,
                **picked(d, "difference=value", "percent", "expanded", "significant"),
            }
            for origin, d in self.differences.items()
        }
        source = {"source": self.source} if self.source else {}
        return figure_data(self.figure) | source | {"differences": differences}


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class MeasurementComparison(Result):
    """Measurements compared with models and publications."""

    table_key: ClassVar[str] = "characteristics"

    characterisation: "Characterisation"
    """Results of the tests."""
    stage: "Stage | None"
    """The stage, if it is described."""
    rows: tuple[MeasuredRow, ...]
    """The measured figures."""
    references: tuple[str, ...]
    """Origins of references."""
    skipped_models: Mapping[str, str] = field(default_factory=dict)
    """Skipped models and reasons."""

    def data(self) -> dict[str, Any]:
        return self.characterisation.data() | {
            "stage": self.stage.name if self.stage is not None else "",
            "characteristics": [row.data() for row in self.rows],
            "notes": list(self.notes),
        }

    @property
    def title(self) -> str:
        """Title of the comparison."""
        name = self.stage.name if self.stage is not None else "records"
        kind = "simulated measurement" if self.characterisation.origin == "virtual" else "measured"
        return f"{name}: {kind}"

    @property
    def notes(self) -> tuple[str, ...]:
        """Remarks on the campaign, its tests, and skipped models."""
        results = self.characterisation.results
        tests = [f"{r.test.name}: {note}" for r in results for note in r.notes]
        skipped = [
            f"the {name} model was skipped: {reason}"
            for name, reason in self.skipped_models.items()
        ]
        return tuple(dict.fromkeys((*self.characterisation.notes, *tests, *skipped)))


def compare_measurement(
    characterisation: "Characterisation", stage: "Stage | None", models: Sequence[str] = ()
) -> MeasurementComparison:
    """Compare measurements with models of the stage and published values.

    Without a stage there are no references; impossible models are skipped with the reason.
    """
    from flexstage.base.errors import ConvergenceError, ModelError, StageError
    from flexstage.studies.models import analyse_model, known_model

    if stage is None:
        return compare_with_references(characterisation, None, Characteristics())
    rows = list(stage.published)
    skipped: dict[str, str] = {}
    for model in models:
        known_model(model)
    for model in models:
        try:
            rows += analyse_model(stage, model).characteristics
        except (ConvergenceError, ModelError, StageError) as error:
            skipped[model] = str(error)
    return compare_with_references(characterisation, stage, Characteristics(rows), skipped)


def compare_with_references(
    characterisation: "Characterisation",
    stage: "Stage | None",
    references: Characteristics,
    skipped_models: Mapping[str, str] | None = None,
) -> MeasurementComparison:
    """Compare measurements with characteristics of models or publications.

    Simulated ones have no differences: the simulated stage is made of such figures.
    """
    rows = []
    present: dict[str, None] = {}
    sources = characterisation.origins if characterisation.origin == "virtual" else {}
    for measured in characterisation.figures:
        figure = replace(measured, origin=characterisation.origin)
        by_origin: dict[str, Characteristic] = {}
        for row in references:
            if (row.quantity, row.axis) != (figure.quantity, figure.axis):
                continue
            if row.origin == characterisation.origin:
                continue  # the figure itself
            # a model may have a figure for several conditions, the default one first
            by_origin.setdefault(row.origin, row)
        present |= dict.fromkeys(by_origin)
        rows.append(
            MeasuredRow(
                figure=figure,
                references=by_origin,
                differences={
                    origin: _difference(figure, row)
                    for origin, row in by_origin.items()
                    if comparable(figure, row)
                },
                source=sources.get(f"{figure.quantity} {figure.axis}", ""),
            )
        )
    order = {row.origin: i for i, row in reversed(list(enumerate(references)))}
    return MeasurementComparison(
        request=characterisation.request,
        characterisation=characterisation,
        stage=stage,
        rows=tuple(rows),
        references=tuple(sorted(present, key=lambda origin: order[origin])),
        skipped_models=dict(skipped_models or {}),
    )


def compare_plan(result: "PlanResult") -> MeasurementComparison:
    """Compare all figures of a plan with published values of the stage."""
    # published modes are those without drives
    in_place = {(f.quantity, f.axis) for f in result.figures if result.drives_in_place(f)}
    published = Characteristics(
        row for row in result.stage.published if (row.quantity, row.axis) not in in_place
    )
    return compare_with_references(result.characterisation, result.stage, published)


def _difference(measured: Characteristic, reference: Characteristic) -> Difference:
    if measured.quantity in _RANGES:
        # a measured range is unsigned, the value of a model has a sign
        reference = replace(reference, value=abs(reference.value))
    result = difference(measured, reference)
    # no percentage of a rounding error
    if abs(reference.value) < display(reference.quantity).zero:
        return replace(result, percent=None)
    return result


#: Least plausible share of the range of a drive in a record; below it the unit may be wrong.
_LEAST_SHARE = 1.0 / 100.0
#: Largest plausible ratio of a record to the range of a drive.
_LARGEST_RATIO = 3.0


def against_description(
    identification: "Identification", described: Stage, axis: str | None
) -> tuple[str, ...]:
    """Return warnings on range and stroke of a record that do not suit the drive of a stage.

    The default axis is the first one.
    """
    from flexstage.lumped import lumped_system

    if not described.axes:
        raise StageError(f"{described.name} has no axis: add one, or omit --stage")
    driven = described.axis(axis) if axis is not None else described.axes[0]
    drive = described.drive_of(driven.name)
    if not isinstance(drive, PiezoStack):
        raise StageError(
            f"axis '{driven.name}' of {described.name} has a {drive.kind}, but a piezo stack is "
            "needed: choose another axis, or omit --stage"
        )
    system = lumped_system(described)
    port = next(a for a in system.axes if a.name == driven.name)
    # the free stroke, for a record of the stack alone, and the stroke of the stage
    strokes = (drive.free_stroke, abs(analyse_axis(system, port).output_displacement))
    low, high = identification.measurement.input_range
    model = identification.model
    owner = f"the drive of axis '{driven.name}' of {described.name}"
    warnings = []
    if drive.voltage_range is not None:
        ranges = (drive.voltage_range[1] - drive.voltage_range[0],)
        clause = f"the voltage range of {owner} is"
        warnings.append(_mismatch("input", high - low, model.input_unit, "V", ranges, clause))
    clause = f"the stroke of {owner} is"
    warnings.append(
        _mismatch("output", identification.stroke, model.output_unit, "m", strokes, clause)
    )
    return tuple(warning for warning in warnings if warning)


def _mismatch(
    what: str, span: float, unit: str, si_unit: str, described: tuple[float, ...], clause: str
) -> str:
    """Return a warning if a span differs widely from all described ones, else an empty text."""
    if unit != si_unit:
        record_unit = f"in {unit}" if unit else "without a unit"
        return f"the {what} is {record_unit} and {clause} in {si_unit}: they cannot be compared"
    least, most = min(described), max(described)
    if _LEAST_SHARE * least <= span <= _LARGEST_RATIO * most:
        return ""
    nearest = most if span > most else least
    ratio = span / nearest if span > nearest else nearest / span
    return (
        f"the {what} range is {readable(unit, span)} and {clause} {readable(unit, nearest)}, "
        f"{ratio:.3g} times {'less' if span > nearest else 'more'}: check the unit of the {what}, "
        "and whether the record is of this drive"
    )
