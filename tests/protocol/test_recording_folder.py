"""The folder of a run, and a run on an instrument that is recorded into it."""

import numpy as np
import pytest

from flexstage.base.errors import NotConnectedError
from flexstage.instruments.protocol import Signal, Waveform
from flexstage.instruments.record_run import record_now, run_waveform
from flexstage.instruments.recording.archive import recover
from flexstage.instruments.recording.metadata import RunMetadata
from flexstage.instruments.recording.writer import RunWriter
from flexstage.records import read_record
from tests.recordings import RunFolder, written
from tests.simple_instrument import SimpleInstrument

SIGNALS = [
    Signal(kind="position", source="x", name="x"),
    Signal(kind="voltage", source="x", name="drive", unit="V"),
]
CHANNELS = [(s.name, s.unit) for s in SIGNALS]


def test_records_and_streams_are_found_and_drafts_are_not(tmp_path):
    place = RunFolder(tmp_path / "run")
    for name in ("b", "a"):
        run, _ = written(place.stream(name), [5], leave=False)
        run.close()
    written(place.stream("c"), [5])
    written(place.path / "by hand.stream", [5])
    place.stream("a").write_bytes(b"its file is there")
    (place.path / "records" / ".a.h5.xyz.part").write_bytes(b"")
    (place.path / "records" / "notes.txt").write_text("")
    assert [p.name for p in place.records()] == ["a.h5", "b.h5"]
    assert [p.name for p in place.streams()] == ["by hand.stream", "c.stream"]


def about(instrument):
    return RunMetadata(
        stage="vgtu-piezo", instrument=instrument.identity, settings=instrument.settings()
    )


def test_a_waveform_on_an_instrument_is_in_the_file_as_it_was_returned(tmp_path):
    place = RunFolder(tmp_path / "run")
    instrument = SimpleInstrument()
    phase = 2.0 * np.pi * np.arange(730) / 730
    wave = Waveform(
        values={"x": 41.0 - 30.0 * np.cos(phase)}, sample_rate_hz=700.0, quantity="voltage"
    )
    with RunWriter(place.stream("loop"), CHANNELS, 2500.0, about(instrument)) as writer:
        record = run_waveform(instrument, wave, SIGNALS, rate_hz=2500.0, cycles=2, writer=writer)
    [file] = place.records()
    read = read_record(file)
    assert read.size == record.size == round(2 * 730 / 700.0 * 2500.0)
    for name, unit in CHANNELS:
        assert read.channel(name).unit == unit
        assert np.array_equal(read.channel(name).values, record.channel(name).values)
    assert np.ptp(read.channel("drive").values) == pytest.approx(60.0, rel=1e-4)


def test_what_was_read_before_the_link_was_lost_is_in_the_stream(tmp_path):
    place = RunFolder(tmp_path / "run")
    instrument = SimpleInstrument()
    writer = RunWriter(place.stream("hold"), CHANNELS, 2500.0, about(instrument))
    honest = instrument.recorder.read

    def until(first, count):
        if first >= 1500:
            raise NotConnectedError("the link was lost")
        return honest(first, min(count, 500))

    instrument.recorder.read = until
    with pytest.raises(NotConnectedError), writer:
        record_now(instrument, SIGNALS, 2500.0, 4000, writer)
    record, recovery = recover(place.streams()[0])
    assert record.size == recovery.samples >= 1000
    assert not recovery.ended
    assert not place.records()
