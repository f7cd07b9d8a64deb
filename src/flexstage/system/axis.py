"""One axis of a stage over the stroke of its drive."""

from dataclasses import dataclass

from flexstage.errors import ModelError
from flexstage.short_repr import short_repr
from flexstage.system.mechanical import AxisPort, MechanicalSystem
from flexstage.system.statics import StaticSolution, drive_stiffness, static_displacements


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class AxisAnalysis:
    """What one drive does to the stage over its stroke, the other drives removed."""

    axis: str
    """Name of the axis."""
    drive: str
    """Its drive."""
    probe: str
    """Its probe."""
    input_displacement: float
    """Elongation of the drive [m]."""
    output_displacement: float
    """Reading of the probe [m]."""
    input_stiffness: float
    """Force of the drive over its elongation [N/m]."""
    static: StaticSolution
    """The whole state."""

    __repr__ = short_repr


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
        The drive has neither a stroke nor a largest force.
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
        drive=axis.drive,
        probe=axis.probe,
        input_displacement=stroke,
        output_displacement=static.readings[axis.probe],
        input_stiffness=static.drive_force[axis.drive] / stroke,
        static=static,
    )
