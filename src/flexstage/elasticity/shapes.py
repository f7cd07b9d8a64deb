"""Plane faces with exact arcs, and their prisms, for the mesher; the unit that it works in."""

import math
from collections.abc import Sequence

from netgen.occ import ArcOfCircle, Face, Segment, TopoDS_Shape, Wire, gp_Pnt

#: One metre in the unit of geometry and mesh, the millimetre: the tolerances of the geometry
#: kernel are absolute, and made for it. Everything else is SI.
METRE = 1e3

_NOTHING = 1e-12  # a segment shorter than this [m] is a repeated point
# An arc that rises less over its chord [m] is a line: the kernel takes points so near for one, and
# the mesher may end the process on an arc of a radius of kilometres.
_FLAT = 1e-10


def turns_left(points: Sequence[tuple[float, float]], bulges: Sequence[float] = ()) -> bool:
    """Return whether a closed line runs counter-clockwise.

    The bulges are as of `face`.
    """
    area = 0.0
    bent = bulges or (0.0,) * len(points)
    for (ax, ay), (bx, by), bulge in zip(points, (*points[1:], points[0]), bent, strict=True):
        area += 0.5 * (ax * by - bx * ay)
        if bulge:
            sweep = 4.0 * math.atan(bulge)
            radius = 0.25 * math.hypot(bx - ax, by - ay) * (1.0 + bulge**2) / bulge
            area += 0.5 * radius**2 * (sweep - math.sin(sweep))
    return area > 0.0


def face(
    points: Sequence[tuple[float, float]], bulges: Sequence[float] = (), *, z: float = 0.0
) -> TopoDS_Shape:
    """Return the plane face inside a closed line of straight segments and circular arcs.

    Parameters
    ----------
    points : sequence of tuple of float
        The corners [m].
    bulges : sequence of float
        Tangent of a quarter of the angle of the arc after each corner, positive where it turns
        left; empty where all are straight.
    z : float
        Height of the plane [m].

    Returns
    -------
    netgen.occ.TopoDS_Shape
        The face, in the mesher's unit; its normal is +z whichever way round the line runs.

    Examples
    --------
    >>> disc = face(((-1e-3, 0.0), (1e-3, 0.0)), (1.0, 1.0))
    >>> round(disc.mass, 6)
    3.141593
    """
    corners, bent = list(points), list(bulges or (0.0,) * len(points))
    if not turns_left(corners, bent):
        # The mesher joins two faces along a shared edge only where their normals agree.
        corners.reverse()
        bent = [-b for b in (*bent[-2::-1], bent[-1])]

    def at(x: float, y: float) -> gp_Pnt:
        return gp_Pnt(x * METRE, y * METRE, z * METRE)

    edges = []
    for a, b, bulge in zip(corners, (*corners[1:], corners[0]), bent, strict=True):
        if math.dist(a, b) < _NOTHING:
            continue
        if 0.5 * abs(bulge) * math.dist(a, b) > _FLAT:
            # the middle of the arc lies a sagitta to the right of a chord that turns left
            middle = (
                0.5 * (a[0] + b[0] + bulge * (b[1] - a[1])),
                0.5 * (a[1] + b[1] - bulge * (b[0] - a[0])),
            )
            edges.append(ArcOfCircle(at(*a), at(*middle), at(*b)))
        else:
            edges.append(Segment(at(*a), at(*b)))
    return Face(Wire(edges))
