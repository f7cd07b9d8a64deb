"""What was measured, beside models, publications and the description of a drive."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from typing import TYPE_CHECKING, Any

from flexstage.characteristic import Characteristic, Characteristics, MeasuredCharacteristic
from flexstage.errors import StageError
from flexstage.estimate import Estimate
from flexstage.experiments.campaign.results import Difference, difference
from flexstage.files.plain import picked, plain
from flexstage.measure.motion.positioning import Positioning
from flexstage.quantities import display
from flexstage.stage import PiezoStack, Stage
from flexstage.stage.assumptions import assumed_figures
from flexstage.system import analyse_axis
from flexstage.units import readable

if TYPE_CHECKING:
    from flexstage.experiments.campaign.results import Characterisation, TestResult
    from flexstage.experiments.results import PlanResult
    from flexstage.hysteresis import Identification


#: Quantities whose measured value has no sign.
_RANGES = frozenset(("parasitic_rotation",))


@dataclass(frozen=True, slots=True, kw_only=True)
class MeasuredRow:
    """One measured figure, and how far it is from what others say."""

    figure: MeasuredCharacteristic
    """The figure."""
    references: Mapping[str, Characteristic]
    """What others say, by origin."""
    differences: Mapping[str, Difference]
    """The differences of the figure to them, by origin."""
    assumed: bool = False
    """Whether it is of a simulated stage and was put in by an assumption."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class MeasurementComparison:
    """What was measured, compared with models and publications."""

    found: "Characterisation"
    """What the tests gave."""
    stage: "Stage | None"
    """The stage, where it is described."""
    rows: tuple[MeasuredRow, ...]
    """Its figures."""
    references: tuple[str, ...]
    """Origins that have something to compare with."""
    left_out: Mapping[str, str] = field(default_factory=dict)
    """Why a model could not be made of the stage, by model."""

    @property
    def title(self) -> str:
        """What it is of, in one line."""
        name = self.stage.name if self.stage is not None else "records"
        kind = "simulated measurement" if self.found.origin == "virtual" else "measured"
        return f"{name}: {kind}"

    @property
    def notes(self) -> tuple[str, ...]:
        """Remarks of the campaign, of its tests, and on models that were left out."""
        own = [n for r in self.found.results for n in (f"{r.test.name}: {t}" for t in r.notes)]
        out = [f"the {name} model was left out: {why}" for name, why in self.left_out.items()]
        return tuple(dict.fromkeys((*self.found.notes, *own, *out)))


def compare_measurement(
    found: "Characterisation", stage: "Stage | None", models: Sequence[str] = ()
) -> MeasurementComparison:
    """Compare what was measured with models of the stage and with what is published of it.

    Nothing is compared where there is no stage; a model that cannot be made is left out, with the
    reason.
    """
    from flexstage.errors import ConvergenceError, ModelError, StageError
    from flexstage.studies.models import analyse_model, known_model

    if stage is None:
        return compare_with_references(found, None, Characteristics())
    rows = list(stage.published)
    left_out: dict[str, str] = {}
    for model in models:
        known_model(model)
    for model in models:
        try:
            rows += analyse_model(stage, model).characteristics
        except (ConvergenceError, ModelError, StageError) as error:
            left_out[model] = str(error)
    return compare_with_references(found, stage, Characteristics(rows), left_out)


def compare_with_references(
    found: "Characterisation",
    stage: "Stage | None",
    references: Characteristics,
    left_out: Mapping[str, str] | None = None,
) -> MeasurementComparison:
    """Compare what was measured with rows that models or publications have given."""
    rows = []
    present: dict[str, None] = {}
    virtual = stage if found.origin == "virtual" else None
    assumed = {} if virtual is None else assumed_figures(virtual)
    for evaluated in found.figures:
        note = assumed.get((evaluated.quantity, evaluated.axis))
        figure = evaluated if note is None else replace(evaluated, note=note)
        given: dict[str, Characteristic] = {}
        for row in references:
            if (row.quantity, row.axis) != (figure.quantity, figure.axis):
                continue
            if row.origin == found.origin:
                continue  # its own row, of a table that it has joined
            # a model gives some figures for several conditions; the first is the usual one
            given.setdefault(row.origin, row)
        present |= dict.fromkeys(given)
        rows.append(
            MeasuredRow(
                figure=figure,
                references=given,
                differences={origin: _compared(figure, row) for origin, row in given.items()},
                assumed=note is not None,
            )
        )
    order = {row.origin: i for i, row in reversed(list(enumerate(references)))}
    return MeasurementComparison(
        found=found,
        stage=stage,
        rows=tuple(rows),
        references=tuple(sorted(present, key=lambda origin: order[origin])),
        left_out=dict(left_out or {}),
    )


def compare_plan(result: "PlanResult") -> MeasurementComparison:
    """Compare all figures of a plan with what is published of the stage."""
    # a mode with the drives in place is another than that which was published
    in_place = {(f.quantity, f.axis) for f in result.figures if result.drives_in_place(f)}
    published = Characteristics(
        row for row in result.stage.published if (row.quantity, row.axis) not in in_place
    )
    return compare_with_references(result.characterisation, result.stage, published)


def _compared(own: Characteristic, other: Characteristic) -> Difference:
    if own.quantity in _RANGES:
        # what was measured is largest less smallest, a model gives the end of it with its sign
        other = replace(other, value=abs(other.value))
    found = difference(own, other)
    # a model that gives nothing but rounding is no reference for a percentage
    if abs(other.value) < display(other.quantity).zero:
        return replace(found, percent=None)
    return found


def measurement_results(result: MeasurementComparison) -> dict[str, Any]:
    """Return what was measured as plain data, in SI units."""
    return {
        "stage": result.stage.name if result.stage is not None else "",
        "origin": result.found.origin,
        "characteristics": [_row(row) for row in result.rows],
        "tests": [
            {
                "name": r.test.name,
                "kind": r.test.test,
                "axis": r.test.axis,
                "records": list(r.test.records),
                "figures": [f.quantity for f in r.figures],
                "notes": list(r.notes),
                **_details(r),
            }
            for r in result.found.results
        ],
        "sources": dict(result.found.sources),
        "notes": list(result.notes),
    }


def _details(result: "TestResult") -> dict[str, Any]:
    found, ranges = result.details.get("positioning"), result.details.get("ranges", ())
    data: dict[str, Any] = {} if found is None else {"positioning": positioning_data(found)}
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


def _row(row: MeasuredRow) -> dict[str, Any]:
    figure = row.figure
    return {
        **picked(figure, "quantity", "axis", "value", "unit", "uncertainty", "degrees_of_freedom"),
        **picked(figure, "interval=estimate.interval", "test", "note"),
        "budget": [
            picked(c, "name", "uncertainty", "degrees_of_freedom", "kind")
            for c in figure.components
        ],
        "differences": {
            origin: {
                "reference": row.references[origin].value,
                **picked(d, "difference=value", "percent", "expanded", "significant"),
            }
            for origin, d in row.differences.items()
        },
    }


def positioning_data(found: Positioning) -> dict[str, Any]:
    """Return everything that a test of positioning gave as plain data, in SI units."""
    figures = {
        f.name: value
        for f in fields(found)
        if isinstance(value := getattr(found, f.name), Estimate)
    }
    at_targets = {
        "target": found.target,
        "mean_upward": found.mean_upward,
        "mean_downward": found.mean_downward,
        "mean_bidirectional": found.mean_bidirectional,
        "reversal": found.reversal_at_targets,
        "spread_upward": found.spread_upward,
        "spread_downward": found.spread_downward,
        "repeatability_upward": 4.0 * found.spread_upward,
        "repeatability_downward": 4.0 * found.spread_downward,
        "repeatability": found.repeatability_at_targets,
    }
    return {
        "runs": found.runs,
        "figures": {
            name: picked(e, "value", "unit", "uncertainty", "interval")
            for name, e in figures.items()
        },
        "targets": plain(at_targets),
    }


#: One of less than this share is of a small part of its range, or of another prefix of the unit.
_SMALL = 1.0 / 100.0


def against_description(
    found: "Identification", described: Stage, axis: str | None
) -> tuple[str, ...]:
    """Compare range and stroke of a record with the drive of a stage.

    The axis is the first one where None. Returns a sentence for each that does not suit the drive.
    """
    from flexstage.lumped import lumped_system

    if not described.axes:
        raise StageError(f"{described.name} has no axis: give it one, or leave --stage out")
    chosen = described.axis(axis) if axis is not None else described.axes[0]
    drive = described.drive_of(chosen.name)
    if not isinstance(drive, PiezoStack):
        raise StageError(
            f"axis '{chosen.name}' of {described.name} is driven by a {drive.kind}, and a piezo "
            "stack is needed: choose another axis, or leave --stage out"
        )
    system = lumped_system(described)
    port = next(a for a in system.axes if a.name == chosen.name)
    # a stack on the stage moves less, and one that is measured by itself does not pass the stage
    strokes = (drive.free_stroke, abs(analyse_axis(system, port).output_displacement))
    low, high = found.measurement.input_range
    of = f"the drive of axis '{chosen.name}' of {described.name}"
    said = []
    if drive.voltage_range is not None:
        takes = (drive.voltage_range[1] - drive.voltage_range[0],)
        said.append(
            _far_from("input", high - low, found.model.input_unit, "V", takes, f"{of} takes")
        )
    said.append(
        _far_from("output", found.stroke, found.model.output_unit, "m", strokes, f"{of} moves")
    )
    return tuple(sentence for sentence in said if sentence)


def _far_from(
    what: str, span: float, unit: str, wanted: str, known: tuple[float, ...], verb: str
) -> str:
    """Say that a span is far from what is known, whichever of it is meant."""
    # A record beyond this many times what the drive takes or moves is not of it as it is described
    beyond = 3.0
    if unit != wanted:
        own = f"in {unit}" if unit else "without a unit"
        return f"the {what} is {own} and {verb} {wanted}: the two cannot be compared"
    least, most = min(known), max(known)
    if _SMALL * least <= span <= beyond * most:
        return ""
    nearest = most if span > most else least
    times = span / nearest if span > nearest else nearest / span
    return (
        f"the {what} spans {readable(unit, span)} and {verb} {readable(unit, nearest)}, "
        f"{times:.3g} times {'less' if span > nearest else 'more'}: is the unit of the {what} "
        "right, and is it the record of this drive?"
    )
