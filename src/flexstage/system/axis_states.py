"""The states that the axes of a stage are told by: each at full stroke, all drives anywhere."""

from itertools import product
from typing import NamedTuple

import numpy as np

from flexstage.errors import ModelError
from flexstage.stage import Stage
from flexstage.system.coupled_axes import CoupledAxes, coupled_axes
from flexstage.system.mechanical import MechanicalSystem
from flexstage.system.reachable_area import MOST_DRIVES
from flexstage.system.statics import AxisAnalysis, analyse_axis, static_state


def _coupling(stage: Stage, system: MechanicalSystem) -> CoupledAxes | None:
    """What all drives do to all axes; None where it says nothing, or cannot be found."""
    if len({drive for axis in system.axes for drive in axis.drives}) < 2:
        return None
    try:
        found = coupled_axes(stage, system)
    except ModelError:
        # drives that hold the same: then each is looked at by itself
        if any(len(axis.drives) > 1 for axis in system.axes):
            raise
        return None
    return found


class AxisStates(NamedTuple):
    """What the drives of a stage do to its axes."""

    coupling: CoupledAxes | None
    """What all drives do to all axes; None where there is one drive, or drives hold the same."""
    together: CoupledAxes | None
    """The same where all drives together make the motion of each axis; else each has its own."""
    axes: tuple[AxisAnalysis, ...]
    """Each axis at full stroke."""


def axis_states(stage: Stage, system: MechanicalSystem) -> AxisStates:
    """Return what all drives do to all axes, whether that moves the axes, and each at full stroke.

    Raises
    ------
    ModelError
        The stage is a mechanism, or a drive has no stroke.
    """
    coupling = _coupling(stage, system)
    together = coupling if coupling is not None and coupling.coupled else None
    if (
        together is not None
        and not together.independent
        and all(len(axis.drives) == 1 for axis in system.axes)
    ):
        # no way to move one axis alone: each drive by itself, as it is
        together = None
    axes = tuple(
        analyse_axis(system, axis)
        if together is None
        else decoupled_axis(system, together, axis.name)
        for axis in system.axes
    )
    return AxisStates(coupling, together, axes)


def decoupled_axis(system: MechanicalSystem, coupled: CoupledAxes, axis: str) -> AxisAnalysis:
    """Return the longest motion along an axis alone, made by all drives together.

    Parameters
    ----------
    system : MechanicalSystem
        The system.
    coupled : CoupledAxes
        What its drives do to its axes.
    axis : str
        Name of the axis.

    Returns
    -------
    AxisAnalysis
        The motion from its beginning to its end, and the stress that it adds on the way.

    Raises
    ------
    ModelError
        The drives cannot move every axis alone.
    """
    moved = coupled.elongations(axis)
    force = coupled.forces @ moved
    state = static_state(
        system, coupled.shapes @ moved, dict(zip(coupled.drives, force.tolist(), strict=True))
    )
    largest = float(np.abs(moved).max())
    probe = coupled.axes[coupled.names.index(axis)].probe
    return AxisAnalysis(
        axis=axis,
        drives=dict(zip(coupled.drives, moved.tolist(), strict=True)),
        probe=probe,
        input_displacement=largest,
        output_displacement=state.readings[probe],
        input_stiffness=float(moved @ force) / largest**2,
        static=state,
    )


def stress_anywhere(system: MechanicalSystem, coupled: CoupledAxes) -> dict[str, float]:
    """Return the largest stress of each hinge with the drives anywhere within their strokes.

    Stress is convex in the elongations, so that it is largest where each drive is at an end of its
    stroke.

    Parameters
    ----------
    system : MechanicalSystem
        The system.
    coupled : CoupledAxes
        What its drives do to its axes.

    Returns
    -------
    dict of str to float
        Largest equivalent stress by hinge [Pa]; empty where the system knows no stress.

    Raises
    ------
    ModelError
        There are more than 12 drives.
    """
    if system.stress is None:
        return {}
    if len(coupled.drives) > MOST_DRIVES:
        raise ModelError(
            f"the ends of at most {MOST_DRIVES} drives are gone through, got {len(coupled.drives)}"
        )
    ends = (system.stress.largest(coupled.shapes @ np.array(w)) for w in product(*coupled.strokes))
    worst: dict[str, float] = {}
    for stress in ends:
        worst = {hinge: max(size, worst.get(hinge, 0.0)) for hinge, size in stress.items()}
    return worst
