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
    """Read all columns of a file, including incomplete ones; over its rows if it has no times.

    Nothing is resampled. Returns the record, and the reason why it has no times, else empty.
    """
    # no column has to be complete, and gaps are reported
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
    """Return columns, ranges, rate and gaps of a record of `read_whole`, as plain data."""
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
            # a table without responses is over points: report why it has no times
            result["notes"] += [without_times]
        else:
            result["responses"] = [
                c.name.removesuffix(" real") for c in table.channels if c.name.endswith(" real")
            ]
            result["from"], result["to"] = float(table.time[0]), float(table.time[-1])
    return result


def _readable(channel: dict[str, Any]) -> tuple[str, float]:
    """Return a readable unit of a column, and the size of its own unit in it."""
    ends = (channel["smallest"], channel["largest"])
    size = max((abs(end) for end in ends if end is not None), default=0.0)
    unit, factor = readable_unit(size, channel["unit"])
    return (f"µ{unit[1:]}" if factor == 1e6 else unit), factor


def column_label(channel: dict[str, Any]) -> str:
    """Return the label of a column of `contents`, such as ``2: Weg [µm]``."""
    unit = _readable(channel)[0]
    return f"{channel['number']}: {channel['name']}" + (f" [{unit}]" if unit else "")


def contents_table(one: dict[str, Any], caption: str = "") -> Table:
    """Return a table of the columns of `contents`, in readable units."""
    heads = "no.", "<column", "<unit", "smallest", "largest", "missing"
    rows = []
    for channel in one["columns"]:
        unit, factor = _readable(channel)
        ends = (channel["smallest"], channel["largest"])
        figures = ("" if e is None else f"{factor * e:.6g}".replace("-", "−") for e in ends)
        rows.append((channel["number"], channel["name"], unit, *figures, channel["missing"] or ""))
    return table(caption, heads, rows)


def length_in_words(one: dict[str, Any]) -> str:
    """Return a text with the length, rate and range of `contents`."""
    if one["over"] == "time":
        uniform = "" if one["uniform"] else ", non-uniform"
        return (
            f"{one['samples']} samples over time, {one['sample_rate_hz']:.6g} Hz{uniform}, from "
            f"{one['from']:.6g} to {one['to']:.6g} s"
        )
    if "from" not in one:
        return f"{one['samples']} rows"
    responses = one.get("responses", [])
    what = f"frequency responses {', '.join(responses)}: " if responses else ""
    return f"{what}{one['samples']} lines from {one['from']:.6g} to {one['to']:.6g} Hz"


def is_time(column: dict[str, Any]) -> bool:
    """Return whether a column contains times, by its unit or name."""
    return column["unit"] == "s" or str(column["name"]).casefold() in TIME_NAMES


def moving_columns(listing: dict[str, Any]) -> Columns:
    """Return the columns of `contents` that change, except times."""
    columns = (c for c in listing["columns"] if not is_time(c))
    return [c for c in columns if (c["smallest"] or 0.0) < (c["largest"] or 0.0)]


def likely_drive(
    moving: Columns, *, vibration: bool = False, inputs: Columns | None = None
) -> tuple[Columns, Columns]:
    """Return the columns that may be the input of a drive, and those that may be the output.

    They are selected by their units, and by their names if several or no columns have the unit. The
    input of a `vibration` may be a force, an output a velocity or an acceleration.
    """
    if inputs is None:
        has_force = vibration and any(c["unit"] == "N" for c in moving)
        inputs = _matching(moving, ("N",) if has_force else ("V",), _INPUTS)
    others = [c for c in moving if c not in inputs]
    outputs = _matching(others, _VIBRATIONS if vibration else _MOTIONS, _OUTPUTS)
    return inputs, outputs or [c for c in others if len(others) == 1 and not c["unit"]]


def _matching(columns: Columns, units: Collection[str], words: Sequence[str]) -> Columns:
    fit = [c for c in columns if c["unit"] in units]
    if len(fit) == 1:
        return fit
    words_of = (set(re.findall(r"[^\W\d_]+", str(c["name"]).casefold())) for c in fit or columns)
    return [
        c for c, name_words in zip(fit or columns, words_of, strict=True) if name_words & set(words)
    ] or fit


def default_drive_columns(
    file: Path,
    columns: tuple[tuple[str | int, ...], tuple[str | int, ...]],
    how: ReadOptions,
    *,
    vibration: bool = False,
    options: tuple[str, str] = ("input", "output"),
) -> tuple[tuple[str | int, ...], tuple[str | int, ...], str]:
    """Return input and outputs of a file, those in `columns` or else by default, and a note.

    `options` are the names of their options. Default columns are numbers; a measured response has
    none. The function raises a `RecordError` if units and names are ambiguous.
    """
    listing = contents(*read_whole(file, how))
    if vibration and listing["over"] != "time" and not any(columns):
        return (), (), ""
    names = [str(c["name"]) for c in listing["columns"]]
    used: set[int] = set()
    for column in (column for selected in columns for column in selected):
        with suppress(RecordError):  # reading refuses a column that does not exist
            used.add(column_and_unit(names, column)[0])
    moving = [c for c in moving_columns(listing) if c["number"] not in used]
    selection, labels = list(columns), []
    likely = likely_drive(moving, vibration=vibration, inputs=[] if columns[0] else None)
    for k, option in enumerate(options):
        if columns[k]:
            continue
        if len(likely[k]) != 1 and not (vibration and k and likely[k]):
            raise _ambiguous(listing, f"which column is the {option}: name it by --{option}")
        selection[k] = tuple(c["number"] for c in likely[k])
        labels.append(f"{option} {', '.join(map(column_label, likely[k]))}")
    inputs, outputs = selection
    return inputs, outputs, f"{'; '.join(labels)}: {COLUMNS_BY_NAME}"


def _ambiguous(listing: dict[str, Any], what: str) -> RecordError:
    columns = ", ".join(map(column_label, listing["columns"][:20]))
    return RecordError(f"'{listing['file']}' does not show {what} (columns: {columns})")


@dataclass(frozen=True, slots=True, kw_only=True)
class LikelyTurn:
    """Columns of a record over a turn, and their likely roles."""

    columns: tuple[str, ...]
    """All columns, by name."""
    angle: str
    """The likely angle."""
    errors: tuple[str, ...]
    """The likely errors, or readings."""
    has_units: bool
    """Whether the file has their units."""
    is_sure: bool
    """Whether the names show one angle and its errors."""


def likely_turn(listing: dict[str, Any]) -> LikelyTurn:
    """Return the likely roles of columns: the angle by its name, else the first column."""
    columns = {str(c["name"]): c for c in listing["columns"]}
    if len(columns) < 2:
        raise RecordError(
            f"'{Path(listing['file']).name}' has {len(columns)} column: a record over a turn needs "
            "the angle and the error of each head"
        )
    angles = [n for n in columns if n.casefold().startswith(_ANGLES)]
    angle = (angles or list(columns))[0]
    others = [n for n in columns if n != angle and not is_time(columns[n])]
    error_names = [n for n in others if n.casefold().startswith(_ERRORS)]
    errors = tuple(error_names or others)
    return LikelyTurn(
        columns=tuple(columns),
        angle=angle,
        errors=errors,
        has_units=all(columns[n]["unit"] for n in (angle, *errors)),
        is_sure=len(angles) == 1 and bool(error_names),
    )


def default_turn_columns(file: Path, how: ReadOptions) -> tuple[str, tuple[str, ...], str]:
    """Return angle and errors of a record over a turn, and a note on them."""
    listing = contents(*read_whole(file, how))
    turn = likely_turn(listing)
    if not turn.is_sure:
        raise _ambiguous(listing, "the angle and its errors: name them by --angle and --error")
    note = f"angle {turn.angle}; error {','.join(turn.errors)}: selected by their names"
    return turn.angle, turn.errors, note


def next_job(listing: dict[str, Any]) -> str:
    """Return the command that analyses a file; empty if units and names are ambiguous."""
    job = ""
    if listing["over"] == "frequency" or "responses" in listing:
        job = "frf"
    elif listing["over"] == "point":
        turn = likely_turn(listing) if len(listing["columns"]) > 1 else None
        job = "centre" if turn is not None and turn.is_sure and turn.has_units else ""
    else:
        for name in ("frf", "identify"):
            inputs, outputs = likely_drive(moving_columns(listing), vibration=name == "frf")
            if len(inputs) == 1 and (len(outputs) == 1 or (outputs and name == "frf")):
                job = name
    return job
