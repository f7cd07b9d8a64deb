"""Bodies are drawn as they are: the area of the drawn polygons is the area of the plate."""

import numpy as np
import pytest

from flexstage.report.figures.shapes import BodyShape, Placer, body_shapes, extent
from flexstage.stage import Circle, Stage, mass_properties
from flexstage.stage.designs import design

NAMES = ["vgtu-piezo", "vgtu-mechanical", "parallelogram"]


def signed_area(loop: np.ndarray) -> float:
    x, y = loop.T
    return 0.5 * float(np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y))


def area(shape: BodyShape) -> float:
    return sum(map(signed_area, shape.loops))


def plate_area(stage: Stage, name: str) -> float:
    return mass_properties(stage)[name].mass / (stage.material.density * stage.thickness)


@pytest.mark.parametrize("name", NAMES)
def test_drawn_area_is_the_area_of_the_body(name: str) -> None:
    stage = design(name)
    for shape in body_shapes(stage):
        # a chord within 10 um of its arc leaves out at most 2/3 of that along the arc: two quarter
        # circles at each half notch, and every circular hole
        arcs = sum(
            np.pi * h.profile.length / 2.0 for h in stage.hinges if shape.body.name in h.bodies
        )
        holes = (*shape.body.holes, *shape.body.mounting_holes)
        arcs += sum(2.0 * np.pi * hole.radius for hole in holes if isinstance(hole, Circle))
        expected = plate_area(stage, shape.body.name)
        assert area(shape) == pytest.approx(expected, abs=2.0 / 3.0 * 10e-6 * arcs, rel=1e-9)
        assert signed_area(shape.loops[0]) > 0.0
        assert all(signed_area(loop) < 0.0 for loop in shape.loops[1:])


def test_each_body_is_one_piece_with_its_notches() -> None:
    stage = design("vgtu-piezo")
    for shape in body_shapes(stage):
        openings = len(shape.body.holes) + len(shape.body.mounting_holes)
        assert len(shape.loops) == 1 + openings, shape.body.name


def test_labels_stand_inside_their_bodies() -> None:
    from matplotlib.path import Path

    shapes = body_shapes(design("vgtu-mechanical"))
    for shape in shapes:
        assert shape.room > 0.0
        x, y = shape.label_at
        assert Path(shape.loops[0]).contains_point((x, y))
        assert not any(Path(hole).contains_point((x, y)) for hole in shape.loops[1:])
        assert np.min(np.hypot(*(np.vstack(shape.loops) - (x, y)).T)) >= 0.99 * shape.room
    assert extent(shapes) == pytest.approx((-0.045, -0.0835, 0.139, 0.0835), abs=1e-3)


def test_labels_do_not_cover_each_other_while_there_is_room() -> None:
    placer = Placer((0.0, 0.0, 100.0, 60.0))
    places = [placer.place(50.0, 30.0, 7.0, 3.0, nearest=1.0) for _ in range(6)]
    for i, (x, y) in enumerate(places):
        assert not (abs(x - 50.0) < 3.5 and abs(y - 30.0) < 1.5)
        for u, v in places[:i]:
            across, up = 7.0 - abs(x - u), 3.0 - abs(y - v)
            # corners may touch: a fiftieth of a label is not its text
            assert max(across, 0.0) * max(up, 0.0) < 0.02 * 21.0


def test_labels_stay_within_the_drawing() -> None:
    placer = Placer((0.0, 0.0, 100.0, 60.0))
    x, y = placer.place(0.5, 59.5, 7.0, 3.0, nearest=1.0)
    assert 3.5 <= x <= 96.5
    assert 1.5 <= y <= 58.5
