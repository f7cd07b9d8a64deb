"""Analysing the piezo stage again after a change: condensed bodies against one mesh of all.

`python -m benchmarks.superelements` runs it alone.
"""

import math
import os
import tempfile
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

from benchmarks.cases import Row
from benchmarks.timing import Timed
from flexstage.cache import Cache
from flexstage.designs.nested_xy import NestedXYParameters, nested_xy
from flexstage.designs.vgtu_piezo import PARAMETERS
from flexstage.fem.plane import plane_model
from flexstage.fem.superelement import superelement_model
from flexstage.stage import Circle, ExtraMass, Loop, Stage
from flexstage.system import analyse

__all__ = ["superelements"]

ROUNDS, FEW = 4, 3
LIMITS = {
    "nothing, all bodies read from disk": "the analysis, and reading",
    "everything, without a cache": "the two large bodies",
    "plane_model of the whole stage": "modes of the mesh",
}


def _body(stage: Stage, name: str, **changes: object) -> Stage:
    return replace(
        stage,
        bodies=tuple(replace(b, **changes) if b.name == name else b for b in stage.bodies),  # type: ignore[arg-type]
    )


def _slimmer(stage: Stage, name: str, k: int) -> Stage:
    """Slim a bar by 0.2 mm and a little more in its middle: a change that touches no other body."""
    outline = stage.body(name).outline
    points = []
    for (x0, y0), (x1, y1), bulge in outline.segments():
        points.append((x0, y0))
        length = math.dist((x0, y0), (x1, y1))
        if length < 5e-3 or bulge:
            continue
        # inward, to the left of the way round
        depth = (0.1e-3 + 1e-7 * k) / length
        for share in (0.3, 0.4, 0.6, 0.7):
            inward = depth if 0.35 < share < 0.65 else 0.0
            points.append(
                (
                    x0 + share * (x1 - x0) - inward * (y1 - y0),
                    y0 + share * (y1 - y0) + inward * (x1 - x0),
                )
            )
    return _body(stage, name, outline=Loop(tuple(points)))


def _bored(stage: Stage, name: str, k: int) -> Stage:
    """Bore a hole of about 1 mm in the middle of a body."""
    points = stage.body(name).outline.points
    centre = tuple(sum(p[i] for p in points) / len(points) for i in (0, 1))
    hole = Circle((centre[0], centre[1]), 0.5e-3 + 1e-7 * k)
    return _body(stage, name, holes=(*stage.body(name).holes, hole))


def _axis(axis: str, name: str, k: int) -> NestedXYParameters:
    one = getattr(PARAMETERS, axis)
    changed = replace(one, **{name: getattr(one, name) * (1.0 + 1e-5 * k)})
    return replace(PARAMETERS, **{axis: changed})


def _changes(stage: Stage) -> dict[str, tuple[Callable[[int], Stage], int, str]]:
    """What is changed, how often in a round, and what takes the time."""
    platform = stage.body("PY")
    material = stage.material
    return {
        "the waist of one guide leg": (
            lambda k: _slimmer(stage, "xG0u", k),
            FEW,
            "meshing and condensing one leg",
        ),
        "a hole in one guide leg": (
            lambda k: _bored(stage, "xG0u", k),
            FEW,
            "meshing and condensing one leg",
        ),
        "a hole in one lever": (
            lambda k: _bored(stage, "xLu", k),
            FEW,
            "meshing and condensing one lever",
        ),
        "a mass on the platform": (
            lambda k: _body(
                stage,
                "PY",
                extra_masses=(ExtraMass(mass=0.1 + 1e-5 * k, at=platform.outline.points[0]),),
            ),
            FEW,
            "joining, and the analysis",
        ),
        "Young's modulus": (
            lambda k: replace(
                stage,
                material=replace(material, youngs_modulus=material.youngs_modulus * (1 + 1e-5 * k)),
            ),
            FEW,
            "joining, and the analysis",
        ),
        "thickness of the plate": (
            lambda k: replace(stage, thickness=stage.thickness * (1 + 1e-5 * k)),
            FEW,
            "joining, and the analysis",
        ),
        "stiffness of the drives": (
            lambda k: replace(
                stage,
                drives=tuple(replace(d, stiffness=4e7 + k) for d in stage.drives),  # type: ignore[call-arg]
            ),
            FEW,
            "joining, and the analysis",
        ),
        "parameter aperture_diameter": (
            lambda k: nested_xy(
                replace(PARAMETERS, aperture_diameter=PARAMETERS.aperture_diameter * (1 + 1e-5 * k))
            ),
            1,
            "the y platform",
        ),
        "parameter x.leg_neck": (
            lambda k: nested_xy(_axis("x", "leg_neck", k)),
            1,
            "the x platform and the frame, which have its half notches",
        ),
        "parameter x.lever_neck": (
            lambda k: nested_xy(_axis("x", "lever_neck", k)),
            1,
            "the x platform and the frame",
        ),
    }


def _least(routes: dict[str, tuple[Callable[[], object], int]]) -> dict[str, float]:
    """Time routes in turn, several rounds over, so that what else the machine does hits all alike.

    Each has a number of runs in a round; the least time counts, and the first run of all does not.
    """
    least = dict.fromkeys(routes, math.inf)
    for around in range(ROUNDS + 1):
        for name, (work, runs) in routes.items():
            for _ in range(runs):
                start = time.perf_counter()
                work()
                if around:
                    least[name] = min(least[name], time.perf_counter() - start)
    return least


def superelements() -> Iterator[Row]:
    """Time model and analysis after a change; the first line is a change of one small body.

    The meshes, factorisations and dense matrices of every route run on one thread.
    """
    os.environ["NGS_NUM_THREADS"] = "1"
    stage = nested_xy(PARAMETERS)
    routes: dict[str, tuple[Callable[[], object], int]] = {}
    built: dict[str, set[str]] = {}
    limits: dict[str, str] = {}
    with tempfile.TemporaryDirectory() as name:
        cache = Cache(Path(name))
        superelement_model(stage, cache=cache)
        for label, (change, runs, limit) in _changes(stage).items():
            built[label] = set()
            stages = iter([change(k) for k in range(1, runs * (ROUNDS + 1) + 1)])

            def again(stages: Iterator[Stage] = stages, which: set[str] = built[label]) -> None:
                changed = next(stages)
                model = superelement_model(changed, cache=cache)
                which.update(model.built)
                analyse(changed, model.system)

            routes[label] = again, runs
            limits[label] = limit

        def from_disk() -> None:
            analyse(stage, superelement_model(stage, cache=Cache(Path(name))).system)

        def all_new() -> None:
            analyse(stage, superelement_model(stage, cache=False).system)

        def whole() -> None:
            analyse(stage, plane_model(stage).system)

        routes["nothing, all bodies read from disk"] = from_disk, FEW
        routes["everything, without a cache"] = all_new, 1
        routes["plane_model of the whole stage"] = whole, 1
        least = _least(routes)
    first = next(iter(least.values()))
    for route, seconds in least.items():
        bodies = f" ({', '.join(sorted(built[route])) or 'no body'})" if route in built else ""
        yield Row(
            case="vgtu-piezo again, after a change of ...",
            route=route + bodies,
            time=Timed(seconds=seconds),
            ratio=seconds / first,
            limit=limits.get(route, LIMITS.get(route, "")),
        )


if __name__ == "__main__":
    for row in superelements():
        print(f"{row.route:<72} {row.time!s:>9} {row.ratio:>8.3g}   {row.limit}")
