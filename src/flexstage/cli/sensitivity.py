"""`flexstage sensitivity`: influence of the parameters of a stage on its figures."""

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
    print_notes,
    print_result,
    print_shown,
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
    taken: ParameterOptions = NOTHING_SET,
    quiet: QuietOption = False,
    json: JsonOption = False,
) -> None:
    """Run a sensitivity analysis of the parameters of a stage.

    Parameters
    ----------
    units
        Show the changes in the units of the figures instead of per cent.
    folder
        Write sensitivity.json, sensitivity.csv and a picture, sensitivity.svg; with --hinges also
        necks.svg, the necks with the largest influence on the drawing of the stage.
    figure
        Draw the changes as a map of colours. (.svg, .png or .pdf)
    """
    from flexstage.report.explored_files import sensitivity_files
    from flexstage.report.figures.sensitivity import draw_moving_necks
    from flexstage.studies.explore.prepare import ready_sensitivity

    template = taken.template(stage)
    run = ready_sensitivity(request, template)
    with progress_bar("sensitivity", quiet=quiet):
        found = run()
    files = write_folder(folder, lambda: sensitivity_files(found))
    files += write_picture(figure, found.plot)
    if folder is not None and request.hinges:
        drawn = None
        with suppress(ModelError):  # the places of necks alone were asked for
            drawn = draw_moving_necks(template.stage(), found)
        if drawn is not None:
            files += write_picture(folder / "necks.svg", lambda: drawn)
    if json:
        print_result(found.to_dict(), files)
        return
    from flexstage.report.sensitivity import sensitivity_table, skipped_notes

    screen, shown = console(), sensitivity_table(found, in_units=units)
    if len(shown.rows) > 1:
        print_shown(screen, shown)
    own = shown.notes if len(shown.rows) < 2 else ()
    print_notes(screen, (*own, *skipped_notes(found)), files)
