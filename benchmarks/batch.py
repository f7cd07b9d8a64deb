"""Many stages at once against loops over the single analysis, by turns, in one thread.

All times are for one stage. Each route is given what it needs: arrays of masses, places and
stiffness for the batch, descriptions whose hinges and masses were computed before for the loops.
"""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from benchmarks.cases import Row
from benchmarks.timing import Timed, in_turns
from flexstage.lumped import StageArrays, lumped_characteristics, lumped_system, stage_arrays
from flexstage.stage import Stage
from flexstage.stage.designs import design
from flexstage.system import analyse, analyse_axis, modes

__all__ = ["batch"]

SAMPLES = 4096
STAGES = 24
#: What a tolerance analysis asks for.
QUANTITIES = ("transmission_ratio", "natural_frequency_hz", "max_stress", "cross_coupling")


def scattered(stage: Stage, count: int, seed: int = 3) -> StageArrays:
    """Return arrays of stages whose hinges and masses scatter by some percent."""
    arrays, draw = stage_arrays([stage]), np.random.default_rng(seed)

    def scaled(x: np.ndarray, share: float) -> np.ndarray:
        size = (count, x.shape[1], *(1,) * (x.ndim - 2))
        return x * (1.0 + share * draw.standard_normal(size))

    return replace(
        arrays,
        mass=scaled(arrays.mass, 0.005),
        inertia=scaled(arrays.inertia, 0.005),
        hinge_stiffness=scaled(arrays.hinge_stiffness, 0.03),
        hinge_at=arrays.hinge_at + 5e-6 * draw.standard_normal((count, *arrays.hinge_at.shape[1:])),
        stress_rows=scaled(arrays.stress_rows, 0.01),
    )


def batch() -> Iterator[Row]:
    """Time one stage of thousands of one topology: figures from arrays, and from descriptions."""
    for name in ("vgtu-piezo", "parallelogram"):
        yield from _one(name)


def _one(name: str) -> Iterator[Row]:
    stage = design(name)
    arrays = scattered(stage, SAMPLES)
    wanted = [
        (quantity, axis.name)
        for quantity in QUANTITIES
        for axis in stage.axes
        if quantity != "cross_coupling" or len(stage.axes) > 1
    ]
    stages = [replace(stage, name=f"{name}-{i}") for i in range(STAGES)]

    def lean() -> None:
        for each in stages:
            system = lumped_system(each)
            for axis in system.axes:
                analyse_axis(system, axis)
            modes(system)

    def whole() -> None:
        for each in stages:
            analyse(each, lumped_system(each))

    routes = [
        (
            "batch, ratio, frequencies, stress, coupling",
            lambda: lumped_characteristics(arrays, wanted),
            SAMPLES,
            "sums and products over the samples, in memory nearest to the processor",
        ),
        (
            "batch, all figures",
            lambda: lumped_characteristics(arrays),
            SAMPLES,
            "more digits of the modes, for their effective mass",
        ),
        ("loop: statics of each axis, six modes", lean, STAGES, "assembly, eigenvalues: n^3"),
        ("loop: all of `analyse`", whole, STAGES, "the Bode diagrams"),
    ]
    times = in_turns([work for _, work, _, _ in routes], runs=3)
    each = [t.seconds / count for t, (_, _, count, _) in zip(times, routes, strict=True)]
    for (route, _, _, limit), seconds in zip(routes, each, strict=True):
        yield Row(
            case=f"one {name} of thousands",
            route=route,
            time=Timed(seconds=seconds),
            ratio=seconds / each[0],
            limit=limit,
        )
