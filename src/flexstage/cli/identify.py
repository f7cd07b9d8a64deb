"""`flexstage identify`: identification of a drive model from measured records."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, ClassVar

import typer

from flexstage.base.errors import RecordError
from flexstage.cli.options import JsonOption, QuietOption, from_docstring, refuse
from flexstage.cli.output import (
    FigureFile,
    OutputFile,
    console,
    display_table,
    print_notes,
    print_result,
    progress_bar,
    write_file,
    write_picture,
)
from flexstage.cli.predict import print_predictions
from flexstage.cli.stage_options import AS_DESCRIBED, StageOptions
from flexstage.files.ranges import Written
from flexstage.files.request import Request
from flexstage.hysteresis.requests import OSCILLATOR, IdentifyRequest, rowwise
from flexstage.records.read_options import DriveColumns, ReadOptions

if TYPE_CHECKING:
    from rich.console import Console

    from flexstage.hysteresis.coupled_drives.identify import CoupledDriveIdentification
    from flexstage.hysteresis.identification.result import Identification
    from flexstage.hysteresis.oscillator.identify import OscillatorIdentification


@dataclass(frozen=True, slots=True, kw_only=True)
class ModelComparison(Request):
    """Data to compare an identified model with."""

    heading: ClassVar[str] = "Comparison of the model"

    test_record: Annotated[tuple[Path, ...], Written("FILE")] = ()
    """Another record, read with the same options, to test the model on without refitting it."""
    stage: Annotated[str, Written("STAGE")] | None = None
    """A stage file, or the name of a built-in design, to compare the record with its voltage range
    and stroke.
    """
    axis: Annotated[str, Written("NAME")] | None = None
    """Axis of the stage (default: the first)."""
    options: StageOptions = AS_DESCRIBED
    """Options of the stage."""

    def __post_init__(self) -> None:
        super(ModelComparison, self).__post_init__()
        refuse(self.axis and not self.stage, "--axis needs --stage, whose axis it names")
        self.options.require_stage(self.stage, "--stage")


@from_docstring
def identify(
    records: Annotated[list[Path], typer.Argument()],
    *,
    columns: DriveColumns,
    request: IdentifyRequest,
    comparison: ModelComparison,
    read_options: ReadOptions,
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
        Write the model file, a readable text.
    figure
        Draw measured and modelled loops of up to four records (.svg, .png or .pdf).
    """
    several = len(columns.input) > 1 and not columns.is_table
    if several or OSCILLATOR in request.model:
        kind = "several inputs are" if several else f"{OSCILLATOR} is"
        alone = IdentifyRequest() if several else IdentifyRequest(model=(OSCILLATOR,))
        refuse(
            request != alone or comparison.stage is not None or columns.is_table,
            f"{kind} identified without other models, options of a single drive or --stage: omit "
            "them",
            RecordError,
        )
        identified = _coupled_drives if several else _oscillator
        with progress_bar("identify", quiet=quiet):
            result, text = identified(records, columns, comparison.test_record, read_options)
        files = write_picture(figure, result.plot)
        if out is not None:
            write_file(out, text.encode())
            files.insert(0, out)
        if json:
            print_result(result.to_dict(), files)
        else:
            print_coupled_drives(console(), result, files)
        return
    from flexstage.hysteresis.identification.identify import identified_file
    from flexstage.hysteresis.identification.identify import identify as run
    from flexstage.hysteresis.model_file import model_text
    from flexstage.hysteresis.prediction import predict_each
    from flexstage.records.drives import read_drive

    message = "--curve files joins all files into one record: omit --test-record"
    refuse(comparison.test_record and columns.curve == "files", message, RecordError)
    records_read, driven, follows = read_drive(
        [*records, *comparison.test_record], columns, read_options
    )
    training, tests = records_read[: len(records)], records_read[len(records) :]
    if columns.is_table and not read_options.sample_rate:
        request = rowwise(request)
    with progress_bar("identify", quiet=quiet):
        result = run(training, driven, follows, request)
    if comparison.stage is not None:
        from flexstage.studies.measurement import against_description

        warnings = against_description(
            result, comparison.options.stage(comparison.stage), comparison.axis
        )
        result = replace(result, warnings=(*warnings, *result.warnings))
    result = replace(result, tested=tuple(predict_each(result.model, tests, driven, follows)))
    # drawn first: if the figure fails, no model is written
    files = write_picture(figure, result.plot)
    if out is not None:
        write_file(out, model_text(identified_file(result, training)).encode())
        files.insert(0, out)
    if json:
        print_result(result.to_dict(), files)
        return
    print_identification(console(), result, files)
    if result.tested:
        print_predictions(console(), result.tested, result.model, "test on other records")


def _coupled_drives(
    files: list[Path], columns: DriveColumns, tests: tuple[Path, ...], read_options: ReadOptions
) -> "tuple[CoupledDriveIdentification, str]":
    """Return the identification of several drives, and the text of its model file."""
    from flexstage.hysteresis.coupled_drives.identify import identify_coupled_drives
    from flexstage.hysteresis.coupled_drives.model_file import coupled_model_text
    from flexstage.records.read import read_files

    refuse(not columns.output, "several inputs need --output: name the columns", RecordError)
    names = [*columns.input, *columns.output]
    records = read_files([*files, *tests], names, options=read_options, even=True)
    training, test_records = records[: len(files)], records[len(files) :]
    result = identify_coupled_drives(
        training, columns.input, columns.output, test_records=test_records
    )
    return result, coupled_model_text(result)


def _oscillator(
    files: list[Path], columns: DriveColumns, tests: tuple[Path, ...], read_options: ReadOptions
) -> "tuple[OscillatorIdentification, str]":
    """Return the identification of an oscillator, and the text of its model file."""
    from flexstage.hysteresis.oscillator.identify import identify_oscillator
    from flexstage.hysteresis.oscillator.model_file import oscillator_text
    from flexstage.records.drives import read_drive

    refuse(len(files) > 1, f"{OSCILLATOR} is identified from one record: omit others", RecordError)
    (record, *test_records), *pair = read_drive([*files, *tests], columns, read_options)
    result = identify_oscillator(record, *pair)
    tested = result.model.predictions(test_records, *pair) if tests else None
    return replace(result, tested=tested), oscillator_text(result.model)


def print_coupled_drives(
    screen: "Console",
    result: "CoupledDriveIdentification | OscillatorIdentification",
    files: list[Path],
) -> None:
    """Print the tables of a model of coupled drives, or of an oscillator, and its validity."""
    from flexstage.report.coupled_drives import coupled_parts

    for part in coupled_parts(result):
        screen.print(part, markup=False) if isinstance(part, str) else display_table(screen, part)
    for warning in result.warnings:
        screen.print(f"warning: {warning}", style="yellow", markup=False)
    print_notes(screen, result.notes, files)


def print_identification(screen: "Console", result: "Identification", files: list[Path]) -> None:
    """Print candidates, the quality of the best fit, parameters, warnings and files."""
    from flexstage.report.identification import (
        candidates_table,
        failures,
        identification_in_words,
        parameters_table,
    )

    caption = f"{result.kind}: {', '.join(result.records)}"
    display_table(screen, candidates_table(result, caption))
    for failure in failures(result):
        screen.print(failure, style="yellow", markup=False)
    for line in identification_in_words(result):
        screen.print(line, markup=False)
    display_table(screen, parameters_table(result))
    for warning in result.warnings:
        screen.print(f"warning: {warning}", style="yellow", markup=False)
    print_notes(screen, result.notes, files)
