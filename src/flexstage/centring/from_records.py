"""From records of an error over the turn to what is said of the scale: one way for all who ask."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from flexstage.arrays import Array
from flexstage.centring.geometry import SCALE_KINDS
from flexstage.centring.setting import (
    MAGNET,
    TURN_WORDS,
    Head,
    Setting,
    change,
    fit_setting,
    joined,
    report,
)
from flexstage.centring.trial_moves import trial
from flexstage.centring.turns import unwrap_error
from flexstage.errors import ModelError, RecordError
from flexstage.records import Channel, Record
from flexstage.records.reading_options import column, column_list
from flexstage.units import parse, si_unit


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
    y, what = _in_si(
        errors, error_unit, unit, counts, "--error-unit", ("rad",) if reading else ("rad", "m")
    )
    if angle is None:
        assert turns is not None
        theta = 2.0 * math.pi * turns * np.arange(record.size) / record.size
    else:
        theta, _ = _in_si(record.channel(angle), angle_unit, unit, counts, "--angle-unit", ("rad",))
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


def _in_si(
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


_DIRECTIONS = ("ccw", "cw")


@dataclass(frozen=True, slots=True, kw_only=True)
class CentreOptions:
    """Which columns of records are the error of a scale, where its heads stand, and what it is.

    Raises
    ------
    ModelError
        Options say what there is not, or do not belong together.
    RecordError
        Columns or turns are missing, or said twice.
    """

    error: str | None = None
    """Columns of errors, separated by commas."""
    reading: str | None = None
    """Columns of readings instead, of which the true angle is taken away."""
    angle: str | None = None
    """Column of the true angle."""
    unit: str | None = None
    """Unit of both."""
    angle_unit: str | None = None
    """Unit of the angle."""
    error_unit: str | None = None
    """Unit of errors or readings."""
    counts: float | None = None
    """Counts in a turn."""
    heads: str | None = None
    """Where the heads stand, separated by commas."""
    radius: float | None = None
    """Radius at which the scale is read [m]."""
    kind: str | None = None
    """disc, drum or magnet."""
    orders: Sequence[int] | None = None
    """Orders that are fitted."""
    turns: float | None = None
    """Number of turns, without a column of the angle."""
    sign: int = 1
    """-1 where errors are true angle less angle that was read."""
    head_direction: str = "ccw"
    """How the heads travel round the scale, ccw or cw."""
    stage_at: Sequence[tuple[float, float]] | None = None
    """Where the stage stood at each setting [m]."""
    mount: float = 0.0
    """Direction of the stage's x axis in the frame that turns with the table [rad]."""
    outliers: bool = True
    """Whether outliers are found and set aside."""

    def __post_init__(self) -> None:
        kinds = (*SCALE_KINDS, MAGNET)
        if self.sign not in (1, -1):
            raise ModelError(f"--sign must be 1 or -1, got {self.sign}")
        if self.head_direction not in _DIRECTIONS:
            raise ModelError(f"--head-direction must be ccw or cw, got '{self.head_direction}'")
        if self.kind is not None and self.kind not in kinds:
            raise ModelError(f"--kind must be one of {', '.join(kinds)}, got '{self.kind}'")
        _require_angle(self.angle, self.turns)
        _require_columns(self)
        if self.kind == MAGNET and self.radius is not None:
            raise ModelError(
                "a magnet on the axis has no radius that its error could be turned into "
                "micrometres by, and its harmonic of order 1 is that of offsets of its signals as "
                "well: leave --radius and --diameter out, and find the gain by trial moves "
                "(--stage-at)"
            )

    @property
    def names(self) -> list[str | int]:
        """The columns of errors or readings."""
        return column_list(self.error or self.reading)

    @property
    def columns(self) -> list[str | int]:
        """The columns that are read."""
        return self.names if self.angle is None else [column(self.angle), *self.names]

    @property
    def units(self) -> list[str | None]:
        """The unit of each of them, where records know it."""
        own = [] if self.angle is None else [spelled(self.angle_unit)]
        return [*own, *[spelled(self.error_unit)] * len(self.names)]


@dataclass(frozen=True, slots=True, kw_only=True)
class CentredRecords:
    """What records say of a scale."""

    settings: list[Setting]
    """The scale in each place."""
    reports: list[dict[str, Any]]
    """What is said of each, as plain data."""
    notes: tuple[str, ...]
    """What a reader should know of the records."""
    trial: dict[str, Any] | None
    """How the harmonics follow the positions of the stage, where those were given."""

    @property
    def result(self) -> dict[str, Any]:
        """All of it as plain data, as `flexstage centre --json` prints it."""
        result = joined(self.reports, self.notes)
        return result if self.trial is None else result | {"trial": self.trial}


def centre_records(records: Sequence[Record], options: CentreOptions) -> CentredRecords:
    """Return the eccentricity of a scale and the move that removes it.

    Several records are the heads of one setting if each column has an angle of its own, else
    settings in sequence.
    """
    names = options.names
    at = head_angles(options.heads, len(records), len(names))
    mirror = -1.0 if options.head_direction == "cw" else 1.0
    units = (options.angle_unit, options.error_unit, options.unit, options.counts)
    pairs = [(record, name) for record in records for name in names]
    found = [
        head_of(
            record,
            name,
            None if options.angle is None else column(options.angle),
            options.turns,
            units,
            alpha * mirror,
            reading=options.reading is not None,
            sign=options.sign,
        )
        for (record, name), alpha in zip(pairs, at, strict=True)
    ]
    together = len(records) > 1 and options.heads and each_has_one(options.heads, found)
    size = len(found) if together else len(names)
    settings = [_fitted(found[i : i + size], options) for i in range(0, len(found), size)]
    written = options.error_unit or options.unit
    reports = [report(s, mirror, options.mount, written) for s in settings]
    for i in range(1, len(reports)):
        reports[i]["change"] = change(settings[i - 1], settings[i], mirror, written)
    moves = options.stage_at
    if moves is not None and (len(moves) != len(settings) or len(settings) < 3):
        raise RecordError(
            f"--stage-at needs a position for each setting, and three settings at least: got "
            f"{len(moves)} positions and {len(settings)} settings"
        )
    return CentredRecords(
        settings=settings,
        reports=reports,
        notes=(*(note for r in records for note in r.notes), *doubts(found)),
        trial=None if moves is None else trial(settings, moves, options.kind),
    )


def _fitted(heads: list[Any], options: CentreOptions) -> Setting:
    orders = None if options.orders is None else list(options.orders)
    one = fit_setting(heads, options.radius, options.kind, orders, options.outliers)
    # of settings at known positions the kind says nothing that they do not say themselves
    known = options.stage_at is not None
    more = [] if known else kind_notes(one, options.kind, options.radius is not None)
    return replace(one, notes=tuple(dict.fromkeys((*one.notes, *more))))


def _require_columns(options: CentreOptions) -> None:
    error, reading = options.error, options.reading
    if (error is None) == (reading is None):
        raise RecordError(
            "give the columns of errors by --error, or those of what was read by --reading"
            + ("" if error is None else ", not both")
        )
    if reading is not None and options.angle is None:
        raise RecordError("--reading needs the true angle beside it: name its column by --angle")
    if reading is not None and options.sign != 1:
        raise RecordError("--reading gives errors of angle read less true angle: leave --sign out")
    if not options.names:
        raise RecordError(f"--{'error' if reading is None else 'reading'} must name a column")


def _require_angle(angle: str | None, turns: float | None) -> None:
    if angle is None and turns is None:
        raise RecordError(
            "give the column of the angle by --angle, or, for samples that are evenly spaced, the "
            "number of turns by --turns"
        )
    if angle is not None and turns is not None:
        raise RecordError("--angle says how many turns there are: leave --turns out")
    if turns is not None and not 0.9 <= turns < math.inf:
        raise RecordError(f"--turns must be 0.9 or more, got {turns:g}")
