"""Which thin places of a part are necks: shapes drawn by hand, with their necks known."""

import math
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
import shapely

from flexstage.base.errors import StageError
from flexstage.export.drawing.contours import plate_contours
from flexstage.fem.whole_stage import plane_model
from flexstage.hinges import Leaf
from flexstage.lumped import lumped_system
from flexstage.quantities.material import material
from flexstage.stage import Body, Hinge, Loop, Stage, check
from flexstage.stage.drawing.drawn_stage import read_drawing
from flexstage.stage.drawing.requests import ContourOptions, DrawingOptions
from flexstage.stage.drawing.thickness import _Samples, _too_coarse
from flexstage.system import probe_stiffness
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


# ----------------------------------------------------- strips around corners

#: Middle lines of strips between two blocks [mm], their thickness [mm], and the straight parts.
STRIPS: dict[str, tuple[list[tuple[float, float]], float, int]] = {
    "leg with a corner": ([(0, 0), (0, 12.25), (9.5, 12.25)], 0.5, 2),
    "oblique leg": ([(0, 0), (0, 12.25), (9.5, 18)], 0.5, 2),
    "slight bend": ([(0, 0), (0, 12), (9.5, 13.9)], 0.5, 2),
    "folded spring": ([(0, 0), (0, 20), (1.5, 20), (1.5, 2), (9.5, 2)], 0.4, 4),
    "serpentine": (
        [(0, 0), (0, 3), (8, 3), (8, 7), (-8, 7), (-8, 11), (9.5, 11)],
        0.4,
        6,
    ),
}


def _sides(line: list[tuple[float, float]], thickness: float) -> tuple[list, list]:
    """Both sides of a middle line with mitred corners, from an end along x."""
    z = [complex(*p) for p in line]
    along = [(b - a) / abs(b - a) for a, b in pairwise(z)]
    half = 0.5 * thickness
    normals = [1j * along[0]]
    normals += [1j * (u + v) / (1.0 + (u.conjugate() * v).real) for u, v in pairwise(along)]
    # the ends lie on the edges of the blocks, along x and along y
    normals.append(1j / along[-1].real)
    left, right = ([p + s * half * n for p, n in zip(z, normals, strict=True)] for s in (1, -1))
    return [(p.real, p.imag) for p in left], [(p.real, p.imag) for p in right]


def _write_lines(path, loops: list[list[tuple[float, float]]]) -> None:
    """Write closed polygons as lines of a DXF file, by the group codes of the format."""
    tags = ["0", "SECTION", "2", "HEADER", "9", "$INSUNITS", "70", "4", "0", "ENDSEC"]
    tags += ["0", "SECTION", "2", "ENTITIES"]
    for loop in loops:
        for (ax, ay), (bx, by) in zip(loop, [*loop[1:], loop[0]], strict=True):
            tags += ["0", "LINE", "8", "0", "10", repr(ax), "20", repr(ay), "11", repr(bx)]
            tags += ["21", repr(by)]
    path.write_text("\n".join([*tags, "0", "ENDSEC", "0", "EOF", ""]))


def _stage_of(loop: list[tuple[float, float]], path, tip: tuple[float, float]) -> Stage:
    """The stage of a drawing with two rigid blocks, read in x and y where a strip ends."""
    _write_lines(path, [loop])
    x, y = tip
    options = DrawingOptions(
        thickness=5e-3,
        material="Al 7075-T6",
        fixed=("0,-5",),
        body=("0,-5: rigid", f"{x + 5},{y}: rigid"),
        probe=(f"x: {x},{y} at 0 deg", f"y: {x},{y} at 90 deg"),
    )
    stage = read_drawing(path, options).stage
    assert [i for i in check(stage) if i.severity == "error"] == []
    (plate,) = plate_contours(stage).contours
    drawn = shapely.Polygon(1e3 * plate.loop.polyline(1e-6))
    assert drawn.symmetric_difference(shapely.Polygon(loop)).area < 1e-6
    return stage


def _castigliano(line: list[tuple[float, float]], thickness: float, stage: Stage) -> dict:
    """Compliance of a bent strip at its end, by its middle line, with shear 6/5 V/GA."""
    t, h = 1e-3 * thickness, stage.thickness
    e, nu = stage.material.youngs_modulus, stage.material.poissons_ratio
    points = 1e-3 * np.array(line, dtype=float)
    total = np.zeros((2, 2))
    shares, weights = np.polynomial.legendre.leggauss(2)
    for a, b in pairwise(points):
        length = float(np.hypot(*(b - a)))
        u = (b - a) / length
        v = np.array([-u[1], u[0]])
        for share, weight in zip(0.5 * (shares + 1.0), 0.5 * weights, strict=True):
            x, y = points[-1] - a - share * (b - a)
            moment = np.array([-y, x])
            total += weight * length * 12.0 / (e * h * t**3) * np.outer(moment, moment)
        total += length / (e * h * t) * (np.outer(u, u) + 2.4 * (1.0 + nu) * np.outer(v, v))
    return {"x": float(total[0, 0]), "y": float(total[1, 1])}


@pytest.mark.parametrize("name", STRIPS)
def test_a_strip_around_corners_is_a_chain_of_leaves(name: str, tmp_path) -> None:
    line, thickness, parts = STRIPS[name]
    left, right = _sides(line, thickness)
    x, y = line[-1]
    end = [(x, y - 4), (x + 10, y - 4), (x + 10, y + 9), (x, y + 9)]
    loop = [*right, *end, *left[::-1], (-12, 0), (-12, -10), (8, -10), (8, 0)]
    stage = _stage_of(loop, tmp_path / "part.dxf", (x, y))
    assert len(stage.hinges) == parts
    assert {(h.profile.kind, h.profile.depth) for h in stage.hinges} == {("leaf", 0.0)}
    for hinge in stage.hinges:
        assert hinge.profile.neck_thickness == pytest.approx(1e-3 * thickness, rel=1e-9)
    lumped = lumped_system(stage, plane="stress")
    whole = plane_model(stage, plane="stress").system
    for probe, compliance in _castigliano(line, thickness, stage).items():
        stiffness = probe_stiffness(lumped, probe)
        assert stiffness == pytest.approx(1.0 / compliance, rel=0.005), probe
        # sharp corners are stiffer than their middle lines
        assert stiffness == pytest.approx(probe_stiffness(whole, probe), rel=0.025), probe


def test_a_leaf_may_end_flush_on_opposite_sides(tmp_path) -> None:
    loop = [(0.25, 0), (0.25, 30), (-20, 30), (-20, 20), (-0.25, 20)]
    loop += [(-0.25, -10), (20, -10), (20, 0)]
    _write_lines(path := tmp_path / "part.dxf", [loop])
    (hinge,) = read_drawing(path).stage.hinges
    assert hinge.profile == Leaf(neck_thickness=0.5e-3, leaf_length=20e-3, notch_depth=0.0)
    assert hinge.at == pytest.approx((0.0, 10e-3))


def test_bends_of_arcs_are_bodies_that_share_their_length_with_the_leaves(tmp_path) -> None:
    """A folded spring with half rings at its ends, against finite elements."""
    p, h = 1.5, 0.2
    right = [(h, 0, 0), (h, 20, -1), (p - h, 20, 0), (p - h, 2, 1), (2 * p + h, 2, 0)]
    left = [(2 * p - h, 2, -1), (p + h, 2, 0), (p + h, 20, 1), (-h, 20, 0), (-h, 0, 0)]
    top = [*_straight((2 * p + h, 24), (20, 24), (20, 34), (-12, 34), (-12, 24), (2 * p - h, 24))]
    base = _straight((-12, 0), (-12, -10), (12, -10), (12, 0))
    stage = _found(
        [[*right, *top, *left, *base]],
        tmp_path / "part.dxf",
        thickness=5e-3,
        fixed=("0,-5",),
        body=("0,-5: rigid", "3,30: rigid"),
        probe=("x: 3,24 at 0 deg", "y: 3,24 at 90 deg"),
    )
    assert len(stage.hinges) == 3
    lumped = lumped_system(stage, plane="stress")
    whole = plane_model(stage, plane="stress").system
    for probe in ("x", "y"):
        expected = probe_stiffness(whole, probe)
        assert probe_stiffness(lumped, probe) == pytest.approx(expected, rel=0.01), probe


def test_a_platform_between_two_leaves_is_no_bend(tmp_path) -> None:
    outline = [(-10.25, 0), (-10.25, 30), (10.25, 30), (10.25, 0), (20, 0), (20, -10)]
    outline += [(-20, -10), (-20, 0)]
    window = [(-9.75, 0), (-9.75, 20), (9.75, 20), (9.75, 0)]
    _write_lines(path := tmp_path / "part.dxf", [outline, window])
    stage = read_drawing(path).stage
    assert len(stage.bodies) == len(stage.hinges) == 2
    assert {h.profile.one_sided for h in stage.hinges} == {True}


def test_a_strip_that_tapers_is_refused(tmp_path) -> None:
    loop = [(0.25, 0), (0.35, 20), (20, 20), (20, 30), (-20, 30), (-20, 20), (-0.35, 20)]
    loop += [(-0.25, 0), (-20, 0), (-20, -10), (20, -10), (20, 0)]
    _write_lines(path := tmp_path / "part.dxf", [loop])
    with pytest.raises(StageError, match="matches no hinge profile"):
        read_drawing(path)


def _leaves(stage: Stage) -> list[tuple[float, float, float]]:
    """Return centre and length of the leaves of a stage [mm]."""
    assert {h.profile.kind for h in stage.hinges} == {"leaf"}
    return sorted(tuple(round(1e3 * v, 6) for v in (*h.at, h.profile.length)) for h in stage.hinges)


def test_leaves_may_share_one_straight_side(tmp_path) -> None:
    """Two legs carry a beam whose halves share their upper side, symmetric about x = 30 mm."""
    outline = [(-5, -10), (65, -10), (65, 0), (60, 0), (60, 20.5), (0, 20.5), (0, 0), (-5, 0)]
    window = [(0.5, 0), (59.5, 0), (59.5, 20), (35, 20), (35, 15), (25, 15), (25, 20), (0.5, 20)]
    stage = _found([_straight(*outline), _straight(*window)], tmp_path / "part.dxf")
    assert _leaves(stage) == [
        *((0.25, 10.0, 20.0), (12.75, 20.25, 24.5), (47.25, 20.25, 24.5), (59.75, 10.0, 20.0)),
    ]
    assert len(stage.bodies) == 4


@pytest.mark.parametrize("bulge", [0.0, 1.0])
def test_a_strip_with_a_free_end_is_no_leaf(bulge: float, tmp_path) -> None:
    """A leg with a bar across its end, on which nothing hangs."""
    loop = [
        *_straight((-10, -5), (10, -5), (10, 0), (0.25, 0), (0.25, 10)),
        *((10, 10, bulge), (10, 10.5, 0.0), (-10, 10.5, bulge), (-10, 10, 0.0)),
        *_straight((-0.25, 10), (-0.25, 0), (-10, 0)),
    ]
    limit = ContourOptions(neck_limit=1.2e-3)
    stage = _found([loop], tmp_path / "part.dxf", contours=limit)
    assert _leaves(stage) == [(0.0, 5.0, 10.0)]
    assert len(stage.bodies) == 2


@pytest.mark.parametrize(("leg", "link"), [(1.0, 0.9), (0.9, 1.0)])
def test_a_strip_is_one_leaf_however_it_is_found(leg: float, link: float, tmp_path) -> None:
    """Legs joined by a link too short to continue them, which continues in both of them."""
    lower = [(0, 0), (-12, 0), (-12, -10), (14, -10), (14, 0), (leg, 0), (leg, 10), (1.3, 10)]
    lower += [(1.3, 10.65 - 0.5 * link), (2.1, 10.65 - 0.5 * link), (2.1, 10), (3.4, 10)]
    upper = [(3.4 - x, 21.3 - y) for x, y in lower]
    limit = ContourOptions(neck_limit=1.05e-3)
    stage = _found([_straight(*lower, *upper)], tmp_path / "part.dxf", contours=limit)
    half = 0.5 * leg
    assert _leaves(stage) == [
        (half, 5.0, 10.0),
        (1.7, 10.65, 0.8),
        (round(3.4 - half, 6), 16.3, 10.0),
    ]
