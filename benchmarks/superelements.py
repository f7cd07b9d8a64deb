"""Analysing the piezo stage again after a change: condensed bodies against one mesh of all.

`python -m benchmarks.superelements` runs it alone; `space` and `growth` are its other cases.
"""

import argparse
import math
import os
import resource
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from benchmarks.cases import Row
from benchmarks.timing import Timed
from flexstage.fem.superelement import superelement_model
from flexstage.fem.whole_stage import plane_model, solid_model
from flexstage.files.cache import Cache
from flexstage.hinges import RightCircular
from flexstage.stage import Axis, Body, Circle, ExtraMass, Force, Hinge, Loop, Probe, Stage
from flexstage.stage.designs.nested_xy import NestedXYParameters, nested_xy
from flexstage.stage.designs.vgtu import PIEZO
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
    one = getattr(PIEZO.parameters, axis)
    changed = replace(one, **{name: getattr(one, name) * (1.0 + 1e-5 * k)})
    return replace(PIEZO.parameters, **{axis: changed})


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
                replace(
                    PIEZO.parameters,
                    aperture_diameter=PIEZO.parameters.aperture_diameter * (1 + 1e-5 * k),
                )
            ),
            1,
            "the y platform",
        ),
        "one neck of the frame": (
            lambda k: _with_necks(stage, [1.01 + 1e-5 * k]),
            FEW,
            "half notches on either side of it, then joining",
        ),
        "parameter x.leg_neck": (
            lambda k: nested_xy(_axis("x", "leg_neck", k)),
            1,
            "the frame, whose outline the design moves with it",
        ),
        "parameter x.lever_neck": (
            lambda k: nested_xy(_axis("x", "lever_neck", k)),
            1,
            "x platform and frame, whose outlines the design moves with it",
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
    stage = nested_xy(PIEZO.parameters)
    routes: dict[str, tuple[Callable[[], object], int]] = {}
    built: dict[str, set[str]] = {}
    limits: dict[str, str] = {}
    with tempfile.TemporaryDirectory() as name:
        cache = Cache(Path(name))
        base = superelement_model(stage, cache=cache)
        for label, (change, runs, limit) in _changes(stage).items():
            built[label] = set()
            stages = iter([change(k) for k in range(1, runs * (ROUNDS + 1) + 1)])

            def again(stages: Iterator[Stage] = stages, which: set[str] = built[label]) -> None:
                changed = next(stages)
                model = superelement_model(changed, cache=cache, near=base)
                which.update(model.newly_condensed)
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


def in_space() -> Iterator[Row]:
    """Time models in space after a change near one that is known, against `solid_model`."""
    os.environ["NGS_NUM_THREADS"] = "1"
    stage = nested_xy(PIEZO.parameters)
    random = np.random.default_rng(1)

    def one(k: int) -> Stage:
        return _with_necks(stage, [1.01 + 1e-4 * k])

    def axis(k: int) -> Stage:
        return _with_necks(
            stage, [0.98 - 1e-4 * k if h.name[0] == "x" else 1.0 for h in stage.hinges]
        )

    def each(_: int) -> Stage:
        return _with_necks(stage, list(1.0 - 0.1 * random.random(len(stage.hinges))))

    with tempfile.TemporaryDirectory() as name:
        cache = Cache(Path(name))
        start = time.perf_counter()
        base = superelement_model(stage, space=True, cache=cache)
        first = time.perf_counter() - start
        taken = [("first", first, "the x platform and the frame")]
        for label, change, limit in (
            ("nothing", lambda _: stage, "joining, and the analysis"),
            ("one neck of the frame", one, "three half notches on either side of it"),
            ("all necks of the x axis", axis, "their half notches"),
            ("every neck, each by another part", each, "their half notches"),
        ):
            seconds = []
            for k in range(1, 2 + FEW):
                changed = change(k)
                start = time.perf_counter()
                model = superelement_model(changed, space=True, cache=cache, near=base)
                analyse(changed, model.system)
                seconds.append(time.perf_counter() - start)
            taken.append((label, seconds[0], limit))
            taken.append((f"{label}, again", min(seconds[1:]), "joining, and the analysis"))
        start = time.perf_counter()
        analyse(stage, solid_model(stage).system)
        taken.append(("solid_model of the whole stage", time.perf_counter() - start, ""))
    memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e6
    for label, seconds, words in taken:
        yield Row(
            case=f"vgtu-piezo in space, after a change of ... (peak memory {memory:.1f} GB)",
            route=label,
            time=Timed(seconds=seconds),
            ratio=seconds / first,
            limit=words,
        )


def _with_necks(stage: Stage, times: Sequence[float]) -> Stage:
    """Make the first necks so many times as thick."""
    times = (*times, *[1.0] * len(stage.hinges))
    hinges = tuple(
        replace(h, profile=replace(h.profile, neck_thickness=k * h.profile.neck_thickness))
        for h, k in zip(stage.hinges, times, strict=False)
    )
    return replace(stage, hinges=hinges)


def _rake(legs: int) -> Stage:
    """Return a platform on many legs, side by side on one frame, all of other widths."""
    pitch, length, beam, height = 9e-3, 24e-3, 2e-3, 10e-3
    whole = legs * pitch
    bodies = [
        Body(name="frame", outline=_box(0.0, whole, -height, 0.0), fixed=True),
        Body(
            name="platform", outline=_box(0.0, whole, length + 2 * beam, length + 2 * beam + height)
        ),
    ]
    hinges = []
    for i in range(legs):
        x, notch = (i + 0.5) * pitch, RightCircular(neck_thickness=0.5e-3, radius=1e-3)
        wide = 3e-3 + 1e-6 * i
        bodies.append(
            Body(name=f"leg {i}", outline=_box(x - wide / 2, x + wide / 2, beam, length + beam))
        )
        for low, pair in ((0.0, ("frame", f"leg {i}")), (length + beam, (f"leg {i}", "platform"))):
            hinges.append(
                Hinge(
                    name=f"{pair[0]} {pair[1]}",
                    bodies=pair,
                    at=(x, low + beam / 2),
                    direction=math.pi / 2,
                    profile=notch,
                )
            )
    push = Force(
        name="push",
        pushes="platform",
        reacts="frame",
        at=((0.0, length + 2 * beam + height / 2), (0.0, -height / 2)),
        direction=0.0,
        patch_half_width=2e-3,
        largest_force=10.0,
    )
    read = Probe(
        name="out", body="platform", at=(whole, length + 2 * beam + height / 2), direction=0.0
    )
    return Stage(
        name=f"rake of {legs} legs",
        thickness=8e-3,
        material=nested_xy(PIEZO.parameters).material,
        bodies=tuple(bodies),
        hinges=tuple(hinges),
        drives=(push,),
        probes=(read,),
        axes=(Axis(name="x", drive="push", probe="out"),),
    )


def _box(x0: float, x1: float, y0: float, y1: float) -> Loop:
    return Loop(((x0, y0), (x1, y0), (x1, y1), (x0, y1)))


def growth() -> Iterator[Row]:
    """Time the first analysis of stages of 8 to 200 hinges, and the next after one neck changed."""
    os.environ["NGS_NUM_THREADS"] = "1"
    for space, sizes in ((False, (8, 26, 80, 200)), (True, (8, 26, 80))):
        first = 0.0
        for hinges in sizes:
            stage = _rake(hinges // 2)
            start = time.perf_counter()
            base = superelement_model(stage, space=space, cache=False)
            analyse(stage, base.system)
            seconds = time.perf_counter() - start
            first = first or seconds
            after = []
            for k in range(FEW):
                changed = _with_necks(stage, [0.97 - 1e-4 * k])
                start = time.perf_counter()
                analyse(
                    changed, superelement_model(changed, space=space, cache=False, near=base).system
                )
                after.append(time.perf_counter() - start)
            memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e6
            yield Row(
                case=f"a platform on legs, all others, {'in space' if space else 'in the plane'}",
                route=f"{hinges} hinges, {base.unknowns} unknowns",
                time=Timed(seconds=seconds),
                ratio=seconds / first,
                limit=f"after one neck changed {min(after):.3f} s; memory so far {memory:.2f} GB",
            )


CASES = {"again": superelements, "space": in_space, "growth": growth}

if __name__ == "__main__":
    parser = argparse.ArgumentParser(description="Superelements again after a change; growth.")
    parser.add_argument("case", nargs="?", choices=list(CASES), default="again")
    for row in CASES[parser.parse_args().case]():
        print(f"{row.route:<72} {row.time!s:>9} {row.ratio:>8.3g}   {row.limit}")
