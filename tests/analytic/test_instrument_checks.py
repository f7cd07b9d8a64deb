"""What leaves the limits is refused, sample by sample; what keeps to them is not."""

import itertools

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from flexstage.base.errors import LimitError
from flexstage.instruments.limits import check_position, check_voltage, check_waveform
from flexstage.instruments.protocol import Waveform
from flexstage.stage.limits import AxisLimits

LIMITS = AxisLimits(position=(-3e-6, 41e-6), voltage=(-7.0, 113.0), slew=900.0, speed=2e-4)


def voltage(*values: float, rate: float = 70.0) -> Waveform:
    return Waveform(
        values={"x": np.array(values, dtype=float)}, sample_rate_hz=rate, quantity="voltage"
    )


def test_values_at_the_ends_are_allowed_and_beyond_them_not() -> None:
    for value in (-3e-6, 41e-6, 0.0, np.float64(17e-6)):
        check_position(LIMITS, value, "x")
    for value in (-7.0, 113.0, 113.0 + 1e-8):  # rounding of a billionth of the range is forgiven
        check_voltage(LIMITS, value, "x")
    with pytest.raises(LimitError, match=r"axis 'y' cannot be sent to 41\.1 um.* -3 to 41 um"):
        check_position(LIMITS, 41.1e-6, "y")
    with pytest.raises(LimitError, match="-7 to 113 V"):
        check_voltage(LIMITS, -7.0 - 1e-6, "x")
    with pytest.raises(LimitError, match="accepts no voltage"):
        check_voltage(AxisLimits(position=(0.0, 1.0)), 3.0, "x")
    check_position(AxisLimits(voltage=(0.0, 1.0)), 3.0, "x")  # no range, nothing forbidden
    for value in (np.nan, np.inf, -np.inf):
        with pytest.raises(LimitError, match="finite"):
            check_position(AxisLimits(), value, "x")
        with pytest.raises(LimitError, match="finite"):
            check_voltage(LIMITS, value, "x")


def test_the_sentence_names_sample_time_value_and_limit() -> None:
    with pytest.raises(
        LimitError,
        match=r"'x' would be sent to 114 V at sample 2 \(0\.0285714 s\).* -7 to 113 V \(2 of 4",
    ):
        check_waveform({"x": LIMITS}, voltage(100.0, 107.0, 114.0, 115.0))
    with pytest.raises(LimitError, match=r"change at 910 V/s after sample 1 \(0\.0142857 s\).*900"):
        check_waveform({"x": LIMITS}, voltage(100.0, 107.0, 94.0))
    with pytest.raises(LimitError, match="the axes of the instrument are 'y', 'z'"):
        check_waveform({"y": LIMITS, "z": LIMITS}, voltage(0.0, 1.0))
    with pytest.raises(LimitError, match="cycles"):
        check_waveform({"x": LIMITS}, voltage(0.0, 1.0), cycles=-1)


def test_a_repeated_waveform_is_closed() -> None:
    rising = voltage(0.0, 12.0, 24.0, 36.0)
    check_waveform({"x": LIMITS}, rising, cycles=1)
    for cycles in (0, 2):
        with pytest.raises(LimitError, match=r"step by -36 V .* 2520 V/s"):
            check_waveform({"x": LIMITS}, rising, cycles=cycles)
    check_waveform({"x": LIMITS}, voltage(0.0, 12.0, 24.0, 12.0), cycles=0)


def test_where_an_axis_stands_counts() -> None:
    wave = voltage(40.0, 41.0)
    step = 900.0 / 70.0
    check_waveform({"x": LIMITS}, wave, start={"x": 40.0 - step, "y": -1e9})
    with pytest.raises(LimitError, match="is at 27 V and the waveform starts at 40 V"):
        check_waveform({"x": LIMITS}, wave, start={"x": 27.0})
    check_waveform({"x": LIMITS}, wave, start={"x": 27.0}, tolerance=0.2)
    with pytest.raises(LimitError, match="reads nan, so its distance"):
        check_waveform({"x": LIMITS}, wave, start={"x": np.nan})
    check_waveform({"x": AxisLimits(voltage=(0.0, 50.0))}, wave, start={"x": 0.0})  # no slew known


def test_positions_have_their_own_range_and_speed() -> None:
    def wave(rate: float) -> Waveform:
        return Waveform(
            values={"x": np.array([0.0, 1e-6, 3e-6])}, sample_rate_hz=rate, quantity="position"
        )

    check_waveform({"x": LIMITS}, wave(100.0))
    with pytest.raises(LimitError, match="202 um/s after sample 1"):
        check_waveform({"x": LIMITS}, wave(101.0))
    with pytest.raises(LimitError, match="accepts no voltage"):
        check_waveform({"x": AxisLimits(position=(0.0, 1.0))}, voltage(0.0, 1.0))


@given(
    st.lists(st.floats(-20.0, 130.0), min_size=2, max_size=30),
    st.sampled_from([0, 1, 3]),
    st.floats(1.0, 200.0),
)
def test_it_agrees_with_a_look_at_every_sample(
    values: list[float], cycles: int, rate: float
) -> None:
    """The same decision by a loop, away from the ends where rounding is forgiven."""
    follow = values if cycles == 1 else [*values, values[0]]
    over = [max(v - 113.0, -7.0 - v) / 120.0 for v in values]
    over += [abs(b - a) * rate / 900.0 - 1.0 for a, b in itertools.pairwise(follow)]
    worst = max(over)
    if abs(worst) < 1e-6:
        return
    if worst < 0.0:
        check_waveform({"x": LIMITS}, voltage(*values, rate=rate), cycles=cycles)
    else:
        with pytest.raises(LimitError):
            check_waveform({"x": LIMITS}, voltage(*values, rate=rate), cycles=cycles)
