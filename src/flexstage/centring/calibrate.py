"""Calibration of a scale or a polygon from records, the same for the command and Python."""

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from flexstage.base.arrays import Array
from flexstage.base.errors import ModelError, RecordError
from flexstage.centring.calibration import (
    ScaleReadings,
    against_reference,
    cross_calibration,
    equal_division,
    self_calibration,
)
from flexstage.centring.calibration_table import Division
from flexstage.centring.closure import dual_closure, simple_closure
from flexstage.centring.from_records import head_angles, head_of, read_turns, unit_warnings
from flexstage.centring.geometry import ARCSEC
from flexstage.centring.requests import CalibrateRequest
from flexstage.centring.turns import find_turns, places
from flexstage.files.plain import csv_text, json_text, plain
from flexstage.files.request import request_fields
from flexstage.files.result import Result
from flexstage.quantities.units import si_unit
from flexstage.records import Channel, Record
from flexstage.records.contents import read_whole
from flexstage.records.read_options import ReadOptions
from flexstage.records.sampling import TIME_NAMES

_FACES = ("face", "faces", "position", "segment")
_SETTINGS, _ROUNDS = ("setting", "settings"), ("round", "rounds")
#: Methods by the readings of heads.
_BY_HEADS = {
    "self": self_calibration, "reference": against_reference, "equal-division": equal_division,
}  # fmt: skip
#: Options that only some methods use.
_USED_BY = {
    "heads": tuple(_BY_HEADS),
    "head_uncertainty": tuple(_BY_HEADS),
    "axis_motion": ("self", "reference"),
    "blind_allowance": ("self", "equal-division", "cross"),
    "positions": ("cross",),
    "orders": (*_BY_HEADS, "cross"),
    "settings": ("rosette",),
    "span": ("closure",),
    "gain_uncertainty": ("closure", "rosette"),
}
#: Points up to which plain data have a covariance; the files always have it.
_MOST_POINTS = 360


@dataclass(frozen=True, slots=True, kw_only=True)
class Calibration(Result):
    """Calibrated scale, or two scales, or a polygon and its table."""

    table_key: ClassVar[str] = "points"

    method: str
    """Method, by its name in the request."""
    why: str
    """Why this method was used."""
    divisions: tuple[Division, ...]
    """The calibrated scales, or faces and table."""
    noise: float
    """Standard deviation of one reading [rad]."""
    degrees_of_freedom: float
    """Degrees of freedom of the noise; infinite if it was given."""
    notes: tuple[str, ...]
    """Remarks on the records."""

    def data(self) -> dict[str, Any]:
        return {
            "method": self.method,
            "why": self.why,
            "unit": "rad",
            "noise": self.noise,
            "degrees_of_freedom": plain(self.degrees_of_freedom),
            "points": [row for d in self.divisions for row in _points(d)],
            "harmonics": [row for d in self.divisions for row in _harmonics(d)],
            "blind": {d.name: list(d.blind) for d in self.divisions},
            "contributions": [
                {
                    "of": d.name,
                    "source": c.source,
                    "kind": c.kind,
                    "degrees_of_freedom": plain(c.degrees_of_freedom),
                    "uncertainty": math.sqrt(float(np.trace(c.covariance)) / d.error.size),
                }
                for d in self.divisions
                for c in d.contributions
            ],
            "covariance": {
                d.name: d.covariance.tolist() if d.error.size <= _MOST_POINTS else None
                for d in self.divisions
            },
            "notes": list(self.notes),
        }


def _points(division: Division) -> list[dict[str, Any]]:
    """Return the error of each point, and that of the angle from it to the next point."""
    rows = []
    for i, angle in enumerate(division.angle):
        error = division.estimate(i)
        step = division.difference((i + 1) % division.error.size, i)
        rows.append({
            "of": division.name,
            "angle_deg": math.degrees(angle),
            "error": error.value,
            "uncertainty": error.uncertainty,
            "degrees_of_freedom": plain(error.degrees_of_freedom),
            "expanded": error.expanded,
            "step_error": step.value,
            "step_uncertainty": step.uncertainty,
        })  # fmt: skip
    return rows


def _harmonics(division: Division) -> list[dict[str, Any]]:
    rows = []
    for n in division.orders:
        cosine, sine, amplitude = division.harmonic(n)
        rows.append({
            "of": division.name,
            "order": n,
            "amplitude": amplitude.value,
            "uncertainty": amplitude.uncertainty,
            "phase_deg": math.degrees(math.atan2(sine.value, cosine.value)),
            "cosine": cosine.value,
            "sine": sine.value,
        })  # fmt: skip
    return rows


def calibrate_files(
    files: Sequence[Path], request: CalibrateRequest, how: ReadOptions = ReadOptions()
) -> Calibration:
    """Return the calibration of a scale or a polygon by the records in files.

    Files with a column of faces are readings of a polygon, others records over the turn.
    """
    if not files:
        raise RecordError("give the records to calibrate from, or --best-heads without records")
    if request.best_heads is not None or request.step is not None:
        raise ModelError("--best-heads and --step need no records: give one or the other")
    if request.method is None or request.method in ("closure", "rosette"):
        records = [read_whole(file, how)[0] for file in files]
        if request.method or request.settings or at_faces(records[0]):
            return _of_polygon(records, request)
    return _of_turns(*read_turns(files, request, how))


def _require_used(request: CalibrateRequest, method: str) -> None:
    """Refuse options that the method does not use."""
    for name, methods in _USED_BY.items():
        field = request_fields(CalibrateRequest)[name]
        if method not in methods and getattr(request, name) != field.default:
            raise ModelError(
                f"{field.option} is for {', '.join(methods)}, not for {method}: omit it"
            )


def _of_turns(records: Sequence[Record], request: CalibrateRequest) -> Calibration:
    count = len(records) * len(request.names)
    method, why = _method_of_turns(request, count)
    _require_used(request, method)
    alphas = (
        list(request.positions)
        if method == "cross"
        else head_angles(request.heads, len(records), len(request.names))
    )
    if len(alphas) != count:
        raise RecordError(
            f"--positions must have an angle for each of {count} columns, got {len(alphas)}"
        )
    pairs = [(record, name) for record in records for name in request.names]
    heads = []
    for (record, name), alpha in zip(pairs, alphas, strict=True):
        head, radial = head_of(record, name, request, alpha)
        if radial:
            raise RecordError(f"column '{head.name}' is a length, but must be an error of angle")
        heads.append(head)
    angle = np.asarray(heads[0].angle, dtype=np.float64)
    for head in heads[1:]:
        if np.shape(head.angle) != angle.shape or not np.allclose(head.angle, angle, atol=1e-9):
            raise RecordError(
                f"'{head.file}' and '{heads[0].file}' have different angles: heads are compared at "
                "the same angles, so read them together"
            )
    errors = np.array([head.error for head in heads])
    highest = (places(find_turns(angle).angle / math.tau) - 1) // 2
    orders = request.orders or range(1, max(1, min(12, highest)) + 1)
    # four points or more in each wave
    points = 36 * (4 * max(orders) // 36 + 1)
    allowance = {} if method == "reference" else {"blind_allowance": request.blind_allowance}
    if method == "cross":
        tables = cross_calibration(
            angle, errors, positions=alphas, orders=orders, noise=request.noise, points=points,
            **allowance,
        )  # fmt: skip
    else:
        readings = ScaleReadings(
            angle=angle, errors=errors, heads=np.array(alphas), noise=request.noise,
            head_uncertainty=request.head_uncertainty,
        )  # fmt: skip
        moving = {} if method == "equal-division" else {"axis_motion": request.axis_motion}
        solve: Any = _BY_HEADS[method]
        tables = (solve(readings, orders, points=points, **allowance, **moving),)
    return Calibration(
        request=request,
        method=method,
        why=why,
        divisions=tuple(
            table.division(points, name)
            for table, name in zip(tables, ("scale", "second scale"), strict=False)
        ),
        noise=tables[0].noise,
        degrees_of_freedom=tables[0].degrees_of_freedom,
        notes=(*(note for r in records for note in r.notes), *unit_warnings(heads)),
    )


def _method_of_turns(request: CalibrateRequest, heads: int) -> tuple[str, str]:
    """Return the method for records over the turn, and why it is used."""
    if request.method is not None:
        return request.method, "by --method"
    if request.positions:
        return "cross", "two scales in several --positions"
    if heads == 1:
        return "reference", "one head shows only the difference from the reference"
    if request.angle is None:
        return "self", f"{heads} heads without a true angle, which cancels in their differences"
    raise RecordError(
        f"{heads} heads and a column of the angle allow two methods: give --method self, in which "
        "errors of the angle cancel, or --method reference if the angle is of a better standard"
    )


def _of_polygon(records: Sequence[Record], request: CalibrateRequest) -> Calibration:
    readings, names, notes = face_readings(records, request)
    method, why = _method_of_polygon(request, names)
    _require_used(request, method)
    known: dict[str, Any] = {"noise": request.noise, "gain_uncertainty": request.gain_uncertainty}
    if method == "closure":
        closed = simple_closure(readings, span=request.span, **known)
    else:
        ends = [re.search(r"-?\d+$", name) for name in names]
        settings = request.settings or tuple(int(end[0]) for end in ends if end)
        if len(settings) != len(names):
            raise RecordError(
                f"--settings must have a number for each of {len(names)} columns "
                f"({', '.join(names)}), got {len(settings)}"
            )
        if not request.settings:
            notes.append(f"settings {', '.join(map(str, settings))}: the numbers of the columns")
        closed = dual_closure(readings, settings, **known)
    return Calibration(
        request=request,
        method=method,
        why=why,
        divisions=(closed.faces,) if closed.table is None else (closed.faces, closed.table),
        noise=closed.noise,
        degrees_of_freedom=closed.degrees_of_freedom,
        notes=tuple(dict.fromkeys(notes)),
    )


def _method_of_polygon(request: CalibrateRequest, names: Sequence[str]) -> tuple[str, str]:
    """Return the method for readings of a polygon, and why it is used."""
    if request.method is not None:
        return request.method, "by --method"
    if request.settings or all(name.startswith("setting") for name in names):
        return "rosette", "the polygon was turned on the table between the settings"
    if len(names) == 1:
        return "closure", "one column of readings has no other setting of the polygon on the table"
    raise RecordError(
        f"{len(names)} columns of readings of a polygon ({', '.join(names)}) allow two methods: "
        "give --settings if it was turned on the table, or --method closure if they are rounds of "
        "two autocollimators"
    )


def at_faces(record: Record) -> bool:
    """Return whether a record has a column of the faces of a polygon."""
    return any(_is(channel, _FACES) for channel in record.channels)


def face_readings(
    records: Sequence[Record], request: CalibrateRequest
) -> tuple[Array, list[str], list[str]]:
    """Return readings of faces [rad], shape (faces, columns), names of the columns, and notes."""
    columns: list[Array] = []
    names: list[str] = []
    # columns with missing readings are used
    notes = [n for record in records for n in record.notes if not n.startswith("incomplete")]
    for record in records:
        face, setting, repeat = (_labels(record, words) for words in (_FACES, _SETTINGS, _ROUNDS))
        group = "setting" if setting is not None else "round"
        setting = repeat if setting is None else setting
        rows = np.arange(record.size) if face is None else face - face.min()
        apart = np.unique(np.diff(np.unique(rows)))
        if apart.size == 1 and apart[0] > 1:
            raise RecordError(
                f"the faces of '{record.source}' have numbers {apart[0]} apart: number them one by "
                "one, 0, 1, 2 and so on"
            )
        selected = [record.channel(name) for name in request.names] or [
            c for c in record.channels if not _is(c, (*_FACES, *_SETTINGS, *_ROUNDS, *TIME_NAMES))
        ]
        for channel in selected:
            for s in (None,) if setting is None else np.unique(setting):
                here = slice(None) if setting is None else setting == s
                if np.unique(rows[here]).size < rows[here].size:
                    raise RecordError(
                        f"'{record.source}' has two readings of a face in one setting: give the "
                        "repeats in a file of their own"
                    )
                column = np.full(rows.max() + 1, np.nan)
                column[rows[here]] = _in_rad(channel, request, notes)[here]
                columns.append(column)
                names.append(channel.name if setting is None else f"{group} {s}")
    if not columns or len({column.size for column in columns}) > 1:
        raise RecordError("all records need readings of the same faces, a row for each")
    notes.append(f"{columns[0].size} faces in the full circle")
    return np.stack(columns, axis=1), names, notes


def _is(channel: Channel, words: Sequence[str]) -> bool:
    return channel.name.strip().casefold() in words


def _labels(record: Record, words: Sequence[str]) -> NDArray[np.int64] | None:
    """Return the whole numbers of a column with one of these names; None without one."""
    for channel in record.channels:
        if _is(channel, words):
            if not np.array_equal(np.rint(channel.values), channel.values):
                raise RecordError(f"column '{channel.name}' must have a whole number in every row")
            return channel.values.astype(np.int64)
    return None


def _in_rad(channel: Channel, request: CalibrateRequest, notes: list[str]) -> Array:
    """Return readings in rad, which are in arcsec if neither file nor request has a unit."""
    factor, unit = (1.0, channel.unit) if channel.unit else si_unit(request.unit or "arcsec")
    if unit != "rad":
        raise RecordError(
            f"column '{channel.name}' is in {unit}, but must be an angle: give its unit by --unit"
        )
    if not (channel.unit or request.unit):
        notes.append("readings without a unit are taken in arcsec: give another one by --unit")
    return request.sign * factor * channel.values


def calibration_files(result: Calibration) -> dict[str, bytes]:
    """Return tables and covariances of a calibration as CSV, and all of it as JSON."""
    files = {"calibration.json": json_text(result.to_dict()).encode()}
    for division in result.divisions:
        name = division.name.replace(" ", "-")
        degrees = np.degrees(division.angle).tolist()
        columns = degrees, division.error / ARCSEC, division.uncertainty / ARCSEC
        heading = "angle (deg)", "error (arcsec)", "uncertainty (arcsec)"
        table = [heading, *np.transpose(columns).tolist()]
        covariance = [
            [f"{angle:.9g} deg (arcsec^2)" for angle in degrees],
            *(division.covariance / ARCSEC**2).tolist(),
        ]
        files[f"{name}.csv"] = csv_text(table).encode()
        files[f"{name}-covariance.csv"] = csv_text(covariance).encode()
    return files
