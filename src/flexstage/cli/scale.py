"""`flexstage scale`: error budget of a rotary table, and stages that can centre its scale."""

from pathlib import Path
from typing import Annotated

import typer

from flexstage.cli.options import JsonOption, from_docstring
from flexstage.cli.output import (
    FigureFile,
    console,
    display_table,
    print_notes,
    print_result,
    write_picture,
)
from flexstage.studies.requests import ScaleRequest


@from_docstring
def scale(
    table: Annotated[Path, typer.Argument()],
    request: ScaleRequest,
    figure: FigureFile = None,
    json: JsonOption = False,
) -> None:
    """Find which stages can centre the scale of a rotary table.

    The error budget of the table gives the eccentricity that its tolerance allows. The exit status
    is 1 if no stage suits.

    Parameters
    ----------
    table
        TABLE: A description of a rotary table in YAML: scale, heads, axis, space, tolerance.
    figure
        Draw the error budget (.svg, .png or .pdf).
    """
    from flexstage.centring.table_file import read_table
    from flexstage.report.scale import budget_table, needs_table, one_stage_table, stages_table
    from flexstage.studies.scale import study_scale

    study = study_scale(read_table(table), request)
    files = write_picture(figure, study.plot)
    if json:
        print_result(study.to_dict(), files)
    else:
        screen = console()
        display_table(screen, budget_table(study))
        display_table(screen, needs_table(study))
        for judged in study.stages if request.stage else ():
            if judged.needs:
                display_table(screen, one_stage_table(judged))
        display_table(screen, stages_table(study))
        print_notes(screen, study.notes, files)
    if not any(judged.suits for judged in study.stages):
        raise typer.Exit(1)
