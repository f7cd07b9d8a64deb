"""The mesh of one half of a notch and of the block that it stands on.

Lengths are in heights of the root: the mesh takes them for metres, so the size of a notch has no
influence on it. The neck is at x = 0, the block at the right.
"""

import math
from itertools import pairwise
from typing import NamedTuple

import ngsolve as ng
import numpy as np
from netgen.meshing import MeshingParameters
from netgen.occ import (
    ArcOfCircle,
    Edge,
    Face,
    Glue,
    OCCGeometry,
    Segment,
    SplineInterpolation,
    TopoDS_Shape,
    Wire,
    gp_Pnt,
    gp_Vec,
)

from flexstage.elasticity import face
from flexstage.elasticity.shapes import METRE
from flexstage.errors import HingeError
from flexstage.hinges.profile import Array, Profile

_Points = list[tuple[float, float]]

_NECK_SIZE = 0.8  # largest element at the neck, in necks, and along the contour, in heights there
_CORNER_SIZE = 1e-2  # smallest element in a sharp corner, in necks: 0.04 % on a leaf
_CURVATURE = 2.5  # elements by radius of curvature
_NOTCH_SIZE, _BLOCK_SIZE = 0.3, 0.5  # largest elements, in heights of the root and widths
_GRADING = 0.5
_UPRIGHT = 0.5 * math.pi - 0.05  # a contour that ends steeper than this makes no sharp corner

_POINTS = 61  # on a curved piece of the contour, to tell an arc from other curves
_APART = 0.02  # points of a spline that are closer, in necks, only spoil it
_PART = 4.0  # a curve is cut where it has gone this many heights
_TOLERANCE = 1e-9


class _Curve(NamedTuple):
    """A smooth part of a contour: points, the height of the notch there, its slope at the ends."""

    points: _Points
    heights: list[float]
    slopes: tuple[float, float]


class HalfNotch(NamedTuple):
    """The half of a notch in body b and its block, in heights of the root."""

    neck: float
    """Thickness of the neck [1]."""
    root: float
    """Distance of the root from the neck [1]."""
    middle: float
    """Distance of the block's middle from the hinge's line, to the left [1]."""
    width: float
    """Width of the block [1]."""
    end: float
    """Distance of the block's end from the neck [1]."""

    def as_beam(self, end: float, poisson: float) -> Array:
        """The compliance about the neck of the block as a beam with shear, from the root on.

        It counts up to `end` from the neck; times E b, shape (3, 3).
        """
        x, w, e = self.root, self.width, self.middle
        # integrals of 1, x and x^2
        i0, i1, i2 = end - x, (end**2 - x**2) / 2.0, (end**3 - x**3) / 3.0
        bend = 12.0 / w**3
        c = np.empty((3, 3))
        c[0, 0] = i0 / w + bend * e**2 * i0
        c[1, 1] = bend * i2 + 2.4 * (1.0 + poisson) * i0 / w
        c[2, 2] = bend * i0
        c[0, 2] = c[2, 0] = bend * e * i0
        c[1, 2] = c[2, 1] = -bend * i1
        c[0, 1] = c[1, 0] = -bend * e * i1
        return c


def half_notch_on_block(profile: Profile, width: float, length: float) -> HalfNotch:
    """Return the measures of the half of a notch on a block.

    The block is `width` heights of the root wide and `length` of its widths long. The measures are
    rounded, so that a notch and its enlargement have one mesh.
    """
    height = profile.root_height
    root = round(0.5 * profile.length / height, 12)
    return HalfNotch(
        neck=round(profile.neck_thickness / height, 12),
        root=root,
        middle=round(0.5 * profile.depth / height, 12) if profile.one_sided else 0.0,
        width=width,
        end=root + length * width,
    )


def half_mesh(profile: Profile, half: HalfNotch, fineness: float) -> ng.Mesh:
    """Mesh the half of a notch and its block.

    Regions ``notch`` and ``body``; edges ``neck``, ``left``, ``right`` (the surfaces of the notch)
    and ``end``; points ``low`` and ``high`` at the ends of the neck. It is not yet curved;
    `fineness` divides the size of the elements.
    """
    t, x0, e, w, x1 = half.neck, half.root, half.middle, half.width, half.end
    left = _contour(profile, 1.0)
    right = _contour(profile, -1.0)
    low, high = right[-1].points[-1][1], left[-1].points[-1][1]
    slopes = (abs(left[-1].slopes[1]), abs(right[-1].slopes[1]))
    # Counter-clockwise, as `face` runs: faces are joined only where their normals agree.
    edges = [
        _edge([(0.0, 0.5 * t), (0.0, -0.5 * t)], (0.0, 0.0)),
        *(_edge(c.points, c.slopes) for c in right),
        _edge([(x0, low), (x0, high)], (0.0, 0.0)),
        *(_edge(c.points, c.slopes) for c in reversed(left)),
    ]
    notch = Face(Wire(edges))
    corners = [(x0, low), (x0, e - 0.5 * w), (x1, e - 0.5 * w), (x1, e + 0.5 * w)]
    corners += [(x0, e + 0.5 * w), (x0, high)]
    corners = [p for p, q in pairwise([*corners, corners[0]]) if math.dist(p, q) > _TOLERANCE]
    body = face(corners)
    notch.faces.name, body.faces.name = "notch", "body"
    notch.faces.maxh = _NOTCH_SIZE / fineness * METRE
    body.faces.maxh = _BLOCK_SIZE * w / fineness * METRE
    shape = Glue([notch, body])
    _name_edges(shape, half, _NECK_SIZE * t / fineness * METRE)
    for vertex in shape.vertices:
        x, y = vertex.p.x / METRE, vertex.p.y / METRE
        if abs(x) < _TOLERANCE:
            vertex.name = "high" if y > 0.0 else "low"
        for at, slope, edge in ((high, slopes[0], e + 0.5 * w), (low, slopes[1], e - 0.5 * w)):
            # the contour meets a wider body in a sharp corner unless it ends upright
            sharp = abs(at - edge) > _TOLERANCE and slope < _UPRIGHT
            if sharp and math.dist((x, y), (x0, at)) < _TOLERANCE:
                vertex.maxh = _CORNER_SIZE * t * METRE
    sizes = MeshingParameters(
        maxh=max(1.0, w) * _BLOCK_SIZE / fineness * METRE,
        grading=_GRADING,
        curvaturesafety=_CURVATURE * fineness,
        segmentsperedge=0.2,
    )
    for curves in (left, right):
        _restrict(sizes, curves, fineness)
    mesh = ng.Mesh(OCCGeometry(shape, dim=2).GenerateMesh(sizes))
    # the mesher leaves out what it cannot mesh; straight elements miss a little of the area
    area = sum(part.mass for part in shape.faces)
    if abs(ng.Integrate(ng.CoefficientFunction(1.0), mesh) / area - 1.0) > 0.05:
        raise HingeError(
            f"this {profile.kind} notch could not be meshed: use the method 'wedge', or less "
            "extreme proportions"
        )
    return mesh


def _restrict(sizes: MeshingParameters, curves: list[_Curve], fineness: float) -> None:
    """Keep the elements along a contour below the height of the notch there."""
    last = -1.0
    for curve in curves:
        for (x, y), height in zip(curve.points, curve.heights, strict=True):
            size = _NECK_SIZE * height / fineness
            if x - last > 0.5 * size and size < _NOTCH_SIZE / fineness:
                sizes.RestrictH(x * METRE, y * METRE, 0.0, size * METRE)
                last = x


def _name_edges(shape: TopoDS_Shape, half: HalfNotch, at_neck: float) -> None:
    """Name the neck, the two surfaces of the notch and the end of the half."""
    for edge in shape.edges:
        x = [v.p.x / METRE for v in edge.vertices]
        if max(x) < _TOLERANCE:
            edge.name = "neck"
            edge.maxh = at_neck
        elif min(x) > half.end - _TOLERANCE:
            edge.name = "end"
        elif min(x) < half.root - _TOLERANCE:
            edge.name = "left" if sum(v.p.y for v in edge.vertices) > 0.0 else "right"
        else:
            edge.name = "body"


def _contour(profile: Profile, side: float) -> list[_Curve]:
    """Return one side from the neck to the root."""
    unit, neck = profile.root_height, profile.neck_thickness
    if profile.one_sided and side < 0.0:
        y = -0.5 * neck / unit
        ends = [(0.0, y), (round(0.5 * profile.length / unit, 12), y)]
        return [_Curve(ends, [neck / unit, 1.0], (0.0, 0.0))]
    curves = []
    for piece in profile.pieces():
        x, depth, angle, _ = piece(np.linspace(0.0, 1.0, _POINTS))
        xy = np.round(np.column_stack([x, side * (0.5 * neck + depth)]) / unit, 12)
        heights = (neck + profile.sides * depth) / unit
        if _on_a_line(xy):
            kept = [0, _POINTS - 1]
            cuts = kept
        else:
            kept = _apart(xy, _APART * neck / unit)
            cuts = [kept[0], kept[-1]] if _on_a_circle(xy) else _cuts(xy, heights, kept)
        for first, last in pairwise(cuts):
            part = [i for i in kept if first <= i <= last]
            curves.append(
                _Curve(
                    [(float(a), float(b)) for a, b in xy[part]],
                    [float(h) for h in heights[part]],
                    (side * float(angle[first]), side * float(angle[last])),
                )
            )
    return curves


def _apart(xy: Array, least: float) -> list[int]:
    """Leave out points that are too close to their neighbours."""
    kept, last = [0], len(xy) - 1
    for i in range(1, last):
        if math.dist(xy[i], xy[kept[-1]]) > least and math.dist(xy[i], xy[last]) > least:
            kept.append(i)
    return [*kept, last]


def _cuts(xy: Array, heights: Array, kept: list[int]) -> list[int]:
    """Cut a long curve where it has gone several heights: the mesher divides each part evenly."""
    along = np.append(0.0, np.cumsum(np.hypot(*np.diff(xy, axis=0).T)))
    cuts = [kept[0]]
    for i in kept[2:-2]:
        enough = _PART * heights[cuts[-1]]
        if along[i] - along[cuts[-1]] > enough and along[-1] - along[i] > enough:
            cuts.append(i)
    return [*cuts, kept[-1]]


def _edge(points: _Points, slopes: tuple[float, float]) -> Edge:
    """Return a line, the arc that the points lie on, or else a spline with these end slopes."""
    at = [gp_Pnt(x * METRE, y * METRE, 0.0) for x, y in points]
    if len(at) == 2 or _on_a_line(np.array(points)):
        return Segment(at[0], at[-1])
    if _on_a_circle(np.array(points)):
        return ArcOfCircle(at[0], at[len(at) // 2], at[-1])
    first, last = (gp_Vec(math.cos(a), math.sin(a), 0.0) for a in slopes)
    return SplineInterpolation(at, tangents={0: first, len(at) - 1: last})


def _on_a_line(points: Array) -> bool:
    """Say whether points lie on the line through the first and the last."""
    along = (points[-1] - points[0]) / math.dist(points[-1], points[0])
    off = (points - points[0]) @ np.array([-along[1], along[0]])
    return bool(np.max(np.abs(off)) < 1e-8)


def _on_a_circle(points: Array) -> bool:
    """Say whether points lie on the circle through the first, the middle and the last."""
    start, others = points[0], points[[len(points) // 2, -1]] - points[0]
    centre = start + np.linalg.solve(others, 0.5 * np.sum(others**2, axis=1))
    radii = np.hypot(*(points - centre).T)
    return bool(np.ptp(radii) < 1e-9)
