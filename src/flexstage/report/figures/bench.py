"""The bench in outline: the stage, what drives it, and the sensors that read it."""

import math
from typing import TYPE_CHECKING

from flexstage.report.figures.shapes import body_shapes, extent
from flexstage.report.figures.style import BODY, CYCLE, INK, MUTED, PAPER, new_figure
from flexstage.stage import PiezoStack, Stage

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from flexstage.stage import Drive, Probe

__all__ = ["draw_bench"]

_MM = 1e3
_DRIVE, _PROBE = CYCLE[1], CYCLE[2]


def draw_bench(stage: Stage) -> "Figure":
    """Draw the stage with its drives and a sensor in front of each probe.

    Parameters
    ----------
    stage : Stage
        The stage.

    Returns
    -------
    matplotlib.figure.Figure
        A sketch: outlines, drives and probes where the stage has them; a sensor stands outside the
        outline on the line of its probe.

    Examples
    --------
    >>> from flexstage.designs import design
    >>> figure = draw_bench(design("vgtu-piezo"))
    >>> [text.get_text() for text in figure.axes[0].texts]
    ['piezo stack x', 'piezo stack y', 'sensor x', 'sensor y']
    """
    shapes = body_shapes(stage)
    x0, y0, x1, y1 = (v * _MM for v in extent(shapes))
    size = max(x1 - x0, y1 - y0)
    room = 0.34 * size
    wide, high = x1 - x0 + 2.0 * room, y1 - y0 + 2.0 * room
    scale = 4.4 / max(wide, high)
    figure = new_figure(scale * wide, scale * high)
    axes = figure.subplots()
    axes.set_axis_off()
    axes.set(xlim=(x0 - room, x1 + room), ylim=(y0 - room, y1 + room), aspect="equal")
    _outlines(axes, stage)
    for drive in stage.drives:
        _drive(axes, drive, size)
    for probe in stage.probes:
        _sensor(axes, probe, (x0, y0, x1, y1), size)
    return figure


def _outlines(axes: "Axes", stage: Stage) -> None:
    from matplotlib.patches import PathPatch

    for shape in body_shapes(stage):
        colour = PAPER if shape.body.fixed else BODY
        axes.add_patch(PathPatch(shape.path(_MM), facecolor=colour, edgecolor=MUTED, linewidth=0.5))


def _drive(axes: "Axes", drive: "Drive", size: float) -> None:
    """Draw the drive between its points, with its kind and name."""
    from matplotlib.patches import Polygon

    tip, foot = ((_MM * p[0], _MM * p[1]) for p in drive.at)
    c, s = math.cos(drive.direction), math.sin(drive.direction)
    length = max((tip[0] - foot[0]) * c + (tip[1] - foot[1]) * s, 0.06 * size)
    half = 0.025 * size
    corners = [
        (tip[0] - c * a - s * b, tip[1] - s * a + c * b)
        for a, b in ((0.0, half), (0.0, -half), (length, -half), (length, half))
    ]
    axes.add_patch(Polygon(corners, facecolor=_DRIVE, edgecolor=INK, linewidth=0.5, alpha=0.9))
    middle = (tip[0] - 0.5 * c * length, tip[1] - 0.5 * s * length)
    kind = "piezo stack" if isinstance(drive, PiezoStack) else "screw"
    upright = abs(s) > abs(c)
    axes.annotate(
        f"{kind} {drive.name}", middle, fontsize=7.5, color=INK, parse_math=False,
        xytext=(9, 0) if upright else (0, 8), textcoords="offset points",
        ha="left" if upright else "center", va="center" if upright else "bottom",
        bbox={"facecolor": PAPER, "edgecolor": "none", "pad": 0.8, "alpha": 0.8},
    )  # fmt: skip


def _sensor(
    axes: "Axes", probe: "Probe", box: tuple[float, float, float, float], size: float
) -> None:
    """Draw a sensor outside the outline, on the line on which its probe reads."""
    from matplotlib.patches import Polygon

    x, y = _MM * probe.at[0], _MM * probe.at[1]
    c, s = math.cos(probe.direction), math.sin(probe.direction)
    reach = [
        (edge - at) / along
        for edge, at, along in (
            (box[2] if c > 0.0 else box[0], x, c),
            (box[3] if s > 0.0 else box[1], y, s),
        )
        if abs(along) > 1e-9
    ]
    start = min(r for r in reach if r >= 0.0) if any(r >= 0.0 for r in reach) else 0.0
    start += 0.07 * size
    axes.plot((x, x + c * start), (y, y + s * start), color=_PROBE, linewidth=1.0,
              linestyle=(0, (5, 2)))  # fmt: skip
    axes.plot(x, y, "o", color=_PROBE, markersize=4)
    half, length = 0.028 * size, 0.09 * size
    corners = [
        (x + c * a - s * b, y + s * a + c * b)
        for a, b in (
            (start, half), (start, -half), (start + length, -half), (start + length, half),
        )
    ]  # fmt: skip
    axes.add_patch(Polygon(corners, facecolor=_PROBE, edgecolor=INK, linewidth=0.5))
    end = start + length
    axes.annotate(
        f"sensor {probe.name}", (x + c * end, y + s * end), fontsize=7.5, color=INK,
        xytext=(0.0, 5.0 if s >= -0.5 else -5.0), textcoords="offset points",
        ha="center", va="bottom" if s >= -0.5 else "top", parse_math=False,
    )  # fmt: skip
