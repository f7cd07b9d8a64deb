"""A stage as a continuum, projected on the coordinates of a `MechanicalSystem`."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial

import ngsolve as ng
import numpy as np
from numpy.typing import NDArray

from flexstage.base import progress
from flexstage.base.arrays import Array
from flexstage.base.short_repr import short_repr
from flexstage.elasticity import AttachedMass, Continuum
from flexstage.elasticity.shapes import METRE
from flexstage.fem.geometry import StageFaces
from flexstage.fem.mesh import MeshSettings
from flexstage.fem.necks import NeckPoints, neck_points, neck_stress
from flexstage.fem.stage_system import (
    Ports,
    Supports,
    attached_masses,
    body_motion,
    body_regions,
    coordinate_names,
    drive_vector,
    lifted_probes,
    probe_vector,
    rigid_regions,
    side_by_side,
    stage_system,
    turned_bodies,
)
from flexstage.stage import MassProperties, Stage, mass_properties
from flexstage.system import MechanicalSystem
from flexstage.system.mechanical import STANDARD_GRAVITY
from flexstage.system.stress_map import StressMap
from flexstage.system.thermal_transient import heats

# what is left of a response once the others are taken out of it, below which it is rounding
_DEPENDENT = 1e-12


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class UncoupledProblem:
    """Motion in the plane of a stage, or out of it: a continuum and its coordinates.

    A model in the plane has one. In three dimensions there are two decoupled ones: motion in the
    plane, which is symmetric about the middle of the plate, and motion out of it, which is
    antisymmetric. Each is solved on the upper half of the plate.
    """

    continuum: Continuum
    """The continuum."""
    basis: Array
    """Displacement of the continuum for each coordinate of the system, shape (n, r)."""
    out_of_plane: bool
    """True if it is the motion out of the plane."""
    points: NeckPoints
    """Points of the stress of the notches."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class StageModel:
    """A finite-element model of a stage."""

    stage: Stage
    """The stage."""
    system: MechanicalSystem
    """The system that it was projected on."""
    mesh_settings: MeshSettings
    """Settings of the mesh."""
    unknowns: int
    """Number of unknowns of one problem, the largest system that is factorised."""
    elements: int
    """Number of elements of the mesh."""
    solved: Callable[[], tuple[UncoupledProblem, ...]] = field(repr=False, compare=False)
    """Returns `problems`; solves the stage again if the other fields are from a cache."""

    __repr__ = short_repr

    @property
    def problems(self) -> tuple[UncoupledProblem, ...]:
        """The problem in the plane and, in three dimensions, the one out of it."""
        return self.solved()

    def displacement(self, q: Array) -> list[tuple[UncoupledProblem, ng.GridFunction]]:
        """Return the displacement on the mesh in each problem.

        Parameters
        ----------
        q : numpy.ndarray
            Coordinates of the system, shape (r,).

        Returns
        -------
        list of tuple
            Each problem and its displacement [m].
        """
        return [(p, p.continuum.field(p.basis @ q)) for p in self.problems]


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
    """Loads on the whole stage of this problem, by name, with the unit that they are for."""
    loads: dict[str, tuple[Array, str]] = {}
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
        loads[f"gravity {axis}"] = (weight, "g")
    if all(m.thermal_expansion is not None for m in continuum.materials):
        for name, change in _temperature(stage, masses).items():
            if name.endswith("z") == out_of_plane:
                unit = "K/m" if "gradient" in name else "K"
                loads[name] = (continuum.thermal(change), unit)
    return loads


def assemble(
    stage: Stage,
    faces: StageFaces,
    continua: Sequence[tuple[Continuum, int, bool]],
    settings: MeshSettings,
    *,
    validity: tuple[str, ...],
    choices: Mapping[str, str],
    supports: Supports,
) -> StageModel:
    """Project continua of a stage on one system.

    Each of `continua` is a continuum, the number of its modes, and whether it moves out of the
    plane. `choices` are those that change the figures; with `supports` ``elastic`` fixed bodies are
    compliant under drives that react on them.
    """
    masses = mass_properties(stage)
    uncoupled: list[_UncoupledSystem] = []
    for i, (continuum, count, out) in enumerate(continua):
        with progress.subtask(0.1 + 0.9 * i / len(continua), 0.1 + 0.9 * (i + 1) / len(continua)):
            uncoupled.append(
                _uncoupled(
                    stage, faces, masses, continuum, count, out_of_plane=out, supports=supports
                )
            )
    omega = np.concatenate([h.omega for h in uncoupled])
    sizes = [h.omega.size for h in uncoupled]
    offsets = np.cumsum([0, *sizes])
    problems = []
    for i, h in enumerate(uncoupled):
        basis = np.zeros((h.continuum.size, omega.size))
        basis[:, offsets[i] : offsets[i + 1]] = h.basis
        problems.append(
            UncoupledProblem(
                continuum=h.continuum, basis=basis, out_of_plane=h.out, points=h.points
            )
        )
    points = uncoupled[0].points
    stress = StressMap(
        hinges=points.hinges,
        matrix=np.concatenate([h.stress for h in uncoupled], axis=2),
        owner=points.owner,
        point=points.point,
    )
    names = tuple(t for h in uncoupled for t in h.coordinates)
    system = stage_system(
        stage,
        side_by_side([h.ports for h in uncoupled], sizes),
        (np.eye(omega.size), np.diag(omega**2), names),
        stress,
        (validity, {**choices, "supports": supports}),
    )
    return StageModel(
        stage=stage,
        system=system,
        mesh_settings=settings,
        unknowns=max(p.continuum.size for p in problems),
        elements=int(problems[0].continuum.mesh.ne),
        solved=partial(tuple, problems),
    )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _UncoupledSystem:
    """Contribution of one continuum to the system, in its own coordinates."""

    continuum: Continuum
    omega: Array
    basis: Array
    out: bool
    coordinates: list[str]
    ports: Ports
    points: NeckPoints
    stress: Array


def _uncoupled(
    stage: Stage,
    faces: StageFaces,
    masses: Mapping[str, MassProperties],
    continuum: Continuum,
    count: int,
    *,
    out_of_plane: bool,
    supports: Supports,
) -> _UncoupledSystem:
    attached = attached_masses(continuum, stage)
    loads = _loads(continuum, stage, masses, attached, out_of_plane=out_of_plane)
    drives: dict[str, Array] = {}
    if out_of_plane:
        probes = {
            name: continuum.rigid_motion(rigid_regions(stage, body), (*at, 0.0))[1][2]
            for name, (body, at) in lifted_probes(stage).items()
        }
    else:
        drives = {
            d.name: drive_vector(continuum, stage, d, faces.patches, supports) for d in stage.drives
        }
        probes = {p.name: probe_vector(continuum, stage, p) for p in stage.probes}
    bodies, heated, turned = {}, {}, ()
    if not out_of_plane:
        turned = turned_bodies(stage)
        bodies = {
            n: (p.centre, body_motion(continuum, stage, n, p.centre)) for n, p in masses.items()
        }
        if heats(stage) and stage.expands:
            for name in masses:
                where = continuum.mesh.MaterialCF({body_regions(stage, name): 1.0}, default=0.0)
                heated[name] = continuum.thermal(where)
    ports = Ports(
        drives=drives, probes=probes, bodies=bodies, loads=loads, heated=heated, turned=turned
    )
    right = np.array(ports.static_vectors).reshape(-1, continuum.size).T
    omega, basis, is_mode = project(continuum, right, count, attached)
    progress.update("stress", 0.85)
    points = neck_points(continuum.mesh, stage)
    continuum.release()
    return _UncoupledSystem(
        continuum=continuum,
        omega=omega,
        basis=basis,
        out=out_of_plane,
        coordinates=coordinate_names(omega, is_mode, out_of_plane),
        ports=ports.changed(lambda rows: rows @ basis),
        points=points,
        stress=neck_stress(continuum, points, basis),
    )


def project(
    continuum: Continuum,
    loads: Array,
    count: int,
    attached: Sequence[AttachedMass] = (),
) -> tuple[Array, Array, NDArray[np.bool_]]:
    r"""Project a continuum on its lowest modes and on its static responses to some loads.

    Statics under these loads are exact, and so are the modes; drives that are put in place or
    locked afterwards act through their own static responses, which is what residual attachment
    modes are for (R. H. MacNeal, Computers & Structures 1 (1971) 581; S. Rubin, AIAA J. 13 (1975)
    995).

    Loads are one a column, shape (n, k). Returns the frequencies of all coordinates [rad/s], shape
    (r,), of which the first `count` are natural ones; their displacements, with unit modal mass,
    shape (n, r); and which of them are modes, shape (r,).
    """
    with progress.subtask(0.0, 0.3):
        continuum.factorise()
    with progress.subtask(0.3, 0.75):
        omega, shapes = continuum.modes(count, attached=attached)
    modal_mass = _mass(continuum, attached, shapes)
    progress.update("static responses", 0.75)
    response = continuum.solve(loads)
    # take the modes out, then what the responses share
    within = modal_mass.T @ response
    rest = response - shapes @ within
    effective = np.where(continuum.free[:, None], loads, 0.0)
    stiff_rest = effective - modal_mass @ (omega[:, None] ** 2 * within)
    mass_rest = _mass(continuum, attached, rest)
    self_mass = np.einsum("ij,ij->j", response, _mass(continuum, attached, response))
    left = np.einsum("ij,ij->j", rest, mass_rest)
    independent = np.flatnonzero(left > _DEPENDENT * self_mass)
    if not independent.size:
        return omega, shapes, np.ones(count, dtype=bool)
    size = np.sqrt(left[independent])
    rest, mass_rest, stiff_rest = (a[:, independent] / size for a in (rest, mass_rest, stiff_rest))
    gram = rest.T @ mass_rest
    values, vectors = np.linalg.eigh(0.5 * (gram + gram.T))
    good = values > _DEPENDENT * values.max()
    basis = vectors[:, good] / np.sqrt(values[good])
    stiffness = basis.T @ (rest.T @ stiff_rest) @ basis
    squares, turn = np.linalg.eigh(0.5 * (stiffness + stiffness.T))
    residual = rest @ (basis @ turn)
    all_omega = np.concatenate((omega, np.sqrt(np.clip(squares, 0.0, None))))
    is_mode = np.arange(all_omega.size) < count
    return all_omega, np.column_stack((shapes, residual)), is_mode


def _mass(continuum: Continuum, attached: Sequence[AttachedMass], u: Array) -> Array:
    total = continuum.mass_times(u)
    for rider in attached:
        total = total + rider.motion.T @ (rider.inertia[:, None] * (rider.motion @ u))
    return total
