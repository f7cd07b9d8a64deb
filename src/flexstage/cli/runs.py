"""`flexstage runs`: the catalogue of recorded runs, and the recovery of streams."""

import dataclasses
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from flexstage.base.errors import RecordError
from flexstage.cli.command import CliCommand, CliGroup
from flexstage.cli.options import JsonOption, from_docstring, option
from flexstage.cli.output import (
    OutputFile,
    console,
    count,
    display_table,
    output_path,
    print_json,
    print_notes,
    print_table,
)
from flexstage.files.plain import picked
from flexstage.files.request import option_words
from flexstage.instruments.requests import CalibrationsRequest, RunsRequest

if TYPE_CHECKING:
    from flexstage.instruments.catalogue.entries import CalibrationEntry, RunEntry

runs = typer.Typer(
    name="runs",
    cls=CliGroup,
    help="List, show, add and recover recorded runs.",
    no_args_is_help=False,
    rich_markup_mode=None,
)

_Catalogue = Annotated[
    str | None,
    option(
        "URL",
        "Catalogue: a file, or the URL of a database, such as postgresql://user@host/database "
        "(default: FLEXSTAGE_CATALOGUE, or the user's catalogue).",
        "--catalogue",
    ),
]


@runs.callback(invoke_without_command=True)
@from_docstring
def _list(
    context: typer.Context,
    request: RunsRequest,
    catalogue: _Catalogue = None,
    json: JsonOption = False,
) -> None:
    """List the runs in the catalogue, latest first."""
    if context.invoked_subcommand is not None:
        words = option_words(request)
        words += [name for name, v in (("--catalogue", catalogue), ("--json", json)) if v]
        if words:
            raise typer.BadParameter(f"give {words[0]} after '{context.invoked_subcommand}'")
        return
    from flexstage.instruments.catalogue.catalogue import Catalogue

    with Catalogue.open(catalogue, make=False) as opened:
        entries = opened.runs(request)
        where = opened.address
    if json:
        print_json({"catalogue": where, "runs": [_plain(entry) for entry in entries]})
    else:
        _print_list(entries, where)


@runs.command(cls=CliCommand)
@from_docstring
def show(
    identifier: Annotated[str, typer.Argument()],
    catalogue: _Catalogue = None,
    json: JsonOption = False,
) -> None:
    """Show the catalogue entry of a run.

    It says whether the file has changed since it was entered.

    Parameters
    ----------
    identifier
        ID: Identifier of the run, or its first characters.
    """
    from flexstage.instruments.catalogue.catalogue import Catalogue

    with Catalogue.open(catalogue, make=False) as opened:
        entry = opened.run(identifier)
        models = opened.models(run=entry.identifier)
    state = _state_of(entry)
    result = {
        **_plain(entry),
        "file_is": state,
        "models": [picked(model, "kind", "file", "axis", "figures") for model in models],
    }
    if json:
        print_json(result)
        return
    rows = [
        (name.replace("_", " "), str(value))
        for name, value in result.items()
        if name not in ("identifier", "models") and value not in ("", None)
    ]
    for model in models:
        figures = ", ".join(f"{k} {v:.4g}" for k, v in model.figures.items())
        rows.append(("model", f"{model.kind} {model.axis}: {model.file} {figures}".strip()))
    print_table(console(), f"run {entry.identifier}", ("", "<"), rows)


@runs.command(cls=CliCommand)
@from_docstring
def add(
    folders: Annotated[list[Path], typer.Argument(parser=output_path)],
    catalogue: _Catalogue = None,
    json: JsonOption = False,
) -> None:
    """Add the runs of folders to the catalogue.

    This is for runs that could not be entered when they were measured.

    Parameters
    ----------
    folders
        FOLDER...: Folders of runs with their records.
    """
    from flexstage.instruments.catalogue.catalogue import Catalogue, folder_entries

    results = [folder_entries(folder) for folder in folders]
    entries = [entry for run_entries, _ in results for entry in run_entries]
    problems = [problem for _, run_problems in results for problem in run_problems]
    if not entries:
        where = ", ".join(f"'{folder}'" for folder in folders)
        raise RecordError("; ".join([f"no records of runs in {where}", *problems]))
    with Catalogue.open(catalogue) as opened:
        new = sum(opened.enter_run(entry) for entry in entries)
        where = opened.address
    if json:
        print_json(
            {
                "catalogue": where,
                "entered": new,
                "known": len(entries) - new,
                "runs": [_plain(entry) for entry in entries],
                "problems": problems,
            }
        )
    else:
        _print_list(entries, where)
        screen = console()
        screen.print(f"entered {new}, already known {len(entries) - new}")
        for problem in problems:
            screen.print(f"skipped: {problem}", style="yellow", markup=False)
    if problems:
        raise typer.Exit(1)


@runs.command(cls=CliCommand)
@from_docstring
def recover(
    file: Annotated[Path, typer.Argument(parser=output_path)],
    out: OutputFile = None,
    look: bool = False,
    remove: bool = False,
    json: JsonOption = False,
) -> None:
    """Recover the intact part of a stream left by a crash.

    The result is an HDF5 file.

    Parameters
    ----------
    file
        FILE: The stream file.
    out
        The HDF5 file to write (default: in the folder of the stream).
    look
        Only report the intact part; write nothing.
    remove
        Remove the stream after the HDF5 file has been read back and compared.
    """
    from flexstage.instruments.recording.archive import examine, rescued

    examined = examine(file)
    target = None
    if not look:
        target = rescued(file, out, remove=remove)
    removed = not file.exists()
    rate = examined.head.sample_rate_hz
    result: dict[str, Any] = {
        "stream": str(file),
        "stage": examined.head.run.stage,
        "identifier": examined.head.run.identifier,
        "samples": examined.samples,
        "duration": examined.samples / rate,
        "sample_rate_hz": rate,
        "channels": [name for name, _ in examined.head.channels],
        "complete": examined.complete,
        "lost": [dataclasses.asdict(part) for part in examined.lost],
        "notes": list(examined.notes),
        "file": None if target is None else str(target),
        "stream_removed": removed,
    }
    if json:
        print_json(result)
        return
    screen = console()
    screen.print(
        f"{count(examined.samples, 'sample')} of {count(len(examined.head.channels), 'channel')} "
        f"intact: {examined.samples / rate:.6g} s at {rate:g} Hz",
        markup=False,
    )
    print_notes(screen, examined.notes, style="yellow")
    if target is not None:
        screen.print(f"wrote {target}", markup=False, soft_wrap=True)
        outcome = "removed" if removed else "kept"
        screen.print(f"{outcome} {file}", markup=False, soft_wrap=True)


@runs.command(cls=CliCommand)
@from_docstring
def calibrations(
    request: CalibrationsRequest,
    catalogue: _Catalogue = None,
    json: JsonOption = False,
) -> None:
    """List the calibrations in the catalogue, latest first."""
    from flexstage.instruments.catalogue.catalogue import Catalogue
    from flexstage.report.run import shown_time

    with Catalogue.open(catalogue, make=False) as opened:
        entries = opened.calibrations(request)
        where = opened.address
    if json:
        rows = [_plain_calibration(entry) for entry in entries]
        print_json({"catalogue": where, "calibrations": rows})
        return
    heads = "quantity", "value", "standard uncertainty", "<unit", "<stage", "<serial number"
    rows = (
        (
            entry.what,
            f"{entry.value:.9g}",
            f"{entry.standard_uncertainty:.3g}",
            entry.unit,
            entry.stage.name,
            entry.stage.serial_number,
            shown_time(entry.valid_from),
            entry.run[:8],
        )
        for entry in entries
    )
    title = f"{count(len(entries), 'calibration')} in {where}"
    print_table(console(), title, (*heads, "<valid from, UTC", "~<run"), rows)


def _plain(entry: "RunEntry") -> dict[str, Any]:
    stage = entry.stage
    details = {
        f.name: getattr(entry, f.name)
        for f in dataclasses.fields(entry)
        if f.name not in ("stage", "started")
    }
    return {
        "identifier": details.pop("identifier"),
        "stage": stage.name,
        "serial_number": stage.serial_number,
        "design": stage.design,
        "stage_hash": stage.hash,
        "started": entry.started.isoformat(),
        **details,
        "duration": entry.duration,
    }


def _plain_calibration(entry: "CalibrationEntry") -> dict[str, Any]:
    stage = picked(entry.stage, "stage=name", "serial_number")
    value = picked(entry, "what", "value", "standard_uncertainty", "unit")
    return {
        **value,
        **stage,
        "valid_from": entry.valid_from.isoformat(),
        **picked(entry, "run", "note"),
    }


def _state_of(entry: "RunEntry") -> str:
    """Return whether the file of a run is as entered, changed or missing."""
    from flexstage.base.provenance import file_hash

    path = Path(entry.folder) / entry.file
    try:
        digest = file_hash(path)
    except OSError:
        return "missing"
    return "as entered" if digest == entry.sha256 else "changed since it was entered"


def _print_list(entries: "list[RunEntry]", where: str) -> None:
    from flexstage.report.run import runs_table

    display_table(console(), runs_table(entries, f"{count(len(entries), 'run')} in {where}"))
