"""Cells and motion of the plate of a stage with rigid bodies."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from flexstage.base.arrays import Array
from flexstage.stage import Circle, Hinge, Loop, Stage
from flexstage.stage.contour import body_contour, inner_notch
from flexstage.system import MechanicalSystem

# Share of a notch that is drawn in bending; the rest moves with its body.
_BENT = 0.8
# Smallest number of divisions along each half of a notch.
_PARTS = 12


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class BodyCells:
    """The plate of a stage in tetrahedra over its whole thickness."""

    stage: Stage
    """The stage."""
    points: Array
    """Corners at rest [m], shape (n, 3): from z = -thickness/2 to thickness/2."""
    cells: NDArray[np.intp]
    """Corners of each tetrahedron, the fourth on the side from which the first three are
    anticlockwise, shape (m, 4).
    """
    region: NDArray[np.intp]
    """Index into `regions` of each cell, shape (m,)."""
    point_region: NDArray[np.intp]
    """Index into `regions` of each corner, shape (n,); regions share no corners."""
    regions: tuple[str, ...]
    """Names of the regions: bodies without their notches, and halves of notches."""
    body: NDArray[np.intp]
    """Index of the body of each region, shape (r,)."""
    hinge: NDArray[np.intp]
    """Index of the hinge of each region, -1 for bodies, shape (r,)."""

    def displacement(self, system: MechanicalSystem, q: Array) -> Array:
        """Return the displacement of the corners [m], shape (n, 3).

        Bodies are rigid; those that are not in the system do not move. A notch is drawn as a bar of
        constant stiffness between its two bodies, a cubic curve, for illustration only.
        """
        motion_of_points = np.zeros_like(self.points)
        motion = {b.name: (b.centre, b.matrix @ q) for b in system.bodies}
        still = ((0.0, 0.0), np.zeros(3))
        for i, (body, hinge) in enumerate(zip(self.body, self.hinge, strict=True)):
            in_region = self.point_region == i
            at = self.points[in_region, :2]
            if hinge < 0:
                motion_of_points[in_region, :2] = _rigid(
                    *motion.get(self.stage.bodies[body].name, still), at
                )
            else:
                notch = self.stage.hinges[hinge]
                ends = [motion.get(name, still) for name in notch.bodies]
                motion_of_points[in_region, :2] = _bent(notch, ends[0], ends[1], at)
        return motion_of_points

    def hinge_values(self, values: dict[str, float]) -> Array:
        """Return the value of each hinge in the cells of its notch, 0 in all other cells."""
        by_hinge = np.array([*(values.get(h.name, 0.0) for h in self.stage.hinges), 0.0])
        return by_hinge[self.hinge][self.region]


_Motion = tuple[tuple[float, float], Array]


def _rigid(centre: tuple[float, float], motion: Array, at: Array) -> Array:
    x, y, turn = motion
    return np.column_stack((x - turn * (at[:, 1] - centre[1]), y + turn * (at[:, 0] - centre[0])))


def _bent(hinge: Hinge, a: _Motion, b: _Motion, at: Array) -> Array:
    """Return the displacement of the points of a notch, a bar clamped to two bodies."""
    half = 0.5 * _BENT * hinge.profile.length
    c, s = math.cos(hinge.direction), math.sin(hinge.direction)
    axes = np.array(((c, s), (-s, c)))
    local = (at - hinge.at) @ axes.T
    (ua, va), (ub, vb) = (
        axes @ _rigid(*motion, np.array([hinge.to_plane(side * half, 0.0)]))[0]
        for side, motion in ((-1.0, a), (1.0, b))
    )
    ta, tb = a[1][2], b[1][2]
    length = 2.0 * half
    r = np.clip((local[:, 0] + half) / length, 0.0, 1.0)
    v = (
        (1.0 - 3.0 * r**2 + 2.0 * r**3) * va
        + (3.0 * r**2 - 2.0 * r**3) * vb
        + length * (r - 2.0 * r**2 + r**3) * ta
        + length * (r**3 - r**2) * tb
    )
    slope = (
        6.0 * (r - r**2) * (vb - va) / length
        + (1.0 - 4.0 * r + 3.0 * r**2) * ta
        + (3.0 * r**2 - 2.0 * r) * tb
    )
    along = (1.0 - r) * ua + r * ub - local[:, 1] * slope
    return np.column_stack((along, v)) @ axes


# ------------------------------------------------------------------ the cells


def body_cells(stage: Stage) -> BodyCells:
    """Return the plate of a stage in tetrahedra; chords are within 2 um of its arcs.

    Three tetrahedra make a prism over a triangle. Wedges are not used, since programs differ in the
    orientation of a wedge.
    """
    index = {b.name: i for i, b in enumerate(stage.bodies)}
    outlines: list[tuple[str, int, int, Loop, tuple[Loop | Circle, ...], float]] = []
    for i, body in enumerate(stage.bodies):
        outline, holes = body_contour(stage, body, _BENT)
        holes = (*holes, *body.mounting_holes)
        outlines.append((f"body {body.name}", i, -1, outline, holes, 0.0))
    for k, hinge in enumerate(stage.hinges):
        for which, name in enumerate(hinge.bodies):
            step = 0.5 * _BENT * hinge.profile.length / _PARTS
            loop = inner_notch(hinge, which, _BENT)
            outlines.append((f"notch {hinge.name} {'ab'[which]}", index[name], k, loop, (), step))
    points, cells, region, of_point, count = [], [], [], [], 0
    half = 0.5 * stage.thickness
    for i, (_, _, _, outline, holes, step) in enumerate(outlines):
        flat, triangles = _triangles(outline, holes, step)
        n = len(flat)
        points += [np.column_stack((flat, np.full(n, z))) for z in (-half, half)]
        cells.append(count + _tetrahedra(triangles, n))
        region.append(np.full(3 * len(triangles), i))
        of_point.append(np.full(2 * n, i))
        count += 2 * n
    return BodyCells(
        stage=stage,
        points=np.concatenate(points),
        cells=np.concatenate(cells),
        region=np.concatenate(region),
        point_region=np.concatenate(of_point),
        regions=tuple(o[0] for o in outlines),
        body=np.array([o[1] for o in outlines], dtype=np.intp),
        hinge=np.array([o[2] for o in outlines], dtype=np.intp),
    )


def _triangles(
    outline: Loop, holes: tuple[Loop | Circle, ...], step: float
) -> tuple[Array, NDArray[np.intp]]:
    """Return an area in counter-clockwise triangles without inner corners."""
    import shapely

    inner = [(h.loop() if isinstance(h, Circle) else h).polyline() for h in holes]
    area = shapely.Polygon(outline.polyline(), inner)
    if step:
        area = shapely.segmentize(area, step)
    parts = shapely.get_parts(shapely.constrained_delaunay_triangles(area))
    # each triangle is a closed ring of four points
    corners = shapely.get_coordinates(parts).reshape(-1, 4, 2)[:, :3]
    (ax, ay), (bx, by) = ((corners[:, k] - corners[:, 0]).T for k in (1, 2))
    clockwise = ax * by < ay * bx
    corners[clockwise] = corners[clockwise][:, ::-1]
    points, number = np.unique(corners.reshape(-1, 2), axis=0, return_inverse=True)
    return points, number.reshape(-1, 3)


def _tetrahedra(triangles: NDArray[np.intp], above: int) -> NDArray[np.intp]:
    """Return the tetrahedra of prisms, whose upper corners have numbers higher by `above`.

    The diagonal of each side is from the lower corner of smaller number to the other upper corner,
    the same in the neighbouring prism.
    """
    order = np.sort(triangles, axis=1)
    a, b, c = order.T
    parts = np.stack(
        [
            np.column_stack((a, b, c, c + above)),
            np.column_stack((a, b, c + above, b + above)),
            np.column_stack((a, b + above, c + above, a + above)),
        ],
        axis=1,
    )
    # triangles that sorting has flipped: exchange the second and third corner
    start = np.argmin(triangles, axis=1)
    second = np.take_along_axis(triangles, ((start + 1) % 3)[:, None], axis=1)[:, 0]
    flipped = second != b
    parts[flipped] = parts[flipped][:, :, [0, 2, 1, 3]]
    return parts.reshape(-1, 4)
