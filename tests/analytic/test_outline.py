"""Area integrals of outlines with arcs, against closed forms of the shapes."""

import math

import numpy as np
import pytest

from flexstage.base.errors import StageError
from flexstage.stage import Circle, Loop


def test_circle_off_the_origin() -> None:
    a, x, y, xx, yy, xy = Circle((1.3, -2.1), 0.7).loop().integrals()
    area = math.pi * 0.7**2
    # Steiner's theorem on pi r^4/4
    expected = (
        area,
        1.3 * area,
        -2.1 * area,
        math.pi * 0.7**4 / 4 + 1.3**2 * area,
        math.pi * 0.7**4 / 4 + 2.1**2 * area,
        -1.3 * 2.1 * area,
    )
    assert (a, x, y, xx, yy, xy) == pytest.approx(expected, rel=1e-14)


def test_half_disc_has_its_centroid_at_four_thirds_over_pi() -> None:
    half = Loop(((-2.0, 0.0), (2.0, 0.0)), (0.0, 1.0))
    integrals = half.integrals()
    assert integrals.area == pytest.approx(2.0 * math.pi, rel=1e-15)
    assert integrals.y / integrals.area == pytest.approx(4.0 * 2.0 / (3.0 * math.pi), rel=1e-14)


def test_notch_takes_away_what_a_bump_adds() -> None:
    # the same arc turned right and left, on one side of a rectangle
    corners = ((0.0, 0.0), (3.0, 0.0), (3.0, 2.0), (0.0, 2.0))
    plain = Loop(corners).integrals()
    bump = Loop(corners, (0.31, 0.0, 0.0, 0.0)).integrals()
    notch = Loop(corners, (-0.31, 0.0, 0.0, 0.0)).integrals()
    assert bump.area - plain.area == pytest.approx(plain.area - notch.area, rel=1e-13)
    radius = 3.0 * (1 + 0.31**2) / (4 * 0.31)
    sweep = 4.0 * math.atan(0.31)
    assert bump.area - plain.area == pytest.approx(
        radius**2 / 2 * (sweep - math.sin(sweep)), rel=1e-13
    )


def test_second_moments_agree_with_a_fine_polygon() -> None:
    loop = Loop(((0.2, -0.4), (2.9, 0.1), (2.2, 1.7), (-0.3, 1.1)), (0.5, -0.2, 0.0, 1.4))
    fine = Loop(tuple(map(tuple, loop.polyline(tolerance=1e-9).tolist())))
    # chords of an arc lose about 2/3 of the tolerance times its length
    assert loop.integrals() == pytest.approx(fine.integrals(), rel=1e-7)


def test_direction_of_travel_does_not_matter() -> None:
    corners = ((0.0, 0.0), (3.0, 0.2), (2.0, 2.5))
    there = Loop(corners, (0.2, 0.0, -0.1)).integrals()
    back = Loop(corners[::-1], (0.0, -0.2, 0.1)).integrals()
    assert there == pytest.approx(back, rel=1e-13)


def test_reflection_keeps_the_area() -> None:
    loop = Loop(((0.0, 0.0), (3.0, 0.2), (2.0, 2.5)), (0.2, 0.0, -0.1))
    mirrored = loop.mapped(lambda p: (1.5 - p[0], p[1] + 0.3))
    assert mirrored.integrals().area == pytest.approx(loop.integrals().area, rel=1e-14)


@pytest.mark.parametrize(
    ("points", "bulges", "part"),
    [
        (((0.0, 0.0), (1.0, 0.0)), (), "at least 3 points"),
        (((0.0, 0.0), (1.0, 0.0), (1.0, 1.0)), (0.1,), "3 bulges"),
        (((0.0, 0.0), (1.0, math.nan), (1.0, 1.0)), (), "finite"),
    ],
)
def test_impossible_outlines_are_refused(points, bulges, part) -> None:
    with pytest.raises(StageError, match=part):
        Loop(points, bulges)


def test_polyline_stays_within_its_tolerance() -> None:
    corners = Circle((0.0, 0.0), 2.0).loop().polyline(tolerance=1e-4)
    middles = 0.5 * (corners + np.roll(corners, -1, axis=0))
    assert 2.0 - np.linalg.norm(middles, axis=1).min() <= 1e-4


@pytest.mark.parametrize("bulge", [5e-324, 2.9e-130, -1e-16])
def test_an_arc_that_is_flat_to_a_rounding_is_straight(bulge: float) -> None:
    square = ((0.0, 0.0), (2e-3, 0.0), (2e-3, 3e-3), (0.0, 3e-3))
    loop = Loop(square, (bulge, 0.0, 0.0, 0.3))
    assert loop == Loop(square, (0.0, 0.0, 0.0, 0.3))
    assert Loop(square, (bulge, 0.0, 0.0, 0.0)) == Loop(square)
    assert loop.integrals().area > 6e-6


@pytest.mark.parametrize("bulge", [1e-9, -1e-6, 3e-4, 0.0199, -0.0201, 0.3, -0.9])
def test_flat_arcs_have_their_own_moments(bulge: float) -> None:
    """Against the same arc as 100 000 chords, which leave 1e-10 of the segment out."""
    loop = Loop(((0.011, 0.007), (0.034, 0.012), (0.019, 0.031)), (bulge, 0.0, 0.0))
    start, end = loop.points[:2]
    chord = np.array(end) - start
    half = 2.0 * math.atan(abs(bulge))
    t = np.linspace(-half, half, 100_001)
    along = 0.5 + 0.5 * np.sin(t) / math.sin(half)
    off = np.sin(0.5 * (half + t)) * np.sin(0.5 * (half - t)) / math.sin(half)
    right = math.copysign(1.0, bulge) * np.array([chord[1], -chord[0]])
    arc = np.array(start) + along[:, None] * chord + off[:, None] * right
    found, expected = loop.integrals(), polygon_integrals(np.concatenate((arc, loop.points[2:])))
    straight = polygon_integrals(np.array(loop.points))
    for k in range(6):
        share = expected[k] - straight[k]  # of the arc
        assert found[k] == pytest.approx(expected[k], rel=1e-14, abs=2e-9 * abs(share))


def polygon_integrals(points: np.ndarray) -> list[float]:
    """Integrate over a polygon by the formula of its corners."""
    x, y = points.T
    nx, ny = np.roll(x, -1), np.roll(y, -1)
    cross = x * ny - nx * y
    return [
        math.fsum(cross) / 2.0,
        math.fsum(cross * (x + nx)) / 6.0,
        math.fsum(cross * (y + ny)) / 6.0,
        math.fsum(cross * (x**2 + x * nx + nx**2)) / 12.0,
        math.fsum(cross * (y**2 + y * ny + ny**2)) / 12.0,
        math.fsum(cross * (2 * x * y + x * ny + nx * y + 2 * nx * ny)) / 24.0,
    ]
