"""An amplifier found again from its command and its output."""

import numpy as np
import pytest

from flexstage.errors import RecordError
from flexstage.hysteresis import Amplifier, identify_amplifier

DT = 5e-5
STEPS = np.repeat([0.0, 0.4, 0.0, 9.3, 2.0, 2.4, 0.0], 160)


def test_gain_bandwidth_and_slew_are_found_in_noise() -> None:
    true = Amplifier(bandwidth_hz=913.0, slew_limit=33e3, gain=12.7)
    noise = 0.02 * np.random.default_rng(4).standard_normal(STEPS.size)
    found = identify_amplifier(STEPS, true.simulate(STEPS, DT).values + 0.31 + noise, DT)
    assert found.amplifier.gain == pytest.approx(12.7, rel=1e-3)
    assert found.amplifier.bandwidth_hz == pytest.approx(913.0, rel=0.02)
    assert abs(found.amplifier.bandwidth_hz - 913.0) < 4.0 * found.bandwidth_error_hz
    assert found.amplifier.slew_limit == pytest.approx(33e3, rel=5e-3)
    assert found.offset == pytest.approx(0.31, abs=5e-3)
    assert found.rms == pytest.approx(0.02, rel=0.1)
    assert found.warnings == ()


def test_the_current_limit_is_a_limit_of_the_rate() -> None:
    true = Amplifier(bandwidth_hz=1300.0, capacitance=6.4e-6, current_limit=0.21, gain=-11.0)
    found = identify_amplifier(STEPS, true.simulate(STEPS, DT).values, DT)
    assert found.amplifier.gain == pytest.approx(-11.0, rel=1e-6)
    assert found.amplifier.slew_limit == pytest.approx(0.21 / 6.4e-6, rel=1e-6)
    assert found.amplifier.bandwidth_hz == pytest.approx(1300.0, rel=1e-5)


def test_what_was_not_reached_is_said() -> None:
    true = Amplifier(bandwidth_hz=640.0, slew_limit=2e6, gain=9.0)
    small = 0.1 * STEPS
    found = identify_amplifier(small, true.simulate(small, DT).values, DT)
    assert found.amplifier.slew_limit is None
    assert any("no limit of the rate" in w for w in found.warnings)
    assert found.amplifier.bandwidth_hz == pytest.approx(640.0, rel=1e-5)


def test_bad_records_are_refused() -> None:
    with pytest.raises(RecordError, match="equally long"):
        identify_amplifier(STEPS, STEPS[:-1], DT)
    with pytest.raises(RecordError, match="must move"):
        identify_amplifier(np.zeros(50), np.zeros(50), DT)
