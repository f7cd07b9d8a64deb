"""The path of the wire: what it leaves is the part, to a nanometre at the necks.

Evidence (Exported files): wire path (distances to the part): $10^{-12}$ m
"""

import dataclasses
import math
from functools import lru_cache

import numpy as np
import pytest
import shapely

from flexstage.base.errors import StageError
from flexstage.export.drawing.contours import PlateContours, plate_contours
from flexstage.export.drawing.wire import WirePath, cuts, offset_contours
from flexstage.hinges import AsDrawn, Elliptical, RightCircular
from flexstage.hinges.straight import Leaf
from flexstage.quantities.material import material
from flexstage.stage import Body, Circle, Loop, Stage
from flexstage.stage.curve import Curve, point_distance
from tests.drawing_stages import NOTCHES, PLATES, guide, least_distance, quick

KERF = 0.31e-3
STAGES = {**PLATES, **{n: guide(p) for n, p in NOTCHES.items()}}
ALL = pytest.mark.parametrize("name", [quick(n, n) for n in STAGES])


@lru_cache
def made(name: str) -> tuple[PlateContours, tuple[WirePath, ...]]:
    plate = plate_contours(STAGES[name])
    return plate, offset_contours(plate, 0.5 * KERF)


def plate_of(outline: Loop, *holes: Loop | Circle) -> PlateContours:
    body = Body(name="plate", outline=outline, holes=holes, fixed=True)
    stage = Stage(name="p", thickness=1e-3, material=material("Al 7075-T6"), bodies=(body,))
    return plate_contours(stage)


def curves(loop: Loop) -> list[Curve]:
    return [Curve(*s) for s in loop.segments()]


# ------------------------------------------------------------------ closed forms


def test_round_a_polygon_the_path_gains_its_length_and_a_full_circle() -> None:
    # Steiner: area and length of the parallel body of a convex one
    corners = ((0.0, 0.0), (31e-3, 2e-3), (27e-3, 19e-3), (3e-3, 23e-3))
    (path,) = offset_contours(plate_of(Loop(corners)), d := 0.7e-3)
    plate = Loop(corners)
    length = sum(c.length for c in curves(plate))
    area = plate.integrals().area + length * d + math.pi * d**2
    assert path.loop.integrals().area == pytest.approx(area, rel=1e-13)
    total = sum(c.length for c in curves(path.loop))
    assert total == pytest.approx(length + 2.0 * math.pi * d, rel=1e-13)


def test_in_a_rectangular_slot_the_path_is_a_smaller_rectangle() -> None:
    frame = Loop(((-9e-3, -9e-3), (29e-3, -9e-3), (29e-3, 29e-3), (-9e-3, 29e-3)))
    slot = Loop(((0.0, 0.0), (13e-3, 0.0), (13e-3, 4e-3), (0.0, 4e-3)))
    d = 0.3e-3
    _, path = offset_contours(plate_of(frame, slot), d)
    assert len(path.loop.points) == 4
    expected = (13e-3 - 2 * d) * (4e-3 - 2 * d)
    assert path.loop.integrals().area == pytest.approx(expected, rel=1e-13)


def test_a_slot_as_wide_as_the_cut_is_passed_and_a_narrower_one_is_refused() -> None:
    frame = Loop(((-9e-3, -9e-3), (29e-3, -9e-3), (29e-3, 29e-3), (-9e-3, 29e-3)))
    slot = Loop(((0.0, 0.0), (13e-3, 0.0), (13e-3, 0.4e-3), (0.0, 0.4e-3)))
    plate = plate_of(frame, slot)
    _, path = offset_contours(plate, 0.2e-3)
    # there and back along one line
    assert path.loop.integrals().area == pytest.approx(0.0, abs=1e-15)
    assert sum(c.length for c in curves(path.loop)) == pytest.approx(2.0 * 12.6e-3, rel=1e-9)
    with pytest.raises(StageError, match=r"a kerf of 0\.42 mm does not fit between the edges"):
        offset_contours(plate, 0.21e-3)


def test_a_waist_that_the_wire_does_not_pass_is_refused() -> None:
    frame = Loop(((-9e-3, -9e-3), (29e-3, -9e-3), (29e-3, 29e-3), (-9e-3, 29e-3)))
    corners = ((0.0, 0.0), (6e-3, 1.9e-3), (12e-3, 0.0), (12e-3, 4e-3), (6e-3, 2.1e-3), (0.0, 4e-3))
    plate = plate_of(frame, Loop(corners))
    assert len(offset_contours(plate, 0.09e-3)) == 2
    with pytest.raises(StageError, match="does not fit between the edges"):
        offset_contours(plate, 0.11e-3)


def test_short_edges_that_the_wire_does_not_reach_are_left_out() -> None:
    frame = Loop(((-9e-3, -9e-3), (29e-3, -9e-3), (29e-3, 29e-3), (-9e-3, 29e-3)))
    # a chamfer of 0.1 mm in a corner, which a wire of 0.6 mm spans
    corners = ((0.1e-3, 0.0), (9e-3, 0.0), (9e-3, 7e-3), (0.0, 7e-3), (0.0, 0.1e-3))
    _, path = offset_contours(plate_of(frame, Loop(corners)), 0.3e-3)
    assert len(path.loop.points) == 4


def test_the_path_in_a_round_opening_is_a_circle() -> None:
    frame = Loop(((-9e-3, -9e-3), (29e-3, -9e-3), (29e-3, 29e-3), (-9e-3, 29e-3)))
    _, path = offset_contours(plate_of(frame, Circle((7e-3, 8e-3), 3e-3)), 0.2e-3)
    assert path.circle == Circle((7e-3, 8e-3), 2.8e-3)


@ALL
def test_arcs_of_notches_keep_their_centre(name: str) -> None:
    stage = STAGES[name]
    plate, paths = made(name)
    for hinge in stage.hinges:
        if not isinstance(hinge.profile, RightCircular):
            continue
        r, t = hinge.profile.radius, hinge.profile.neck_thickness
        centre = hinge.to_plane(0.0, 0.5 * t + r)
        found = [
            c
            for p in paths
            for c in curves(p.loop)
            if c.bulge < 0.0 and abs(math.dist(c.start, centre) - (r - 0.5 * KERF)) < 1e-12
        ]
        assert {round(-c.radius, 12) for c in found} == {round(r - 0.5 * KERF, 12)}
    assert plate.necks


# ------------------------------------------------------------------ what the wire leaves


@ALL
def test_nowhere_is_the_path_nearer_to_the_part_than_half_the_cut(name: str) -> None:
    plate, paths = made(name)
    sides = [c for contour in plate.contours for c in curves(contour.loop)]
    shares = np.linspace(0.0, 1.0, 9).tolist()

    def line(c: Curve) -> shapely.LineString:
        return shapely.LineString([c.point(t) for t in shares])

    tree = shapely.STRtree([line(c) for c in sides])
    near = (
        (c, sides[j])
        for path in paths
        for c in curves(path.loop)
        for j in tree.query(line(c), predicate="dwithin", distance=2.0 * KERF)
    )
    # exact distances of lines and arcs; 1e-12 m is the rounding of their centres
    assert least_distance(near) == pytest.approx(0.5 * KERF, abs=1e-12)


@ALL
def test_the_cut_part_has_the_necks_of_the_design_to_a_nanometre(name: str) -> None:
    plate, paths = made(name)
    for neck in plate.necks:
        ux, uy = (b - a for a, b in zip(neck.right, neck.left, strict=True))
        t = math.hypot(ux, uy)
        reach = [
            min(point_distance(p, c) for path in paths for c in curves(path.loop))
            for p in (neck.right, neck.left)
        ]
        # the wire takes away what is within half the cut of its centre: it takes the surface at
        # each end of the neck, and no more
        assert sum(reach) - KERF == pytest.approx(0.0, abs=1e-12)
        (x0, y0), (x1, y1) = neck.right, neck.left
        middle = (0.5 * (x0 + x1), 0.5 * (y0 + y1))
        room = min(point_distance(middle, c) for path in paths for c in curves(path.loop))
        assert 2.0 * (room - 0.5 * KERF) == pytest.approx(t, abs=1e-9)


@pytest.mark.parametrize("name", ["vgtu-piezo", "elliptical", "leaf-one-sided", "v", "power"])
def test_sweeping_a_disc_along_the_path_leaves_the_part(name: str) -> None:
    plate, paths = made(name)
    tolerance = 20e-9
    lines = [shapely.LinearRing(p.loop.polyline(tolerance)) for p in paths]
    swept = shapely.union_all([line.buffer(0.5 * KERF, quad_segs=64) for line in lines])
    part = shapely.Polygon(
        # mounting holes are drilled
        plate.outline.loop.polyline(tolerance),
        [c.loop.polyline(tolerance) for c in plate.slots],
    )
    # chords of the path and of the disc: 20 nm + 0.5 KERF (pi/128)^2/2 = 47 nm, along all edges
    length = sum(c.length for contour in plate.contours for c in curves(contour.loop))
    assert swept.intersection(part).area < 70e-9 * length
    # between the cut and the part nothing is left but the rest of re-entrant corners, each
    # (1 - pi/4) of a square of half the cut for a right angle
    beside = part.buffer(0.4 * KERF, quad_segs=64).difference(part)
    rest = beside.difference(swept).buffer(-0.3e-6)
    pieces = [g for g in getattr(rest, "geoms", [rest]) if not g.is_empty]
    assert all(g.area < (0.5 * KERF) ** 2 for g in pieces)


def test_a_cut_wider_than_a_notch_is_refused_by_name_and_radius() -> None:
    plate = plate_contours(guide(NOTCHES["circular"]))
    expected = (
        r"a kerf of 3\.6 mm does not fit into the notch of hinge 'h\d\d', .* radius of 1\.7 mm"
    )
    with pytest.raises(StageError, match=expected):
        offset_contours(plate, 1.8e-3)


def test_a_cut_as_wide_as_a_leaf_is_long_does_not_reach_its_neck() -> None:
    short = Leaf(neck_thickness=0.4e-3, leaf_length=0.5e-3, notch_depth=3e-3)
    plate = plate_contours(guide(short))
    assert offset_contours(plate, 0.24e-3)
    with pytest.raises(StageError, match=r"a kerf of 0\.54 mm does not (fit|reach)"):
        offset_contours(plate, 0.27e-3)


def test_corners_of_chords_keep_the_wire_off_a_neck_and_arcs_do_not() -> None:
    # at a corner that turns by a an amount d (1/cos(a/2) - 1) is left, 9 nm at this neck
    ellipse = NOTCHES["elliptical"]
    assert isinstance(ellipse, Elliptical)
    angles = 0.5 * math.pi * np.arange(1, 65) / 64
    chords = AsDrawn(
        neck_thickness=ellipse.neck_thickness,
        distances=tuple((ellipse.half_length * np.sin(angles)).tolist()),
        depths=tuple((ellipse.notch_depth * (1.0 - np.cos(angles))).tolist()),
    )
    with pytest.raises(
        StageError, match=r"neck of hinge 'h00' .* or arcs for a notch .* in chords"
    ):
        offset_contours(plate_contours(guide(chords)), 0.5 * KERF)
    assert offset_contours(plate_contours(guide(ellipse)), 0.5 * KERF)


def test_the_wire_does_not_enter_on_a_notch_even_where_it_is_threaded_in_one() -> None:
    plate, paths = made("vgtu-mechanical")
    # as wide as this, most start holes fit into the notches only
    found = cuts(plate, paths, 0.5 * KERF, 1.9e-3)
    in_notch = 0
    for cut in found:
        contour = cut.path.contour
        notches = [
            Curve(*s)
            for s, h in zip(contour.loop.segments(), contour.hinges, strict=True)
            if h is not None
        ]
        in_notch += any(point_distance(cut.start, n) < 1.6e-3 for n in notches)
        assert all(point_distance(cut.entry, n) > 0.5 * KERF + 0.5e-6 for n in notches)
    assert in_notch > 2


def test_a_round_opening_narrower_than_the_cut_is_refused() -> None:
    frame = Loop(((-9e-3, -9e-3), (29e-3, -9e-3), (29e-3, 29e-3), (-9e-3, 29e-3)))
    with pytest.raises(StageError, match=r"an edge of body 'plate', .* radius of 0\.3 mm"):
        offset_contours(plate_of(frame, Circle((7e-3, 8e-3), 0.3e-3)), 0.31e-3)


# ------------------------------------------------------------------ threading


@ALL
def test_start_holes_lie_in_the_waste_and_lead_straight_to_the_path(name: str) -> None:
    plate, paths = made(name)
    hole = 0.8e-3
    sides = [c for contour in plate.contours for c in curves(contour.loop)]
    found = cuts(plate, paths, 0.5 * KERF, hole)
    assert sorted(c.number for c in found) == list(range(1, len(paths) + 1))
    for cut in found:
        contour = cut.path.contour
        inside = shapely.Polygon(contour.loop.polyline(1e-6)).contains(shapely.Point(cut.start))
        assert inside == (contour.kind == "slot")
        assert min(point_distance(cut.start, s) for s in sides) > 0.5 * hole
        on_path = min(point_distance(cut.entry, c) for c in curves(cut.path.loop))
        if cut.path.circle is not None:
            circle = cut.path.circle
            on_path = abs(math.dist(cut.entry, circle.centre) - circle.radius)
        assert on_path < 1e-12
        lead = Curve(cut.start, cut.entry)
        assert least_distance((lead, s) for s in sides) > 0.5 * KERF - 1e-9
        # the wire enters beside the notches, not on them
        notches = [
            Curve(*s)
            for s, h in zip(contour.loop.segments(), contour.hinges, strict=True)
            if h is not None
        ]
        assert all(point_distance(cut.entry, n) > 0.5 * KERF + 0.5e-6 for n in notches)


@ALL
def test_contours_are_cut_from_inside_outwards(name: str) -> None:
    plate, paths = made(name)
    order = [c.path.contour for c in cuts(plate, paths, 0.5 * KERF, 0.8e-3)]
    groups = [2 if c.kind == "outline" else int(any(c.hinges)) for c in order]
    assert groups == sorted(groups)
    assert order[-1] is plate.outline


def test_a_start_hole_that_does_not_fit_is_refused() -> None:
    plate, paths = made("circular")
    with pytest.raises(StageError, match=r"start hole of 50 mm does not fit .* space for \d"):
        cuts(plate, paths, 0.5 * KERF, 50e-3)


def test_mirrored_slots_are_numbered_the_same_way_every_time() -> None:
    plate, paths = made("vgtu-mechanical")
    first = [(c.number, c.start) for c in cuts(plate, paths, 0.5 * KERF, 0.8e-3)]
    turned = dataclasses.replace(plate, slots=plate.slots[::-1])
    again = offset_contours(turned, 0.5 * KERF)
    assert [(c.number, c.start) for c in cuts(turned, again, 0.5 * KERF, 0.8e-3)] == first
