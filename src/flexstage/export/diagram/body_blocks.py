"""Bodies of a structural diagram: sum of forces, inverse mass, and two integrators."""

from dataclasses import dataclass

import numpy as np

from flexstage.arrays import Array
from flexstage.export.diagram.builder import DiagramBuilder
from flexstage.lumped import Mechanism
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
    described = {"group": group, "width": masses.size}
    forces = builder.add(
        f"{group}_forces", "sum", "+", f"forces on {words} [N, N, N m]", **described
    )
    inverse = builder.add(
        f"{group}_inverse_mass",
        "gain",
        "M⁻¹",
        f"inverse masses and inertia of {words} [1/kg, 1/kg, 1/(kg m^2)]",
        matrix=np.diag(1.0 / masses),
        role="mass",
        **described,
    )
    rate = builder.add(
        f"{group}_rate", "integrator", "1/s", f"rates of {words} [m/s, m/s, rad/s]", **described
    )
    motion = builder.add(
        f"{group}_motion",
        "integrator",
        "1/s",
        f"displacement of the centre of mass and rotation of {words} [m, m, rad]",
        **described,
    )
    builder.connect(forces, inverse, f"F_{first.name} [N, N, N m]{many}")
    builder.connect(inverse, rate)
    builder.connect(rate, motion)
    if damping.alpha > 0.0:
        drag = builder.add(
            f"{group}_damper",
            "gain",
            "αM",
            f"damping of {words} against the ground [N s/m, N s/m, N m s]",
            matrix=np.diag(damping.alpha * masses),
            role="damper",
            **described,
        )
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


def per_second(label: str) -> str:
    """Return the units of rates instead of those of motion."""
    return label.replace("[m, m, rad]", "[m/s, m/s, rad/s]")
