"""How often the error that is printed beside a figure of superelements holds, on random stages.

``python -m tests.estimates_held plane 200 5`` draws 200 stages by the seed 5 and prints a table;
``space`` does so with those in space, on stages of few necks.
"""

import os
import sys
from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping
from concurrent.futures import ProcessPoolExecutor
from itertools import islice, repeat
from multiprocessing import get_context
from typing import NamedTuple
from unittest.mock import patch

import numpy as np

from flexstage.fem import MeshSettings, necks, plane_model, solid_model
from flexstage.stage import Stage
from flexstage.studies.models import run_model
from flexstage.studies.requests import ModelOptions
from flexstage.system import Analysis, MechanicalSystem, analyse
from tests.random_stages import random_stages

#: What is compared, by what it is called in the table.
COMPARED: Mapping[str, tuple[str, ...]] = {
    "transmission ratio": ("transmission_ratio",),
    "stroke": ("output_displacement", "rotation_stroke"),
    "input stiffness": ("input_stiffness",),
    "frequency of an axis": ("natural_frequency_hz",),
    "largest stress": ("max_stress",),
}
FREQUENCIES, COUNT = "six frequencies", 6
# places on an edge of an element where the reference looks for the largest stress
_DENSE = tuple(k / 8 for k in range(9))


class Comparison(NamedTuple):
    """One figure: both relative to the reference."""

    error: float
    estimate: float
    stage: str

    @property
    def ratio(self) -> float:
        """The error over its estimate; below 1 where the estimate holds."""
        return self.error / self.estimate if self.estimate else np.inf * bool(self.error)


def reference(stage: Stage, *, space: bool) -> MechanicalSystem:
    """Return the whole stage on one mesh, finer than that of its bodies."""
    with patch.object(necks, "ALONG", _DENSE):
        if space:
            return solid_model(stage, MeshSettings(order=5), modes=(8, 4)).system
        return plane_model(stage, MeshSettings(order=6, neck_size=0.4)).system


def compared(stage: Stage, *, space: bool) -> Iterator[tuple[str, Comparison]]:
    """Compare figures of superelements and their estimates with the reference."""
    options = ModelOptions(estimate=True, cache=False)
    mine = run_model(stage, "superelement-3d" if space else "superelement", options).analysis
    other = analyse(stage, reference(stage, space=space))
    name = f"{stage.name}, {type(stage.hinges[0].profile).__name__}"

    def one(value: float, uncertainty: float, true: float) -> Comparison:
        return Comparison(abs(value / true - 1.0), uncertainty / abs(true), name)

    yield from ((FREQUENCIES, one(*figures)) for figures in _frequencies(mine, other))
    true = {(r.quantity, r.axis): r.value for r in other.characteristics}
    for row in mine.characteristics:
        for called, quantities in COMPARED.items():
            if row.quantity in quantities and (row.quantity, row.axis) in true:
                value = true[row.quantity, row.axis]
                yield called, one(row.value, row.uncertainty or 0.0, value)


def _frequencies(mine: Analysis, other: Analysis) -> Iterator[tuple[float, float, float]]:
    found, true = mine.modes["removed"], other.modes["removed"]
    assert found.uncertainty_hz is not None
    columns = (found.frequency_hz, found.uncertainty_hz, true.frequency_hz)
    return zip(*(c[:COUNT].tolist() for c in columns), strict=True)


def all_compared(stages: Iterable[Stage], *, space: bool) -> dict[str, list[Comparison]]:
    """Compare figures of many stages, by what they are called."""
    return _by_name(_compared(stage, space) for stage in stages)


def _compared(stage: Stage, space: bool) -> list[tuple[str, Comparison]]:
    return list(compared(stage, space=space))


def _by_name(stages: Iterable[list[tuple[str, Comparison]]]) -> dict[str, list[Comparison]]:
    found = defaultdict(list)
    for own in stages:
        for called, one in own:
            found[called].append(one)
    return dict(found)


def held(found: list[Comparison]) -> tuple[float, float]:
    """Return the share of figures within their estimates, and the largest error over estimate."""
    ratios = np.array([one.ratio for one in found])
    return float(np.mean(ratios <= 1.0)), float(ratios.max())


def table(found: Mapping[str, list[Comparison]]) -> Iterator[str]:
    """Write how often estimates held, and below it where they held least."""
    yield "| figure | number | within | worst | error, median, largest | estimate over error |"
    yield "|---|---|---|---|---|---|"
    for called, ones in found.items():
        share, worst = held(ones)
        errors = 100.0 * np.array([one.error for one in ones])
        over = np.median([1.0 / one.ratio if one.ratio else np.inf for one in ones])
        yield (
            f"| {called} | {len(ones)} | {100.0 * share:.1f} % | {worst:.2f} | "
            f"{np.median(errors):.2g}, {errors.max():.2g} % | {over:.2g} |"
        )
    for called, ones in found.items():
        yield from (f"{called}: {one}" for one in sorted(ones, key=lambda one: -one.ratio)[:3])


def main(kind: str, count: str, seed: str) -> None:
    """Print the table; each processor has a process."""
    space = kind == "space"
    stages = islice(random_stages(int(seed), small=space), int(count))
    for library in ("OPENBLAS", "NGS"):
        os.environ.setdefault(f"{library}_NUM_THREADS", "1")
    with ProcessPoolExecutor(os.cpu_count(), get_context("spawn")) as processes:
        found = _by_name(processes.map(_compared, stages, repeat(space)))
    for line in table(found):
        sys.stdout.write(f"{line}\n")


if __name__ == "__main__":
    main(*sys.argv[1:])
