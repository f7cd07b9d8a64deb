"""Slow motion: where it ends, how fast it is, and that nothing moves that must not."""

import numpy as np
import pytest

from flexstage.base.errors import ControllerError, LimitError, ModelError
from flexstage.instruments.ramp import lead_to, to_safe
from flexstage.stage.limits import AxisLimits
from tests.simple_instrument import GAINS, PIEZO, SCREW, SimpleInstrument

SLOW = AxisLimits(voltage=(-10.0, 130.0), slew=40.0, safe_voltage=3.0)


def fastest(instrument: SimpleInstrument, axis: str, since: float, over: float = 1e-4) -> float:
    """Largest rate of an axis's voltage over steps of some time [V/s]."""
    time = np.arange(since, instrument.now, over)
    return float(np.abs(np.diff(instrument.axes[axis].voltages_at(time))).max() / over)


@pytest.mark.parametrize("generator", [True, False])
def test_all_axes_come_to_their_voltages(generator: bool) -> None:
    instrument = SimpleInstrument(generator=generator)
    lead_to(instrument, {"x": 87.0, "y": 31.0}, "voltage")
    assert instrument.axes["x"].voltage() == pytest.approx(87.0, rel=1e-12)
    assert instrument.axes["y"].voltage() == pytest.approx(31.0, rel=1e-12)
    assert instrument.now < 0.8
    before = list(instrument.log)
    lead_to(instrument, {"x": 87.0, "y": 31.0}, "voltage")
    assert instrument.log == before  # they are there


@pytest.mark.parametrize("generator", [True, False])
def test_the_slew_limit_makes_it_slower(generator: bool) -> None:
    instrument = SimpleInstrument(limits={"x": SLOW}, generator=generator)
    lead_to(instrument, {"x": 120.0}, "voltage")
    assert instrument.axes["x"].voltage() == pytest.approx(120.0, rel=1e-12)
    assert fastest(instrument, "x", 0.0) <= 40.0 * (1.0 + 1e-6)
    # At 15/8 of the mean slope the limit is reached once; questions take a millisecond each.
    assert 1.0 < instrument.now / (1.875 * 120.0 / 40.0) < 1.15


def test_positions_under_control_with_and_without_a_generator() -> None:
    for generator in (True, False):
        instrument = SimpleInstrument(generator=generator)
        instrument.axes["x"].set_closed_loop(True)
        lead_to(instrument, {"x": 33e-6}, "position")
        assert instrument.axes["x"].position() == pytest.approx(33e-6, rel=1e-12)
        # No speed is known of a piezo axis: it is led in half a second all the same.
        # Without a generator it goes by 50 small moves, which 20 ms smooth.
        speed = fastest(instrument, "x", 0.0, over=1e-4 if generator else 2e-2) * GAINS["x"]
        assert speed < 1.1 * 1.875 * 33e-6 / 0.5


def test_screws_travel_by_their_own_speed() -> None:
    instrument = SimpleInstrument(limits={"x": SCREW, "y": SCREW})
    lead_to(instrument, {"x": 1.5e-3, "y": 0.4e-3}, "position")
    assert instrument.log == ["move x 0.0015", "move y 0.0004"]
    assert instrument.axes["x"].position() == pytest.approx(1.5e-3)


def test_nothing_moves_when_one_target_is_wrong() -> None:
    instrument = SimpleInstrument()
    with pytest.raises(LimitError, match="'y' cannot be sent to 121 V"):
        lead_to(instrument, {"x": 30.0, "y": 121.0}, "voltage")
    with pytest.raises(ModelError, match="no axis 'z': it has 'x', 'y'"):
        lead_to(instrument, {"z": 30.0}, "voltage")
    with pytest.raises(ControllerError, match="not under position control"):
        lead_to(instrument, {"x": 30e-6}, "position")
    assert instrument.log == []
    instrument.axes["y"].set_closed_loop(True)
    with pytest.raises(ControllerError, match="switch the control off"):
        lead_to(instrument, {"x": 30.0, "y": 20.0}, "voltage")
    assert instrument.log == ["servo y on"]


def test_a_reading_that_is_no_number_moves_nothing() -> None:
    instrument = SimpleInstrument(nan_from={"x": 0.0})
    instrument.axes["x"].set_closed_loop(True)
    with pytest.raises(ControllerError, match="reads nan as its position"):
        lead_to(instrument, {"x": 30e-6}, "position")
    assert instrument.log == ["servo x on"]


def test_a_reading_a_little_outside_the_range_does_not_hinder() -> None:
    instrument = SimpleInstrument(
        limits={"x": AxisLimits(position=(1e-6, 58e-6), voltage=(0, 120))}
    )
    instrument.axes["x"].set_closed_loop(True)  # stands at 0, below its range
    lead_to(instrument, {"x": 20e-6}, "position")
    assert instrument.axes["x"].position() == pytest.approx(20e-6)


def test_drives_come_to_their_safe_voltages() -> None:
    limits = {"x": SLOW, "y": PIEZO, "z": SCREW}
    instrument = SimpleInstrument(limits=limits, gains={"x": 3e-7, "y": 4e-7})
    lead_to(instrument, {"x": 90.0, "y": 55.0}, "voltage")
    instrument.axes["z"].move_to(0.3e-3)
    instrument.axes["y"].set_closed_loop(True)
    since = instrument.now
    to_safe(instrument)
    instrument.pause(0.1)
    assert instrument.axes["x"].voltage() == 3.0
    assert instrument.axes["y"].voltage() == 0.0
    assert not instrument.axes["y"].closed_loop
    assert instrument.axes["z"].position() == pytest.approx(0.3e-3)
    assert fastest(instrument, "x", since) <= 40.0 * (1.0 + 1e-6)
    assert "load" not in " ".join(instrument.log[instrument.log.index("servo y on") :])
