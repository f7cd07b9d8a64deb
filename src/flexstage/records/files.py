"""Several measured files that are read alike: of one kind, at even times where that is needed."""

from collections.abc import Sequence
from pathlib import Path
from typing import Literal

from flexstage.errors import RecordError
from flexstage.records.read import read_record
from flexstage.records.record import Record
from flexstage.records.sampling import (
    LARGEST_STEP,
    LARGEST_UNEVEN_STEP,
    evened,
    require_uniform,
)

_SUCH = {
    "time": "samples with their times or their rate",
    "point": "a report of a measuring machine, or a table of positions",
    "frequency": "a universal file of frequency responses or spectra",
}


def read_files(
    files: Sequence[Path],
    columns: Sequence[str | int] | None,
    *,
    units: Sequence[str | None],
    rates_hz: Sequence[float | None] | None = None,
    time: str | int | None = None,
    format: str | None = None,
    dataset: str | None = None,
    rows: tuple[int | None, int | None] | None = None,
    skip_lines: int = 0,
    delimiter: str | None = None,
    decimal: str | None = None,
    over: Literal["time", "point", "frequency", "any", "table"] = "time",
    resample_hz: Sequence[float | None] | None = None,
    even: bool = False,
    labels: str | int | None = None,
    partial: Sequence[str | int] = (),
) -> list[Record]:
    """Read files, one record for each.

    `units` are those of `columns` (all, where None), then of `partial`: further columns, which may
    be incomplete. `rates_hz` are sample rates, one for each file. `over` is what the samples must
    follow one another by: with point, rows of a text need no times; with table, times are not
    looked at. `resample_hz` are rates of even times, one for each file, None in it that of the
    median step; with `even`, uneven times are refused. `labels` is the column that labels the rows,
    with numbers or texts.
    """
    all_used = (*(columns or ()), *partial)
    named = {str(c): u for c, u in zip(all_used, units, strict=True) if u is not None}
    read = [
        read_record(
            file,
            format=format,
            sample_rate_hz=rate,
            time=time,
            units=named,
            dataset=dataset,
            columns=columns,
            rows=rows,
            skip_lines=skip_lines,
            delimiter=delimiter,
            decimal=decimal,
            over="point" if over in ("point", "table") else "time",
            largest_step=LARGEST_STEP if resample_hz is None else LARGEST_UNEVEN_STEP,
            labels=labels,
        )
        for file, rate in zip(files, rates_hz or [None] * len(files), strict=True)
    ]
    for file, record in zip(files, read, strict=True):
        if over not in ("any", "table", record.over):
            raise RecordError(
                f"'{file}' is over {record.over}, and a record over {over} is needed: give "
                f"{_SUCH[over]}"
            )
    if resample_hz is not None:
        for record in read:
            if record.over != "time":
                raise RecordError(
                    f"'{record.source}' is over {record.over}, and --resample is for samples over "
                    "time: leave it out"
                )
        read = [evened(record, rate) for record, rate in zip(read, resample_hz, strict=True)]
    if even:
        for record in read:
            require_uniform(record)
    return read
