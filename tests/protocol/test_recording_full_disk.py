"""A disk that is full or fails: one clear error, nothing written is lost, the rest is in memory."""

import itertools
import os
import shutil
import subprocess
import sys

import numpy as np
import pytest

from flexstage.base.errors import RecordError
from flexstage.instruments.recording.archive import examine, recover
from flexstage.instruments.recording.writer import RunWriter
from flexstage.records import read_record
from tests.recordings import (
    CHANNELS,
    RATE,
    FullDisk,
    assert_true,
    metadata,
    small_disk,
    truth,
    writer,
)

CHUNKS = [7, 1, 30, 12, 5]
STARTS = np.cumsum([0, *CHUNKS])


def size_of_head(tmp_path):
    run = writer(tmp_path / "head.stream")
    size = run.path.stat().st_size
    run.leave()
    return size


def append_all(run):
    """Append all chunks; return the errors that came."""
    errors = []
    for first, count in zip(STARTS, CHUNKS, strict=False):
        try:
            run.append(int(first), truth(first, count))
        except RecordError as error:
            errors.append((int(first), str(error)))
    return errors


@pytest.mark.parametrize("room", [*range(0, 1900, 37), 1, 23, 24, 25, 247, 248, 249])
def test_wherever_the_disk_is_full(tmp_path, room):
    head = size_of_head(tmp_path)
    path = tmp_path / "run.stream"
    opener, files = small_disk(head + room)
    run = writer(path, opener=opener)
    errors = append_all(run)
    # 24 bytes before the samples of a chunk, 8 for each sample of 4 channels
    ends = np.cumsum([24 + 32 * count for count in CHUNKS])
    whole = int(np.count_nonzero(ends <= room))
    if whole == len(CHUNKS):
        assert errors == []
        assert not run.failed
        run.leave()
        return
    safe = int(STARTS[whole])
    assert errors == [
        (
            safe,
            f"writing to '{path}' failed: No space left on device; its first {safe} samples are "
            "safe, the following ones are only in memory",
        )
    ]
    assert run.failed
    assert [first for first, _ in run.unsaved] == STARTS[whole:-1].tolist()
    for (first, columns), count in zip(run.unsaved, CHUNKS[whole:], strict=True):
        assert all(np.array_equal(columns[n], truth(first, count)[n]) for n, _ in CHANNELS)
    # it is readable while the writer still has it, and half a chunk was cut off again
    assert path.stat().st_size == head + (ends[whole - 1] if whole else 0)
    found = examine(path)
    assert (found.samples, found.damaged_bytes, found.ended) == (safe, 0, False)
    if safe >= 2:
        assert_true(recover(path)[0], range(safe))
    # still full: nothing changes but for another sentence
    with pytest.raises(RecordError, match="still fails: No space left on device"):
        run.close()
    assert examine(path).samples >= safe
    assert [first for first, _ in run.unsaved] == STARTS[whole:-1].tolist()
    # room again: all of it becomes the file
    files[0].room = None
    assert_true(read_record(run.close()), range(sum(CHUNKS)))
    assert not path.exists()
    assert run.unsaved == ()


def test_a_sync_that_fails_is_not_forgotten(tmp_path):
    now = [0.0]
    files = []

    def opener(path):
        files.append(FullDisk(path, "xb"))
        return files[0]

    run = writer(tmp_path / "run.stream", sync=1.0, clock=lambda: now[0], opener=opener)
    run.append(0, truth(0, 7))
    run.sync()
    run.append(7, truth(7, 1))
    files[0].syncs = 0
    now[0] = 5.0
    with pytest.raises(RecordError, match="Input/output error; its first 7 samples are safe"):
        run.append(8, truth(8, 30))
    # nobody knows what of it is on disk: it is all still in memory
    assert [(f, c["x"].size) for f, c in run.unsaved] == [(7, 1), (8, 30)]
    assert run.synced == 7
    columns = truth(38, 4)
    run.append(38, columns)
    for values in columns.values():  # the caller goes on with its own arrays
        values[:] = 0.0
    with pytest.raises(RecordError, match="still fails"):
        run.close()
    files[0].syncs = None
    record = read_record(run.close())
    assert_true(record, range(42))
    # what was written again is there once
    assert "lost" not in record.attributes


def test_an_end_that_cannot_be_written_is_told_and_tried_again(tmp_path):
    head = size_of_head(tmp_path)
    path = tmp_path / "run.stream"
    opener, files = small_disk(head + 24 + 32 * 7 + 5)
    run = writer(path, opener=opener)
    run.append(0, truth(0, 7))
    with pytest.raises(RecordError, match="its first 7 samples are safe"):
        run.close()
    assert_true(recover(path)[0], range(7))
    files[0].room = None
    assert_true(read_record(run.close()), range(7))


def test_a_stream_that_cannot_be_begun_leaves_no_file(tmp_path):
    opener, _ = small_disk(100)
    with pytest.raises(
        RecordError, match=r"cannot be started: No space left.* nothing was recorded"
    ):
        writer(tmp_path / "run.stream", opener=opener)
    assert not list(tmp_path.iterdir())


@pytest.fixture
def tiny_disk(tmp_path):
    """Give a folder on a file system of 2 MiB, where this process may make one."""
    if sys.platform != "linux" or os.geteuid() != 0 or shutil.which("mount") is None:
        pytest.skip("only root on Linux can mount a small file system")
    folder = tmp_path / "disk"
    folder.mkdir()
    words = ["mount", "-t", "tmpfs", "-o", "size=2m", "flexstage-test", str(folder)]
    made = subprocess.run(words, capture_output=True, text=True, timeout=30, check=False)
    if made.returncode:
        pytest.skip(f"no file system can be mounted here: {made.stderr.strip()}")
    yield folder
    subprocess.run(["umount", "-l", str(folder)], check=True, timeout=30)


def append_until_it_fails(run):
    for first in itertools.count(0, 1000):
        run.append(first, truth(first, 1000))


def test_a_file_system_that_is_full(tiny_disk, tmp_path):
    run = RunWriter(tiny_disk / "run.stream", CHANNELS, 10.0, metadata())
    with pytest.raises(RecordError, match="No space left on device"):
        append_until_it_fails(run)
    [(unsaved, _)] = run.unsaved
    first = unsaved + 1000
    kept, recovery = recover(tiny_disk / "run.stream")
    assert kept.size == recovery.samples == first - 1000
    assert recovery.damaged_bytes == 0
    # what is kept in memory can be written elsewhere
    with RunWriter(tmp_path / "rest.stream", CHANNELS, RATE, run.head.run) as other:
        for start, columns in run.unsaved:
            other.append(start, columns)
        other.append(first, truth(first, 10))
    run.leave()
    assert_true(read_record(tmp_path / "rest.h5"), range(unsaved, first + 10))


def test_no_room_for_the_hdf5_file(tiny_disk):
    path = tiny_disk / "run.stream"
    run = RunWriter(path, CHANNELS, 10.0, metadata())
    for k in range(35):  # 1.1 MB, which fits once
        run.append(1000 * k, truth(1000 * k, 1000))
    # 4 channels of 8 bytes each, and what describes them
    needed = "has 1.0 MB of free space, and the record needs 1.2 MB: all 35000 samples are safe in"
    with pytest.raises(
        RecordError, match=f"{needed} .*; free some space, then run 'flexstage runs recover"
    ):
        run.close()
    assert [p.name for p in tiny_disk.iterdir()] == ["run.stream"]
    record, recovery = recover(path)
    assert recovery.complete
    assert record.size == 35_000
