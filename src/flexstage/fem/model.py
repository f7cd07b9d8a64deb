"""A stage as a continuum, projected on the coordinates of a `MechanicalSystem`."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import ngsolve as ng
import numpy as np

from flexstage import progress
from flexstage.arrays import Array
from flexstage.elasticity import AttachedMass, Continuum
from flexstage.elasticity.unit import METRE
from flexstage.fem.geometry import StageFaces
from flexstage.fem.mesh import MeshSettings
from flexstage.fem.necks import NeckPoints, neck_points, neck_stress
from flexstage.fem.ports import (
    Supports,
    attached_masses,
    body_motion,
    body_regions,
    drive_vector,
    probe_vector,
)
from flexstage.fem.projection import project
from flexstage.short_repr import short_repr
from flexstage.stage import Force, MassProperties, Stage, mass_properties
from flexstage.system import STANDARD_GRAVITY, MechanicalSystem, StressMap
from flexstage.system.mechanical import AxisPort, BodyPort, DrivePort, LoadPort, ProbePort


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Half:
    """A continuum and what of the system's coordinates moves it.

    A stage in its plane has one. In three dimensions it has two: motion in the plane, which is
    symmetric about the middle of the plate, and motion out of it, which is the opposite.
    """

    continuum: Continuum
    """The continuum."""
    basis: Array
    """Displacement of the continuum for each coordinate of the system, shape (n, r)."""
    out_of_plane: bool
    """Whether it is the motion out of the plane."""
    points: NeckPoints
    """Where the stress of the notches is looked for."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class StageModel:
    """A finite-element model of a stage."""

    stage: Stage
    """The stage."""
    system: MechanicalSystem
    """The system that it was projected on."""
    halves: tuple[Half, ...]
    """The continua behind it."""
    mesh_settings: MeshSettings
    """How fine the mesh is."""

    __repr__ = short_repr

    @property
    def unknowns(self) -> int:
        """Number of unknowns of one half, the largest system that is factorised."""
        return max(h.continuum.size for h in self.halves)

    @property
    def elements(self) -> int:
        """Number of elements of the mesh."""
        return int(self.halves[0].continuum.mesh.ne)

    def displacement(self, q: Array) -> list[tuple[Half, ng.GridFunction]]:
        """Return the displacement on the mesh of each half.

        Parameters
        ----------
        q : numpy.ndarray
            Coordinates of the system, shape (r,).

        Returns
        -------
        list of tuple
            Each half and its displacement [m].
        """
        return [(half, half.continuum.field(half.basis @ q)) for half in self.halves]


def _temperature(stage: Stage, masses: Mapping[str, MassProperties]) -> dict[str, object]:
    """Fields of temperature of one unit, by name: uniform, and linear about the middle."""
    total = sum(p.mass for p in masses.values())
    x0, y0 = (sum(p.mass * p.centre[i] for p in masses.values()) / total for i in (0, 1))
    return {
        "temperature": 1.0,
        "temperature gradient x": ng.x / METRE - x0,
        "temperature gradient y": ng.y / METRE - y0,
        "temperature gradient z": ng.z / METRE,
    }


def _loads(
    continuum: Continuum,
    stage: Stage,
    masses: Mapping[str, MassProperties],
    attached: Sequence[AttachedMass],
    *,
    out_of_plane: bool,
) -> dict[str, tuple[Array, str]]:
    """Loads on the whole stage that move this half, by name, with the unit that they are for."""
    found: dict[str, tuple[Array, str]] = {}
    for axis, direction in (
        (("z", (0.0, 0.0, 1.0)),)
        if out_of_plane
        else (
            ("x", (1.0, 0.0, 0.0)),
            ("y", (0.0, 1.0, 0.0)),
        )
    ):
        weight = continuum.gravity(direction, STANDARD_GRAVITY)
        for rider in attached:
            i = "xyz".index(axis)
            weight = weight + STANDARD_GRAVITY * rider.inertia[i] * rider.motion[i]
        found[f"gravity {axis}"] = (weight, "g")
    if stage.material.thermal_expansion is not None:
        for name, change in _temperature(stage, masses).items():
            if name.endswith("z") == out_of_plane:
                unit = "K/m" if "gradient" in name else "K"
                found[name] = (continuum.thermal(change), unit)
    return found


def assemble(
    stage: Stage,
    faces: StageFaces,
    continua: Sequence[tuple[Continuum, int, bool]],
    settings: MeshSettings,
    *,
    name: str,
    validity: tuple[str, ...],
    choices: Mapping[str, str],
    supports: Supports,
) -> StageModel:
    """Project continua of a stage on one system."""
    masses = mass_properties(stage)
    halves: list[_HalfSystem] = []
    for i, (continuum, count, out) in enumerate(continua):
        with progress.subtask(0.1 + 0.9 * i / len(continua), 0.1 + 0.9 * (i + 1) / len(continua)):
            halves.append(
                _half(stage, faces, masses, continuum, count, out_of_plane=out, supports=supports)
            )
    omega = np.concatenate([h.omega for h in halves])
    sizes = [h.omega.size for h in halves]
    offsets = np.cumsum([0, *sizes])
    halves_kept = []
    for i, h in enumerate(halves):
        basis = np.zeros((h.continuum.size, omega.size))
        basis[:, offsets[i] : offsets[i + 1]] = h.basis
        halves_kept.append(
            Half(continuum=h.continuum, basis=basis, out_of_plane=h.out, points=h.points)
        )

    first = halves[0]
    zeros = [np.zeros(s) for s in sizes[1:]]
    drives = tuple(
        DrivePort(
            name=d.name,
            vector=np.concatenate([first.drives[i], *zeros]),
            stiffness=d.spring,
            stroke=d.stroke,
            smallest_displacement=d.smallest_displacement,
            largest_force=d.largest_force if isinstance(d, Force) else None,
        )
        for i, d in enumerate(stage.drives)
    )
    probes = [
        ProbePort(
            name=p.name, vector=np.concatenate([first.probes[i], *zeros]), unit="m", body=p.body
        )
        for i, p in enumerate(stage.probes)
    ]
    loads: list[LoadPort] = []
    for i, h in enumerate(halves):
        for key, (vector, unit) in h.loads.items():
            parts = [np.zeros(s) for s in sizes]
            parts[i] = vector
            loads.append(LoadPort(name=key, vector=np.concatenate(parts), unit=unit))
        for key, vector in h.lifts.items():
            parts = [np.zeros(s) for s in sizes]
            parts[i] = vector
            probes.append(
                ProbePort(name=f"{key} out of plane", vector=np.concatenate(parts), body=key)
            )
    bodies = tuple(
        BodyPort(
            name=n,
            centre=p.centre,
            matrix=np.concatenate(
                [first.bodies[n], *(np.zeros((3, s)) for s in sizes[1:])], axis=1
            ),
        )
        for n, p in masses.items()
    )
    stress = StressMap(
        hinges=first.points.hinges,
        matrix=np.concatenate([h.stress for h in halves], axis=2),
        owner=first.points.owner,
        point=first.points.point,
    )
    names = [t for h in halves for t in h.coordinates]
    system = MechanicalSystem(
        name=stage.name,
        model=name,
        M=np.eye(omega.size),
        K=np.diag(omega**2),
        coordinates=tuple(names),
        drives=drives,
        probes=tuple(probes),
        bodies=bodies,
        stress=stress,
        loads=tuple(loads),
        axes=tuple(AxisPort(name=a.name, drive=a.drive, probe=a.probe) for a in stage.axes),
        validity=validity,
        settings={**choices, "supports": supports},
    )
    return StageModel(
        stage=stage,
        system=system,
        halves=tuple(halves_kept),
        mesh_settings=settings,
    )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _HalfSystem:
    """What one continuum gives to the system, in its own coordinates."""

    continuum: Continuum
    omega: Array
    basis: Array
    out: bool
    coordinates: list[str]
    drives: Array
    probes: Array
    lifts: dict[str, Array]
    bodies: dict[str, Array]
    loads: dict[str, tuple[Array, str]]
    points: NeckPoints
    stress: Array


def _half(
    stage: Stage,
    faces: StageFaces,
    masses: Mapping[str, MassProperties],
    continuum: Continuum,
    count: int,
    *,
    out_of_plane: bool,
    supports: Supports,
) -> _HalfSystem:
    attached = attached_masses(continuum, stage)
    loads = _loads(continuum, stage, masses, attached, out_of_plane=out_of_plane)
    none = np.zeros((0, continuum.size))
    drives, probes, lifts = none, none, {}
    if out_of_plane:
        for body in dict.fromkeys(p.body for p in stage.probes):
            probe = next(p for p in stage.probes if p.body == body)
            _, motion = continuum.rigid_motion(body_regions(stage, body), (*probe.at, 0.0))
            lifts[body] = motion[2]
    else:
        if stage.drives:
            drives = np.array(
                [drive_vector(continuum, stage, d, faces.patches, supports) for d in stage.drives]
            )
        if stage.probes:
            probes = np.array([probe_vector(continuum, stage, p) for p in stage.probes])
    vectors = [*drives, *probes, *lifts.values(), *(v for v, _ in loads.values())]
    right = np.array(vectors).reshape(-1, continuum.size).T
    omega, basis, is_mode = project(continuum, right, count, attached)
    progress.update("stress", 0.85)
    points = neck_points(continuum, stage)
    where = "out of plane, " if out_of_plane else ""
    coordinates = [
        f"{where}{'mode' if m else 'static response'} {i + 1} ({w / (2.0 * math.pi):.5g} Hz) "
        "[kg^0.5 m]"
        for i, (w, m) in enumerate(zip(omega, is_mode, strict=True))
    ]
    continuum.release()
    bodies = {}
    if not out_of_plane:
        bodies = {n: body_motion(continuum, stage, n, p.centre) @ basis for n, p in masses.items()}
    return _HalfSystem(
        continuum=continuum,
        omega=omega,
        basis=basis,
        out=out_of_plane,
        coordinates=coordinates,
        drives=drives @ basis,
        probes=probes @ basis,
        lifts={k: v @ basis for k, v in lifts.items()},
        bodies=bodies,
        loads={k: (v @ basis, unit) for k, (v, unit) in loads.items()},
        points=points,
        stress=neck_stress(continuum, points, basis),
    )
