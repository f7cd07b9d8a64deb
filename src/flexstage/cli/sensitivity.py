"""`flexstage sensitivity`: which parameter of a stage moves which figure."""

from contextlib import suppress

from flexstage.cli.options import (
    JsonOption,
    ModelOption,
    QuietOption,
    from_docstring,
    positive_length,
)
from flexstage.cli.output import (
    FigureFile,
    OutputFolder,
    console,
    print_json,
    print_notes,
    print_shown,
    progress_bar,
    write_folder,
    write_picture,
)
from flexstage.cli.stage_options import NOTHING_SET, ParameterOptions, TemplateArgument
from flexstage.errors import ModelError


@from_docstring
def sensitivity(
    stage: TemplateArgument,
    of: list[str] | None = None,
    by: list[str] | None = None,
    hinges: bool = False,
    step: str | None = None,
    units: bool = False,
    model: ModelOption = "lumped",
    folder: OutputFolder = None,
    figure: FigureFile = None,
    taken: ParameterOptions = NOTHING_SET,
    quiet: QuietOption = False,
    json: JsonOption = False,
) -> None:
    """Show which parameter of a stage moves which figure.

    Parameters
    ----------
    of
        FIGURE: A figure that is looked at, such as natural_frequency.x, stroke (of every axis) or
        mass; may be repeated (default: ratio, stroke, frequency, stress and coupling of each axis).
    by
        NAME: A parameter, or a pattern of names such as "x.*"; may be repeated (default: all that
        change continuously).
    hinges
        Take neck and place of each hinge by itself in place of the parameters; those that do the
        same share a row.
    step
        --per LENGTH: Have lengths change by so much, such as "10 um", in place of 1 % of each; that
        is usual with --hinges.
    units
        Show the changes in the units of the figures, in place of per cent of them.
    folder
        Write sensitivity.json, sensitivity.csv and a picture, sensitivity.svg; with --hinges also
        necks.svg, the necks that move a figure most on the drawing of the stage.
    figure
        Draw the changes as a map of colours. (.svg, .png or .pdf)
    """
    from flexstage.explore.requests.sensitivity import SensitivityRequest
    from flexstage.report.explored_files import sensitivity_files
    from flexstage.report.figures.sensitivity import draw_moving_necks, draw_sensitivities

    request = SensitivityRequest(
        of=tuple(of or ()),
        by=tuple(by or ()),
        hinges=hinges,
        step=None if step is None else positive_length(step, "--per"),
        model=model,
    )
    template, length = taken.template(stage), request.length
    run = request.ready(template)
    with progress_bar("sensitivity", quiet=quiet):
        found = run()
    files = write_folder(folder, lambda: sensitivity_files(found, length))
    files += write_picture(figure, lambda: draw_sensitivities(found, length))
    if folder is not None and hinges:
        drawn = None
        with suppress(ModelError):  # the places of necks alone were asked for
            drawn = draw_moving_necks(template.stage(), found)
        if drawn is not None:
            files += write_picture(folder / "necks.svg", lambda: drawn)
    if json:
        from flexstage.explore.results import sensitivity_results

        print_json(sensitivity_results(found, length) | {"files": [str(file) for file in files]})
        return
    from flexstage.report.sensitivity import left_out_notes, sensitivity_table

    screen, shown = console(), sensitivity_table(found, length, in_units=units)
    if len(shown.rows) > 1:
        print_shown(screen, shown)
    own = shown.notes if len(shown.rows) < 2 else ()
    print_notes(screen, (*own, *left_out_notes(found, hinges=hinges)), files)
