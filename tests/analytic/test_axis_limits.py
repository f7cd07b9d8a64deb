"""Limits of an axis: from the stage's own drives, and together with a controller's."""

from dataclasses import replace

import numpy as np
import pytest

from flexstage.base.errors import ModelError
from flexstage.instruments.protocol import Waveform
from flexstage.stage.designs import design
from flexstage.stage.limits import AxisLimits, stage_limits


def _with_drive(stage, name, **changes):
    drives = tuple(replace(d, **changes) if d.name == name else d for d in stage.drives)
    return replace(stage, drives=drives)


def test_a_stack_gives_voltage_and_slew_and_no_travel() -> None:
    stage = design("vgtu-piezo")
    drive = stage.axis("y").drive
    stage = _with_drive(stage, drive, voltage_range=(-20.0, 130.0), largest_slew=1.7e4)
    limits = stage_limits(stage, "y")
    assert limits == AxisLimits(voltage=(-20.0, 130.0), slew=1.7e4, safe_voltage=0.0)
    assert stage_limits(stage, "x").voltage == (0.0, 120.0)


def test_the_safe_voltage_is_the_lowest_one_where_zero_is_not_allowed() -> None:
    stage = design("vgtu-piezo")
    stage = _with_drive(stage, stage.axis("x").drive, voltage_range=(5.0, 90.0))
    assert stage_limits(stage, "x").safe_voltage == 5.0
    stage = _with_drive(stage, stage.axis("x").drive, voltage_range=(-90.0, -5.0))
    assert stage_limits(stage, "x").safe_voltage == -5.0


def test_a_screw_gives_travel_and_speed() -> None:
    stage = design("vgtu-mechanical")
    limits = stage_limits(stage, "x")
    assert limits == AxisLimits(position=(0.0, 350e-6), speed=0.35e-3)


def test_the_narrower_of_two_limits_holds_each_way() -> None:
    own = AxisLimits(voltage=(-20.0, 120.0), slew=3e4, safe_voltage=-3.0)
    other = AxisLimits(voltage=(0.0, 135.0), position=(1e-6, 60e-6), slew=2e4, speed=1e-3)
    both = own.within(other)
    assert both.voltage == (0.0, 120.0)
    assert both.position == (1e-6, 60e-6)
    assert (both.slew, both.speed) == (2e4, 1e-3)
    assert both.safe_voltage == 0.0
    assert other.within(own).voltage == both.voltage


def test_limits_with_nothing_in_common_belong_to_two_stages() -> None:
    with pytest.raises(ModelError, match="another stage"):
        AxisLimits(voltage=(0.0, 10.0)).within(AxisLimits(voltage=(20.0, 30.0)))


@pytest.mark.parametrize(
    "bad", [{"voltage": (3.0, 3.0)}, {"position": (2.0, -1.0)}, {"slew": 0.0}, {"speed": np.inf}]
)
def test_impossible_limits_are_refused(bad) -> None:
    with pytest.raises(ModelError, match=next(iter(bad))):
        AxisLimits(**bad)


def test_the_largest_rate_of_a_repeated_waveform_counts_its_return() -> None:
    wave = Waveform(
        values={"x": np.array([0.0, 1.0, 3.0, 4.5])}, sample_rate_hz=20.0, quantity="voltage"
    )
    assert wave.largest_rate("x") == 40.0
    assert wave.largest_rate("x", closed=True) == 90.0
    assert (wave.size, wave.duration) == (4, 0.2)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"values": {}}, "at least one axis"),
        ({"values": {"x": np.zeros(3), "y": np.zeros(4)}}, "same number"),
        ({"values": {"x": np.zeros(1)}}, "at least 2"),
        ({"values": {"x": np.zeros((2, 2))}}, "same number"),
        ({"values": {"x": np.array([0.0, np.nan, 1.0])}}, "at sample 1"),
        ({"sample_rate_hz": 0.0}, "rate"),
        ({"quantity": "charge"}, "charge"),
    ],
)
def test_impossible_waveforms_are_refused(change, said) -> None:
    good = {"values": {"x": np.array([0.0, 1.0])}, "sample_rate_hz": 1.0, "quantity": "voltage"}
    with pytest.raises(ModelError, match=said):
        Waveform(**good | change)
