"""Recorded runs on an instrument whose every sample is known, and what they do when it fails."""

from collections.abc import Mapping
from typing import Any

import numpy as np
import pytest

from flexstage.base import progress
from flexstage.base.arrays import Array
from flexstage.base.errors import (
    ControllerError,
    LimitError,
    ModelError,
    NotConnectedError,
    RecordError,
)
from flexstage.instruments.protocol import Signal, Waveform
from flexstage.instruments.record_run import record_impact, record_now, run_moves, run_waveform
from tests.simple_instrument import GAINS, SCREW, SimpleInstrument

X = Signal(kind="position", source="x", name="x")
U = Signal(kind="voltage", source="x", name="u", unit="V")
ACROSS = Signal(kind="channel", source="3", name="across")


class Kept:
    """A writer that keeps what it is given and minds gaps; fails when it holds `full` samples."""

    def __init__(self, full: float = np.inf) -> None:
        self.columns: dict[str, list[Array]] = {}
        self.size, self.calls, self.full = 0, 0, full

    def append(self, first: int, columns: Mapping[str, Array]) -> None:
        assert first == self.size
        if self.size >= self.full:
            raise RecordError("the disk is full")
        for name, values in columns.items():
            self.columns.setdefault(name, []).append(values)
        self.size += len(next(iter(columns.values())))
        self.calls += 1

    def column(self, name: str) -> Array:
        return np.concatenate(self.columns[name])


def voltages(n: int = 730, rate: float = 700.0, offset: float = 11.0) -> Waveform:
    phase = 2.0 * np.pi * np.arange(n) / n
    return Waveform(
        values={"x": offset + 30.0 - 30.0 * np.cos(phase)}, sample_rate_hz=rate, quantity="voltage"
    )


def test_a_waveform_is_led_to_recorded_and_streamed() -> None:
    instrument, kept, told = SimpleInstrument(), Kept(), []
    wave = voltages()
    with progress.listen(lambda what, done: told.append((what, done))):
        record = run_waveform(
            instrument, wave, [X, U, ACROSS], rate_hz=2500.0, cycles=3, writer=kept
        )
    n = round(3 * 730 / 700.0 * 2500.0)
    assert record.size == n
    k = np.minimum(np.arange(n) / 2500.0 * 700.0, 3 * 730 - 1)
    closed = np.append(wave.values["x"], wave.values["x"][0])
    u = np.interp(k % 730, np.arange(731), closed)
    # Sample 0 is the instant of sample 0 of the waveform; the rest is rounding of the time.
    assert record.channel("u").values == pytest.approx(u, abs=1e-9)
    assert record.channel("x").values == pytest.approx(GAINS["x"] * u, abs=1e-15)
    assert record.channel("across").values == pytest.approx(0.013 * GAINS["x"] * u, abs=1e-17)
    assert [c.unit for c in record.channels] == ["m", "V", "m"]
    assert record.sample_rate_hz == pytest.approx(2500.0)
    assert record.attributes["simulated"] == "yes"
    for name in ("x", "u", "across"):
        assert np.array_equal(kept.column(name), record.channel(name).values)
    assert kept.calls > 20  # handed over while it ran
    assert told[-1] == ("recording", 1.0)
    assert told == sorted(told, key=lambda entry: entry[1])
    orders = [o.split()[0] for o in instrument.log]
    assert orders[-4:] == ["load", "record", "arm", "start"]
    assert instrument.stops == 0


def test_the_axis_is_led_to_the_first_sample_without_a_jump() -> None:
    instrument = SimpleInstrument()
    instrument.axes["x"].set_voltage(97.0)
    instrument.pause(1.0)
    begin = instrument.now
    run_waveform(instrument, voltages(offset=3.0), [U], rate_hz=1000.0)
    time = np.arange(begin, instrument.now, 1e-4)
    steps = np.abs(np.diff(instrument.axes["x"].voltages_at(time)))
    # 94 V in 0.5 s at 15/8 of the mean, and 2 % for the corners of the table: never by a step.
    assert steps.max() < 1.02 * 1.875 * 94.0 / 0.5 * 1e-4


def test_positions_run_under_control_with_voltages_beside_them() -> None:
    instrument = SimpleInstrument()
    for axis in instrument.axes.values():
        axis.set_closed_loop(True)
    n = 400
    r = 21e-6 * np.sin(2.0 * np.pi * np.arange(n) / n) + 27e-6
    wave = Waveform(values={"x": r, "y": 0.7 * r}, sample_rate_hz=1000.0, quantity="position")
    beside = Waveform(values={"x": r / GAINS["x"]}, sample_rate_hz=1000.0, quantity="voltage")
    y = Signal(kind="position", source="y", name="y")
    record = run_waveform(instrument, wave, [X, y], rate_hz=1000.0, feedforward=beside)
    assert record.channel("x").values == pytest.approx(r, abs=1e-15)
    assert record.channel("y").values == pytest.approx(0.7 * r, abs=1e-15)
    assert instrument.waves.feedforward is beside


def refused(instrument: SimpleInstrument, error: type[Exception], match: str, **given: Any) -> None:
    """A run that is refused has moved nothing."""
    options: dict[str, Any] = {"waveform": voltages(), "signals": [X], "rate_hz": 1000.0} | given
    with pytest.raises(error, match=match):
        run_waveform(instrument, **options)
    moved = ("load", "start", "move", "voltage", "servo", "stop")
    assert [o for o in instrument.log if o.startswith(moved)] == []


def test_what_cannot_run_is_refused_before_anything_moves() -> None:
    high = voltages(offset=61.0)
    refused(
        SimpleInstrument(),
        LimitError,
        r"axis 'x' would be sent to 120\.\d+ V at sample",
        waveform=high,
    )
    ramp = Waveform(
        values={"x": np.linspace(1.0, 90.0, 50)}, sample_rate_hz=5e3, quantity="voltage"
    )
    refused(SimpleInstrument(), LimitError, "step by -89 V", waveform=ramp, cycles=2)
    refused(SimpleInstrument(), LimitError, "at least 1 cycle", cycles=0)
    refused(SimpleInstrument(), LimitError, "record at .* Hz or slower", cycles=100, rate_hz=1e4)
    refused(SimpleInstrument(), LimitError, "8 signals at once", signals=[
        Signal(kind="channel", source="1", name=f"s{k}") for k in range(9)])  # fmt: skip
    refused(SimpleInstrument(), ModelError, "a different name", signals=[X, X])
    refused(SimpleInstrument(), ModelError, "rate of a record", rate_hz=-1.0)
    position = Waveform(values={"x": np.zeros(9)}, sample_rate_hz=9.0, quantity="position")
    refused(SimpleInstrument(), ControllerError, "not under position control", waveform=position)
    closed = SimpleInstrument()
    closed.axes["x"].set_closed_loop(True)
    closed.log.clear()
    beside = Waveform(values={"x": np.full(9, 121.0)}, sample_rate_hz=9.0, quantity="voltage")
    refused(closed, LimitError, "121 V", waveform=position, feedforward=beside)
    refused(SimpleInstrument(), ModelError, "voltage for voltage", feedforward=beside)


def test_a_sensor_that_gives_no_number_stops_the_stage() -> None:
    instrument, kept = SimpleInstrument(), Kept()
    instrument.nan_from = {"across": 1.204}
    with pytest.raises(
        ControllerError, match=r"'across' \(channel 3\) reads nan at sample (\d+) .*\1 samples"
    ):
        run_waveform(instrument, voltages(), [X, ACROSS], rate_hz=1000.0, writer=kept)
    assert instrument.stops == 1
    assert not instrument.waves.running()
    assert 0 < kept.size < 1043
    assert np.all(np.isfinite(kept.column("across")))
    # All that was good is there: the first sample that is missing is the first without a number.
    assert instrument.recorder.begin + kept.size / 1000.0 == pytest.approx(1.204, abs=1.001e-3)


def test_a_lost_link_leaves_what_was_read_and_says_how_much() -> None:
    instrument, kept = SimpleInstrument(cut_link_at=1.3), Kept()
    with pytest.raises(NotConnectedError, match="samples are saved by the writer") as caught:
        run_waveform(instrument, voltages(), [X, U], rate_hz=1000.0, writer=kept)
    assert f"; {kept.size} samples are saved by the writer, of 1043" in str(caught.value)
    assert 500 < kept.size < 900
    assert instrument.log[-1] == "stop that nobody heard"
    with pytest.raises(NotConnectedError, match="samples were read but not saved"):
        run_waveform(SimpleInstrument(cut_link_at=1.3), voltages(), [X], rate_hz=1000.0)


def test_a_writer_that_fails_stops_the_stage() -> None:
    instrument = SimpleInstrument()
    with pytest.raises(RecordError, match="disk is full"):
        run_waveform(instrument, voltages(), [X], rate_hz=1000.0, writer=Kept(full=300))
    assert instrument.stops == 1


def test_a_recorder_that_stands_still_ends_the_run() -> None:
    instrument = SimpleInstrument()
    instrument.recorder.trigger = lambda: None  # type: ignore[method-assign]
    begin = instrument.now
    with pytest.raises(
        ControllerError, match=r"0 of 1043 samples arrived .* check that the recorder was started"
    ):
        run_waveform(instrument, voltages(), [X], rate_hz=1000.0, timeout=2.0)
    assert instrument.stops == 1
    # The wait is the record's own time and the time-out; questions take a millisecond each.
    assert instrument.now - begin < 0.7 + 1.2 * (1.043 + 2.0)


def test_a_waveform_that_does_not_end_is_stopped() -> None:
    instrument = SimpleInstrument()
    instrument.waves.running = lambda: (
        instrument.log[-1] == "start wave 1"
        and (  # type: ignore[method-assign]
            instrument.waves.loaded is not None and instrument.waves.loaded.size == 730
        )
    )
    with pytest.raises(ControllerError, match="the waveform still ran"):
        run_waveform(instrument, voltages(), [X], rate_hz=1000.0, timeout=0.5)
    assert instrument.stops == 1


def test_a_hold_of_any_length_is_whole() -> None:
    for samples in (2, 3, 11, 12, 13, 977):
        instrument, kept = SimpleInstrument(noise=5e-9, seed=4), Kept()
        record = record_now(instrument, [X, ACROSS], 1000.0, samples, kept)
        assert (record.size, kept.size) == (samples, samples)
        # Samples that are read twice, for want of a neighbour, are kept once.
        assert np.array_equal(kept.column("x"), record.channel("x").values)
    assert record.channel("x").values.std() == pytest.approx(5e-9, rel=0.1)  # 1/sqrt(2n) = 2.3 %
    with pytest.raises(ModelError, match="at least 2 samples"):
        record_now(SimpleInstrument(), [X], 1000.0, 1)


def test_the_rate_that_an_instrument_keeps_decides_how_many_samples_there_are() -> None:
    instrument = SimpleInstrument()
    record = run_waveform(instrument, voltages(700, 700.0), [X], rate_hz=3000.0)
    assert record.sample_rate_hz == pytest.approx(1e4 / 3)
    assert record.size == 3333  # one second


def test_a_blow_is_recorded() -> None:
    instrument = SimpleInstrument()
    force = Signal(kind="force", source="x", name="force", unit="N")
    motion = Signal(kind="response", source="x", name="response")
    record = record_impact(instrument, "x", [force, motion], 10e3, 4000)
    assert record.channel("force").values.max() == pytest.approx(21.0, rel=2e-3)
    assert instrument.log[-2:] == ["arm", "strike x"]
    assert record.channel("force").unit == "N"


def test_moves_are_recorded_at_rest() -> None:
    instrument, kept = SimpleInstrument(limits={"x": SCREW}, gains={}, generator=False), Kept()
    places = [0.5e-3, 1.7e-3, 0.2e-3]
    record = run_moves(instrument, "x", places, 0.05, [X], rate_hz=2000.0, writer=kept)
    assert record.size == kept.size == 300
    assert record.channel("command").values == pytest.approx(np.repeat(places, 100), abs=0.0)
    assert record.channel("x").values == pytest.approx(np.repeat(places, 100), abs=1e-12)
    assert np.array_equal(kept.column("command"), record.channel("command").values)
    assert record.uniform
    log = list(instrument.log)
    with pytest.raises(LimitError, match="6100 um"):
        run_moves(instrument, "x", [1e-3, 6.1e-3], 0.05, [X], rate_hz=2000.0)
    assert instrument.log == log


def test_a_link_that_is_lost_between_moves_counts_all_samples() -> None:
    instrument, kept = SimpleInstrument(limits={"x": SCREW}, cut_link_at=2.2), Kept()
    with pytest.raises(NotConnectedError, match=r"samples are saved by the writer$") as e:
        run_moves(instrument, "x", [5e-4, 1.5e-3, 9e-4, 3e-3], 0.05, [X], rate_hz=2e3, writer=kept)
    assert f"; {kept.size} samples" in str(e.value)
    assert kept.size == 200
