"""The figures that an engineer quotes of a stage, from one analysed axis."""

import numpy as np

from flexstage.characteristic import QUANTITIES, Characteristic
from flexstage.stage import Stage
from flexstage.system.axis import AxisAnalysis
from flexstage.system.mechanical import MechanicalSystem
from flexstage.system.modes import Modes

__all__ = ["axis_characteristics", "axis_mode"]


def axis_mode(system: MechanicalSystem, result: Modes, drive: str, probe: str) -> int:
    r"""Return the mode by which a drive moves a probe.

    It is the one that gives most of the static response, by
    :math:`|p^T\phi\,\phi^T d|/\omega^2`.

    Parameters
    ----------
    system : MechanicalSystem
        The system.
    result : Modes
        Its modes.
    drive : str
        The drive.
    probe : str
        The probe.

    Returns
    -------
    int
        Index into the modes.
    """
    p = system.probe(probe).vector @ result.shapes
    d = system.drive(drive).vector @ result.shapes
    with np.errstate(divide="ignore", invalid="ignore"):
        return int(np.nanargmax(np.abs(p * d) / result.omega**2))


def axis_characteristics(
    stage: Stage, system: MechanicalSystem, axis: AxisAnalysis, removed: Modes
) -> list[Characteristic]:
    """Return the characteristics of one axis.

    Parameters
    ----------
    stage : Stage
        The stage.
    system : MechanicalSystem
        The model.
    axis : AxisAnalysis
        The axis at full stroke.
    removed : Modes
        Modes with the drives removed.

    Returns
    -------
    list of Characteristic
        Stroke, ratio, stress, safety, resolution, frequency, coupling, rotation, stiffness.
    """
    ratio = axis.output_displacement / axis.input_displacement
    others = [a for a in system.axes if a.name != axis.axis]
    static = axis.static
    port = system.drive(axis.drive)
    rows: list[Characteristic] = []

    def add(quantity: str, value: float, note: str) -> None:
        rows.append(
            Characteristic(
                quantity=quantity,
                axis=axis.axis,
                origin=system.model,
                value=float(value),
                unit=QUANTITIES[quantity],
                note=note,
            )
        )

    pushed = "imposed" if port.stroke is not None else "at its largest force"
    add("input_displacement", axis.input_displacement, f"elongation of the drive, {pushed}")
    add(
        "output_displacement",
        axis.output_displacement,
        f"probe '{axis.probe}', other drives removed",
    )
    add("transmission_ratio", ratio, "output over input displacement")
    if static.hinge_stress:
        worst = max(static.hinge_stress, key=lambda k: static.hinge_stress[k])
        stress = static.hinge_stress[worst]
        add("max_stress", stress, f"equivalent stress at hinge '{worst}', full stroke")
        if stage.material.yield_strength is not None and stress > 0.0:
            add("safety_factor", stage.material.yield_strength / stress, "against yield")
    if port.smallest_displacement is not None:
        add(
            "resolution",
            abs(ratio) * port.smallest_displacement,
            "smallest step of the drive times ratio",
        )
    mode = axis_mode(system, removed, axis.drive, axis.probe)
    add("natural_frequency_hz", removed.frequency_hz[mode], f"mode {mode + 1}, drives removed")
    if others and axis.output_displacement != 0.0:
        cross = [static.readings[a.probe] / axis.output_displacement for a in others]
        add(
            "cross_coupling", max(cross, key=abs), "reading of the other axis over that of this one"
        )
    body = system.probe(axis.probe).body
    if body in static.body_motion:
        add("parasitic_rotation", static.body_motion[body][2], f"of body '{body}' at full stroke")
    add("input_stiffness", axis.input_stiffness, "force of the drive over its elongation")
    return rows
