"""A whole stage analysed for the first time: superelements against scikit-fem and CalculiX.

`python -m benchmarks.whole_stage [plane] [space]` takes about ten minutes where nothing else runs.

Every route makes its own mesh of the same outline, the others by Gmsh, and climbs from coarse to
fine until two frequencies and both ratios are within 0.1 % of a reference, and the largest stress
in a notch for a unit of each drive within 1 %. It has two threads and a process of its own; what it
loads and compiles before is not counted, nor what CalculiX's deck takes to write and its answer to
read.
"""

import argparse
import os
import resource
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Any

import numpy as np

from benchmarks.cases import Row
from benchmarks.finite_elements import (
    Rung,
    alone,
    climbed,
    have_calculix,
    have_scikit_fem,
    shown,
)
from flexstage.base.arrays import Array
from flexstage.stage import Stage
from flexstage.stage.designs import design
from flexstage.system import MechanicalSystem, analyse

__all__ = ["plane", "space"]

#: The stage, and another one by which a process gets ready.
STAGE, WARM = "vgtu-piezo", "parallelogram"
#: Relative errors of two frequencies, two ratios and two stresses.
TARGET = np.array([1e-3, 1e-3, 1e-3, 1e-3, 1e-2, 1e-2])
#: The stage in space: two frequencies [Hz], two ratios, two stresses over elongation [Pa/m]. The
#: first four are means of `solid` of order 5 and of CalculiX with five layers of C3D20R, which are
#: within 0.03 % of each other. The stresses are those of superelements of order 5 in the middle
#: plane, times what a hinge alone, of order 6 in four layers, has more of it below its face (1.016
#: and 1.025). Those in the plane, times what the hinge alone has more in space, are within 0.1 %
#: of them; CalculiX with four fine layers is 0.4 and 0.6 % below.
SPACE = np.array([320.00, 532.14, 1.6969, 1.6508, 5.595e12, 4.416e12])
#: A mesh that takes longer than this ends the ladder of its route [s].
LIMIT = 300.0
#: Threads of each route.
THREADS = 2

# figures, unknowns, seconds of the clock and of the processors
Found = tuple[Array, int, float, float]


def _figures(stage: Stage, system: MechanicalSystem) -> Array:
    found = analyse(stage, system)
    ratios = [a.output_displacement / a.input_displacement for a in found.axes]
    stresses = [max(a.static.hinge_stress.values()) / a.input_displacement for a in found.axes]
    return np.array([*found.modes["removed"].frequency_hz[:2], *ratios, *stresses])


def _processor() -> float:
    who = (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)
    used = [resource.getrusage(w) for w in who]
    return sum(u.ru_utime + u.ru_stime for u in used)


def _ours(model: str, settings: dict[str, Any]) -> Found:
    from flexstage.fem.mesh import MeshSettings
    from flexstage.fem.superelement import BODIES, superelement_model
    from flexstage.fem.whole_stage import plane_model, solid_model

    models: dict[str, Callable[[Stage, MeshSettings], Any]] = {
        "plane": lambda s, m: plane_model(s, m, plane="stress"),
        "solid": lambda s, m: solid_model(s, m, modes=(4, 1)),
        "superelement": lambda s, m: superelement_model(s, m, plane="stress", cache=False),
        "superelement-3d": lambda s, m: superelement_model(s, m, space=True, cache=False),
    }
    made = models[model]
    warm = design(WARM)
    analyse(warm, made(warm, MeshSettings(order=2)).system)
    source = design(STAGE)
    start, used = time.perf_counter(), _processor()
    usual = BODIES if model.startswith("superelement") else MeshSettings()
    found = made(source, replace(usual, **settings))
    values = _figures(source, found.system)
    seconds, used = time.perf_counter() - start, _processor() - used
    return values, found.unknowns, seconds, used


def _theirs(order: int, kind: str, levels: tuple[float, ...], mesh: dict[str, Any]) -> Found:
    """Solve by scikit-fem, or by CalculiX where there is a kind of elements."""
    from flexstage.fem.geometry import stage_faces
    from tests.peers.gmsh_grid import plane_grid
    from tests.peers.stage_grid import Figures, calculix_figures, scikit_fem_figures

    def solved(stage: Stage) -> tuple[Figures, float, float]:
        outline = stage_faces(stage).shape
        start, used = time.perf_counter(), _processor()
        grid = plane_grid(stage, outline, **mesh)
        seconds = time.perf_counter() - start
        if kind:
            found = calculix_figures(stage, grid, kind=kind, levels=levels, threads=THREADS)
        else:
            found = scikit_fem_figures(stage, grid, order=order, threads=THREADS)
        return found, seconds + found.seconds, _processor() - used

    if not kind:
        solved(design(WARM))
    found, seconds, used = solved(design(STAGE))
    return found.values(), found.unknowns, seconds, used


def _rungs(
    reference: Array,
    work: Callable[..., Found],
    *steps: tuple[Any, ...],
    target: Array = TARGET,
) -> Iterator[Callable[[], Rung]]:
    def rung(arguments: tuple[Any, ...]) -> Rung:
        (values, unknowns, seconds, used), memory = alone(work, *arguments)
        errors = values / reference - 1.0
        f, r, s = (", ".join(f"{100.0 * e:+.2f}" for e in errors[k : k + 2]) for k in (0, 2, 4))
        return Rung(
            error=float(np.abs(errors / target).max()),
            words=f"{unknowns} unknowns, {used:.3g} s of the processors, {memory / 1e9:.2f} GB; "
            f"frequencies {f} %, ratios {r} %, stresses {s} %",
            seconds=seconds,
        )

    for step in steps:
        yield lambda s=step: rung(s)


def _threads() -> None:
    """Give processes that start from now on the threads that the commands have."""
    os.environ["OPENBLAS_NUM_THREADS"] = "1"
    os.environ.pop("OMP_NUM_THREADS", None)
    os.environ["NGS_NUM_THREADS"] = str(THREADS)


def _mesh(neck_size: float, size: float, slope: float, *, four: bool = False) -> dict[str, Any]:
    return {"neck_size": neck_size, "size": size, "slope": slope, "quadrilaterals": four}


def plane() -> Iterator[Row]:
    """Time the piezo stage in its plane, all of it in plane stress."""
    _threads()
    (reference, *_), _ = alone(_ours, "plane", {"order": 5, "neck_size": 0.5})
    routes = [
        (
            "flexstage, superelements",
            _rungs(
                reference,
                _ours,
                ("superelement", {}),
                ("superelement", {"neck_size": 0.6}),
                ("superelement", {"order": 5, "neck_size": 0.6}),
            ),
        )
    ]
    if have_scikit_fem():
        routes += [
            (
                f"scikit-fem, curved triangles P{order}",
                _rungs(reference, _theirs, *((order, "", (), _mesh(*m)) for m in meshes)),
            )
            for order, meshes in (
                (2, ((0.3, 0.03, 0.7), (0.25, 0.03, 0.5), (0.18, 0.03, 0.4))),
                (3, ((0.8, 0.03, 1.5), (0.7, 0.03, 1.0), (0.5, 0.03, 1.0))),
                (4, ((1.0, 0.03, 2.0), (1.0, 0.03, 1.5), (0.8, 0.03, 1.0))),
            )
        ]
    yield from climbed(f"{STAGE} in its plane, analysed for the first time", routes, LIMIT)


def space() -> Iterator[Row]:
    """Time the piezo stage in space, first without a word on stress, then with it.

    CalculiX has the half above the middle plane and motion in the plane alone; ours move out of it
    too.
    """
    _threads()
    ours = "flexstage, superelements, both motions"
    theirs = "CalculiX, {}, motion in the plane"
    name = f"{STAGE} in space, analysed for the first time: {{}}"

    def peer(kind: str, target: Array, *steps: tuple[Any, ...]) -> list[Any]:
        rungs = _rungs(SPACE, _theirs, *((0, kind, z, m) for z, m in steps), target=target)
        return [(theirs.format(kind), rungs)] if have_calculix() else []

    loose = np.where(np.arange(6) < 4, TARGET, np.inf)
    routes = [
        (ours, _rungs(SPACE, _ours, ("superelement-3d", {}), target=loose)),
        *peer(
            "C3D20R",
            loose,
            ((0.0, 0.7, 1.0), _mesh(0.8, 0.06, 2.0, four=True)),
            ((0.0, 0.7, 1.0), _mesh(0.6, 0.06, 2.0, four=True)),
        ),
        *peer("C3D15", loose, ((0.0, 0.7, 1.0), _mesh(0.25, 0.03, 0.5))),
    ]
    yield from climbed(name.format("frequencies and ratios to 0.1 %"), routes, LIMIT)
    routes = [
        (ours, _rungs(SPACE, _ours, ("superelement-3d", {}))),
        *peer(
            "C3D20R",
            TARGET,
            ((0.0, 0.75, 0.95, 1.0), _mesh(0.6, 0.06, 2.0, four=True)),
            ((0.0, 0.7, 0.9, 0.97, 1.0), _mesh(0.35, 0.06, 2.0, four=True)),
        ),
    ]
    yield from climbed(name.format("stress to 1 % too"), routes, LIMIT)


def main() -> None:
    parser = argparse.ArgumentParser(description="A whole stage analysed for the first time.")
    cases = {"plane": plane, "space": space}
    parser.add_argument("names", nargs="*", choices=[*cases, []])
    shown(cases, parser.parse_args().names)


if __name__ == "__main__":
    main()
