"""Batches on worker processes of this machine."""

import os
import signal

import pytest

from flexstage.explore import Job, open_workers
from flexstage.explore import workers as workers_module
from flexstage.progress import listen
from tests import spread_work


@pytest.fixture(autouse=True)
def shared_at_once(monkeypatch):
    """Jobs of some milliseconds are shared, as long ones are."""
    monkeypatch.setattr(workers_module, "_TRIED", 0.0)
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
    return [nanny.pid for nanny in workers._cluster._local.workers.values()]


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
