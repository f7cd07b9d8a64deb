"""Many stages near one that is known, in space: what an optimiser by superelements asks for.

`OPENBLAS_NUM_THREADS=1 python -m benchmarks.many_stages [COUNT]` analyses the piezo stage COUNT
times (2000), with every neck up to a tenth thinner, in as many processes as there are cores.
"""

import os
import sys
import time
from concurrent.futures import ProcessPoolExecutor
from functools import lru_cache
from multiprocessing import get_context
from typing import Any

import numpy as np

from benchmarks.superelements import _with_necks

__all__ = ["many_stages"]


@lru_cache(maxsize=1)
def _known() -> tuple[Any, Any]:
    from flexstage.fem import superelement_model
    from flexstage.stage.designs import design

    stage = design("vgtu-piezo")
    return stage, superelement_model(stage, space=True)


def _one(seed: int) -> float:
    from flexstage.fem import superelement_model
    from flexstage.system import analyse

    stage, model = _known()
    times = np.random.default_rng(seed).uniform(0.9, 1.0, len(stage.hinges))
    other = _with_necks(stage, times.tolist())
    found = analyse(other, superelement_model(other, space=True, near=model).system)
    return float(found.modes["removed"].frequency_hz[0])


def many_stages(count: int) -> float:
    """Return the time that so many analyses take [s], once the bodies and blocks are known."""
    workers = os.cpu_count() or 1
    _known()
    # not forked: what has computed with threads leaves locks behind
    with ProcessPoolExecutor(workers, mp_context=get_context("spawn")) as pool:
        list(pool.map(_one, range(2 * workers)))
        began = time.perf_counter()
        list(pool.map(_one, range(count), chunksize=20))
        return time.perf_counter() - began


if __name__ == "__main__":
    asked = int(sys.argv[1]) if len(sys.argv) > 1 else 2000
    took = many_stages(asked)
    print(f"{asked} stages in {took:.1f} s, {1e3 * took / asked:.1f} ms each")
