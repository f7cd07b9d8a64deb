r"""What scatter does to the motion of a stage: closed forms, and the model in the plane.

Evidence (Stages, tolerances, designs): scattered stages (neck by neck): 0.2 %, *consistency*; yaw
from unparallel legs ($(e_1-e_2)/(ls)$): 1 %, unequal legs ($d^2\delta l/(2l^2s)$): 3 %; Abbe error:
$2\cdot10^{-11}$ m
"""

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from flexstage.base.arrays import Array
from flexstage.base.errors import ModelError
from flexstage.hinges import RightCircular
from flexstage.lumped import lumped_system, mechanism, stroke_path
from flexstage.stage import Stage
from flexstage.stage.designs import design
from flexstage.stage.designs.parallelogram import ParallelogramParameters, parallelogram
from flexstage.stage.designs.pieces import Leg
from flexstage.stage.drive import VoiceCoil
from flexstage.system import probe_stiffness, static_displacements
from flexstage.virtual.imperfections import Scatter, displaced_system, displacements, manufactured
from flexstage.virtual.scattered_motion import (
    Deviations,
    ErrorMotion,
    draw_deviations,
    error_motion,
    motion_rates,
)
from tests.solved_stages import solved

#: A parallelogram whose necks are so thin that its legs turn as if they had pins.
PINNED = ParallelogramParameters(
    leg_spacing=43e-3,
    leg=Leg(notch=RightCircular(neck_thickness=0.05e-3, radius=2.3e-3), bar_length=27e-3),
    actuator=VoiceCoil(largest_force=1.0),
)
LENGTH = PINNED.leg.neck_distance
SPACING = PINNED.leg_spacing
#: Order of its hinges.
LEFT_LOWER, LEFT_UPPER, RIGHT_LOWER, RIGHT_UPPER = range(4)


def off(stage: Stage, **given: Array) -> Deviations:
    """Deviations of which only some are not zero."""
    h, d = len(stage.hinges), len(stage.drives)
    shapes = {"neck": (1, h), "position": (1, h, 2), "lean": (1, h, 2), "drive": (1, d, 2)}
    return Deviations(**({n: np.zeros(s) for n, s in shapes.items()} | given))


def as_in_the_plane(system, axis: str) -> tuple[float, float]:
    """Motion to the left and rotation for each metre along an axis, of the body that is probed."""
    port = next(a for a in system.axes if a.name == axis)
    state = static_displacements(system, {port.drive: 1e-4})
    body = system.probe(port.probe).body
    along = state.readings[port.probe]
    other = next(p for p in system.probes if p.name != port.probe)
    sign = 1.0 if axis == "x" else -1.0  # the left of y is -x
    return sign * state.readings[other.name] / along, state.body_motion[body][2] / along


@pytest.mark.parametrize("axis", ["x", "y"])
def test_in_its_plane_it_is_the_lumped_model(axis: str) -> None:
    stage = design("vgtu-piezo")
    own, moved = manufactured(stage, Scatter(), seed=4), displacements(stage, Scatter(), seed=4)
    necks = [
        made.profile.neck_thickness - drawn.profile.neck_thickness
        for made, drawn in zip(own.hinges, stage.hinges, strict=True)
    ]
    found = motion_rates(
        stage,
        off(
            stage,
            neck=np.array([necks]),
            position=np.array([[moved[hinge.name] for hinge in stage.hinges]]),
        ),
    )[axis][0]
    across, yaw = as_in_the_plane(displaced_system(own, moved), axis)
    assert found[0] == 1.0
    # of the neck to first order: 2 um of 400 um, whose square is 3e-5
    assert found[1] == pytest.approx(across, rel=2e-3)
    assert found[5] == pytest.approx(yaw, rel=2e-3)
    assert abs(found[2:5]).max() < 1e-12


def test_a_stage_as_drawn_moves_as_the_lumped_model_says() -> None:
    stage = replace(design("vgtu-piezo"), hinges=manufactured(
        design("vgtu-piezo"), Scatter(neck_own=30e-6), seed=2).hinges)  # fmt: skip
    across, yaw = as_in_the_plane(lumped_system(stage), "y")
    found = motion_rates(stage)["y"][0]
    assert found[1] == pytest.approx(across, rel=1e-7)
    assert found[5] == pytest.approx(yaw, rel=1e-7)


def test_legs_that_are_not_parallel_turn_the_platform() -> None:
    # a leg whose upper neck is e to the right goes along (l, -e): yaw = (v_right - v_left)/spacing
    stage = parallelogram(PINNED)
    e_left, e_right = 31e-6, -17e-6
    moved = np.zeros((1, 4, 2))
    moved[0, LEFT_UPPER, 0], moved[0, RIGHT_UPPER, 0] = e_left, e_right
    added = motion_rates(stage, off(stage, position=moved))["x"] - motion_rates(stage)["x"]
    assert added[0, 1] == pytest.approx(-0.5 * (e_left + e_right) / LENGTH, rel=1e-2)
    assert added[0, 5] == pytest.approx(-(e_right - e_left) / (LENGTH * SPACING), rel=1e-2)


def test_scatter_of_places_scatters_the_yaw() -> None:
    # four independent places of sigma: yaw = 2 sigma/(l spacing), across = sigma/l
    stage, sigma = parallelogram(PINNED), 4e-6
    only = Scatter(neck_common=0.0, neck_own=0.0, position=sigma, lean=0.0, drive=0.0)
    rates = motion_rates(stage, draw_deviations(stage, only, 4000, seed=3))["x"]
    # standard deviations of 4000 samples are within 3.4 % in 998 of 1000 cases
    assert rates[:, 5].std() == pytest.approx(2.0 * sigma / (LENGTH * SPACING), rel=0.045)
    assert rates[:, 1].std() == pytest.approx(sigma / LENGTH, rel=0.045)


def test_legs_of_unequal_length_turn_it_by_the_square_of_the_stroke() -> None:
    # each goes down by d^2/(2 l): yaw = d^2 dl/(2 l^2 spacing); one sigma of 3 um is nothing
    stage, dl, d = parallelogram(PINNED), 0.4e-3, 1.1e-3
    model = mechanism(stage)
    hinges = list(model.hinges)
    x, y = hinges[RIGHT_UPPER].at
    hinges[RIGHT_UPPER] = replace(hinges[RIGHT_UPPER], at=(x, y + dl))
    steps = np.linspace(0.0, d, 9)
    longer = stroke_path(replace(model, hinges=tuple(hinges)), "x", "x", steps)
    as_drawn = stroke_path(model, "x", "x", steps)
    turned = longer.rotation[-1] - as_drawn.rotation[-1]
    assert turned == pytest.approx(d**2 * dl / (2.0 * LENGTH**2 * SPACING), rel=0.03)
    assert as_drawn.across[-1] == pytest.approx(-(d**2) / (2.0 * LENGTH), rel=2e-3)
    assert 3e-6 / dl * turned / d < 0.01 * 2.0 * 3e-6 / (LENGTH * SPACING)


def test_hinges_that_all_lean_alike_lead_the_platform_out_of_its_plane() -> None:
    # axes (p, 0, 1): what turns about them goes along (1, 0, -p)
    stage, lean = parallelogram(PINNED), 2.3e-4
    leaning = np.zeros((1, 4, 2))
    leaning[0, :, 1] = lean
    rates = motion_rates(stage, off(stage, lean=leaning))["x"][0]
    assert rates[2] == pytest.approx(-lean, rel=1e-3)
    assert abs(rates[3:5]).max() < 1e-4 * lean / SPACING


def test_a_drive_off_its_line_turns_the_platform_by_its_moment() -> None:
    stage, aside = design("parallelogram"), 0.7e-3
    system = lumped_system(stage)
    port = system.drive("x")
    body = next(b for b in system.bodies if b.name == "platform")
    # the same force, and its moment about the line of the drive
    moved = np.linalg.solve(system.K, port.vector + aside * body.matrix[2] * -1.0)
    expected = body.matrix[2] @ moved / (system.probe("x").vector @ moved)
    line = np.array([[[aside, 0.0]]])
    assert motion_rates(stage, off(stage, drive=line))["x"][0, 5] == pytest.approx(expected)


def test_a_sample_does_not_depend_on_how_many_there_are() -> None:
    stage = design("parallelogram")
    few, many = (draw_deviations(stage, Scatter(), n, seed=9) for n in (3, 40))
    for name in ("neck", "position", "lean", "drive"):
        assert np.array_equal(getattr(few, name), getattr(many, name)[:3])
    other = draw_deviations(stage, Scatter(), 3, seed=9, stream=1)
    assert not np.allclose(few.position, other.position)
    np.testing.assert_allclose(
        motion_rates(stage, few)["x"], motion_rates(stage, many)["x"][:3], rtol=1e-9, atol=1e-15
    )


def test_an_abbe_offset_moves_a_point_as_a_rigid_body_does() -> None:
    rotation, offset = np.array([31e-6, -17e-6, 8e-6]), (2e-3, -7e-3, 23e-3)
    start = np.array([1e-6, 2e-6, -3e-6])
    motion = ErrorMotion(
        along=np.array([5e-5]), displacement=start[None, None], rotation=rotation[None, None]
    )
    exact = start + Rotation.from_rotvec(rotation).apply(offset) - offset
    # what finite rotations do beyond: half of the square of the angle, times the offset
    assert motion.at(offset).displacement[0, 0] == pytest.approx(exact, abs=2e-11)
    there_and_back = motion.at(offset).at((-offset[0], -offset[1], -offset[2]))
    assert there_and_back.displacement == pytest.approx(motion.displacement, abs=1e-18)


def test_a_guide_that_was_mounted_askew_goes_askew() -> None:
    along = np.linspace(0.0, 8e-5, 5)
    straight = error_motion(along, 0.0 * along, 0.0 * along, np.zeros((2, 6)))
    askew = straight.with_assembly(np.array([1e-4, -2e-4]), np.array([0.0, 3e-4]))
    assert askew.displacement[:, -1, 1] == pytest.approx([8e-9, -16e-9])
    assert askew.displacement[:, -1, 2] == pytest.approx([0.0, 24e-9])


def test_what_is_joined_of_path_scatter_and_bending() -> None:
    along, across = np.array([0.0, 1e-4]), np.array([0.0, -3e-7])
    rates = np.array([[1.0, 2e-3, 1e-3, 0.1, 0.2, 0.3]])
    made = error_motion(along, across, 0.0 * along, rates, {"across": 5e-3, "yaw": 0.5})
    assert made.displacement[0, -1] == pytest.approx([0.0, -3e-7 + 7e-7, 1e-7])
    assert made.rotation[0, -1] == pytest.approx([1e-5, 2e-5, 8e-5])


def test_what_cannot_be_computed_is_refused() -> None:
    stage = design("parallelogram")
    with pytest.raises(ModelError, match="samples must be at least 1"):
        draw_deviations(stage, Scatter(), 0)
    with pytest.raises(ModelError, match="has no axis"):
        motion_rates(replace(stage, axes=()))
    with pytest.raises(ModelError, match="lean must be 0 or more"):
        Scatter(lean=math.nan)


@pytest.mark.slow
def test_out_of_its_plane_a_parallelogram_is_half_as_stiff_as_its_hinges_alone() -> None:
    # by finite elements in space, where legs and platform bend and twist: 0.47 against 0.93 N/um
    from flexstage.virtual.scattered_motion import _none, _sight_row, _stiffness

    stage = design("parallelogram")
    model = mechanism(stage)
    row = _sight_row(model, model.probe("x"), np.zeros((1, 2)))[0, 2]
    hinges_alone = 1.0 / float(
        row @ np.linalg.solve(_stiffness(stage, model, _none(stage))[0], row)
    )
    solid = solved("parallelogram", "solid").analysis.system
    whole = probe_stiffness(solid, "platform out of plane")
    assert 1.7 < hinges_alone / whole < 2.3
