"""Drawings by other programs' habits: each gives the stage, or is refused with the place."""

import math
from itertools import pairwise

import pytest

from flexstage.base.errors import StageError
from flexstage.stage import Circle, Stage
from flexstage.stage.designs import design
from flexstage.stage.drawing.drawn_stage import DrawnStage, read_drawing
from flexstage.stage.drawing.requests import ContourOptions, DrawingOptions
from tests import foreign_drawings as foreign
from tests.drawing_stages import NOTCHES, guide
from tests.drawn_stages import require_same

#: What a drawing is made with, and how near its sizes must come back [m]. Those with all digits
#: bring them back to the last; with six digits, at places below 100 mm, they are off by 50 nm.
HABITS = {
    "splines": (foreign.arcs_as_splines, 1e-9),
    "chords of 5 nm": (foreign.arcs_as_polylines(5e-6), 1e-9),
    "chords of 20 um": (foreign.arcs_as_polylines(20e-3), 1e-9),
    "soup": (foreign.soup, 1e-9),
    "inches": (foreign.inches, 1e-9),
    "tiny gaps": (foreign.tiny_gaps, 1e-9),
    "doubled": (foreign.doubled, 1e-9),
    "mirrored blocks": (foreign.mirrored_blocks, 1e-9),
    "words": (foreign.with_words, 1e-9),
    "from below": (foreign.from_below, 1e-9),
    "R12 polylines": (foreign.r12_polylines, 1e-9),
    "six digits": (foreign.six_digits, 0.2e-6),
}
_SMOOTH = ("elliptical", "elliptical-one-sided", "parabolic", "hyperbolic", "power")
_WITHOUT_UNIT = ("R12 polylines", "six digits")


def _read(document, path, stage: Stage, unit: str | None = None) -> DrawnStage:
    document.saveas(path)
    told = DrawingOptions(
        thickness=stage.thickness, material=stage.material.name, contours=ContourOptions(unit=unit)
    )
    return read_drawing(path, told)


def _comes_back(habit: str, stage: Stage, path, drawn_within: float = 0.0) -> None:
    make, within = HABITS[habit]
    within = max(within, drawn_within)
    unit = "mm" if habit in _WITHOUT_UNIT else None
    drawn = _read(make(stage), path, stage, unit)
    require_same(drawn.stage, stage, within=within, layers=False)


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("habit", HABITS)
def test_a_guide_comes_back_from_any_habit(habit: str, tmp_path) -> None:
    kinds = list(NOTCHES)
    # another notch for each habit, of those that are lines and arcs
    exact = [k for k in kinds if k.partition("-one")[0] in ("circular", "corner-filleted", "v")]
    kind = exact[list(HABITS).index(habit) % len(exact)]
    _comes_back(habit, guide(NOTCHES[kind]), tmp_path / "part.dxf")


@pytest.mark.parametrize(
    ("habit", "kind"),
    [
        # every habit with half of the notches, every notch with half of the habits
        pytest.param(habit, kind, marks=pytest.mark.evidence if (i + j) % 2 else pytest.mark.slow)
        for i, habit in enumerate(HABITS)
        for j, kind in enumerate(("leaf", "corner-filleted", "power", "as-drawn"))
    ],
)
def test_any_notch_comes_back_from_any_habit(habit: str, kind: str, tmp_path) -> None:
    smooth = kind in _SMOOTH
    if habit == "six digits" and smooth:
        pytest.skip("48 sides on a quarter of it are not how such a notch is drawn")
    if habit == "chords of 20 um" and kind == "as-drawn":
        pytest.skip("two chords stand for its arc of 45 degrees: they are what was drawn")
    # what is drawn of those that are no arcs is within 10 nm of them
    _comes_back(habit, guide(NOTCHES[kind]), tmp_path / "part.dxf", 10e-9 if smooth else 0.0)


@pytest.mark.slow
@pytest.mark.parametrize("habit", ["splines", "inches", "six digits"])
def test_a_study_stage_comes_back_from_any_habit(habit: str, tmp_path) -> None:
    _comes_back(habit, design("vgtu-piezo"), tmp_path / "part.dxf")


def test_what_is_no_contour_is_counted(tmp_path) -> None:
    stage = design("parallelogram")
    drawn = _read(foreign.with_words(stage), tmp_path / "part.dxf", stage)
    assert dict(drawn.excluded) == {
        "dimension": 1,
        "hatch": 1,
        "line on layer 0": 1,
        "line on layer CENTERLINES": 1,
        "point": 1,
        "text": 2,
    }


def test_holes_in_an_array_of_blocks_of_unequal_scales_are_round_again(tmp_path) -> None:
    """A block drawn twice as wide as high, put in place in rows and columns, half as wide."""
    stage = design("parallelogram")
    document = foreign.soup(stage)
    block = document.blocks.new("BOLT")
    block.add_ellipse((0, 0), (3.0, 0.0), 0.5)
    place = {"xscale": 0.5, "column_count": 3, "column_spacing": 3.5, "row_count": 2}
    place |= {"row_spacing": 3.8}
    document.modelspace().add_blockref("BOLT", (-7.0, -12.5), dxfattribs=place)
    drawn = _read(document, tmp_path / "part.dxf", stage)
    (base,) = (b for b in drawn.stage.bodies if b.fixed)
    small = sorted(c.centre for c in base.mounting_holes if c.radius < 2e-3)
    assert small == sorted((x, y) for x in (-7e-3, -3.5e-3, 0.0) for y in (-12.5e-3, -8.7e-3))
    assert {c.radius for c in base.mounting_holes} == {1.5e-3, 2.75e-3}


def test_lines_of_six_digits_give_round_places_and_drilled_holes(tmp_path) -> None:
    """A plate as a modeller of solids writes it: polygons of 96 and 48 sides, cut from a square."""
    from shapely import Polygon, box

    def polygon(x: float, y: float, radius: float, sides: int) -> Polygon:
        turn = [2.0 * math.pi * k / sides for k in range(sides)]
        return Polygon([(x + radius * math.cos(a), y + radius * math.sin(a)) for a in turn])

    holes = [(x, y) for x in (7.0, 113.0) for y in (7.0, 73.0)]
    cut = [box(14, 16, 22, 60), box(14, 58, 88, 60), box(30, 16, 70, 46), box(78, 16, 88, 60)]
    cut += [polygon(x, y, 3.6, 96) for x in (22.0, 30.0, 70.0, 78.0) for y in (20.0, 42.0)]
    cut += [polygon(x, y, 2.75, 48) for x, y in holes]
    plate = box(0, 0, 120, 80)
    for shape in cut:
        plate = plate.difference(shape)
    document = foreign.new(None)
    for ring in (plate.exterior, *plate.interiors):
        short = [(float(f"{x:.6g}"), float(f"{y:.6g}")) for x, y in ring.coords]
        for a, b in pairwise(short):
            document.modelspace().add_line(a, b)
    path = tmp_path / "part.dxf"
    document.saveas(path)
    stage = read_drawing(path, DrawingOptions(contours=ContourOptions(unit="mm"))).stage
    assert [(h.profile.kind, h.at) for h in stage.hinges] == [
        ("circular", (26e-3, 42e-3)),
        ("circular", (74e-3, 42e-3)),
        ("circular", (26e-3, 20e-3)),
        ("circular", (74e-3, 20e-3)),
    ]
    for hinge in stage.hinges:
        assert math.degrees(hinge.direction) == pytest.approx(90.0, abs=1e-12)
        assert (hinge.profile.neck_thickness, hinge.profile.length) == (0.8e-3, 7.2e-3)
    (frame,) = (b for b in stage.bodies if b.fixed)
    assert set(frame.mounting_holes) == {Circle((x * 1e-3, y * 1e-3), 2.75e-3) for x, y in holes}
    corners = {c for b in stage.bodies for p in b.outline.points for c in p}
    assert all(round(c, 6) == c for c in corners)


def test_a_notch_of_an_ellipse_entity_comes_back(tmp_path) -> None:
    """ELLIPSE as it is: half of one on each side of each neck."""
    profile = NOTCHES["elliptical"]
    stage = guide(profile, 0.0, (0.0, 0.0))
    document = foreign.new()
    space = document.modelspace()
    half, depth = 0.5e3 * profile.length, 1e3 * profile.depth
    for loop in foreign.contours(stage):
        run: list[foreign.Segment] = []
        # begin with a line, so that no chain of arcs is cut
        first = next((k for k, (*_, bulge) in enumerate(loop) if not bulge), 0)
        for segment in [*loop[first:], *loop[:first], None]:
            if segment is not None and segment[2]:
                run.append(segment)
                continue
            if len(run) > 2:
                # the chain of arcs from root to root, along y; the axis across points to -x
                (x, y0), (_, y1) = run[0][0], run[-1][1]
                to_left = run[len(run) // 2][0][0] < x
                low = 0.0 if to_left else math.pi
                space.add_ellipse(
                    (x, 0.5 * (y0 + y1)), (0.0, half), depth / half, low, low + math.pi
                )
            for piece in run if len(run) <= 2 else ():
                foreign.draw_arc(space, piece)
            run = []
            if segment is not None:
                foreign.draw_arc(space, segment)
    drawn = _read(document, tmp_path / "part.dxf", stage)
    require_same(drawn.stage, stage, layers=False)


# ----------------------------------------------------------------------------- refusals


def _square(space, low: float = 0.0, high: float = 40.0) -> None:
    space.add_lwpolyline([(low, low), (high, low), (high, high), (low, high)], close=True)


def _refused(document, path, **options) -> str:
    document.saveas(path)
    with pytest.raises(StageError) as caught:
        read_drawing(path, DrawingOptions(**options))
    return str(caught.value)


def test_a_large_gap_is_refused_with_its_place(tmp_path) -> None:
    stage = design("parallelogram")
    document = foreign.soup(stage, gap=0.05)
    said = _refused(document, tmp_path / "part.dxf")
    for part in ("the contour is open at (", "50 um away", "--contours gap=LENGTH"):
        assert part in said
    told = DrawingOptions(contours=ContourOptions(gap=60e-6))
    require_same(read_drawing(tmp_path / "part.dxf", told).stage, stage, within=1e-9, layers=False)


def test_a_gap_is_told_in_the_unit_of_the_drawing(tmp_path) -> None:
    document = foreign.new(1)
    document.modelspace().add_lwpolyline([(0, 0), (4, 0), (4, 3), (0, 3), (0, 0.5)])
    said = _refused(document, tmp_path / "part.dxf")
    assert "open at (0, 0.5) inch" in said
    assert "at (0, 0) inch" in said


@pytest.mark.parametrize(
    ("points", "said"),
    [
        ([(0, 0), (40, 40), (40, 0), (0, 40)], "crosses or touches itself at (20, 20) mm"),
        ([(10, 10), (60, 10), (60, 20), (10, 20)], "two contours cross or touch at (40, "),
    ],
)
def test_crossing_contours_are_refused_with_the_place(points, said: str, tmp_path) -> None:
    document = foreign.new()
    if points[0] != (0, 0):
        _square(document.modelspace())
    document.modelspace().add_lwpolyline(points, close=True)
    assert said in _refused(document, tmp_path / "part.dxf")


def test_lines_that_branch_are_refused_with_the_place(tmp_path) -> None:
    document = foreign.new()
    space = document.modelspace()
    _square(space)
    space.add_lwpolyline([(0, 0), (10, 20), (40, 40)])
    assert "3 lines meet at (40, 40) mm" in _refused(document, tmp_path / "part.dxf")


def test_several_parts_and_loose_pieces_are_refused(tmp_path) -> None:
    document = foreign.new()
    _square(document.modelspace())
    _square(document.modelspace(), 100.0, 120.0)
    assert "2 separate parts" in _refused(document, tmp_path / "a.dxf")
    document = foreign.new()
    for low, high in ((0.0, 40.0), (5.0, 35.0), (10.0, 20.0)):
        _square(document.modelspace(), low, high)
    assert "loose piece" in _refused(document, tmp_path / "b.dxf")


def test_a_part_without_necks_is_refused(tmp_path) -> None:
    document = foreign.new()
    _square(document.modelspace())
    assert "contains no neck" in _refused(document, tmp_path / "part.dxf")


def test_a_drawing_without_a_unit_is_refused(tmp_path) -> None:
    document = foreign.new(None)
    document.header["$INSUNITS"] = 0
    _square(document.modelspace())
    assert "give --contours unit=UNIT" in _refused(document, tmp_path / "part.dxf")
    assert "unknown unit" in _refused(
        document, tmp_path / "part.dxf", contours=ContourOptions(unit="foot")
    )


def test_a_neck_with_two_different_halves_is_refused_with_the_place(tmp_path) -> None:
    # one side slanted, the other level: no half is like the other
    document = foreign.new()
    slanted = [
        *((0, 0), (20, 0), (20, 8), (28, 8), (28, 0), (50, 0), (50, 20), (28, 20), (28, 9.7)),
        *((20, 8.5), (20, 20), (0, 20)),
    ]
    document.modelspace().add_lwpolyline(slanted, close=True)
    said = _refused(document, tmp_path / "slanted.dxf")
    assert "the neck about (20, 8" in said
    assert "both halves must be equal" in said


def test_a_file_that_is_no_drawing_is_refused(tmp_path) -> None:
    path = tmp_path / "part.dxf"
    path.write_text("no drawing\n")
    with pytest.raises(StageError, match="cannot be read as a DXF file"):
        read_drawing(path)
    with pytest.raises(StageError, match="there is no drawing"):
        read_drawing(tmp_path / "other.dxf")
