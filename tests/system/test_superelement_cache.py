"""The cache on disk: never trusts a damaged file, survives death at any moment, does without."""

import logging
import os
import random
import signal
import subprocess
import sys
import textwrap
import time
from pathlib import Path

import numpy as np
import pytest

from flexstage.fem import condensed_bodies
from flexstage.fem.condensation import condense
from flexstage.fem.mesh import MeshSettings
from flexstage.fem.superelement import SuperelementModel, superelement_model
from flexstage.files.cache import Cache, open_cache
from flexstage.files.cache import cache as cache_module
from flexstage.files.names import user_folder
from flexstage.system import modes
from tests.hinged_bars import hinged_bars

COARSE = MeshSettings(order=2, neck_size=1.5)
KEY, OTHER = "a5" * 32, "3c" * 32
ENTRY = {
    "numbers": np.arange(1.0, 300.0).reshape(13, 23) / 7.0,
    "none": np.zeros((0, 4)),
    "one": np.asarray(17),
    "text": np.frombuffer(b"held at its holes", dtype=np.uint8),
}


def same(found: object) -> bool:
    return (
        isinstance(found, dict)
        and list(found) == list(ENTRY)
        and all(np.array_equal(found[k], v) and found[k].shape == v.shape for k, v in ENTRY.items())
    )


def fresh(directory: Path, **options: int) -> Cache:
    """A cache that remembers nothing, so that it has to read."""
    return Cache(directory, memory=0, **options)


def file_of(directory: Path) -> Path:
    (path,) = directory.glob("*.arrays")
    return path


def test_arrays_return_as_they_were(tmp_path: Path) -> None:
    assert fresh(tmp_path / "new").load(KEY) is None
    fresh(tmp_path / "new").store(KEY, ENTRY)
    found = fresh(tmp_path / "new").load(KEY)
    assert same(found)
    assert found is not None
    assert not found["numbers"].flags.writeable
    assert fresh(tmp_path / "new").load(OTHER) is None
    assert [p.suffix for p in (tmp_path / "new").iterdir()] == [".arrays"]


def test_a_flipped_bit_anywhere_is_seen(tmp_path: Path) -> None:
    fresh(tmp_path).store(KEY, ENTRY)
    path = file_of(tmp_path)
    good = path.read_bytes()
    # every byte of the mark, checksum, key, length and header, and some of the numbers
    places = [*range(340), *range(340, len(good), 97), len(good) - 1]
    for i, place in enumerate(places):
        bad = bytearray(good)
        bad[place] ^= 1 << (i % 8)
        path.write_bytes(bad)
        assert fresh(tmp_path).load(KEY) is None, place
    path.write_bytes(good)
    assert same(fresh(tmp_path).load(KEY))


def test_truncated_and_foreign_files_are_seen(tmp_path: Path) -> None:
    fresh(tmp_path).store(KEY, ENTRY)
    path = file_of(tmp_path)
    good = path.read_bytes()
    foreign = (b"", b"\x80\x04\x95", b"PK\x03\x04 another format", good + b"\0", good[:18] * 9)
    for bad in (*(good[:n] for n in (1, 17, 18, 49, 50, 81, 90, 200, len(good) - 1)), *foreign):
        path.write_bytes(bad)
        assert fresh(tmp_path).load(KEY) is None
    # a whole file of another key under this name
    fresh(tmp_path / "b").store(OTHER, ENTRY)
    path.write_bytes(file_of(tmp_path / "b").read_bytes())
    assert fresh(tmp_path).load(KEY) is None
    path.unlink()
    path.mkdir()  # not even a file
    assert fresh(tmp_path).load(KEY) is None


def test_a_damaged_body_is_built_again(tmp_path: Path) -> None:
    stage = hinged_bars()
    first = superelement_model(stage, COARSE, cache=fresh(tmp_path))
    assert first.newly_condensed == ("block", "lying", "standing")
    path = sorted(tmp_path.glob("*.arrays"))[1]
    for damage in ("flipped", "short", "empty"):
        data = bytearray(path.read_bytes())
        if damage == "flipped":
            data[len(data) // 2] ^= 0x10
        path.write_bytes({"flipped": bytes(data), "short": data[:-7], "empty": b""}[damage])
        again = superelement_model(stage, COARSE, cache=fresh(tmp_path))
        assert len(again.newly_condensed) == 1, damage
        assert superelement_model(stage, COARSE, cache=fresh(tmp_path)).newly_condensed == ()
        np.testing.assert_array_equal(again.system.K, first.system.K)


def test_only_changed_bodies_are_built_and_copies_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from flexstage.stage.designs import design

    calls = []
    monkeypatch.setattr(
        condensed_bodies, "condense", lambda part: calls.append(part) or condense(part)
    )
    stage = design("parallelogram")
    model = superelement_model(stage, COARSE, cache=tmp_path)
    # the two legs are copies
    assert len(calls) == len(stage.bodies) - 1 == 3
    warm = superelement_model(stage, COARSE, cache=tmp_path)
    assert (len(calls), warm.newly_condensed) == (3, ())
    np.testing.assert_array_equal(warm.system.K, model.system.K)
    assert warm.system.stress is not None
    assert model.system.stress is not None
    q = np.ones(len(model.system.K))
    np.testing.assert_array_equal(
        warm.system.stress.components(q), model.system.stress.components(q)
    )
    assert superelement_model(stage, COARSE, cache=False).newly_condensed == model.newly_condensed
    assert len(calls) == 6


def test_the_first_figures_and_those_from_disk_are_the_same(tmp_path: Path) -> None:
    stage = hinged_bars()
    built = superelement_model(stage, COARSE, cache=fresh(tmp_path))
    read = superelement_model(stage, COARSE, cache=fresh(tmp_path))
    assert (built.newly_condensed, read.newly_condensed) == (("block", "lying", "standing"), ())

    def everything(model: SuperelementModel) -> list[np.ndarray]:
        s = model.system
        assert s.stress is not None
        assert s.stress.point is not None
        stress = s.stress.components(np.ones(len(s.K)))
        return [s.M, s.K, stress, s.stress.point, *(p.vector for p in s.probes)]

    for a, b in zip(everything(built), everything(read), strict=True):
        np.testing.assert_array_equal(a, b)
    assert dict(built.system.settings) == dict(read.system.settings)
    assert built.system.validity == read.system.validity


# ---------------------------------------------------------------------- death and company

WRITER = textwrap.dedent(
    """
    import importlib.util, sys, time
    from pathlib import Path
    import numpy as np

    # the module alone: the package would take a second to import
    spec = importlib.util.spec_from_file_location("cache", sys.argv[3])
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    Cache = module.Cache

    class Slow(Cache):
        @staticmethod
        def _write(write, data):
            for start in range(0, len(data), 400):  # a write that takes its time
                write(data[start : start + 400])
                time.sleep(0.0004)

    cache = (Slow if sys.argv[2] == "slow" else Cache)(Path(sys.argv[1]), memory=0)
    print("ready", flush=True)
    k = 0
    while True:
        key = f"{k % 5:064x}"
        found = cache.load(key)
        if found is not None and not np.all(found["a"] == found["a"].flat[0]):
            print("torn", flush=True)
        cache.store(key, {"a": np.full((40, 31), float(k))})
        k += 1
    """
)


def writer(directory: Path, pace: str = "fast") -> subprocess.Popen[str]:
    process = subprocess.Popen(
        [sys.executable, "-c", WRITER, str(directory), pace, cache_module.__file__],
        stdout=subprocess.PIPE,
        text=True,
    )
    assert process.stdout is not None
    assert process.stdout.readline() == "ready\n"
    return process


def check_whole(directory: Path) -> int:
    """Every file under a key is whole, or at worst absent."""
    names = sorted(directory.glob("*.arrays"))
    for path in names:
        found = fresh(directory).load(path.stem)
        assert found is not None, path
        assert np.all(found["a"] == found["a"].flat[0])
    return len(names)


@pytest.mark.skipif(os.name != "posix", reason="kill -9 is of POSIX")
@pytest.mark.parametrize("pace", ["fast", "slow"])
def test_death_at_any_moment_leaves_whole_files(tmp_path: Path, pace: str) -> None:
    moments = random.Random(8)
    interrupted = 0
    for _ in range(6):
        process = writer(tmp_path, pace)
        time.sleep(moments.uniform(0.02, 0.15))
        process.kill()
        assert process.wait() == -signal.SIGKILL
        assert process.stdout is not None
        assert "torn" not in process.stdout.read()
        process.stdout.close()
        interrupted = len(list(tmp_path.glob("*.part")))
        check_whole(tmp_path)
    # a slow writer spends nearly all its time in the middle of a file
    assert pace == "fast" or interrupted >= 2
    assert check_whole(tmp_path) > 0 or pace == "slow"
    cache = fresh(tmp_path)
    cache.store(KEY, ENTRY)
    cache.trim()
    assert len(list(tmp_path.glob("*.part"))) == interrupted  # another process may be writing them
    for left in tmp_path.glob("*.part"):
        os.utime(left, (1e9, 1e9))
    cache.store(KEY, ENTRY)
    cache.trim()
    assert not list(tmp_path.glob("*.part"))
    assert same(fresh(tmp_path).load(KEY))


@pytest.mark.skipif(os.name != "posix", reason="kill -9 is of POSIX")
def test_two_processes_at_once(tmp_path: Path) -> None:
    pair = [writer(tmp_path), writer(tmp_path, "slow")]
    reader = fresh(tmp_path)
    seen = set()
    begin = time.monotonic()
    while (waited := time.monotonic() - begin) < 0.8 or (len(seen) <= 3 and waited < 300.0):
        found = reader.load(f"{len(seen) % 5:064x}")
        if found is not None:
            assert np.all(found["a"] == found["a"].flat[0])
            seen.add(float(found["a"].flat[0]))
    for process in pair:
        process.kill()
        process.wait()
        assert process.stdout is not None
        assert "torn" not in process.stdout.read()
        process.stdout.close()
    assert len(seen) > 3
    assert check_whole(tmp_path) == 5


# ---------------------------------------------------------------------- room


def test_the_oldest_give_way(tmp_path: Path) -> None:
    cache = fresh(tmp_path, limit=60_000)
    entry = {"a": np.zeros(1000)}  # 8 kB and a little
    for k in range(9):
        cache.store(f"{k:064x}", entry)
        os.utime(cache.directory / f"{k:064x}.arrays", (1e9 + k, 1e9 + k))
    assert cache.load(f"{0:064x}") is not None  # read just now, so it is not the oldest
    cache.trim()
    left = sorted(int(p.stem, 16) for p in tmp_path.glob("*.arrays"))
    assert left == [0, 5, 6, 7, 8]  # 80 % of the limit holds five
    (tmp_path / "notes.txt").write_text("not ours")
    cache.store(KEY, {"a": np.zeros(9000)})
    cache.trim()
    assert (tmp_path / "notes.txt").read_text() == "not ours"


def test_a_cache_that_was_only_read_takes_nothing_away(tmp_path: Path) -> None:
    fresh(tmp_path).store(KEY, {"a": np.zeros(1000)})
    small = fresh(tmp_path, limit=100)
    assert small.load(KEY) is not None
    small.trim()
    assert fresh(tmp_path).load(KEY) is not None
    # what it writes itself counts
    small.store("1" * 64, {"a": np.zeros(1000)})
    small.trim()
    assert not list(tmp_path.glob("*.arrays"))


def test_memory_is_bounded_and_saves_reading(tmp_path: Path) -> None:
    cache = Cache(tmp_path, memory=20_000)
    for k in range(3):
        cache.store(f"{k:064x}", {"a": np.full(1000, k)})
    for path in tmp_path.glob("*.arrays"):
        path.unlink()
    assert cache.load(f"{0:064x}") is None
    assert cache.load(f"{2:064x}") is not None
    assert cache.load(f"{1:064x}") is not None
    cache.store(KEY, {"a": np.full(9000, 1.0)})  # larger than all of the memory
    assert cache.load(f"{1:064x}") is not None


# ---------------------------------------------------------------------- no cache


def _full(*_: object) -> None:
    raise OSError(28, "No space left on device")


@pytest.mark.parametrize("trouble", ["a file in its place", "full"])
def test_a_stage_is_analysed_without_a_cache(
    tmp_path: Path,
    trouble: str,
    monkeypatch: pytest.MonkeyPatch,
    caplog: pytest.LogCaptureFixture,
) -> None:
    directory = tmp_path / "cache"
    # a tool of the tests, run in this process before, turns off all loggers that it finds
    monkeypatch.setattr(logging.getLogger("flexstage.files.cache.cache"), "disabled", False)
    if trouble == "full":
        monkeypatch.setattr(Cache, "_write", staticmethod(_full))
    else:
        directory.write_text("in the way")
    with caplog.at_level(logging.WARNING):
        model = superelement_model(hinged_bars(), COARSE, cache=fresh(directory))
    assert modes(model.system, count=1).frequency_hz[0] > 100.0
    assert len(model.newly_condensed) == 3
    # said once, not for each body
    (said,) = (r.getMessage() for r in caplog.records)
    assert "cannot be written" in said
    assert not list(tmp_path.glob("**/*.part"))
    assert not list(tmp_path.glob("**/*.arrays"))


@pytest.mark.skipif(not hasattr(os, "geteuid") or os.geteuid() == 0, reason="root writes anywhere")
def test_a_directory_that_is_only_read(tmp_path: Path) -> None:
    superelement_model(hinged_bars(), COARSE, cache=fresh(tmp_path))
    tmp_path.chmod(0o500)
    try:
        assert (
            superelement_model(hinged_bars(), COARSE, cache=fresh(tmp_path)).newly_condensed == ()
        )
        other = superelement_model(hinged_bars(), COARSE, modes=1, cache=fresh(tmp_path))
        assert len(other.newly_condensed) == 3
    finally:
        tmp_path.chmod(0o700)


# ---------------------------------------------------------------------- where it is


@pytest.mark.parametrize(
    ("variables", "expected"),
    [
        ({"FLEXSTAGE_CACHE": "/a/b", "XDG_CACHE_HOME": "/c"}, Path("/a/b")),
        ({"XDG_CACHE_HOME": "/c"}, Path("/c/flexstage")),
    ],
)
def test_where_the_cache_is(
    variables: dict[str, str], expected: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("FLEXSTAGE_CACHE", "XDG_CACHE_HOME"):
        monkeypatch.delenv(name, raising=False)
    for name, value in variables.items():
        monkeypatch.setenv(name, value)
    assert user_folder("cache") == expected


def test_the_default_is_the_users_cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("FLEXSTAGE_CACHE", str(tmp_path))
    superelement_model(hinged_bars(), COARSE)
    assert len(list((tmp_path / "computed").glob("*.arrays"))) == 3
    assert open_cache(False) is None
    assert open_cache(None) is None
    cache = open_cache(tmp_path)
    assert cache is not None
    assert open_cache(str(tmp_path)) is cache
    assert open_cache(cache) is cache
