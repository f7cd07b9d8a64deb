"""Mass, centre and inertia against hand formulas and against the reference stages."""

import dataclasses
import math

import numpy as np
import pytest
from hypothesis import assume, given, settings
from shapely import Point, Polygon, box
from shapely.ops import unary_union

from flexstage.hinges import RightCircular
from flexstage.hinges.registry import PROFILES
from flexstage.quantities.material import material
from flexstage.stage import Body, Circle, ExtraMass, Hinge, Loop, Stage
from flexstage.stage.contour import half_notch
from flexstage.stage.mass import mass_properties, outer_size
from tests.drawing_stages import NOTCHES
from tests.reference_stages import NAMES, reference_stage
from tests.strategies import loops

ALUMINIUM = material("Al 7075-T6")


def plate(**changes: object) -> Body:
    outline = Loop(((0.012, 0.031), (0.043, 0.031), (0.043, 0.048), (0.012, 0.048)))
    return Body(name="plate", outline=outline, **changes)


def alone(body: Body, *others: Body, hinges: tuple[Hinge, ...] = ()) -> Stage:
    return Stage(
        name="s", thickness=0.0085, material=ALUMINIUM, bodies=(body, *others), hinges=hinges
    )


def test_plate_with_holes_and_extra_mass() -> None:
    # 31 x 17 mm about (27.5, 39.5) mm, less a disc of 4.2 mm, plus 21 g
    w, h, rho = 0.031, 0.017, 0.0085 * ALUMINIUM.density
    r, at = 0.0042, (0.0215, 0.0371)
    extra = ExtraMass(mass=0.021, at=(0.0301, 0.0222), inertia=3.3e-7)
    parts = [
        (rho * w * h, (0.0275, 0.0395), rho * w * h * (w**2 + h**2) / 12.0),
        (-rho * math.pi * r**2, at, -rho * math.pi * r**4 / 2.0),
        (extra.mass, extra.at, extra.inertia),
    ]
    mass = sum(p[0] for p in parts)
    centre = tuple(sum(p[0] * p[1][k] for p in parts) / mass for k in (0, 1))
    inertia = sum(p[2] + p[0] * math.dist(p[1], centre) ** 2 for p in parts)
    for field in ("holes", "mounting_holes"):
        body = plate(**{field: (Circle(at, r),)}, extra_masses=(extra,))
        got = mass_properties(alone(body))["plate"]
        assert got.mass == pytest.approx(mass, rel=1e-13)
        assert got.centre == pytest.approx(centre, rel=1e-13)
        assert got.inertia == pytest.approx(inertia, rel=1e-12)


def test_a_body_of_steel_keeps_the_half_notches_of_the_plate() -> None:
    # 31 x 17 mm and half a circular notch on its right side
    steel, h, rho = material("Stainless steel 304"), 0.0085, ALUMINIUM.density
    notch = RightCircular(neck_thickness=0.6e-3, radius=2e-3)
    right = Loop(((0.047, 0.031), (0.06, 0.031), (0.06, 0.048), (0.047, 0.048)))
    joint = Hinge(
        name="h", bodies=("plate", "right"), at=(0.045, 0.04), direction=0.0, profile=notch
    )
    other = Body(name="right", outline=right)
    found = mass_properties(alone(plate(material=steel), other, hinges=(joint,)))
    area = 4.6e-3 * 2e-3 - math.pi * 2e-3**2 / 2.0
    bodies = {"plate": steel.density * 0.031, "right": rho * 0.013}
    for name, of_body in bodies.items():
        expected = h * (of_body * 0.017 + rho * area)
        assert found[name].mass == pytest.approx(expected, rel=1e-12)
    # its inertia is that of a rectangle where it has no notch, in proportion to the density
    bare = mass_properties(alone(plate(material=steel)))["plate"]
    mass = steel.density * h * 0.031 * 0.017
    assert bare.inertia == pytest.approx(mass * (0.031**2 + 0.017**2) / 12.0, rel=1e-12)


def test_the_frame_does_not_matter() -> None:
    # a leg of 1 mg, half a metre from the origin: digits would be lost about the origin
    leg = Loop(((0.0, 0.0), (0.0007, 0.0), (0.0007, 0.0021), (0.0, 0.0021)))
    near = mass_properties(alone(Body(name="leg", outline=leg)))["leg"]
    # powers of two, so that moving the corners rounds nothing itself
    far_leg = leg.mapped(lambda p: (p[0] + 0.5, p[1] - 0.25))
    far = mass_properties(alone(Body(name="leg", outline=far_leg)))["leg"]
    # the corners of the moved leg are rounded to 1e-16 / 0.7e-3 = 1.6e-13 of its width
    assert far.inertia == pytest.approx(near.inertia, rel=1e-12)


@pytest.mark.parametrize("one_sided", [False, True])
@pytest.mark.parametrize("kind", sorted(PROFILES))
def test_half_notches_belong_to_their_bodies(kind: str, one_sided: bool) -> None:
    """The drawn outline of each half, integrated as a polygon, is what is added to the body."""
    notch = next(p for p in NOTCHES.values() if p.kind == kind)
    profile = dataclasses.replace(notch, one_sided=one_sided)
    hinge = Hinge(name="h", bodies=("plate", "b"), at=(0.05, 0.04), direction=0.7, profile=profile)
    other = dataclasses.replace(plate(), name="b")
    bare = mass_properties(alone(plate(), other))
    with_notch = mass_properties(alone(plate(), other, hinges=(hinge,)))
    surface = 0.0085 * ALUMINIUM.density
    for which, name in enumerate(hinge.bodies):
        outline = Polygon(half_notch(hinge, which).polyline(1e-9)).buffer(0.0)
        a, b = bare[name], with_notch[name]
        # contours that are not arcs are drawn with arcs, to about 1e-3 of the area
        assert b.mass - a.mass == pytest.approx(surface * outline.area, rel=2e-3)
        moment = np.array(b.centre) * b.mass - np.array(a.centre) * a.mass
        centroid = moment / (b.mass - a.mass)
        reach = 2e-3 * max(profile.length, profile.root_height)
        assert centroid == pytest.approx((outline.centroid.x, outline.centroid.y), abs=reach)
        # Steiner: about the common centre, plate and notch add up
        polar = surface * polar_moment(outline, b.centre)
        plate_part = a.inertia + a.mass * math.dist(a.centre, b.centre) ** 2
        assert b.inertia - plate_part == pytest.approx(polar, rel=5e-3)


def polar_moment(polygon: Polygon, about: tuple[float, float]) -> float:
    """Integral of the squared distance from a point, by triangles with that point."""
    total = 0.0
    for part in getattr(polygon, "geoms", [polygon]):
        xy = np.array(part.exterior.coords) - about
        (x0, y0), (x1, y1) = xy[:-1].T, xy[1:].T
        cross = x0 * y1 - x1 * y0
        squares = x0**2 + x0 * x1 + x1**2 + y0**2 + y0 * y1 + y1**2
        total += abs(float(np.sum(cross * squares))) / 12.0
    return total


def sixty_four_gon(x: float, y: float, r: float) -> Polygon:
    """The polygon that the reference files hold in place of a circle."""
    return Point(x, y).buffer(r, quad_segs=16)


@pytest.mark.parametrize("name", NAMES)
def test_reference_stages(name: str) -> None:
    """To the printed digits, once circles are made the 64-gons that the reference was made with.

    The exact mass and the centre differ from the reference by what the polygons leave out: it is
    taken from polygons of 64 and of 16 384 sides, and is up to 0.04 % of a mass.
    """
    reference = reference_stage(name)
    exact = mass_properties(reference.stage)
    surface = reference.stage.thickness * ALUMINIUM.density
    largest = 0.0
    for body, entry in reference.data["bodies"].items():
        corrected, moment = exact[body].mass, np.array(exact[body].centre) * exact[body].mass
        for area, centre in air_differences(reference.data, body):
            corrected += surface * area
            moment += surface * area * np.array(centre)
        largest = max(largest, abs(corrected / exact[body].mass - 1.0))
        # half of the last printed digit, 1e-4 g and 1e-5 mm, and as much again for the fine polygon
        assert corrected * 1e3 == pytest.approx(entry["mass_g"], abs=1e-4)
        assert moment / corrected * 1e3 == pytest.approx(entry["cg"], abs=2e-5)
    # the correction is what explains the difference, and it is small
    assert 1e-4 < largest < 5e-4


def air_differences(data: dict, body: str) -> list[tuple[float, tuple[float, float]]]:
    """Area that 64-gons leave in a body and circles take out of it, with its centre [SI]."""
    entry = data["bodies"][body]
    cuts = [(x, y, r, None) for x, y, r in entry["circular_holes"]]
    for hinge in data["hinges"]:
        if body in (hinge["a"], hinge["b"]):
            (x, y), r, angle = hinge["c"], hinge["radius"], math.radians(hinge["angle_deg"])
            c, s = math.cos(angle), math.sin(angle)
            side = -1.0 if body == hinge["a"] else 1.0
            # the half of the notch that belongs to the body, between the centres of its circles
            reach = r + hinge["neck"] / 2
            corners = [(0, -reach), (side * r, -reach), (side * r, reach), (0, reach)]
            half = Polygon([(x + c * u - s * v, y + s * u + c * v) for u, v in corners])
            cuts += [(x - s * k * reach, y + c * k * reach, r, half) for k in (-1.0, 1.0)]
    out = []
    for x, y, r, half in cuts:
        coarse, fine = sixty_four_gon(x, y, r), Point(x, y).buffer(r, quad_segs=4096)
        gap = fine.difference(coarse)
        gap = gap if half is None else gap.intersection(half)
        out.append((gap.area * 1e-6, (gap.centroid.x * 1e-3, gap.centroid.y * 1e-3)))
    return out


def test_the_profile_of_one_notch_by_hand() -> None:
    notch = RightCircular(neck_thickness=0.5e-3, radius=1.3e-3)
    r, t = 1.3e-3, 0.5e-3
    half = box(0, -(r + t / 2), r, r + t / 2).difference(
        unary_union([Point(0, k * (r + t / 2)).buffer(r, quad_segs=4096) for k in (-1, 1)])
    )
    hinge = Hinge(name="h", bodies=("a", "b"), at=(0.0, 0.0), direction=0.0, profile=notch)
    assert half_notch(hinge, 1).integrals().area == pytest.approx(half.area, rel=1e-6)
    exact = r * (2 * r + t) - math.pi * r**2 / 2
    assert half_notch(hinge, 0).integrals().area == pytest.approx(exact, rel=1e-12)


@given(loops())
@settings(max_examples=40, deadline=None)
def test_bounds_are_those_of_a_fine_polygon(loop: Loop) -> None:
    """Arcs turn either way, more than half round too; the polygon stays within 2 um of them."""
    assume(all(math.dist(a, b) > 1e-5 and abs(k) > 1e-3 for a, b, k in loop.segments() if k))
    points = loop.polyline(2e-6)
    want = (*points.min(axis=0), *points.max(axis=0))
    assert loop.bounds() == pytest.approx(want, abs=3e-6)


def test_outer_size_is_that_of_all_outlines() -> None:
    """A plate with a half disc of 8.5 mm at its right end, whose arc bulges beyond its points."""
    disc = Loop(((0.043, 0.031), (0.043, 0.048)), (1.0, 0.0))
    stage = alone(plate(), Body(name="end", outline=disc))
    assert outer_size(stage) == pytest.approx((0.031 + 0.0085, 0.017, 0.0085))
