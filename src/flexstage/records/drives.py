"""Records of a drive: over time, or as tables of branches and of reversal curves."""

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

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
from flexstage.records.read_options import (
    DriveColumns,
    ReadOptions,
    RowRange,
    read_column,
    write_rows,
)
from flexstage.records.record import Record


def read_drive(
    files: Sequence[Path], columns: DriveColumns, how: ReadOptions = ReadOptions()
) -> tuple[list[Record], str | int, str | int]:
    """Read what a drive was told and what followed: over time, or as tables of curves.

    Returns the records, evenly sampled and NaN where nothing was measured, then the columns that
    drive and follow. Over time those that are not given are taken of the first file, where units
    and names leave no choice; a note says so.
    """
    input, output = columns.input, columns.output
    if not columns.is_table:
        said: list[str] = []
        if not (input and output):
            input, output, *said = taken_drive(files[0], (input, output), how)
        wanted = [*input, *output]
        if len(wanted) != 2:
            raise RecordError("--input and --output name one column each, but of --curve columns")
        read = read_files(files, wanted, options=how, even=True)
        read[0] = replace(read[0], notes=(*said, *read[0].notes))
        return read, wanted[0], wanted[1]
    if not input or not (output or columns.branches):
        raise RecordError(
            "a table without times needs --input, and --output or --branches: name the columns"
        )
    option = "--branches" if columns.branches else "--curve"
    for other, given in (("--time", how.time), ("--resample", how.resample or None)):
        if given is not None:
            raise RecordError(f"{option} is for tables without times: leave {other} out")
    if columns.branches and (columns.curve is not None or output):
        other = "--output" if output else "--curve"
        raise RecordError(f"--branches names both columns of the output: leave {other} out")
    made = (_loops if columns.branches else _curves)(files, columns, how)
    driven, follows = made[0].channels
    return made, driven.name, follows.name


def train_range(given: RowRange | None, read: list[Record]) -> tuple[int, int] | None:
    """Return the samples to fit, first and one behind the last, as counted in what was read.

    What is given counts them as they are in the files.
    """
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
            f"--train {write_rows(given)} holds none of the samples that are read, "
            f"{_numbered(read)}"
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


def _loops(files: Sequence[Path], columns: DriveColumns, how: ReadOptions) -> list[Record]:
    if len(columns.branches) != 2 or len(columns.input) != 1:
        raise RecordError(
            f"--branches needs two columns, UP,DOWN, and one --input, got {len(columns.branches)} "
            f"and {len(columns.input)}"
        )
    (input,), (up, down) = columns.input, columns.branches
    read = read_files(files, [input, up, down], options=_timeless(how), over="table")
    return [
        from_branches(table, input, up, down, sample_rate_hz=each.rate)
        for table, each in zip(read, how.of_each(len(files)), strict=True)
    ]


def _timeless(how: ReadOptions) -> ReadOptions:
    return replace(how, sample_rate=())


def _curves(files: Sequence[Path], columns: DriveColumns, how: ReadOptions) -> list[Record]:
    inputs, outputs, curve = columns.input, columns.output, columns.curve or ""
    table = partial(read_files, files, options=_timeless(how), over="table")
    rates = [each.rate for each in how.of_each(len(files))]
    if curve != "columns" and len(inputs) * len(outputs) != 1:
        raise RecordError(
            "--input and --output name one column each; where each curve has its own column, say "
            "so by --curve columns"
        )
    if curve == "columns":
        # where a curve was not measured its column is empty
        read = table(inputs[:1], partial=[*inputs[1:], *outputs])
        return [
            curves_in_columns(one, inputs, outputs, sample_rate_hz=rate)
            for one, rate in zip(read, rates, strict=True)
        ]
    pair = [inputs[0], outputs[0]]
    if curve == "files":
        read = table(pair)
        return [curves_in_records(read, inputs[0], outputs[0], sample_rate_hz=rates[0])]
    by = read_column(curve)
    read = table([*pair, by], labels=by)
    return [
        curves_in_rows(one, inputs[0], outputs[0], by, sample_rate_hz=rate)
        for one, rate in zip(read, rates, strict=True)
    ]
