"""How many threads finite elements take: as many as there are cores that nothing else uses."""

import os
import subprocess
import sys
import time

import ngsolve as ng
import pytest

from flexstage.elasticity import resources


def set_machine(
    patch: pytest.MonkeyPatch, *, cores: int, idle: float, own: float, quota: str = "max 100000"
) -> None:
    """A machine whose cores idle, and that we use, by so many cores together from now on."""
    began = time.monotonic()

    def now() -> tuple[float, float, float]:
        passed = time.monotonic() - began
        return passed + began, own * passed, idle * passed

    patch.setattr(resources, "_now", now)
    patch.setattr(resources, "_cores", lambda: set(range(cores)))
    patch.setattr(resources, "_read", lambda path: quota if path.endswith("cpu.max") else "")
    patch.setattr(resources, "_WATCHED", 0.02)
    patch.setattr(resources, "_watch", resources._Watch())


@pytest.mark.parametrize(
    ("cores", "idle", "own", "quota", "expected"),
    [
        (4, 2.9, 1.0, "max 100000", 4),  # a tenth of a core goes to others
        (4, 1.4, 1.0, "max 100000", 2),
        (4, 0.0, 0.5, "max 100000", 1),  # all are busy, we have half a core
        (4, 0.0, 3.2, "max 100000", 3),
        (16, 15.0, 1.0, "250000 100000", 2),  # a container that may use two and a half
        (3, float("nan"), 1.0, "max 100000", 3),  # a system that does not tell
    ],
)
def test_cores_that_others_use_are_left_to_them(
    monkeypatch: pytest.MonkeyPatch,
    cores: int,
    idle: float,
    own: float,
    quota: str,
    expected: int,
) -> None:
    set_machine(monkeypatch, cores=cores, idle=idle, own=own, quota=quota)
    assert resources.free_cores() == expected


def test_what_was_counted_is_kept_for_a_while(monkeypatch: pytest.MonkeyPatch) -> None:
    set_machine(monkeypatch, cores=4, idle=4.0, own=0.0)
    assert resources.free_cores() == 4
    monkeypatch.setattr(resources, "_cores", lambda: {0})
    assert resources.free_cores() == 4
    monkeypatch.setattr(resources, "_VALID", 0.0)
    assert resources.free_cores() == 1


def test_the_use_of_the_cores_is_read_from_the_system(monkeypatch: pytest.MonkeyPatch) -> None:
    # user, nice, system, idle, iowait, ...; the core that we may not run on does not count
    stat = "cpu  9 9 9 9 9\ncpu0 1 2 3 70 5 6\ncpu1 1 2 3 1000 5 6\ncpu3 4 4 4 20 5 6\nintr 1 2 3 4"
    monkeypatch.setattr(resources, "_read", lambda path: stat)
    monkeypatch.setattr(resources, "_cores", lambda: {0, 3})
    assert resources._idle() == pytest.approx(100.0 * resources._TICK)


def test_a_limit_holds_and_blocks_within_take_the_threads_of_the_outer_one(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    set_machine(monkeypatch, cores=3, idle=3.0, own=0.0)
    monkeypatch.delenv("NGS_NUM_THREADS")
    with resources.parallel():
        assert ng.GetNumThreads() == 3
        with resources.parallel(1):
            assert ng.GetNumThreads() == 3
    with resources.parallel(2):
        assert ng.GetNumThreads() == 2
    monkeypatch.setenv("NGS_NUM_THREADS", "1")
    with resources.parallel():
        assert ng.GetNumThreads() == 1
    assert ng.GetNumThreads() == 1


@pytest.mark.alone
@pytest.mark.slow
@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="counts the cores' use on Linux")
def test_on_busy_cores_there_is_one_thread(monkeypatch: pytest.MonkeyPatch) -> None:
    busy = [
        subprocess.Popen([sys.executable, "-c", "while True: pass"])
        for _ in range(2 * (os.cpu_count() or 1))
    ]
    try:
        time.sleep(0.5)
        monkeypatch.setattr(resources, "_watch", resources._Watch())
        assert resources.free_cores() == 1
    finally:
        for process in busy:
            process.kill()
            process.wait()
