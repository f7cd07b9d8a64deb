"""`flexstage centre`: eccentricity of a scale on a turning table, and the move that removes it."""

import math
from dataclasses import replace
from pathlib import Path
from typing import Annotated

import typer

from flexstage.cli.centre_heads import (
    MAGNET,
    doubts,
    each_has_one,
    head_angles,
    head_of,
    kind_notes,
    orders_of,
    radius_of,
    spelled,
)
from flexstage.cli.centre_report import change, joined, print_setting, report
from flexstage.cli.centre_trial import positions_of, print_trial, trial
from flexstage.cli.options import JsonOption, from_docstring, quantity
from flexstage.cli.output import (
    FigureFile,
    console,
    picture,
    print_json,
    print_notes,
    write_file,
)
from flexstage.cli.reading import (
    WHOLE_FILE,
    FileOptions,
    read_records,
)
from flexstage.errors import ModelError, RecordError
from flexstage.records.selectors import column

_DIRECTIONS = ("ccw", "cw")


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
        true angle; or, in a unit of length, the readings of indicators on the rim.
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
    from flexstage.centring.setting import fit_setting

    _require(figure, sign, head_direction, kind, angle, turns)
    names = _columns(error, reading, angle, sign)
    size_of_scale = radius_of(radius, diameter)
    mounted = quantity(mount_angle, "angle", bare_unit="deg")
    if kind == MAGNET and size_of_scale is not None:
        raise ModelError(
            "a magnet on the axis has no radius that its error could be turned into micrometres "
            "by, and its harmonic of order 1 is that of offsets of its signals as well: leave "
            "--radius and --diameter out, and find the gain by trial moves (--stage-at)"
        )
    wanted = names if angle is None else [column(angle), *names]
    own = [] if angle is None else [spelled(angle_unit)]
    read = read_records(
        records,
        wanted,
        units=[*own, *[spelled(error_unit)] * len(names)],
        sample_rate=None,
        time=None,
        over="point",
        **vars(how),
    )
    at = head_angles(heads, len(read), len(names))
    mirror = -1.0 if head_direction == "cw" else 1.0
    found = [
        head_of(
            record,
            name,
            None if angle is None else column(angle),
            turns,
            units,
            alpha * mirror,
            reading=reading is not None,
            sign=sign,
        )
        for units in [(angle_unit, error_unit, unit, counts)]
        for (record, name), alpha in zip(
            [(record, name) for record in read for name in names], at, strict=True
        )
    ]
    size = (
        len(found)
        if len(read) > 1 and heads is not None and each_has_one(heads, found)
        else len(names)
    )
    settings = []
    for i in range(0, len(found), size):
        one = fit_setting(found[i : i + size], size_of_scale, kind, orders_of(orders), outliers)
        # of settings at known positions the kind says nothing that they do not say themselves
        more = [] if stage_at is not None else kind_notes(one, kind, size_of_scale is not None)
        settings.append(replace(one, notes=tuple(dict.fromkeys((*one.notes, *more)))))
    written = error_unit or unit
    reports = [report(s, mirror, mounted, written) for s in settings]
    for i in range(1, len(reports)):
        reports[i]["change"] = change(settings[i - 1], settings[i], mirror, written)
    notes = (*(note for r in read for note in r.notes), *doubts(found))
    result = joined(reports, notes)
    if stage_at is not None:
        result["trial"] = trial(settings, positions_of(stage_at, len(settings)), kind)
    if figure is not None:
        from flexstage.report.figures.centring import draw_polar

        drawn = draw_polar([s.fits[0] for s in settings], [s.heads[0].angle for s in settings])
        write_file(figure, picture(figure, drawn))
        result["files"] = [str(figure)]
    if json:
        print_json(result)
        return
    for one in reports:
        print_setting(one)
    if stage_at is not None:
        print_trial(result["trial"])
    print_notes(console(), notes, [] if figure is None else [figure])


def _columns(
    error: str | None, reading: str | None, angle: str | None, sign: int
) -> list[str | int]:
    """Return the columns that --error or --reading names."""
    if (error is None) == (reading is None):
        raise RecordError(
            "give the columns of errors by --error, or those of what was read by --reading"
            + ("" if error is None else ", not both")
        )
    if reading is not None and angle is None:
        raise RecordError("--reading needs the true angle beside it: name its column by --angle")
    if reading is not None and sign != 1:
        raise RecordError("--reading gives errors of angle read less true angle: leave --sign out")
    names = [column(word) for word in (error or reading or "").split(",") if word.strip()]
    if not names:
        raise RecordError(f"--{'error' if reading is None else 'reading'} must name a column")
    return names


def _require(
    figure: Path | None,
    sign: int,
    direction: str,
    kind: str | None,
    angle: str | None,
    turns: float | None,
) -> None:
    from flexstage.centring.geometry import SCALE_KINDS

    if sign not in (1, -1):
        raise ModelError(f"--sign must be 1 or -1, got {sign}")
    if direction not in _DIRECTIONS:
        raise ModelError(f"--head-direction must be ccw or cw, got '{direction}'")
    kinds = (*SCALE_KINDS, MAGNET)
    if kind is not None and kind not in kinds:
        raise ModelError(f"--kind must be one of {', '.join(kinds)}, got '{kind}'")
    if angle is None and turns is None:
        raise RecordError(
            "give the column of the angle by --angle, or, for samples that are evenly spaced, the "
            "number of turns by --turns"
        )
    if angle is not None and turns is not None:
        raise RecordError("--angle says how many turns there are: leave --turns out")
    if turns is not None and not 0.9 <= turns < math.inf:
        raise RecordError(f"--turns must be 0.9 or more, got {turns:g}")
