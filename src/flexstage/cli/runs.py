"""`flexstage runs`: what was recorded, and what became of it."""

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
    output_path,
    print_json,
    print_notes,
    print_shown,
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
        "(default: FLEXSTAGE_CATALOGUE, or that of the user).",
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
        given = option_words(request)
        given += [name for name, v in (("--catalogue", catalogue), ("--json", json)) if v]
        if given:
            raise typer.BadParameter(f"give {given[0]} behind '{context.invoked_subcommand}'")
        return
    from flexstage.instruments.catalogue.catalogue import Catalogue

    with Catalogue.open(catalogue, make=False) as opened:
        found = opened.runs(request)
        where = opened.address
    if json:
        print_json({"catalogue": where, "runs": [_plain(entry) for entry in found]})
    else:
        _print_list(found, where)


@runs.command(cls=CliCommand)
@from_docstring
def show(
    identifier: Annotated[str, typer.Argument()],
    catalogue: _Catalogue = None,
    json: JsonOption = False,
) -> None:
    """Show the catalogue's entry of a run.

    Checks whether its file has changed since it was entered.

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
    """Enter the runs of folders into the catalogue.

    For runs that could not be entered when they were measured.

    Parameters
    ----------
    folders
        FOLDER...: Folders of runs with their records.
    """
    from flexstage.instruments.catalogue.catalogue import Catalogue
    from flexstage.instruments.catalogue.folder import folder_entries

    read = [folder_entries(folder) for folder in folders]
    entries = [entry for found, _ in read for entry in found]
    problems = [problem for _, told in read for problem in told]
    if not entries:
        where = ", ".join(f"'{folder}'" for folder in folders)
        raise RecordError("; ".join([f"no record of a run is in {where}", *problems]))
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
        screen.print(f"entered {new}, known before {len(entries) - new}")
        for problem in problems:
            screen.print(f"left out: {problem}", style="yellow", markup=False)
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

    It is written as HDF5.

    Parameters
    ----------
    file
        FILE: The stream file.
    out
        The HDF5 file to write (default: beside the stream).
    look
        Only report what is intact; write nothing.
    remove
        Remove the stream after the HDF5 file has been read back and compared.
    """
    from flexstage.instruments.recording.archive import examine, rescued

    found = examine(file)
    target = None
    if not look:
        target = rescued(file, out, remove=remove)
    removed = not file.exists()
    rate = found.head.sample_rate_hz
    result: dict[str, Any] = {
        "stream": str(file),
        "stage": found.head.run.stage,
        "identifier": found.head.run.identifier,
        "samples": found.samples,
        "duration": found.samples / rate,
        "sample_rate_hz": rate,
        "channels": [name for name, _ in found.head.channels],
        "complete": found.complete,
        "lost": [dataclasses.asdict(part) for part in found.lost],
        "notes": list(found.notes),
        "file": None if target is None else str(target),
        "stream_removed": removed,
    }
    if json:
        print_json(result)
        return
    screen = console()
    screen.print(
        f"{count(found.samples, 'sample')} of {count(len(found.head.channels), 'channel')} are "
        f"safe: {found.samples / rate:.6g} s at {rate:g} Hz",
        markup=False,
    )
    print_notes(screen, found.notes, style="yellow")
    if target is not None:
        screen.print(f"wrote {target}", markup=False, soft_wrap=True)
        kept = "removed" if removed else "kept"
        screen.print(f"{kept} {file}", markup=False, soft_wrap=True)


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
        found = opened.calibrations(request)
        where = opened.address
    if json:
        rows = [_plain_calibration(entry) for entry in found]
        print_json({"catalogue": where, "calibrations": rows})
        return
    heads = "what", "value", "standard uncertainty", "<unit", "<stage", "<serial number"
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
        for entry in found
    )
    title = f"{count(len(found), 'calibration')} in {where}"
    print_table(console(), title, (*heads, "<valid from, UTC", "~<run"), rows)


def _plain(entry: "RunEntry") -> dict[str, Any]:
    stage = entry.stage
    rest = {
        f.name: getattr(entry, f.name)
        for f in dataclasses.fields(entry)
        if f.name not in ("stage", "started")
    }
    return {
        "identifier": rest.pop("identifier"),
        "stage": stage.name,
        "serial_number": stage.serial_number,
        "design": stage.design,
        "stage_hash": stage.hash,
        "started": entry.started.isoformat(),
        **rest,
        "duration": entry.duration,
    }


def _plain_calibration(entry: "CalibrationEntry") -> dict[str, Any]:
    stage = picked(entry.stage, "stage=name", "serial_number")
    own = picked(entry, "what", "value", "standard_uncertainty", "unit")
    return {
        **own,
        **stage,
        "valid_from": entry.valid_from.isoformat(),
        **picked(entry, "run", "note"),
    }


def _state_of(entry: "RunEntry") -> str:
    """Say whether the file of a run is what was entered."""
    from flexstage.base.provenance import file_hash

    path = Path(entry.folder) / entry.file
    try:
        digest = file_hash(path)
    except OSError:
        return "not there"
    return "as entered" if digest == entry.sha256 else "changed since it was entered"


def _print_list(found: "list[RunEntry]", where: str) -> None:
    from flexstage.report.run import runs_table

    print_shown(console(), runs_table(found, f"{count(len(found), 'run')} in {where}"))
