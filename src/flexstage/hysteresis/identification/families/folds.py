"""Whole cycles, divided into parts that are held out in turn."""

import numpy as np
from numpy.typing import NDArray

from flexstage.hysteresis.identification.families.family import Data

#: Parts that the cycles are divided into, each held out once.
_FOLDS = 5
#: Runs of neighbouring cycles in each part.
_RUNS = 2


def folds_of(
    data: Data, count: int = _FOLDS, runs: int = _RUNS
) -> list[tuple[NDArray[np.bool_], ...]]:
    """Divide the cycles of all sections into parts of about as many samples.

    With two runs of neighbours in each part, far from one another, drift is not extrapolated, and
    slow cycles and fast ones are in every part of a record of both. With one run a part that goes
    further than the others asks a model to extrapolate. Rows before the first and after the last
    cycle belong to its neighbour; there are fewer parts than `count` where there are fewer cycles.
    """
    section, cycle, size = [], [], []
    for k, (r, use) in enumerate(zip(data.rows, data.use, strict=True)):
        found, rows = np.unique(r.cycle[use], return_counts=True)
        section += [k] * found.size
        cycle += found.tolist()
        size += rows.tolist()
    parts = min(count, len(cycle))
    if parts == 0:
        return []
    blocks = min(runs * parts, len(cycle))
    middle = np.cumsum(size) - 0.5 * np.array(size)
    block = np.minimum((middle / np.sum(size) * blocks).astype(int), blocks - 1)
    # long cycles leave blocks empty: those that are not are numbered anew
    part = np.unique(block, return_inverse=True)[1] % parts
    held = {(k, c): p for k, c, p in zip(section, cycle, part.tolist(), strict=True)}
    return [
        tuple(
            np.isin(r.cycle, [c for (s, c), q in held.items() if s == k and q == p]) & use
            for k, (r, use) in enumerate(zip(data.rows, data.use, strict=True))
        )
        for p in range(int(part.max()) + 1)
    ]
