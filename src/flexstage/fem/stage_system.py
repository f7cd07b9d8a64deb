"""A stage as a mechanical system: what acts on its coordinates, and what is read of them."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from flexstage.arrays import Array
from flexstage.stage import Force, Stage
from flexstage.stage.outline import Point
from flexstage.system import MechanicalSystem
from flexstage.system.mechanical import (
    AxisPort,
    BodyPort,
    DrivePort,
    LoadPort,
    ProbePort,
)
from flexstage.system.stress_map import StressMap

_LIFTED = " out of plane"


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Ports:
    """What acts on the coordinates of a stage, and what is read of them, by name."""

    drives: Mapping[str, Array]
    """Elongation of each drive, shape (n,)."""
    probes: Mapping[str, Array]
    """Reading of each probe, shape (n,); out of the plane those of `lifted_probes`."""
    bodies: Mapping[str, tuple[Point, Array]]
    """Centre [m] of each body and its motion there, shape (3, n)."""
    loads: Mapping[str, tuple[Array, str]]
    """Force on the coordinates, shape (n,), and unit of each load."""

    def changed(self, change: Callable[[Array], Array]) -> "Ports":
        """Return them for other coordinates, of which `change` says what rows become."""
        return Ports(
            drives={name: change(v) for name, v in self.drives.items()},
            probes={name: change(v) for name, v in self.probes.items()},
            bodies={name: (at, change(rows)) for name, (at, rows) in self.bodies.items()},
            loads={name: (change(v), unit) for name, (v, unit) in self.loads.items()},
        )


def side_by_side(parts: Sequence[Ports], sizes: Sequence[int]) -> Ports:
    """Put motions of so many coordinates side by side that know nothing of each other.

    Drives and bodies are those of the first.
    """
    ends = np.cumsum(sizes)
    wider = [
        ports.changed(
            lambda rows, before=end - size, after=ends[-1] - end: np.pad(
                rows, [(0, 0)] * (rows.ndim - 1) + [(before, after)]
            )
        )
        for ports, size, end in zip(parts, sizes, ends.tolist(), strict=True)
    ]
    return Ports(
        drives=wider[0].drives,
        probes={name: v for ports in wider for name, v in ports.probes.items()},
        bodies=wider[0].bodies,
        loads={name: v for ports in wider for name, v in ports.loads.items()},
    )


def lifted_probes(stage: Stage) -> dict[str, tuple[str, Point]]:
    """Name the readings out of the plane: of each body that a probe reads, at the first of them."""
    found: dict[str, tuple[str, Point]] = {}
    for probe in stage.probes:
        found.setdefault(f"{probe.body}{_LIFTED}", (probe.body, probe.at))
    return found


def stage_system(
    stage: Stage,
    ports: Ports,
    coordinates: tuple[Array, Array, tuple[str, ...]],
    stress: StressMap,
    said: tuple[tuple[str, ...], Mapping[str, str]],
) -> MechanicalSystem:
    """Return a stage in some coordinates: their mass, stiffness and names.

    `said` are where the model holds, and the settings that change its figures.
    """
    mass, stiffness, names = coordinates
    validity, settings = said
    readings = [
        ProbePort(name=p.name, vector=ports.probes[p.name], unit=p.unit, body=p.body)
        for p in stage.probes
    ]
    lifted = [
        ProbePort(name=name, vector=ports.probes[name], body=body)
        for name, (body, _) in lifted_probes(stage).items()
        if name in ports.probes
    ]
    return MechanicalSystem(
        name=stage.name,
        model=settings["model"],
        M=mass,
        K=stiffness,
        coordinates=names,
        drives=tuple(
            DrivePort(
                name=d.name,
                vector=ports.drives[d.name],
                stiffness=d.spring,
                stroke=d.stroke,
                smallest_displacement=d.smallest_displacement,
                largest_force=d.largest_force if isinstance(d, Force) else None,
            )
            for d in stage.drives
        ),
        probes=(*readings, *lifted),
        bodies=tuple(
            BodyPort(name=name, centre=centre, matrix=motion)
            for name, (centre, motion) in ports.bodies.items()
        ),
        stress=stress,
        loads=tuple(
            LoadPort(name=name, vector=vector, unit=unit)
            for name, (vector, unit) in ports.loads.items()
        ),
        axes=tuple(AxisPort(name=a.name, drives=a.moved_by, probe=a.probe) for a in stage.axes),
        validity=validity,
        settings=settings,
    )
