"""Common parts of drawings of a stage: outlines of bodies, and free places for labels."""

import itertools
from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from flexstage.hinges import Profile
from flexstage.report.figures.style import HATCH, INK, MM
from flexstage.stage import Body, Circle, Hinge, Loop, Stage

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.path import Path


# Chords may leave their arcs by this much [m]: a tenth of a pixel of a large drawing.
_TOLERANCE = 10e-6


@dataclass(frozen=True, slots=True, kw_only=True)
class BodyShape:
    """The drawn shape of a body."""

    body: Body
    """The body."""
    loops: tuple[NDArray[np.float64], ...]
    """Closed polygons [m], each of shape (n, 2): outer ones to the left, holes to the right."""
    label_at: tuple[float, float]
    """A point well inside it [m]."""
    room: float
    """Distance of that point from the nearest edge [m]."""

    def path(self) -> "Path":
        """Return all loops as one path [mm]."""
        from matplotlib.path import Path

        return Path.make_compound_path(
            *(Path(np.vstack((loop, loop[:1])) * MM, closed=True) for loop in self.loops)
        )

    def svg_path(self) -> str:
        """Return all loops [mm], with two decimals, as the ``d`` of an SVG path; y points down."""
        parts = []
        for loop in self.loops:
            corners = [f"{x * MM:.2f} {-y * MM:.2f}" for x, y in loop]
            parts.append("M" + "L".join(corners) + "Z")
        return "".join(parts)


def add_body(
    axes: "Axes", shape: BodyShape, face: str, edge: str = INK, width: float = 0.5, **look: Any
) -> None:
    """Draw a body in millimetres; `look` are properties of a patch of Matplotlib."""
    from matplotlib.patches import PathPatch

    axes.add_patch(PathPatch(shape.path(), facecolor=face, edgecolor=edge, linewidth=width, **look))


def add_hatched(axes: "Axes", shape: BodyShape, face: str) -> None:
    """Draw a body below all else, hatched where it is fixed."""
    add_body(axes, shape, face, zorder=1)
    if shape.body.fixed:
        add_body(axes, shape, "none", HATCH, 0.0, hatch="///")


@lru_cache(maxsize=8)
def body_shapes(stage: Stage) -> tuple[BodyShape, ...]:
    """Return the shape of every body, in the order of the stage."""
    return tuple(_shape(stage, body) for body in stage.bodies)


def extent(shapes: tuple[BodyShape, ...]) -> tuple[float, float, float, float]:
    """Return smallest x and y, largest x and y of all bodies [m]."""
    points = np.vstack([loop for shape in shapes for loop in shape.loops])
    return (*map(float, points.min(axis=0)), *map(float, points.max(axis=0)))  # type: ignore[return-value]


def _shape(stage: Stage, body: Body) -> BodyShape:
    from shapely import Polygon, maximum_inscribed_circle, unary_union

    def polygon(loop: Loop | Circle) -> Any:
        line = loop.loop() if isinstance(loop, Circle) else loop
        return Polygon(line.polyline(_TOLERANCE)).buffer(0.0)

    area = polygon(body.outline)
    halves = [
        Polygon(_half_notch(hinge, side)).buffer(0.0)
        for hinge in stage.hinges
        for name, side in zip(hinge.bodies, (-1.0, 1.0), strict=True)
        if name == body.name
    ]
    for hole in (*body.holes, *body.mounting_holes):
        area = area.difference(polygon(hole))
    merged: Any = unary_union([area, *halves])
    pieces: list[Any] = list(merged.geoms) if hasattr(merged, "geoms") else [merged]
    loops: list[NDArray[np.float64]] = []
    for piece in sorted(pieces, key=lambda p: -p.area):
        loops.append(_turned(np.asarray(piece.exterior.coords)[:-1], left=True))
        loops += [_turned(np.asarray(r.coords)[:-1], left=False) for r in piece.interiors]
    largest = max(pieces, key=lambda p: p.area)
    size = max(largest.bounds[2] - largest.bounds[0], largest.bounds[3] - largest.bounds[1])
    radius: Any = maximum_inscribed_circle(largest, 0.002 * size)  # type: ignore[call-overload]
    (x, y), _ = radius.coords
    return BodyShape(body=body, loops=tuple(loops), label_at=(x, y), room=radius.length)


def _half_notch(hinge: Hinge, side: float) -> list[tuple[float, float]]:
    """Return the corners of half a notch on one side of the neck, overlapping its body."""
    # overlap of half a notch with its body [m], so that the two merge without a seam
    overlap = 20e-6
    profile = hinge.profile
    edge = notch_contour(profile)
    neck = 0.5 * profile.neck_thickness
    upper = [(x, neck + depth) for x, depth in edge]
    lower = [(x, -neck if profile.one_sided else -neck - depth) for x, depth in edge]
    end = upper[-1][0] + overlap
    corners = [*upper, (end, upper[-1][1]), (end, lower[-1][1]), *reversed(lower)]
    return [hinge.to_plane(side * along, across) for along, across in corners]


def notch_contour(profile: Profile) -> list[tuple[float, float]]:
    """Return the contour of a notch from the neck to the root, arcs as chords.

    Distance from the neck, and depth [m].
    """
    vertices = profile.contour()
    points: list[tuple[float, float]] = []
    for start, end in itertools.pairwise(vertices):
        if start.bulge:
            # a loop of the arc and its chord is divided like other arcs
            arc = Loop(((start.x, start.depth), (end.x, end.depth)), (start.bulge, 0.0))
            points += [(float(x), float(d)) for x, d in arc.polyline(_TOLERANCE)[:-1]]
        else:
            points.append((start.x, start.depth))
    points.append((vertices[-1].x, vertices[-1].depth))
    return points


def _turned(loop: NDArray[np.float64], *, left: bool) -> NDArray[np.float64]:
    x, y = loop.T
    area = float(np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y))
    return loop if (area > 0.0) == left else loop[::-1]


# Candidate places: 16 directions, first next to the point, then label heights further away.
_STEPS = np.repeat((0.0, 0.6, 1.2, 2.0, 3.0, 4.5), 16)
_ALONG = np.tile(np.cos(np.pi / 8.0 * np.arange(16)), 6)
_UP = np.tile(np.sin(np.pi / 8.0 * np.arange(16)), 6)


class Placer:
    """Finds the best free place for each new label.

    Labels stay within the bounds: smallest x and y, largest x and y.
    """

    def __init__(self, bounds: tuple[float, float, float, float]) -> None:
        self._bounds = bounds
        self._occupied: list[tuple[float, float, float, float]] = []

    def take(self, x: float, y: float, width: float, height: float) -> None:
        """Mark a rectangle about a centre as occupied."""
        self._occupied.append((x - width / 2, y - height / 2, x + width / 2, y + height / 2))

    def is_free(self, x: float, y: float, width: float, height: float) -> bool:
        """Return whether a rectangle about a centre is free."""
        return bool(self._overlap(np.array([[x, y]]), width, height)[0] == 0.0)

    def place(
        self, x: float, y: float, width: float, height: float, *, nearest: float
    ) -> tuple[float, float]:
        """Find and occupy a place for a label near a point; return its centre.

        `nearest` is the smallest distance between the point and the edge of the label.
        """
        # the label's own half size in each direction, then the gap
        with np.errstate(divide="ignore"):
            reach = np.minimum(0.5 * width / abs(_ALONG), 0.5 * height / abs(_UP))
        distance = reach + nearest + _STEPS * height
        at = np.column_stack((x + _ALONG * distance, y + _UP * distance))
        # a twentieth of a label covered is as bad as a label three heights further away
        cost = 10.0 * self._overlap(at, width, height) + 0.15 * width * height * _STEPS
        best_x, best_y = map(float, at[np.argmin(cost)])
        self.take(best_x, best_y, width, height)
        return best_x, best_y

    def _overlap(self, at: NDArray[np.float64], width: float, height: float) -> NDArray[np.float64]:
        """Return the area of a label over occupied places or out of bounds, by position."""
        left, bottom = at[:, 0] - width / 2, at[:, 1] - height / 2
        right, top = left + width, bottom + height
        x0, y0, x1, y1 = np.reshape(self._occupied, (-1, 4)).T[:, :, None]
        across = np.minimum(right, x1) - np.maximum(left, x0)
        up = np.minimum(top, y1) - np.maximum(bottom, y0)
        covered = np.sum(np.maximum(across, 0.0) * np.maximum(up, 0.0), axis=0)
        x0, y0, x1, y1 = self._bounds
        outside = np.maximum(x0 - left, 0.0) + np.maximum(right - x1, 0.0)
        outside += np.maximum(y0 - bottom, 0.0) + np.maximum(top - y1, 0.0)
        return covered + 10.0 * outside * height
