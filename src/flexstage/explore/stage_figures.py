"""Figures of a stage beyond those of an analysis, which a search wants to bound."""

import math
from collections.abc import Callable, Collection, Mapping

from flexstage.characteristic import WHOLE_STAGE
from flexstage.lumped.buckling import lumped_buckling
from flexstage.stage import Stage
from flexstage.stage.drive import Force, PiezoStack
from flexstage.stage.narrowest import narrowest_slot, thinnest_wall
from flexstage.system import MechanicalSystem
from flexstage.system.axis_states import axis_states

# of every drive of each axis at full stroke, its elongation [m] and force [N]
Forces = Mapping[str, Mapping[str, tuple[float, float]]]


def _smallest_wall(stage: Stage) -> Mapping[str, float]:
    """Thinnest place of a body, necks left out; none where nothing is thin."""
    found = thinnest_wall(stage)
    return {WHOLE_STAGE: found} if math.isfinite(found) else {}


def _output_wall(stage: Stage) -> Mapping[str, float]:
    """Thinnest place of the body whose motion is the output of an axis; none where none is thin."""
    bodies = {axis.name: stage.probe(axis.probe).body for axis in stage.axes}
    walls = {body: thinnest_wall(stage, body) for body in dict.fromkeys(bodies.values())}
    return {axis: walls[body] for axis, body in bodies.items() if math.isfinite(walls[body])}


def _smallest_neck(stage: Stage) -> Mapping[str, float]:
    """Thinnest neck."""
    necks = [hinge.profile.neck_thickness for hinge in stage.hinges]
    return {WHOLE_STAGE: min(necks)} if necks else {}


def _drive_force(stage: Stage, forces: Forces) -> Mapping[str, float]:
    """Largest force of a drive that the full stroke takes, its elongation imposed."""
    return {
        axis: max((abs(force) for _, force in drives.values()), default=0.0)
        for axis, drives in forces.items()
    }


def _drive_force_share(stage: Stage, forces: Forces) -> Mapping[str, float]:
    """That force in parts of the blocking force, of stacks: what their push must be for all."""
    found: dict[str, float] = {}
    for axis, drives in forces.items():
        for name, (_, force) in drives.items():
            drive = stage.drive(name)
            if isinstance(drive, PiezoStack):
                blocking = drive.blocking_force or drive.stiffness * drive.free_stroke
                found[axis] = max(found.get(axis, 0.0), abs(force) / blocking)
    return found


def _stroke_left(stage: Stage, forces: Forces) -> Mapping[str, float]:
    r"""Part of its free stroke that a drive keeps against the stage: :math:`k_d/(k_d + k_s)`.

    By its own stiffness and the force over its elongation; the least of the drives of an axis.
    """
    found: dict[str, float] = {}
    for axis, drives in forces.items():
        largest = max((abs(length) for length, _ in drives.values()), default=0.0)
        for name, (length, force) in drives.items():
            drive = stage.drive(name)
            # of the largest elongation of a motion, less is none
            if isinstance(drive, Force) or abs(length) <= 1e-9 * largest:
                continue
            lost = 0.0 if drive.spring is None else force / drive.spring
            left = length / (length + lost) if length + lost else math.inf
            found[axis] = min(found.get(axis, math.inf), left)
    return found


def _buckling_factor(stage: Stage, forces: Forces) -> Mapping[str, float]:
    """Factor of the forces of the full stroke at which the stage buckles, bodies taken as rigid."""
    return {
        axis: lumped_buckling(stage, {name: force for name, (_, force) in drives.items()})
        for axis, drives in forces.items()
    }


#: By quantity: what computes it of the geometry alone, by axis, ``stage`` for the whole.
_OF_GEOMETRY: Mapping[str, Callable[[Stage], Mapping[str, float]]] = {
    "smallest_neck": _smallest_neck,
    # the narrowest cut, negative where bodies overlap
    "smallest_slot": lambda stage: {WHOLE_STAGE: narrowest_slot(stage)},
    "smallest_wall": _smallest_wall,
    "output_wall": _output_wall,
}
# of the forces of drives, by axis
_OF_FORCES: Mapping[str, Callable[[Stage, Forces], Mapping[str, float]]] = {
    "drive_force": _drive_force,
    "drive_force_share": _drive_force_share,
    "stroke_left": _stroke_left,
    "buckling_factor": _buckling_factor,
}
#: Quantities that are known of one stage at a time.
STAGE_FIGURES = (*_OF_FORCES, *_OF_GEOMETRY)


def need_a_model(quantities: Collection[str]) -> bool:
    """Say whether some quantities of `STAGE_FIGURES` are more than geometry."""
    return any(quantity in _OF_FORCES for quantity in quantities)


def stage_figures(
    stage: Stage,
    system: MechanicalSystem | None,
    wanted: Collection[tuple[str, str]] | None = None,
) -> dict[tuple[str, str], float]:
    """Return figures of a stage by quantity and axis: those that are wanted, or all.

    `system` is a model of it; None where `need_a_model` says that none is needed.
    """
    asked = {quantity for quantity, _ in wanted} if wanted is not None else set(STAGE_FIGURES)
    found: dict[tuple[str, str], float] = {}
    for quantity, measure in _OF_GEOMETRY.items():
        if quantity in asked:
            found |= {(quantity, axis): value for axis, value in measure(stage).items()}
    if system is None or not need_a_model(asked):
        return found
    forces = {
        state.axis: {
            name: (length, state.static.drive_force.get(name, 0.0))
            for name, length in state.drives.items()
        }
        for state in axis_states(stage, system).axes
    }
    for quantity, compute in _OF_FORCES.items():
        if quantity in asked:
            of = {a: f for a, f in forces.items() if wanted is None or (quantity, a) in wanted}
            found |= {(quantity, axis): value for axis, value in compute(stage, of).items()}
    return found
