"""What is in a measured file, before anything is asked of it."""

import math
from collections.abc import Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from flexstage.base.errors import RecordError
from flexstage.quantities.table import Table, table
from flexstage.quantities.units import readable_unit
from flexstage.records.read import read_record
from flexstage.records.read_options import ReadOptions
from flexstage.records.record import Record
from flexstage.records.responses import responses_in_columns
from flexstage.records.sampling import LARGEST_STEP


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
