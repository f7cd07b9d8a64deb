"""Equilibrium of a stage and its drives on their seats, and working lines of stacks."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from flexstage.base.arrays import Array
from flexstage.base.errors import ModelError
from flexstage.base.short_repr import short_repr
from flexstage.files.plain import picked
from flexstage.quantities.units import readable
from flexstage.stage.drive import Drive, Force, PiezoStack
from flexstage.stage.model import Stage
from flexstage.system.mechanical import MechanicalSystem
from flexstage.system.statics import StaticSolution, solve_stiffness, static_forces, static_state

# Sweeps over all drives, and the relative change of their forces at which they end.
_SWEEPS, _SETTLED = 2000, 1e-12
# Halvings after which doubles of an interval are one.
_HALVINGS = 60
# Relative error of the stroke of a linear model that is worth a note.
_NOTABLE = 0.01


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SeatedDrive:
    """State of a drive on its seats."""

    force: float
    """Force on the stage besides the preload [N]; it pushes where positive."""
    contact_force: float
    """Pressing force on the seats [N]."""
    elongation: float
    """Elongation between both bodies [m]."""
    is_open: bool
    """A seat has lifted off."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SeatedState:
    """Equilibrium of a stage and its drives."""

    drives: Mapping[str, SeatedDrive]
    """State of each drive that has a displacement."""
    static: StaticSolution
    """State of the stage; its change from rest."""

    __repr__ = short_repr


def static_drives(
    stage: Stage,
    system: MechanicalSystem,
    displacements: Mapping[str, float],
    *,
    load: Array | None = None,
) -> SeatedState:
    r"""Return the equilibrium of a stage with its drives in place, on their seats.

    .. math:: d_i^T q + c_i(F_i) = w_i, \quad K q = \sum_i d_i F_i + f, \quad F_{0i} + F_i \ge 0

    The compression c of drive and seats is that of `Drive.compression`; a preload spring adds to K.
    Where a seat would have to pull, the drive is open.

    Parameters
    ----------
    stage : Stage
        The stage.
    system : MechanicalSystem
        A model of it.
    displacements : Mapping
        Free displacement w by drive [m]; of every other drive with a stroke 0.
    load : numpy.ndarray, optional
        Force f on each coordinate, shape (n,).

    Returns
    -------
    SeatedState
        The state. Its one solution is found drive by drive: the energy is convex.

    Raises
    ------
    ModelError
        A drive does not exist or has no displacement, two are redundant, or the stage is a
        mechanism.

    Notes
    -----
    Validity: as the seats and the linear model; the preload is that at rest, without slip and
    without friction of the seats.
    """
    drives, vectors, K = seated_drives(stage, system)
    names = {d.name for d in drives}
    if unknown := [name for name in displacements if name not in names]:
        system.drive(unknown[0])
        raise ModelError(f"drive '{unknown[0]}' is a pure force, which has no displacement")
    outer = np.zeros(system.order) if load is None else load
    right = np.column_stack((vectors, outer))
    shapes, _ = solve_stiffness(K, right, np.zeros((system.order, 0)))
    free = np.array([displacements.get(d.name, 0.0) for d in drives]) - vectors.T @ shapes[:, -1]
    force = contact_forces(drives, vectors.T @ shapes[:, :-1], free)
    q = shapes[:, :-1] @ force + shapes[:, -1]
    states = {
        d.name: _state(d, float(f), float(elongation))
        for d, f, elongation in zip(drives, force, vectors.T @ q, strict=True)
    }
    return SeatedState(
        drives=states, static=static_state(system, q, {n: s.force for n, s in states.items()})
    )


def seat_notes(stage: Stage, system: MechanicalSystem) -> tuple[str, ...]:
    """Return what a linear model of a drive on its seats leaves out, for axes with one drive."""
    notes = []
    for axis in system.axes:
        drive = stage.drive(axis.drives[0])
        if len(axis.drives) > 1 or drive.pulls:  # coupled drives do not move over their strokes
            continue
        probe, port = system.probe(axis.probe), system.drive(drive.name)
        state = static_drives(stage, system, {drive.name: drive.stroke or 0.0})
        reading = state.static.readings[axis.probe]
        push = (port.stiffness or 0.0) * (port.stroke or 0.0)
        tangent = static_forces(system, {drive.name: push}, drives="in place")
        linear = tangent.readings[axis.probe]
        if abs(linear - reading) > _NOTABLE * abs(reading):
            notes.append(
                f"axis '{axis.name}': the drive has the stiffness of its seats at the preload; "
                f"over the stroke this moves the probe by {readable(probe.unit, linear)}, the law "
                f"of the contacts by {readable(probe.unit, reading)}"
            )
    return tuple(notes)


def seated_drives(stage: Stage, system: MechanicalSystem) -> tuple[list[Drive], Array, Array]:
    """Return the drives that have a displacement, their elongations, and K with preload springs.

    An elongation is a column for a drive, as the vector of its `DrivePort`.
    """
    drives = [d for d in stage.drives if not isinstance(d, Force)]
    vectors = np.array([system.drive(d.name).vector for d in drives])
    K = system.K.copy()
    for drive, vector in zip(drives, vectors, strict=True):
        if drive.preload:
            K += drive.preload.spring_stiffness * np.outer(vector, vector)
    return drives, vectors.reshape(len(drives), system.order).T, K


def contact_forces(drives: Sequence[Drive], compliance: Array, free: Array) -> Array:
    """Return the force F of each drive with compliance F + c(F) = w, one drive after the other.

    The compliance is that of what they push on, shape (m, m), and w is `free`, shape (m,); or those
    of samples, shapes (s, m, m) and (s, m).
    """
    force = np.zeros(free.shape)
    for _ in range(_SWEEPS):
        before = force.copy()
        for i, drive in enumerate(drives):
            there = compliance[..., i, i]
            if np.any(there <= 0.0):
                raise ModelError(
                    f"drive '{drive.name}' moves nothing: both of its bodies are fixed"
                )
            if force.ndim > 1:
                pushed = np.einsum("sj,sj->s", compliance[:, i], force)
                rest = free[:, i] - pushed + there * force[:, i]
                force[:, i] = _forces(drive, there, rest)
            else:
                rest = float(free[i] - compliance[i] @ force + there * force[i])
                force[i] = _force(drive, float(there), rest)
        change, largest = (np.max(np.abs(f), -1, initial=0.0) for f in (force - before, force))
        if np.all(change <= _SETTLED * largest):
            return force
    raise ModelError(
        "the forces of the drives do not settle: two of them hold the same motion, so that only "
        "their sum is determined"
    )


def _force(drive: Drive, compliance: float, free: float) -> float:
    """Return the force F with compliance F + c(F) = w; an open drive only lacks its preload."""
    from scipy.optimize import brentq

    def excess(force: float) -> float:
        return compliance * force + drive.compression(force) - free

    if not drive.seats:
        return free / (compliance + drive.compression(1.0))
    # F = 0 is on one side of the balance, and w over the compliance on the other
    end, least = free / compliance, -math.inf
    if not drive.pulls and drive.preload:
        least = -drive.preload.force
    if end == 0.0:
        return 0.0
    if end <= least:
        # the law of asperities never ends: what is left of the contact force is rounding
        end = least * (1.0 - 1e-12)
        if excess(end) >= 0.0:
            return least
    low, high = sorted((0.0, end))
    root: Any = brentq(excess, low, high, xtol=1e-14 * abs(end))
    return float(root)


def _forces(drive: Drive, compliance: Array, free: Array) -> Array:
    """Return what `_force` does for each of many samples, by bisection."""
    if not drive.seats:
        return free / (compliance + drive.compression(1.0))
    end = free / compliance
    low, high = np.minimum(end, 0.0), np.maximum(end, 0.0)
    # an open seat lacks everything, and so it ends where the seat opens
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        below = compliance * middle + drive.compressions(middle) < free
        low, high = np.where(below, middle, low), np.where(below, high, middle)
    return 0.5 * (low + high)


def _state(drive: Drive, force: float, elongation: float) -> SeatedDrive:
    contact = force + (drive.preload.force if drive.preload else 0.0)
    return SeatedDrive(
        force=force,
        contact_force=contact,
        elongation=elongation,
        is_open=not drive.pulls and contact <= 0.0,
    )


# keys of the plain data of a working line
_KEYS = (
    "free_stroke=drive.free_stroke", "stiffness=drive.stiffness",
    "blocking_force=drive.blocked_force", "stage_stiffness", "preload_stiffness", "stroke",
    "stroke_share", "lost_on_seats", "force", "force_share", "contact_force",
)  # fmt: skip


@dataclass(frozen=True, slots=True, kw_only=True)
class WorkingLine:
    r"""A stack at its full free stroke on its stage.

    .. math:: F = k_p (L_0 - x_p), \quad F = (k_s + k_0)\,x, \quad x = x_p - a(F)

    The line of the stack has its stiffness k_p and free stroke L0; the load is the stage with k_s
    and the preload spring with k_0, and the seats approach by a(F). Without seats
    :math:`x = L_0 k_p/(k_p + k_s + k_0)`.
    """

    drive: PiezoStack
    """The stack."""
    stroke: float
    """Elongation between both bodies [m]."""
    force: float
    """Force of the stack on stage and preload spring [N]."""
    contact_force: float
    """Force on the seats, that of the preload included [N]."""

    @property
    def stroke_share(self) -> float:
        """Stroke over free stroke [1]."""
        return self.stroke / self.drive.free_stroke

    @property
    def force_share(self) -> float:
        """Force over blocking force [1]."""
        return self.force / self.drive.blocked_force

    @property
    def preload_stiffness(self) -> float:
        """Stiffness of the preload spring [N/m]."""
        return self.drive.preload.spring_stiffness if self.drive.preload else 0.0

    @property
    def stage_stiffness(self) -> float:
        """Stiffness of the stage at the stack, other drives in place [N/m]."""
        return self.force / self.stroke - self.preload_stiffness

    @property
    def lost_on_seats(self) -> float:
        """Part of the stroke by which the seats approach [m]."""
        return self.seat_approach(self.force)

    def seat_approach(self, force: float) -> float:
        """Return by how much the seats approach from rest under a force of the stack [m]."""
        return (
            self.drive.compression(force) - force / self.drive.stiffness
            if self.drive.seats
            else 0.0
        )

    def data(self) -> dict[str, Any]:
        """Return the working line as plain data."""
        return picked(self, *_KEYS)


def working_lines(stage: Stage, system: MechanicalSystem) -> tuple[WorkingLine, ...]:
    """Return the working line of each stack of a stage, with all other drives at rest in place.

    Parameters
    ----------
    stage : Stage
        The stage.
    system : MechanicalSystem
        A model of it.

    Returns
    -------
    tuple of WorkingLine
        One of each stack.

    Raises
    ------
    ModelError
        Two drives are redundant, or the stage is a mechanism.

    Notes
    -----
    Validity: as `static_drives`.
    """
    lines = []
    for drive in stage.drives:
        if isinstance(drive, PiezoStack):
            state = static_drives(stage, system, {drive.name: drive.free_stroke})
            there = state.drives[drive.name]
            lines.append(
                WorkingLine(
                    drive=drive,
                    stroke=there.elongation,
                    force=there.force,
                    contact_force=there.contact_force,
                )
            )
    return tuple(lines)
