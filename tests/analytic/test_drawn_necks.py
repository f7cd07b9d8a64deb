"""Which thin places of a part are necks: shapes drawn by hand, with their necks known."""

import math
from dataclasses import replace

import numpy as np
import pytest

from flexstage.base.errors import StageError
from flexstage.quantities.material import material
from flexstage.stage import Body, Hinge, Loop, Stage, check
from flexstage.stage.drawing.drawn_stage import read_drawing
from flexstage.stage.drawing.requests import ContourOptions, DrawingOptions
from flexstage.stage.drawing.thickness import _Samples, _too_coarse
from tests import foreign_drawings as foreign
from tests.drawing_stages import NOTCHES, guide
from tests.drawn_stages import dxf_without_hinges, require_same

Corner = tuple[float, float, float]  # with the bulge of what follows


def _found(loops: list[list[Corner]], path, **options) -> Stage:
    document = foreign.new()
    for loop in loops:
        document.modelspace().add_lwpolyline(loop, format="xyb", close=True)
    document.saveas(path)
    stage = read_drawing(path, DrawingOptions(**options)).stage
    faults = [i for i in check(stage) if i.severity == "error" and i.code != "thin-neck"]
    assert faults == []
    return stage


def _straight(*points: tuple[float, float]) -> list[Corner]:
    return [(x, y, 0.0) for x, y in points]


def _thick_and_thin(path, **options) -> Stage:
    """Two blocks on a neck 3 mm thick, and on a link 2 mm wide between necks of 0.3 mm."""
    outline = [
        *_straight((0, 0), (40, 0), (40, 15)),
        *((31, 15, -1.0), (31, 16.7, 0.0), (31, 19.3, -1.0), (31, 21, 0.0)),
        *_straight((40, 21), (40, 36), (0, 36), (0, 21)),
        *((5.5, 21, -1.0), (5.5, 15, 0.0), (0, 15, 0.0)),
    ]
    window = [
        *((14.5, 15, -1.0), (14.5, 21, 0.0)),
        *((29, 21, -1.0), (29, 19.3, 0.0), (29, 16.7, -1.0), (29, 15, 0.0)),
    ]
    return _found([outline, window], path, **options)


def test_a_neck_may_be_thicker_than_a_body_elsewhere(tmp_path) -> None:
    stage = _thick_and_thin(tmp_path / "part.dxf")
    assert len(stage.bodies) == 3
    necks = sorted(
        (h.profile.neck_thickness, *(round(c * 1e3, 6) for c in h.at)) for h in stage.hinges
    )
    assert necks == [
        (pytest.approx(0.3e-3), 30.0, 15.85),
        (pytest.approx(0.3e-3), 30.0, 20.15),
        (pytest.approx(3e-3), 10.0, 18.0),
    ]
    assert {h.profile.kind for h in stage.hinges} == {"circular"}


def test_a_limit_says_how_thick_a_neck_may_be(tmp_path) -> None:
    stage = _thick_and_thin(tmp_path / "part.dxf", contours=ContourOptions(neck_limit=1e-3))
    # the blocks are one body, held together by what was the thick neck
    assert len(stage.bodies) == 2
    assert len(stage.hinges) == 2


def test_a_neck_between_drilled_holes_ends_where_they_are_widest(tmp_path) -> None:
    """Two holes of 3 mm with slits of 1 mm: more than half of each circle is there."""
    radius, neck, half_slit = 3.0, 0.6, 0.5
    turn = math.asin(half_slit / radius)
    bulge = -math.tan((2.0 * math.pi - 2.0 * turn) / 4.0)
    reach = 0.5 * neck + radius + radius * math.cos(turn)
    outline = [
        *((0, 0, 0), (29.5, 0, 0), (29.5, 20 - reach, bulge), (30.5, 20 - reach, 0)),
        *((30.5, 0, 0), (63, 0, 0), (63, 40, 0), (30.5, 40, 0), (30.5, 20 + reach, bulge)),
        *((29.5, 20 + reach, 0), (29.5, 40, 0), (0, 40, 0)),
    ]
    (hinge,) = _found([outline], tmp_path / "part.dxf").hinges
    assert hinge.profile.kind == "circular"
    assert hinge.profile.neck_thickness == pytest.approx(0.6e-3, abs=1e-12)
    assert hinge.profile.length == pytest.approx(6e-3, abs=1e-12)
    assert hinge.at == pytest.approx((30e-3, 20e-3), abs=1e-12)


@pytest.mark.parametrize("apart", [0.7, 1.6, 3.1])
def test_leaves_beside_each_other_share_the_edge_between_them(apart: float, tmp_path) -> None:
    left, right = 20.0 - 0.5 * apart, 20.0 + 0.5 * apart
    outline = _straight(
        *((0, 0), (43, 0), (43, 10), (right + 0.4, 10), (right + 0.4, 30), (43, 30), (43, 40)),
        *((0, 40), (0, 30), (left - 0.4, 30), (left - 0.4, 10), (0, 10)),
    )
    between = _straight((left, 10), (right, 10), (right, 30), (left, 30))
    stage = _found([outline, between], tmp_path / "part.dxf")
    assert len(stage.bodies) == 2
    for hinge in stage.hinges:
        assert hinge.profile.kind == "leaf"
        assert hinge.profile.length == pytest.approx(20e-3, abs=1e-12)
        assert hinge.profile.depth < 0.5e-3 * apart


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["circular", "elliptical", "as-drawn"])
def test_a_hundred_necks_are_found(kind: str, tmp_path) -> None:
    profile = NOTCHES[kind]
    length, wide = profile.length, profile.root_height
    pitch, high = wide + 2.3e-3, length + 12e-3

    def block(name: str, x0: float, y0: float, x1: float, y1: float, fixed: bool = False) -> Body:
        return Body(name=name, outline=Loop(((x0, y0), (x1, y0), (x1, y1), (x0, y1))), fixed=fixed)

    bodies = [
        block("base", -5e-3, -20e-3, 50 * pitch + 5e-3, 0.0, True),
        block("top", -5e-3, high + length, 50 * pitch + 5e-3, high + length + 15e-3),
    ]
    hinges = []
    for k in range(50):
        x = (k + 0.5) * pitch
        bodies.append(block(f"bar{k}", x - 0.5 * wide, length, x + 0.5 * wide, high))
        for end, (a, b), y in (
            ("low", ("base", f"bar{k}"), 0.5 * length),
            ("high", (f"bar{k}", "top"), high + 0.5 * length),
        ):
            hinges.append(
                Hinge(
                    name=f"{end}{k}",
                    bodies=(a, b),
                    at=(x, y),
                    direction=0.5 * math.pi,
                    profile=profile,
                )
            )
    stage = Stage(
        name="comb",
        thickness=8e-3,
        material=material("Al 7075-T6"),
        bodies=tuple(bodies),
        hinges=tuple(hinges),
    )
    path = tmp_path / "part.dxf"
    dxf_without_hinges(stage).saveas(path)
    require_same(read_drawing(path).stage, stage)


def test_walls_beside_holes_and_pockets_are_no_necks(tmp_path) -> None:
    """Walls of 1 and 3 mm in one body: on both of their sides is the same one."""
    document = foreign.new()
    space = document.modelspace()
    space.add_lwpolyline([(0, 0), (70, 0), (70, 60), (0, 60)], close=True)
    space.add_lwpolyline([(46, 10), (67, 10), (67, 50), (46, 50)], close=True)
    space.add_circle((3.5, 3.5), 2.5)
    path = tmp_path / "part.dxf"
    document.saveas(path)
    with pytest.raises(StageError, match="contains no neck"):
        read_drawing(path)


@pytest.mark.parametrize("one_sided", [False, True])
def test_smooth_necks_of_every_kind_come_back(one_sided: bool, tmp_path) -> None:
    """Four kinds of the same sizes in one drawing, turned and shifted; drawn within 10 nm."""
    kinds = [replace(NOTCHES[k], one_sided=one_sided)
             for k in ("elliptical", "parabolic", "hyperbolic", "power")]  # fmt: skip
    stage = guide(kinds[0], turn=1.234, shift=(-13.7e-3, 8.9e-3))
    hinges = [replace(h, profile=p) for h, p in zip(stage.hinges, kinds, strict=True)]
    stage = replace(stage, hinges=tuple(hinges))
    path = tmp_path / "part.dxf"
    dxf_without_hinges(stage).saveas(path)
    found = read_drawing(path, DrawingOptions(thickness=stage.thickness))
    require_same(found.stage, stage)
    assert {n.certainty for n in found.necks} == {"sure"}


@pytest.mark.parametrize(("height", "coarse"), [(20, 0), (1, 36)])
def test_points_are_wanted_where_sides_face_each_other(height: int, coarse: int) -> None:
    """A square 20 mm wide has enough points every millimetre; a bar 1 mm thick wants more."""
    size = 2 * (20 + height)
    way = np.arange(size)
    x = np.interp(way, [0, 20, 20 + height, 40 + height, size], [0, 20, 20, 0, 0])
    y = np.interp(way, [0, 20, 20 + height, 40 + height, size], [0, 0, height, height, 0])
    one = np.zeros(size, dtype=int)
    samples = _Samples(
        at=1e-3 * np.column_stack((x, y)),
        contour=one,
        stroke=one,
        share=way / size,
        along=1e-3 * way,
        following=np.roll(np.arange(size), -1),
        length=np.full(size, 1e-3 * size),
    )
    assert len(_too_coarse(samples, np.full(size, 1e-3))) == coarse
