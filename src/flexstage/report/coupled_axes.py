"""What all drives of a stage do to all of its axes, as tables and a picture."""

from collections.abc import Iterator

from flexstage.quantities import number
from flexstage.section import Content, Picture
from flexstage.system import Analysis, AxisAnalysis
from flexstage.system.coupled_axes import CoupledAxes
from flexstage.table import Table, table


def coupling_tables(found: CoupledAxes) -> Iterator[Table]:
    """Show the Jacobian, the decoupling matrix and the workspace of all drives."""
    turns = dict(zip(found.names, (unit == "rad" for unit in found.units), strict=True))
    yield table(
        "Jacobian: axis per elongation of each drive, the other drives held",
        ("axis", *(f"drive {name}" for name in found.drives), "<unit"),
        [
            (axis, *map(_figure, row), "µrad/µm" if turns[axis] else "µm/µm")
            for axis, row in zip(found.names, found.jacobian.tolist(), strict=True)
        ],
    )
    if found.independent:
        yield table(
            "Decoupling: elongation of each drive for one unit of an axis alone",
            ("drive", *(f"{axis} [µm/{'µrad' if turns[axis] else 'µm'}]" for axis in found.names)),
            [
                (drive, *map(_figure, row))
                for drive, row in zip(found.drives, found.decoupling.tolist(), strict=True)
            ],
        )
    reached = found.workspace
    if reached is None:
        return
    rows = [("all drives over their strokes", number(1e12 * reached.area), "µm²")]
    if len(reached.axes) > 2:
        rows = [
            ("at the middle rotation", number(1e12 * reached.area), "µm²"),
            ("at any rotation", number(1e12 * reached.projected_area), "µm²"),
            ("with the rotations", number(1e18 * reached.volume), "µm² µrad"),
        ]
    title = f"Workspace of all drives, {' and '.join(reached.axes[:2])}"
    yield table(title, ("what", "reached", "<unit"), rows)


def coupling_section(found: CoupledAxes | None) -> Iterator[Content]:
    """Show what all drives do together, where axes are coupled."""
    if found is None or not found.coupled:
        return
    yield (
        "The drives move the axes together. The Jacobian is for one drive at a time, all others "
        "held at no elongation; with the decoupling matrix they move one axis alone, as in the "
        "figures of each axis here."
    )
    yield from coupling_tables(found)
    if (reached := found.workspace) is not None:
        yield Picture(
            result=reached,
            title="workspace of all drives",
            caption="What all drives reach within their strokes. Arrows: the stroke of each by "
            "itself, from where all are at the lower end of theirs.",
            size="tiny",
        )


def cause_words(analysis: Analysis) -> str:
    """Say what stands before the name of an axis where something is said to come of it."""
    alone = all(len(axis.drives) == 1 for axis in analysis.axes)
    return "drive of" if alone else "motion of"


def full_stroke_words(axis: AxisAnalysis) -> str:
    """Say what the drives do in a picture of an axis at full stroke."""
    if len(axis.drives) == 1:
        return f"drive of {axis.axis} at full stroke, the others removed"
    return f"all drives together over the full stroke of {axis.axis} alone"


def _figure(value: float) -> str:
    return number(value) if abs(value) > 1e-12 else "≈ 0"
