"""The icon of an FMU: the plate of the stage, or a sketch of a flexure."""

import io
from typing import TYPE_CHECKING

import numpy as np

from flexstage.hysteresis.model import Array
from flexstage.stage import Circle, Stage
from flexstage.stage.contour import body_contour

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_PIXELS = 256
_HELD, _MOVED, _EDGE = "#9aa5b1", "#3f7fbf", "#1f2d3d"


def icon_png(stage: Stage | None) -> bytes:
    """Return a small square PNG: the plate, or a block between two leaf springs, on no ground."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(2.56, 2.56), dpi=_PIXELS / 2.56, facecolor="none")
    axes = figure.add_axes((0.02, 0.02, 0.96, 0.96))
    axes.set_aspect("equal")
    axes.set_axis_off()
    if stage is None:
        _sketch(axes)
    else:
        _plate(axes, stage)
    axes.autoscale_view()
    out = io.BytesIO()
    # nothing of the computer or the time in the file: the same stage gives the same bytes
    FigureCanvasAgg(figure).print_png(out, metadata={"Software": None})
    return out.getvalue()


def _plate(axes: "Axes", stage: Stage) -> None:
    from matplotlib.patches import PathPatch
    from matplotlib.path import Path

    for body in stage.bodies:
        outline, holes = body_contour(stage, body)
        loops = (outline, *holes, *body.mounting_holes)
        rings = [(x.loop() if isinstance(x, Circle) else x).polyline(1e-4) for x in loops]
        # a ring that turns the other way round is a hole
        rings = [rings[0], *(ring[::-1] if _turns_left(ring) else ring for ring in rings[1:])]
        if not _turns_left(rings[0]):
            rings[0] = rings[0][::-1]
        paths = [Path(np.vstack((ring, ring[:1])), closed=True) for ring in rings]
        colour = _HELD if body.fixed else _MOVED
        axes.add_patch(
            PathPatch(Path.make_compound_path(*paths), facecolor=colour, edgecolor=_EDGE, lw=0.4)
        )


def _turns_left(ring: Array) -> bool:
    x, y = ring.T
    return float(np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y)) > 0.0


def _sketch(axes: "Axes") -> None:
    from matplotlib.patches import Rectangle

    for x in (0.0, 8.6):
        axes.add_patch(Rectangle((x, 0.0), 1.4, 10.0, facecolor=_HELD, edgecolor=_EDGE, lw=1.0))
    for y in (2.2, 7.4):
        axes.add_patch(Rectangle((1.4, y), 7.2, 0.4, facecolor=_EDGE, edgecolor="none"))
    axes.add_patch(Rectangle((3.2, 1.4), 3.6, 7.2, facecolor=_MOVED, edgecolor=_EDGE, lw=1.0))
