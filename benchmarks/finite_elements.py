"""Finite elements: time to an accuracy against rivals, and growth with the number of unknowns.

`python -m benchmarks.finite_elements [--long] [hinge] [growth] [stage]`; the whole stage takes
minutes and comes with `--long` alone.

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

__all__ = ["growth", "hinge", "stage"]

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


def _climb(steps: Iterable[Callable[[], Rung]], limit: float = LIMIT) -> tuple[Timed, str]:
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


def _rows(case: str, routes: Iterable[tuple[str, Iterable[Callable[[], Rung]]]]) -> Iterator[Row]:
    first = None
    for route, steps in routes:
        taken, words = _climb(steps)
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
                    held=lambda x: piece.on_left(x.T),
                    loaded=lambda x: piece.on_right(x.T),
                    modes=1,
                ),
            )

    squares = ((6, 2, 4), (8, 2, 8), (12, 3, 8), (16, 4, 12), (20, 5, 16), (28, 7, 24))
    routes = [("flexstage, curved triangles", ours((3, 1.5, None), (4, 1.0, None), (5, 0.8, None)))]
    if _have_scikit_fem():
        routes.append(("scikit-fem, triangles P2", flat(1.0, 0.7, 0.5, 0.35, 0.25, 0.18, 0.12)))
    if _have_calculix():
        routes.append(("CalculiX, CPS8", bricks("CPS8", *((*s, 0) for s in squares))))
    yield from _rows("hinge in plane stress: frequency to 0.1 %, stress to 1 %", routes)

    blocks = ((4, 1, 3, 3), (6, 2, 4, 4), (8, 2, 4, 6), (8, 3, 4, 6), (12, 3, 6, 6), (16, 4, 6, 6))
    prisms = ((3, 1.5, (0.0, 1.0)), (4, 1.5, (0.0, 1.0)), (4, 1.0, (0.0, 0.8, 1.0)))
    routes = [("flexstage, prisms", ours(*prisms, (5, 1.0, (0.0, 0.8, 1.0))))]
    if _have_calculix():
        routes += [
            ("CalculiX, C3D15 from triangles", wedges((1.0, 3), (0.5, 4), (0.25, 6), (0.18, 8))),
            ("CalculiX, C3D20, grid by hand", bricks("C3D20", *blocks)),
            ("CalculiX, C3D20R, grid by hand", bricks("C3D20R", *blocks)),
        ]
    yield from _rows("hinge in three dimensions: frequency to 0.1 %, stress to 1 %", routes)


def _have_calculix() -> bool:
    import shutil

    return shutil.which("ccx") is not None


def _have_scikit_fem() -> bool:
    import importlib.util

    return importlib.util.find_spec("skfem") is not None


# --------------------------------------------------------------------------------------- growth


def _measure(connection: Any, dimension: int, unknowns: int) -> None:
    """Mesh, factorise, solve one load and one mode in a process of its own."""
    _one_thread()
    from flexstage.elasticity import Continuum
    from tests.peers import reference_piece as piece

    base = _peak_memory()
    order, area = 4, 155e-6
    # unknowns of a triangle, or of a prism, of order 4 in a large mesh
    each = 16.0 if dimension == 2 else 120.0
    size = math.sqrt(area * each / (0.433 * unknowns))
    fineness: dict[str, Any] = {"neck_size": min(1.5, size / 0.5e-3), "size": size, "grading": 0.9}
    start = time.perf_counter()
    if dimension == 2:
        mesh = piece.plane_mesh(order, **fineness)
        part = Continuum(mesh, piece.MATERIAL, order=order, thickness=10e-3, held="left")
    else:
        mesh = piece.prism_mesh(order, **fineness)
        part = Continuum(
            mesh, piece.MATERIAL, order=order, held="left", held_components={"z": "middle"}
        )
    part.solve(part.mean("right", (0.0, 1.0)))
    part.modes(1, tolerance=1e-6)
    seconds = time.perf_counter() - start
    connection.send((part.size, seconds, _peak_memory() - base, _peak_memory()))


def _peak_memory() -> float:
    scale = 1.0 if sys.platform == "darwin" else 1024.0
    return scale * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss


def _grown(dimension: int, unknowns: int) -> tuple[float, float, float, float]:
    context = multiprocessing.get_context("spawn")
    ours, theirs = context.Pipe()
    process = context.Process(target=_measure, args=(theirs, dimension, unknowns))
    process.start()
    theirs.close()
    try:
        return ours.recv()
    except EOFError as error:
        raise RuntimeError(f"{unknowns} unknowns failed in their process") from error
    finally:
        process.join()


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


# -------------------------------------------------------------------------------- a whole stage


def stage() -> Iterator[Row]:
    """Time the piezo stage to 0.3 % in its first two frequencies and both drive ratios, in 3D.

    The rival's finest wedges reach no more than that in a few minutes.
    """
    _one_thread()
    from flexstage.designs import design
    from flexstage.fem.mesh import MeshSettings
    from flexstage.fem.solid import solid_model
    from flexstage.fem.superelement import superelement_model
    from flexstage.system import analyse_axis, modes
    from tests.peers.stage_grid import calculix_figures, plane_grid

    source = design("vgtu-piezo")

    def figures(system: Any) -> np.ndarray:
        axes = [analyse_axis(system, axis) for axis in system.axes]
        ratios = [a.output_displacement / a.input_displacement for a in axes]
        return np.array([*modes(system, drives="removed").frequency_hz[:2], *ratios])

    def solid_figures(settings: MeshSettings) -> tuple[np.ndarray, int]:
        model = solid_model(source, settings, modes=(4, 1))
        return figures(model.system), model.unknowns

    converged, _ = solid_figures(MeshSettings(order=4, neck_size=1.0))

    def rung(found: np.ndarray, unknowns: int, seconds: float) -> Rung:
        errors = found / converged - 1.0
        return Rung(
            error=float(np.abs(errors).max()) / 3e-3,
            words=f"{unknowns} unknowns: f {errors[0]:+.2%}, {errors[1]:+.2%}, "
            f"ratio {errors[2]:+.2%}, {errors[3]:+.2%}",
            seconds=seconds,
        )

    def ours() -> Iterator[Callable[[], Rung]]:
        for order, neck_size in ((2, 1.5), (3, 1.5), (4, 1.5)):

            def step(o: int = order, h: float = neck_size) -> Rung:
                start = time.perf_counter()
                found, unknowns = solid_figures(MeshSettings(order=o, neck_size=h))
                return rung(found, unknowns, time.perf_counter() - start)

            yield step

    def condensed() -> Iterator[Callable[[], Rung]]:
        def step() -> Rung:
            start = time.perf_counter()
            model = superelement_model(source, space=True, cache=False)
            seconds = time.perf_counter() - start
            return rung(figures(model.system), model.unknowns, seconds)

        yield step

    def theirs() -> Iterator[Callable[[], Rung]]:
        for neck_size, size, grading in ((0.5, 20e-3, 0.6), (0.25, 20e-3, 0.6), (0.2, 10e-3, 0.5)):
            plane = plane_grid(source, neck_size=neck_size, size=size, grading=grading)

            def step(p: Any = plane) -> Rung:
                found = calculix_figures(source, p, threads=1)
                values = np.array([*found.frequencies, *found.ratios.values()])
                return rung(values, found.unknowns, found.seconds)

            yield step

    routes = [
        ("flexstage, superelements in space, both motions, none from disk", condensed()),
        ("flexstage, prisms, in and out of the plane", ours()),
    ]
    if _have_calculix():
        routes.append(("CalculiX, C3D15 from triangles, in the plane", theirs()))
    case = "vgtu-piezo in three dimensions: two frequencies and both ratios to 0.3 %"
    first = None
    for route, steps in routes:
        taken, words = _climb(steps, limit=600.0)
        first = first or taken.seconds
        yield Row(case=case, route=route, time=taken, ratio=taken.seconds / first, limit=words)


def main() -> None:
    parser = argparse.ArgumentParser(description="Finite elements: time to an accuracy, growth.")
    parser.add_argument("names", nargs="*", choices=["hinge", "growth", "stage", []])
    parser.add_argument("--long", action="store_true", help="the whole stage, and larger problems")
    options = parser.parse_args()
    cases = {"hinge": hinge, "growth": lambda: growth(long=options.long)}
    if options.long:
        cases["stage"] = stage
    elif "stage" in options.names:
        parser.error("the whole stage takes minutes: give --long")
    for name in options.names or cases:
        for case, group in groupby(cases[name](), key=lambda row: row.case):
            print(f"\n{case}", flush=True)
            for row in group:
                mark = " " if row.time.finished else ">"
                print(
                    f"  {row.route:<44} {row.time!s:>10} {mark}{row.ratio:>8.3g}   {row.limit}",
                    flush=True,
                )


if __name__ == "__main__":
    main()
