"""Two guides of one axis each, side by side and stacked: what rigid bodies must do."""

import math
from dataclasses import replace

import numpy as np
import pytest

from flexstage.base.errors import StageError
from flexstage.hinges import RightCircular
from flexstage.lumped import lumped_system
from flexstage.stage import Loop, Stage, mass_properties
from flexstage.stage.checks import check
from flexstage.stage.designs.pieces import Leg
from flexstage.stage.designs.two_guides import (
    SideBySideXYParameters,
    SingleAxisParameters,
    StackedXYParameters,
    joined,
    plates,
    side_by_side_xy,
    stacked_xy,
)
from flexstage.stage.drive import ScrewActuator
from flexstage.system import drive_stiffness, modes, static_displacements

X = SingleAxisParameters(
    leg=Leg(notch=RightCircular(neck_thickness=0.61e-3, radius=1.7e-3), bar_length=19e-3),
    leg_spacing=33e-3,
    platform_height=27e-3,
    actuator=ScrewActuator(pitch=0.2e-3, smallest_step=0.3e-6, travel=130e-6),
)
Y = replace(X, leg_spacing=29e-3, platform_height=23e-3, actuator_length=3e-3)
BESIDE = SideBySideXYParameters(x=X, y=Y, gap=1.5e-3, thickness=9e-3)
STACKED = StackedXYParameters(x=X, y=Y, spacer=2.2e-3, thickness=9e-3)


def moved(stage: Stage, drive: str) -> dict[str, tuple[float, float, float]]:
    """Motion of every body for 1 um of a drive, rigid bodies."""
    return static_displacements(lumped_system(stage), {drive: 1e-6}).body_motion


@pytest.mark.parametrize("stage", [side_by_side_xy(BESIDE), stacked_xy(STACKED)], ids=str)
def test_there_is_nothing_wrong_with_them(stage: Stage) -> None:
    assert [issue for issue in check(stage) if issue.severity == "error"] == []


def test_side_by_side_the_second_guide_rides_on_the_first() -> None:
    stage = side_by_side_xy(BESIDE)
    system, alone = lumped_system(stage), lumped_system(X.build(BESIDE))
    # the guide of x is as stiff as it is alone, and what it moves has the yaw of its platform
    assert drive_stiffness(system, "x") == pytest.approx(drive_stiffness(alone, "x"), rel=1e-5)
    by_x = moved(stage, "x")
    assert by_x["platform"][2] == pytest.approx(by_x["carriage"][2], rel=1e-9)
    assert by_x["carriage"][2] == pytest.approx(
        moved(X.build(BESIDE), "x")["platform"][2], rel=1e-4
    )
    # and its platform goes across by the yaw times the arm from the middle of that guide
    arm = stage.probe("x").at[0]
    assert arm > X.leg_spacing
    state = static_displacements(system, {"x": 1e-6})
    assert state.readings["y"] == pytest.approx(arm * by_x["carriage"][2], rel=1e-6)
    # the drive of y stands on the carriage, which bears its reaction
    assert moved(stage, "y")["platform"][1] == pytest.approx(1e-6, rel=1e-4)


def test_side_by_side_a_slot_stays_between_the_guides() -> None:
    stage = side_by_side_xy(BESIDE)
    right = max(x for x, _ in stage.body("base").outline.points)
    arm = [x for x, y in stage.body("carriage").outline.points if y < 0.012]
    assert min(arm) - right == pytest.approx(BESIDE.gap)


def test_the_lower_guide_carries_the_upper_plate() -> None:
    lower, upper = plates(STACKED)
    masses = mass_properties(upper)
    whole = sum(m.mass for m in masses.values())
    riding = lower.body("platform").extra_masses
    assert sum(m.mass for m in riding) == pytest.approx(whole)
    assert [m.inertia for m in riding] == [m.inertia for m in masses.values()]
    # turned by a quarter, with the middle of its platform above that of the lower one
    above, middle = lower.probe("x").at, upper.probe("x").at
    for mass, drawn in zip(riding, masses.values(), strict=True):
        assert mass.at[0] - above[0] == pytest.approx(drawn.centre[1] - middle[1])
        assert mass.at[1] - above[1] == pytest.approx(drawn.centre[0] - middle[0])
    bare = X.build(STACKED)
    slower = (
        modes(lumped_system(lower)).frequency_hz[0] / modes(lumped_system(bare)).frequency_hz[0]
    )
    share = mass_properties(bare)["platform"].mass / mass_properties(lower)["platform"].mass
    assert slower == pytest.approx(math.sqrt(share), rel=0.03)  # the legs move as well


def test_the_stack_is_drawn_as_its_two_plates() -> None:
    stage, (lower, upper) = stacked_xy(STACKED), plates(STACKED)
    system = lumped_system(stage)
    for axis, plate in (("x", lower), ("y", upper)):
        alone = lumped_system(plate)
        assert drive_stiffness(system, axis) == pytest.approx(drive_stiffness(alone, "x"))
    both = np.sort(
        np.concatenate([modes(lumped_system(plate)).frequency_hz for plate in (lower, upper)])
    )
    assert modes(system).frequency_hz == pytest.approx(both[: modes(system).frequency_hz.size])


def test_heights_are_those_of_the_top_above_the_middles() -> None:
    assert STACKED.heights == pytest.approx((9e-3 + 2.2e-3 + 4.5e-3, 4.5e-3))


def test_outlines_are_joined_along_their_edges() -> None:
    one = Loop(((0.0, 0.0), (2e-3, 0.0), (2e-3, 3e-3), (0.0, 3e-3)))
    two = Loop(((2e-3, 1e-3), (5e-3, 1e-3), (5e-3, 2e-3), (2e-3, 2e-3)))
    whole = joined(one, two)
    assert whole.integrals().area == pytest.approx(9e-6)
    assert len(whole.points) == 8


def test_impossible_dimensions_are_refused() -> None:
    with pytest.raises(StageError, match="leg_spacing must be at least"):
        side_by_side_xy(replace(BESIDE, x=replace(X, leg_spacing=2e-3)))
    with pytest.raises(StageError, match="platform_height"):
        SingleAxisParameters(platform_height=-1e-3)
