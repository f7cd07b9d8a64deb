"""Reading and drawing of stages, and the text of results, at a prompt."""

import os
from collections.abc import Mapping
from typing import TYPE_CHECKING

from flexstage.quantities.characteristic import Characteristics
from flexstage.quantities.quantity import display
from flexstage.stage import Stage
from flexstage.stage.designs import find_stage

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def read(source: str | os.PathLike[str], set: Mapping[str, object] | None = None) -> Stage:
    """Return the stage of a stage file, or a built-in design by its name.

    `set` replaces parameters, see `flexstage.stage.designs.find_stage`. A notebook shows the stage
    as a drawing. `read_record` reads measured data.

    Examples
    --------
    >>> import flexstage as fs
    >>> len(fs.read("vgtu-piezo").hinges)
    32
    >>> fs.read("vgtu-piezo", set={"x.lever_neck": "0.5 mm"}).name
    'vgtu-piezo-variation'
    """
    return find_stage(source, set)


def draw(stage: Stage | str | os.PathLike[str]) -> "Figure":
    """Draw a stage, or its source as for `read`, to scale, in millimetres."""
    from flexstage.report.figures.drawing import draw_stage

    return draw_stage(stage_of(stage))


def stage_of(source: Stage | str | os.PathLike[str]) -> Stage:
    """Return a stage, read from its source if need be."""
    return source if isinstance(source, Stage) else find_stage(source)


def _drawing(stage: Stage) -> str:
    from flexstage.report.figures.style import svg_text

    return svg_text(draw(stage))


# the class of a stage has no drawing; this room adds it for notebooks
Stage._notebook_html = _drawing

#: Quantities in the text of a result.
_HEADLINE = (
    "output_displacement", "transmission_ratio", "max_stress", "natural_frequency_hz",
    "natural_frequency_with_stack_hz",
)  # fmt: skip


def headline(figures: Characteristics) -> list[str]:
    """Return the main figures of a result."""
    lines = []
    for quantity in _HEADLINE:
        rows = figures.select(quantity)
        unit = display(quantity)
        texts = [f"{row.axis} {unit.text(row.value)}" for row in rows]
        if texts:
            lines.append(f"  {unit.label.lower()}: {', '.join(texts)} {unit.shown_unit}".rstrip())
    return lines
