"""Streams for the tests of recording: their samples by formula, and disks that fail."""

import errno
import io
from pathlib import Path

import numpy as np

from flexstage.instruments.protocol import Identity
from flexstage.instruments.recording.metadata import RunMetadata
from flexstage.instruments.recording.writer import RunWriter

CHANNELS = (("x", "m"), ("drive", "V"), ("roll of x (guide)", "rad"), ("ratio [raw]", ""))
RATE = 7812.5


def metadata(**changes):
    words = {
        "stage": "vgtu-piezo",
        "stage_hash": "ab" * 32,
        "serial_number": "A-0042",
        "design": "vgtu-piezo",
        "instrument": Identity(
            vendor="Physik", model="E-7xx", serial_number="115", firmware="2.1", simulated=True
        ),
        "settings": {"servo x": "on", "P": "0.03"},
        "kind": "motion",
        "axis": "x",
        "plan": "chapter 3",
        "step": "stroke",
        "operator": "Ona Š.",
        "note": "after lunch; µm; a zero \0 and half a letter \ud800",
        "seed": 2**70 + 1,
    }
    return RunMetadata(**{**words, **changes})


def truth(first, count):
    """Return the samples of all channels: a function of their number, so that none is alike."""
    n = np.arange(first, first + count, dtype=float)
    columns = (1e-6 * np.sin(0.01 * n) + 1e-9 * n, 60.0 - 0.125 * n, 1e-7 * n**1.5, 1.0 / (n + 1.0))
    return {name: v for (name, _), v in zip(CHANNELS, columns, strict=True)}


def writer(path, **options):
    return RunWriter(path, CHANNELS, RATE, options.pop("metadata", metadata()), **options)


def written(path, chunks, *, first=0, leave=True, **options):
    """Write chunks of these sizes; return the stream and the position at which each begins."""
    run = writer(path, sync=None, **options)
    positions = [path.stat().st_size]
    for count in chunks:
        run.append(first, truth(first, count))
        first += count
        positions.append(path.stat().st_size)
    if leave:
        run.leave()
    return run, positions


def assert_true(record, numbers=None):
    """Compare every sample of a record with the truth at its number, bit by bit."""
    found = np.round(record.time * RATE).astype(int)
    if numbers is not None:
        assert found.tolist() == list(numbers)
    assert np.array_equal(record.time, found / RATE)
    for start in range(0, found.size, 100_000):
        part = slice(start, start + 100_000)
        wanted = truth(0, int(found.max()) + 1)
        for name, unit in CHANNELS:
            assert record.channel(name).unit == unit
            assert (
                record.channel(name).values[part].tobytes() == wanted[name][found[part]].tobytes()
            )


class RunFolder:
    """A folder of a run, with its records."""

    def __init__(self, path):
        self.path = path
        (path / "records").mkdir(parents=True)

    def stream(self, name):
        return self.path / "records" / f"{name}.stream"

    def records(self):
        return self._files(".h5")

    def streams(self):
        return self._files(".stream")

    def _files(self, suffix):
        # not above: writers that are killed import this module in processes of their own
        from flexstage.instruments.catalogue.catalogue import run_files

        return [p for p in run_files(self.path) if p.suffix == suffix]


class FullDisk(io.FileIO):
    """A file on a disk of limited size: it takes what there is room for, then it refuses."""

    room = None  # bytes; None for no limit
    syncs = None  # how many syncs succeed; None for all

    def write(self, data):
        if self.room is not None:
            left = self.room - self.tell()
            if left <= 0:
                raise OSError(errno.ENOSPC, "No space left on device")
            data = data[:left]
        return super().write(data)

    def fileno(self):
        # asked for at each sync, and at the mark that the file is in use
        if self.syncs is not None:
            self.syncs -= 1
            if self.syncs < 0:
                raise OSError(errno.EIO, "Input/output error")
        return super().fileno()


def small_disk(room):
    """Return an opener, and the list of the files that it opened."""
    opened = []

    def opener(path: Path):
        file = FullDisk(path, "xb")
        file.room = room
        opened.append(file)
        return file

    return opener, opened
