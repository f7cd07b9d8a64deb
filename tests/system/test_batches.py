"""Batches in this process: ranges, what is kept and found again, what is refused."""

import functools
import json
import os
import subprocess
import sys

import numpy as np
import pytest

from flexstage.base.errors import ModelError, RecordError, StageError, WorkerError
from flexstage.base.progress import listen
from flexstage.stage.designs import design
from flexstage.studies.explore import Job, batch_size, open_workers
from flexstage.studies.explore import workers as workers_module
from flexstage.studies.explore.batches import StoredBatches
from tests import spread_work

JOB = functools.partial(
    Job, name="trial", work=spread_work.solutions, payload={"seed": 11}, count=47, batch=9
)


def same(one, other):
    """Whether results are equal to the last bit, in names, types and order."""
    assert list(one) == list(other)
    return all(one[name].tobytes() == other[name].tobytes() for name in one)


def alone(job, keep=None):
    with open_workers(1) as workers:
        return workers.run(job, keep)


@pytest.fixture
def counted(monkeypatch):
    """The batches that were computed, in their order."""
    numbers = []
    compute = Job.compute
    monkeypatch.setattr(Job, "compute", lambda job, n: (numbers.append(n), compute(job, n))[1])
    return numbers


def test_batches_of_one_process_are_the_work_at_once():
    found = alone(JOB())
    whole = spread_work.solutions({"seed": 11}, 0, 47)
    assert same(found, whole)
    assert found["moved"].shape == (47, 7)


def test_kept_batches_are_not_computed_again(tmp_path, counted):
    keep = tmp_path / "kept"
    first = alone(JOB(), keep)
    assert counted == [0, 1, 2, 3, 4, 5]
    assert same(alone(JOB(), keep), first)
    assert len(counted) == 6


def test_a_run_that_was_interrupted_goes_on(tmp_path, monkeypatch, counted):
    solutions = spread_work.solutions

    def interrupted(payload, start, stop):
        if start >= 27:
            raise KeyboardInterrupt
        return solutions(payload, start, stop)

    interrupted.__module__, interrupted.__qualname__ = solutions.__module__, "solutions"
    with pytest.raises(KeyboardInterrupt):
        alone(JOB(work=interrupted), tmp_path)
    assert len(list(tmp_path.glob("batch-*.npz"))) == 3
    counted.clear()
    assert same(alone(JOB(), tmp_path), solutions({"seed": 11}, 0, 47))
    assert counted == [3, 4, 5]


def half(content):
    return content[: len(content) // 2]


def one_bit_off(content):
    middle = content.index(b"moved.npy") + 400
    return content[:middle] + bytes([content[middle] ^ 4]) + content[middle + 1 :]


@pytest.mark.parametrize("damage", [half, one_bit_off, lambda content: b""])
def test_a_damaged_batch_is_computed_again(tmp_path, counted, damage):
    first = alone(JOB(), tmp_path)
    counted.clear()
    file = tmp_path / "batch-000002.npz"
    file.write_bytes(damage(file.read_bytes()))
    assert same(alone(JOB(), tmp_path), first)
    assert counted == [2]


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"name": "sweep"}, "another kind of job"),
        ({"count": 48}, "another number of samples"),
        ({"batch": 8}, "batches of another size"),
        ({"payload": {"seed": 12}}, "another stage or other settings"),
        ({"work": spread_work.refused}, "another stage or other settings"),
    ],
)
def test_the_folder_of_another_job_is_refused(tmp_path, change, said):
    alone(JOB(), tmp_path)
    with pytest.raises(RecordError, match=f"({said}).*name another folder, or remove"):
        alone(JOB(**change), tmp_path)


def test_the_folder_of_another_version_is_refused(tmp_path):
    alone(JOB(), tmp_path)
    head = json.loads((tmp_path / "job.json").read_text())
    head["versions"]["numpy"] = "1.0"
    (tmp_path / "job.json").write_text(json.dumps(head))
    with pytest.raises(RecordError, match="another version of flexstage, Python, NumPy or SciPy"):
        alone(JOB(), tmp_path)


@pytest.mark.parametrize("head", ["", "{", "[]", '{"name": "trial"}'])
def test_a_head_that_says_nothing_is_refused(tmp_path, head):
    (tmp_path / "job.json").write_text(head)
    with pytest.raises(RecordError, match="does not identify the job"):
        alone(JOB(), tmp_path)


def test_batches_without_a_head_are_refused(tmp_path):
    alone(JOB(), tmp_path)
    (tmp_path / "job.json").unlink()
    with pytest.raises(RecordError, match=r"has batches, but no job\.json"):
        alone(JOB(), tmp_path)


def test_a_stage_is_recognised_by_another_process(tmp_path):
    """The order of a set and which texts are shared differ between processes; the hash must not."""
    program = (
        "from pathlib import Path\n"
        "from tests.system.test_batches import stage_job\n"
        "from flexstage.studies.explore.batches import StoredBatches\n"
        f"StoredBatches(Path({str(tmp_path)!r}), stage_job())\n"
    )
    subprocess.run(
        [sys.executable, "-c", program], check=True, env={**os.environ, "PYTHONHASHSEED": "271"}
    )
    StoredBatches(tmp_path, stage_job())


def stage_job():
    return JOB(payload={"seed": 11, "stage": design("vgtu-piezo")})


def test_an_error_of_the_work_is_its_sentence():
    job = JOB(work=spread_work.refused, payload={"lasts": 0.0, "sample": 20})
    with pytest.raises(StageError, match="'h3' is thicker"):
        alone(job)


@pytest.mark.parametrize(
    "wrong", [lambda *_: {"x": np.zeros(3)}, lambda *_: {"x": np.float64(2.0)}]
)
def test_work_that_leaves_samples_out_is_refused(wrong):
    with pytest.raises(ModelError, match="a row for each of the 9 samples"):
        alone(JOB(work=wrong))


@pytest.mark.parametrize("sizes", [{"count": 0}, {"batch": 0}])
def test_a_job_has_samples(sizes):
    with pytest.raises(ModelError, match="at least one sample"):
        JOB(**sizes)


def test_what_cannot_be_pickled_is_refused(tmp_path):
    with pytest.raises(ModelError, match="must be picklable"):
        alone(JOB(payload=lambda: 0), tmp_path)


def test_workers_are_a_number_or_a_cluster():
    with pytest.raises(ModelError, match="must be 1 or more, got 0"), open_workers(0):
        pass
    with pytest.raises(ModelError, match="not both"), open_workers(2, "tcp://127.0.0.1:1"):
        pass


def test_a_cluster_alone_needs_the_extra(monkeypatch):
    monkeypatch.setitem(sys.modules, "distributed", None)
    with (
        pytest.raises(WorkerError, match=r'a cluster needs .* pip install "flexstage\[explore\]"'),
        open_workers(scheduler="tls://127.0.0.1:1"),
    ):
        pass
    monkeypatch.setattr(workers_module, "_FIRST_ESTIMATE", 0.0)
    monkeypatch.setattr(workers_module, "_WORTH_SHARING", 0.0)
    with open_workers(2) as workers:
        assert same(workers.run(JOB()), spread_work.solutions({"seed": 11}, 0, 47))


def test_progress_says_how_many_batches_and_how_long():
    said = []
    with listen(lambda what, done: said.append((what, round(done, 2)))):
        alone(JOB(payload={"seed": 11, "lasts": 0.01}))
    assert said[0] == ("trial, 0 of 6 batches", 0.0)
    assert said[4] == ("trial, 4 of 6 batches, 0 s left", 0.67)
    assert said[-1] == ("trial, 6 of 6 batches", 1.0)


def test_batches_are_sized_by_what_a_sample_costs():
    assert batch_size(10_000_000, 20e-6) == 50_000
    assert [batch_size(count, 0.25) for count in (1, 33, 1000)] == [1, 2, 4]
