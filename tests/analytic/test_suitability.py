"""What is said of commands and readings that a model was not identified on."""

import numpy as np
import pytest

from flexstage.base.errors import ModelError, UnitError
from flexstage.hysteresis import Dahl
from flexstage.hysteresis.drive_model import (
    DriveModel,
    ValidityRange,
    in_unit_of_model,
    range_warnings,
)

DT = 1e-3
DRIVE = DriveModel(
    hysteresis=Dahl(gain=2.9e-7, stiffness=0.9e-7, limit=2.3e-6),
    validity=ValidityRange(
        input_range=(3.0, 117.0), output_range=(-1e-6, 37e-6), rate_range_hz=(0.7, 6.0)
    ),
)


def cycles_at(rate_hz, low=5.0, high=110.0):
    t = np.arange(int(5.0 / rate_hz / DT)) * DT
    return low + 0.5 * (high - low) * (1.0 - np.cos(2.0 * np.pi * rate_hz * t))


@pytest.mark.parametrize("rate_hz", [0.5, 0.9, 2.3, 8.7])
def test_rates_between_and_next_to_those_of_the_model_suit(rate_hz):
    assert range_warnings(DRIVE, DT, command=cycles_at(rate_hz)) == ()


@pytest.mark.parametrize("rate_hz", [0.4, 9.7, 50.0])
def test_other_rates_are_said_with_both_figures(rate_hz):
    (said,) = range_warnings(DRIVE, DT, command=cycles_at(rate_hz))
    assert "identified at 0.7 to 6 Hz" in said
    found = float(said.split("repeat at ")[1].split(" Hz")[0])
    assert found == pytest.approx(rate_hz, rel=0.05)


def test_a_range_beyond_and_a_prefix_of_the_unit():
    (said,) = range_warnings(DRIVE, DT, command=cycles_at(2.3, 5.0, 131.0))
    assert "extrapolated" in said
    small = cycles_at(2.3, 5.0, 5.1)
    (said,) = range_warnings(DRIVE, DT, command=small)
    assert "the command spans 0.1 V, 1/1.14e+03 of the 114 V" in said
    (said,) = range_warnings(DRIVE, DT, command=cycles_at(2.3), reading=1e-3 * cycles_at(2.3))
    assert said.startswith("the reference or reading spans 0.105 m, 2.76e+03 times the 38 um")
    (said,) = range_warnings(DRIVE, DT, command=np.full(90, 7.0))
    assert "the command is constant at 7 V" in said
    bare = DriveModel(hysteresis=DRIVE.hysteresis)
    assert range_warnings(bare, DT, command=small) == ()


def test_units_of_one_dimension_are_converted():
    values, said = in_unit_of_model([0.013, -0.7], "mm", "um", "reference")
    assert values == pytest.approx([13.0, -700.0], rel=1e-15)
    assert "from mm to um" in said
    same, said = in_unit_of_model([0.013], "", "", "reference")
    assert (same[0], said) == (0.013, "")


@pytest.mark.parametrize(
    ("unit", "model_unit", "said"),
    [
        ("", "um", "no unit and the model is in um: give it after the column, such as --column"),
        ("um", "", "is in um and the model was identified without a unit"),
        ("V", "m", "is in V, that of the model in m"),
        ("furlong", "m", "furlong"),
    ],
)
def test_units_that_do_not_belong_together(unit, model_unit, said):
    with pytest.raises((ModelError, UnitError), match=said):
        in_unit_of_model([1.0], unit, model_unit, "reference")
