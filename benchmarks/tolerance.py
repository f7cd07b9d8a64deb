"""A lot of 100 000 stages as the workshop makes them, against the single analysis of each.

`python -m benchmarks tolerance`. What is computed: ratio, frequency, largest stress and coupling of
both axes, of stages each with its own necks, radii, places, plate, material and drives. The single
analysis builds the notches, masses and matrices of a sample by itself and computes no more than
that: no Bode diagrams, and modes with the drives removed alone.
"""

import time
from collections.abc import Callable, Iterator
from functools import partial
from typing import Any

from benchmarks.cases import Row
from benchmarks.timing import Timed
from flexstage.stage import Stage
from flexstage.stage.designs import design
from flexstage.studies.explore.deviations import KINDS, draw
from flexstage.studies.explore.family import known_figures
from flexstage.studies.explore.figures import Figure, default_figures
from flexstage.studies.explore.tolerance import tolerance as draw_lot
from flexstage.studies.explore.workers import open_workers
from flexstage.system import analyse_axis, modes
from flexstage.system.characteristics import axis_characteristics
from flexstage.virtual.imperfections import Scatter

__all__ = ["tolerance"]

SAMPLES = 100_000
#: Samples that the single analysis is timed with.
SINGLE = 50


def _once(work: Callable[[], Any]) -> Timed:
    start = time.perf_counter()
    work()
    return Timed(seconds=time.perf_counter() - start)


def _lot(stage: Stage, figures: tuple[Figure, ...], count: int) -> None:
    with open_workers(count) as workers:
        draw_lot(stage, figures=figures, samples=SAMPLES, model="lumped", workers=workers)


def _single(stage: Stage) -> None:
    from tests.made_system import made_system

    numbers = draw(stage, tuple(kind.name for kind in KINDS), 0, SINGLE, seed=0)
    for i in range(SINGLE):
        made, system = made_system(stage, Scatter(), numbers, i)
        removed = modes(system, count=12)
        for axis in system.axes:
            axis_characteristics(made, system, analyse_axis(system, axis), removed)


def tolerance() -> Iterator[Row]:
    """Time 100 000 samples of the piezo stage on one, two and four processes, and the loop."""
    stage = design("vgtu-piezo")
    figures = default_figures(known_figures(stage))
    routes = [
        (
            f"batches, {count} process{'' if count == 1 else 'es, with their start'}",
            _once(partial(_lot, stage, figures, count)),
            "statics and frequencies by one factor of each stage, memory",
        )
        for count in (1, 2, 4)
    ]
    loop = _once(partial(_single, stage))
    routes.append(
        (
            f"loop over the single analysis ({SINGLE} of them, times {SAMPLES // SINGLE})",
            Timed(seconds=loop.seconds * SAMPLES / SINGLE),
            "the compliance of 32 notches",
        )
    )
    for route, timed, limit in routes:
        yield Row(
            case=f"{SAMPLES} tolerance samples of vgtu-piezo",
            route=route,
            time=timed,
            ratio=timed.seconds / routes[0][1].seconds,
            limit=limit,
        )
