"""Bodies and hinges of a structural diagram.

A body is a sum of forces, an inverse mass, and two integrators; a hinge leads from the motion of
two bodies to forces on both.
"""

import math
from dataclasses import dataclass

import numpy as np
from scipy.linalg import block_diag

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
    members: tuple[int, ...]
    """Indices of the bodies that share the group."""
    label: str
    """What is written behind q: name of the body and units."""

    @property
    def name(self) -> str:
        """Name of the first body."""
        return self.label.split(" ")[0].lstrip("_")


def count_mark(members: tuple[int, ...]) -> str:
    """Return `` ×2`` and so on for those who share a group; nothing for one alone."""
    return f" ×{len(members)}" if len(members) > 1 else ""


def add_body(
    builder: DiagramBuilder,
    mechanism: Mechanism,
    members: tuple[int, ...],
    damping: RayleighDamping,
) -> BodyBlocks:
    """Add the group of a body, or of several that do the same."""
    first = mechanism.bodies[members[0]]
    many = count_mark(members)
    words = f"body {first.name}" + (f" and {len(members) - 1} like it" if many else "")
    units = "[m, m, rad]" + many
    group = builder.group(
        f"b_{first.name}",
        title=f"Body {first.name}{many}",
        kind="body",
        place=first.centre,
        stands_for=tuple(mechanism.bodies[i].name for i in members[1:]),
    )
    masses = np.concatenate(
        [(b.mass, b.mass, b.inertia) for b in (mechanism.bodies[i] for i in members)]
    )
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
    builder.connect(forces, inverse, f"F_{first.name} [N, N, N m]{many}")
    builder.chain(inverse, rate, motion)
    if damping.alpha > 0.0:
        meaning = f"damping of {words} against the ground [N s/m, N s/m, N m s]"
        drag = group.gain("damper", "αM", meaning, np.diag(damping.alpha * masses), "damper")
        builder.connect(rate, drag)
        builder.term(forces, drag, -1, last=True)
    return BodyBlocks(
        forces=forces,
        rate=rate,
        motion=motion,
        members=members,
        label=f"_{first.name} {units}",
    )


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


def _sides(
    mechanism: Mechanism, members: tuple[int, ...], bodies: dict[int, BodyBlocks]
) -> list[tuple[BodyBlocks, int, Array]]:
    """Bodies at the ends of twin hinges, the signs of their parts, and the matrices of these.

    The deformation is the sum over the ends of sign times matrix times motion.
    """
    found: dict[str, tuple[BodyBlocks, int, Array]] = {}
    for row, k in enumerate(members):
        hinge = mechanism.hinges[k]
        # the end that it is held by comes last, so that a reader meets the body that moves first
        for body, sign in zip(hinge.bodies[::-1], (1, -1), strict=True):
            if body not in bodies:
                continue
            end = bodies[body]
            if end.forces not in found:
                shape = (3 * len(members), 3 * len(end.members))
                found[end.forces] = (end, sign, np.zeros(shape))
            _, first, matrix = found[end.forces]
            column = end.members.index(body)
            part = matrix[3 * row : 3 * row + 3, 3 * column : 3 * column + 3]
            part += first * sign * _hinge_end(mechanism, hinge, body)
    sides = list(found.values())
    if len(sides) == 1:
        end, sign, matrix = sides[0]
        return [(end, 1, sign * matrix)]
    return sides


def add_hinge(
    builder: DiagramBuilder,
    mechanism: Mechanism,
    members: tuple[int, ...],
    bodies: dict[int, BodyBlocks],
    damping: RayleighDamping,
) -> None:
    """Add the group of a hinge, or of several that do the same, and lead its forces to bodies."""
    first = mechanism.hinges[members[0]]
    sides = _sides(mechanism, members, bodies)
    if not sides:
        return
    many = count_mark(members)
    words = f"hinge {first.name}" + (f" and {len(members) - 1} like it" if many else "")
    held = [mechanism.bodies[i].name for i in first.bodies if mechanism.bodies[i].fixed]
    group = builder.group(
        f"h_{first.name}",
        title=f"Hinge {first.name}{many}" + (f" to {held[0]} (held)" if held else ""),
        kind="hinge",
        place=first.at,
        stands_for=tuple(mechanism.hinges[i].name for i in members[1:]),
    )
    stiffness = np.asarray(block_diag(*(mechanism.hinges[i].stiffness for i in members)))
    meaning = f"stiffness of {words} [N/m, N, N m/rad]"
    spring = group.gain("spring", "K", meaning, stiffness, "spring")
    from_motion = _add_difference(builder, sides, group, words, "motion")
    builder.connect(from_motion, spring, f"e_{first.name} [m, m, rad]")
    force = spring
    if damping.beta > 0.0:
        meaning = f"damping of {words} [N s/m, N s, N m s/rad]"
        damper = group.gain("damper", "βK", meaning, damping.beta * stiffness, "damper")
        builder.connect(_add_difference(builder, sides, group, words, "rate"), damper)
        force = group.sum("force", f"force of {words} [N, N, N m]", stiffness.shape[0])
        builder.term(force, spring, 1)
        builder.term(force, damper, 1)
    signal = f"f_{first.name} [N, N, N m]"
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
        builder.connect(end.motion, target, f"q{end.label}")
    else:
        label = end.label.replace("[m, m, rad]", "[m/s, m/s, rad/s]")
        builder.connect(end.rate, target, f"q'{label}")
