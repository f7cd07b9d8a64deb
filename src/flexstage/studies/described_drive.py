"""A record of a drive beside the description of that drive: are range and stroke alike."""

from flexstage.errors import StageError
from flexstage.hysteresis import Identification
from flexstage.lumped import lumped_system
from flexstage.stage import PiezoStack, Stage
from flexstage.system import analyse_axis
from flexstage.units import readable

#: A record beyond this many times what the drive takes or moves is not of it as it is described.
_BEYOND = 3.0
#: One of less than this share is of a small part of its range, or of another prefix of the unit.
_SMALL = 1.0 / 100.0


def against_description(
    found: Identification, described: Stage, axis: str | None
) -> tuple[str, ...]:
    """Compare range and stroke of a record with the drive of a stage.

    The axis is the first one where None. Returns a sentence for each that does not suit the drive.
    """
    if not described.axes:
        raise StageError(f"{described.name} has no axis: give it one, or leave --stage out")
    chosen = described.axis(axis) if axis is not None else described.axes[0]
    drive = described.drive_of(chosen.name)
    if not isinstance(drive, PiezoStack):
        raise StageError(
            f"axis '{chosen.name}' of {described.name} is driven by a {drive.kind}, and a piezo "
            "stack is needed: choose another axis, or leave --stage out"
        )
    system = lumped_system(described)
    port = next(a for a in system.axes if a.name == chosen.name)
    # a stack on the stage moves less, and one that is measured by itself does not pass the stage
    strokes = (drive.free_stroke, abs(analyse_axis(system, port).output_displacement))
    low, high = found.measurement.input_range
    of = f"the drive of axis '{chosen.name}' of {described.name}"
    said = []
    if drive.voltage_range is not None:
        takes = (drive.voltage_range[1] - drive.voltage_range[0],)
        said.append(
            _compare("input", high - low, found.model.input_unit, "V", takes, f"{of} takes")
        )
    said.append(
        _compare("output", found.stroke, found.model.output_unit, "m", strokes, f"{of} moves")
    )
    return tuple(sentence for sentence in said if sentence)


def _compare(
    what: str, span: float, unit: str, wanted: str, known: tuple[float, ...], verb: str
) -> str:
    """Say that a span is far from what is known, whichever of it is meant."""
    if unit != wanted:
        own = f"in {unit}" if unit else "without a unit"
        return f"the {what} is {own} and {verb} {wanted}: the two cannot be compared"
    least, most = min(known), max(known)
    if _SMALL * least <= span <= _BEYOND * most:
        return ""
    nearest = most if span > most else least
    times = span / nearest if span > nearest else nearest / span
    return (
        f"the {what} spans {readable(unit, span)} and {verb} {readable(unit, nearest)}, "
        f"{times:.3g} times {'less' if span > nearest else 'more'}: is the unit of the {what} "
        "right, and is it the record of this drive?"
    )
