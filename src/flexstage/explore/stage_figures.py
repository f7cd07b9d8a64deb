"""Figures of a stage beyond those of an analysis, which a search wants to bound."""

import math
from collections.abc import Callable, Iterator, Mapping

from flexstage.characteristic import WHOLE_STAGE
from flexstage.lumped.buckling import lumped_buckling
from flexstage.stage import Stage
from flexstage.stage.drive import Force, PiezoStack
from flexstage.stage.narrowest import narrowest_slot, thinnest_wall
from flexstage.system import MechanicalSystem
from flexstage.system.axis_states import axis_states

# of the largest elongation of a motion, less is none
_STILL = 1e-9


def _smallest_slot(stage: Stage, system: MechanicalSystem) -> Mapping[str, float]:
    """Narrowest cut, negative where bodies overlap."""
    return {WHOLE_STAGE: narrowest_slot(stage)}


def _smallest_wall(stage: Stage, system: MechanicalSystem) -> Mapping[str, float]:
    """Thinnest place of a body, necks left out; none where nothing is thin."""
    found = thinnest_wall(stage)
    return {WHOLE_STAGE: found} if math.isfinite(found) else {}


def _smallest_neck(stage: Stage, system: MechanicalSystem) -> Mapping[str, float]:
    """Thinnest neck."""
    necks = [hinge.profile.neck_thickness for hinge in stage.hinges]
    return {WHOLE_STAGE: min(necks)} if necks else {}


def _drive_forces(
    stage: Stage, system: MechanicalSystem
) -> Iterator[tuple[str, list[tuple[str, float, float]]]]:
    """Name, elongation and force of every drive of each axis at full stroke."""
    for axis in axis_states(stage, system).axes:
        force = axis.static.drive_force
        yield axis.axis, [(n, length, force.get(n, 0.0)) for n, length in axis.drives.items()]


def _drive_force(stage: Stage, system: MechanicalSystem) -> Mapping[str, float]:
    """Largest force of a drive that the full stroke takes, its elongation imposed."""
    return {
        axis: max((abs(force) for _, _, force in drives), default=0.0)
        for axis, drives in _drive_forces(stage, system)
    }


def _drive_force_share(stage: Stage, system: MechanicalSystem) -> Mapping[str, float]:
    """That force in parts of the blocking force, of stacks: what their push must be for all."""
    found: dict[str, float] = {}
    for axis, drives in _drive_forces(stage, system):
        for name, _, force in drives:
            drive = stage.drive(name)
            if isinstance(drive, PiezoStack):
                blocking = drive.blocking_force or drive.stiffness * drive.free_stroke
                found[axis] = max(found.get(axis, 0.0), abs(force) / blocking)
    return found


def _stroke_left(stage: Stage, system: MechanicalSystem) -> Mapping[str, float]:
    r"""Part of its free stroke that a drive keeps against the stage: :math:`k_d/(k_d + k_s)`.

    By its own stiffness and the force over its elongation; the least of the drives of an axis.
    """
    found: dict[str, float] = {}
    for axis, drives in _drive_forces(stage, system):
        largest = max((abs(length) for _, length, _ in drives), default=0.0)
        for name, length, force in drives:
            drive = stage.drive(name)
            if isinstance(drive, Force) or abs(length) <= _STILL * largest:
                continue
            lost = 0.0 if drive.spring is None else force / drive.spring
            left = length / (length + lost) if length + lost else math.inf
            found[axis] = min(found.get(axis, math.inf), left)
    return found


def _buckling_factor(stage: Stage, system: MechanicalSystem) -> Mapping[str, float]:
    """Factor of the forces of the full stroke at which the stage buckles, bodies taken as rigid."""
    return {
        axis: lumped_buckling(stage, {name: force for name, _, force in drives})
        for axis, drives in _drive_forces(stage, system)
    }


#: By quantity: what computes it of a stage and a model of it, by axis, ``stage`` for the whole.
STAGE_FIGURES: Mapping[str, Callable[[Stage, MechanicalSystem], Mapping[str, float]]] = {
    "drive_force": _drive_force,
    "drive_force_share": _drive_force_share,
    "stroke_left": _stroke_left,
    "buckling_factor": _buckling_factor,
    "smallest_neck": _smallest_neck,
    "smallest_slot": _smallest_slot,
    "smallest_wall": _smallest_wall,
}
