"""Drawing of a stage: bodies, hinges, drives and probes, with a key of their names."""

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal

from flexstage.report.figures.shapes import (
    BodyShape,
    Placer,
    add_hatched,
    body_shapes,
    extent,
)
from flexstage.report.figures.style import (
    BODY,
    CYCLE,
    DRIVEN,
    FIXED,
    INK,
    MM,
    MUTED,
    PAPER,
    PLATFORM,
    add_arrow,
    one_panel,
    panels,
    set_title,
    shortened,
)
from flexstage.stage import Drive, Screw, Stage

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_HINGE, _DRIVE, _PROBE = CYCLE[0], CYCLE[1], CYCLE[2]
#: Longer side of the drawing itself [inch], with and without a key.
_LONGEST, _ALONE = 7.2, 4.2
#: Width of a column of the key, and height of a row [inch].
_COLUMN, _ROW = 1.45, 0.155


@dataclass(frozen=True, slots=True, kw_only=True)
class _Entry:
    """A row of the key."""

    kind: Literal["heading", "disc", "number", "arrow", "swatch", "gap"]
    """``heading``, ``disc`` (a number in a disc), ``number``, ``arrow``, ``swatch`` or ``gap``."""
    text: str = ""
    """The name."""
    mark: str = ""
    """The number in the drawing."""
    detail: str = ""
    """The text at the right end of the row."""
    colour: str = INK
    """Colour of the mark."""


def draw_stage(stage: Stage, *, key: bool = True) -> "Figure":
    """Draw a stage to scale, in millimetres.

    With `key`, bodies and hinges are numbered, and a key next to the drawing lists all names.

    Examples
    --------
    >>> from flexstage.stage.designs import design
    >>> figure = draw_stage(design("vgtu-piezo"))
    >>> len(figure.axes)
    2
    """
    shapes = body_shapes(stage)
    x0, y0, x1, y1 = (v * MM for v in extent(shapes))
    longest = max(x1 - x0, y1 - y0)
    margin = 0.07 * longest
    x0, y0, x1, y1 = x0 - margin, y0 - margin, x1 + margin, y1 + margin
    per_inch = max(x1 - x0, y1 - y0) / (_LONGEST if key else _ALONE)
    width, height = (x1 - x0) / per_inch, (y1 - y0) / per_inch
    figure_height = max(height, 3.4)
    width = max(width, 2.5)
    if key:
        columns = _arrange(_entries(stage, shapes), figure_height)
        key_width = len(columns) * _COLUMN
        figure, (axes, key_axes) = panels(
            width + key_width + 0.7,
            figure_height + 0.8,
            2,
            2,
            grid=False,
            width_ratios=(width, key_width),
        )
        _draw_key(key_axes, columns, figure_height)
    else:
        figure, axes = one_panel(width + 0.7, height + 0.8, grid=False)
    axes.set(xlim=(x0, x1), ylim=(y0, y1), xlabel="x [mm]", ylabel="y [mm]", aspect="equal")
    if key:
        set_title(axes, stage.title or stage.name, 10.0)

    draw_bodies(axes, stage, shapes)
    # one typographic point in millimetres of the drawing, the unit of label sizes
    point = per_inch / 72.0
    placer = Placer((x0, y0, x1, y1))
    for drive in stage.drives:
        _drive(axes, drive, placer, longest, point)
    for hinge in stage.hinges:
        placer.take(hinge.at[0] * MM, hinge.at[1] * MM, 3.0 * point, 3.0 * point)
    _probes(axes, stage, placer, longest, point)
    if key:
        _numbers(axes, shapes, placer, point)
        _hinges(axes, stage, placer, point)
    return figure


def fill_of(stage: Stage, name: str) -> str:
    """Return the colour of a body by its function."""
    if stage.body(name).fixed:
        return FIXED
    carries = [probe.body for probe in stage.probes] + [drive.reacts for drive in stage.drives]
    if name in carries:
        return PLATFORM
    if any(name == drive.pushes for drive in stage.drives):
        return DRIVEN
    return BODY


def draw_bodies(axes: "Axes", stage: Stage, shapes: tuple[BodyShape, ...]) -> None:
    """Draw the bodies with their holes, coloured by function."""
    for shape in shapes:
        add_hatched(axes, shape, fill_of(stage, shape.body.name))
        for hole in shape.body.mounting_holes:
            x, y = hole.centre[0] * MM, hole.centre[1] * MM
            arm = 1.35 * hole.radius * MM
            for line in (((x - arm, x + arm), (y, y)), ((x, x), (y - arm, y + arm))):
                axes.plot(*line, color=MUTED, linewidth=0.5, linestyle=(0, (6, 2, 1, 2)), zorder=2)


def _drive(axes: "Axes", drive: Drive, placer: Placer, longest: float, point: float) -> None:
    """Draw the drive as a bar between its points, with an arrow in its direction."""
    from matplotlib.patches import Polygon

    tip = (drive.at[0][0] * MM, drive.at[0][1] * MM)
    c, s = math.cos(drive.direction), math.sin(drive.direction)
    gap = (tip[0] - drive.at[1][0] * MM) * c + (tip[1] - drive.at[1][1] * MM) * s
    # a screw extends back through its body
    length = max(gap, 0.11 * longest if isinstance(drive, Screw) else 0.08 * longest)
    half = drive.patch_half_width * MM

    def at(along: float, across: float) -> tuple[float, float]:
        return (tip[0] + c * along - s * across, tip[1] + s * along + c * across)

    corners = [at(0, -half), at(0, half), at(-length, half), at(-length, -half)]
    axes.add_patch(
        Polygon(corners, facecolor=PAPER, edgecolor=_DRIVE, linewidth=0.9, alpha=0.85, zorder=3)
    )
    if isinstance(drive, Screw):
        threads = int(length // (0.9 * half)) or 1
        for k in range(1, threads):
            a, b = at(-length * k / threads, -half), at(-length * (k - 0.5) / threads, half)
            axes.plot((a[0], b[0]), (a[1], b[1]), color=_DRIVE, linewidth=0.5, zorder=3)
    add_arrow(axes, at(-0.06 * length, 0), at(-0.62 * length, 0), _DRIVE, 1.6, 11, zorder=4)
    middle = at(-0.5 * length, 0)
    placer.take(*middle, abs(c) * length + abs(s) * 2 * half, abs(s) * length + abs(c) * 2 * half)
    _label(axes, placer, drive.name, middle, half + 1.5 * point, _DRIVE, point)


def _probes(axes: "Axes", stage: Stage, placer: Placer, longest: float, point: float) -> None:
    reach = 0.07 * longest
    for probe in stage.probes:
        x, y = probe.at[0] * MM, probe.at[1] * MM
        axes.plot(x, y, "D", color=_PROBE, markersize=4, zorder=6)
        placer.take(x, y, 6 * point, 6 * point)
        if probe.direction is None:
            turning_arrow(axes, (x, y), 0.5 * reach, _PROBE, 1.2, 9)
            placer.take(x, y, 1.1 * reach, 1.1 * reach)
            continue
        tip = (x + reach * probe.along[0], y + reach * probe.along[1])
        add_arrow(axes, tip, (x, y), _PROBE, 1.2, 9, zorder=6)
        for k in range(1, 5):
            at = (x + (tip[0] - x) * k / 4, y + (tip[1] - y) * k / 4)
            placer.take(*at, reach / 4, reach / 4)
    for probe in stage.probes:
        x, y = probe.at[0] * MM, probe.at[1] * MM
        c, s = (0.0, 0.9) if probe.direction is None else probe.along
        tip = (x + reach * c, y + reach * s)
        _label(axes, placer, probe.name, tip, 2 * point, _PROBE, point)


def turning_arrow(
    axes: "Axes",
    centre: tuple[float, float],
    radius: float,
    colour: str,
    width: float,
    head: float,
) -> None:
    """Draw an arrow of three quarters of a turn to the left: a measured rotation.

    Colour, width and head are those of a straight arrow.
    """
    angles = [math.radians(a) for a in range(-135, 136, 5)]
    x = [centre[0] + radius * math.cos(a) for a in angles]
    y = [centre[1] + radius * math.sin(a) for a in angles]
    axes.plot(x, y, color=colour, linewidth=width, zorder=6)
    # long enough for the head
    near = (
        x[-1] + 0.3 * radius * math.sin(angles[-1]),
        y[-1] - 0.3 * radius * math.cos(angles[-1]),
    )
    add_arrow(axes, (x[-1], y[-1]), near, colour, width, head, zorder=6)


def _label(
    axes: "Axes",
    placer: Placer,
    text: str,
    at: tuple[float, float],
    nearest: float,
    colour: str,
    point: float,
) -> None:
    width, height = (5.2 * len(text) + 4) * point, 11.0 * point
    place = placer.place(*at, width, height, nearest=nearest)
    axes.text(
        *place, text, color=colour, fontsize=8, fontweight="bold", zorder=8, **_middle(), **_halo()
    )


def _numbers(axes: "Axes", shapes: tuple[BodyShape, ...], placer: Placer, point: float) -> None:
    """Draw the number of each body in it, on a dark disc."""
    for number, shape in enumerate(shapes, start=1):
        x, y = (v * MM for v in shape.label_at)
        size = 6.5 if shape.room * MM > 6.0 * point else 5.0
        width = (1.25 if number < 10 else 1.75) * size * point
        if placer.is_free(x, y, width, 1.4 * size * point):
            placer.take(x, y, width, 1.4 * size * point)
        else:
            x, y = placer.place(x, y, width, 1.4 * size * point, nearest=0.0)
        box = {"boxstyle": "round,pad=0.18", "facecolor": INK, "edgecolor": "none"}
        axes.text(x, y, str(number), color=PAPER, fontsize=size, bbox=box, zorder=7, **_middle())


def _hinges(axes: "Axes", stage: Stage, placer: Placer, point: float) -> None:
    for number, hinge in enumerate(stage.hinges, start=1):
        x, y = hinge.at[0] * MM, hinge.at[1] * MM
        axes.plot(x, y, "o", color=_HINGE, markersize=2.2, markeredgewidth=0, zorder=5)
        size = 6.0
        text = str(number)
        width, height = (0.64 * len(text) + 0.2) * size * point, 1.05 * size * point
        place = placer.place(x, y, width, height, nearest=1.6 * point)
        if math.dist(place, (x, y)) > 2.2 * height:
            axes.plot((x, place[0]), (y, place[1]), color=_HINGE, linewidth=0.4, zorder=5)
        axes.text(
            *place, text, color=_HINGE, fontsize=size, fontweight="bold", zorder=7,
            **_middle(), **_halo(),
        )  # fmt: skip


def _middle() -> dict[str, Any]:
    return {"ha": "center", "va": "center_baseline"}


def _halo() -> dict[str, Any]:
    from matplotlib.patheffects import withStroke

    # a dollar sign in a name is no formula; labels stay in their axes, and measuring is slow
    return {
        "parse_math": False,
        "in_layout": False,
        "path_effects": [withStroke(linewidth=1.6, foreground=PAPER)],
    }


def _entries(stage: Stage, shapes: tuple[BodyShape, ...]) -> list[_Entry]:
    gap = _Entry(kind="gap")
    entries = [_Entry(kind="heading", text="Bodies")]
    entries += [
        _Entry(kind="disc", mark=str(number), text=shape.body.name)
        for number, shape in enumerate(shapes, start=1)
    ]
    entries += [gap, _Entry(kind="heading", text="Hinges", detail="neck, mm")]
    entries += [
        _Entry(
            kind="number",
            mark=str(number),
            text=hinge.name,
            detail=f"{hinge.profile.neck_thickness * MM:.3g}",
            colour=_HINGE,
        )
        for number, hinge in enumerate(stage.hinges, start=1)
    ]
    for noun, things, colour in (
        ("Drives", stage.drives, _DRIVE),
        ("Probes", stage.probes, _PROBE),
    ):
        if things:
            entries += [gap, _Entry(kind="heading", text=noun)]
            entries += [_Entry(kind="arrow", text=thing.name, colour=colour) for thing in things]
    used = {fill_of(stage, body.name) for body in stage.bodies}
    entries += [gap, _Entry(kind="heading", text="Colours")]
    entries += [
        _Entry(kind="swatch", text=text, colour=colour)
        for colour, text in (
            (FIXED, "fixed"),
            (PLATFORM, "platform"),
            (DRIVEN, "driven"),
            (BODY, "other body"),
        )
        if colour in used
    ]
    return entries


def _arrange(entries: list[_Entry], height: float) -> list[list[_Entry]]:
    """Break a key into columns of a height [inch]; the last row counts omitted entries."""
    most_columns = 4
    fit = max(int(height / _ROW), 8)
    columns = min(math.ceil(len(entries) / fit), most_columns)
    if len(entries) > columns * fit:
        omitted = len(entries) - columns * fit + 1
        entries = [*entries[: columns * fit - 1], _Entry(kind="gap", text=f"… and {omitted} more")]
    out: list[list[_Entry]] = [[]]
    for entry in entries:
        last_heading = entry.kind == "heading" and len(out[-1]) == fit - 1
        if len(out[-1]) == fit or (last_heading and len(out) < columns):
            out.append([])
        if out[-1] or entry.kind != "gap" or entry.text:
            out[-1].append(entry)
    return out


def _draw_key(axes: "Axes", columns: list[list[_Entry]], height: float) -> None:
    """Draw the key on axes of its own without a frame; height [inch]."""
    axes.set_axis_off()
    axes.set(xlim=(0.0, len(columns) * _COLUMN), ylim=(-height, 0.0))
    for number, column in enumerate(columns):
        left = number * _COLUMN
        for row, entry in enumerate(column):
            _draw_row(axes, entry, left, -(row + 0.6) * _ROW)


def _draw_row(axes: "Axes", entry: _Entry, left: float, y: float) -> None:
    from matplotlib.patches import Rectangle

    longest_name = 15

    def write(x: float, text: str, **style: Any) -> None:
        usual = {"va": "center_baseline", "fontsize": 7, "color": INK, "parse_math": False}
        # rows stay in their column, and measuring is slow
        axes.text(x, y, text, None, in_layout=False, **(usual | style))

    at = left + 0.14
    if entry.detail:
        write(left + _COLUMN - 0.18, entry.detail, ha="right", color=MUTED)
    if entry.kind == "heading":
        write(left, entry.text, fontsize=7.5, fontweight="bold")
        return
    if entry.kind == "gap":
        write(left + 0.3, entry.text, color=MUTED)
        return
    if entry.kind == "disc":
        box = {"boxstyle": "round,pad=0.16", "facecolor": INK, "edgecolor": "none"}
        write(at, entry.mark, ha="center", fontsize=5.5, color=PAPER, bbox=box)
    elif entry.kind == "number":
        write(at, entry.mark, ha="center", fontsize=6.5, color=entry.colour, fontweight="bold")
    elif entry.kind == "arrow":
        arrow = {"arrowstyle": "-|>", "color": entry.colour, "linewidth": 1.2}
        axes.annotate("", xy=(at + 0.13, y), xytext=(at - 0.13, y), arrowprops=arrow)
    else:
        corner = (at - 0.11, y - 0.045)
        look = {"facecolor": entry.colour, "edgecolor": INK, "linewidth": 0.4}
        axes.add_patch(Rectangle(corner, 0.22, 0.09, **look))
    write(left + 0.34, shortened(entry.text, longest_name - 3 * bool(entry.detail)))
