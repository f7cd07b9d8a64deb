"""Figures of a stage that a search bounds: slots, walls, necks, drives, buckling."""

import dataclasses
import itertools
import math

import pytest

from flexstage.base.errors import StageError
from flexstage.lumped import lumped_system
from flexstage.quantities.quantity import QUANTITIES
from flexstage.stage import Body, Circle, Loop, Stage, check
from flexstage.stage.designs import design
from flexstage.stage.narrowest import narrowest_slot, thinnest_wall
from flexstage.stage.transform import PlaneMotion, moved
from flexstage.studies.explore.family import STAGE_FIGURES, stage_figures
from flexstage.system import analyse
from tests.analytic.test_checks import body, box, loop, slotted, stage_of
from tests.reference_stages import NAMES, reference_stage


def slot(*bodies: Body) -> float:
    """The narrowest slot in millimetres."""
    return 1e3 * narrowest_slot(stage_of(*bodies))


def wall(*bodies: Body) -> float:
    return 1e3 * thinnest_wall(stage_of(*bodies))


@pytest.mark.parametrize("gap", [7.3, 0.352, 0.01, 0.0, -0.01, -0.83])
def test_a_gap_between_two_blocks_and_less_than_none_where_they_overlap(gap: float) -> None:
    blocks = body("a", box(0, 0, 5, 3)), body("b", box(5 + gap, 1, 17, 4))
    assert slot(*blocks) == pytest.approx(gap, abs=1e-9)
    turned = moved(stage_of(*blocks), PlaneMotion(angle=0.731, shift=(0.11, -0.07)))
    assert 1e3 * narrowest_slot(turned) == pytest.approx(gap, abs=1e-9)


@pytest.mark.parametrize("angle", [0.0, 0.4, 1.9])
@pytest.mark.parametrize("width", [2.1, 0.34, 0.011])
def test_a_slot_within_a_body(angle: float, width: float) -> None:
    assert slot(slotted(width, angle)) == pytest.approx(width, rel=1e-9)


def test_round_holes_windows_and_what_lies_in_them() -> None:
    hole = Circle((3.1e-3, 2e-3), 0.65e-3)
    assert slot(body("a", box(0, 0, 8, 5), mounting_holes=(hole,))) == pytest.approx(1.3)
    window = box(1, 1, 4, 3.2)
    frame = body("a", box(0, 0, 8, 5), holes=(window,))
    assert slot(frame) == pytest.approx(2.2)
    inner = body("b", box(1.7, 1.4, 3.5, 2.7))
    assert slot(frame, inner) == pytest.approx(0.4)
    # a slot that ends round is as wide as its sides are apart: the end is no narrower
    round_end = loop(
        (0, 0), (11, 0), (11, 7), (5.6, 7), (5.6, 2), (5, 2), (5, 7), (0, 7), bulges=(0,) * 8
    )
    ended = dataclasses.replace(round_end, bulges=(0.0, 0.0, 0.0, 0.0, -1.0, 0.0, 0.0, 0.0))
    assert slot(body("a", ended)) == pytest.approx(0.6, rel=2e-3)
    # corners are no slots, however sharp they are to the eye: 60 degrees
    wedge = loop((1, 1), (4, 1), (2.5, 3.5981))
    assert slot(body("a", box(0, 0, 8, 5), holes=(wedge,))) == math.inf


def test_walls_of_bodies() -> None:
    assert wall(body("a", box(0, 0, 8, 5))) == pytest.approx(5.0)
    hole = Circle((3.1e-3, 1.2e-3), 0.65e-3)
    assert wall(body("a", box(0, 0, 8, 5), mounting_holes=(hole,))) == pytest.approx(0.55)
    other = Circle((4.6e-3, 1.4e-3), 0.55e-3)
    near = body("a", box(0, 0, 8, 5), mounting_holes=(hole, other))
    assert wall(near) == pytest.approx(math.hypot(1.5, 0.2) - 1.2)
    windows = box(1, 1, 4, 4), box(4.1, 1, 7, 4)
    assert wall(body("a", box(0, 0, 8, 5), holes=windows)) == pytest.approx(0.1)
    # between a slot and the outer side: 4.7 mm to the left of it, less than 11 - 6.4
    assert wall(slotted(2.1)) == pytest.approx(2.0)


@pytest.mark.parametrize("name", NAMES)
def test_the_narrowest_slot_is_what_the_checks_hold_to_the_wire(name: str) -> None:
    """The wire passes just below it, and does not just above."""
    stage = reference_stage(name).stage
    found = narrowest_slot(stage)
    for share, passes in ((0.996, True), (1.004, False)):
        limits = dataclasses.replace(stage.manufacture, wire_width=share * found)
        codes = {issue.code for issue in check(dataclasses.replace(stage, manufacture=limits))}
        assert (not codes & {"narrow-slot", "narrow-notch"}) is passes


def test_the_narrowest_slot_goes_with_the_geometry_without_a_jump() -> None:
    """A disc goes through a block: its slot falls by what it moves, into the overlap."""
    found = []
    for k in range(40):
        disc = Circle(((7.0 - 0.05 * k) * 1e-3, 1.3e-3), 1.17e-3).loop()
        found.append(slot(body("a", box(0, 0, 5, 3)), body("b", disc)))
    steps = [one - other for one, other in itertools.pairwise(found)]
    assert all(step == pytest.approx(0.05, abs=1e-3) for step in steps)
    assert found[0] > 0.0 > found[-1]


def test_an_outline_that_crosses_itself_has_no_slots() -> None:
    crossed = body("a", loop((0, 0), (5, 5), (5, 0), (0, 5)))
    with pytest.raises(StageError, match="crosses"):
        narrowest_slot(stage_of(crossed))


def figures(stage: Stage) -> dict[tuple[str, str], float]:
    return stage_figures(stage, lumped_system(stage))


def test_forces_of_drives_and_what_they_leave_of_the_stroke() -> None:
    """A stack of stiffness k_d against a stage of k_s moves it by k_d/(k_d + k_s) of its stroke."""
    stage = design("vgtu-piezo")
    found, system = figures(stage), lumped_system(stage)
    rows = {(r.quantity, r.axis): r.value for r in analyse(stage, system).characteristics}
    for axis in stage.axes:
        drive = stage.drive_of(axis.name)
        stiffness, stack = rows["input_stiffness", axis.name], drive.spring
        assert stack is not None
        assert drive.stroke is not None
        assert found["drive_force", axis.name] == pytest.approx(stiffness * drive.stroke)
        assert found["stroke_left", axis.name] == pytest.approx(stack / (stack + stiffness))
        assert found["drive_force_share", axis.name] == pytest.approx(
            stiffness * drive.stroke / drive.blocking_force  # type: ignore[attr-defined]
        )
    necks = [hinge.profile.neck_thickness for hinge in stage.hinges]
    assert found["smallest_neck", "stage"] == min(necks)
    assert found["smallest_slot", "stage"] == narrowest_slot(stage)
    assert found["smallest_wall", "stage"] == thinnest_wall(stage)
    platform = stage.probe(stage.axes[0].probe).body
    assert found["output_wall", stage.axes[0].name] == thinnest_wall(stage, platform)
    assert thinnest_wall(stage, platform) > thinnest_wall(stage)
    # what is asked for alone, of one axis
    axis = stage.axes[1].name
    one = stage_figures(stage, system, [("buckling_factor", axis), ("smallest_neck", "stage")])
    assert one == {key: found[key] for key in one}
    assert set(one) == {("buckling_factor", axis), ("smallest_neck", "stage")}


def test_a_rigid_screw_keeps_its_stroke_and_has_no_share() -> None:
    found = figures(design("vgtu-mechanical"))
    assert found["stroke_left", "x"] == 1.0
    assert not [key for key in found if key[0] == "drive_force_share"]


def test_every_axis_of_drives_together_has_the_largest_of_them() -> None:
    stage = design("three-rrr")
    found = figures(stage)
    states = {a.axis: a.static.drive_force for a in analyse(stage, lumped_system(stage)).axes}
    for axis, forces in states.items():
        assert len(forces) == 3
        assert found["drive_force", axis] == pytest.approx(max(map(abs, forces.values())))
        assert found["buckling_factor", axis] > 1.0


def test_every_figure_is_a_quantity() -> None:
    assert set(STAGE_FIGURES) <= set(QUANTITIES)


def test_a_plate_alone_has_a_figure_of_its_own() -> None:
    plate = Loop(((0.0, 0.0), (0.03, 0.0), (0.03, 0.02), (0.0, 0.02)))
    found = figures_of_plate(stage_of(body("a", plate)))
    assert found == {"smallest_wall": pytest.approx(0.02), "smallest_slot": math.inf}


def figures_of_plate(stage: Stage) -> dict[str, float]:
    return {quantity: value for (quantity, _), value in stage_figures(stage, None).items()}
