"""`flexstage centre`: eccentricity of a scale on a turning table, and the move that removes it."""

from dataclasses import replace
from pathlib import Path
from typing import Annotated

import typer

from flexstage.cli.centre_report import print_setting, print_trial
from flexstage.cli.options import JsonOption, from_docstring, positive_length, quantity, refuse
from flexstage.cli.output import (
    FigureFile,
    console,
    print_json,
    print_notes,
    write_picture,
)
from flexstage.cli.reading import WHOLE_FILE, FileOptions, read_records
from flexstage.errors import RecordError


@from_docstring
def centre(
    records: Annotated[list[Path], typer.Argument()],
    error: str | None = None,
    reading: str | None = None,
    angle: str | None = None,
    unit: str | None = None,
    angle_unit: str | None = None,
    error_unit: str | None = None,
    counts: float | None = None,
    heads: str | None = None,
    radius: str | None = None,
    diameter: str | None = None,
    kind: str | None = None,
    orders: str | None = None,
    turns: float | None = None,
    sign: int = 1,
    head_direction: str = "ccw",
    stage_at: str | None = None,
    mount_angle: str = "0 deg",
    outliers: bool = True,
    how: FileOptions = WHOLE_FILE,
    figure: FigureFile = None,
    json: JsonOption = False,
) -> None:
    """Find a scale's eccentricity and the move that removes it.

    The harmonics of the error over the turn are fitted; that of order 1 gives the eccentricity.

    Parameters
    ----------
    records
        FILE...: Records of the error over the angle of the table. Several files are the heads of
        one setting if --heads has an angle for each, else settings in sequence.
    error
        COLUMN,...: Numbers or names of the error columns, one for each head: angle reading minus
        true angle; or, in a unit of length, the readings of indicators on the rim (default: with
        none of these options, what is called angle and error).
    reading
        COLUMN,...: Instead of --error: columns of the readings of the heads, wrapped at a turn or
        not; the true angle is subtracted.
    angle
        COLUMN: Number or name of the column of the true angle, wrapped or not (default: samples are
        evenly spaced over --turns).
    unit
        UNIT: Unit of angle and error if neither the file nor --angle-unit and --error-unit give it,
        such as "deg", "rad", "arcsec", "turn" or "count"; harmonics are printed in it.
    angle_unit
        UNIT: Unit of the angle.
    error_unit
        UNIT: Unit of the errors, or of the readings.
    counts
        NUMBER: Counts per turn, for columns in counts.
    heads
        ANGLES: Angles of the heads or indicators in the room, bare numbers in degrees, such as
        "0,90,180,270".
    radius
        LENGTH: Radius at which the scale is read, such as "50 mm"; needed for the eccentricity.
    diameter
        LENGTH: Diameter, instead of --radius.
    kind
        disc|drum|magnet: disc (default): radial lines or poles on a face, read at the radius; drum:
        lines or poles parallel to the axis on a rim; magnet: one pair of poles on the axis, whose
        harmonic of order 1 is not eccentricity alone.
    orders
        RANGE: Orders to fit, such as "1:12" or "1,2,4" (default: 1:12, or fewer if there are few
        samples).
    turns
        NUMBER: Number of turns in the record, if there is no --angle.
    sign
        1|-1: -1 if the errors are true angle minus angle reading: all printed and drawn values
        change their sign.
    head_direction
        ccw|cw: Direction in which the heads travel round the scale as the angle grows, seen in the
        frame x, y that turns with the table; head angles count in this direction. Over a table that
        turns counter-clockwise they travel cw.
    stage_at
        X,Y;...: Positions of the stage at each setting, bare numbers in um, such as "0,0; 20,0;
        0,20; 20,20": gives the orders that follow the moves, their gain, and the centre, for any
        scale and without a radius.
    mount_angle
        ANGLE: Direction of the x axis of the stage in the frame that turns with the table, such as
        "30 deg"; a bare number is in degrees.
    outliers
        --outliers/--no-outliers: Find outliers, report them, and exclude them.
    figure
        Draw the error over the turn and its harmonics. (.svg, .png or .pdf)
    """
    from flexstage.centring.from_records import CentreOptions, centre_records
    from flexstage.report.figures.centring import draw_polar

    said: list[str] = []
    if not (angle or error or reading or turns):
        from flexstage.records.likely_columns import taken_turn
        from flexstage.records.sampling import row_range

        of_rows = row_range(how.rows, "--rows")
        angle, error, *said = taken_turn(records[0], **{**vars(how), "rows": of_rows})
    options = CentreOptions(
        error=error,
        reading=reading,
        angle=angle,
        unit=unit,
        angle_unit=angle_unit,
        error_unit=error_unit,
        counts=counts,
        heads=heads,
        radius=_radius_of(radius, diameter),
        kind=kind,
        orders=_orders_of(orders),
        turns=turns,
        sign=sign,
        head_direction=head_direction,
        stage_at=None if stage_at is None else _positions_of(stage_at),
        mount=quantity(mount_angle, "angle", bare_unit="deg"),
        outliers=outliers,
    )
    read = read_records(
        records,
        options.columns,
        units=options.units,
        sample_rate=None,
        time=None,
        over="point",
        **vars(how),
    )
    read[0] = replace(read[0], notes=(*said, *read[0].notes))
    found = centre_records(read, options)
    result = found.result
    fits, angles = zip(*((s.fits[0], s.heads[0].angle) for s in found.settings), strict=True)
    if files := write_picture(figure, lambda: draw_polar(fits, angles)):
        result["files"] = [str(figure)]
    if json:
        print_json(result)
        return
    for one in found.reports:
        print_setting(one)
    if found.trial is not None:
        print_trial(found.trial)
    print_notes(console(), found.notes, files)


def _radius_of(radius: str | None, diameter: str | None) -> float | None:
    """Return the radius that options give [m]."""
    refuse(radius is not None and diameter is not None, "give --radius or --diameter, not both")
    if diameter is not None:
        return 0.5 * positive_length(diameter, "the diameter of the scale", "mm")
    return None if radius is None else positive_length(radius, "the radius of the scale", "mm")


def _orders_of(text: str | None) -> list[int] | None:
    """Return the orders that an option gives; None where nothing was given."""
    if text is None:
        return None
    words = [word.strip() for word in text.replace(":", ",").split(",")]
    known = all(word.isdecimal() and 1 <= int(word) <= 10_000 for word in words)
    refuse(not known, f'--orders must be such as "1:12" or "1,2,4", got \'{text}\'', RecordError)
    given = [int(word) for word in words]
    if ":" not in text:
        return given if "," in text else list(range(1, given[0] + 1))
    sentence = f"--orders must be a range such as \"1:12\", got '{text}'"
    refuse(len(given) != 2 or given[0] > given[1], sentence, RecordError)
    return list(range(given[0], given[1] + 1))


def _positions_of(text: str) -> list[tuple[float, float]]:
    """Return the positions x, y of the stage [m] that --stage-at gives."""
    pairs = [pair.split(",") for pair in text.split(";") if pair.strip()]
    refuse(
        any(len(pair) != 2 for pair in pairs),
        f"--stage-at gives x,y for each setting, such as '0,0; 20,0; 0,20' in um, got '{text}'",
        RecordError,
    )
    x, y = ([quantity(p[k].strip(), "length", bare_unit="um") for p in pairs] for k in (0, 1))
    return list(zip(x, y, strict=True))
