"""`flexstage run`: an experiment plan on a real or simulated instrument."""

import sys
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from flexstage.base.errors import FlexstageError, PlanError
from flexstage.cli.options import JsonOption, QuietOption, from_docstring, refuse
from flexstage.cli.output import (
    OutputFolder,
    console,
    display_table,
    print_json,
    print_notes,
    progress_bar,
    write_file,
)
from flexstage.cli.stage_options import AS_DESCRIBED, StageOptions
from flexstage.experiments.requests import BenchRequest, RunRequest

if TYPE_CHECKING:
    from flexstage.experiments import DryRun, PlanResult


@from_docstring
def run(
    plan: Annotated[str, typer.Argument()],
    *,
    bench: BenchRequest,
    request: RunRequest,
    dry_run: bool = False,
    out: OutputFolder = None,
    stage: str | None = None,
    options: StageOptions = AS_DESCRIBED,
    quiet: QuietOption = False,
    json: JsonOption = False,
) -> None:
    """Carry out and evaluate an experiment plan.

    Records are written to disk while they are measured. --resume continues an interrupted run:
    complete steps are not repeated.

    Parameters
    ----------
    plan
        PLAN: A plan file, or the name of a built-in plan.
    dry_run
        Check the plan and list its motions, without an instrument.
    out
        Folder of the run (default: runs/TIME-STAGE).
    stage
        STAGE: A stage file, or the name of a built-in design, instead of that of the plan.
    """
    from flexstage.experiments import find_plan, read_plan
    from flexstage.experiments.plan import stage_source

    file = find_plan(plan)
    test_plan = read_plan(file)
    described = options.stage(stage if stage is not None else stage_source(test_plan, file.parent))
    test_plan.selected(request.only)
    if dry_run:
        from flexstage.experiments import dry_run as tried

        rehearsal = tried(test_plan, described, only=request.only)
        if json:
            print_json(rehearsal.to_dict())
        else:
            _print_dry(rehearsal, test_plan.title or file.stem)
        if rehearsal.problems:
            typer.echo(f"flexstage: {rehearsal.problems[0]}", err=True)
            raise typer.Exit(2)
        return
    if bench.instrument is None:
        raise PlanError(
            "no instrument: give --instrument, such as gcs://192.168.0.10:50000, or twin://?seed=1 "
            "for a simulation; or check the plan with --dry-run"
        )
    from flexstage.files.write import require_writable

    message = "--resume needs --folder, the folder of the interrupted run"
    refuse(request.resume and out is None, message, PlanError)
    from flexstage.experiments.runner import new_run_folder

    folder = out if out is not None else new_run_folder(Path("runs"), described.name, file.stem)
    require_writable(folder)
    from flexstage.instruments.catalogue.database import chosen_catalogue

    catalogue = chosen_catalogue(bench.catalogue)
    result = _carry_out(
        bench, test_plan, folder, request, stage=described, title=file.stem, catalogue=catalogue,
        quiet=quiet,
    )  # fmt: skip
    from flexstage.report.run import run_text

    write_file(result.folder / "report.html", run_text(result).encode("utf-8"))
    if json:
        print_json(result.to_dict())
        return
    _print(result)


def _carry_out(
    bench: BenchRequest,
    plan: Any,
    folder: Path,
    request: RunRequest,
    *,
    stage: Any,
    quiet: bool,
    **settings: Any,
) -> "PlanResult":
    from flexstage.experiments import run_plan
    from flexstage.instruments.connect import connect

    address = bench.instrument or ""
    device = connect(address, stage)
    try:
        if not device.identity.simulated and not bench.yes:
            _ask(device.identity, stage.name)
        if device.identity.simulated and address.startswith("ni:"):
            # a card whose driver is missing is simulated: the user may have meant to measure
            typer.echo(f"flexstage: {device.settings().get('driver', address)}", err=True)
        try:
            with progress_bar("run", quiet=quiet):
                return run_plan(plan, device, folder, request, stage=stage, **settings)
        except (KeyboardInterrupt, SystemExit):  # the latter by a signal to end
            sys.stderr.write(f"\nthe stage was stopped; {_how_to_resume(folder)}\n")
            raise
        except FlexstageError as error:
            # a refused folder contains nothing of this run
            refused = "--resume" in str(error) or "choose another folder" in str(error)
            if (folder / "run.json").exists() and not refused:
                raise type(error)(f"{error}; {_how_to_resume(folder)}") from error
            raise
    finally:
        device.close()


def _how_to_resume(folder: Path) -> str:
    return f"complete steps are kept: to resume, repeat the command with --resume --folder {folder}"


def _ask(identity: Any, stage: str) -> None:
    """Ask for confirmation before a real stage moves."""
    name = " ".join(w for w in (identity.vendor, identity.model, identity.serial_number) if w)
    if not sys.stdin.isatty():
        raise PlanError(
            f"{name} is a real instrument, and there is no terminal to ask for confirmation: give "
            f"--yes to let the stage {stage} move"
        )
    if not typer.confirm(f"{name} will move the stage {stage}. Is its path clear?", err=True):
        raise typer.Abort


def _print_dry(rehearsal: "DryRun", title: str) -> None:
    from flexstage.report.run import dry_run_table

    screen = console()
    display_table(screen, dry_run_table(rehearsal, title))
    for step in rehearsal.steps:
        print_notes(screen, (f"{step.name}: {note}" for note in step.notes))


def _print(result: "PlanResult") -> None:
    from flexstage.report.run import figures_table

    screen = console()
    if result.figures:
        display_table(screen, figures_table(result))
    for step in result.steps:
        if step.line:
            screen.print(step.line, markup=False)
        if (table := step.table) is not None:
            display_table(screen, replace(table, notes=()))
            print_notes(screen, table.notes)
    print_notes(screen, result.notes, [result.folder / "report.html"])
