"""Contents of a measured file, and the columns and job that units and names suggest."""

import math
import re
from collections.abc import Collection, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from flexstage.base.errors import RecordError
from flexstage.quantities.table import Table, table
from flexstage.quantities.units import readable_unit
from flexstage.records.read import read_record
from flexstage.records.read_options import ReadOptions
from flexstage.records.record import Record, column_and_unit
from flexstage.records.responses import responses_in_columns
from flexstage.records.sampling import LARGEST_STEP, TIME_NAMES

_INPUTS = ("input", "in", "u", "voltage", "volt", "spannung", "command", "drive", "force", "kraft")
_OUTPUTS = ("output", "out", "y", "position", "pos", "displacement", "weg", "response", "sensor")
_ERRORS = ("error", "err", "fehler", "deviation", "abweichung", "gauge", "indicator")
_ANGLES = ("angle", "theta", "azimuth", "winkel", "reference")
_MOTIONS = ("m", "rad")
_VIBRATIONS = (*_MOTIONS, "m/s", "rad/s", "m/s^2", "rad/s^2")

#: End of the note on columns that were selected by default.
COLUMNS_BY_NAME = "selected by units and names"

Columns = list[dict[str, Any]]


def read_whole(
    file: str | Path,
    options: ReadOptions = ReadOptions(),
    *,
    units: Mapping[str, str] | None = None,
) -> tuple[Record, str]:
    """Read all columns of a file, with gaps and what is missing; by its rows where it has no times.

    Nothing is resampled. Returns the record, and why there are no times; empty where there are.
    """
    # no column has to be complete, and gaps are told
    every = partial(
        read_record, file, replace(options, resample=()), units=units, columns=[],
        largest_step=math.inf,
    )  # fmt: skip
    try:
        return every(), ""
    except RecordError as error:
        if options.sample_rate or options.time is not None:
            raise
        return every(over="point"), str(error)


def contents(record: Record, without_times: str = "") -> dict[str, Any]:
    """Return columns, their ranges, rate and gaps of what `read_whole` gives, as plain data."""
    channels = []
    for number, channel in enumerate(record.channels):
        finite = channel.values[np.isfinite(channel.values)]
        channels.append({
            "number": number,
            "name": channel.name,
            "unit": channel.unit,
            "smallest": float(finite.min()) if finite.size else None,
            "largest": float(finite.max()) if finite.size else None,
            "missing": int(channel.values.size - finite.size),
        })  # fmt: skip
    result: dict[str, Any] = {
        "file": record.source,
        "over": record.over,
        "samples": record.size,
        "columns": channels,
        "notes": list(record.notes),
    }
    if record.over != "point":
        result["from"], result["to"] = float(record.time[0]), float(record.time[-1])
    if record.over == "time":
        steps = np.diff(record.time)
        usual = float(np.median(steps))
        wide = np.flatnonzero(steps > LARGEST_STEP * usual)
        result["sample_rate_hz"] = 1.0 / usual if wide.size else record.sample_rate_hz
        result["uniform"] = record.uniform
        result["gaps"] = [{"after_sample": int(i), "seconds": float(steps[i])} for i in wide]
    if record.over == "point":
        try:
            table = responses_in_columns(record)
        except RecordError:
            # a table without responses has points, unless times were to be found
            result["notes"] += [without_times]
        else:
            result["responses"] = [
                c.name.removesuffix(" real") for c in table.channels if c.name.endswith(" real")
            ]
            result["from"], result["to"] = float(table.time[0]), float(table.time[-1])
    return result


def _shown(channel: dict[str, Any]) -> tuple[str, float]:
    """Return the unit in which a column is read easily, and how many of it one of its own is."""
    ends = (channel["smallest"], channel["largest"])
    size = max((abs(end) for end in ends if end is not None), default=0.0)
    unit, factor = readable_unit(size, channel["unit"])
    return (f"µ{unit[1:]}" if factor == 1e6 else unit), factor


def column_label(channel: dict[str, Any]) -> str:
    """Name a column of what `contents` returns as a person does: ``2: Weg [µm]``."""
    unit = _shown(channel)[0]
    return f"{channel['number']}: {channel['name']}" + (f" [{unit}]" if unit else "")


def contents_table(one: dict[str, Any], caption: str = "") -> Table:
    """Set out the columns of what `contents` returns, in units that are read easily."""
    heads = "no.", "<column", "<unit", "smallest", "largest", "missing"
    rows = []
    for channel in one["columns"]:
        unit, factor = _shown(channel)
        ends = (channel["smallest"], channel["largest"])
        figures = ("" if e is None else f"{factor * e:.6g}".replace("-", "−") for e in ends)
        named = channel["number"], channel["name"], unit
        rows.append((*named, *figures, channel["missing"] or ""))
    return table(caption, heads, rows)


def length_in_words(one: dict[str, Any]) -> str:
    """Say how much there is of what `contents` returns, and over what."""
    if one["over"] == "time":
        even = "" if one["uniform"] else ", uneven"
        return (
            f"{one['samples']} samples over time, {one['sample_rate_hz']:.6g} Hz{even}, from "
            f"{one['from']:.6g} to {one['to']:.6g} s"
        )
    if "from" not in one:
        return f"{one['samples']} rows"
    responses = one.get("responses", [])
    what = f"frequency responses {', '.join(responses)}: " if responses else ""
    return f"{what}{one['samples']} lines from {one['from']:.6g} to {one['to']:.6g} Hz"


def is_time(column: dict[str, Any]) -> bool:
    """Say whether a column is of times, by its unit or its name."""
    return column["unit"] == "s" or str(column["name"]).casefold() in TIME_NAMES


def moving_columns(found: dict[str, Any]) -> Columns:
    """Return the columns of what `contents` returns that do not stand still, but for the times."""
    columns = (c for c in found["columns"] if not is_time(c))
    return [c for c in columns if (c["smallest"] or 0.0) < (c["largest"] or 0.0)]


def likely_drive(
    moving: Columns, *, vibration: bool = False, driven: Columns | None = None
) -> tuple[Columns, Columns]:
    """Return the columns that may be the input of a drive, and those that may be the output.

    Units tell; where several columns have one, or none has, their names do. Of a `vibration` the
    input may be a force, and an output a velocity or an acceleration.
    """
    if driven is None:
        forced = vibration and any(c["unit"] == "N" for c in moving)
        driven = _told(moving, ("N",) if forced else ("V",), _INPUTS)
    rest = [c for c in moving if c not in driven]
    follows = _told(rest, _VIBRATIONS if vibration else _MOTIONS, _OUTPUTS)
    return driven, follows or [c for c in rest if len(rest) == 1 and not c["unit"]]


def _told(columns: Columns, units: Collection[str], words: Sequence[str]) -> Columns:
    fit = [c for c in columns if c["unit"] in units]
    if len(fit) == 1:
        return fit
    named = (set(re.findall(r"[^\W\d_]+", str(c["name"]).casefold())) for c in fit or columns)
    return [c for c, own in zip(fit or columns, named, strict=True) if own & set(words)] or fit


def default_drive_columns(
    file: Path,
    columns: tuple[tuple[str | int, ...], tuple[str | int, ...]],
    how: ReadOptions,
    *,
    vibration: bool = False,
    options: tuple[str, str] = ("input", "output"),
) -> tuple[tuple[str | int, ...], tuple[str | int, ...], str]:
    """Return input and outputs of a file, where they are not given, and a line that says so.

    `options` ask for them. Columns that are found are their numbers, and none of responses that
    exist. Raises a `RecordError` where units and names leave a choice.
    """
    found = contents(*read_whole(file, how))
    if vibration and found["over"] != "time" and not any(columns):
        return (), (), ""
    names = [str(c["name"]) for c in found["columns"]]
    known: set[int] = set()
    for column in (column for given in columns for column in given):
        with suppress(RecordError):  # one that there is not is refused where it is read
            known.add(column_and_unit(names, column)[0])
    left = [c for c in moving_columns(found) if c["number"] not in known]
    chosen, said = list(columns), []
    likely = likely_drive(left, vibration=vibration, driven=[] if columns[0] else None)
    for k, option in enumerate(options):
        if columns[k]:
            continue
        if len(likely[k]) != 1 and not (vibration and k and likely[k]):
            raise _left_open(found, f"which column is the {option}: name it by --{option}")
        chosen[k] = tuple(c["number"] for c in likely[k])
        said.append(f"{option} {', '.join(map(column_label, likely[k]))}")
    driven, follows = chosen
    return driven, follows, f"{'; '.join(said)}: {COLUMNS_BY_NAME}"


def _left_open(found: dict[str, Any], what: str) -> RecordError:
    columns = ", ".join(map(column_label, found["columns"][:20]))
    return RecordError(f"'{found['file']}' leaves open {what} (columns: {columns})")


@dataclass(frozen=True, slots=True, kw_only=True)
class LikelyTurn:
    """The columns of a record of a turn, and what they are likely to be."""

    columns: tuple[str, ...]
    """All columns, by name."""
    angle: str
    """The likely angle."""
    errors: tuple[str, ...]
    """The likely errors, or readings."""
    has_units: bool
    """Whether the file says their units."""
    is_sure: bool
    """Whether one column is called an angle, and others are called errors."""


def likely_turn(found: dict[str, Any]) -> LikelyTurn:
    """Return what columns of a turn are: the angle is the one called so, else the first."""
    columns = {str(c["name"]): c for c in found["columns"]}
    if len(columns) < 2:
        raise RecordError(
            f"'{Path(found['file']).name}' has {len(columns)} column: a record of a turn has the "
            "angle and, for each head, its error"
        )
    called = [n for n in columns if n.casefold().startswith(_ANGLES)]
    angle = (called or list(columns))[0]
    others = [n for n in columns if n != angle and not is_time(columns[n])]
    said = [n for n in others if n.casefold().startswith(_ERRORS)]
    errors = tuple(said or others)
    return LikelyTurn(
        columns=tuple(columns),
        angle=angle,
        errors=errors,
        has_units=all(columns[n]["unit"] for n in (angle, *errors)),
        is_sure=len(called) == 1 and bool(said),
    )


def default_turn_columns(file: Path, how: ReadOptions) -> tuple[str, tuple[str, ...], str]:
    """Return angle and errors of a record of a turn, and a line that says so."""
    found = contents(*read_whole(file, how))
    turn = likely_turn(found)
    if not turn.is_sure:
        raise _left_open(found, "what is angle and error: name them by --angle and --error")
    said = f"angle {turn.angle}; error {','.join(turn.errors)}: taken by their names"
    return turn.angle, turn.errors, said


def next_job(found: dict[str, Any]) -> str:
    """Return the command that goes on with a file; empty where units and names leave a choice."""
    job = ""
    if found["over"] == "frequency" or "responses" in found:
        job = "frf"
    elif found["over"] == "point":
        turn = likely_turn(found) if len(found["columns"]) > 1 else None
        job = "centre" if turn is not None and turn.is_sure and turn.has_units else ""
    else:
        for name in ("frf", "identify"):
            inputs, outputs = likely_drive(moving_columns(found), vibration=name == "frf")
            if len(inputs) == 1 and (len(outputs) == 1 or (outputs and name == "frf")):
                job = name
    return job
