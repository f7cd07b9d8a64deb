"""The contours of a plate: closed, exact, and of the area that the bodies have."""

import dataclasses
import itertools
import math

import numpy as np
import pytest

from flexstage.base.errors import StageError
from flexstage.export.drawing.contours import plate_contours
from flexstage.hinges import RightCircular
from flexstage.hinges.profile import CurvedProfile
from flexstage.hinges.registry import PROFILES
from flexstage.stage import Circle, Loop, Stage, check, mass_properties
from flexstage.stage.contour import body_contour
from flexstage.stage.curve import Curve, crossings, distance, point_distance
from flexstage.stage.designs import design
from tests.drawing_stages import NOTCHES, PLATES, guide, least_distance, quick

STAGES = {**PLATES, **{n: guide(p) for n, p in NOTCHES.items()}}
ALL = pytest.mark.parametrize("stage", [quick(n, s) for n, s in STAGES.items()])


def body_area(stage: Stage) -> float:
    """Area of the bodies with their half notches, each by itself."""
    areas = []
    for body in stage.bodies:
        outline, holes = body_contour(stage, body)
        cut = (h.loop() if isinstance(h, Circle) else h for h in (*holes, *body.mounting_holes))
        areas += [outline.integrals().area, *(-h.integrals().area for h in cut)]
    return math.fsum(areas)


def test_the_stages_of_these_tests_are_sound_and_have_every_profile() -> None:
    assert {p.kind for p in NOTCHES.values()} == set(PROFILES)
    for name in NOTCHES:
        assert not [f for f in check(STAGES[name]) if f.severity == "error"], name


@ALL
def test_area_is_that_of_the_bodies(stage: Stage) -> None:
    # both are sums of the same closed forms, in another order: rounding only
    assert plate_contours(stage).area == pytest.approx(body_area(stage), rel=1e-12)


@ALL
def test_area_with_arcs_is_that_of_the_masses(stage: Stage) -> None:
    mass = math.fsum(m.mass for m in mass_properties(stage).values())
    mass -= math.fsum(e.mass for b in stage.bodies for e in b.extra_masses)
    expected = mass / (stage.material.density * stage.thickness)
    # arcs within 5 nm of profiles about 30 mm long in all, on 1000 mm^2; signs differ, so less
    assert plate_contours(stage).area == pytest.approx(expected, rel=1e-7)


@ALL
def test_contours_run_with_the_material_on_their_left(stage: Stage) -> None:
    plate = plate_contours(stage)
    for contour in plate.contours:
        polygon = contour.loop.polyline(1e-6)
        x, y = polygon.T
        signed = 0.5 * float(np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y))
        assert (signed > 0.0) == (contour.kind == "outline")
        assert signed == pytest.approx(math.copysign(contour.area, signed), rel=1e-3)


@ALL
def test_both_ends_of_every_neck_are_corners_of_contours(stage: Stage) -> None:
    plate = plate_contours(stage)
    corners = {p for c in plate.contours for p in c.loop.points}
    assert [n.hinge for n in plate.necks] == [h.name for h in stage.hinges]
    for neck, hinge in zip(plate.necks, stage.hinges, strict=True):
        assert math.dist(neck.right, neck.left) == pytest.approx(hinge.profile.neck_thickness)
        for end in (neck.right, neck.left):
            assert min(math.dist(end, p) for p in corners) < 1e-15


@ALL
def test_the_two_sides_of_a_notch_are_as_far_apart_as_its_neck_is_thick(stage: Stage) -> None:
    plate = plate_contours(stage)
    for hinge in stage.hinges:
        c, s = math.cos(hinge.direction), math.sin(hinge.direction)
        sides: tuple[list[Curve], list[Curve]] = ([], [])
        for contour in plate.contours:
            for segment, name in zip(contour.loop.segments(), contour.hinges, strict=True):
                if name == hinge.name:
                    x, y = Curve(*segment).point(0.5)
                    across = -s * (x - hinge.at[0]) + c * (y - hinge.at[1])
                    sides[across > 0.0].append(Curve(*segment))
        thickness = least_distance(itertools.product(*sides))
        assert thickness == pytest.approx(hinge.profile.neck_thickness, abs=1e-15)


@pytest.mark.parametrize("name", ["vgtu-mechanical", "circular", "circular-one-sided"])
def test_arcs_of_a_notch_keep_their_radius_and_number(name: str) -> None:
    stage = STAGES[name]
    plate = plate_contours(stage)
    for hinge in stage.hinges:
        assert isinstance(hinge.profile, RightCircular)
        radii = [
            abs(Curve(*s).radius)
            for c in plate.contours
            for s, h in zip(c.loop.segments(), c.hinges, strict=True)
            if h == hinge.name and s[2]
        ]
        # a quarter circle on either side of the neck, on every side that is cut
        assert len(radii) == 2 * hinge.profile.sides
        assert radii == pytest.approx([hinge.profile.radius] * len(radii), rel=1e-12)


def test_a_guide_has_the_segments_that_can_be_counted() -> None:
    plate = plate_contours(guide(NOTCHES["circular"]))
    # between the bars: their 2 sides, the edges of base and platform, 2 arcs at each of 4 necks,
    # and beside the 4 roots on bars a bit of edge up to the corner
    assert [len(c.loop.points) for c in plate.slots] == [2 + 2 + 8 + 4, 2]
    assert len(plate.holes) == 1
    # outside: base and platform have three edges more each, and a bit of edge on either side
    assert len(plate.outline.loop.points) == 2 * (3 + 2) + 8 + 2 + 4


def test_corners_in_straight_edges_are_taken_out() -> None:
    for contour in plate_contours(guide(NOTCHES["leaf"])).contours:
        segments = [Curve(*s) for s in contour.loop.segments()]
        necks = 0
        for k, b in enumerate(segments):
            a = segments[k - 1]
            if a.bulge or b.bulge:
                continue
            (ux, uy), (vx, vy) = a.direction(1.0), b.direction(0.0)
            necks += abs(ux * vy - uy * vx) < 1e-9
        assert necks == sum(h is not None for h in contour.hinges) / 2


def test_a_slot_through_the_edge_is_part_of_the_outline() -> None:
    plate = plate_contours(design("parallelogram"))
    assert set(plate.outline.bodies) == {"base", "left-leg", "right-leg", "platform"}
    assert set(filter(None, plate.outline.hinges)) == {
        h.name for h in design("parallelogram").hinges
    }


def test_a_plate_in_pieces_is_refused() -> None:
    stage = guide(NOTCHES["circular"])
    with pytest.raises(StageError, match=r"in 2 pieces .* join them by hinges"):
        plate_contours(dataclasses.replace(stage, hinges=stage.hinges[::2]))


def test_a_notch_beside_its_body_is_refused() -> None:
    stage = guide(NOTCHES["circular"])
    moved = dataclasses.replace(stage.hinges[0], at=(9.0, 9.0))
    with pytest.raises(StageError, match="is not attached to one straight edge"):
        plate_contours(dataclasses.replace(stage, hinges=(moved, *stage.hinges[1:])))


# ------------------------------------------------------------------ arcs in place of curves


@pytest.mark.parametrize("name", [n for n, p in NOTCHES.items() if isinstance(p, CurvedProfile)])
def test_arcs_follow_a_curved_profile_with_common_tangents(name: str) -> None:
    profile = NOTCHES[name]
    vertices = profile.contour()
    curves = [
        Curve((a.x, a.depth), (b.x, b.depth), a.bulge) for a, b in itertools.pairwise(vertices)
    ]
    x, depth, *_ = profile.samples()
    # the samples are the profile's own quadrature points, which the arcs were not fitted to
    for p in zip(x[::2].tolist(), depth[::2].tolist(), strict=True):
        assert min(point_distance(p, c) for c in curves) < 10e-9
    for a, b in itertools.pairwise(curves):
        (ux, uy), (vx, vy) = a.direction(1.0), b.direction(0.0)
        # the shortest arcs are 1e-5 m long and their ends are rounded to 1e-18 m
        assert abs(ux * vy - uy * vx) < 1e-9
    assert curves[0].direction(0.0) == pytest.approx((1.0, 0.0), abs=1e-12)
    assert vertices[-1] == (0.5 * profile.length, profile.depth, 0.0)


# ------------------------------------------------------------------ lines and arcs

_RNG = np.random.default_rng(20261)


def _some_curve() -> Curve:
    a, b = _RNG.uniform(-3.0, 3.0, (2, 2))
    bulge = float(_RNG.choice([0.0, 1.0])) * float(_RNG.uniform(-2.5, 2.5))
    return Curve((float(a[0]), float(a[1])), (float(b[0]), float(b[1])), bulge)


def test_distance_of_curves_is_that_of_fine_samples() -> None:
    shares = np.linspace(0.0, 1.0, 400)
    met = 0
    for _ in range(60):
        a, b = _some_curve(), _some_curve()
        pa, pb = (np.array([c.point(float(t)) for t in shares]) for c in (a, b))
        sampled = float(np.min(np.hypot(*(pa[:, None] - pb[None]).transpose(2, 0, 1))))
        found = distance(a, b)
        # samples stand apart by up to their spacing, along both curves
        spacing = max(a.length, b.length) / 399.0
        assert found <= sampled + 1e-12
        assert sampled - found < spacing
        met += found == 0.0
        for t, u in crossings(a, b):
            assert math.dist(a.point(t), b.point(u)) < 1e-9
    assert met > 5


def test_a_part_of_an_arc_lies_on_it() -> None:
    bow = Curve((0.3, -0.2), (2.1, 0.7), 1.7)
    part = bow.part(0.2, 0.7)
    assert part.radius == pytest.approx(bow.radius, rel=1e-13)
    assert part.length == pytest.approx(0.5 * bow.length, rel=1e-13)
    assert part.point(0.5) == pytest.approx(bow.point(0.45), abs=1e-14)


def test_curves_agree_with_the_polygon_of_a_loop() -> None:
    loop = Loop(((0.1, 0.2), (1.7, 0.3), (1.1, 1.9)), (0.3, -1.4, 0.0))
    for p in loop.polyline(1e-4):
        near = min(point_distance(tuple(p.tolist()), Curve(*s)) for s in loop.segments())
        assert near < 1e-14
