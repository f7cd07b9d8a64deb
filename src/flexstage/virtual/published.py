"""What an axis is taken for: as measured and published, else as its model and what is usual."""

from flexstage.characteristic import measured_value
from flexstage.stage import Stage
from flexstage.stage.assumptions import LOOP_WIDTH


def platform_stroke(stage: Stage, axis: str) -> float | None:
    """Return the stroke at the platform [m]: published, else of the lumped model at rest.

    None where the drive says no stroke.

    Examples
    --------
    >>> from dataclasses import replace
    >>> from flexstage.designs import design
    >>> stage = design("vgtu-piezo")
    >>> for known in (stage, replace(stage, published=())):
    ...     print(f"{1e6 * platform_stroke(known, 'x'):.2f} um")
    63.12 um
    67.54 um
    """
    known = measured_value(stage.published, "output_displacement", axis)
    port = stage.axis(axis)
    drive = stage.drive_of(axis)
    stroke = drive.stroke
    if known is not None or stroke is None:
        return known
    from flexstage.lumped import lumped_system
    from flexstage.system import static_displacements

    solution = static_displacements(lumped_system(stage), {drive.name: stroke})
    return abs(float(solution.readings[port.probe]))


def loop_share(stage: Stage, axis: str, stroke: float) -> float:
    """Return the width of an axis's loop over its stroke [1]: published, else usual."""
    width = measured_value(stage.published, "hysteresis_loop_width", axis)
    return LOOP_WIDTH if width is None else width / stroke
