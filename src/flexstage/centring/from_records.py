"""From records of an error over the turn to what is said of the scale: one way for all who ask."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from flexstage.base.arrays import Array
from flexstage.base.errors import RecordError
from flexstage.centring.eccentricity import HeadReadings
from flexstage.centring.requests import MAGNET, CentreRequest
from flexstage.centring.setting import (
    Setting,
    change,
    fit_setting,
    joined,
    report,
)
from flexstage.centring.trial_moves import trial
from flexstage.centring.turns import unwrap_error
from flexstage.files.result import Result
from flexstage.quantities.units import si_unit
from flexstage.records import Channel, Record
from flexstage.records.likely_columns import taken_turn
from flexstage.records.read import read_files
from flexstage.records.read_options import ReadOptions
from flexstage.records.record import column_and_unit


def head_angles(given: Sequence[float], files: int, columns: int) -> list[float]:
    """Return where the head of each column of each file stands [rad]."""
    total = files * columns
    if not given:
        if columns > 1:
            raise RecordError(
                f"--heads must say where the {columns} heads stand, such as --heads "
                f'"{",".join(f"{360 * i / columns:g}" for i in range(columns))}"'
            )
        return [0.0] * total
    if len(given) == total:
        return list(given)
    if len(given) == columns:
        return list(given) * files
    raise RecordError(
        f"--heads must have one angle for each of {columns} columns"
        + (f", or for each of those of {files} files" if files > 1 else "")
        + f", got {len(given)}"
    )


def _si(text: str, counts: float | None, option: str) -> tuple[float, str]:
    """Return how many SI units a unit is, and which."""
    factor, unit = si_unit(text)
    if unit != "count":
        return factor, unit
    if counts is None or not 0.0 < abs(counts) < math.inf:
        raise RecordError(f"{option} is in counts: say by --counts how many there are in a turn")
    return 2.0 * math.pi / counts, "rad"


def head_of(
    record: Record, name: str | int, request: CentreRequest, alpha: float
) -> tuple[HeadReadings, bool]:
    """Return a column of errors with its angles, in SI, and whether an indicator read it.

    Samples are evenly spaced over the turns where there is no column of the angle; `alpha` is where
    the head stands [rad].
    """
    errors = record.channel(name)
    y, unit = _in_si(errors, request, "--error", ("rad",) if request.reading else ("rad", "m"))
    if request.angle is None:
        assert request.turns is not None
        theta = 2.0 * math.pi * request.turns * np.arange(record.size) / record.size
    else:
        theta, _ = _in_si(record.channel(request.angle), request, "--angle", ("rad",))
    if request.reading:
        _require_alike(y, theta, errors.name)
        y = y - theta
    error = request.sign * (unwrap_error(y) if unit == "rad" else y)
    head = HeadReadings(
        angle=theta, error=error, head_angle=alpha, name=errors.name, file=record.source
    )
    return head, unit == "m"


def _require_alike(read: Array, theta: Array, name: str) -> None:
    turn = 2.0 * math.pi
    steps = [np.diff(x) - turn * np.rint(np.diff(x) / turn) for x in (read, theta)]
    if float(steps[0] @ steps[1]) <= 0.0:
        raise RecordError(
            f"what column '{name}' reads falls where the angle rises, or does not go with it: "
            "check the columns, and count one of them the other way, such as by a minus for "
            "--counts"
        )


def doubts(heads: Sequence[HeadReadings]) -> list[str]:
    """Say where an angle looks as if it was in another unit."""
    # 57.3 turns are rare, and 0 to 360 of what are not degrees
    doubtful = [h for h in heads if 330.0 < float(np.ptp(h.angle)) <= 360.5]
    return [
        f"the angle goes over {float(np.ptp(h.angle)):.0f} rad in '{h.file}': if that is in "
        'degrees, say so by --unit deg or behind the column, such as --angle "0 deg"'
        for h in doubtful[:1]
    ]


def _in_si(
    channel: Channel,
    request: CentreRequest,
    option: str,
    allowed: tuple[str, ...],
) -> tuple[Array, str]:
    """Return a column in SI, as it was read, or by the unit for both."""
    known, general, counts = channel.unit, request.unit, request.counts
    if known == "count":
        factor, known = _si("count", counts, f"column '{channel.name}'")
    elif known:
        factor = 1.0
    elif general is None:
        raise RecordError(
            f"nobody says in which unit column '{channel.name}' is: give --unit, or say it behind "
            f'the column, such as {option} "{channel.name} deg"'
        )
    else:
        factor, known = _si(general, counts, f"column '{channel.name}'")
    if known not in allowed:
        raise RecordError(
            f"column '{channel.name}' is in {known}, and must be an angle"
            + (" or a length" if "m" in allowed else "")
            + f": choose another column, or say its unit behind {option}"
        )
    return channel.values * factor, known


def kind_notes(setting: Setting, kind: str | None, sized: bool) -> list[str]:
    """Say what the harmonic of order 1 is, of a scale of that kind."""
    if setting.radial:
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
            "give --radius for the eccentricity and the move, if lines or many poles "
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


@dataclass(frozen=True, slots=True, kw_only=True)
class CentredRecords(Result):
    """What records say of a scale."""

    table_key: ClassVar[str] = "harmonics"

    settings: list[Setting]
    """The scale in each place."""
    reports: list[dict[str, Any]]
    """What is said of each, as plain data."""
    notes: tuple[str, ...]
    """What a reader should know of the records."""
    trial: dict[str, Any] | None
    """How the harmonics follow the positions of the stage, where those were given."""

    def data(self) -> dict[str, Any]:
        result = joined(self.reports, self.notes)
        return result if self.trial is None else result | {"trial": self.trial}


def centre_files(
    files: Sequence[Path], request: CentreRequest, how: ReadOptions = ReadOptions()
) -> CentredRecords:
    """Return what `centre_records` finds in files; columns that are called so are taken of them."""
    said: list[str] = []
    if request.angle is None and not (request.error or request.reading or request.turns):
        angle, errors, *said = taken_turn(files[0], how)
        request = replace(request, angle=angle, error=errors)
    _require_columns(request)
    read = read_files(files, request.columns, options=how, over="point")
    read[0] = replace(read[0], notes=(*said, *read[0].notes))
    return centre_records(read, request)


def centre_records(records: Sequence[Record], options: CentreRequest) -> CentredRecords:
    """Return the eccentricity of a scale and the move that removes it.

    Several records are the heads of one setting if each column has an angle of its own, else
    settings in sequence.
    """
    _require_columns(options)
    names = options.names
    at = head_angles(options.heads, len(records), len(names))
    mirror = -1.0 if options.head_direction == "cw" else 1.0
    pairs = [(record, name) for record in records for name in names]
    found = [
        head_of(record, name, options, alpha * mirror)
        for (record, name), alpha in zip(pairs, at, strict=True)
    ]
    together = len(records) > 1 and len(options.heads) == len(found)
    size = len(found) if together else len(names)
    settings = [_fitted(found[i : i + size], options) for i in range(0, len(found), size)]
    headings = [channel.name for channel in records[0].channels]
    written = column_and_unit(headings, names[0])[1] or options.unit
    reports = [report(s, mirror, options.mounting_angle, written) for s in settings]
    for i in range(1, len(reports)):
        reports[i]["change"] = change(settings[i - 1], settings[i], mirror, written)
    moves = options.stage_at
    if moves and (len(moves) != len(settings) or len(settings) < 3):
        raise RecordError(
            f"--stage-at needs a position for each setting, and three settings at least: got "
            f"{len(moves)} positions and {len(settings)} settings"
        )
    return CentredRecords(
        request=options,
        settings=settings,
        reports=reports,
        notes=(*(note for r in records for note in r.notes), *doubts([head for head, _ in found])),
        trial=None if not moves else trial(settings, moves, options.kind),
    )


def _fitted(found: list[tuple[HeadReadings, bool]], options: CentreRequest) -> Setting:
    if len({radial for _, radial in found}) > 1:
        raise RecordError("the columns of errors must all be angles, or all lengths")
    heads, radial = [head for head, _ in found], found[0][1]
    orders = list(options.orders) or None
    one = fit_setting(heads, radial, options.radius, options.kind, orders, options.outliers)
    # of settings at known positions the kind says nothing that they do not say themselves
    known = bool(options.stage_at)
    more = [] if known else kind_notes(one, options.kind, options.radius is not None)
    return replace(one, notes=tuple(dict.fromkeys((*one.notes, *more))))


def _require_columns(request: CentreRequest) -> None:
    """Refuse a request that leaves columns or angles open, or gives them twice."""
    if request.angle is None and request.turns is None:
        raise RecordError(
            "give the column of the angle by --angle, or, for samples that are evenly spaced, the "
            "number of turns by --turns"
        )
    if request.angle is not None and request.turns is not None:
        raise RecordError("--angle says how many turns there are: leave --turns out")
    if bool(request.error) == bool(request.reading):
        raise RecordError(
            "give the columns of errors by --error, or those of what was read by --reading"
            + (", not both" if request.error else "")
        )
    if request.reading and request.angle is None:
        raise RecordError("--reading needs the true angle beside it: name its column by --angle")
    if request.reading and request.sign != 1:
        raise RecordError("--reading gives errors of angle read less true angle: leave --sign out")
