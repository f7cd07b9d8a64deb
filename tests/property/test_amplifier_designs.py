"""Amplifiers, levers and parallel stages stay possible stages when their dimensions change."""

import math
from dataclasses import replace
from typing import Any

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from flexstage.base.errors import StageError
from flexstage.hinges import CornerFilleted, Elliptical, Leaf, Profile, RightCircular
from flexstage.stage import Force, Stage, check
from flexstage.stage.designs import build
from flexstage.stage.designs.amplifiers import BridgeParameters, RhombusParameters, bridge, rhombus
from flexstage.stage.designs.bridge_xy import BridgeXYParameters, bridge_xy
from flexstage.stage.designs.lever_chain import Lever, LeverChainParameters, lever_chain
from flexstage.stage.designs.pieces import Leg, round_leaf
from flexstage.stage.designs.scott_russell import ScottRussellParameters, scott_russell
from flexstage.stage.designs.three_rrr import ThreeRRRParameters, three_rrr

BUILDERS: dict[type, Any] = {
    BridgeParameters: bridge,
    RhombusParameters: rhombus,
    BridgeXYParameters: bridge_xy,
    ScottRussellParameters: scott_russell,
    LeverChainParameters: lever_chain,
    ThreeRRRParameters: three_rrr,
}


def errors(stage: Stage) -> list[str]:
    return [issue.message for issue in check(stage) if issue.severity == "error"]


def notches() -> st.SearchStrategy[Profile]:
    neck, radius = st.floats(0.3e-3, 0.7e-3), st.floats(0.6e-3, 1.2e-3)
    return st.one_of(
        st.builds(RightCircular, neck_thickness=neck, radius=radius),
        st.builds(
            CornerFilleted,
            neck_thickness=neck,
            notch_length=st.floats(1.8e-3, 2.6e-3),
            fillet_radius=st.floats(0.4e-3, 0.8e-3),
        ),
        st.builds(
            Elliptical,
            neck_thickness=neck,
            half_length=radius,
            notch_depth=st.floats(0.5e-3, 0.9e-3),
        ),
    )


def legs(low: float, high: float) -> st.SearchStrategy[Leg]:
    def notched(length: float) -> Leg:
        notch = RightCircular(neck_thickness=0.4e-3, radius=0.8e-3)
        return Leg(notch=notch, bar_length=length - 4.0 * notch.radius)

    return st.floats(low, high).flatmap(lambda x: st.sampled_from([round_leaf(x), notched(x)]))


CHANGES: dict[type, dict[str, st.SearchStrategy[Any]]] = {
    BridgeParameters: {
        "notch": notches(),
        "link_length": st.floats(5e-3, 14e-3),
        "link_offset": st.floats(0.3e-3, 6e-3),
        "guide": legs(28e-3, 40e-3),
        "actuator_width": st.floats(5e-3, 12e-3),
        "input_block_length": st.floats(3e-3, 10e-3),
    },
    RhombusParameters: {
        "beam_angle": st.floats(0.01, 0.7),
        "beam": st.builds(
            Leaf,
            neck_thickness=st.floats(0.3e-3, 0.9e-3),
            leaf_length=st.floats(6e-3, 16e-3),
            notch_depth=st.floats(0.1e-3, 1e-3),
        ),
        "guide": legs(38e-3, 50e-3),
    },
    BridgeXYParameters: {
        "notch": notches(),
        "link_length": st.floats(5e-3, 11.5e-3),
        "platform_size": st.floats(12e-3, 44e-3),
        "coupling": legs(26e-3, 36e-3),
        "guide": legs(28e-3, 32e-3),
    },
    ScottRussellParameters: {
        "notch": notches(),
        "link_angle": st.floats(0.29, 0.5),
        "crank_length": st.floats(14e-3, 30e-3),
        "guide": legs(8e-3, 30e-3),
    },
    LeverChainParameters: {
        "notch": notches(),
        "levers": st.lists(
            st.builds(
                Lever,
                input_arm=st.floats(0.5e-3, 20e-3),
                output_arm=st.floats(6e-3, 40e-3),
            ),
            min_size=1,
            max_size=3,
        ).map(tuple),
        "guide": legs(8e-3, 40e-3),
        "lever_height": st.floats(3e-3, 20e-3),
        "link_bar_length": st.floats(2e-3, 20e-3),
    },
    ThreeRRRParameters: {
        "notch": notches(),
        "link_position": st.floats(1.9e-3, 4e-3),
        "link_length": st.floats(7e-3, 11e-3),
        "link_distance": st.floats(15e-3, 21e-3),
        "lever_length": st.floats(13e-3, 20e-3),
        "lever_width": st.floats(4e-3, 10e-3),
    },
}


@pytest.mark.parametrize("parameters", BUILDERS, ids=lambda p: p.__name__)
@given(data=st.data())
@settings(max_examples=12, deadline=None, suppress_health_check=[HealthCheck.too_slow])
def test_changed_dimensions_give_a_possible_stage_or_a_sentence(
    parameters: type, data: st.DataObject
) -> None:
    changes = {name: data.draw(values, label=name) for name, values in CHANGES[parameters].items()}
    try:
        stage = BUILDERS[parameters](parameters(**changes))
    except StageError:
        return
    assert errors(stage) == []


SHARP = Leaf(neck_thickness=0.4e-3, leaf_length=30e-3, notch_depth=0.5e-3)
REFUSED: list[tuple[type, dict[str, Any], str]] = [
    (BridgeParameters, {"link_length": 2e-3}, "link_length must be at least 3 mm"),
    (BridgeParameters, {"link_length": 16e-3}, "link_length must be at most 15.5 mm"),
    (BridgeParameters, {"guide": round_leaf(20e-3)}, "length of guide must be at least 21 mm"),
    (BridgeParameters, {"guide_spacing": 2e-3}, "guide_spacing must be at least 2.4 mm"),
    (BridgeParameters, {"frame_wall": 5e-3}, "mounting_hole_diameter must be under the frame_wall"),
    (BridgeParameters, {"link_offset": 0.0}, "link_offset"),
    (
        BridgeParameters,
        {"notch": RightCircular(neck_thickness=0.4e-3, radius=1e-3, one_sided=True)},
        "cut from both sides",
    ),
    (RhombusParameters, {"beam": SHARP}, "length of beam must be at most 17.67"),
    (RhombusParameters, {"beam_angle": 0.0}, "beam_angle"),
    (RhombusParameters, {"beam_angle": 0.8}, "beam_angle"),
    (BridgeXYParameters, {"coupling_spacing": 2e-3}, "coupling_spacing must be at least 2.4 mm"),
    (BridgeXYParameters, {"coupling_spacing": 7e-3}, "coupling_spacing must be at most 6.6 mm"),
    (BridgeXYParameters, {"platform_size": 60e-3}, "platform_size must be at most 48 mm"),
    (BridgeXYParameters, {"coupling": round_leaf(10e-3)}, "length of coupling must be at least 13"),
    (ScottRussellParameters, {"link_angle": 0.1}, "sin.link_angle. must be at least 2.2 mm"),
    (ScottRussellParameters, {"crank_length": 8e-3}, "crank_length must be at least 9.58"),
    (ScottRussellParameters, {"input_block_height": 3e-3}, "input_block_height"),
    (ScottRussellParameters, {"input_block_length": 6e-3}, "input_block_length"),
    (ScottRussellParameters, {"actuator_width": 40e-3}, "actuator_width must be at most 32 mm"),
    (LeverChainParameters, {"levers": ()}, "one lever at least"),
    (
        LeverChainParameters,
        {"levers": (Lever(input_arm=3e-3, output_arm=4e-3),)},
        "output_arm of lever 1 must be at least 4.5 mm",
    ),
    (LeverChainParameters, {"link_bar_length": 1e-3}, "link_bar_length must be at least 2 mm"),
    (LeverChainParameters, {"output_width": 2e-3}, "output_width must be at least 2.5 mm"),
    (ThreeRRRParameters, {"link_length": 2e-3}, "link_length must be at least 3 mm"),
    (ThreeRRRParameters, {"lever_width": 2e-3}, "lever_width must be at least 2.4 mm"),
    (ThreeRRRParameters, {"input_arm": 1e-3}, "input_arm must be at least 2.5 mm"),
    (ThreeRRRParameters, {"lever_length": 8e-3}, "lever_length must be at least 11.7 mm"),
    (ThreeRRRParameters, {"tab_width": 20e-3}, "link_distance must be at least"),
    (ThreeRRRParameters, {"actuator_length": 15e-3}, "actuator_length must be at least 19 mm"),
    (ThreeRRRParameters, {"actuator_length": 36e-3}, "actuator_length must be at most 25.8"),
    (ThreeRRRParameters, {"lever_width": math.nan}, "lever_width"),
]


@pytest.mark.parametrize(("parameters", "changes", "culprit"), REFUSED)
def test_impossible_dimensions_get_one_sentence(
    parameters: type, changes: dict[str, Any], culprit: str
) -> None:
    with pytest.raises(StageError, match=culprit) as caught:
        BUILDERS[parameters](parameters(**changes))
    assert "\n" not in str(caught.value)
    assert "got" in str(caught.value) or "remove that" in str(caught.value)


@pytest.mark.parametrize("name", ["bridge", "rhombus", "bridge-xy", "scott-russell", "lever-chain"])
def test_the_actuator_is_a_parameter(name: str) -> None:
    stage = build(name, {"actuator": {"kind": "force", "largest_force": "7 N"}})
    assert all(isinstance(drive, Force) for drive in stage.drives)
    assert errors(stage) == []


def test_the_legs_of_a_3_rrr_are_alike_under_a_third_of_a_turn() -> None:
    stage = three_rrr(replace(ThreeRRRParameters(), link_position=2.7e-3))
    turn = complex(-0.5, math.sqrt(0.75))
    for name in ("fulcrum", "knee", "tab"):
        first, second, third = (complex(*stage.hinge(f"{name}-{k}").at) for k in "123")
        assert second == pytest.approx(first * turn, rel=1e-12)
        assert third == pytest.approx(second * turn, rel=1e-12)
