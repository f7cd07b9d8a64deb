"""Finite elements: time to an accuracy against rivals, and growth with the number of unknowns.

`python -m benchmarks.finite_elements [--long] [hinge] [growth]`; a whole stage is in
`benchmarks.whole_stage`.

Every route climbs a ladder of meshes until its own error is within the target, and its time is that
of the first mesh that is. Ours has the geometry to mesh; rivals are given their meshes, and their
time is that of the solver alone. Every route has one thread.
"""

import argparse
import math
import multiprocessing
import os
import resource
import sys
import time
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from itertools import groupby
from typing import Any

import numpy as np

from benchmarks.cases import Row
from benchmarks.timing import Timed

__all__ = [
    "Rung",
    "alone",
    "climbed",
    "growth",
    "have_calculix",
    "have_scikit_fem",
    "hinge",
    "shown",
]

#: A mesh that takes longer than this ends the ladder of its route [s].
LIMIT = 60.0
#: Relative errors of the first frequency and of the largest von Mises stress.
TARGET = (1e-3, 1e-2)
#: Converged frequency [Hz] and stress [Pa] of the reference hinge, by dimension.
CONVERGED = {2: (900.898, 30.2336e6), 3: (946.757, 28.20e6)}
#: The largest problem in three dimensions may take this much memory [bytes].
MEMORY = 12e9


@dataclass(frozen=True, slots=True, kw_only=True)
class Rung:
    """One mesh of a route: its error over the target, what it says of itself, its time."""

    error: float
    words: str
    seconds: float


def _climb(steps: Iterable[Callable[[], Rung]], limit: float) -> tuple[Timed, str]:
    """Return the time of the first mesh that is accurate enough, or that of the last one tried."""
    rung = None
    for step in steps:
        rung = step()
        if rung.error <= 1.0:
            # once more where it is short: the first run also meets a cold cache
            again = step().seconds if rung.seconds < 10.0 else rung.seconds
            return Timed(seconds=min(rung.seconds, again)), rung.words
        if rung.seconds > limit:
            break
    if rung is None:
        raise ValueError("a route needs a mesh")
    return Timed(seconds=rung.seconds, finished=False), f"target not reached: {rung.words}"


def climbed(
    case: str, routes: Iterable[tuple[str, Iterable[Callable[[], Rung]]]], limit: float = LIMIT
) -> Iterator[Row]:
    """Return a row for each route, against the first one."""
    first = None
    for route, steps in routes:
        taken, words = _climb(steps, limit)
        first = first or taken.seconds
        yield Row(case=case, route=route, time=taken, ratio=taken.seconds / first, limit=words)


def _one_thread() -> None:
    import ngsolve as ng

    ng.SetNumThreads(1)
    os.environ["NGS_NUM_THREADS"] = "1"


# --------------------------------------------------------------------------- the reference hinge


def _rung(dimension: int, found: Any) -> Rung:
    f, s = CONVERGED[dimension]
    stress = getattr(found, "stress", None) or found.peak_stress
    errors = (found.frequencies[0] / f - 1.0, stress / s - 1.0)
    return Rung(
        error=max(abs(e) / t for e, t in zip(errors, TARGET, strict=True)),
        words=f"{found.unknowns} unknowns: frequency {errors[0]:+.3%}, stress {errors[1]:+.2%}",
        seconds=found.seconds,
    )


def hinge() -> Iterator[Row]:
    """Time a circular hinge to 0.1 % in its first frequency and 1 % in stress."""
    _one_thread()
    from tests.peers import reference_piece as piece
    from tests.peers import scikit_fem
    from tests.peers.grids import triangles

    def ours(*steps: tuple[Any, ...]) -> Iterator[Callable[[], Rung]]:
        for order, neck_size, levels in steps:
            yield lambda o=order, n=neck_size, z=levels: _rung(
                2 if z is None else 3,
                piece.by_flexstage(o, neck_size=n, size=10e-3, grading=0.9, levels=z),
            )

    def bricks(kind: str, *steps: tuple[int, ...]) -> Iterator[Callable[[], Rung]]:
        for along, across, outside, layers in steps:
            plane = piece.quadrilaterals(along, across, outside)
            # levels crowd towards the face of the plate, where stress changes most
            levels = 1.0 - (1.0 - np.linspace(0.0, 1.0, layers + 1)) ** 2 if layers else None
            yield lambda p=plane, z=levels: _rung(
                2 if z is None else 3, piece.by_calculix(p, kind, levels=z, threads=1)
            )

    def wedges(*steps: tuple[float, int]) -> Iterator[Callable[[], Rung]]:
        for neck_size, layers in steps:
            plane = triangles(piece.plane_mesh(5, neck_size=neck_size))
            levels = 1.0 - (1.0 - np.linspace(0.0, 1.0, layers + 1)) ** 2
            yield lambda p=plane, z=levels: _rung(
                3, piece.by_calculix(p, "C3D15", levels=z, threads=1)
            )

    def flat(*sizes: float) -> Iterator[Callable[[], Rung]]:
        for size in sizes:
            grid = triangles(piece.plane_mesh(5, neck_size=size, size=4e-3 * size**0.5))
            yield lambda g=grid: _rung(
                2,
                scikit_fem.solve(
                    g,
                    piece.MATERIAL,
                    thickness=piece.THICKNESS,
                    plane_strain=False,
                    held=piece.on_left,
                    loaded=piece.on_right,
                    modes=1,
                ),
            )

    squares = ((6, 2, 4), (8, 2, 8), (12, 3, 8), (16, 4, 12), (20, 5, 16), (28, 7, 24))
    routes = [("flexstage, curved triangles", ours((3, 1.5, None), (4, 1.0, None), (5, 0.8, None)))]
    if have_scikit_fem():
        routes.append(("scikit-fem, triangles P2", flat(1.0, 0.7, 0.5, 0.35, 0.25, 0.18, 0.12)))
    if have_calculix():
        routes.append(("CalculiX, CPS8", bricks("CPS8", *((*s, 0) for s in squares))))
    yield from climbed("hinge in plane stress: frequency to 0.1 %, stress to 1 %", routes)

    blocks = ((4, 1, 3, 3), (6, 2, 4, 4), (8, 2, 4, 6), (8, 3, 4, 6), (12, 3, 6, 6), (16, 4, 6, 6))
    prisms = ((3, 1.5, (0.0, 1.0)), (4, 1.5, (0.0, 1.0)), (4, 1.0, (0.0, 0.8, 1.0)))
    routes = [("flexstage, prisms", ours(*prisms, (5, 1.0, (0.0, 0.8, 1.0))))]
    if have_calculix():
        routes += [
            ("CalculiX, C3D15 from triangles", wedges((1.0, 3), (0.5, 4), (0.25, 6), (0.18, 8))),
            ("CalculiX, C3D20, grid by hand", bricks("C3D20", *blocks)),
            ("CalculiX, C3D20R, grid by hand", bricks("C3D20R", *blocks)),
        ]
    yield from climbed("hinge in three dimensions: frequency to 0.1 %, stress to 1 %", routes)


def have_calculix() -> bool:
    import shutil

    return shutil.which("ccx") is not None


def have_scikit_fem() -> bool:
    import importlib.util

    return importlib.util.find_spec("skfem") is not None


# --------------------------------------------------------------------------------------- growth


def _measure(dimension: int, unknowns: int) -> tuple[float, float, float]:
    """Mesh, factorise, solve one load and one mode; say what memory was there before."""
    _one_thread()
    from flexstage.elasticity import Continuum
    from tests.peers import reference_piece as piece

    base = peak_memory()
    order, area = 4, 155e-6
    # unknowns of a triangle, or of a prism, of order 4 in a large mesh
    each = 16.0 if dimension == 2 else 120.0
    size = math.sqrt(area * each / (0.433 * unknowns))
    fineness: dict[str, Any] = {"neck_size": min(1.5, size / 0.5e-3), "size": size, "grading": 0.9}
    start = time.perf_counter()
    if dimension == 2:
        mesh = piece.plane_mesh(order, **fineness)
        part = Continuum(mesh, piece.MATERIAL, order=order, thickness=10e-3, fixed="left")
    else:
        mesh = piece.prism_mesh(order, **fineness)
        part = Continuum(
            mesh, piece.MATERIAL, order=order, fixed="left", fixed_components={"z": "middle"}
        )
    part.solve(part.mean("right", (0.0, 1.0)))
    part.modes(1, tolerance=1e-6)
    return part.size, time.perf_counter() - start, base


def peak_memory() -> float:
    """Most memory that this process, or one that it ran, has had so far [bytes]."""
    scale = 1.0 if sys.platform == "darwin" else 1024.0
    who = (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)
    return scale * max(resource.getrusage(w).ru_maxrss for w in who)


def _child(connection: Any, work: Callable[..., Any], arguments: tuple[Any, ...]) -> None:
    connection.send((work(*arguments), peak_memory()))


def alone(work: Callable[..., Any], *arguments: Any) -> tuple[Any, float]:
    """Run a function of a module in a process of its own; return also its peak memory [bytes]."""
    context = multiprocessing.get_context("spawn")
    ours, theirs = context.Pipe()
    process = context.Process(target=_child, args=(theirs, work, arguments))
    process.start()
    theirs.close()
    try:
        return ours.recv()
    except EOFError as error:
        raise RuntimeError(f"{work.__name__} failed in its process: {arguments}") from error
    finally:
        process.join()


def _grown(dimension: int, unknowns: int) -> tuple[float, float, float, float]:
    (count, seconds, base), peak = alone(_measure, dimension, unknowns)
    return count, seconds, peak - base, peak


def growth(*, long: bool = False) -> Iterator[Row]:
    """Time statics and one mode from 10 000 to a million unknowns, of order 4.

    In three dimensions it is one layer of prisms, more of which lie beside each other: so a stage
    grows. A size is left out where it would take more memory than `MEMORY`, or, unless `long`, more
    than `LIMIT`; what a size will take is told by the growth so far.
    """
    for dimension in (2, 3):
        case = f"growth in {dimension} dimensions, order 4: mesh, factorise, one load, one mode"
        done: list[tuple[float, float, float, float]] = []
        for unknowns in (10_000, 30_000, 100_000, 300_000, 1_000_000):
            if len(done) > 1:
                ahead = unknowns / done[-1][0]
                seconds = done[-1][1] * ahead ** _slope(done[-2:], 1)
                memory = done[-1][2] * ahead ** _slope(done[-2:], 2)
                if memory > MEMORY or (seconds > LIMIT and not long):
                    continue
            done.append(_grown(dimension, unknowns))
            n, seconds, _, peak = done[-1]
            words = f"peak memory {peak / 1e9:.2f} GB"
            if len(done) > 2:
                words += (
                    f"; so far time ~ n^{_slope(done, 1):.2f}, memory added ~ "
                    f"n^{_slope(done, 2):.2f}"
                )
            yield Row(
                case=case,
                route=f"{n:.0f} unknowns",
                time=Timed(seconds=seconds),
                ratio=seconds / done[0][1],
                limit=words,
            )


def _slope(rows: list[tuple[float, float, float, float]], column: int) -> float:
    values = np.log(np.array(rows)[:, [0, column]])
    return float(np.polyfit(values[:, 0], values[:, 1], 1)[0])


def shown(cases: dict[str, Callable[[], Iterator[Row]]], names: Iterable[str]) -> None:
    """Print the rows of cases as they come, all cases where none is named."""
    for name in names or cases:
        for case, group in groupby(cases[name](), key=lambda row: row.case):
            print(f"\n{case}", flush=True)
            for row in group:
                mark = " " if row.time.finished else ">"
                print(
                    f"  {row.route:<44} {row.time!s:>10} {mark}{row.ratio:>8.3g}   {row.limit}",
                    flush=True,
                )


def main() -> None:
    parser = argparse.ArgumentParser(description="Finite elements: time to an accuracy, growth.")
    parser.add_argument("names", nargs="*", choices=["hinge", "growth", []])
    parser.add_argument("--long", action="store_true", help="larger problems")
    options = parser.parse_args()
    shown({"hinge": hinge, "growth": lambda: growth(long=options.long)}, options.names)


if __name__ == "__main__":
    main()
