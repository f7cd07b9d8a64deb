"""A stage with what is wrong with it: each issue of its check is marked where it is."""

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

from flexstage.report.figures.drawing import draw_stage
from flexstage.report.figures.shapes import BodyShape, body_shapes, extent
from flexstage.report.figures.style import CYCLE, PAPER

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from flexstage.stage import Issue, Stage

_MM = 1e3
_COLOURS = {"error": CYCLE[1], "warning": CYCLE[4]}
#: More issues than that are not marked: their numbers would cover the drawing.
MARKED = 12


def draw_checked(stage: "Stage", issues: Sequence["Issue"]) -> "Figure":
    """Draw a stage, and a numbered ring at each thing that is wrong, in the order of the issues.

    Examples
    --------
    >>> from flexstage.designs import find_stage
    >>> from flexstage.stage import check
    >>> thin = find_stage("vgtu-piezo", {"x.lever_neck": "0.1 mm"})
    >>> figure = draw_checked(thin, check(thin))
    >>> [text.get_text() for text in figure.axes[0].texts if text.get_gid() == "issue"][:2]
    ['1', '2']
    """
    figure = draw_stage(stage, key=False)
    axes = figure.axes[0]
    shapes = {shape.body.name: shape for shape in body_shapes(stage)}
    x0, y0, x1, y1 = extent(tuple(shapes.values()))
    size = 0.022 * max(x1 - x0, y1 - y0) * _MM
    taken: list[tuple[float, float]] = []
    for number, issue in enumerate(issues[:MARKED], start=1):
        places = [at for name in issue.what if (at := _place(stage, shapes, name)) is not None]
        if not places:
            continue
        colour = _COLOURS[issue.severity]
        for x, y in places:
            axes.plot(x, y, "o", markersize=11, markerfacecolor="none", markeredgecolor=colour,
                      markeredgewidth=1.8, zorder=9)  # fmt: skip
        _number(axes, number, places[0], size, taken, colour)
    return figure


def _place(stage: "Stage", shapes: dict[str, BodyShape], name: str) -> tuple[float, float] | None:
    """Return where a hinge, body, drive or probe is [mm]."""
    for hinge in stage.hinges:
        if hinge.name == name:
            return hinge.at[0] * _MM, hinge.at[1] * _MM
    for probe in stage.probes:
        if probe.name == name and name not in shapes:
            return probe.at[0] * _MM, probe.at[1] * _MM
    for drive in stage.drives:
        if drive.name == name and name not in shapes:
            return drive.at[0][0] * _MM, drive.at[0][1] * _MM
    if name in shapes:
        x, y = shapes[name].label_at
        return x * _MM, y * _MM
    return None


def _number(
    axes: "Axes",
    number: int,
    at: tuple[float, float],
    size: float,
    taken: list[tuple[float, float]],
    colour: str,
) -> None:
    """Put a number beside a ring, where no other number stands."""
    place = at
    for k in range(24):
        angle, radius = math.radians(45 + 45 * k), (1.7 + 0.9 * (k // 8)) * size
        place = (at[0] + radius * math.cos(angle), at[1] + radius * math.sin(angle))
        if all(math.dist(place, other) > 1.8 * size for other in taken):
            break
    taken.append(place)
    box = {"boxstyle": "circle,pad=0.25", "facecolor": colour, "edgecolor": "none"}
    axes.text(*place, str(number), color=PAPER, fontsize=7, fontweight="bold", ha="center",
              va="center_baseline", bbox=box, zorder=10, gid="issue", in_layout=False)  # fmt: skip
