"""The section of a study on traditional stages: motion errors, what else differs, drift."""

import math
from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING

from flexstage.quantities.quantity import number
from flexstage.quantities.section import Bullets, Content
from flexstage.quantities.table import Cell, Column, Table, table
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
    """Show the claim against every definition of a traditional stage, and the parts of each."""
    if (found := study.traditional) is not None:
        yield Bullets(conclusions(found))
        yield claim_table(found)
        yield error_table(found)
        yield other_table(found)


def drift_section(study: "Study") -> Iterator[Content]:
    """Show what temperature does to each stage."""
    if (found := study.traditional) is not None:
        yield Bullets(drift_conclusions(found))
        yield drift_table(found)


def assumption_section(study: "Study") -> Iterator[Content]:
    """Say what traditional stages are taken to be, and where the comparison ends."""
    if (found := study.traditional) is None:
        return
    scatter, mounting = found.scatter, Mounting()
    path = (
        "The path of the stage itself is that of plane finite elements with finite displacements."
        if found.knows_straightness
        else "The path of the stage itself is that of rigid bodies with what elastic ones add to "
        "first order; its legs stretch as it moves, which takes it up to half as far across again: "
        "the plane model has that."
    )
    yield Bullets(
        (
            "The study does not say which traditional stages it means. Here they have guides of "
            "the legs of each of its axes (notches, length, spacing), a platform of the same "
            "height, the same plate and material, and an actuator of the same kind on the "
            "platform itself, which goes as far as the stage does. Single parallelograms or double "
            "ones, one plate on the other; or single ones side by side in one plate.",
            "The point of interest is the middle of the platform, on the top of the upper plate.",
            f"As made: necks {_UM * scatter.neck_common:g} µm in common and "
            f"{_UM * scatter.neck_own:g} µm each, places {_UM * scatter.position:g} µm in x and y, "
            f"axes of notches {1e3 * scatter.lean:g} mrad, lines of drives {_UM * scatter.drive:g} "
            "µm (standard deviations as of good wire erosion, measured on no machine); stacked "
            f"plates {_UM * mounting.squareness:.0f} µrad in squareness and tilt (20 arcsec).",
            path,
            "Paths of traditional stages are those of rigid bodies with what elastic ones add to "
            "first order: by plane finite elements with finite displacements they go up to 0.05 µm "
            "less across, and double parallelograms 0.02 µm more.",
            f"{found.catalogue.title.capitalize()}: {found.catalogue.source}. Nothing is said of a "
            "travel as short as this one: it is an upper limit.",
            "Motion along the normal is what leaning hinges and drives off the middle of the plate "
            "do; gravity, screws that push askew and a base that is not flat are not in it.",
            "No public price of an actuator was found: their number, kind and stroke are given.",
        )
    )


def claim_table(found: TraditionalComparison) -> Table:
    """Say what becomes of the claim for each definition of a traditional stage."""
    by = {m: {r.against: r for r in found.reductions(m)} for m in MEASURES}
    rows = []
    for row in found.reductions():
        straight = by["straightness"].get(row.against) if found.knows_straightness else None
        yaw = by["yaw"].get(row.against)
        rows.append(
            (
                row.against,
                number(_UM * row.other, 3),
                *("–" if r is None else number(1.0 - r.reduction, 2) for r in (row, straight, yaw)),
                "yes" if row.holds else "no",
                f"{100.0 * row.share:.0f} %",
            )
        )
    return table(
        f"The claim, {100.0 * found.claim:.0f} % less motion error, by what is called traditional: "
        f"it holds where the share is at most {1.0 - found.claim:.2f}. Motion across: largest less "
        f"smallest over the stroke, worse axis, median of {found.samples} stages as made. Share: "
        "the stage of the study over the traditional one.",
        (
            Column("Traditional stage", "long words"),
            "Motion across [µm]",
            Column("across", group="share"),
            Column("straightness", group="share"),
            Column("yaw", group="share"),
            Column("across", "words", group="claim holds"),
            Column("pairs of stages", group="claim holds"),
        ),
        rows,
    )


def error_table(found: TraditionalComparison) -> Table:
    """Show motion errors of every axis, and their parts."""
    rows = [
        (stage.title, name, *_errors(axis, found.knows_straightness or stage is not found.stage))
        for stage in _stages(found)
        for name, axis in stage.axes.items()
    ]
    as_drawn, made, whole = "as drawn [µm]", "as made, deviation [µm]", "whole, median [µm]"
    return table(
        "Motion errors over the stroke. As drawn: motion across by finite rotations of rigid "
        "bodies, and what elastic ones add. As made: standard deviation by scatter, and by "
        "mounting and scattered rotations times the Abbe offset. Whole: all of it, by sample.",
        (
            Column("Stage", "long words"),
            "<Axis",
            "Travel [µm]",
            Column("rotations", group=as_drawn),
            Column("elastic", group=as_drawn),
            Column("scatter", group=made),
            Column("mounting", group=made),
            Column("across", group=whole),
            Column("95 %", group=whole),
            Column("straight\u00adness", group=whole),
            Column("normal", group=whole),
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
    for what in ("yaw", "tilt"):
        yield number(_UM * axis.figures(what)[0], 3)


def other_table(found: TraditionalComparison) -> Table:
    """Show what else differs: frequency, how alike the axes are, coupling, size, mass, drives."""
    rows = []
    for stage in _stages(found):
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
        "What else differs. Axes differ: larger less smaller over their mean, of frequency and of "
        "motion across. Coupling: motion across over motion along as drawn, worse axis.",
        (
            Column("Stage", "long words"),
            *(Column(name, group=axes) for name in found.stage.axes),
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


def drift_table(found: TraditionalComparison) -> Table:
    """Show how far the platform of each stage drifts with temperature."""
    rows = []
    for stage in _stages(found):
        cells: list[str] = [stage.title]
        for load in LOADS:
            x, y, turned = stage.drift[load]
            cells += [_small(1e9 * v, 0) for v in (x, y, math.hypot(x, y))]
            cells.append(_small(_UM * turned, 2))
        rows.append(cells)
    groups = (
        "1 K everywhere",
        *(f"1 K over {1e3 * SPAN:.0f} mm in {axis}" for axis in "xy"),
    )
    return table(
        "Drift of the middle of the platform [nm], and its rotation [µrad]; two-dimensional finite "
        "elements, drives removed, the base held and without expansion.",
        (
            Column("Stage", "long words"),
            *(Column(what, group=group) for group in groups for what in ("x", "y", "total", "yaw")),
        ),
        [[Cell(text) for text in row] for row in rows],
    )


def _stages(found: TraditionalComparison) -> tuple[ComparedStage, ...]:
    return (found.stage, *found.others, found.asymmetric)


def _small(value: float, decimals: int = 3) -> str:
    """Write a figure with as many decimals as a comparison needs; one that rounds to 0 as 0."""
    text = f"{value:.{decimals}f}"
    return text.replace("-", "−") if float(text) else "0"
