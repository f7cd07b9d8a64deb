"""Stages that move in several directions at once, against their kinematics."""

import math
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from flexstage.fem import MeshSettings, solid_model, superelement_model
from flexstage.hinges import RightCircular
from flexstage.lumped import hinge_springs, lumped_system
from flexstage.stage import Stage, check
from flexstage.stage.designs.amplifiers import BridgeParameters, bridge
from flexstage.stage.designs.bridge_xy import BridgeXYParameters, bridge_xy
from flexstage.stage.designs.pieces import round_leaf
from flexstage.stage.designs.three_rrr import ThreeRRRParameters, three_rrr
from flexstage.system import (
    analyse_axis,
    coupled_axes,
    modes,
    probe_stiffness,
    static_displacements,
)

DRIVES = ("1", "2", "3")
RRR = ThreeRRRParameters(
    link_distance=17.3e-3,
    link_position=2.6e-3,
    link_length=9.1e-3,
    lever_length=15.2e-3,
    lever_width=6.3e-3,
    input_arm=5.7e-3,
    notch=RightCircular(neck_thickness=0.37e-3, radius=0.9e-3),
)


def of_pins(stage: Stage, arm: float) -> np.ndarray:
    """Return the Jacobian with pins for necks, each link keeping its length.

    B.-J. Yi et al., IEEE Trans. Robot. Autom. 19 (2003) 604; Y. K. Yong, T.-F. Lu, Mech. Mach.
    Theory 44 (2009) 1156: the velocities of both ends of a link, along it, are equal. The lever
    turns right by u/a, about A; the platform moves by p and turns by phi, about the origin.
    """
    rows = []
    for k in DRIVES:
        a, b, c = (np.array(stage.hinge(f"{n}-{k}").at) for n in ("fulcrum", "knee", "tab"))
        link = (c - b) / math.dist(c, b)
        lever = a - b
        per_drive = link @ np.array([-lever[1], lever[0]]) / arm
        rows.append(np.array([*link, link @ np.array([-c[1], c[0]])]) / per_drive)
    return np.linalg.inv(np.array(rows))


def scaled(jacobian: np.ndarray, stage: Stage) -> np.ndarray:
    """Make rotation a displacement at the necks of the platform, so that entries compare."""
    return np.diag([1.0, 1.0, math.hypot(*stage.hinge("tab-1").at)]) @ jacobian


def loss(p: ThreeRRRParameters) -> float:
    stage = three_rrr(p)
    pins = scaled(of_pins(stage, p.input_arm), stage)
    found = scaled(coupled_axes(stage, lumped_system(stage)).jacobian, stage)
    return float(np.linalg.norm(found - pins) / np.linalg.norm(pins))


def test_the_jacobian_of_a_3_rrr_is_that_of_its_pins() -> None:
    assert not [i for i in check(three_rrr(RRR)) if i.severity == "error"]
    # The fulcrums bear link and drive across: they give by k_theta/k_v, which goes with t where
    # necks are thin, as k_theta does with t^2.5 and k_v with t^1.5. Nothing is left of it then.
    thin = (0.08e-3, 0.04e-3, 0.02e-3, 0.01e-3)
    parts = [loss(replace(RRR, notch=replace(RRR.notch, neck_thickness=t))) for t in thin]
    assert loss(RRR) < 0.05
    assert parts[-1] < 5e-4
    for thicker, thinner in pairwise(parts):
        assert thicker / thinner == pytest.approx(2.0, rel=0.1)


@pytest.mark.parametrize("position", [1.9e-3, 2.6e-3, 3.3e-3])
@pytest.mark.parametrize("length", [9.1e-3, 13.7e-3])
def test_the_jacobian_follows_the_legs(position: float, length: float) -> None:
    p = replace(RRR, link_position=position, link_length=length, actuator_length=25e-3)
    assert loss(replace(p, notch=replace(p.notch, neck_thickness=0.02e-3))) < 1e-3


def test_three_equal_drives_turn_a_3_rrr_about_its_centre() -> None:
    stage = three_rrr(RRR)
    for system in (lumped_system(stage), superelement_model(stage).system):
        state = static_displacements(system, dict.fromkeys(DRIVES, 1e-5))
        turn = state.readings["theta"] * RRR.link_distance
        # 1e-4: each leg is meshed for itself, so that finite elements are not quite alike
        assert abs(state.readings["x"]) < 1e-4 * turn
        assert abs(state.readings["y"]) < 1e-4 * turn
        # a drive along any axis of symmetry does the same: J J^T is isotropic in x and y
        j = coupled_axes(stage, system).jacobian
        plane = j[:2] @ j[:2].T
        assert plane == pytest.approx(plane[0, 0] * np.eye(2), rel=1e-3, abs=1e-3 * plane[0, 0])


def test_finite_elements_of_a_3_rrr() -> None:
    stage = three_rrr(RRR)
    pins = scaled(of_pins(stage, RRR.input_arm), stage)
    necks = scaled(coupled_axes(stage, lumped_system(stage)).jacobian, stage)
    bodies = scaled(coupled_axes(stage, superelement_model(stage).system).jacobian, stage)
    # levers, tabs and ring bend as well: in all 2 % more than the necks take
    size = np.linalg.norm(pins)
    assert np.linalg.norm(necks - pins) < np.linalg.norm(bodies - pins) < 0.07 * size
    assert np.linalg.norm(bodies - necks) < 0.03 * size


@pytest.mark.slow
def test_a_3_rrr_in_space() -> None:
    """Ring and platform share their centre; in space they are meshed apart none the less."""
    stage = three_rrr(RRR)
    solid = solid_model(stage).system
    flat = superelement_model(stage).system
    # plane strain at the necks and plane stress elsewhere are bounds; what is between is 1 %
    wanted = coupled_axes(stage, flat).jacobian
    assert coupled_axes(stage, solid).jacobian == pytest.approx(
        wanted, rel=0.02, abs=1e-3 * np.abs(wanted[:2]).max()
    )
    assert modes(solid).frequency_hz[:3] == pytest.approx(modes(flat).frequency_hz[:3], rel=0.03)


XY = BridgeXYParameters(
    link_length=11.3e-3,
    link_offset=1.9e-3,
    notch=RightCircular(neck_thickness=0.37e-3, radius=1.1e-3),
    coupling=round_leaf(17.3e-3),
    guide=round_leaf(23e-3),
    platform_size=29e-3,
    thickness=9e-3,
)


def test_a_bridge_driven_stage_has_the_ratio_of_its_bridge_under_load() -> None:
    stage = bridge_xy(XY)
    assert not [i for i in check(stage) if i.severity == "error"]
    own = {name: getattr(XY, name) for name in BridgeParameters.__dataclass_fields__}
    alone = bridge(BridgeParameters(**own))
    alone = replace(alone, hinges=tuple(h for h in alone.hinges if h.name[:5] != "guide"))
    single = lumped_system(alone)
    axis = analyse_axis(single, single.axes[0])
    free = axis.output_displacement / axis.input_displacement
    held = probe_stiffness(single, "y", drives="locked")
    # all leaves that bend with x: four each of the guides on the right and on the left, and two
    # each to the blocks of y
    springs = {s.hinge.name: s.stiffness for s in hinge_springs(stage)}
    leaves = {n: 1.0 / np.linalg.inv(k)[1, 1] for n, k in springs.items()}
    load = sum(
        k
        for n, k in leaves.items()
        if n.startswith(("x-guide", "left-guide", "y-coupling", "bottom-coupling"))
    )
    system = lumped_system(stage)
    for axis_port in system.axes:
        found = analyse_axis(system, axis_port)
        ratio = found.output_displacement / found.input_displacement
        # 1 %: between block and platform the leaves to it stretch
        assert ratio == pytest.approx(free * held / (held + load), rel=0.01)


def test_neither_axis_of_a_bridge_driven_stage_moves_the_other() -> None:
    stage = bridge_xy(XY)
    elastic = superelement_model(stage, MeshSettings(order=2, neck_size=2.0)).system
    for system, other, drive in ((lumped_system(stage), 1e-6, 1e-3), (elastic, 3e-4, 2e-3)):
        for axis, across in (("x", "y"), ("y", "x")):
            state = static_displacements(system, {axis: 1e-5})
            moved = state.readings[axis]
            # Y. Li, Q. Xu, IEEE Trans. Robot. 25 (2009) 645, call this total decoupling: neither
            # the other axis nor the other drive is moved
            assert abs(state.readings[across]) < other * moved
            assert abs(state.drive_displacement[across]) < drive * abs(
                state.drive_displacement[axis]
            )


def test_both_axes_of_a_bridge_driven_stage_are_alike() -> None:
    system = lumped_system(bridge_xy(XY))
    first, second = modes(system).frequency_hz[:2]
    assert first == pytest.approx(second, rel=1e-6)
