"""The same runs on a simulated controller, through every byte that a real one would see."""

from collections.abc import Iterator

import numpy as np
import pytest

from flexstage.base.errors import LimitError
from flexstage.instruments.connect import connect
from flexstage.instruments.guard import guarded
from flexstage.instruments.protocol import Instrument, Signal, Waveform
from flexstage.instruments.record_run import record_now, run_moves, run_waveform

X = Signal(kind="position", source="x", name="x")
U = Signal(kind="voltage", source="x", name="u", unit="V")
TARGET = Signal(kind="target", source="x", name="target")


@pytest.fixture
def piezo() -> Iterator[Instrument]:
    instrument = connect("twin://vgtu-piezo?model=lumped&seed=8")
    yield instrument
    instrument.close()


def test_voltages_are_those_of_the_waveform(piezo: Instrument) -> None:
    n = 500
    u = 60.0 - 47.0 * np.cos(2.0 * np.pi * np.arange(n) / n)
    wave = Waveform(values={"x": u, "y": 0.4 * u}, sample_rate_hz=500.0, quantity="voltage")
    record = run_waveform(piezo, wave, [U, X], rate_hz=1000.0, cycles=2)
    assert record.size == 2000
    k = np.minimum(np.arange(2000) / 2.0, 2 * n - 1) % n
    expected = np.interp(k, np.arange(n + 1), np.append(u, u[0]))
    # The slope is 295 V/s at most, and the amplifier is behind by some tenths of a millisecond.
    assert np.abs(record.channel("u").values - expected).max() < 0.15
    x = record.channel("x").values
    assert 40e-6 < np.ptp(x) < 70e-6  # of 62 um over 120 V
    assert "simulated, not measured data" in record.notes


def test_positions_under_control_are_followed(piezo: Instrument) -> None:
    piezo.axes["x"].set_closed_loop(True)
    n = 500
    r = 33e-6 - 20e-6 * np.cos(2.0 * np.pi * np.arange(n) / n)
    wave = Waveform(values={"x": r}, sample_rate_hz=500.0, quantity="position")
    record = run_waveform(piezo, wave, [X, TARGET], rate_hz=500.0, cycles=2)
    # Positions go over the wire in um with six digits after the point or more.
    assert record.channel("target").values == pytest.approx(np.tile(r, 2), abs=2e-12)
    # 126 um/s at most, behind by some milliseconds.
    assert np.abs(record.channel("x").values - np.tile(r, 2)).max() < 2e-6


def test_a_waveform_is_recorded_after_a_recording_that_was_started_by_hand(piezo) -> None:
    held = record_now(piezo, [X], rate_hz=1000.0, samples=100)
    assert held.size == 100
    wave = Waveform(
        values={"x": 30.0 - 30.0 * np.cos(2.0 * np.pi * np.arange(200) / 200)},
        sample_rate_hz=400.0,
        quantity="voltage",
    )
    record = run_waveform(piezo, wave, [U], rate_hz=1000.0)
    assert record.size == 500
    assert record.channel("u").values.max() == pytest.approx(60.0, abs=0.1)


def test_an_error_leaves_the_drives_at_their_safe_voltages(piezo: Instrument) -> None:
    piezo.axes["x"].set_voltage(50.0)
    piezo.axes["y"].set_closed_loop(True)
    piezo.axes["y"].move_to(20e-6)
    with pytest.raises(KeyError), guarded(piezo):
        raise KeyError
    piezo.pause(0.1)
    for axis in piezo.axes.values():
        assert not axis.closed_loop
        assert axis.voltage() == pytest.approx(0.0, abs=1e-3)


def test_what_is_refused_sends_nothing_that_moves(piezo: Instrument) -> None:
    ramp = Waveform(
        values={"x": np.linspace(0.0, 121.0, 50)}, sample_rate_hz=100.0, quantity="voltage"
    )
    before = piezo.axes["x"].voltage()
    with pytest.raises(LimitError, match="0 to 120 V"):
        run_waveform(piezo, ramp, [X], rate_hz=100.0)
    assert piezo.axes["x"].voltage() == before


def test_a_hold_has_the_noise_of_the_sensor(piezo: Instrument) -> None:
    record = record_now(piezo, [X], 10e3, 2000)
    # 5 nm of noise and 10 nm at 50 Hz: sqrt(25 + 50) nm = 8.7 nm; drift and creep add little.
    assert record.channel("x").values.std() == pytest.approx(8.7e-9, rel=0.25)


def test_screws_move_from_place_to_place() -> None:
    instrument = connect("twin://vgtu-mechanical?model=lumped&seed=8")
    probe = Signal(kind="channel", source="1", name="probe")
    places = [110e-6, 230e-6, 60e-6]
    record = run_moves(instrument, "x", places, 0.1, [X, probe], rate_hz=500.0)
    assert record.size == 150
    assert record.channel("command").values == pytest.approx(np.repeat(places, 50))
    # What moves is the screw; its position has its smallest step and backlash.
    assert np.abs(record.channel("x").values - np.repeat(places, 50)).max() < 5e-6
    instrument.close()
