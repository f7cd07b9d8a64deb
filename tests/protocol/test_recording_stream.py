"""Streams on disk: their bytes, their end as HDF5, and what they say about bad input."""

import dataclasses
import datetime
import json
import struct
import zlib

import h5py
import numpy as np
import pytest

from flexstage.base.errors import RecordError
from flexstage.instruments.recording import archive
from flexstage.instruments.recording.archive import archived, examine, file_summary, recover
from flexstage.instruments.recording.metadata import RunMetadata, read_metadata
from flexstage.instruments.recording.stream import Irregularity, in_use
from flexstage.instruments.recording.writer import RunWriter
from flexstage.records import read_record
from tests.octave_program import OCTAVE, run_octave
from tests.recordings import CHANNELS, RATE, assert_true, metadata, truth, writer, written


def frames_by_hand(data):
    """Read a whole stream by the layout alone: the description, and number, first, columns."""
    magic, version, length = struct.unpack_from("<8sII", data)
    assert (magic, version) == (b"\x8eFXSTRM\n", 2)
    end = 16 + length
    (checksum_of_head,) = struct.unpack_from("<I", data, end)
    assert checksum_of_head == zlib.crc32(data[:end])
    described = json.loads(data[16:end])
    at = end + 4
    frames = []
    while at < len(data):
        mark, number, first, rows, checksum = struct.unpack_from("<4sIQII", data, at)
        payload = data[at + 24 : at + 24 + 8 * rows * len(described["channels"])]
        assert checksum == zlib.crc32(data[at : at + 20] + payload, checksum_of_head)
        columns = np.frombuffer(payload).reshape(len(described["channels"]), rows)
        frames.append((mark, number, first, columns))
        at += 24 + len(payload)
    return described, frames


def test_the_bytes_are_as_described(tmp_path):
    path = tmp_path / "run.stream"
    written(path, [3, 1, 5], first=2)
    described, frames = frames_by_hand(path.read_bytes())
    assert described["sample_rate_hz"] == RATE
    assert [tuple(c) for c in described["channels"]] == list(CHANNELS)
    assert described["run"]["operator"] == "Ona Š."
    assert [f[:3] for f in frames] == [
        (b"\xf5FX\x8e", 0, 2),
        (b"\xf5FX\x8e", 1, 5),
        (b"\xf5FX\x8e", 2, 6),
    ]
    wanted = truth(2, 3)
    for (name, _), row in zip(CHANNELS, frames[0][3], strict=True):
        assert row.tobytes() == wanted[name].tobytes()


def test_a_closed_run_is_an_hdf5_file_that_reads_back_to_the_last_bit(tmp_path):
    path = tmp_path / "run.stream"
    run, _ = written(path, [1000, 1, 417], leave=False)
    about = run.head.run
    target = run.close()
    assert target == tmp_path / "run.h5"
    assert [p.name for p in tmp_path.iterdir()] == ["run.h5"]
    record = read_record(target)
    assert_true(record, range(1418))
    assert [c.name for c in record.channels] == [name for name, _ in CHANNELS]
    assert record.sample_rate_hz == pytest.approx(RATE, rel=1e-14)
    assert record.attributes["serial_number"] == "A-0042"
    assert record.attributes["instrument"] == "Physik E-7xx 115 (simulated)"
    assert record.attributes["simulated"] == "yes"
    assert record.attributes["ending"] == "complete"
    assert "lost" not in record.attributes
    assert read_metadata(record) == about
    summary = file_summary(target)
    assert (summary.metadata, summary.samples, summary.sample_rate_hz) == (about, 1418, RATE)
    assert (summary.complete, summary.lost) == (True, "")
    assert [unit for _, unit in summary.channels] == [unit for _, unit in CHANNELS]
    assert run.close() == target


def test_one_channel_is_enough_and_names_may_only_differ_in_signs(tmp_path):
    with RunWriter(tmp_path / "a.stream", [("x", "m")], 50.0, metadata()) as run:
        run.append(0, {"x": [1e-6, 3e-6, 2e-6]})
    assert read_record(tmp_path / "a.h5").channel("x").values.tolist() == [1e-6, 3e-6, 2e-6]
    names = [("x+", "m"), ("x-", "m"), ("run", "V"), ("9", "V")]
    with RunWriter(tmp_path / "b.stream", names, 50.0, metadata()) as run:
        run.append(0, {n: [float(i), i + 0.5] for i, (n, _) in enumerate(names)})
    record = read_record(tmp_path / "b.h5")
    assert [c.name for c in record.channels] == [n for n, _ in names]
    assert [c.values.tolist() for c in record.channels] == [[i, i + 0.5] for i in range(4)]


def test_settings_of_any_length_and_any_letter_are_kept(tmp_path):
    about = metadata(settings={"table": "7" * 200_000, "odd\0name": "\ud83d"}, note="n" * 70_000)
    run, _ = written(tmp_path / "run.stream", [5], leave=False, metadata=about)
    record = read_record(run.close())
    assert read_metadata(record) == run.head.run
    assert read_metadata(record).settings == about.settings
    assert len(record.attributes["note"]) == 1000


def test_values_that_are_no_numbers_are_kept_and_told_when_read(tmp_path):
    with RunWriter(tmp_path / "a.stream", [("x", "m"), ("y", "m")], 50.0, metadata()) as run:
        run.append(0, {"x": [1e-6, np.nan, 2e-6, np.inf], "y": [0.0, 1.0, 2.0, 3.0]})
    with pytest.raises(RecordError, match=r"column 'x' is missing .* sample 1"):
        read_record(tmp_path / "a.h5")
    kept = read_record(tmp_path / "a.h5", columns=["y"]).channel("x").values
    assert np.array_equal(kept, [1e-6, np.nan, 2e-6, np.inf], equal_nan=True)


def test_a_gap_is_told_kept_and_never_closed_up(tmp_path):
    run, _ = written(tmp_path / "run.stream", [40], leave=False)
    told = run.append(53, truth(53, 20))
    assert told == Irregularity(kind="gap", first=40, count=13)
    assert str(told) == "samples 40 to 52 not received from the instrument"
    assert run.append(73, truth(73, 2)) is None
    assert run.irregularities == (told,)
    numbers = [*range(40), *range(53, 75)]
    target = run.close()
    with pytest.raises(RecordError, match=r"gap of .* after sample 39"):
        read_record(target)
    late = read_record(target, rows=(40, None))
    assert_true(late, range(53, 75))
    assert late.attributes["lost"] == "samples 40 to 52 not received from the instrument"
    assert file_summary(target).complete
    with h5py.File(target) as file:
        assert np.array_equal(file["time"][()], np.array(numbers) / RATE)


def test_a_gap_before_the_first_sample_keeps_the_numbers(tmp_path):
    run, _ = written(tmp_path / "run.stream", [10, 4], first=7, leave=False)
    assert run.irregularities == (Irregularity(kind="gap", first=0, count=7),)
    assert_true(read_record(run.close()), range(7, 21))


def test_samples_that_come_twice_are_told_and_the_stream_stays(tmp_path):
    path = tmp_path / "run.stream"
    run, _ = written(path, [40], leave=False)
    other = {name: -v for name, v in truth(31, 15).items()}
    told = run.append(31, other)
    assert told == Irregularity(kind="overlap", first=31, count=9)
    assert run.append(3, truth(3, 4)) == Irregularity(kind="overlap", first=3, count=4)
    record = read_record(run.close())
    assert record.size == 46
    x = record.channel("x").values
    assert np.array_equal(x[:40], truth(0, 40)["x"])
    assert np.array_equal(x[40:], -truth(40, 6)["x"])
    assert "samples 31 to 39 received twice" in record.attributes["lost"]
    # what the file leaves out is only there
    assert path.exists()
    assert len(frames_by_hand(path.read_bytes())[1]) == 4


@pytest.mark.parametrize("count", [0, 1])
def test_a_run_without_two_samples_stays_a_stream(tmp_path, count):
    run, _ = written(tmp_path / "run.stream", [count] if count else [], leave=False)
    with pytest.raises(RecordError, match=f"has {count} samples, and a record needs two"):
        run.close()
    assert examine(tmp_path / "run.stream").ended
    with pytest.raises(RecordError, match=f"contains {count} complete samples"):
        recover(tmp_path / "run.stream")


def test_no_run_is_written_over(tmp_path):
    path = tmp_path / "run.stream"
    written(path, [3])
    before = path.read_bytes()
    with pytest.raises(RecordError, match="exists: runs are never overwritten"):
        writer(path)
    assert path.read_bytes() == before
    (tmp_path / "other.h5").write_bytes(b"mine")
    with pytest.raises(RecordError, match=r"other\.h5' exists"):
        writer(tmp_path / "other.stream")
    assert not (tmp_path / "other.stream").exists()
    # one that comes while the run is made is not written over either
    run, _ = written(tmp_path / "late.stream", [5], leave=False)
    (tmp_path / "late.h5").write_bytes(b"mine")
    with pytest.raises(RecordError, match="exists"):
        run.close()
    assert (tmp_path / "late.h5").read_bytes() == b"mine"
    assert_true(recover(tmp_path / "late.stream")[0], range(5))


def test_the_stream_goes_only_when_the_file_was_compared(tmp_path, monkeypatch):
    path = tmp_path / "run.stream"
    run, _ = written(path, [300, 20], leave=False)
    honest = archive._write

    def damaged(draft, stream, found):
        honest(draft, stream, found)
        with h5py.File(draft, "r+") as file:
            file["drive"][319] = np.nextafter(file["drive"][319], np.inf)

    monkeypatch.setattr(archive, "_write", damaged)
    with pytest.raises(RecordError, match="differs from the stream"):
        run.close()
    assert [p.name for p in tmp_path.iterdir()] == ["run.stream"]
    monkeypatch.setattr(archive, "_write", honest)
    assert_true(read_record(archived(path, tmp_path / "run.h5")), range(320))


def test_an_error_in_the_block_leaves_a_stream_to_recover(tmp_path):
    path = tmp_path / "run.stream"
    with pytest.raises(KeyboardInterrupt), writer(path) as run:  # noqa: PT012
        run.append(0, truth(0, 30))
        raise KeyboardInterrupt
    record, recovery = recover(path)
    assert_true(record, range(30))
    assert (recovery.samples, recovery.ended, recovery.complete) == (30, False, False)
    assert recovery.head.run.operator == "Ona Š."
    assert record.attributes["ending"] == "recovered"
    with pytest.raises(RecordError, match="is closed"):
        run.append(30, truth(30, 1))
    with pytest.raises(RecordError, match="still a stream"):
        run.close()


def test_large_chunks_are_cut_and_small_ones_gathered(tmp_path):
    path = tmp_path / "run.stream"
    many = 300_000  # 9.6 MB in one piece: frames hold 4 MiB
    run, _ = written(path, [many, *[3] * 50, 0], leave=False)
    sizes = [f[3].shape[1] for f in frames_by_hand(path.read_bytes())[1]]
    assert sizes == [131_072, 131_072, 37_856] + [3] * 50
    record = read_record(run.close())
    assert record.size == many + 150
    wanted = truth(0, many + 150)
    assert all(np.array_equal(record.channel(n).values, wanted[n]) for n, _ in CHANNELS)


def test_the_caller_may_fill_its_arrays_anew(tmp_path):
    buffer = np.zeros(4)
    run = RunWriter(tmp_path / "run.stream", [("x", "m")], 10.0, metadata(), sync=100.0)
    for k in range(3):
        buffer[:] = k
        run.append(4 * k, {"x": buffer})
    assert (
        read_record(run.close()).channel("x").values.tolist() == [0.0] * 4 + [1.0] * 4 + [2.0] * 4
    )


def test_samples_are_forced_to_disk_by_the_clock(tmp_path):
    now = [10.0]
    run = writer(tmp_path / "run.stream", sync=0.5, clock=lambda: now[0])
    run.append(0, truth(0, 8))
    assert (run.samples, run.synced) == (8, 0)
    now[0] += 0.49
    run.append(8, truth(8, 8))
    assert run.synced == 0
    now[0] += 0.02
    run.append(16, truth(16, 8))
    assert (run.samples, run.synced) == (24, 24)
    run.append(24, truth(24, 8))
    assert run.synced == 24
    run.sync()
    assert run.synced == 32
    run.leave()
    at_once = writer(tmp_path / "b.stream", sync=0.0, clock=lambda: now[0])
    at_once.append(0, truth(0, 8))
    assert at_once.synced == 8
    at_once.leave()


def test_no_more_than_eight_megabytes_wait_for_the_disk(tmp_path):
    run = RunWriter(
        tmp_path / "run.stream", [("x", "m")], 10.0, metadata(), sync=1e9, clock=lambda: 0.0
    )
    step = 2**17
    for k in range(9):  # 1 MiB each
        run.append(k * step, {"x": np.zeros(step)})
    assert run.synced >= 8 * step
    run.leave()


def test_a_stream_says_that_it_is_being_written(tmp_path):
    run, _ = written(tmp_path / "run.stream", [4], leave=False)
    assert in_use(tmp_path / "run.stream")
    run.leave()
    assert not in_use(tmp_path / "run.stream")


BAD_CHUNKS = [
    (lambda c: c.pop("x"), "must have the channels x, drive"),
    (lambda c: c.update(z=c["x"]), "must have the channels x, drive"),
    (lambda c: c.update(x=c["x"][:-1]), "the same number of samples, got x: 4, drive: 5"),
    (
        lambda c: c.update(x=c["x"].reshape(5, 1)),
        r"array of numbers, got float64 of shape \(5, 1\)",
    ),
    (lambda c: c.update(x=c["x"] * 1j), "array of numbers, got complex128"),
    (lambda c: c.update(x=list("abcde")), "array of numbers, got <U1"),
]


@pytest.mark.parametrize(("spoil", "said"), BAD_CHUNKS)
def test_a_chunk_of_the_wrong_form_is_refused_and_leaves_no_trace(tmp_path, spoil, said):
    run, positions = written(tmp_path / "run.stream", [4], leave=False)
    columns = truth(4, 5)
    spoil(columns)
    with pytest.raises(RecordError, match=said):
        run.append(4, columns)
    assert (tmp_path / "run.stream").stat().st_size == positions[-1]
    assert run.append(4, truth(4, 5)) is None
    assert_true(read_record(run.close()), range(9))


@pytest.mark.parametrize("first", [-1, 1.0, True, None, 2**53])
def test_the_first_sample_is_a_whole_number(tmp_path, first):
    run = writer(tmp_path / "run.stream")
    with pytest.raises(RecordError, match="integer from 0"):
        run.append(first, truth(0, 2))
    run.leave()


@pytest.mark.parametrize(
    ("channels", "said"),
    [
        ([], "at least one channel"),
        ([("x", "m"), ("x", "V")], "two channels have the name 'x'"),
        ([("", "m")], "one line without surrounding spaces"),
        ([("a\nb", "m")], "one line without surrounding spaces"),
        ([("Time", "s")], "cannot be called 'Time'"),
        ([("x", "um")], "SI unit, got 'um': multiply its values by 1e-06 and give 'm'"),
        ([("x", "parrot")], "channel 'x': unknown unit 'parrot'"),
    ],
)
def test_channels_that_no_record_can_have_are_refused(tmp_path, channels, said):
    with pytest.raises(RecordError, match=said):
        RunWriter(tmp_path / "run.stream", channels, 10.0, metadata())
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("rate", [0.0, -1.0, float("nan"), float("inf"), "7"])
def test_a_rate_is_positive_and_finite(tmp_path, rate):
    with pytest.raises(RecordError, match="sample rate must be positive"):
        RunWriter(tmp_path / "run.stream", [("x", "m")], rate, metadata())


def test_a_stream_has_its_ending_and_its_folder(tmp_path):
    with pytest.raises(RecordError, match=r"must end in \.stream, got 'run\.h5'"):
        writer(tmp_path / "run.h5")
    with pytest.raises(RecordError, match="cannot be created: No such file"):
        writer(tmp_path / "no" / "run.stream")
    with pytest.raises(RecordError, match="must not be negative"):
        writer(tmp_path / "run.stream", sync=-1.0)


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ({"stage": 3}, "'stage' of a run must be a text, got 3"),
        ({"seed": 1.5}, "seed of a run must be an integer"),
        ({"settings": {"P": 0.1}}, "must be texts by name"),
        ({"identifier": "XYZ"}, "must be 32 hexadecimal digits"),
        ({"started": "yesterday"}, "must be a date and time such as 2"),
        ({"started": "2031-05-17T09:30:00"}, "must have a time zone"),
        ({"started": "0001-01-01T00:00:00+05:00"}, "must be a date and time such as 2"),
    ],
)
def test_a_run_says_only_what_can_be(words, said):
    with pytest.raises(RecordError, match=said):
        metadata(**words)


@pytest.mark.parametrize(
    ("plain", "said"),
    [
        (None, ": expected a mapping"),
        (3, ": expected a mapping of names to values, got 3"),
        ({}, ": 'stage' is missing"),
        ({"stage": "s"}, ": 'instrument' is missing"),
        ({"stage": "s", "instrument": 4}, ", instrument: expected a mapping"),
    ],
)
def test_a_description_that_is_none_is_refused(plain, said):
    with pytest.raises(RecordError, match=f"^metadata of a run{said}"):
        RunMetadata.from_plain(plain)


def test_one_description_serves_for_several_runs(tmp_path):
    about = metadata()
    assert (about.identifier, about.started) == ("", "")
    first, second = (writer(tmp_path / f"{k}.stream", metadata=about) for k in range(2))
    for run in (first, second):
        begun = run.head.run
        assert dataclasses.replace(begun, identifier="", started="") == about
        age = datetime.datetime.now(datetime.UTC) - begun.start_time()
        assert 0.0 <= age.total_seconds() < 60.0
        run.leave()
    assert first.head.run.identifier != second.head.run.identifier
    given = metadata(identifier="0f" * 16, started="2031-05-17T12:30:00+03:00")
    assert given.begun() == given
    assert given.start_time().isoformat() == "2031-05-17T09:30:00+00:00"


def test_what_a_later_version_adds_is_left_out():
    about = metadata()
    assert RunMetadata.from_plain({**about.plain(), "weather": "rain"}) == about


def test_files_of_others_are_told_apart(tmp_path):
    text = tmp_path / "a.csv"
    text.write_text("time (s),x (m)\n0,1\n1,2\n")
    with pytest.raises(RecordError, match="is not a stream of a run"):
        recover(text)
    (tmp_path / "empty.stream").write_bytes(b"")
    with pytest.raises(RecordError, match="is not a stream of a run"):
        recover(tmp_path / "empty.stream")
    with pytest.raises(RecordError, match="cannot be read: No such file"):
        recover(tmp_path / "none.stream")
    with pytest.raises(RecordError, match="cannot be read: Is a directory"):
        examine(tmp_path)
    with pytest.raises(RecordError, match="has no metadata of its run"):
        read_metadata(read_record(text))
    with pytest.raises(RecordError, match="is not a complete HDF5 file of a run"):
        file_summary(text)
    with h5py.File(tmp_path / "b.h5", "w") as file:
        file["x"] = [1.0, 2.0]
    with pytest.raises(RecordError, match="is not a complete HDF5 file of a run"):
        file_summary(tmp_path / "b.h5")


@pytest.mark.parametrize(
    ("version", "mend"), [(3, "wrote it, or a later one$"), (1, "with the version that wrote it$")]
)
def test_streams_of_another_version_are_not_guessed_at(tmp_path, version, mend):
    path = tmp_path / "run.stream"
    written(path, [4])
    data = bytearray(path.read_bytes())
    length = struct.unpack_from("<I", data, 12)[0]
    data[8] = version
    struct.pack_into("<I", data, 16 + length, zlib.crc32(data[: 16 + length]))
    path.write_bytes(data)
    said = f"of version {version}, and this flexstage reads version 2: read it .*{mend}"
    with pytest.raises(RecordError, match=said):
        recover(path)


def test_a_frame_of_another_run_is_none_of_this_one(tmp_path):
    paths = [tmp_path / f"{name}.stream" for name in ("one", "other")]
    heads = []
    for path in paths:
        run, _ = written(path, [40, 40])
        heads.append(run.head)
    data = [path.read_bytes() for path in paths]
    # the same channels and samples, and the identifier of a run alone differs
    assert heads[0].run.identifier != heads[1].run.identifier
    assert len(data[0]) == len(data[1])
    at = data[1].rindex(b"\xf5FX\x8e")
    paths[0].write_bytes(data[0][:at] + data[1][at:])
    found = examine(paths[0])
    assert found.samples == 40
    assert not found.complete


@pytest.mark.skipif(OCTAVE is None, reason="GNU Octave is not installed")
def test_octave_loads_all_of_a_record(tmp_path):
    path = tmp_path / "run.stream"
    written(path, [30, 12])
    file = archived(path, tmp_path / "run.h5")
    done = run_octave(
        tmp_path,
        'found = load("run.h5"); printf("%d %s\\n", numel(fieldnames(found)), found.run);',
    )
    assert done.stderr == ""
    count, _, described = done.stdout.partition(" ")
    assert int(count) == 1 + len(CHANNELS)
    assert json.loads(described) == read_metadata(read_record(file)).plain()
