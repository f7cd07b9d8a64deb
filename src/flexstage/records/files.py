"""Several measured files that are read alike: of one kind, at even times where that is needed."""

from collections.abc import Sequence
from pathlib import Path
from typing import Literal

from flexstage.errors import RecordError
from flexstage.records.read import read_record
from flexstage.records.read_options import ReadOptions
from flexstage.records.record import Record
from flexstage.records.sampling import require_uniform

_SUCH = {
    "time": "samples with their times or their rate",
    "point": "a report of a measuring machine, or a table of positions",
    "frequency": "a universal file of frequency responses or spectra",
}


def read_files(
    files: Sequence[Path],
    columns: Sequence[str | int] | None,
    *,
    options: ReadOptions = ReadOptions(),
    over: Literal["time", "point", "frequency", "any", "table"] = "time",
    even: bool = False,
    labels: str | int | None = None,
    partial: Sequence[str | int] = (),
) -> list[Record]:
    """Read files, one record for each.

    `columns` are those that are used (all, where None); `partial` are further ones, which may be
    incomplete. `over` is what the samples must follow one another by: with point, rows of a text
    need no times; with table, times are not looked at. With `even`, uneven times are refused.
    `labels` is the column that labels the rows, with numbers or texts.
    """
    read = []
    for file, how in zip(files, options.of_each(len(files)), strict=True):
        record = read_record(
            file,
            how,
            columns=columns,
            partial=partial,
            over="point" if over in ("point", "table") else "time",
            labels=labels,
        )
        if over not in ("any", "table", record.over):
            raise RecordError(
                f"'{file}' is over {record.over}, and a record over {over} is needed: give "
                f"{_SUCH[over]}"
            )
        if even:
            require_uniform(record)
        read.append(record)
    return read
