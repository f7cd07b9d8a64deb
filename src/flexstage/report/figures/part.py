"""Views of a part from four sides, with the names of its faces."""

import textwrap
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.colors import to_rgb
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt
from scipy.optimize import isotonic_regression

from flexstage.base.arrays import Array, Integers
from flexstage.fem.part import Part, PartSurface, part_surface
from flexstage.report.figures.style import (
    BODY,
    CYCLE,
    INK,
    MUTED,
    PAPER,
    new_figure,
    set_title,
    shortened,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_PIXELS = 900  # longer side of a view
_WIDE = 11.0  # of the figure [inch]
_TYPE = 6.5  # [pt]
_FIXED, _MOVED = CYCLE[5], CYCLE[4]  # blue and orange; solids have distant colours
_SOLIDS = (BODY, CYCLE[2], CYCLE[3], CYCLE[1])
# directions towards the viewer: each face is turned to one of them
_SIDES = (
    ("from +x, −y, +z", (1.0, -1.3, 0.9)),
    ("from −x, +y, +z", (-1.0, 1.3, 0.9)),
    ("from +x, +y, −z", (1.3, 1.0, -0.9)),
    ("from −x, −y, −z", (-1.3, -1.0, -0.9)),
)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _View:
    """View from one side: colours, and the number of the face at each pixel, or -1."""

    image: Array
    face: Integers
    axes: Array  # rows: to the right, upwards, towards the viewer


def _axes(towards: Sequence[float]) -> Array:
    back = np.array(towards) / np.linalg.norm(towards)
    right = np.cross((0.0, 0.0, 1.0), back)
    right /= np.linalg.norm(right)
    return np.array([right, np.cross(back, right), back])


def _look(surface: PartSurface, colours: Array, towards: Sequence[float]) -> _View:
    """Fill the pixels of the triangles that face the viewer, by their depth."""
    axes = _axes(towards)
    placed = surface.triangles @ axes.T
    low, high = placed.reshape(-1, 3).min(axis=0), placed.reshape(-1, 3).max(axis=0)
    scale = (_PIXELS - 9) / (high - low)[:2].max()
    width, height = np.ceil((high - low)[:2] * scale).astype(int) + 9
    placed[..., :2] = (placed[..., :2] - low[:2]) * scale + 4.0
    normal = surface.area_vectors / np.linalg.norm(surface.area_vectors, axis=1)[:, None]
    facing = normal @ axes[2]
    light = 0.74 + 0.26 * np.clip(normal @ (axes.T @ (-0.35, 0.55, 0.76)), 0.0, 1.0)
    depth = np.full((height, width), -np.inf)
    face = np.full((height, width), -1, dtype=np.intp)
    image = np.broadcast_to(to_rgb(PAPER), (height, width, 3)).copy()
    for t in np.flatnonzero(facing > 1e-6):
        (x0, y0), (x1, y1) = placed[t, :, :2].min(axis=0), placed[t, :, :2].max(axis=0)
        rows = slice(int(y0), int(y1) + 2)
        columns = slice(int(x0), int(x1) + 2)
        y, x = np.mgrid[rows, columns][:, : height - rows.start, : width - columns.start]
        inside, z = _within(placed[t], x, y)
        here = inside & (z > depth[rows, columns])
        depth[rows, columns][here] = z[here]
        face[rows, columns][here] = surface.face[t]
        image[rows, columns][here] = light[t] * colours[surface.face[t]]
    edge = np.zeros_like(face, dtype=bool)
    edge[:-1] |= face[:-1] != face[1:]
    edge[:, :-1] |= face[:, :-1] != face[:, 1:]
    image[edge] = to_rgb(INK)
    return _View(image=image, face=face, axes=axes)


def _within(corners: Array, x: Array, y: Array) -> tuple[NDArray[np.bool_], Array]:
    """Return the points inside a triangle, and the depth of its plane at them."""
    (ax, ay, az), (bx, by, bz), (cx, cy, cz) = corners
    area = (bx - ax) * (cy - ay) - (by - ay) * (cx - ax)
    if abs(area) < 1e-12:
        return np.zeros(x.shape, dtype=bool), np.zeros(x.shape)
    v = ((x - ax) * (cy - ay) - (y - ay) * (cx - ax)) / area
    w = ((bx - ax) * (y - ay) - (by - ay) * (x - ax)) / area
    slack = -1e-3
    inside = (v >= slack) & (w >= slack) & (v + w <= 1.0 - slack)
    return inside, az + v * (bz - az) + w * (cz - az)


def draw_part(part: Part, *, fixed: Sequence[str] = (), moved: Sequence[str] = ()) -> "Figure":
    """Draw a part from four sides, each face named where most of it is seen.

    Fixed and moved faces are highlighted in colour. Faces between two solids, and others that are
    hidden in all views, are listed below.
    """
    fewest_pixels = 12  # fewest pixels of a visible face
    lowest = 0.45  # smallest height of a view over its width: flat parts need room for names
    column = 0.34  # room for names on each side of a view, relative to its width
    letters = 22  # most letters of a name; the list of faces has the complete one
    surface = part_surface(part)
    outer = np.array([len(f.bodies) == 1 for f in part.faces])
    outer_surface = PartSurface(
        triangles=surface.triangles[outer[surface.face]],
        face=surface.face[outer[surface.face]],
        lines=surface.lines,
        edge=surface.edge,
    )
    colours = _colours(part, fixed, moved)
    views = [_look(outer_surface, colours, towards) for _, towards in _SIDES]
    count = len(part.faces)
    pixels = np.array([np.bincount(v.face[v.face >= 0], minlength=count) for v in views])
    best = pixels.argmax(axis=0)
    visible = pixels.max(axis=0) >= fewest_pixels
    wide = (1.0 + 2.0 * column) * _PIXELS
    high = max(lowest * wide, 1.05 * max(v.face.shape[0] for v in views))
    figure = new_figure(_WIDE, _WIDE * high / wide + 1.2)
    places = figure.subplots(2, 2).ravel()
    for k, (axes, view, (title, _)) in enumerate(zip(places, views, _SIDES, strict=True)):
        _show(axes, view, wide, high)
        set_title(axes, title)
        faces = [f for f in range(count) if visible[f] and best[f] == k]
        _name(axes, view, faces, [shortened(f.name, letters) for f in part.faces])
    figure.supxlabel(
        _caption(part, visible, fixed, moved), fontsize=_TYPE + 1, color=INK, parse_math=False
    )
    return figure


def _colours(part: Part, fixed: Sequence[str], moved: Sequence[str]) -> Array:
    """Return the colour of each face: of its solid, unless it is fixed or moved."""
    solids = [
        np.array(to_rgb(c)) if c == BODY else 0.45 * np.array(to_rgb(c)) + 0.55 for c in _SOLIDS
    ]
    of_solid = {name: solids[k % len(solids)] for k, name in enumerate(part.bodies)}
    out = [of_solid[f.bodies[0]] for f in part.faces]
    for names, colour in ((fixed, _FIXED), (moved, _MOVED)):
        for k, f in enumerate(part.faces):
            if f.name in names:
                out[k] = np.array(to_rgb(colour))
    return np.array(out)


def _show(axes: "Axes", view: _View, wide: float, high: float) -> None:
    height, width = view.face.shape
    axes.imshow(view.image, origin="lower", interpolation="antialiased", zorder=1)
    margin, above = 0.5 * (wide - width), 0.5 * (high - height)
    axes.set_xlim(-margin, width + margin)
    axes.set_ylim(-above, height + above)
    axes.set_axis_off()
    # the three axes, in the corner
    corner = np.array([-margin + 0.09 * _PIXELS, -above + 0.09 * _PIXELS])
    for k, letter in enumerate("xyz"):
        arrow = 0.07 * _PIXELS * view.axes[:2, k]
        axes.annotate(
            "",
            xy=tuple(corner + arrow),
            xytext=tuple(corner),
            arrowprops={"arrowstyle": "-|>", "color": MUTED, "linewidth": 0.7, "shrinkA": 0},
        )
        x, y = corner + 1.45 * arrow
        axes.text(x, y, letter, fontsize=_TYPE, color=MUTED, ha="center", va="center")


def _middle(mask: NDArray[np.bool_]) -> tuple[float, float, float]:
    """Return the point of a region farthest from its border, and its distance."""
    rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
    top, left = rows[0], columns[0]
    part = np.pad(mask[top : rows[-1] + 1, left : columns[-1] + 1], 1)
    distance = np.asarray(distance_transform_edt(part))
    y, x = np.unravel_index(int(distance.argmax()), distance.shape)
    return float(left + x - 1), float(top + y - 1), float(distance[y, x])


def _name(axes: "Axes", view: _View, faces: Sequence[int], names: Sequence[str]) -> None:
    """Write names onto faces where they fit, the others at the sides of the part with a line."""
    low, high = axes.get_xlim()
    line = _TYPE / 72.0 * (high - low) / (0.5 * _WIDE)  # height of the type, in pixels of the view
    side_labels: dict[bool, list[tuple[float, float, str]]] = {False: [], True: []}
    for f in faces:
        x, y, free = _middle(view.face == f)
        wide = 0.62 * line * len(names[f])
        if free > np.hypot(0.5 * wide, 0.5 * line) or _fits(view.face == f, x, y, wide, line):
            axes.text(
                x,
                y,
                names[f],
                fontsize=_TYPE,
                color=INK,
                ha="center",
                va="center",
                parse_math=False,
            )
        else:
            side_labels[x > 0.5 * view.face.shape[1]].append((y, x, names[f]))
    width = view.face.shape[1]
    for right, labels in side_labels.items():
        labels.sort()
        column = width + 0.06 * _PIXELS if right else -0.06 * _PIXELS
        # two columns where one is too short
        room = (axes.get_ylim()[1] - axes.get_ylim()[0]) * 0.97
        each = min(1.45 * line, room / max(len(labels), 1))
        for (y, x, name), at in zip(
            labels, _label_positions([y for y, _, _ in labels], each, axes.get_ylim()), strict=True
        ):
            axes.plot([x, column], [y, at], color=MUTED, linewidth=0.4, zorder=2)
            axes.plot([x], [y], ".", color=INK, markersize=1.8, zorder=3)
            axes.text(
                column + (0.01 if right else -0.01) * _PIXELS,
                at,
                name,
                fontsize=_TYPE,
                color=INK,
                ha="left" if right else "right",
                va="center",
                parse_math=False,
            )


def _fits(mask: NDArray[np.bool_], x: float, y: float, wide: float, high: float) -> bool:
    rows = slice(max(int(y - 0.6 * high), 0), int(y + 0.6 * high) + 1)
    columns = slice(max(int(x - 0.55 * wide), 0), int(x + 0.55 * wide) + 1)
    region = mask[rows, columns]
    pixels = (rows.stop - rows.start) * (columns.stop - columns.start)
    return bool(region.size == pixels and region.all())


def _label_positions(
    preferred: Sequence[float], spacing: float, limits: tuple[float, float]
) -> Array:
    """Return positions in a column near preferred ones, in their order and at a distance."""
    if not preferred:
        return np.zeros(0)
    low, high = limits[0] + 0.5 * spacing, limits[1] - 0.5 * spacing
    steps = spacing * np.arange(len(preferred))
    # the least-squares nearest of all increasing sequences
    flat = isotonic_regression(np.array(preferred) - steps).x
    return np.asarray(np.clip(flat, low, max(low, high - steps[-1])) + steps, dtype=float)


def _caption(
    part: Part, visible: NDArray[np.bool_], fixed: Sequence[str], moved: Sequence[str]
) -> str:
    joints = [f"{f.name} ({' and '.join(f.bodies)})" for f in part.faces if len(f.bodies) > 1]
    hidden = [
        f.name
        for f, face_visible in zip(part.faces, visible, strict=True)
        if not face_visible and len(f.bodies) == 1
    ]
    name = Path(part.source.strip("'")).name
    lines = [f"{name}, {len(part.faces)} faces"]
    lines += [f"fixed, blue: {', '.join(fixed)}"] if fixed else []
    lines += [f"moved, orange: {', '.join(moved)}"] if moved else []
    lines += [f"between solids: {', '.join(joints)}"] if joints else []
    lines += [f"hidden in all views: {', '.join(hidden)}"] if hidden else []
    return "\n".join(line for text in lines for line in textwrap.wrap(text, 150))
