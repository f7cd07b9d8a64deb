"""Bodies and hinges of a structural diagram.

A body is a sum of forces, an inverse mass, and two integrators; a hinge leads from the motion of
two bodies to forces on both.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from flexstage.arrays import Array
from flexstage.export.diagram.graph import DiagramBuilder, GroupBuilder
from flexstage.lumped import Mechanism
from flexstage.lumped.rigid_bodies import SpringHinge
from flexstage.system import RayleighDamping


@dataclass(frozen=True, slots=True, kw_only=True)
class BodyBlocks:
    """What other groups connect to."""

    forces: str
    """Name of the sum of forces."""
    rate: str
    """Name of the integrator that gives the rates."""
    motion: str
    """Name of the integrator that gives the displacement."""
    name: str
    """Name of the body."""


def add_body(
    builder: DiagramBuilder, mechanism: Mechanism, index: int, damping: RayleighDamping
) -> BodyBlocks:
    """Add the group of a body."""
    body = mechanism.bodies[index]
    words = f"body {body.name}"
    group = builder.group(f"b_{body.name}", title=f"Body {body.name}", kind="body")
    masses = np.array([body.mass, body.mass, body.inertia])
    forces = group.sum("forces", f"forces on {words} [N, N, N m]", masses.size)
    inverse = group.gain(
        "inverse_mass",
        "M⁻¹",
        f"inverse masses and inertia of {words} [1/kg, 1/kg, 1/(kg m^2)]",
        np.diag(1.0 / masses),
        "mass",
    )
    rate = group.integrator("rate", f"rates of {words} [m/s, m/s, rad/s]", masses.size)
    centre = f"displacement of the centre of mass and rotation of {words} [m, m, rad]"
    motion = group.integrator("motion", centre, masses.size)
    builder.connect(forces, inverse, f"F_{body.name} [N, N, N m]")
    builder.chain(inverse, rate, motion)
    if damping.alpha > 0.0:
        meaning = f"damping of {words} against the ground [N s/m, N s/m, N m s]"
        drag = group.gain("damper", "αM", meaning, np.diag(damping.alpha * masses), "damper")
        builder.connect(rate, drag)
        builder.term(forces, drag, -1, last=True)
    return BodyBlocks(forces=forces, rate=rate, motion=motion, name=body.name)


def point_of_body(mechanism: Mechanism, body: int, at: tuple[float, float]) -> Array:
    """Return the motion (x, y, rotation) of a point [m] for that of its body, shape (3, 3)."""
    cx, cy = mechanism.bodies[body].centre
    return np.array([[1.0, 0.0, -(at[1] - cy)], [0.0, 1.0, at[0] - cx], [0.0, 0.0, 1.0]])


def _hinge_end(mechanism: Mechanism, hinge: SpringHinge, body: int) -> Array:
    """Motion of an end of a hinge, in its axes, for the coordinates of the body."""
    c, s = math.cos(hinge.direction), math.sin(hinge.direction)
    return np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]]) @ point_of_body(
        mechanism, body, hinge.at
    )


def moving_ends(
    ends: tuple[int, int], bodies: dict[int, BodyBlocks], matrix_of: Callable[[int], Array]
) -> list[tuple[BodyBlocks, int, Array]]:
    """Return the bodies between two ends that are not held, their signs, and their matrices.

    A length or deformation is the sum over the ends of sign times matrix times motion. The end that
    it is held by comes last, so that a reader meets the body that moves first.
    """
    found = [
        (bodies[body], sign, matrix_of(body))
        for body, sign in zip(ends[::-1], (1, -1), strict=True)
        if body in bodies
    ]
    if len(found) == 1:
        end, sign, matrix = found[0]
        return [(end, 1, sign * matrix)]
    return found


def add_hinge(
    builder: DiagramBuilder,
    mechanism: Mechanism,
    hinge: SpringHinge,
    bodies: dict[int, BodyBlocks],
    damping: RayleighDamping,
) -> None:
    """Add the group of a hinge, and lead its forces to bodies."""
    sides = moving_ends(hinge.bodies, bodies, lambda body: _hinge_end(mechanism, hinge, body))
    if not sides:
        return
    words = f"hinge {hinge.name}"
    held = [mechanism.bodies[i].name for i in hinge.bodies if mechanism.bodies[i].fixed]
    group = builder.group(
        f"h_{hinge.name}",
        title=f"Hinge {hinge.name}" + (f" to {held[0]} (held)" if held else ""),
        kind="hinge",
    )
    stiffness = np.asarray(hinge.stiffness)
    meaning = f"stiffness of {words} [N/m, N, N m/rad]"
    spring = group.gain("spring", "K", meaning, stiffness, "spring")
    from_motion = _add_difference(builder, sides, group, words, "motion")
    builder.connect(from_motion, spring, f"e_{hinge.name} [m, m, rad]")
    force = spring
    if damping.beta > 0.0:
        meaning = f"damping of {words} [N s/m, N s, N m s/rad]"
        damper = group.gain("damper", "βK", meaning, damping.beta * stiffness, "damper")
        builder.connect(_add_difference(builder, sides, group, words, "rate"), damper)
        force = group.sum("force", f"force of {words} [N, N, N m]", stiffness.shape[0])
        builder.term(force, spring, 1)
        builder.term(force, damper, 1)
    signal = f"f_{hinge.name} [N, N, N m]"
    for number, (end, sign, matrix) in enumerate(sides):
        meaning = f"force of {words} on body {end.name} [N, N, N m]"
        back = group.gain(f"to_{number + 1}", "Bᵀ", meaning, matrix.T.copy(), "geometry")
        builder.connect(force, back, signal if number == 0 else "")
        builder.term(end.forces, back, -sign, signal)


def _add_difference(
    builder: DiagramBuilder,
    sides: list[tuple[BodyBlocks, int, Array]],
    group: GroupBuilder,
    words: str,
    of: str,
) -> str:
    """Add gains from the bodies at the ends of a hinge, and their sum; return its name."""
    what = "deformation" if of == "motion" else "rate of deformation"
    units = "[m, m, rad]" if of == "motion" else "[m/s, m/s, rad/s]"
    gains = []
    for number, (end, sign, matrix) in enumerate(sides):
        meaning = f"part of body {end.name} in the {what} of {words} {units}"
        gain = group.gain(f"{of}_{number + 1}", "B", meaning, matrix, "geometry")
        connect_end(builder, end, gain, of)
        gains.append((gain, sign))
    if len(gains) == 1:
        return gains[0][0]
    total = group.sum(of, f"{what} of {words} {units}", sides[0][2].shape[0])
    for gain, sign in gains:
        builder.term(total, gain, sign)
    return total


def connect_end(builder: DiagramBuilder, end: BodyBlocks, target: str, of: str) -> None:
    """Lead the ``motion`` or the ``rate`` of a body to a block."""
    if of == "motion":
        builder.connect(end.motion, target, f"q_{end.name} [m, m, rad]")
    else:
        builder.connect(end.rate, target, f"q'_{end.name} [m/s, m/s, rad/s]")
