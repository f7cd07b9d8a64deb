"""Records of a drive: over time, or as tables of branches and of reversal curves."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from flexstage.errors import RecordError
from flexstage.records.curves import (
    curves_in_columns,
    curves_in_records,
    curves_in_rows,
    from_branches,
)
from flexstage.records.files import read_files
from flexstage.records.likely_columns import taken_drive
from flexstage.records.reading_options import column, column_list
from flexstage.records.record import Record
from flexstage.records.sampling import row_range


def read_drive(
    files: Sequence[Path],
    input: str | None,
    output: str | None,
    *,
    branches: str | None = None,
    curve: str | None = None,
    units: tuple[str | None, str | None] = (None, None),
    rates_hz: Sequence[float | None] | None = None,
    time: str | int | None = None,
    resample_hz: Sequence[float | None] | None = None,
    **how: Any,
) -> tuple[list[Record], str | int, str | int]:
    """Read what a drive was told and what followed: over time, or as tables of curves.

    Of curves in columns, `input` and `output` name one for each, with commas. `branches` names
    the columns of the rising and the falling branch; `curve` is a column that numbers reversal
    curves, or says how they lie: "files" or "columns". `how` goes on to `read_files`. Returns the
    records, evenly sampled and NaN where nothing was measured, then the columns that drive and
    follow. Over time those that are not given are taken of the first file, where units and names
    leave no choice; a note says so.
    """
    if branches is None and curve is None:
        said: list[str] = []
        if not (input and output):
            given = {"rates_hz": rates_hz or [None], "time": time, **how}
            input, output, *said = taken_drive(files[0], (input, output), **given)
        wanted = [column(input), column(output)]
        read = read_files(
            files, wanted, units=units, rates_hz=rates_hz, time=time, resample_hz=resample_hz,
            even=True, **how,
        )  # fmt: skip
        read[0] = replace(read[0], notes=(*said, *read[0].notes))
        return read, wanted[0], wanted[1]
    if input is None or (output is None and branches is None):
        raise RecordError(
            "a table without times needs --input, and --output or --branches: name the columns"
        )
    option = "--branches" if branches is not None else "--curve"
    for other, given in (("--time", time), ("--resample", resample_hz)):
        if given is not None:
            raise RecordError(f"{option} is for tables without times: leave {other} out")
    if branches is not None and (curve is not None or output is not None):
        other = "--output" if output is not None else "--curve"
        raise RecordError(f"--branches names both columns of the output: leave {other} out")
    rates = rates_hz or [None] * len(files)
    if branches is not None:
        made = _loops(files, column(input), column_list(branches), units, rates, how)
    else:
        made = _curves(
            files, column_list(input), column_list(output), curve or "", units, rates, how
        )
    driven, follows = made[0].channels
    return made, driven.name, follows.name


def train_range(text: str | None, read: list[Record]) -> tuple[int, int] | None:
    """Return the samples to fit, first and one behind the last, as counted in what was read.

    The text counts them as they are in the files.
    """
    given = row_range(text, "--train")
    if given is None:
        return None
    spans = {_span(given, record) for record in read}
    if len(spans) > 1:
        raise RecordError(
            "--train is one range of samples for all files, which differ in how they were "
            "resampled: give one file, or leave --train out"
        )
    first, stop = spans.pop()
    size = max(r.size for r in read)
    if first >= size or (stop is not None and stop <= 0):
        raise RecordError(
            f"--train {text} holds none of the samples that are read, {_numbered(read)}"
        )
    return max(first, 0), size if stop is None else stop


def _span(given: tuple[int | None, int | None], record: Record) -> tuple[int, int | None]:
    numbers = record.numbers
    if numbers is None:
        return given[0] or 0, given[1]
    if np.isnan(numbers).any():
        raise RecordError(
            "--train counts samples over time: of branches or curves, leave rows out by --rows"
        )
    if np.array_equal(numbers, numbers[0] + np.arange(numbers.size)):
        begin = int(numbers[0])
        return (given[0] or 0) - begin, None if given[1] is None else given[1] - begin
    first, stop = (None if n is None else int(np.searchsorted(numbers, n)) for n in given)
    return first or 0, stop


def _numbered(read: list[Record]) -> str:
    ends = [(0, r.size - 1) if r.numbers is None else r.numbers[[0, -1]] for r in read]
    return f"{min(e[0] for e in ends):.0f} to {max(e[1] for e in ends):.0f}"


def _loops(
    files: Sequence[Path],
    input: str | int,
    branches: list[str | int],
    units: tuple[str | None, str | None],
    rates: Sequence[float | None],
    how: dict[str, Any],
) -> list[Record]:
    if len(branches) != 2:
        raise RecordError(f"--branches needs two columns, UP,DOWN, got {len(branches)}")
    up, down = branches
    read = _tables(files, [units[0], units[1], units[1]], {**how, "columns": [input, up, down]})
    return [
        from_branches(table, input, up, down, sample_rate_hz=rate)
        for table, rate in zip(read, rates, strict=True)
    ]


def _curves(
    files: Sequence[Path],
    inputs: list[str | int],
    outputs: list[str | int],
    curve: str,
    units: tuple[str | None, str | None],
    rates: Sequence[float | None],
    how: dict[str, Any],
) -> list[Record]:
    if curve != "columns" and len(inputs) * len(outputs) != 1:
        raise RecordError(
            "--input and --output name one column each; where each curve has its own column, say "
            "so by --curve columns"
        )
    if curve == "columns":
        each = [units[0]] * len(inputs) + [units[1]] * len(outputs)
        # where a curve was not measured its column is empty
        used = {"columns": inputs[:1], "partial": [*inputs[1:], *outputs]}
        read = _tables(files, each, {**how, **used})
        return [
            curves_in_columns(table, inputs, outputs, sample_rate_hz=rate)
            for table, rate in zip(read, rates, strict=True)
        ]
    pair = [inputs[0], outputs[0]]
    if curve == "files":
        read = _tables(files, units, {**how, "columns": pair})
        return [curves_in_records(read, inputs[0], outputs[0], sample_rate_hz=rates[0])]
    by = column(curve)
    read = _tables(files, [*units, None], {**how, "columns": [*pair, by], "labels": by})
    return [
        curves_in_rows(table, inputs[0], outputs[0], by, sample_rate_hz=rate)
        for table, rate in zip(read, rates, strict=True)
    ]


def _tables(
    files: Sequence[Path], units: Sequence[str | None], how: dict[str, Any]
) -> list[Record]:
    return read_files(files, units=units, over="table", **how)
