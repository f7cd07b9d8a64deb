"""A stage of joined bodies as a mechanical system: its ports, and the stress of its notches."""

from collections.abc import Mapping, Sequence
from itertools import pairwise

import numpy as np

from flexstage.arrays import Array
from flexstage.fem.condensation import Condensed
from flexstage.fem.coupling import Joint
from flexstage.fem.cutting import Placed
from flexstage.fem.substructure import REFERENCE
from flexstage.stage import Force, Stage
from flexstage.system import MechanicalSystem
from flexstage.system.mechanical import (
    AxisPort,
    BodyPort,
    DrivePort,
    LoadPort,
    ProbePort,
)
from flexstage.system.stress_map import StressByForces, StressMap, StressOfForces


def joined_system(
    stage: Stage,
    joint: Joint,
    placed: Sequence[Placed],
    condensed: Sequence[Condensed],
    coordinates: tuple[Array, Array, Array, tuple[str, ...]],
    said: tuple[tuple[str, ...], Mapping[str, str]],
) -> MechanicalSystem:
    """Return a joined stage in other coordinates: their basis, mass, stiffness and names."""
    basis, mass, stiffness, names = coordinates
    return MechanicalSystem(
        name=stage.name,
        model=said[1]["model"],
        M=mass,
        K=stiffness,
        coordinates=names,
        drives=tuple(
            DrivePort(
                name=d.name,
                vector=joint.drives[d.name] @ basis,
                stiffness=d.spring,
                stroke=d.stroke,
                smallest_displacement=d.smallest_displacement,
                largest_force=d.largest_force if isinstance(d, Force) else None,
            )
            for d in stage.drives
        ),
        probes=(
            *(
                ProbePort(
                    name=p.name, vector=joint.probes[p.name] @ basis, unit=p.unit, body=p.body
                )
                for p in stage.probes
            ),
            *(
                ProbePort(name=name, vector=vector @ basis, body=name.removesuffix(" out of plane"))
                for name, vector in joint.probes.items()
                if name not in {p.name for p in stage.probes}
            ),
        ),
        bodies=tuple(
            BodyPort(name=name, centre=centre, matrix=motion @ basis)
            for name, (centre, motion) in joint.bodies.items()
        ),
        stress=_stress(stage, joint, placed, condensed, basis),
        loads=tuple(
            LoadPort(name=name, vector=vector @ basis, unit=unit)
            for name, (vector, unit) in joint.loads.items()
        ),
        axes=tuple(AxisPort(name=a.name, drives=a.moved_by, probe=a.probe) for a in stage.axes),
        validity=said[0],
        settings=said[1],
    )


def _stress(
    stage: Stage,
    joint: Joint,
    placed: Sequence[Placed],
    condensed: Sequence[Condensed],
    basis: Array,
) -> StressMap:
    """Stress of all notches; at the ends of a neck its two halves meet in one point."""
    scale = stage.material.youngs_modulus / REFERENCE.youngs_modulus
    # the motions in space know nothing of each other, but stress the same places
    ways = len(condensed) // len(stage.bodies)
    count = sum(c.neck.size for c in condensed) // ways
    levels = max((int(np.abs(c.seam).max(initial=1)) for c in condensed), default=1)
    shares = []
    owner, point = np.zeros(count, dtype=np.intp), np.zeros(count, dtype=np.intp)
    at, used = 0, 2 * levels * len(stage.hinges)
    for k, (p, c, (index, own)) in enumerate(zip(placed, condensed, joint.shares, strict=True)):
        at %= count or 1
        here = slice(at, at + c.neck.size)
        if not c.neck.size:
            continue
        each = c.stress.shape[2]
        forces = scale * c.forces(own @ basis[index])
        ends = np.searchsorted(c.neck, np.arange(len(p.hinges) + 1))
        for i, (first, end) in enumerate(pairwise(ends.tolist())):
            carried = forces[each * i : each * (i + 1)]
            shares.append(StressByForces(at + first, c.stress[first:end], carried))
        if k < len(stage.bodies):
            owner[here] = np.array(p.hinges, dtype=np.intp)[c.neck]
            shared = 2 * (levels * owner[here] + np.abs(c.seam) - 1) + (c.seam > 0)
            point[here] = np.where(c.seam != 0, shared, used + c.point)
            used += int(c.point.max()) + 1
        at += c.neck.size
    return StressMap(
        hinges=tuple(h.name for h in stage.hinges),
        matrix=StressOfForces(count=count, shares=tuple(shares)),
        owner=owner,
        point=point,
    )
