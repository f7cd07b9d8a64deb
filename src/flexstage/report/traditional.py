"""The section of a study on traditional stages: motion errors, other differences, drift."""

import math
from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING

from flexstage.base.choose import listed
from flexstage.quantities.quantity import number
from flexstage.quantities.table import Bullets, Cell, Column, Content, Table, table
from flexstage.stage.designs.vgtu import PredictedRanges, predicted_ranges
from flexstage.studies.guided_axes import Mounting
from flexstage.studies.traditional import (
    LOADS,
    MEASURES,
    SPAN,
    ComparedStage,
    TraditionalComparison,
    conclusions,
    drift_conclusions,
)

if TYPE_CHECKING:
    from flexstage.studies.guided_axes import AxisErrors
    from flexstage.studies.study import Study

_UM = 1e6


def motion_error_section(study: "Study") -> Iterator[Content]:
    """Yield the claim for every definition of a traditional stage, and the parts of the errors."""
    if (comparison := study.traditional) is not None:
        yield Bullets((*conclusions(comparison), *_ranges_of_motion(study)))
        yield claim_table(comparison)
        yield error_table(comparison)
        yield other_table(comparison)


def _ranges_of_motion(study: "Study") -> Iterator[str]:
    """Yield the ranges of motion across and rotation of the stage as described."""
    if (ranges := predicted_ranges(study.stage)) is None:
        return
    across = {
        axis.axis: study.main.characteristics.value("output_displacement", axis.axis)
        for axis in study.main.axes
    }
    sentences = (
        ("motion across", _by_axis(ranges, "cross_coupling", across, "µm")),
        ("rotation", _by_axis(ranges, "parasitic_rotation", dict.fromkeys(across, 1.0), "µrad")),
    )
    if known := [f"{what} is {text}" for what, text in sentences if text]:
        yield (
            f"The geometry is fitted. Without manufacture, {' and '.join(known)}, at 95 %. "
            "Straightness has no range: condensed finite elements move straight. "
            f"{ranges.source}"
        )


def _ranges_of_drift(study: "Study") -> Iterator[str]:
    """Yield the ranges of the drift of the probes."""
    if (ranges := predicted_ranges(study.stage)) is None:
        return
    factors = {axis.axis: 1e3 for axis in study.main.axes}
    if text := _by_axis(ranges, "thermal_drift", factors, "nm/K"):
        yield f"The geometry is fitted: drift at the probes is {text}. {ranges.source}"


def _by_axis(
    ranges: PredictedRanges, quantity: str, factors: Mapping[str, float], unit: str
) -> str:
    """Return the ranges of the axes that have one, times a millionth of factors."""
    texts = {axis: ranges.text(quantity, axis, _UM * factor) for axis, factor in factors.items()}
    return listed(f"{text} {unit} in {axis}" for axis, text in texts.items() if text)


def drift_section(study: "Study") -> Iterator[Content]:
    """Yield the thermal drift of each stage."""
    if (comparison := study.traditional) is not None:
        yield Bullets((*drift_conclusions(comparison), *_ranges_of_drift(study)))
        yield drift_table(comparison)


def assumption_section(study: "Study") -> Iterator[Content]:
    """Yield the assumptions about traditional stages, and the limits of the comparison."""
    if (comparison := study.traditional) is None:
        return
    scatter, mounting = comparison.scatter, Mounting()
    path = (
        "The path of this stage is by plane finite elements with finite displacements."
        if comparison.knows_straightness
        else "The path of this stage is by rigid bodies with first-order elastic deformation. Only "
        "the plane model includes the stretch of its legs, which increases the motion across by up "
        "to a half."
    )
    yield Bullets(
        (
            "The publication does not define the traditional stages. Here they have guides with "
            "the legs of each axis (notches, length, spacing), a platform of the same height, and "
            "the same plate and material. An actuator of the same kind acts on the platform, with "
            "the travel of this stage. The guides are single or double parallelograms in two "
            "stacked plates, or single ones side by side in one plate.",
            "The point of interest is the centre of the platform, on the top of the upper plate.",
            f"Manufacturing scatter: necks {_UM * scatter.neck_common:g} µm in common and "
            f"{_UM * scatter.neck_own:g} µm each, positions {_UM * scatter.position:g} µm in x and "
            f"y, axes of notches {1e3 * scatter.lean:g} mrad, lateral offset of drives "
            f"{_UM * scatter.drive:g} µm. These are standard deviations of good wire erosion, not "
            f"measured on a machine. Stacked plates: {_UM * mounting.squareness:.0f} µrad in "
            "squareness and tilt (20 arcsec).",
            path,
            "The paths of traditional stages are by rigid bodies with first-order elastic "
            "deformation. Plane finite elements with finite displacements give up to 0.05 µm less "
            "motion across, for double parallelograms 0.02 µm more.",
            f"{comparison.catalogue.title.capitalize()}: {comparison.catalogue.source}. It gives "
            "no value for such a short travel: it is an upper limit.",
            "Motion along the normal results from tilted hinges and from drives off the mid-plane "
            "of the plate. Gravity, misaligned screws and an uneven base are not included.",
            "No public prices of actuators were found: their number, kind and stroke are given.",
        )
    )


def claim_table(comparison: TraditionalComparison) -> Table:
    """Return the assessment of the claim for each definition of a traditional stage."""
    by = {m: {r.against: r for r in comparison.reductions(m)} for m in MEASURES}
    rows = []
    for row in comparison.reductions():
        if row.kind == "given":
            limit = f"{number(_UM * row.other, 3)} at most"
            rows.append((row.against, row.kind, limit, *["–"] * 5))
            continue
        straight = by["straightness"].get(row.against) if comparison.knows_straightness else None
        yaw = by["yaw"].get(row.against)
        rows.append(
            (
                row.against,
                row.kind,
                number(_UM * row.other, 3),
                *("–" if r is None else number(1.0 - r.reduction, 2) for r in (row, straight, yaw)),
                "yes" if row.holds else "no",
                f"{100.0 * row.share:.0f} %",
            )
        )
    return table(
        f"Claim of {100.0 * comparison.claim:.0f} % less motion error, by definition of a "
        f"traditional stage. It holds for a ratio of at most {1.0 - comparison.claim:.2f}. Motion "
        f"across: peak to valley over the stroke, worse axis, median of {comparison.samples} "
        "manufactured stages. Ratio: this stage over the traditional one, both predicted.",
        (
            Column("Traditional stage", "long words"),
            "<Kind",
            "Motion across [µm]",
            Column("across", group="ratio"),
            Column("straightness", group="ratio"),
            Column("yaw", group="ratio"),
            Column("across", "words", group="claim holds"),
            Column("pairs of stages", group="claim holds"),
        ),
        rows,
    )


def error_table(comparison: TraditionalComparison) -> Table:
    """Return the motion errors of every axis, and their parts."""
    rows = [
        (
            stage.title,
            name,
            *_errors(axis, comparison.knows_straightness or stage is not comparison.stage),
        )
        for stage in _stages(comparison)
        for name, axis in stage.axes.items()
    ]
    nominal, manufactured, total = "nominal [µm]", "manufactured, σ [µm]", "total, median [µm]"
    return table(
        "Predicted motion errors over the stroke. Nominal: motion across by finite rotations of "
        "rigid bodies, and by elastic deformation. Manufactured: standard deviation by scatter, "
        "and by mounting and scattered rotations times the Abbe offset. Total: all parts, by "
        "sample.",
        (
            Column("Stage", "long words"),
            "<Axis",
            "Travel [µm]",
            Column("rotations", group=nominal),
            Column("elastic", group=nominal),
            Column("scatter", group=manufactured),
            Column("mounting", group=manufactured),
            Column("across", group=total),
            Column("95 %", group=total),
            Column("straight\u00adness", group=total),
            Column("normal", group=total),
            Column("yaw", group="[µrad]"),
            Column("roll, pitch", group="[µrad]"),
        ),
        rows,
        divided=True,
    )


def _errors(axis: "AxisErrors", straight: bool) -> Iterator[str]:
    yield f"{_UM * axis.travel:.1f}"
    for part in (axis.geometry, axis.bending, axis.manufacture, axis.assembly):
        yield _small(_UM * part)
    for value in axis.figures("across"):
        yield _small(_UM * value)
    yield _small(_UM * axis.figures("straightness")[0]) if straight else "–"
    yield _small(_UM * axis.figures("normal")[0])
    for quantity in ("yaw", "tilt"):
        yield number(_UM * axis.figures(quantity)[0], 3)


def other_table(comparison: TraditionalComparison) -> Table:
    """Return other differences: frequency, symmetry of the axes, coupling, size, mass, drives."""
    rows = []
    for stage in _stages(comparison):
        sizes = " × ".join(f"{1e3 * v:.0f}" for v in stage.size)
        coupling = max((axis.coupling for axis in stage.axes.values()), key=abs)
        rows.append(
            (
                stage.title,
                *(f"{f:.0f}" for f in stage.frequency_hz.values()),
                f"{100.0 * spread(stage.frequency_hz):.0f}",
                f"{100.0 * spread(stage.axis_errors):.0f}",
                _small(100.0 * abs(coupling)),
                sizes,
                number(stage.mass, 3),
                stage.actuators,
            )
        )
    axes, differ = "natural frequency [Hz]", "axes differ by [%]"
    return table(
        "Other differences. Axes differ by: difference over mean, of frequency and of motion "
        "across. Coupling: nominal motion across over motion along, worse axis.",
        (
            Column("Stage", "long words"),
            *(Column(name, group=axes) for name in comparison.stage.axes),
            Column("frequency", group=differ),
            Column("motion across", group=differ),
            "Coupling [%]",
            Column("Size [mm]", "words"),
            "Mass [kg]",
            Column("Actuators", "long words"),
        ),
        rows,
    )


def spread(figures: Mapping[str, float]) -> float:
    """Return the difference between the largest and the smallest figure, over their mean."""
    values = list(figures.values())
    return (max(values) - min(values)) / (sum(values) / len(values))


def drift_table(comparison: TraditionalComparison) -> Table:
    """Return the thermal drift of the platform of each stage."""
    rows = []
    for stage in _stages(comparison):
        cells: list[str] = [stage.title]
        for load in LOADS:
            x, y, turned = stage.drift[load]
            cells += [_small(1e9 * v, 0) for v in (x, y, math.hypot(x, y))]
            cells.append(_small(_UM * turned, 2))
        rows.append(cells)
    groups = (
        "uniform 1 K",
        *(f"1 K per {1e3 * SPAN:.0f} mm in {axis}" for axis in "xy"),
    )
    return table(
        "Thermal drift of the centre of the platform [nm], and its rotation [µrad]; "
        "two-dimensional finite elements, drives removed, base fixed and without expansion.",
        (
            Column("Stage", "long words"),
            *(
                Column(component, group=group)
                for group in groups
                for component in ("x", "y", "total", "yaw")
            ),
        ),
        [[Cell(text) for text in row] for row in rows],
    )


def _stages(comparison: TraditionalComparison) -> tuple[ComparedStage, ...]:
    return (comparison.stage, *comparison.others, comparison.asymmetric)


def _small(value: float, decimals: int = 3) -> str:
    """Return a value with the decimals of a comparison; "0" for one that rounds to 0."""
    text = f"{value:.{decimals}f}"
    return text.replace("-", "−") if float(text) else "0"
