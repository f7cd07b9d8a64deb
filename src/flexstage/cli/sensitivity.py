"""`flexstage sensitivity`: change of each figure of a stage by each parameter."""

from contextlib import suppress

from flexstage.base.errors import ModelError
from flexstage.cli.options import (
    JsonOption,
    QuietOption,
    from_docstring,
)
from flexstage.cli.output import (
    FigureFile,
    OutputFolder,
    console,
    display_table,
    print_notes,
    print_result,
    progress_bar,
    write_folder,
    write_picture,
)
from flexstage.cli.stage_options import NOTHING_SET, ParameterOptions, TemplateArgument
from flexstage.studies.explore.requests import SensitivityRequest


@from_docstring
def sensitivity(
    stage: TemplateArgument,
    request: SensitivityRequest,
    units: bool = False,
    folder: OutputFolder = None,
    figure: FigureFile = None,
    options: ParameterOptions = NOTHING_SET,
    quiet: QuietOption = False,
    json: JsonOption = False,
) -> None:
    """Sensitivity analysis: change of each figure by each parameter.

    Parameters
    ----------
    units
        Print changes in the units of the figures, not in per cent.
    folder
        Write sensitivity.json, sensitivity.csv and sensitivity.svg; with --hinges also necks.svg,
        a drawing of the stage with the most influential necks.
    figure
        Draw the changes as a colour map (.svg, .png or .pdf).
    """
    from flexstage.report.figures.sensitivity import draw_moving_necks
    from flexstage.report.result_files import sensitivity_files
    from flexstage.studies.explore.prepare import ready_sensitivity

    template = options.template(stage)
    run = ready_sensitivity(request, template)
    with progress_bar("sensitivity", quiet=quiet):
        result = run()
    files = write_folder(folder, lambda: sensitivity_files(result))
    files += write_picture(figure, result.plot)
    if folder is not None and request.hinges:
        drawing = None
        with suppress(ModelError):  # only the positions of necks were requested
            drawing = draw_moving_necks(template.stage(), result)
        if drawing is not None:
            files += write_picture(folder / "necks.svg", lambda: drawing)
    if json:
        print_result(result.to_dict(), files)
        return
    from flexstage.report.sensitivity import sensitivity_table, skipped_notes

    screen, table = console(), sensitivity_table(result, in_units=units)
    if len(table.rows) > 1:
        display_table(screen, table)
    notes = table.notes if len(table.rows) < 2 else ()
    print_notes(screen, (*notes, *skipped_notes(result)), files)
