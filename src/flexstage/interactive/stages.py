"""Stages at a prompt: read, taken from the built-in ones, drawn."""

import os
from typing import TYPE_CHECKING

from flexstage.designs import find_stage
from flexstage.stage import Stage

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def read(source: str | os.PathLike[str]) -> Stage:
    """Return the stage of a stage file; the name of a built-in design will do as well.

    Measured data are read by `read_record`.

    Parameters
    ----------
    source : str or os.PathLike
        Path of the stage file, or name of a design.

    Returns
    -------
    Stage
        The stage, which a notebook shows as a drawing.

    Raises
    ------
    StageError
        There is neither such a file nor such a design, or the file is no stage.

    Examples
    --------
    >>> import flexstage as fs
    >>> len(fs.read("vgtu-piezo").hinges)
    32
    """
    return find_stage(source)


def draw(stage: Stage | str | os.PathLike[str]) -> "Figure":
    """Draw a stage to scale, in millimetres.

    Parameters
    ----------
    stage : Stage or str or os.PathLike
        The stage, or what `read` takes.

    Returns
    -------
    matplotlib.figure.Figure
        The drawing, which a notebook shows and ``savefig`` writes.
    """
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
