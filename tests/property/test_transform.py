"""Motions of the plane: what they leave alone, and what a mirror turns round."""

import dataclasses
import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from flexstage.hinges import CornerFilleted
from flexstage.lumped import lumped_system
from flexstage.stage import Circle, Loop, Stage
from flexstage.stage.contour import half_notch
from flexstage.stage.designs import design
from flexstage.stage.transform import PlaneMotion, moved
from flexstage.system import modes, static_displacements
from tests.strategies import angles, loops, points, stages

motions = st.builds(
    PlaneMotion,
    angle=angles,
    shift=st.tuples(st.floats(-0.3, 0.3), st.floats(-0.3, 0.3)),
    mirrored=st.booleans(),
)
NOTCH = CornerFilleted(
    neck_thickness=0.41e-3, notch_length=3.1e-3, fillet_radius=0.7e-3, one_sided=True
)


def numbers(part: Any) -> list[float]:
    """Every number in a part of a stage, angles as cosine and sine."""
    if isinstance(part, float):
        return [part]
    if isinstance(part, tuple):
        return [x for item in part for x in numbers(item)]
    if not dataclasses.is_dataclass(part):
        return []
    out: list[float] = []
    for field in dataclasses.fields(part):
        value = getattr(part, field.name)
        out += (
            [math.cos(value), math.sin(value)]
            if field.name == "direction" and value is not None
            else numbers(value)
        )
    return out


def same(a: Stage, b: Stage) -> bool:
    """Whether two stages are one, to rounding."""
    names = [[h.bodies for h in s.hinges] for s in (a, b)]
    return names[0] == names[1] and bool(
        np.allclose(numbers(a), numbers(b), rtol=1e-12, atol=1e-13)
    )


@given(stages(), angles, points)
@settings(max_examples=20, deadline=None)
def test_twice_in_a_mirror_is_the_same(stage: Stage, direction: float, through: Any) -> None:
    mirror = PlaneMotion.reflection(direction, through=through)
    assert same(moved(moved(stage, mirror), mirror), stage)


@given(stages(), angles, points)
@settings(max_examples=20, deadline=None)
def test_turned_there_and_back(stage: Stage, angle: float, about: Any) -> None:
    turned = moved(stage, PlaneMotion.rotation(angle, about=about))
    assert same(moved(turned, PlaneMotion.rotation(-angle, about=about)), stage)


@given(angles, points, points)
def test_points_on_the_line_stay_where_they_are(direction: float, through: Any, far: Any) -> None:
    mirror = PlaneMotion.reflection(direction, through=through)
    on = (through[0] + 0.7 * math.cos(direction), through[1] + 0.7 * math.sin(direction))
    assert mirror.point(on) == pytest.approx(on, abs=1e-14)
    # any other point goes to the other side, straight across
    image = mirror.point(far)
    across = (-math.sin(direction), math.cos(direction))
    middle = tuple(0.5 * (a + b) - c for a, b, c in zip(far, image, through, strict=True))
    assert abs(np.dot(middle, across)) < 1e-14
    assert mirror.turned(direction) == pytest.approx(math.remainder(direction, math.tau))


@given(loops(), motions)
def test_areas_are_kept(loop: Loop, motion: PlaneMotion) -> None:
    here, there = loop.integrals(), moved(loop, motion).integrals()
    assert there.area == pytest.approx(here.area, rel=1e-9, abs=1e-13)


def test_quarter_turns_are_exact() -> None:
    turned = PlaneMotion.rotation(0.5 * math.pi).point((0.1, 0.3))
    assert turned == (-0.3, 0.1)
    mirror = PlaneMotion.reflection(0.5 * math.pi)
    assert mirror.point((0.1, 0.3)) == (-0.1, 0.3)
    assert moved(Circle((0.1, 0.3), 0.02), mirror) == Circle((-0.1, 0.3), 0.02)


@given(motions, angles)
def test_the_open_side_of_a_notch_goes_along(motion: PlaneMotion, direction: float) -> None:
    hinge = dataclasses.replace(
        design("parallelogram").hinges[0], direction=direction, profile=NOTCH
    )
    image = moved(hinge, motion)
    for which, name in enumerate(hinge.bodies):
        there = half_notch(image, image.bodies.index(name)).integrals()
        here = moved(half_notch(hinge, which), motion).integrals()
        assert there == pytest.approx(here, rel=1e-9, abs=1e-15)


@given(motions)
@settings(max_examples=20, deadline=None)
def test_frequencies_and_ratios_do_not_see_it(motion: PlaneMotion) -> None:
    stage = design("vgtu-piezo")
    here, there = lumped_system(stage), lumped_system(moved(stage, motion))
    # 1e-7: stiffnesses differ by 1e8 among the coordinates of a body
    assert modes(there).omega == pytest.approx(modes(here).omega, rel=1e-7)
    pushed = {"x": 31e-6, "y": -7e-6}
    a, b = static_displacements(here, pushed), static_displacements(there, pushed)
    assert b.readings == pytest.approx(a.readings, rel=1e-7)
    assert b.hinge_stress == pytest.approx(a.hinge_stress, rel=1e-7)


def test_new_names_reach_whatever_bears_them() -> None:
    stage = design("vgtu-piezo")
    renamed = moved(stage, PlaneMotion(shift=(1e-3, 0.0)), lambda name: f"2{name}")
    assert {b.name for b in renamed.bodies} == {f"2{b.name}" for b in stage.bodies}
    assert [h.bodies for h in renamed.hinges] == [
        (f"2{a}", f"2{b}") for a, b in (h.bodies for h in stage.hinges)
    ]
    assert [(a.name, a.drive, a.probe) for a in renamed.axes] == [
        ("2x", "2x", "2x"),
        ("2y", "2y", "2y"),
    ]
    assert {row.axis for row in renamed.published} == {"2x", "2y"}
    # a mapping leaves alone what it does not have
    assert moved(stage.hinges[0], PlaneMotion(), {"G": "frame"}).bodies == ("frame", "xLu")
