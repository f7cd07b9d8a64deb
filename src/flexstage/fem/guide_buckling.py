"""Buckling of the bars that guide a stage: guide legs and links between two notches."""

import math
from dataclasses import replace

import numpy as np

from flexstage.elasticity.buckling import buckling
from flexstage.errors import ModelError
from flexstage.fem.mesh import MeshSettings
from flexstage.fem.plane import plane_model
from flexstage.stage import Body, Force, Hinge, Loop, Stage

Point = tuple[float, float]


def two_notch_bars(stage: Stage) -> tuple[str, ...]:
    """Return the bodies that guide others as bars between two notches on one line.

    They are guide legs and links.
    """
    found = []
    for body in stage.bodies:
        hinges = [h for h in stage.hinges if body.name in h.bodies]
        pushed = any(body.name in (d.pushes, d.reacts) for d in stage.drives)
        if len(hinges) != 2 or body.fixed or pushed:
            continue
        (x0, y0), (x1, y1) = hinges[0].at, hinges[1].at
        line = np.array([x1 - x0, y1 - y0])
        length = float(np.hypot(*line))
        if length == 0.0:
            continue
        turned = [
            abs(line[0] * np.sin(h.direction) - line[1] * np.cos(h.direction)) for h in hinges
        ]
        if max(turned) < 1e-6 * length:
            found.append(body.name)
    return tuple(found)


def bar_buckling_load(stage: Stage, body: str, settings: MeshSettings | None = None) -> float:
    """Return the axial force at which a bar between two notches loses its resistance to sway.

    Two such bars side by side, far apart, carry a block that can move sideways but hardly turn, as
    a platform between its legs can; the block is pressed down until they buckle. Half of that is
    the load of one bar. By a rigid bar of length L between two hinges of stiffness k it would be
    2 k/L.

    `body` is one of `two_notch_bars`, the load in N; the mesh is of order 4 with elements of 0.8
    necks where not given.

    Notes
    -----
    Validity: bifurcation of a straight bar in the plane; crookedness and load beside the axis lower
    what a real one bears, and yielding of the necks may come first.
    """
    if body not in two_notch_bars(stage):
        raise ModelError(
            f"body '{body}' is no bar between two notches on one line; there are: "
            f"{', '.join(two_notch_bars(stage)) or 'none'}"
        )
    model = plane_model(_rig(stage, body), settings, modes=1)
    problem = model.problems[0]
    drive = model.system.drive("press")
    u = problem.basis @ np.linalg.solve(model.system.K, drive.vector)
    found = buckling(problem.continuum, u)
    if not found.positive.size:
        raise ModelError(f"the bar '{body}' does not buckle under an axial load")
    return 0.5 * float(found.positive[0])


def _rig(stage: Stage, name: str) -> Stage:
    """Put a bar twice between a held block and one that is pressed towards it."""
    first, second = (h for h in stage.hinges if name in h.bodies)
    x0, y0 = first.at
    along = math.atan2(second.at[1] - y0, second.at[0] - x0)
    length = math.dist(first.at, second.at)
    reach = [h.profile.length / 2.0 for h in (first, second)]
    high = max(h.profile.root_height for h in (first, second))
    apart = 4.0 * (length + high)
    c, s = math.cos(along), math.sin(along)

    def turned(p: Point) -> Point:
        """From axes along the bar, with the first neck as origin."""
        return (x0 + c * p[0] - s * p[1], y0 + s * p[0] + c * p[1])

    def block(low: float, top: float) -> Loop:
        wide = apart / 2.0 + 2.0 * high
        return Loop(
            tuple(turned(p) for p in ((low, -wide), (top, -wide), (top, wide), (low, wide)))
        )

    thick = apart / 2.0
    ground = Body(name="ground", outline=block(-reach[0] - thick, -reach[0]), fixed=True)
    top = length + reach[1]
    slider = Body(name="slider", outline=block(top, top + thick))
    bars, hinges = [], []
    for k, side in enumerate((-0.5, 0.5)):
        dx, dy = -s * side * apart, c * side * apart

        def aside(p: Point, dx: float = dx, dy: float = dy) -> Point:
            return (p[0] + dx, p[1] + dy)

        bar = stage.body(name)
        holes = tuple(
            h.mapped(aside) if isinstance(h, Loop) else replace(h, centre=aside(h.centre))
            for h in (*bar.holes, *bar.mounting_holes)
        )
        bars.append(Body(name=f"bar {k}", outline=bar.outline.mapped(aside), holes=holes))
        for hinge, end in ((first, "ground"), (second, "slider")):
            joined = tuple(f"bar {k}" if b == name else end for b in hinge.bodies)
            hinges.append(
                Hinge(
                    name=f"{end} {k}",
                    bodies=(joined[0], joined[1]),
                    at=aside(hinge.at),
                    direction=hinge.direction,
                    profile=hinge.profile,
                )
            )
    press = Force(
        name="press",
        pushes="slider",
        reacts="ground",
        at=(turned((top + thick, 0.0)), turned((-reach[0] - thick, 0.0))),
        direction=along + math.pi,
        patch_half_width=apart / 2.0,
        largest_force=1.0,
    )
    return Stage(
        name=f"{stage.name} {name}",
        thickness=stage.thickness,
        material=stage.material,
        bodies=(ground, slider, *bars),
        hinges=tuple(hinges),
        drives=(press,),
    )
