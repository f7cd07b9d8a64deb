"""`flexstage study`: all models of a stage compared with published values, in a report."""

from dataclasses import replace
from pathlib import Path

from flexstage.cli.options import JsonOption, QuietOption, from_docstring
from flexstage.cli.output import (
    OutputFolder,
    console,
    display_table,
    print_notes,
    print_result,
    progress_bar,
)
from flexstage.cli.stage_options import AS_DESCRIBED, StageArgument, StageOptions
from flexstage.files.names import file_name
from flexstage.studies.requests import StudyRequest


@from_docstring
def study(
    stage: StageArgument,
    request: StudyRequest,
    options: StageOptions = AS_DESCRIBED,
    out: OutputFolder = None,
    measured: Path | None = None,
    cache: bool = True,
    quiet: QuietOption = False,
    json: JsonOption = False,
) -> None:
    """Compare models with published values, in a report.

    The folder receives report.html and results.json, and with --parts virtual also
    virtual-measurement.html.

    Parameters
    ----------
    out
        Folder of the report (default: out/NAME).
    measured
        FILE: Test description (.yaml) whose measured values are added to the table.
    cache
        --cache/--no-cache: Reuse cached results of the same description, options and version of
        flexstage, and cache new ones.
    """
    from flexstage.files.cache import Memory, open_cache
    from flexstage.files.write import require_writable, write_files
    from flexstage.quantities.quantity import QUANTITIES
    from flexstage.report.study import study_files
    from flexstage.report.tables import characteristics_table, differences_table
    from flexstage.studies import run_study

    described = options.stage(stage)
    directory = out
    if directory is None:
        directory = Path("out") / file_name(described.name)
        require_writable(directory)
    with progress_bar("study", quiet=quiet):
        measurement = None
        if measured is not None:
            from flexstage.experiments.campaign.plan import read_campaign
            from flexstage.experiments.campaign.results import characterise

            measurement = characterise(read_campaign(measured), measured.parent)
        result = run_study(described, request, measured=measurement, cache=cache)
        contents = study_files(result, Memory(open_cache(cache)))
    files = write_files(directory, contents)
    if json:
        print_result(result.to_dict(), files)
        return
    screen = console()
    title = f"{described.name}: {described.title}" if described.title else described.name
    for table in (
        characteristics_table(result.comparison, QUANTITIES, title),
        differences_table(result.comparison),
    ):
        if table is not None:
            # the report has the conditions of every figure
            rows = tuple(tuple(replace(cell, note="") for cell in row) for row in table.rows)
            display_table(screen, replace(table, rows=rows, notes=()))
    if result.traditional is not None:
        from flexstage.report.traditional import claim_table
        from flexstage.studies.traditional import claim_conclusion

        display_table(screen, claim_table(result.traditional))
        screen.print(claim_conclusion(result.traditional), markup=False)
    notes = [f"{model} model skipped: {why}" for model, why in result.skipped_models.items()]
    for axis, why in result.skipped_experiments.items():
        notes.append(f"hysteresis of axis {axis} skipped: {why}")
    if not described.axes:
        notes.append("the stage has no axes: only modes were computed, see the report")
    if result.read:
        notes.append(f"{', '.join(result.read)}: read from the cache; --no-cache recomputes them")
    print_notes(screen, (*notes, *described.notes), files)
