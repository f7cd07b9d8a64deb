"""Work that tests share between processes: workers import it by name."""

import multiprocessing
import os
import signal
import time
from pathlib import Path
from typing import Any

import numpy as np

from flexstage.base.errors import StageError


def solutions(payload: dict[str, Any], start: int, stop: int) -> dict[str, np.ndarray]:
    """Solve for random forces, a stream for each sample, with what a sum in another order moves."""
    time.sleep(payload.get("lasts", 0.0))
    streams = [
        np.random.default_rng(np.random.SeedSequence(payload["seed"], spawn_key=(i,)))
        for i in range(start, stop)
    ]
    matrices = np.array([stream.normal(size=(7, 7)) for stream in streams])
    forces = np.array([stream.normal(size=(7, 1)) for stream in streams])
    return {
        "moved": np.linalg.solve(matrices, forces)[..., 0],
        "energy": np.einsum("si,sij,sj->s", forces[..., 0], matrices, forces[..., 0]),
        "fault": np.array(["odd" if i % 3 else "" for i in range(start, stop)]),
    }


def whose(payload: dict[str, Any], start: int, stop: int) -> dict[str, np.ndarray]:
    """Return the process that did the work."""
    time.sleep(payload["lasts"])
    return {"process": np.full(stop - start, os.getpid())}


def refused(payload: dict[str, Any], start: int, stop: int) -> dict[str, np.ndarray]:
    """Fail with a sentence in the batch that holds a sample."""
    time.sleep(payload["lasts"])
    if start <= payload["sample"] < stop:
        raise StageError("the neck of hinge 'h3' is thicker than its leg")
    return {"sample": np.arange(start, stop)}


def deadly(payload: dict[str, Any], start: int, stop: int) -> dict[str, np.ndarray]:
    """Kill the process of one batch, for ever, or only the first time where a file says so."""
    time.sleep(payload["lasts"])
    if start <= payload["sample"] < stop:
        once = payload.get("once")
        if once is None or not Path(once).exists():
            if once is not None:
                Path(once).touch()
            # never the process of the tests, which would end without a word
            assert multiprocessing.parent_process() is not None, "not in a worker"
            os.kill(os.getpid(), signal.SIGKILL)
    return {"sample": np.arange(start, stop)}
