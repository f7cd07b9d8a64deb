"""The instrument in memory of the tests: it keeps to the protocol, and its records are exact."""

import numpy as np
import pytest

from flexstage.base.errors import LimitError, NotConnectedError
from flexstage.instruments.protocol import (
    Instrument,
    MotionAxis,
    Recorder,
    Signal,
    Waveform,
    WaveGenerator,
)
from tests.simple_instrument import GAINS, SCREW, SimpleInstrument


def test_it_offers_all_that_an_instrument_offers() -> None:
    instrument = SimpleInstrument()
    assert isinstance(instrument, Instrument)
    assert isinstance(instrument.axes["x"], MotionAxis)
    assert isinstance(instrument.recorder, Recorder)
    assert isinstance(instrument.waves, WaveGenerator)


def test_a_repeated_waveform_is_recorded_as_it_was_given() -> None:
    instrument = SimpleInstrument()
    u = 30.0 - 30.0 * np.cos(2.0 * np.pi * np.arange(250) / 250)
    instrument.waves.load(
        Waveform(values={"x": u, "y": 0.4 * u}, sample_rate_hz=1000.0, quantity="voltage")
    )
    signals = [
        Signal(kind="voltage", source="x", name="ux", unit="V"),
        Signal(kind="position", source="y", name="y"),
        Signal(kind="channel", source="3", name="across"),
    ]
    assert instrument.recorder.configure(signals, 1000.0, 700) == 1000.0
    instrument.recorder.arm()
    instrument.waves.start(2)
    instrument.pause(0.1)
    assert instrument.waves.running()
    assert instrument.recorder.available() == 103  # the instant, and 1 ms for each question
    instrument.pause(1.0)
    record = instrument.recorder.read(0, 700)
    expected = np.concatenate([u, u, np.full(200, u[-1])])
    assert record.channel("ux").values == pytest.approx(expected, abs=1e-9)
    assert record.channel("y").values == pytest.approx(0.4 * GAINS["y"] * expected, abs=1e-15)
    across = (0.013 * GAINS["x"] - 0.004 * 0.4 * GAINS["y"]) * expected
    assert record.channel("across").values == pytest.approx(across, abs=1e-15)


def test_a_screw_moves_at_its_speed_and_a_stop_holds_it() -> None:
    instrument = SimpleInstrument(limits={"x": SCREW}, gains={"x": 0.1})
    axis = instrument.axes["x"]
    axis.move_to(2.5e-3, wait=False)
    instrument.pause(1.0)
    instrument.stop()
    stopped = axis.position()
    assert stopped == pytest.approx(1e-3, rel=2e-3)
    instrument.pause(1.0)
    assert axis.position() == stopped
    axis.move_to(2.5e-3)
    assert axis.position() == pytest.approx(2.5e-3, rel=1e-12)
    with pytest.raises(LimitError, match="7000 um"):
        axis.move_to(7e-3)


def test_a_cut_link_answers_nothing() -> None:
    instrument = SimpleInstrument(cut_link_at=0.5)
    instrument.pause(0.6)
    with pytest.raises(NotConnectedError):
        instrument.axes["x"].position()
    instrument.stop()
    assert instrument.log == ["stop that nobody heard"]
