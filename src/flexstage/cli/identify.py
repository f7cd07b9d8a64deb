"""`flexstage identify`: a model of a drive from measured records."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, ClassVar

import typer

from flexstage.cli.options import JsonOption, QuietOption, from_docstring, refuse
from flexstage.cli.output import (
    FigureFile,
    OutputFile,
    console,
    print_json,
    print_notes,
    print_shown,
    progress_bar,
    write_file,
    write_picture,
)
from flexstage.cli.predict import (
    prediction_result,
    print_predictions,
    start_value,
)
from flexstage.cli.stage_options import AS_DESCRIBED, StageOptions
from flexstage.errors import RecordError
from flexstage.files.plain import picked
from flexstage.files.ranges import Written
from flexstage.files.request import Request
from flexstage.hysteresis.requests import IdentifyRequest, rowwise
from flexstage.records.read_options import DriveColumns, ReadOptions

if TYPE_CHECKING:
    from rich.console import Console

    from flexstage.hysteresis.identification.identify import Identification
    from flexstage.records import Record


@dataclass(frozen=True, slots=True, kw_only=True)
class ComparedWith(Request):
    """What an identified model is compared with."""

    heading: ClassVar[str] = "Comparison of the model"

    test_record: Annotated[tuple[Path, ...], Written("FILE")] = ()
    """Another record, read with the same options, on which the model is tested without another
    fit.
    """
    stage: Annotated[str, Written("STAGE")] | None = None
    """A stage file, or the name of a built-in design: the record is compared with its voltage range
    and stroke.
    """
    axis: Annotated[str, Written("NAME")] | None = None
    """Axis of the stage (default: the first)."""
    taken: StageOptions = AS_DESCRIBED
    """How the stage is taken."""

    def __post_init__(self) -> None:
        super(ComparedWith, self).__post_init__()
        refuse(self.axis and not self.stage, "--axis needs --stage: it names an axis of that")
        self.taken.require_stage(self.stage, "--stage")


@from_docstring
def identify(
    records: Annotated[list[Path], typer.Argument()],
    *,
    columns: DriveColumns,
    request: IdentifyRequest,
    beside: ComparedWith,
    how: ReadOptions,
    out: OutputFile = None,
    figure: FigureFile = None,
    quiet: QuietOption = False,
    json: JsonOption = False,
) -> None:
    """Identify hysteresis, lag, creep and resonance of a drive.

    Parameters
    ----------
    records
        RECORD...: Measured files of one drive. Files at two or more rates separate lag and creep
        from hysteresis.
    out
        Write the model, as readable text.
    figure
        Draw measured and modelled loops, of four records at most. (.svg, .png or .pdf)
    """
    from flexstage.hysteresis.identification.identify import identify as run
    from flexstage.hysteresis.prediction import predict_each
    from flexstage.records.drives import read_drive

    one = "--curve files makes one record of all files: leave --test-record out"
    refuse(beside.test_record and columns.curve == "files", one, RecordError)
    given, driven, follows = read_drive([*records, *beside.test_record], columns, how)
    read, others = given[: len(records)], given[len(records) :]
    if columns.is_table and not how.sample_rate:
        request = rowwise(request)
    with progress_bar("identify", quiet=quiet):
        found = run(read, driven, follows, request)
    tested = predict_each(found.model, others, driven, follows)
    if beside.stage is not None:
        from flexstage.studies.measurement import against_description

        said = against_description(found, beside.taken.stage(beside.stage), beside.axis)
        found = replace(found, warnings=(*said, *found.warnings))
    files = _write(found, read, out, figure)
    result = identification_result(found, read, files)
    if tested:
        result["test"] = [prediction_result(p) for p in tested]
    if json:
        print_json(result)
        return
    print_identification(console(), found, result)
    if tested:
        print_predictions(console(), tested, found.model, "on other records")


def _write(
    found: "Identification", read: "list[Record]", out: Path | None, figure: Path | None
) -> list[Path]:
    from flexstage.hysteresis.identification.identify import identified_file
    from flexstage.hysteresis.model_file import model_text
    from flexstage.report.figures.identification import draw_identification

    names = [r.source for r in read]
    # a picture that cannot be made leaves no model beside an error
    drawn = write_picture(figure, lambda: draw_identification(found, names))
    if out is None:
        return drawn
    write_file(out, model_text(identified_file(found, read)).encode())
    return [out, *drawn]


def identification_result(
    found: "Identification", read: "list[Record]", files: list[Path]
) -> dict[str, Any]:
    """Return an identification as plain data."""
    from flexstage.report.identification import chain_found, parameters_found

    return {
        "records": [r.source for r in read],
        **picked(
            found,
            "model=kind",
            "rms_percent",
            "max_percent",
            "heldout_rms_percent",
            "heldout_free_constant_rms_percent=heldout_free_rms_percent",
            "heldout_standard_error_percent=heldout_standard_error",
            "heldout_max_percent",
            "heldout_band_percent",
        ),
        "start": start_value(found.model.start),
        "settling": {"value": found.settling, "unit": found.model.output_unit},
        "noise_percent": found.noise_percent,
        "fitted": found.settings["fitted"],
        "stroke": {"value": found.stroke, "unit": found.model.output_unit},
        "parameters": parameters_found(found),
        "chain": chain_found(found),
        "candidates": [
            {
                **picked(c, "model=kind", "parameters=size", "rms_percent", "heldout_rms_percent"),
                "heldout_free_constant_rms_percent": c.heldout_free_rms_percent,
                "failed": c.failed or None,
            }
            for c in found.candidates
        ],
        **picked(found, "verdict", "warnings"),
        "notes": sorted({note for r in read for note in r.notes}),
        "files": [str(file) for file in files],
    }


def print_identification(
    screen: "Console", found: "Identification", result: dict[str, Any]
) -> None:
    """Print candidates, how well the best one fits, parameters, warnings and files."""
    from flexstage.report.identification import (
        candidates_table,
        failures,
        identification_in_words,
        parameters_table,
    )

    caption = f"{found.kind}: {', '.join(result['records'])}"
    print_shown(screen, candidates_table(found, caption))
    for failed in failures(found):
        screen.print(failed, style="yellow", markup=False)
    for line in identification_in_words(found):
        screen.print(line, markup=False)
    print_shown(screen, parameters_table(found))
    for warning in found.warnings:
        screen.print(f"warning: {warning}", style="yellow", markup=False)
    print_notes(screen, result["notes"], result["files"])
