"""What is compared with what. Every case says what its time is made of."""

import importlib.util
from collections.abc import Iterator
from dataclasses import dataclass

from benchmarks import peers
from benchmarks.ladder import ladder
from benchmarks.timing import Timed, limited, warm
from flexstage.lumped import lumped_system, mechanism, nonlinear, stroke_path, symbolic_model
from flexstage.stage.designs import design
from flexstage.system import analyse, analyse_axis, modes

__all__ = ["Row", "analysis", "equations", "growth"]

#: A peer that takes longer than this is ended [s].
LIMIT = 30.0
HAVE_EXUDYN = importlib.util.find_spec("exudyn") is not None


@dataclass(frozen=True, slots=True, kw_only=True)
class Row:
    """One line of a table: what, by which route, how long it took, against the case's first."""

    case: str
    route: str
    time: Timed
    ratio: float
    limit: str


def _rows(case: str, timed: list[tuple[str, Timed, str]]) -> Iterator[Row]:
    first = timed[0][1].seconds
    for route, time, limit in timed:
        yield Row(case=case, route=route, time=time, ratio=time.seconds / first, limit=limit)


def analysis() -> Iterator[Row]:
    """Time the analysis of the piezo stage: statics, ratio, stress of both axes, and six modes."""
    stage = design("vgtu-piezo")
    bodies = mechanism(stage)
    drives = [axis.drive for axis in stage.axes]

    def figures() -> None:
        system = lumped_system(stage)
        for axis in system.axes:
            analyse_axis(system, axis)
        modes(system, count=6)

    def everything() -> None:
        analyse(stage, lumped_system(stage))

    timed = [
        (
            "flexstage, from the description",
            warm(figures, runs=20),
            "assembly, eigenvalues: n^3",
        ),
    ]
    if HAVE_EXUDYN:
        work = warm(lambda: peers.exudyn_figures(bodies, drives))
        timed.append(("EXUDYN (no stress)", work, "building the system three times"))
    timed += [
        (
            "sympy.physics.mechanics, LagrangesMethod (no stress)",
            limited(peers.mechanics_figures, bodies, limit=2.0 * LIMIT),
            "differentiation of one energy by 60 coordinates",
        ),
        (
            "flexstage, all of `analyse` (12 modes in 3 conditions, 4 Bode diagrams)",
            warm(everything),
            "the Bode diagrams",
        ),
        (
            "flexstage, finite rotations over the stroke, 21 states of x",
            warm(lambda: _stroke(stage), runs=3),
            "tangent stiffness, four times a state",
        ),
    ]
    yield from _rows("analysis of vgtu-piezo", timed)


def _stroke(stage: object) -> None:
    import numpy as np

    model = nonlinear(mechanism(stage))  # type: ignore[arg-type]
    axis = stage.axis("x")  # type: ignore[attr-defined]
    stroke_path(model, axis.drive, axis.probe, np.linspace(0.0, 38e-6, 21))


def equations() -> Iterator[Row]:
    """Time the symbolic M, C, K of the piezo stage: 21 bodies, 32 hinges, 60 coordinates."""
    bodies = mechanism(design("vgtu-piezo"))
    yield from _rows(
        "symbolic equations of vgtu-piezo",
        [
            (
                "flexstage: one hinge's block, put in 32 times",
                warm(lambda: symbolic_model(bodies), runs=3),
                "replacing symbols in 32 x 2 blocks",
            ),
            (
                "Hessians of the total energy",
                limited(peers.naive_hessians, bodies, limit=2.0 * LIMIT),
                "60 x 60 second derivatives of a sum over all hinges",
            ),
        ],
    )


def growth(sizes: tuple[int, ...] = (5, 10, 21, 50, 100)) -> Iterator[Row]:
    """Time how every route grows with the number of bodies of a ladder."""
    routes = {
        "flexstage, numeric": (None, "3 n x 3 n eigenvalues: n^3"),
        "flexstage, symbolic": (None, "hinges: n, and the symbols to look through: n"),
        "Hessians of the total energy": (peers.naive_hessians, "n^2 derivatives of n terms"),
        "sympy.physics.mechanics": (peers.mechanics_figures, "n^2 derivatives of n terms"),
    }
    if HAVE_EXUDYN:
        routes["EXUDYN"] = (None, "3 n x 3 n dense eigenvalues: n^3")
    stopped: set[str] = set()
    for size in sizes:
        source = ladder(size)
        timed = []
        for route, (peer, limit) in routes.items():
            if route in stopped:
                continue
            if peer is not None:
                time = limited(peer, source, limit=LIMIT)
                if not time.finished:
                    stopped.add(route)
            elif route == "flexstage, numeric":
                time = warm(lambda: peers.numeric_figures(source))  # noqa: B023 (run at once)
            elif route == "flexstage, symbolic":
                time = warm(lambda: symbolic_model(source), runs=2)  # noqa: B023 (run at once)
            else:
                time = warm(lambda: peers.exudyn_figures(source, ["push"]), runs=2)  # noqa: B023
            timed.append((route, time, limit))
        yield from _rows(f"ladder of {size} bodies", timed)
