"""Motion of rigid bodies: at full stroke, over the stroke, in modes; the workspace of drives."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from flexstage.base.arrays import Array
from flexstage.base.errors import ModelError
from flexstage.quantities.quantity import number, round_below
from flexstage.report.figures.shapes import BodyShape, add_body, body_shapes, extent
from flexstage.report.figures.style import (
    CYCLE,
    FIXED,
    INK,
    LONG_DASHED,
    MM,
    MUTED,
    PAPER,
    UM,
    add_arrow,
    add_heading,
    add_legend,
    label_axes,
    one_panel,
    panels,
    set_title,
)
from flexstage.stage import Stage
from flexstage.system import Analysis, AxisAnalysis, MechanicalSystem
from flexstage.system.coupled_axes import ReachableArea

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from flexstage.lumped.large_displacement import StrokePath


_COLOURS = "viridis"


def exaggeration(size: float, motion: float) -> float:
    """Return a round factor by which motion is exaggerated in a drawing.

    It is 1, 2 or 5 times a power of ten, and 1 without motion. Size of the drawn object and largest
    displacement are in one unit.

    Examples
    --------
    >>> exaggeration(0.2, 65e-6)
    50.0
    """
    # size of the largest motion in the drawing, relative to the stage
    drawn_size = 0.02
    return round_below(drawn_size * size / motion) if motion > 0.0 else 1.0


def elongation_words(result: AxisAnalysis) -> str:
    """Return the elongation of each drive of an axis at its full stroke."""
    words = [f"'{name}' {'+' * (w >= 0.0)}{number(w * 1e6)}" for name, w in result.drives.items()]
    return f"drive{'s' * (len(words) > 1)} {', '.join(words)} µm"


def full_stroke(analysis: Analysis, axis: AxisAnalysis) -> str:
    """Return the elongation of the drives at full stroke of an axis, and its reading."""
    unit = "µrad" if analysis.system.probe(axis.probe).unit == "rad" else "µm"
    reading = f"{number(axis.output_displacement * 1e6)} {unit}"
    return f"{elongation_words(axis)}: '{axis.probe}' reads {reading}"


def drawn_axis(analysis: Analysis, axis: str) -> AxisAnalysis:
    """Return the analysis of an axis.

    Raises
    ------
    ModelError
        There is no such axis.
    """
    analysed = next((a for a in analysis.axes if a.axis == axis), None)
    if analysed is None:
        raise ModelError(f"the analysis has no axis '{axis}'")
    return analysed


def draw_static_shape(analysis: Analysis, axis: str) -> "Figure":
    """Draw the stage with one drive at full stroke and the others removed.

    Motion is magnified by the factor in the title; a thin line shows the position at rest.
    """
    result = drawn_axis(analysis, axis)
    shapes = body_shapes(analysis.stage)
    x0, y0, x1, y1 = extent(shapes)
    size = max(x1 - x0, y1 - y0)
    motion = result.static.body_motion
    centres = {port.name: np.array(port.centre) for port in analysis.system.bodies}
    at_rest = (0.0, 0.0, 0.0)
    largest = max(
        float(_displacement(np.vstack(s.loops), centres[n], motion.get(n, at_rest)).max())
        for s in shapes
        if (n := s.body.name) in centres
    )
    factor = exaggeration(size, largest)

    # with room for the colour bar and the labels, also of a long, thin stage
    inch_per_metre = 5.1 / max(x1 - x0, 0.8 * (y1 - y0))
    figure, axes = one_panel(
        max(inch_per_metre * (x1 - x0), 2.0) + 1.1,
        max(inch_per_metre * (y1 - y0), 1.6) + 0.5,
        grid=False,
    )
    margin = 0.035 * size
    axes.set(
        xlim=((x0 - margin) * MM, (x1 + margin) * MM),
        ylim=((y0 - margin) * MM, (y1 + margin) * MM),
        xlabel="x [mm]",
        ylabel="y [mm]",
    )
    set_title(axes, f"{full_stroke(analysis, result)}; motion × {factor:g}")
    _bodies(axes, analysis, motion, factor, largest)
    _colour_bar(figure, axes, largest)
    return figure


def draw_modes(analysis: Analysis) -> "Figure":
    """Draw the lowest modes as motions of the bodies, each with its share of the largest one."""
    modes = analysis.modes["removed"]
    count = min(MOST_MODES, modes.frequency_hz.size)
    x0, y0, x1, y1 = (v * MM for v in extent(body_shapes(analysis.stage)))
    size = max(x1 - x0, y1 - y0)
    margin, columns, rows = 0.06 * size, min(3, count), math.ceil(count / 3)
    high = rows * (3.0 * (y1 - y0) / (x1 - x0) + 0.4)
    figure, grid = panels(3.2 * columns, high, count, columns, grid=False)
    for k, axes in enumerate(grid):
        axes.set(xlim=(x0 - margin, x1 + margin), ylim=(y0 - margin, y1 + margin))
        axes.set_axis_off()
        set_title(axes, f"{number(float(modes.frequency_hz[k]))} Hz, drives removed")
        motion = mode_motion(analysis.system, modes.shapes[:, k], analysis.stage)
        _bodies(axes, analysis, motion, MODE_AMPLITUDE * size / MM, 1.0)
    return figure


def _bodies(
    axes: "Axes",
    analysis: Analysis,
    motion: Mapping[str, tuple[float, float, float]],
    factor: float,
    largest: float,
) -> None:
    """Draw every body, displaced by its motion."""
    centres = {port.name: np.array(port.centre) for port in analysis.system.bodies}
    for shape in sorted(body_shapes(analysis.stage), key=lambda s: not s.body.fixed):
        name = shape.body.name
        moved = motion.get(name, (0.0, 0.0, 0.0))
        _body(axes, shape, centres.get(name), moved, factor, largest)
    # a picture sets the aspect of its axes, so this comes last
    axes.set_aspect("equal")


def _body(
    axes: "Axes",
    shape: BodyShape,
    centre: Array | None,
    motion: tuple[float, float, float],
    factor: float,
    largest: float,
) -> None:
    from matplotlib.transforms import Affine2D

    if shape.body.fixed or centre is None:
        add_body(axes, shape, FIXED, MUTED, 0.3)
        return
    add_body(axes, shape, "none", MUTED, 0.3, linestyle=(0, (3, 2)))
    # a rigid body stays rigid in the picture: it turns by the exaggerated angle
    ux, uy, angle = motion
    cx, cy = (float(c) * MM for c in centre)
    move = Affine2D().rotate_around(cx, cy, factor * angle)
    move = move.translate(factor * ux * MM, factor * uy * MM)
    low, high = np.vstack(shape.loops).min(axis=0), np.vstack(shape.loops).max(axis=0)
    gx, gy = np.meshgrid(np.linspace(low[0], high[0], 32), np.linspace(low[1], high[1], 32))
    field = _displacement(np.column_stack((gx.ravel(), gy.ravel())), centre, motion)
    picture = axes.imshow(
        field.reshape(gx.shape) * 1e6,
        extent=(low[0] * MM, high[0] * MM, low[1] * MM, high[1] * MM),
        origin="lower",
        interpolation="bilinear",
        cmap=_COLOURS,
        vmin=0.0,
        vmax=largest * 1e6,
        aspect="auto",
        transform=move + axes.transData,
        zorder=2,
    )
    add_body(axes, shape, "none", INK, 0.4, transform=move + axes.transData, zorder=3)
    picture.set_clip_path(shape.path(), move + axes.transData)


def _displacement(points: Array, centre: Array, motion: tuple[float, float, float]) -> Array:
    """Return the magnitude of the displacement of points of a rigid body."""
    ux, uy, angle = motion
    arm = points - centre
    return np.hypot(ux - angle * arm[:, 1], uy + angle * arm[:, 0])


def _colour_bar(figure: "Figure", axes: "Axes", largest: float) -> None:
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import Normalize

    scale = ScalarMappable(norm=Normalize(0.0, max(largest, 1e-12) * 1e6), cmap=_COLOURS)
    bar = figure.colorbar(scale, ax=axes, shrink=0.7, aspect=28, pad=0.02)
    bar.set_label("displacement [µm]", color=INK, fontsize=8)
    bar.ax.tick_params(color=MUTED, labelcolor=INK, labelsize=8)
    bar.outline.set_visible(False)


# smaller motions are rounding of the solution [m, rad]
_ROUNDING = 1e-13


def draw_stroke(path: "StrokePath", axis: str) -> "Figure":
    """Draw the deviation of an axis from the straight line of its first-order model.

    Deviation along the axis, across it, and rotation, over the elongation of the drive.
    """
    x, curves = path.displacement, stroke_curves(path)
    figure, grid = panels((5.1, 10.2, 10.2)[len(curves) - 1], 2.9, len(curves), len(curves))
    for axes, (label, values, unit) in zip(grid, curves, strict=True):
        factor, prefix = _scale(float(np.abs(values).max()))
        axes.plot(1e6 * x, factor * values, color=CYCLE[0], linewidth=1.4)
        axes.set_xlim(1e6 * x[0], 1e6 * x[-1])
        label_axes(axes, f"drive '{path.drive}' [µm]", f"{label} [{prefix}{unit}]")
    add_heading(
        figure,
        f"{axis}: {_quantity(path.along[-1] - path.along[0], 'm')} at full stroke; "
        f"straightness {_quantity(path.straightness, 'm')}, "
        f"rotation {_quantity(path.parasitic_rotation, 'rad')}",
    )
    return figure


def stroke_curves(path: "StrokePath") -> list[tuple[str, Array, str]]:
    """Return label, values and unit of each visible curve: one for a straight motion."""
    if path.displacement.size < 3:
        raise ModelError("a path needs at least three states to be drawn")
    x = path.displacement
    # the slope at the start of the stroke, from a parabola through the first three states
    slope = np.polyfit(x[:3], path.along[:3], 2)[1]
    along = path.along - path.along[0] - slope * (x - x[0])
    curves = [
        ("along, beyond first order", along, "m"),
        ("across, from the best-fit line", path.deviation, "m"),
        ("rotation", path.rotation - path.rotation[0], "rad"),
    ]
    return [c for c in curves if np.abs(c[1]).max() > _ROUNDING] or curves[:1]


def _scale(largest: float) -> tuple[float, str]:
    for factor, prefix in ((1e6, "µ"), (1e9, "n")):
        if largest * factor >= 0.1:
            return factor, prefix
    return 1e12, "p"


def _quantity(value: float, unit: str) -> str:
    if abs(value) < _ROUNDING:
        return "0"
    factor, prefix = _scale(abs(value))
    return f"{number(factor * value)} {prefix}{unit}"


#: Most modes of a figure for each condition of the drives.
MOST_MODES = 6
#: Largest motion of a mode in a drawing, relative to the size of the stage [1].
MODE_AMPLITUDE = 0.03


def mode_motion(
    system: MechanicalSystem, shape: NDArray[np.float64], stage: Stage
) -> dict[str, tuple[float, float, float]]:
    """Return the motion of every body in a mode, scaled so that the largest displacement is 1.

    Displacement x, y of the body's centre [1] and rotation [1/m] by body.
    """
    ports = {port.name: port for port in system.bodies}
    motion: dict[str, tuple[float, float, float]] = {}
    largest = 0.0
    for body_shape in body_shapes(stage):
        port = ports.get(body_shape.body.name)
        if port is None:
            continue
        ux, uy, angle = map(float, port.matrix @ shape)
        motion[port.name] = (ux, uy, angle)
        moved = _displacement(np.vstack(body_shape.loops), np.array(port.centre), motion[port.name])
        largest = max(largest, float(moved.max()))
    scale = 1.0 / largest if largest > 0.0 else 0.0
    return {name: (ux * scale, uy * scale, a * scale) for name, (ux, uy, a) in motion.items()}


def body_outlines(stage: Stage) -> tuple[str, ...]:
    """Return the outline of every body as a path of SVG [mm], for the cards of modes."""
    return tuple(shape.svg_path() for shape in body_shapes(stage))


@dataclass(frozen=True, slots=True, kw_only=True)
class MovingBody:
    """Motion of a body in a picture of a mode, for the animation of the page."""

    opacity: str
    """Opacity of its colour, which increases with its motion."""
    motion: str
    """Displacement x and y [mm, y down] and rotation [deg]."""
    centre: str
    """Its centre of rotation [mm, y down]."""
    transform: str
    """The same motion at full amplitude, as an SVG transform."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ModeCard:
    """A still picture of a mode at full amplitude."""

    number: int
    """Number of the mode, from 1."""
    frequency: str
    """Its natural frequency [Hz]."""
    box: str
    """Visible area [mm]: left, top, width, height."""
    bodies: tuple[MovingBody | None, ...]
    """Motion of each body, in the order of `body_outlines`; None of one at rest."""


def mode_cards(analysis: Analysis) -> Mapping[str, tuple[ModeCard, ...]]:
    """Return the lowest modes of each condition of the drives."""
    shapes = body_shapes(analysis.stage)
    return {
        condition: tuple(
            _card(analysis, shapes, modes.shapes[:, k], k, float(modes.frequency_hz[k]))
            for k in range(min(MOST_MODES, modes.frequency_hz.size))
        )
        for condition, modes in analysis.modes.items()
    }


def _card(
    analysis: Analysis,
    shapes: tuple[BodyShape, ...],
    shape: NDArray[np.float64],
    index: int,
    frequency: float,
) -> ModeCard:
    x0, y0, x1, y1 = (v * MM for v in extent(shapes))
    size = max(x1 - x0, y1 - y0)
    margin = 0.03 * size
    reach = MODE_AMPLITUDE * size
    motion = mode_motion(analysis.system, shape, analysis.stage)
    centres = {port.name: port.centre for port in analysis.system.bodies}
    bodies: list[MovingBody | None] = []
    for body_shape in shapes:
        name = body_shape.body.name
        if body_shape.body.fixed or name not in motion:
            bodies.append(None)
            continue
        ux, uy, angle = motion[name]
        centre = f"{centres[name][0] * MM:.2f} {-centres[name][1] * MM:.2f}"
        part = _displacement(
            np.vstack(body_shape.loops), np.array(centres[name]), motion[name]
        ).mean()
        # y points down in the picture, so the sense of rotation is reversed as well
        dx, dy, turn = ux * reach, -uy * reach, -np.degrees(angle * reach / MM)
        bodies.append(
            MovingBody(
                opacity=f"{0.12 + 0.78 * part:.2f}",
                motion=f"{dx:.3f} {dy:.3f} {turn:.3f}",
                centre=centre,
                transform=f"translate({dx:.3f} {dy:.3f}) rotate({turn:.3f} {centre})",
            )
        )
    box = f"{x0 - margin:.1f} {-y1 - margin:.1f} {x1 - x0 + 2 * margin:.1f} "
    box += f"{y1 - y0 + 2 * margin:.1f}"
    return ModeCard(number=index + 1, frequency=number(frequency), box=box, bodies=tuple(bodies))


def draw_reachable_area(workspace: ReachableArea) -> "Figure":
    """Draw the workspace of all drives, in micrometres.

    With a rotation: the positions at its middle, filled, and at any rotation. Arrows show the
    stroke of each drive alone, from the lower ends of all strokes.
    """
    figure, axes = one_panel(5.2, 4.9)
    section = UM * workspace.section()
    projection = UM * workspace.projection
    turns = len(workspace.axes) > 2
    label = None
    if turns:
        _closed(
            axes,
            projection,
            color=MUTED,
            linewidth=1.0,
            linestyle=LONG_DASHED,
            label="any rotation",
        )
        label = f"{workspace.axes[2]} = {number(UM * float(workspace.middle[2]))} µrad"
    axes.fill(*section.T, color=CYCLE[0], alpha=0.14, linewidth=0.0)
    _closed(axes, section, color=CYCLE[0], linewidth=1.4, label=label)
    ends = _arrows(axes, workspace)
    points = np.vstack((projection, ends))
    low, high = points.min(axis=0), points.max(axis=0)
    room = 0.09 * float((high - low).max())
    axes.set(xlim=(low[0] - room, high[0] + room), ylim=(low[1] - room, high[1] + room))
    axes.set_aspect("equal")
    label_axes(axes, f"{workspace.axes[0]} [µm]", f"{workspace.axes[1]} [µm]")
    title = f"{number(workspace.area * UM**2)} µm²"
    if turns:
        title += f" at the middle rotation, {number(workspace.projected_area * UM**2)} µm² at any"
        add_legend(axes, loc="best")
    set_title(axes, title)
    return figure


def _closed(axes: "Axes", corners: Array, **line: object) -> None:
    around = np.vstack((corners, corners[:1]))
    axes.plot(*around.T, **line)  # type: ignore[arg-type]


def _arrows(axes: "Axes", workspace: ReachableArea) -> Array:
    """Draw the stroke of each drive; return the ends of all arrows."""
    origin = UM * workspace.lowest[:2]
    ends = origin + UM * workspace.generators[:2].T
    axes.plot(*origin, "o", color=CYCLE[1], markersize=3.5)
    for name, end in zip(workspace.drives, ends, strict=True):
        add_arrow(axes, tuple(end), tuple(origin), CYCLE[1], 1.2, 9)
        axes.annotate(
            name, 0.55 * end + 0.45 * origin, ha="center", va="center", fontsize=8, color=CYCLE[1],
            fontweight="bold", parse_math=False,
            bbox={"boxstyle": "round,pad=0.15", "facecolor": PAPER, "edgecolor": "none"},
        )  # fmt: skip
    return np.vstack((ends, origin))
