"""Stages at a prompt: read, taken from the built-in ones, drawn."""

import os
from typing import TYPE_CHECKING

from flexstage.designs import find_stage
from flexstage.stage import Stage

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def read(source: str | os.PathLike[str]) -> Stage:
    """Return the stage of a stage file; the name of a built-in design will do as well.

    A notebook shows it as a drawing. Measured data are read by `read_record`.

    Examples
    --------
    >>> import flexstage as fs
    >>> len(fs.read("vgtu-piezo").hinges)
    32
    """
    return find_stage(source)


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
