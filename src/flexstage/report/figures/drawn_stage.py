"""What was found in a drawing: its bodies, and its necks with how sure each is."""

from typing import TYPE_CHECKING

from flexstage.report.figures.shapes import Placer, body_shapes, extent
from flexstage.report.figures.style import (
    CYCLE,
    FIXED,
    HATCH,
    INK,
    MUTED,
    PAPER,
    dress,
    entitle,
    new_figure,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from flexstage.stage.drawing.drawn_stage import DrawnStage

_MM = 1e3
_LONGEST = 7.0  # longer side of the picture [inch]
# bodies beside each other differ; they are no figures, so their colours only have to be pale
_PALE = ("#bcd9ee", "#f6d5b3", "#c5e5d5", "#f0d3e3", "#f5e6b8", "#d5d9f2", "#e3e8ee")
_COLOURS = {"sure": CYCLE[2], "likely": CYCLE[4], "doubtful": CYCLE[1]}


def draw_found(drawn: "DrawnStage") -> "Figure":
    """Draw the bodies of a drawing in colours, and its necks by number and certainty.

    Numbers are those of the names: 3 is ``neck-3``.
    """
    stage = drawn.stage
    shapes = body_shapes(stage)
    x0, y0, x1, y1 = (v * _MM for v in extent(shapes))
    margin = 0.06 * max(x1 - x0, y1 - y0)
    x0, y0, x1, y1 = x0 - margin, y0 - margin, x1 + margin, y1 + margin
    per_inch = max(x1 - x0, y1 - y0) / _LONGEST
    width, height = (x1 - x0) / per_inch, (y1 - y0) / per_inch
    figure = new_figure(max(width, 3.4) + 0.7, height + 1.4)
    axes = figure.subplots()
    dress(axes, grid=False)
    axes.set(xlim=(x0, x1), ylim=(y0, y1), xlabel="x [mm]", ylabel="y [mm]", aspect="equal")
    entitle(axes, f"{stage.name}: {len(stage.bodies)} bodies, {len(stage.hinges)} necks", 10.0)
    _bodies(axes, drawn)
    point = per_inch / 72.0
    placer = Placer((x0, y0, x1, y1))
    for hinge in stage.hinges:
        placer.take(hinge.at[0] * _MM, hinge.at[1] * _MM, 4.0 * point, 4.0 * point)
    for shape in shapes:
        number = shape.body.name.removeprefix("body-")
        x, y = (v * _MM for v in shape.label_at)
        if 2.0 * shape.room * _MM > 7.0 * point:
            axes.text(
                x, y, number, color=MUTED, fontsize=6.5, ha="center", va="center_baseline", zorder=6
            )
            placer.take(x, y, 4.5 * len(number) * point, 7.0 * point)
    _necks(axes, drawn, placer, point)
    _legend(axes, drawn)
    return figure


def _bodies(axes: "Axes", drawn: "DrawnStage") -> None:
    from matplotlib.patches import PathPatch

    stage = drawn.stage
    shapes = body_shapes(stage)
    number = {b.name: k for k, b in enumerate(stage.bodies)}
    joined: dict[str, set[str]] = {b.name: set() for b in stage.bodies}
    for hinge in stage.hinges:
        a, b = hinge.bodies
        joined[a].add(b)
        joined[b].add(a)
    colours: dict[str, int] = {}
    for body in stage.bodies:
        # the first colour that none of its neighbours has, beginning elsewhere each time
        taken = {colours[n] for n in joined[body.name] if n in colours}
        order = [(number[body.name] + k) % len(_PALE) for k in range(len(_PALE))]
        colours[body.name] = next((c for c in order if c not in taken), order[0])
    for shape in shapes:
        body = shape.body
        fill = FIXED if body.fixed else _PALE[colours[body.name]]
        path = shape.path(_MM)
        axes.add_patch(PathPatch(path, facecolor=fill, edgecolor=INK, linewidth=0.5, zorder=1))
        if body.fixed:
            axes.add_patch(
                PathPatch(path, facecolor="none", edgecolor=HATCH, hatch="///", linewidth=0)
            )


def _necks(axes: "Axes", drawn: "DrawnStage", placer: Placer, point: float) -> None:
    from matplotlib.patheffects import withStroke

    for hinge, neck in zip(drawn.stage.hinges, drawn.necks, strict=True):
        colour = _COLOURS[neck.certainty]
        half = 0.5 * hinge.profile.neck_thickness
        ends = [hinge.to_plane(0.0, across) for across in (-half, half)]
        axes.plot(
            [p[0] * _MM for p in ends], [p[1] * _MM for p in ends],
            color=colour, linewidth=2.0, solid_capstyle="butt", zorder=5,
        )  # fmt: skip
        x, y = hinge.at[0] * _MM, hinge.at[1] * _MM
        axes.plot(x, y, "o", color=colour, markersize=2.6, markeredgewidth=0, zorder=5)
        text = hinge.name.removeprefix("neck-")
        width, height = (0.64 * len(text) + 0.2) * 6.5 * point, 7.0 * point
        place = placer.place(x, y, width, height, nearest=2.0 * point)
        axes.text(
            *place, text, color=colour, fontsize=6.5, fontweight="bold", zorder=7,
            ha="center", va="center_baseline", in_layout=False,
            path_effects=[withStroke(linewidth=1.6, foreground=PAPER)],
        )  # fmt: skip


def _legend(axes: "Axes", drawn: "DrawnStage") -> None:
    """Say what the colours of the necks mean, below the picture."""
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    found = [n.certainty for n in drawn.necks]
    handles: list[Line2D | Patch] = [
        Line2D([], [], color=colour, linewidth=2.0, label=f"{found.count(word)} {word}")
        for word, colour in _COLOURS.items()
        if word in found
    ]
    handles.append(Patch(facecolor=FIXED, edgecolor=HATCH, hatch="///", label="held"))
    axes.legend(
        handles=handles, loc="upper center", bbox_to_anchor=(0.5, -0.1), ncols=4, fontsize=7,
        frameon=False,
    )  # fmt: skip
