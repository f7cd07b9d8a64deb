"""Analysis of records of a scale's error, the same for the command, the panel and Python."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, ClassVar, TypeVar

import numpy as np

from flexstage.base.arrays import Array
from flexstage.base.errors import RecordError
from flexstage.centring.calibration_moves import calibrate_moves
from flexstage.centring.eccentricity import HeadReadings, with_resolution
from flexstage.centring.requests import MAGNET, CentreRequest, TurnRequest
from flexstage.centring.setup import Setup, change, fit_setup, joined, report
from flexstage.centring.table_file import read_table
from flexstage.centring.turns import code_faults, unwrap_error
from flexstage.files.result import Result
from flexstage.quantities.units import si_unit
from flexstage.records import Channel, Record
from flexstage.records.contents import default_turn_columns
from flexstage.records.read import read_files
from flexstage.records.read_options import ReadOptions
from flexstage.records.record import column_and_unit

TurnRequestT = TypeVar("TurnRequestT", bound=TurnRequest)


def head_angles(angles: Sequence[float], files: int, columns: int) -> list[float]:
    """Return the angle of the head of each column of each file [rad]."""
    total = files * columns
    if not angles:
        if columns > 1:
            raise RecordError(
                f"--heads must give the angles of the {columns} heads, such as --heads "
                f'"{",".join(f"{360 * i / columns:g}" for i in range(columns))}"'
            )
        return [0.0] * total
    if len(angles) == total:
        return list(angles)
    if len(angles) == columns:
        return list(angles) * files
    raise RecordError(
        f"--heads must have one angle for each of {columns} columns"
        + (f", or for each column of each of {files} files" if files > 1 else "")
        + f", got {len(angles)}"
    )


def _si(text: str, counts: float | None, option: str) -> tuple[float, str]:
    """Return the size of a unit in SI units, and the SI unit."""
    factor, unit = si_unit(text)
    if unit != "count":
        return factor, unit
    if counts is None or not 0.0 < abs(counts) < math.inf:
        raise RecordError(f"{option} is in counts: give the counts per turn by --counts")
    return 2.0 * math.pi / counts, "rad"


def head_of(
    record: Record, name: str | int, request: TurnRequest, alpha: float
) -> tuple[HeadReadings, bool]:
    """Return a column of errors with its angles, in SI, and whether an indicator read it.

    Samples are evenly spaced over the turns if there is no column of the angle; `alpha` is the
    angle of the head [rad].
    """
    errors = record.channel(name)
    y, unit = _in_si(errors, request, "--error", ("rad",) if request.reading else ("rad", "m"))
    if request.angle is None:
        assert request.turns is not None
        theta = 2.0 * math.pi * request.turns * np.arange(record.size) / record.size
    else:
        theta, _ = _in_si(record.channel(request.angle), request, "--angle", ("rad",))
    if request.reading:
        _require_same_sense(y, theta, errors.name)
        y = y - theta
    error = request.sign * (unwrap_error(y) if unit == "rad" else y)
    head = HeadReadings(
        angle=theta, error=error, head_angle=alpha, name=errors.name, file=record.source,
        step=_code_step(errors, request),
    )  # fmt: skip
    return head, unit == "m"


def _code_step(column: Channel, request: TurnRequest) -> float:
    """Return the step of the codes of a column of readings [rad]; 0 if it is not in counts."""
    counts = request.counts
    in_counts = column.unit == "count" or (not column.unit and request.unit == "count")
    return 2.0 * math.pi / abs(counts) if request.reading and in_counts and counts else 0.0


def _code_notes(record: Record, name: str | int, request: CentreRequest) -> list[str]:
    """Return notes on the codes of a column of readings in counts."""
    counts, angle, column = request.counts, request.angle, record.channel(name)
    if not counts or angle is None or _code_step(column, request) == 0.0:
        return []
    if counts != int(counts) or counts < 2:
        return []
    theta, _ = _in_si(record.channel(angle), request, "--angle", ("rad",))
    faults = code_faults(theta, column.values, int(counts))
    return [f"column '{column.name}': {fault}" for fault in faults]


def _require_same_sense(read: Array, theta: Array, name: str) -> None:
    turn = 2.0 * math.pi
    steps = [np.diff(x) - turn * np.rint(np.diff(x) / turn) for x in (read, theta)]
    if float(steps[0] @ steps[1]) <= 0.0:
        raise RecordError(
            f"the readings of column '{name}' decrease where the angle increases, or do not follow "
            "it: check the columns, and reverse the sign of one of them, such as by a negative "
            "--counts"
        )


def unit_warnings(heads: Sequence[HeadReadings]) -> list[str]:
    """Warn of an angle that is probably in another unit."""
    # 57.3 turns are rare, and so is a range from 0 to 360 of anything but degrees
    doubtful = [h for h in heads if 330.0 < float(np.ptp(h.angle)) <= 360.5]
    return [
        f"the angle spans {float(np.ptp(h.angle)):.0f} rad in '{h.file}': if it is in degrees, "
        'add --unit deg, or give the unit after the column, such as --angle "0 deg"'
        for h in doubtful[:1]
    ]


def _in_si(
    channel: Channel,
    request: TurnRequest,
    option: str,
    allowed: tuple[str, ...],
) -> tuple[Array, str]:
    """Return a column in SI, by its own unit or else by the unit of the request."""
    unit, request_unit, counts = channel.unit, request.unit, request.counts
    if unit == "count":
        factor, unit = _si("count", counts, f"column '{channel.name}'")
    elif unit:
        factor = 1.0
    elif request_unit is None:
        raise RecordError(
            f"column '{channel.name}' has no unit: give --unit, or the unit after the column, "
            f'such as {option} "{channel.name} deg"'
        )
    else:
        factor, unit = _si(request_unit, counts, f"column '{channel.name}'")
    if unit not in allowed:
        raise RecordError(
            f"column '{channel.name}' is in {unit}, but must be an angle"
            + (" or a length" if "m" in allowed else "")
            + f": choose another column, or give its unit in {option}"
        )
    return channel.values * factor, unit


def kind_notes(setup: Setup, kind: str | None, sized: bool) -> list[str]:
    """Return notes on the meaning of the harmonic of order 1 for that kind of scale."""
    if setup.radial:
        return []
    if kind == MAGNET:
        return [
            "for an on-axis magnet, signal offsets of the probes also contribute to order 1, and "
            "the orders that show eccentricity depend on how the probes are combined: one record "
            "gives no move; measure at four or more positions of the stage, and give them by "
            "--stage-at"
        ]
    if not sized:
        return [
            "give --radius for the eccentricity and the move, if lines or many poles are read at "
            "that radius; for an on-axis magnet order 1 is not only eccentricity"
        ]
    if setup.like_magnet:
        return [
            "order 2 is larger than order 1, as for an on-axis magnet, where order 1 is not only "
            "eccentricity: no move is given; use --kind disc or --kind drum if lines or many poles "
            "are read at the radius"
        ]
    if kind is None:
        return [
            "assumed a disc (--kind disc), with lines or many poles read at the radius; for an "
            "on-axis magnet (--kind magnet) order 1 is not only eccentricity"
        ]
    return []


@dataclass(frozen=True, slots=True, kw_only=True)
class CentredRecords(Result):
    """Harmonics, eccentricity and move of a scale, from records."""

    table_key: ClassVar[str] = "harmonics"

    setups: list[Setup]
    """The scale in each setup."""
    reports: list[dict[str, Any]]
    """Report of each setup, as plain data."""
    notes: tuple[str, ...]
    """Remarks on the records."""
    trial: dict[str, Any] | None
    """Response of the harmonics to the positions of the stage, if these are known."""

    def data(self) -> dict[str, Any]:
        result = joined(self.reports, self.notes)
        return result if self.trial is None else result | {"trial": self.trial}


def with_table(request: CentreRequest) -> CentreRequest:
    """Return a request with heads, radius, kind and mounting angle of its table."""
    if request.table is None:
        return request
    described = [
        option
        for option, value in (
            ("--heads", request.heads),
            ("--radius", request.radius),
            ("--kind", request.kind),
            ("--mounting-angle", request.mounting_angle),
        )
        if value
    ]
    if described:
        raise RecordError(f"--table describes {described[0]} already: omit one of them")
    table = read_table(request.table)
    columns, heads = len(request.names), len(table.heads.angles)
    if columns and columns != heads:
        raise RecordError(
            f"table '{table.name}' has {heads} heads, but --error or --reading names {columns} "
            "columns: name one for each head"
        )
    return replace(
        request,
        heads=table.heads.angles,
        radius=table.scale.radius,
        kind=table.scale.kind,
        mounting_angle=table.mounting_angle,
    )


def read_turns(
    files: Sequence[Path], request: TurnRequestT, how: ReadOptions
) -> tuple[list[Record], TurnRequestT]:
    """Read records over a turn; without options, by their columns angle and error."""
    column_notes: list[str] = []
    if request.angle is None and not (request.error or request.reading or request.turns):
        angle, errors, *column_notes = default_turn_columns(files[0], how)
        request = replace(request, angle=angle, error=errors)
    require_columns(request)
    read = read_files(files, request.columns, options=how, over="point")
    read[0] = replace(read[0], notes=(*column_notes, *read[0].notes))
    return read, request


def centre_files(
    files: Sequence[Path], request: CentreRequest, how: ReadOptions = ReadOptions()
) -> CentredRecords:
    """Analyse files as `centre_records` does; without options, by their columns angle and error."""
    records, described = read_turns(files, with_table(request), how)
    # the request as it was given can be repeated
    requested = replace(request, angle=described.angle, error=described.error)
    return replace(centre_records(records, described), request=requested)


def centre_records(records: Sequence[Record], options: CentreRequest) -> CentredRecords:
    """Return the eccentricity of a scale and the move that removes it.

    Several records are the heads of one setup if each column has an angle of its own, else
    setups in sequence.
    """
    require_columns(options)
    names = options.names
    at = head_angles(options.heads, len(records), len(names))
    mirror = -1.0 if options.head_direction == "cw" else 1.0
    pairs = [(record, name) for record in records for name in names]
    heads = [
        head_of(record, name, options, alpha * mirror)
        for (record, name), alpha in zip(pairs, at, strict=True)
    ]
    equal_notes, heads = _equal_readings(heads)
    together = len(records) > 1 and len(options.heads) == len(heads)
    size = len(heads) if together else len(names)
    setups = [_fit(heads[i : i + size], options) for i in range(0, len(heads), size)]
    headings = [channel.name for channel in records[0].channels]
    unit = column_and_unit(headings, names[0])[1] or options.unit
    reports = [report(s, mirror, options.mounting_angle, unit) for s in setups]
    for i in range(1, len(reports)):
        reports[i]["change"] = change(setups[i - 1], setups[i], mirror, unit)
    moves = options.stage_at
    if moves and (len(moves) != len(setups) or len(setups) < 3):
        raise RecordError(
            "--stage-at needs a position for each setup, and at least three setups: got "
            f"{len(moves)} positions and {len(setups)} setups"
        )
    return CentredRecords(
        request=options,
        setups=setups,
        reports=reports,
        notes=(
            *(note for r in records for note in r.notes),
            *(note for record, name in pairs for note in _code_notes(record, name, options)),
            *unit_warnings([head for head, _ in heads]),
            *equal_notes,
        ),
        trial=None if not moves else calibrate_moves(setups, moves, options.kind),
    )


def _equal_readings(
    heads: list[tuple[HeadReadings, bool]],
) -> tuple[list[str], list[tuple[HeadReadings, bool]]]:
    """Return heads with the resolution of columns of equal readings, and notes if it is unknown.

    It is that of the same column in other records.
    """
    notes, out = [], []
    resolved = with_resolution([head for head, _ in heads])
    for head, (_, radial) in zip(resolved, heads, strict=True):
        known = head
        if not head.resolution and float(np.ptp(head.error)) == 0.0:
            others = [h.resolution for h in resolved if h.name == head.name and h.resolution]
            if not others:
                notes.append(
                    f"all readings of column '{head.name}' are equal: their resolution is unknown, "
                    "and the uncertainty omits it"
                )
            known = replace(head, resolution=min(others, default=0.0))
        out.append((known, radial))
    return notes, out


def _fit(readings: list[tuple[HeadReadings, bool]], options: CentreRequest) -> Setup:
    if len({radial for _, radial in readings}) > 1:
        raise RecordError("the columns of errors must all be angles, or all lengths")
    heads, radial = [head for head, _ in readings], readings[0][1]
    orders = list(options.orders) or None
    setup = fit_setup(heads, radial, options.radius, options.kind, orders, options.outliers)
    # the response to known positions shows the order of eccentricity without the kind
    notes: list[str] = []
    if not options.stage_at:
        notes = kind_notes(setup, options.kind, options.radius is not None)
    return replace(setup, notes=tuple(dict.fromkeys((*setup.notes, *notes))))


def require_columns(request: TurnRequest) -> None:
    """Refuse a request whose columns or angles are missing or given twice."""
    if request.angle is None and request.turns is None:
        raise RecordError(
            "give the column of the angle by --angle, or, for samples that are evenly spaced, the "
            "number of turns by --turns"
        )
    if request.angle is not None and request.turns is not None:
        raise RecordError("--angle defines the number of turns: omit --turns")
    if bool(request.error) == bool(request.reading):
        raise RecordError(
            "give the columns of errors by --error, or the columns of readings by --reading"
            + (", not both" if request.error else "")
        )
    if request.reading and request.angle is None:
        raise RecordError("--reading also needs the true angle: name its column by --angle")
    if request.reading and request.sign != 1:
        raise RecordError("--reading gives errors as reading minus true angle: omit --sign")
