"""Damage of any kind: what is read is what was written, and what is not read is told.

Evidence (Instruments, twin, control): damaged streams: nothing false read
"""

import itertools
import json
import shutil
import struct

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from flexstage.base.errors import RecordError
from flexstage.instruments.recording.archive import examine, recover
from tests.recordings import RATE, assert_true, written

CHUNKS = [3, 1, 8, 2, 5, 6, 1, 1]
STARTS = np.cumsum([0, *CHUNKS]).tolist()
TOTAL = STARTS[-1]
SETTINGS = settings(deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])


@pytest.fixture
def stream(tmp_path):
    """A whole stream: its path, its bytes, and where each of its frames begins and ends."""
    path = tmp_path / "whole.stream"
    run, positions = written(path, CHUNKS, leave=False)
    run._finish()
    data = path.read_bytes()
    return path, data, [*positions, len(data)]


def spoilt(path, data):
    other = path.with_name("spoilt.stream")
    # some file systems wait for the disk where a file is written over, and not for a new one
    other.unlink(missing_ok=True)
    other.write_bytes(data)
    return other


def numbers_of(record):
    return np.round(record.time * RATE).astype(int).tolist()


def covered(recovery):
    """Return the numbers of all samples that are told to be lost."""
    return {
        n for part in recovery.lost if part.kind == "damage" for n in
        range(part.first, part.first + part.count)
    }  # fmt: skip


@SETTINGS
@given(share=st.floats(0.0, 1.0))
def test_a_file_that_is_cut_anywhere_gives_every_whole_chunk(stream, share):
    path, data, positions = stream
    cut = round(share * len(data))
    other = spoilt(path, data[:cut])
    if cut < positions[0]:
        with pytest.raises(RecordError):
            examine(other)
        return
    found = examine(other)
    whole = sum(1 for p in positions[1:-1] if p <= cut)
    assert found.samples == STARTS[whole]
    assert found.complete == found.ended == (cut == len(data))
    assert found.head.run.operator == "Ona Š."
    if found.samples >= 2:
        record, _ = recover(other)
        assert_true(record, range(STARTS[whole]))
    else:
        with pytest.raises(RecordError, match="a record needs two"):
            recover(other)


@SETTINGS
@given(place=st.floats(0.0, 1.0, exclude_max=True), bit=st.integers(0, 7))
def test_a_flipped_bit_costs_its_own_chunk_and_no_other(stream, place, bit):
    path, data, positions = stream
    at = int(place * len(data))
    changed = bytearray(data)
    changed[at] ^= 1 << bit
    if at < positions[0]:  # nobody knows what the numbers are
        with pytest.raises(RecordError, match=r"is damaged|is not a stream of a run"):
            recover(spoilt(path, changed))
        return
    record, found = recover(spoilt(path, changed))
    frame = next(i for i, end in enumerate(positions[1:]) if at < end)
    if frame == len(CHUNKS):  # the end
        assert_true(record, range(TOTAL))
        assert not found.ended
        return
    gone = set(range(STARTS[frame], STARTS[frame + 1]))
    assert_true(record, [n for n in range(TOTAL) if n not in gone])
    assert covered(found) == gone
    assert found.ended
    assert not found.complete
    assert found.damaged_bytes == positions[frame + 1] - positions[frame]
    assert any("inside the stream" in note for note in found.notes)


@SETTINGS
@given(st.data())
def test_random_bytes_over_random_places_never_give_a_wrong_sample(stream, data):
    path, whole, _ = stream
    changed = bytearray(whole)
    for _ in range(data.draw(st.integers(1, 4))):
        at = data.draw(st.integers(0, len(whole) - 1))
        junk = data.draw(st.binary(min_size=1, max_size=200))
        if data.draw(st.booleans()):
            changed[at : at + len(junk)] = junk
        elif data.draw(st.booleans()):
            changed[at:at] = junk
        else:
            del changed[at : at + len(junk)]
    try:
        record, found = recover(spoilt(path, changed))
    except RecordError:
        return
    assert_true(record)
    numbers = numbers_of(record)
    assert len(set(numbers)) == len(numbers) == found.samples
    missing = set(range(TOTAL)) - set(numbers)
    if found.ended:
        assert covered(found) == missing
    else:  # without its end nobody knows how long it was
        assert covered(found) == {n for n in missing if n < max(numbers)}
    assert found.complete == (found.ended and not missing)
    assert not found.complete or record.attributes["ending"] == "complete"


@SETTINGS
@given(order=st.permutations(range(len(CHUNKS))))
def test_a_chunk_that_stands_behind_a_later_one_is_told_to_be_damage(stream, order):
    path, data, positions = stream
    frames = [data[a:b] for a, b in itertools.pairwise(positions)]
    swapped = data[: positions[0]] + b"".join(frames[i] for i in order) + frames[-1]
    left = [i for k, i in enumerate(order) if i == max(order[: k + 1])]
    if sum(CHUNKS[i] for i in left) < 2:
        with pytest.raises(RecordError, match="a record needs two"):
            recover(spoilt(path, swapped))
        return
    record, found = recover(spoilt(path, swapped))
    numbers = [n for i in left for n in range(STARTS[i], STARTS[i + 1])]
    assert_true(record, numbers)
    assert covered(found) == set(range(TOTAL)) - set(numbers)
    assert found.complete == (len(left) == len(order))


@SETTINGS
@given(
    lost=st.sets(st.integers(0, len(CHUNKS) - 1), max_size=len(CHUNKS) - 2),
    again=st.integers(0, len(CHUNKS) - 1),
)
def test_chunks_that_vanish_without_a_trace_are_told(stream, lost, again):
    path, data, positions = stream
    frames = [data[a:b] for a, b in itertools.pairwise(positions)]
    kept = [i for i in range(len(CHUNKS)) if i not in lost]
    body = b"".join(frames[i] for i in kept)
    # one of the others is there twice, as after a copy that was begun anew
    body += frames[again] if again in kept else b""
    left = sum(CHUNKS[i] for i in kept)
    other = spoilt(path, data[: positions[0]] + body + frames[-1])
    if left < 2:
        with pytest.raises(RecordError):
            recover(other)
        return
    record, found = recover(other)
    gone = {n for i in lost for n in range(STARTS[i], STARTS[i + 1])}
    assert_true(record, [n for n in range(TOTAL) if n not in gone])
    assert covered(found) == gone
    assert found.complete == (not gone)
    if gone:
        assert any("lost by damage of the file" in n for n in found.notes)


def test_a_length_that_lies_reads_nothing_beyond_the_file(stream):
    path, data, positions = stream
    for rows in (2**32 - 1, 2**17, 9, 0):
        changed = bytearray(data)
        struct.pack_into("<I", changed, positions[2] + 16, rows)
        record, found = recover(spoilt(path, changed))
        assert covered(found) == set(range(STARTS[2], STARTS[3]))
        assert record.size == TOTAL - CHUNKS[2]


def test_a_damaged_head_says_so(stream):
    path, data, _ = stream
    changed = bytearray(data)
    changed[30] ^= 1
    with pytest.raises(RecordError, match=r"the head of the stream .* is damaged"):
        recover(spoilt(path, changed))


def test_marks_inside_samples_do_not_confuse_the_search(tmp_path):
    """Samples that look like the beginning of frames, between damaged ones."""
    from flexstage.instruments.recording.writer import RunWriter
    from tests.recordings import metadata

    (trap,) = struct.unpack("<d", b"\xf5FX\x8e\x01\x00\x00\x00")
    path = tmp_path / "run.stream"
    run = RunWriter(path, [("x", "m"), ("y", "m")], 10.0, metadata(), sync=None)
    head = path.stat().st_size
    for k in range(4):
        run.append(50 * k, {"x": np.full(50, trap), "y": np.arange(50.0) + k})
    run.leave()
    data = bytearray(path.read_bytes())
    size = (len(data) - head) // 4
    data[head + size + 40] ^= 4
    path.write_bytes(data)
    record, found = recover(path)
    assert numbers_of_at(record, 10.0) == [*range(50), *range(100, 200)]
    assert found.damaged_bytes == size
    assert np.all(record.channel("x").values == trap)
    assert json.loads(record.attributes["run"])["stage"] == "vgtu-piezo"


def numbers_of_at(record, rate):
    return np.round(record.time * rate).astype(int).tolist()


def test_a_long_damage_is_searched_block_by_block(tmp_path):
    """The next whole chunk lies more than one block of the search away, across its edge."""
    path = tmp_path / "run.stream"
    _, positions = written(path, [4, 4, 4])
    data = path.read_bytes()
    for gap in (2**22 - 3, 2**22 - 1, 2**22 + 17, 9_000_001):
        junk = b"\xf5FX" * (gap // 3) + b"\0" * (gap % 3)
        other = tmp_path / "long.stream"
        other.write_bytes(data[: positions[1]] + junk + data[positions[1] :])
        record, found = recover(other)
        assert_true(record, range(12))
        assert found.damaged_bytes == gap
    shutil.rmtree(tmp_path, ignore_errors=True)
