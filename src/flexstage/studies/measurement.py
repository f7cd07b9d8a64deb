"""What was measured, beside models, publications and the description of a drive."""

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
)
from flexstage.quantities.quantity import display
from flexstage.quantities.units import readable
from flexstage.stage import PiezoStack, Stage
from flexstage.stage.assumptions import assumed_figures
from flexstage.system import analyse_axis

if TYPE_CHECKING:
    from flexstage.experiments.campaign.results import Characterisation
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

    def data(self) -> dict[str, Any]:
        """Return it as plain data."""
        differences = {
            origin: {
                "reference": self.references[origin].value,
                **picked(d, "difference=value", "percent", "expanded", "significant"),
            }
            for origin, d in self.differences.items()
        }
        return figure_data(self.figure) | {"differences": differences}


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class MeasurementComparison(Result):
    """What was measured, compared with models and publications."""

    table_key: ClassVar[str] = "characteristics"

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

    def data(self) -> dict[str, Any]:
        return self.found.data() | {
            "stage": self.stage.name if self.stage is not None else "",
            "characteristics": [row.data() for row in self.rows],
            "notes": list(self.notes),
        }

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
    from flexstage.base.errors import ConvergenceError, ModelError, StageError
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
        request=found.request,
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
