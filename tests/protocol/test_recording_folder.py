"""The folder of a run, and a run on an instrument that is recorded into it."""

from datetime import UTC, datetime, timedelta, timezone

import numpy as np
import pytest

from flexstage.errors import NotConnectedError, RecordError
from flexstage.instruments.protocol import Signal
from flexstage.instruments.record_run import record_now, run_waveform
from flexstage.instruments.recording.folder import RunFolder
from flexstage.instruments.recording.metadata import RunMetadata
from flexstage.instruments.recording.recovery import recover
from flexstage.instruments.recording.writer import RunWriter
from flexstage.instruments.waveform import Waveform
from flexstage.records import read_record
from tests.recordings import written
from tests.simple_instrument import SimpleInstrument

WHEN = datetime(2031, 5, 17, 12, 30, 5, tzinfo=timezone(timedelta(hours=3)))
SIGNALS = [
    Signal(kind="position", source="x", name="x"),
    Signal(kind="voltage", source="x", name="drive", unit="V"),
]
CHANNELS = [(s.name, s.unit) for s in SIGNALS]


def test_a_folder_is_named_by_utc_stage_and_subject(tmp_path):
    made = RunFolder.create(tmp_path / "new" / "runs", "VGTU piezo/2", "Loop: 1 Hz!", when=WHEN)
    assert made.path == tmp_path / "new" / "runs" / "20310517T093005Z-vgtu-piezo-2-loop-1-hz"
    assert sorted(p.name for p in made.path.iterdir()) == ["models", "records", "report"]
    assert made.stream("stroke of x") == made.path / "records" / "stroke-of-x.stream"
    assert RunFolder.open(made.path) == made
    again = RunFolder.create(made.path.parent, "VGTU piezo/2", "Loop: 1 Hz!", when=WHEN)
    assert again.path.name == "20310517T093005Z-vgtu-piezo-2-loop-1-hz-2"
    plain = RunFolder.create(tmp_path, "s", when=datetime(2031, 1, 2, tzinfo=UTC))
    assert plain.path.name == "20310102T000000Z-s"


def test_names_stay_in_the_folder(tmp_path):
    place = RunFolder.create(tmp_path, "../../etc", "x" * 500, when=WHEN)
    assert place.path.parent == tmp_path
    assert len(place.path.name) < 100
    assert place.stream("../../../tmp/a").parent == place.path / "records"
    with pytest.raises(RecordError, match="has no letter that the name of a file can have"):
        place.stream("../..")


def test_a_folder_that_is_not_there_or_cannot_be_made_is_told(tmp_path):
    with pytest.raises(RecordError, match="there is no folder"):
        RunFolder.open(tmp_path / "none")
    (tmp_path / "file").write_text("")
    with pytest.raises(RecordError, match="cannot be made in"):
        RunFolder.create(tmp_path / "file" / "runs", "s")


def test_records_and_streams_are_found_and_drafts_are_not(tmp_path):
    place = RunFolder.create(tmp_path, "s", when=WHEN)
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
    place = RunFolder.create(tmp_path, "vgtu-piezo", "loop", when=WHEN)
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
    place = RunFolder.create(tmp_path, "vgtu-piezo", "hold", when=WHEN)
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
