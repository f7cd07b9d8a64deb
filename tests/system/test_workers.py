"""Batches on worker processes of this machine."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import psutil
import pytest

from flexstage.base.errors import StageError, WorkerError
from flexstage.base.progress import listen
from flexstage.studies.explore import Job, open_workers
from flexstage.studies.explore import workers as workers_module
from tests import spread_work


@pytest.fixture(autouse=True)
def shared_at_once(monkeypatch):
    """Jobs of some milliseconds are shared, as long ones are."""
    monkeypatch.setattr(workers_module, "_FIRST_ESTIMATE", 0.0)
    monkeypatch.setattr(workers_module, "_WORTH_SHARING", 0.0)


def solutions(lasts):
    payload = {"seed": 5, "lasts": lasts}
    return Job(name="trial", work=spread_work.solutions, payload=payload, count=123, batch=6)


def same_as_at_once(found):
    expected = spread_work.solutions({"seed": 5}, 0, 123)
    assert list(found) == list(expected)
    return all(found[name].tobytes() == values.tobytes() for name, values in expected.items())


def processes(workers):
    """The processes of the workers, by their numbers."""
    return [worker.process.pid for worker in workers._others._workers]


def test_two_workers_give_the_bits_of_one_and_a_kill_changes_nothing():
    killed = []

    def kill_one(what, done):
        if done > 0.3 and not killed:
            killed.append(processes(workers)[1])
            os.kill(killed[0], signal.SIGKILL)

    with open_workers(2) as workers, listen(kill_one):
        assert same_as_at_once(workers.run(solutions(0.02)))
        assert killed
        assert killed[0] not in processes(workers)


def test_no_process_listens_at_a_port():
    """Whoever reached one could have it run what they like."""
    listening, looks = set(), []

    def look(what, done):
        looks.append(done)
        for process in (psutil.Process(), *psutil.Process().children(recursive=True)):
            found = process.net_connections("inet")
            listening.update(c.laddr for c in found if c.status == psutil.CONN_LISTEN)

    look("before", 0.0)
    before = {*listening}  # servers that other tests of this process have not ended yet
    with open_workers(2) as workers:
        with listen(look):
            assert same_as_at_once(workers.run(solutions(0.0)))
        assert len(processes(workers)) == 2
    assert len(looks) > 2
    assert listening == before


@pytest.mark.slow
def test_one_two_and_four_workers_give_the_same_bits():
    for count in (1, 2, 4):
        with open_workers(count) as workers:
            assert same_as_at_once(workers.run(solutions(0.01)))
            assert count == 1 or len(processes(workers)) == count
            # the processes are there for the next job, and more where it needs them
            assert same_as_at_once(workers.run(solutions(0.0)))


@pytest.mark.slow
def test_a_batch_that_kills_its_worker_is_redone_and_named_where_it_always_does(tmp_path):
    payload = {"lasts": 0.05, "sample": 33}
    job = Job(name="trial", work=spread_work.deadly, payload=payload, count=60, batch=5)
    with open_workers(2) as workers:
        with pytest.raises(
            WorkerError, match=r"batch 6 of trial \(samples 30 to 34\).* are stored"
        ):
            workers.run(job, tmp_path / "kept")
        assert 0 < len(list((tmp_path / "kept").glob("batch-*.npz"))) < 12
        assert not (tmp_path / "kept" / "batch-000006.npz").exists()
        once = Job(
            name="trial", work=spread_work.deadly, count=60, batch=5,
            payload={**payload, "once": str(tmp_path / "once")},
        )  # fmt: skip
        assert np.array_equal(workers.run(once)["sample"], np.arange(60))
        assert (tmp_path / "once").exists()


@pytest.mark.slow
def test_an_error_of_the_work_is_its_sentence_and_ends_all_processes():
    payload = {"lasts": 0.01, "sample": 33}
    job = Job(name="trial", work=spread_work.refused, payload=payload, count=60, batch=5)
    before = set(psutil.Process().children())
    with pytest.raises(StageError, match="'h3' is thicker"), open_workers(2) as workers:
        workers.run(job)
    # what remains is the tracker of shared memory, one for the life of this process
    left = set(psutil.Process().children()) - before
    assert not [child for child in left if "spawn_main" in " ".join(child.cmdline())]


@pytest.mark.slow
def test_ctrl_c_ends_all_processes_at_once_and_keeps_what_is_finished(tmp_path):
    keep = tmp_path / "kept"
    process = subprocess.Popen(
        [sys.executable, "-W", "error", "-c", PROGRAM.format(keep=str(keep), guard="True")],
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, start_new_session=True,
        env=environment(),
    )  # fmt: skip
    deadline = time.monotonic() + 300.0
    while len(list(keep.glob("batch-*.npz"))) < 4 and time.monotonic() < deadline:
        time.sleep(0.05)
    workers = psutil.Process(process.pid).children(recursive=True)
    assert len(workers) >= 2
    os.killpg(process.pid, signal.SIGINT)
    _, said = process.communicate(timeout=30.0)
    assert "KeyboardInterrupt" in said.splitlines()[-1], said
    assert "distributed" not in said.splitlines()[0]
    _, alive = psutil.wait_procs(workers, timeout=30.0)
    assert not [child for child in alive if child.status() != psutil.STATUS_ZOMBIE]
    assert 4 <= len(list(keep.glob("batch-*.npz"))) < 60


@pytest.mark.slow
def test_a_program_that_its_workers_would_run_again_is_a_sentence(tmp_path):
    program = tmp_path / "unguarded.py"
    program.write_text(PROGRAM.format(keep=str(tmp_path / "kept"), guard="True"), "utf-8")
    done = subprocess.run(
        [sys.executable, program], capture_output=True, text=True, timeout=300.0, check=False,
        env=environment(),
    )  # fmt: skip
    assert done.returncode == 1
    assert "the worker processes do not start" in done.stderr.splitlines()[-1]
    program.write_text(
        PROGRAM.format(keep=str(tmp_path / "other"), guard='__name__ == "__main__"').replace(
            '"lasts": 0.5', '"lasts": 0.0'
        ),
        "utf-8",
    )
    done = subprocess.run(
        [sys.executable, "-W", "error", program], capture_output=True, text=True, timeout=300.0,
        check=False, env=environment(),
    )  # fmt: skip
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout == "360\n"


@pytest.mark.slow
@pytest.mark.skipif(sys.platform == "win32", reason="there is no such signal")
def test_a_worker_that_ends_does_not_end_a_process_whose_library_restored_broken_pipes():
    done = subprocess.run(
        [sys.executable, "-c", BROKEN_PIPE], capture_output=True, text=True, timeout=300.0,
        check=False, env=environment(),
    )  # fmt: skip
    assert (done.returncode, done.stdout) == (0, "60\n"), done.stderr


BROKEN_PIPE = """
import ctypes, signal
from flexstage.base.errors import WorkerError
from flexstage.studies.explore import Job, open_workers, workers
from tests import spread_work
workers._FIRST_ESTIMATE = workers._WORTH_SHARING = 0.0
# as Gmsh does, without a word to Python
libc = ctypes.CDLL(None)
libc.signal.argtypes = (ctypes.c_int, ctypes.c_void_p)
libc.signal(int(signal.SIGPIPE), None)
if __name__ == "__main__":
    def job(work, sample):
        return Job(name="trial", work=work, payload={"lasts": 0.01, "sample": sample}, count=60,
                   batch=5)
    with open_workers(2) as shared:
        try:
            shared.run(job(spread_work.deadly, 33))
        except WorkerError:
            print(len(shared.run(job(spread_work.deadly, 99))["sample"]))
"""


PROGRAM = """
from pathlib import Path
from flexstage.studies.explore import Job, open_workers, workers
from tests import spread_work
workers._FIRST_ESTIMATE = workers._WORTH_SHARING = 0.0
if {guard}:
    job = Job(name="trial", work=spread_work.solutions, payload={{"seed": 2, "lasts": 0.5}},
              count=360, batch=6)
    with open_workers(2) as shared:
        print(len(shared.run(job, Path({keep!r}))["energy"]))
"""


def environment():
    """Where a program finds the package and what tests share."""
    root = str(Path(__file__).parents[2])
    return {**os.environ, "PYTHONPATH": os.pathsep.join([f"{root}/src", root])}
