"""Many stages on one sheet, each small, to choose from."""

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING

from flexstage.report.figures.drawing import draw_bodies
from flexstage.report.figures.shapes import body_shapes, extent
from flexstage.report.figures.style import CYCLE, MUTED, new_figure
from flexstage.stage import Stage

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_MM = 1e3
_COLUMNS = 4
#: Size of a stage with its name [inch].
_WIDTH, _HEIGHT = 2.5, 2.7
#: Height of the window that it is drawn in [inch], and how much larger than the stage that is.
_TALL, _ROOM = 2.2, 1.12


def draw_contact_sheet(stages: Mapping[str, Stage]) -> "Figure":
    """Draw stages beside one another, each as large as there is room, with its name and its size.

    Blue points are necks; arrows show how drives push.

    Examples
    --------
    >>> from flexstage.designs import design
    >>> figure = draw_contact_sheet({"parallelogram": design("parallelogram")})
    >>> len(figure.axes)
    1
    """
    columns = min(_COLUMNS, len(stages))
    rows = math.ceil(len(stages) / columns)
    figure = new_figure(columns * _WIDTH, rows * _HEIGHT)
    grid = figure.subplots(rows, columns, squeeze=False).ravel()
    for axes in grid:
        axes.set_axis_off()
    for axes, (name, stage) in zip(grid, stages.items(), strict=False):
        _draw(axes, name, stage)
    return figure


def _draw(axes: "Axes", name: str, stage: Stage) -> None:
    shapes = body_shapes(stage)
    draw_bodies(axes, stage, shapes)
    x0, y0, x1, y1 = (v * _MM for v in extent(shapes))
    longest = max(x1 - x0, y1 - y0)
    # a window of one shape for all, so that names stand in rows
    x, y = 0.5 * (x0 + x1), 0.5 * (y0 + y1)
    per_inch = _ROOM * max((x1 - x0) / _WIDTH, (y1 - y0) / _TALL) / 2.0
    axes.set(
        xlim=(x - per_inch * _WIDTH, x + per_inch * _WIDTH),
        ylim=(y - per_inch * _TALL, y + per_inch * _TALL),
        aspect="equal",
    )
    xs, ys = zip(*(hinge.at for hinge in stage.hinges), strict=True) if stage.hinges else ((), ())
    axes.plot(
        [x * _MM for x in xs], [y * _MM for y in ys], "o", color=CYCLE[0], markersize=2.0,
        markeredgewidth=0, zorder=5,
    )  # fmt: skip
    arrow = {"arrowstyle": "-|>", "color": CYCLE[1], "linewidth": 1.2, "mutation_scale": 8}
    for drive in stage.drives:
        x, y = (v * _MM for v in drive.at[0])
        back = 0.13 * longest
        start = (x - back * math.cos(drive.direction), y - back * math.sin(drive.direction))
        axes.annotate("", xy=(x, y), xytext=start, arrowprops=arrow, zorder=6)
    axes.set_title(name, fontsize=8, fontweight="bold", loc="center", pad=12)
    said = f"{x1 - x0:.0f} mm x {y1 - y0:.0f} mm, {len(stage.hinges)} hinges"
    axes.text(
        0.5, 1.0, said, transform=axes.transAxes, ha="center", va="bottom", fontsize=6.5,
        color=MUTED,
    )  # fmt: skip
