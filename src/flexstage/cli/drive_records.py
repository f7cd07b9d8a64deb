"""Records of a drive: over time, or as tables of branches and of reversal curves."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from flexstage.cli.options import option

if TYPE_CHECKING:
    from collections.abc import Sequence

    from flexstage.records import Record

BranchesOption = Annotated[
    str | None,
    option(
        "UP,DOWN",
        "Instead of --output: columns of the rising and the falling branch, in a table with "
        "one row for each input and no times.",
    ),
]
CurveOption = Annotated[
    str | None,
    option(
        "COLUMN|files|columns",
        "First-order reversal curves, measured on the way back to saturation: the column of "
        'their numbers or reversal points; "files" if each file is one curve, "columns" if '
        "--output lists one column for each.",
    ),
]


def read_drive(
    files: "Sequence[Path]",
    input: str | None,
    output: str | None,
    *,
    branches: str | None,
    curve: str | None,
    units: tuple[str | None, str | None],
    **given: Any,
) -> "tuple[list[Record], str | int, str | int]":
    """Read what a drive was told and what followed, as `records.drives` does.

    `given` are the fields of the options on reading files.
    """
    from flexstage.records.drives import read_drive as run
    from flexstage.records.reading_options import understood

    how = understood(len(files), **given)
    return run(files, input, output, branches=branches, curve=curve, units=units, **how)
