"""Published parts that are no plates of one thickness, or have no drive, as STEP files.

``python examples/published/parts.py`` writes them into the current folder, for ``flexstage part``:
the faces that others held are called ``fixed``. docs/explanation/published-stages.md compares the
results with the published ones, tests/published_stages.py has sources and loads.

Dimensions are those of the sources, in the unit in which one of theirs is one millimetre here.
"""

import math
from collections.abc import Callable, Sequence

from netgen import occ

Point = tuple[float, float]


def box(x: Point, y: Point, z: Point) -> occ.TopoDS_Shape:
    """Return a box between two values of each coordinate."""
    low, high = zip(x, y, z, strict=True)
    return occ.Box(low, high).solids[0]


def prism(points: Sequence[Point], height: float) -> occ.TopoDS_Shape:
    """Return the prism over a polygon."""
    corners = [occ.gp_Pnt(x, y, 0.0) for x, y in points]
    edges = [occ.Segment(p, q) for p, q in zip(corners, corners[1:] + corners[:1], strict=True)]
    return occ.Face(occ.Wire(edges)).Extrude(occ.Vec(0.0, 0.0, height)).solids[0]


def held(shape: occ.TopoDS_Shape, where: Callable[[float, float, float], bool]) -> occ.TopoDS_Shape:
    """Name the faces whose centres fulfil a condition."""
    for face in shape.faces:
        centre = face.center
        if where(centre.x, centre.y, centre.z):
            face.name = "fixed"
    return shape


def eight_wire_mirror() -> occ.TopoDS_Shape:
    """S. A. Nalkande: plate of 1 x 1 x 0.2 mm on eight wires of 0.05 x 0.05 x 1 mm.

    In the mesh of the source one wire is 0.03 mm shorter.
    """
    shape = box((-0.5, 0.5), (-0.5, 0.5), (0.0, 0.2))
    upper, lower = (0.15, 0.2), (0.0, 0.05)
    for middle, side, z, end in (
        (-0.25, 1, upper, 1.5), (0.25, 1, lower, 1.47),
        (-0.25, -1, lower, 1.5), (0.25, -1, upper, 1.5),
    ):  # fmt: skip
        along = (0.5, end) if side > 0 else (-end, -0.5)
        shape = shape + box(along, (middle - 0.025, middle + 0.025), z)
        across = (0.5, 1.5) if side < 0 else (-1.5, -0.5)
        shape = shape + box((-middle - 0.025, -middle + 0.025), across, z)
    shape = shape.UnifySameDomain().solids[0]
    return held(shape, lambda x, y, _: max(abs(x), abs(y)) > 1.4)


def four_blade_mirror() -> occ.TopoDS_Shape:
    """P. Sivakumar: plate of 1 x 1 x 0.2 mm on four blades of 1 x 1 x 0.01 mm."""
    shape = box((-0.5, 0.5), (-0.5, 0.5), (0.0, 0.2))
    for ends in ((0.5, 1.5), (-1.5, -0.5)):
        shape = shape + box(ends, (-0.5, 0.5), (0.19, 0.2)) + box((-0.5, 0.5), ends, (0.0, 0.01))
    shape = shape.UnifySameDomain().solids[0]
    return held(shape, lambda x, y, _: max(abs(x), abs(y)) > 1.4)


def torsion_accelerometer() -> occ.TopoDS_Shape:
    """V. Kolchuzhin: frame of 660 x 760 um on two beams of 2.6 x 249 um, 15 um thick."""

    def plate(x: Point, y: Point) -> occ.TopoDS_Shape:
        return box(x, y, (0.0, 15.0))

    def root(wide: float, narrow: float) -> occ.TopoDS_Shape:
        corners = [(wide, -6.25), (narrow, -1.3), (narrow, 1.3), (wide, 6.25)]
        return prism(corners if wide < narrow else corners[::-1], 15.0)

    anchor = plate((-11.0, 11.0), (-15.0, 15.0))
    others = [
        plate((-330.0, -270.0), (-325.0, 435.0)),
        plate((270.0, 330.0), (-325.0, 435.0)),
        plate((-270.0, 270.0), (25.0, 435.0)),
        plate((-270.0, 270.0), (-325.0, -25.0)),
        plate((-265.0, -16.0), (-1.3, 1.3)),
        plate((16.0, 265.0), (-1.3, 1.3)),
        root(-270.0, -265.0),
        root(270.0, 265.0),
        root(-11.0, -16.0),
        root(11.0, 16.0),
    ]
    # the anchor is a solid of its own, so that its lower face is one
    return held(
        occ.Glue([anchor, *others]),
        lambda x, y, z: abs(z) < 1e-6 and abs(x) < 1e-6 and abs(y) < 1e-6,
    )


def notched_beam() -> occ.TopoDS_Shape:
    """From amanabt/flexural_stage: beam of 25 x 1 x 1 mm with a round notch of radius 0.5 mm."""
    beam = box((-5.0, 20.0), (0.0, 1.0), (0.0, 1.0))
    notch = occ.Cylinder((0.5, 0.0, -1.0), occ.Z, 0.5, 3.0)
    return held((beam - notch).solids[0], lambda x, *_: x < -4.999)


def copper_wire() -> occ.TopoDS_Shape:
    """Seamplex (FeenoX): wire of 1.948 mm diameter, 151.5 mm long."""
    wire = occ.Cylinder((0.0, 0.0, 0.0), occ.X, 0.974, 151.5)
    return held(wire.solids[0], lambda x, *_: abs(x) < 1e-6)


def _sector(inner: float, outer: float, height: float, degrees: float) -> occ.TopoDS_Shape:
    """Return a part of a ring about the origin from the x axis, held there."""
    angle = math.radians(degrees)

    def arc(radius: float, begin: float, end: float) -> occ.TopoDS_Shape:
        at = [
            occ.gp_Pnt(radius * math.cos(a), radius * math.sin(a), 0.0)
            for a in (begin, 0.5 * (begin + end), end)
        ]
        return occ.ArcOfCircle(*at)

    out, back = arc(outer, 0.0, angle), arc(inner, angle, 0.0)
    edges = [out, occ.Segment(out.end, back.start), back, occ.Segment(back.end, out.start)]
    ring = occ.Face(occ.Wire(edges)).Extrude(occ.Vec(0.0, 0.0, height))
    return held(ring.solids[0], lambda _, y, __: abs(y) < 1e-9)


def quarter_circle_leaf() -> occ.TopoDS_Shape:
    """R. H. MacNeal and R. L. Harder: leaf of 0.2 x 0.1 in, a quarter of a circle of 4.22 in."""
    return _sector(4.12, 4.32, 0.1, 90.0)


def eighth_circle_rod() -> occ.TopoDS_Shape:
    """K.-J. Bathe and S. Bolourchi: rod of 1 x 1 in, an eighth of a circle of 100 in."""
    return _sector(99.5, 100.5, 1.0, 45.0)


#: What the files are called.
PARTS: dict[str, Callable[[], occ.TopoDS_Shape]] = {
    "eight-wire-mirror": eight_wire_mirror,
    "four-blade-mirror": four_blade_mirror,
    "torsion-accelerometer": torsion_accelerometer,
    "notched-beam": notched_beam,
    "copper-wire": copper_wire,
    "quarter-circle-leaf": quarter_circle_leaf,
    "eighth-circle-rod": eighth_circle_rod,
}


if __name__ == "__main__":
    for name, part in PARTS.items():
        part().WriteStep(f"{name}.step")
