"""Columns of a record as heads or indicators in SI units, and what is doubtful of them."""

import math
from collections.abc import Sequence

import numpy as np

from flexstage.arrays import Array
from flexstage.centring.setting import Head, Setting
from flexstage.centring.turns import unwrap_error
from flexstage.errors import RecordError
from flexstage.records import Channel, Record
from flexstage.units import parse, si_unit

#: A magnet of one pair of poles on the axis, as `--kind` has it.
MAGNET = "magnet"


def head_angles(text: str | None, files: int, columns: int) -> list[float]:
    """Return where the head of each column of each file stands [rad]."""
    total = files * columns
    if text is None:
        if columns > 1:
            raise RecordError(
                f"--heads must say where the {columns} heads stand, such as --heads "
                f'"{",".join(f"{360 * i / columns:g}" for i in range(columns))}"'
            )
        return [0.0] * total
    given = [parse(word.strip(), "angle", bare_unit="deg") for word in text.split(",")]
    if len(given) == total:
        return given
    if len(given) == columns:
        return given * files
    raise RecordError(
        f"--heads must have one angle for each of {columns} columns"
        + (f", or for each of those of {files} files" if files > 1 else "")
        + f", got {len(given)}"
    )


def each_has_one(text: str, found: Sequence[Head]) -> bool:
    """Say whether every column of every file has an angle of its own."""
    return len(text.split(",")) == len(found)


def spelled(text: str | None) -> str | None:
    """Return a unit as records know it; None for a turn, none of theirs, which is seen to later."""
    return None if text is None or text.strip().lower() in TURN_WORDS else text


#: Words for a turn as a unit.
TURN_WORDS = ("turn", "turns", "rev", "revs", "revolution", "revolutions")


def _si(text: str, counts: float | None, option: str) -> tuple[float, str]:
    """Return how many SI units a unit is, and which."""
    if text.strip().lower() in TURN_WORDS:
        return 2.0 * math.pi, "rad"
    factor, unit = si_unit(text)
    if unit != "count":
        return factor, unit
    if counts is None or not 0.0 < abs(counts) < math.inf:
        raise RecordError(f"{option} is in counts: say by --counts how many there are in a turn")
    return 2.0 * math.pi / counts, "rad"


def head_of(
    record: Record,
    name: str | int,
    angle: str | int | None,
    turns: float | None,
    units: tuple[str | None, str | None, str | None, float | None],
    alpha: float,
    *,
    reading: bool = False,
    sign: int = 1,
) -> Head:
    """Return a column of errors with its angles, in SI.

    Even samples over so many turns where there is no column of the angle. Units are of the angle,
    of the errors, of both, and counts in a turn, as the options say them; `alpha` is where the head
    stands [rad]. With `reading` the column is what the encoder reads, and the errors are that less
    the angle; `sign` is -1 where errors are true angle less angle that was read.
    """
    angle_unit, error_unit, unit, counts = units
    errors = record.channel(name)
    y, what = _values(
        errors, error_unit, unit, counts, "--error-unit", ("rad",) if reading else ("rad", "m")
    )
    if angle is None:
        assert turns is not None
        theta = 2.0 * math.pi * turns * np.arange(record.size) / record.size
    else:
        theta, _ = _values(
            record.channel(angle), angle_unit, unit, counts, "--angle-unit", ("rad",)
        )
    if reading:
        _require_alike(y, theta, errors.name)
        y = y - theta
    return Head(
        name=errors.name,
        file=record.source,
        angle=theta,
        error=sign * (unwrap_error(y) if what == "rad" else y),
        head_angle=alpha,
        radial=what == "m",
    )


def _require_alike(read: Array, theta: Array, name: str) -> None:
    turn = 2.0 * math.pi
    steps = [np.diff(x) - turn * np.rint(np.diff(x) / turn) for x in (read, theta)]
    if float(steps[0] @ steps[1]) <= 0.0:
        raise RecordError(
            f"what column '{name}' reads falls where the angle rises, or does not go with it: "
            "check the columns, and count one of them the other way, such as by a minus for "
            "--counts"
        )


def doubts(heads: Sequence[Head]) -> list[str]:
    """Say where an angle looks as if it was in another unit."""
    # 57.3 turns are rare, and 0 to 360 of what are not degrees
    doubtful = [h for h in heads if 330.0 < float(np.ptp(h.angle)) <= 360.5]
    return [
        f"the angle goes over {float(np.ptp(h.angle)):.0f} rad in '{h.file}': if that is in "
        "degrees, say so by --unit deg or --angle-unit deg"
        for h in doubtful[:1]
    ]


def _values(
    channel: Channel,
    own: str | None,
    general: str | None,
    counts: float | None,
    option: str,
    allowed: tuple[str, ...],
) -> tuple[Array, str]:
    """Return a column in SI, by its own option, by the file, by the option for both."""
    known = channel.unit
    if own is not None and spelled(own) is None:
        factor, known = 2.0 * math.pi, "rad"
    elif known == "count":
        factor, known = _si("count", counts, f"column '{channel.name}'")
    elif known:
        factor = 1.0
    elif general is None:
        raise RecordError(
            f"nobody says in which unit column '{channel.name}' is: give --unit or {option}, such "
            f"as {option} deg"
        )
    else:
        factor, known = _si(general, counts, f"column '{channel.name}'")
    if known not in allowed:
        raise RecordError(
            f"column '{channel.name}' is in {known}, and must be an angle"
            + (" or a length" if "m" in allowed else "")
            + f": choose another column, or say its unit by {option}"
        )
    return channel.values * factor, known


def kind_notes(setting: Setting, kind: str | None, sized: bool) -> list[str]:
    """Say what the harmonic of order 1 is, of a scale of that kind."""
    if setting.heads[0].radial:
        return []
    if kind == MAGNET:
        return [
            "of a magnet on the axis that a few probes read, order 1 is that of offsets of their "
            "signals as well, and in which orders eccentricity shows hangs on how the probes are "
            "joined: no move follows from one record; measure at four positions of the stage or "
            "more, and give them by --stage-at"
        ]
    if not sized:
        return [
            "give --radius or --diameter for the eccentricity and the move, if lines or many poles "
            "are read there; order 1 of a magnet on the axis is no eccentricity alone"
        ]
    if setting.like_magnet:
        return [
            "order 2 is larger than order 1, as of a magnet on the axis, whose order 1 is no "
            "eccentricity alone: no move is given; say --kind disc or drum if lines or many poles "
            "are read at the radius"
        ]
    if kind is None:
        return [
            "taken for a disc, of lines or many poles that are read at the radius: of a magnet on "
            "the axis order 1 is no eccentricity alone; --kind says which"
        ]
    return []
