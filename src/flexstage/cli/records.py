"""`flexstage records`: what is in measured files, before anything is asked of them."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from flexstage.cli.options import JsonOption, from_docstring
from flexstage.cli.output import console, print_json, print_notes, print_table
from flexstage.cli.reading import (
    AS_TIMED,
    WHOLE_FILE,
    FileOptions,
    TimeOptions,
    file_rates,
)
from flexstage.errors import RecordError
from flexstage.records.selectors import column

if TYPE_CHECKING:
    from rich.console import Console

    from flexstage.records import Record


@from_docstring
def records(
    files: Annotated[list[Path], typer.Argument()],
    timing: TimeOptions = AS_TIMED,
    how: FileOptions = WHOLE_FILE,
    json: JsonOption = False,
) -> None:
    """List columns, units, rate and gaps of measured files.

    Parameters
    ----------
    files
        FILE...: Measured files.
    """
    from flexstage.records import read_record
    from flexstage.records.sampling import row_range

    rates = file_rates(timing.sample_rate, "--sample-rate", len(files))
    found = []
    for file, rate in zip(files, rates, strict=True):
        given: dict[str, Any] = {
            **vars(how),
            "rows": row_range(how.rows, "--rows"),
            # no column has to be complete, and gaps are told
            "columns": [],
        }
        said = ""
        try:
            record = read_record(
                file,
                sample_rate_hz=rate,
                time=None if timing.time is None else column(timing.time),
                largest_step=float("inf"),
                **given,
            )
        except RecordError as error:
            if rate is not None or timing.time is not None:
                raise
            said = str(error)
            record = read_record(file, over="point", **given)
        found.append(_found(record, said))
    if json:
        print_json({"files": found})
        return
    for one in found:
        _print(console(), one)


def _found(record: "Record", said: str) -> dict[str, Any]:
    """Return what is in a record as plain data; `said` is why it has no times."""
    import numpy as np

    from flexstage.records import responses_in_columns
    from flexstage.records.sampling import LARGEST_STEP

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
            result["notes"] += [said]
        else:
            result["responses"] = [
                c.name.removesuffix(" real") for c in table.channels if c.name.endswith(" real")
            ]
            result["from"], result["to"] = float(table.time[0]), float(table.time[-1])
    return result


def _print(screen: "Console", one: dict[str, Any]) -> None:
    heads = "no.", "<column", "<unit", "smallest", "largest", "missing"
    rows = []
    for channel in one["columns"]:
        ends = (channel["smallest"], channel["largest"])
        figures = ("" if end is None else f"{end:.6g}".replace("-", "−") for end in ends)
        named = (channel[key] for key in ("number", "name", "unit"))
        rows.append((*named, *figures, channel["missing"] or ""))
    print_table(screen, one["file"], heads, rows)
    screen.print(_length(one), markup=False, soft_wrap=True)
    gaps = one.get("gaps", [])
    for gap in gaps[:5]:
        screen.print(f"gap of {gap['seconds']:.4g} s after sample {gap['after_sample']}")
    if len(gaps) > 5:
        screen.print(f"and {len(gaps) - 5} more gaps")
    print_notes(screen, one["notes"])


def _length(one: dict[str, Any]) -> str:
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
