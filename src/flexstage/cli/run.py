"""`flexstage run`: an experiment plan on an instrument, real or simulated."""

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
    print_json,
    print_notes,
    print_shown,
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
    taken: StageOptions = AS_DESCRIBED,
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
    wanted = read_plan(file)
    own = taken.stage(stage if stage is not None else stage_source(wanted, file.parent))
    wanted.selected(request.only)
    if dry_run:
        from flexstage.experiments import dry_run as tried

        found = tried(wanted, own, only=request.only)
        if json:
            print_json(found.to_dict())
        else:
            _print_dry(found, wanted.title or file.stem)
        if found.problems:
            typer.echo(f"flexstage: {found.problems[0]}", err=True)
            raise typer.Exit(2)
        return
    if bench.instrument is None:
        raise PlanError(
            "no instrument is named: give --instrument, such as gcs://192.168.0.10:50000, or "
            "twin://?seed=1 for a simulation; or look at the plan with --dry-run"
        )
    from flexstage.files.write import require_writable

    lacking = "--resume needs --folder: the folder of the run that was interrupted"
    refuse(request.resume and out is None, lacking, PlanError)
    from flexstage.experiments.runner import new_run_folder

    folder = out if out is not None else new_run_folder(Path("runs"), own.name, file.stem)
    require_writable(folder)
    from flexstage.instruments.catalogue.database import chosen_catalogue

    catalogue = chosen_catalogue(bench.catalogue)
    result = _carried_out(
        bench, wanted, folder, request, stage=own, title=file.stem, catalogue=catalogue,
        quiet=quiet,
    )  # fmt: skip
    from flexstage.report.run import run_text

    write_file(result.folder / "report.html", run_text(result).encode("utf-8"))
    if json:
        print_json(result.to_dict())
        return
    _print(result)


def _carried_out(
    bench: BenchRequest,
    plan: Any,
    folder: Path,
    request: RunRequest,
    *,
    stage: Any,
    quiet: bool,
    **more: Any,
) -> "PlanResult":
    from flexstage.experiments import run_plan
    from flexstage.instruments.connect import connect

    address = bench.instrument or ""
    device = connect(address, stage)
    try:
        if not device.identity.simulated and not bench.yes:
            _ask(device.identity, stage.name)
        if device.identity.simulated and address.startswith("ni:"):
            # a card is simulated where its driver is missing, whoever meant to measure
            typer.echo(f"flexstage: {device.settings().get('driver', address)}", err=True)
        try:
            with progress_bar("run", quiet=quiet):
                return run_plan(plan, device, folder, request, stage=stage, **more)
        except (KeyboardInterrupt, SystemExit):  # the latter by a signal to end
            sys.stderr.write(f"\nthe stage was stopped; {_how_to_resume(folder)}\n")
            raise
        except FlexstageError as error:
            # a folder that is refused holds nothing of this run
            refused = "--resume" in str(error) or "choose another folder" in str(error)
            if (folder / "run.json").exists() and not refused:
                raise type(error)(f"{error}; {_how_to_resume(folder)}") from error
            raise
    finally:
        device.close()


def _how_to_resume(folder: Path) -> str:
    return (
        f"what is complete is kept: take it up again by the same command with --resume --folder "
        f"{folder}"
    )


def _ask(identity: Any, stage: str) -> None:
    """Ask before a real stage moves."""
    name = " ".join(w for w in (identity.vendor, identity.model, identity.serial_number) if w)
    if not sys.stdin.isatty():
        raise PlanError(
            f"{name} is a real instrument, and nobody can be asked here: give --yes to let the "
            f"stage {stage} move"
        )
    if not typer.confirm(f"{name} will move the stage {stage}. Is its way clear?", err=True):
        raise typer.Abort


def _print_dry(found: "DryRun", title: str) -> None:
    from flexstage.report.run import dry_run_table

    screen = console()
    print_shown(screen, dry_run_table(found, title))
    for step in found.steps:
        print_notes(screen, (f"{step.name}: {note}" for note in step.notes))


def _print(result: "PlanResult") -> None:
    from flexstage.report.run import figures_table

    screen = console()
    if result.figures:
        print_shown(screen, figures_table(result))
    for step in result.steps:
        if step.line:
            screen.print(step.line, markup=False)
        if (shown := step.table) is not None:
            print_shown(screen, replace(shown, notes=()))
            print_notes(screen, shown.notes)
    print_notes(screen, result.notes, [result.folder / "report.html"])
