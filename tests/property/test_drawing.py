"""Drawings of guides with any notch, anywhere: area, necks, and what a wire leaves of them."""

import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from flexstage.base.errors import StageError
from flexstage.export.drawing.contours import plate_contours
from flexstage.export.drawing.wire import offset_contours
from flexstage.stage import Circle
from flexstage.stage.contour import body_contour
from flexstage.stage.curve import Curve, distance, point_distance
from tests.drawing_stages import guide
from tests.strategies import profiles

turns = st.floats(-4.0, 4.0)
shifts = st.tuples(st.floats(-0.4, 0.4), st.floats(-0.4, 0.4))


@settings(max_examples=12, deadline=None)
@given(profiles(), turns, shifts)
def test_area_and_necks_of_any_guide(profile, turn, shift) -> None:
    stage = guide(profile, turn, shift)
    plate = plate_contours(stage)
    total = 0.0
    for body in stage.bodies:
        outline, holes = body_contour(stage, body)
        cut = [h.loop() if isinstance(h, Circle) else h for h in (*holes, *body.mounting_holes)]
        total += outline.integrals().area - sum(h.integrals().area for h in cut)
    # about an origin up to 0.6 m away, areas of triangles of 0.1 m^2 make up 1e-3 m^2
    assert plate.area == pytest.approx(total, rel=1e-12)
    assert len(plate.slots) == 2
    for neck in plate.necks:
        assert math.dist(neck.right, neck.left) == pytest.approx(profile.neck_thickness, abs=1e-15)


@settings(max_examples=8, deadline=None)
@given(profiles(), turns, st.floats(0.02e-3, 0.4e-3))
def test_a_wire_path_either_leaves_the_necks_or_is_refused(profile, turn, offset) -> None:
    plate = plate_contours(guide(profile, turn))
    refused, paths = None, ()
    try:
        paths = offset_contours(plate, offset)
    except StageError as error:
        refused = str(error)
    if refused is not None:
        assert "use a" in refused
        # nothing but a sharp bend of a notch, or a leaf as short as the cut, stands in the way
        bends = [Curve(*s) for c in plate.contours for s in c.loop.segments() if s[2] < 0.0]
        sharpest = min((-c.radius for c in bends), default=math.inf)
        assert sharpest < offset + 1e-9 or profile.length < 2.5 * offset + profile.depth
        return
    curves = [Curve(*s) for p in paths for s in p.loop.segments()]
    for neck in plate.necks:
        for end in (neck.right, neck.left):
            reach = min(point_distance(end, c) for c in curves)
            assert reach == pytest.approx(offset, abs=1e-9)


numbers = st.floats(-1.0, 1.0)
bulges = st.one_of(st.just(0.0), st.floats(-2.0, -0.05), st.floats(0.05, 2.0))
curves = st.builds(Curve, st.tuples(numbers, numbers), st.tuples(numbers, numbers), bulges).filter(
    lambda c: math.dist(c.start, c.end) > 0.05
)


@given(curves, curves)
def test_distance_is_symmetric_and_below_that_of_points(a, b) -> None:
    d = distance(a, b)
    assert d == pytest.approx(distance(b, a), abs=1e-12)
    for k in range(11):
        assert d <= point_distance(a.point(k / 10), b) + 1e-9


@given(curves, st.floats(0.001, 0.02))
def test_a_parallel_curve_is_everywhere_at_its_distance(curve, offset) -> None:
    moved = curve.shifted(offset)
    for k in range(1, 10):
        p = moved.point(k / 10)
        assert point_distance(p, curve) == pytest.approx(offset, abs=1e-12)
        x, y = curve.point(k / 10)
        tx, ty = curve.direction(k / 10)
        assert (x + offset * ty, y - offset * tx) == pytest.approx(p, abs=1e-12)
