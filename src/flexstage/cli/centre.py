"""`flexstage centre`: eccentricity of a scale on a turning table, and the move that removes it."""

from pathlib import Path
from typing import Annotated

import typer

from flexstage.centring.requests import CentreRequest
from flexstage.cli.centre_report import print_setting, print_trial
from flexstage.cli.options import JsonOption, from_docstring
from flexstage.cli.output import (
    FigureFile,
    console,
    print_notes,
    print_result,
    write_picture,
)
from flexstage.records.read_options import ReadOptions


@from_docstring
def centre(
    records: Annotated[list[Path], typer.Argument()],
    *,
    request: CentreRequest,
    how: ReadOptions,
    figure: FigureFile = None,
    json: JsonOption = False,
) -> None:
    """Find a scale's eccentricity and the move that removes it.

    The harmonics of the error over the turn are fitted; that of order 1 gives the eccentricity.

    Parameters
    ----------
    records
        FILE...: Records of the error over the angle of the table. Several files are the heads of
        one setting if --heads has an angle for each, else settings in sequence.
    figure
        Draw the error over the turn and its harmonics. (.svg, .png or .pdf)
    """
    from flexstage.centring.from_records import centre_files

    found = centre_files(records, request, how)
    files = write_picture(figure, found.plot)
    if json:
        print_result(found.to_dict(), files)
        return
    for one in found.reports:
        print_setting(one)
    if found.trial is not None:
        print_trial(found.trial)
    print_notes(console(), found.notes, files)
