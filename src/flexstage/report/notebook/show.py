"""Stages at a prompt, read and drawn; and results, as text and as a data frame."""

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
    """Return the stage of a stage file; the name of a built-in design will do as well.

    What is `set` stands in place of its parameters, see `flexstage.stage.designs.find_stage`. A
    notebook shows it as a drawing. Measured data are read by `read_record`.

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
    """Draw a stage, or what `read` takes, to scale, in millimetres."""
    from flexstage.report.figures.drawing import draw_stage

    return draw_stage(stage_of(stage))


def stage_of(source: Stage | str | os.PathLike[str]) -> Stage:
    """Return a stage as it is, or what `read` gives."""
    return source if isinstance(source, Stage) else find_stage(source)


def _drawing(stage: Stage) -> str:
    from flexstage.report.figures.style import svg_text

    return svg_text(draw(stage))


# a stage knows nothing of drawings; with this room loaded a notebook shows one
Stage._notebook_html = _drawing

#: Quantities that the text of a result shows, of those that it has.
_HEADLINE = (
    "output_displacement", "transmission_ratio", "max_stress", "natural_frequency_hz",
    "natural_frequency_with_stack_hz",
)  # fmt: skip


def headline(figures: Characteristics) -> list[str]:
    """Return the figures that a result is known by."""
    lines = []
    for quantity in _HEADLINE:
        rows = figures.select(quantity)
        shown = display(quantity)
        texts = [f"{row.axis} {shown.text(row.value)}" for row in rows]
        if texts:
            lines.append(f"  {shown.label.lower()}: {', '.join(texts)} {shown.shown_unit}".rstrip())
    return lines
