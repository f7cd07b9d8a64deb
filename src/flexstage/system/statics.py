"""Static response of a system to forces and to imposed drive displacements."""

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.linalg import LinAlgError, cho_factor, cho_solve, get_lapack_funcs

from flexstage.base.arrays import Array
from flexstage.base.errors import ModelError
from flexstage.base.short_repr import short_repr
from flexstage.stage.model import only_drive
from flexstage.system.mechanical import (
    AxisPort,
    DriveCondition,
    DrivePort,
    MechanicalSystem,
)
from flexstage.system.stress_map import StressMap

#: Two drives whose elongations agree to this relative tolerance are one.
DEPENDENT = 1e12


# Rounding may leave any pivot of a singular matrix positive, so the last pivots say little: a small
# one before has left 1e-16 over itself in them. The reciprocal condition number of K with a unit
# diagonal tells: at most 1e-16 of a thousand mechanisms drawn at random, 5e-6 or more of all
# designs, and still 7e-15 of these with necks of some nanometres.
_CONDITION = 1e-15


def solve_stiffness(stiffness: Array, right: Array, constraints: Array) -> tuple[Array, Array]:
    """Solve K q = f with some linear combinations of q held at zero.

    K is symmetric, f and q have one column for each load, and each column v of `constraints` gives
    v^T q = 0. Returns q and the constraint forces, one row for each column of `constraints`. K is
    singular where rounding to 16 digits could have made it what it is, by the condition number that
    N. J. Higham, ACM Trans. Math. Softw. 14 (1988) 381, estimates from its factor.
    """
    # scaling to a unit diagonal makes metres and radians comparable
    diagonal = np.diag(stiffness)
    if stiffness.size and diagonal.min() <= 0.0:
        raise ModelError(_SINGULAR)
    scale = 1.0 / np.sqrt(diagonal)
    scaled = stiffness * np.outer(scale, scale)
    try:
        factor = cho_factor(scaled, lower=True)
    except LinAlgError as error:
        raise ModelError(_SINGULAR) from error
    if stiffness.size:
        (pocon,) = get_lapack_funcs(("pocon",), factor[:1])
        reciprocal_condition, _ = pocon(factor[0], np.abs(scaled).sum(axis=0).max(), uplo="L")
        if reciprocal_condition < _CONDITION:
            raise ModelError(_SINGULAR)
    both = np.concatenate((right, constraints), axis=1) * scale[:, None]
    solution = cho_solve(factor, both) * scale[:, None]
    free, compliance = solution[:, : right.shape[1]], solution[:, right.shape[1] :]
    if constraints.shape[1] == 0:
        return free, np.zeros((0, right.shape[1]))
    holding = -np.linalg.solve(constraints.T @ compliance, constraints.T @ free)
    return free + compliance @ holding, holding


_SINGULAR = (
    "the stage can move without deforming a hinge, so its stiffness matrix is singular: fix a "
    "body, add a hinge, or run 'flexstage check' on it"
)


@dataclass(frozen=True, kw_only=True, eq=False)
class StaticSolution:
    """A state of equilibrium."""

    q: Array
    """Coordinates, shape (n,)."""
    drive_force: dict[str, float]
    """Force of each drive that was given a force or a displacement [N]."""
    drive_displacement: dict[str, float]
    """Elongation of every drive [m]."""
    readings: dict[str, float]
    """Reading of every probe [m]."""
    body_motion: dict[str, tuple[float, float, float]]
    """Displacement x, y [m] and rotation [rad] of every body."""
    stress: StressMap | None
    """Stress for the coordinates; None where it is not known."""

    __repr__ = short_repr

    @cached_property
    def hinge_stress(self) -> dict[str, float]:
        """Largest equivalent stress in every hinge [Pa]; empty where it is not known."""
        return {} if self.stress is None else self.stress.largest(self.q)


def static_forces(
    system: MechanicalSystem,
    forces: Mapping[str, float],
    *,
    drives: DriveCondition = "removed",
) -> StaticSolution:
    """Return the equilibrium under forces of the drives.

    Parameters
    ----------
    system : MechanicalSystem
        The system.
    forces : Mapping
        Force by drive [N].
    drives : str
        Condition of all drives besides their `forces`: ``removed``, ``in place`` or ``locked``.

    Returns
    -------
    StaticSolution
        The state.

    Raises
    ------
    ModelError
        A drive does not exist, or the stage is a mechanism.
    """
    vectors = ((system.drive(name).vector, force) for name, force in forces.items())
    return static_state(system, _under(system, vectors, drives), dict(forces))


def static_displacements(
    system: MechanicalSystem,
    displacements: Mapping[str, float],
    *,
    others: DriveCondition = "removed",
) -> StaticSolution:
    """Return the equilibrium with the elongation of some drives imposed.

    Parameters
    ----------
    system : MechanicalSystem
        The system.
    displacements : Mapping
        Elongation by drive [m].
    others : str
        Condition of the other drives: ``removed``, ``in place`` or ``locked``.

    Returns
    -------
    StaticSolution
        The state; the drive forces are those that the displacements need.

    Raises
    ------
    ModelError
        A drive does not exist or moves nothing, two are redundant, or the stage is a mechanism.
    """
    names = list(displacements)
    vectors = np.array([system.drive(n).vector for n in names]).reshape(len(names), -1).T
    rest = replace(system, drives=tuple(d for d in system.drives if d.name not in displacements))
    compliance, loose = _compliance(rest, vectors, others)
    targets = np.array([displacements[n] for n in names])
    moved = vectors.T @ compliance
    size = np.sqrt(np.abs(np.diag(moved)))
    # a unit diagonal makes the drives comparable
    if (
        np.any(size**2 <= loose / DEPENDENT)
        or np.linalg.cond(moved / np.outer(size, size)) > DEPENDENT
    ):
        if len(names) == 1 and not rest.drive_springs(others)[1].shape[1]:
            raise ModelError(f"drive '{names[0]}' moves nothing: both of its bodies are fixed")
        raise ModelError(
            f"the displacements of {', '.join(names)} cannot be imposed: a drive moves nothing, "
            "or the others already determine its motion"
        )
    force = np.linalg.solve(moved, targets)
    return static_state(system, compliance @ force, dict(zip(names, force.tolist(), strict=True)))


def static_loads(
    system: MechanicalSystem,
    loads: Mapping[str, float],
    *,
    drives: DriveCondition = "removed",
) -> StaticSolution:
    """Return the equilibrium under loads on the whole stage, such as weight or temperature.

    Parameters
    ----------
    system : MechanicalSystem
        The system.
    loads : Mapping
        Size of each load in its unit.
    drives : str
        ``removed``, ``in place`` or ``locked``.

    Returns
    -------
    StaticSolution
        The state. Its hinge stress is that of the deformation alone: under a change of temperature
        the free expansion would have to be subtracted, so there is none.

    Raises
    ------
    ModelError
        A load does not exist, or the stage is a mechanism.
    """
    vectors = ((system.load(name).vector, size) for name, size in loads.items())
    state = static_state(system, _under(system, vectors, drives), {})
    if any(name.startswith("temperature") for name in loads):
        return replace(state, stress=None)
    return state


def load_readings(system: MechanicalSystem) -> dict[str, dict[str, float]]:
    """Return the reading of every probe for every load on the whole stage, drives removed.

    Parameters
    ----------
    system : MechanicalSystem
        The system.

    Returns
    -------
    dict
        Reading of each probe for one unit of each load [m], by load, then by probe.

    Raises
    ------
    ModelError
        The stage is a mechanism.
    """
    return {load.name: static_loads(system, {load.name: 1.0}).readings for load in system.loads}


def drive_stiffness(
    system: MechanicalSystem, drive: str, *, others: DriveCondition = "removed"
) -> float:
    """Return the stiffness that a drive works against.

    Parameters
    ----------
    system : MechanicalSystem
        The system.
    drive : str
        Name of the drive.
    others : str
        Condition of the other drives: ``removed``, ``in place`` or ``locked``.

    Returns
    -------
    float
        Force over elongation [N/m], without the drive's own stiffness.
    """
    return static_displacements(system, {drive: 1.0}, others=others).drive_force[drive]


def probe_stiffness(
    system: MechanicalSystem, probe: str, *, drives: DriveCondition = "removed"
) -> float:
    """Return the stiffness against a force at a probe, along its direction.

    Parameters
    ----------
    system : MechanicalSystem
        The system.
    probe : str
        Name of the probe.
    drives : str
        ``removed``, ``in place`` or ``locked``.

    Returns
    -------
    float
        Force over reading [N/m]; infinite where the drives hold the probe.
    """
    vector = system.probe(probe).vector[:, None]
    q, loose = _compliance(system, vector, drives)
    moved = float(vector[:, 0] @ q[:, 0])
    return math.inf if moved <= loose[0] / DEPENDENT else 1.0 / moved


def _under(
    system: MechanicalSystem, vectors: Iterable[tuple[Array, float]], drives: DriveCondition
) -> Array:
    """Return the coordinates under vectors of force, each times its magnitude."""
    right = np.zeros((system.order, 1))
    for vector, size in vectors:
        right[:, 0] += size * vector
    added, constraints = system.drive_springs(drives)
    return solve_stiffness(system.K + added, right, constraints)[0][:, 0]


def _compliance(
    system: MechanicalSystem, vectors: Array, drives: DriveCondition
) -> tuple[Array, Array]:
    """Return the shapes for unit vectors of force, and their self-compliances, unconstrained."""
    added, constraints = system.drive_springs(drives)
    shapes, _ = solve_stiffness(system.K + added, vectors, constraints)
    free = shapes
    if constraints.shape[1]:
        free, _ = solve_stiffness(system.K + added, vectors, constraints[:, :0])
    return shapes, np.einsum("ij,ij->j", vectors, free)


def static_state(system: MechanicalSystem, q: Array, force: dict[str, float]) -> StaticSolution:
    """Return the state of a stage for coordinates and drive forces."""
    motion = {b.name: b.matrix @ q for b in system.bodies}
    return StaticSolution(
        q=q,
        drive_force=force,
        drive_displacement={d.name: float(d.vector @ q) for d in system.drives},
        readings={p.name: float(p.vector @ q) for p in system.probes},
        body_motion={k: (float(v[0]), float(v[1]), float(v[2])) for k, v in motion.items()},
        stress=system.stress,
    )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class StrokeMotion:
    """Motion over the stroke of a drive, by a model with finite rotations."""

    displacement: Array
    """Elongation of the drive [m], shape (k,)."""
    along: Array
    """Displacement along the axis [m], shape (k,)."""
    across: Array
    """Displacement to the left of it [m], shape (k,)."""
    rotation: Array
    """Rotation of the body [rad], shape (k,)."""

    __repr__ = short_repr

    @property
    def deviation(self) -> Array:
        """Distance of the path from its least-squares straight line [m], shape (k,)."""
        design = np.stack((np.ones_like(self.along), self.along), axis=1)
        fit, *_ = np.linalg.lstsq(design, self.across, rcond=None)
        return (self.across - design @ fit) / np.hypot(1.0, fit[1])

    @property
    def straightness(self) -> float:
        """Largest less smallest deviation from the least-squares straight line [m]."""
        return float(np.ptp(self.deviation))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class AxisAnalysis:
    """The full stroke of an axis: of its drive, the others removed, or of all drives together."""

    axis: str
    """Name of the axis."""
    drives: Mapping[str, float]
    """Elongation of each drive that moves it [m]."""
    probe: str
    """Probe."""
    input_displacement: float
    """Largest elongation of a drive [m]."""
    output_displacement: float
    """Reading of the probe [m, or rad]."""
    input_stiffness: float
    """Force of the drive over its elongation; of several, twice the energy over the square of the
    input displacement [N/m].
    """
    static: StaticSolution
    """The whole state."""

    __repr__ = short_repr

    @property
    def drive(self) -> str:
        """The drive that moves it alone.

        Raises
        ------
        ModelError
            Several drives move it together.
        """
        return only_drive(self.axis, tuple(self.drives), ModelError)


def analyse_axis(system: MechanicalSystem, axis: AxisPort) -> AxisAnalysis:
    """Push one drive over its stroke.

    Parameters
    ----------
    system : MechanicalSystem
        The system.
    axis : AxisPort
        The axis.

    Returns
    -------
    AxisAnalysis
        The state at full stroke; of a pure force, at its largest force.

    Raises
    ------
    ModelError
        The drive has neither a stroke nor a largest force, or several drives move the axis.
    """
    port = system.drive(axis.drive)
    stroke = port.stroke
    if stroke is None:
        if port.largest_force is None:
            raise ModelError(f"drive '{port.name}' has neither a stroke nor a largest force")
        stroke = port.largest_force / drive_stiffness(system, port.name)
    static = static_displacements(system, {axis.drive: stroke})
    return AxisAnalysis(
        axis=axis.name,
        drives={axis.drive: stroke},
        probe=axis.probe,
        input_displacement=stroke,
        output_displacement=static.readings[axis.probe],
        input_stiffness=static.drive_force[axis.drive] / stroke,
        static=static,
    )


def imposed_shape(system: MechanicalSystem, drive: DrivePort) -> Array:
    """Return the shape at rest for one metre of a rigid drive in place.

    The other rigid drives keep their length. Shape (n,), in the coordinates' units over m.
    """
    added, vectors = system.drive_springs("in place")
    n, m = vectors.shape
    saddle = np.block([[system.K + added, vectors], [vectors.T, np.zeros((m, m))]])
    right = np.zeros(n + m)
    right[n + int(np.argmax([np.array_equal(v, drive.vector) for v in vectors.T]))] = 1.0
    return np.asarray(np.linalg.solve(saddle, right)[:n], dtype=np.float64)
