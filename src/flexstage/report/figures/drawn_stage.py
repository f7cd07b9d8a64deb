"""Outlines of stages: recognised in a drawing, with issues, on a sheet, on a test bench."""

import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

from flexstage.report.figures.drawing import draw_bodies, draw_stage, turning_arrow
from flexstage.report.figures.shapes import (
    BodyShape,
    Placer,
    add_body,
    add_hatched,
    body_shapes,
    extent,
)
from flexstage.report.figures.style import (
    BODY,
    CYCLE,
    FIXED,
    HATCH,
    INK,
    MM,
    MUTED,
    PAPER,
    add_arrow,
    add_words,
    on_paper,
    one_panel,
    panels,
    set_title,
)
from flexstage.stage import Drive, PiezoStack, Probe, Stage

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from flexstage.stage import Issue
    from flexstage.stage.drawing.drawn_stage import DrawnStage


# pale colours that differ between neighbouring bodies
_PALE = ("#bcd9ee", "#f6d5b3", "#c5e5d5", "#f0d3e3", "#f5e6b8", "#d5d9f2", "#e3e8ee")
_COLOURS = {"sure": CYCLE[2], "likely": CYCLE[4], "doubtful": CYCLE[1]}


def draw_recognised(recognised: "DrawnStage") -> "Figure":
    """Draw the recognised bodies in colours, and the necks by number and certainty.

    Numbers are those of the names: 3 is ``neck-3``.
    """
    longest = 7.0  # longer side of the picture [inch]
    stage = recognised.stage
    shapes = body_shapes(stage)
    x0, y0, x1, y1 = (v * MM for v in extent(shapes))
    margin = 0.06 * max(x1 - x0, y1 - y0)
    x0, y0, x1, y1 = x0 - margin, y0 - margin, x1 + margin, y1 + margin
    per_inch = max(x1 - x0, y1 - y0) / longest
    width, height = (x1 - x0) / per_inch, (y1 - y0) / per_inch
    figure, axes = one_panel(max(width, 3.4) + 0.7, height + 1.4, grid=False)
    axes.set(xlim=(x0, x1), ylim=(y0, y1), xlabel="x [mm]", ylabel="y [mm]", aspect="equal")
    set_title(axes, f"{stage.name}: {len(stage.bodies)} bodies, {len(stage.hinges)} necks", 10.0)
    _bodies(axes, recognised)
    point = per_inch / 72.0
    placer = Placer((x0, y0, x1, y1))
    for hinge in stage.hinges:
        placer.take(hinge.at[0] * MM, hinge.at[1] * MM, 4.0 * point, 4.0 * point)
    for shape in shapes:
        number = shape.body.name.removeprefix("body-")
        x, y = (v * MM for v in shape.label_at)
        if 2.0 * shape.room * MM > 7.0 * point:
            axes.text(
                x, y, number, color=MUTED, fontsize=6.5, ha="center", va="center_baseline", zorder=6
            )
            placer.take(x, y, 4.5 * len(number) * point, 7.0 * point)
    _necks(axes, recognised, placer, point)
    _legend(axes, recognised)
    return figure


def _bodies(axes: "Axes", recognised: "DrawnStage") -> None:
    stage = recognised.stage
    shapes = body_shapes(stage)
    number = {b.name: k for k, b in enumerate(stage.bodies)}
    joined: dict[str, set[str]] = {b.name: set() for b in stage.bodies}
    for hinge in stage.hinges:
        a, b = hinge.bodies
        joined[a].add(b)
        joined[b].add(a)
    colours: dict[str, int] = {}
    for body in stage.bodies:
        # the first colour of none of its neighbours, from a start of its own
        used = {colours[n] for n in joined[body.name] if n in colours}
        order = [(number[body.name] + k) % len(_PALE) for k in range(len(_PALE))]
        colours[body.name] = next((c for c in order if c not in used), order[0])
    for shape in shapes:
        body = shape.body
        add_hatched(axes, shape, FIXED if body.fixed else _PALE[colours[body.name]])


def _necks(axes: "Axes", recognised: "DrawnStage", placer: Placer, point: float) -> None:
    from matplotlib.patheffects import withStroke

    for hinge, neck in zip(recognised.stage.hinges, recognised.necks, strict=True):
        colour = _COLOURS[neck.certainty]
        half = 0.5 * hinge.profile.neck_thickness
        ends = [hinge.to_plane(0.0, across) for across in (-half, half)]
        axes.plot(
            [p[0] * MM for p in ends], [p[1] * MM for p in ends],
            color=colour, linewidth=2.0, solid_capstyle="butt", zorder=5,
        )  # fmt: skip
        x, y = hinge.at[0] * MM, hinge.at[1] * MM
        axes.plot(x, y, "o", color=colour, markersize=2.6, markeredgewidth=0, zorder=5)
        text = hinge.name.removeprefix("neck-")
        width, height = (0.64 * len(text) + 0.2) * 6.5 * point, 7.0 * point
        place = placer.place(x, y, width, height, nearest=2.0 * point)
        axes.text(
            *place, text, color=colour, fontsize=6.5, fontweight="bold", zorder=7,
            ha="center", va="center_baseline", in_layout=False,
            path_effects=[withStroke(linewidth=1.6, foreground=PAPER)],
        )  # fmt: skip


def _legend(axes: "Axes", recognised: "DrawnStage") -> None:
    """Draw the legend of the colours of the necks, below the picture."""
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    certainties = [n.certainty for n in recognised.necks]
    handles: list[Line2D | Patch] = [
        Line2D([], [], color=colour, linewidth=2.0, label=f"{certainties.count(word)} {word}")
        for word, colour in _COLOURS.items()
        if word in certainties
    ]
    handles.append(Patch(facecolor=FIXED, edgecolor=HATCH, hatch="///", label="fixed"))
    axes.legend(
        handles=handles, loc="upper center", bbox_to_anchor=(0.5, -0.1), ncols=4, fontsize=7,
        frameon=False,
    )  # fmt: skip


_SEVERITIES = {"error": CYCLE[1], "warning": CYCLE[4]}
#: Most issues with a mark: more would cover the drawing.
MARKED = 12


def draw_checked(stage: Stage, issues: Sequence["Issue"]) -> "Figure":
    """Draw a stage with a numbered ring at each issue, in their order.

    Examples
    --------
    >>> from flexstage.stage.designs import find_stage
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
    size = 0.022 * max(x1 - x0, y1 - y0) * MM
    occupied: list[tuple[float, float]] = []
    for number, issue in enumerate(issues[:MARKED], start=1):
        places = [at for name in issue.what if (at := _place(stage, shapes, name)) is not None]
        if not places:
            continue
        colour = _SEVERITIES[issue.severity]
        for x, y in places:
            axes.plot(x, y, "o", markersize=11, markerfacecolor="none", markeredgecolor=colour,
                      markeredgewidth=1.8, zorder=9)  # fmt: skip
        _number(axes, number, places[0], size, occupied, colour)
    return figure


def _place(stage: Stage, shapes: dict[str, BodyShape], name: str) -> tuple[float, float] | None:
    """Return the position of a hinge, body, drive or probe [mm]; None of other names."""
    places = {drive.name: drive.at[0] for drive in stage.drives}
    places |= {probe.name: probe.at for probe in stage.probes}
    places |= {body: shape.label_at for body, shape in shapes.items()}
    places |= {hinge.name: hinge.at for hinge in stage.hinges}
    return (places[name][0] * MM, places[name][1] * MM) if name in places else None


def _number(
    axes: "Axes",
    number: int,
    at: tuple[float, float],
    size: float,
    occupied: list[tuple[float, float]],
    colour: str,
) -> None:
    """Draw a number next to a ring, away from other numbers."""
    place = at
    for k in range(24):
        angle, radius = math.radians(45 + 45 * k), (1.7 + 0.9 * (k // 8)) * size
        place = (at[0] + radius * math.cos(angle), at[1] + radius * math.sin(angle))
        if all(math.dist(place, other) > 1.8 * size for other in occupied):
            break
    occupied.append(place)
    box = {"boxstyle": "circle,pad=0.25", "facecolor": colour, "edgecolor": "none"}
    axes.text(*place, str(number), color=PAPER, fontsize=7, fontweight="bold", ha="center",
              va="center_baseline", bbox=box, zorder=10, gid="issue", in_layout=False)  # fmt: skip


#: Size of a stage with its name [inch].
_WIDTH, _HEIGHT = 2.5, 2.7
#: Height of the window of its drawing [inch], and size of the window relative to the stage.
_TALL, _ROOM = 2.2, 1.12


def draw_contact_sheet(stages: Mapping[str, Stage]) -> "Figure":
    """Draw stages side by side, each scaled to its place, with its name and size.

    Blue points are necks; arrows show the directions of drives.

    Examples
    --------
    >>> from flexstage.stage.designs import design
    >>> figure = draw_contact_sheet({"parallelogram": design("parallelogram")})
    >>> len(figure.axes)
    1
    """
    most_columns = 4
    columns = min(most_columns, len(stages))
    rows = math.ceil(len(stages) / columns)
    figure, grid = panels(columns * _WIDTH, rows * _HEIGHT, len(stages), columns, grid=False)
    for axes, (name, stage) in zip(grid, stages.items(), strict=True):
        axes.set_axis_off()
        _small_stage(axes, name, stage)
    return figure


def _small_stage(axes: "Axes", name: str, stage: Stage) -> None:
    shapes = body_shapes(stage)
    draw_bodies(axes, stage, shapes)
    x0, y0, x1, y1 = (v * MM for v in extent(shapes))
    longest = max(x1 - x0, y1 - y0)
    # one shape of window for all, so that names are aligned
    x, y = 0.5 * (x0 + x1), 0.5 * (y0 + y1)
    per_inch = _ROOM * max((x1 - x0) / _WIDTH, (y1 - y0) / _TALL) / 2.0
    axes.set(
        xlim=(x - per_inch * _WIDTH, x + per_inch * _WIDTH),
        ylim=(y - per_inch * _TALL, y + per_inch * _TALL),
        aspect="equal",
    )
    xs, ys = zip(*(hinge.at for hinge in stage.hinges), strict=True) if stage.hinges else ((), ())
    axes.plot(
        [x * MM for x in xs], [y * MM for y in ys], "o", color=CYCLE[0], markersize=2.0,
        markeredgewidth=0, zorder=5,
    )  # fmt: skip
    for drive in stage.drives:
        x, y = (v * MM for v in drive.at[0])
        back = 0.13 * longest
        start = (x - back * math.cos(drive.direction), y - back * math.sin(drive.direction))
        add_arrow(axes, (x, y), start, CYCLE[1], zorder=6)
    axes.set_title(name, fontsize=8, fontweight="bold", loc="center", pad=12)
    size_text = f"{x1 - x0:.0f} mm x {y1 - y0:.0f} mm, {len(stage.hinges)} hinges"
    axes.text(
        0.5, 1.0, size_text, transform=axes.transAxes, ha="center", va="bottom", fontsize=6.5,
        color=MUTED,
    )  # fmt: skip


def draw_bench(stage: Stage) -> "Figure":
    """Draw the stage with its drives and a sensor in front of each probe.

    A sketch of outlines, drives and probes; each sensor is outside the outline, in line with its
    probe.

    Examples
    --------
    >>> from flexstage.stage.designs import design
    >>> figure = draw_bench(design("vgtu-piezo"))
    >>> [text.get_text() for text in figure.axes[0].texts]
    ['piezo stack x', 'piezo stack y', 'sensor x', 'sensor y']
    """
    shapes = body_shapes(stage)
    x0, y0, x1, y1 = (v * MM for v in extent(shapes))
    size = max(x1 - x0, y1 - y0)
    box = (x0, y0, x1, y1)
    probes = [p for p in stage.probes if p.direction is not None]
    ends = [point for probe in probes for point in _reach(probe, box, size)]
    near = 0.1 * size
    left, right = (f([e[0] for e in ends], default=x0) for f in (min, max))
    low, high = (f([e[1] for e in ends], default=y0) for f in (min, max))
    x_low, x_high = min(x0, left) - near, max(x1, right) + near
    y_low, y_high = min(y0, low) - near, max(y1, high) + near
    scale = 4.0 / max(x_high - x_low, y_high - y_low)
    figure, axes = one_panel(scale * (x_high - x_low), scale * (y_high - y_low), grid=False)
    axes.set_axis_off()
    axes.set(xlim=(x_low, x_high), ylim=(y_low, y_high), aspect="equal")
    for shape in shapes:
        add_body(axes, shape, PAPER if shape.body.fixed else BODY, MUTED)
    for drive in stage.drives:
        _drive(axes, drive, size)
    for probe in stage.probes:
        if probe.direction is not None:
            _sensor(axes, probe, _reach(probe, box, size), size)
            continue
        at = (MM * probe.at[0], MM * probe.at[1])
        turning_arrow(axes, at, 0.04 * size, CYCLE[2], 1.0, 8)
    return figure


def _drive(axes: "Axes", drive: Drive, size: float) -> None:
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
    axes.add_patch(Polygon(corners, facecolor=CYCLE[1], edgecolor=INK, linewidth=0.5, alpha=0.9))
    middle = (tip[0] - 0.5 * c * length, tip[1] - 0.5 * s * length)
    kind = "piezo stack" if isinstance(drive, PiezoStack) else "screw"
    upright = abs(s) > abs(c)
    add_words(
        axes,
        f"{kind} {drive.name}",
        middle,
        (9, 0) if upright else (0, 8),
        ha="left" if upright else "center",
        va="center" if upright else "bottom",
        bbox=on_paper(0.8, 0.8),
    )


def _reach(
    probe: Probe, box: tuple[float, float, float, float], size: float
) -> tuple[tuple[float, float], tuple[float, float]]:
    """Return the ends of the sensor of a probe, in line with it and outside the outline."""
    along = 1e-9  # a smaller component of a direction is 0
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
    probe: Probe,
    place: tuple[tuple[float, float], tuple[float, float]],
    size: float,
) -> None:
    """Draw a sensor in line with its probe."""
    from matplotlib.patches import Polygon

    x, y = MM * probe.at[0], MM * probe.at[1]
    c, s = probe.along
    start, end = place
    axes.plot((x, start[0]), (y, start[1]), color=CYCLE[2], linewidth=1.0, linestyle=(0, (5, 2)))
    axes.plot(x, y, "o", color=CYCLE[2], markersize=4)
    half = 0.028 * size
    corners = [(px - s * b, py + c * b) for px, py in place for b in (half, -half)]
    corners[2:] = corners[:1:-1]  # around the box, not across it
    axes.add_patch(Polygon(corners, facecolor=CYCLE[2], edgecolor=INK, linewidth=0.5))
    beyond = abs(s) > 0.5
    at = end if beyond else (0.5 * (start[0] + end[0]), 0.5 * (start[1] + end[1]) + half)
    add_words(
        axes,
        f"sensor {probe.name}",
        at,
        (0.0, -5.0 if s < -0.5 else 5.0),
        ha="center",
        va="top" if s < -0.5 else "bottom",
    )
