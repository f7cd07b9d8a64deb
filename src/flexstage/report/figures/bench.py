"""The bench in outline: the stage, what drives it, and the sensors that read it."""

import math
from typing import TYPE_CHECKING

from flexstage.report.figures.drawing import turning_arrow
from flexstage.report.figures.shapes import body_shapes, extent
from flexstage.report.figures.style import BODY, CYCLE, INK, MM, MUTED, PAPER, new_figure
from flexstage.stage import PiezoStack, Stage

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from flexstage.stage import Drive, Probe

_DRIVE, _PROBE = CYCLE[1], CYCLE[2]


def draw_bench(stage: Stage) -> "Figure":
    """Draw the stage with its drives and a sensor in front of each probe.

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
    x0, y0, x1, y1 = (v * MM for v in extent(shapes))
    size = max(x1 - x0, y1 - y0)
    box = (x0, y0, x1, y1)
    read = [p for p in stage.probes if p.direction is not None]
    ends = [point for probe in read for point in _reach(probe, box, size)]
    near = 0.1 * size
    left, right = (f([e[0] for e in ends], default=x0) for f in (min, max))
    low, high = (f([e[1] for e in ends], default=y0) for f in (min, max))
    x_low, x_high = min(x0, left) - near, max(x1, right) + near
    y_low, y_high = min(y0, low) - near, max(y1, high) + near
    scale = 4.0 / max(x_high - x_low, y_high - y_low)
    figure = new_figure(scale * (x_high - x_low), scale * (y_high - y_low))
    axes = figure.subplots()
    axes.set_axis_off()
    axes.set(xlim=(x_low, x_high), ylim=(y_low, y_high), aspect="equal")
    _outlines(axes, stage)
    for drive in stage.drives:
        _drive(axes, drive, size)
    for probe in stage.probes:
        if probe.direction is not None:
            _sensor(axes, probe, _reach(probe, box, size), size)
            continue
        arrow = {"arrowstyle": "-|>", "color": _PROBE, "linewidth": 1.0, "mutation_scale": 8}
        turning_arrow(axes, (MM * probe.at[0], MM * probe.at[1]), 0.04 * size, arrow)
    return figure


def _outlines(axes: "Axes", stage: Stage) -> None:
    from matplotlib.patches import PathPatch

    for shape in body_shapes(stage):
        colour = PAPER if shape.body.fixed else BODY
        axes.add_patch(PathPatch(shape.path(MM), facecolor=colour, edgecolor=MUTED, linewidth=0.5))


def _drive(axes: "Axes", drive: "Drive", size: float) -> None:
    """Draw the drive between its points, with its kind and name."""
    from matplotlib.patches import Polygon

    tip, foot = ((MM * p[0], MM * p[1]) for p in drive.at)
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


def _reach(
    probe: "Probe", box: tuple[float, float, float, float], size: float
) -> tuple[tuple[float, float], tuple[float, float]]:
    """Return where the sensor of a probe begins and ends, on its line outside the outline."""
    along = 1e-9  # of a direction, less is across
    x, y = MM * probe.at[0], MM * probe.at[1]
    c, s = probe.along
    edges = [
        ((box[2] if c > 0.0 else box[0]) - x) / c if abs(c) > along else math.inf,
        ((box[3] if s > 0.0 else box[1]) - y) / s if abs(s) > along else math.inf,
    ]
    start = max(min(edges), 0.0) + 0.07 * size
    end = start + 0.09 * size
    return (x + c * start, y + s * start), (x + c * end, y + s * end)


def _sensor(
    axes: "Axes",
    probe: "Probe",
    place: tuple[tuple[float, float], tuple[float, float]],
    size: float,
) -> None:
    """Draw a sensor on the line on which its probe reads."""
    from matplotlib.patches import Polygon

    x, y = MM * probe.at[0], MM * probe.at[1]
    c, s = probe.along
    start, end = place
    axes.plot((x, start[0]), (y, start[1]), color=_PROBE, linewidth=1.0, linestyle=(0, (5, 2)))
    axes.plot(x, y, "o", color=_PROBE, markersize=4)
    half = 0.028 * size
    corners = [(px - s * b, py + c * b) for px, py in place for b in (half, -half)]
    corners[2:] = corners[:1:-1]  # round the box, not across it
    axes.add_patch(Polygon(corners, facecolor=_PROBE, edgecolor=INK, linewidth=0.5))
    beyond = abs(s) > 0.5
    at = end if beyond else (0.5 * (start[0] + end[0]), 0.5 * (start[1] + end[1]) + half)
    axes.annotate(
        f"sensor {probe.name}", at, fontsize=7.5, color=INK,
        xytext=(0.0, -5.0 if s < -0.5 else 5.0), textcoords="offset points", ha="center",
        va="top" if s < -0.5 else "bottom", parse_math=False,
    )  # fmt: skip
