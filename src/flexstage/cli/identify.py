"""`flexstage identify`: a model of a drive from measured records."""

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
    print_notes,
    print_result,
    print_shown,
    progress_bar,
    write_file,
    write_picture,
)
from flexstage.cli.predict import print_predictions
from flexstage.cli.stage_options import AS_DESCRIBED, StageOptions
from flexstage.files.ranges import Written
from flexstage.files.request import Request
from flexstage.hysteresis.requests import IdentifyRequest, rowwise
from flexstage.records.read_options import DriveColumns, ReadOptions

if TYPE_CHECKING:
    from rich.console import Console

    from flexstage.hysteresis.identification.result import Identification


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
    from flexstage.hysteresis.identification.identify import identified_file
    from flexstage.hysteresis.identification.identify import identify as run
    from flexstage.hysteresis.model_file import model_text
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
    if beside.stage is not None:
        from flexstage.studies.measurement import against_description

        said = against_description(found, beside.taken.stage(beside.stage), beside.axis)
        found = replace(found, warnings=(*said, *found.warnings))
    found = replace(found, tested=tuple(predict_each(found.model, others, driven, follows)))
    # a picture that cannot be made leaves no model beside an error
    files = write_picture(figure, found.plot)
    if out is not None:
        write_file(out, model_text(identified_file(found, read)).encode())
        files.insert(0, out)
    if json:
        print_result(found.to_dict(), files)
        return
    print_identification(console(), found, files)
    if found.tested:
        print_predictions(console(), found.tested, found.model, "on other records")


def print_identification(screen: "Console", found: "Identification", files: list[Path]) -> None:
    """Print candidates, how well the best one fits, parameters, warnings and files."""
    from flexstage.report.identification import (
        candidates_table,
        failures,
        identification_in_words,
        parameters_table,
    )

    caption = f"{found.kind}: {', '.join(found.records)}"
    print_shown(screen, candidates_table(found, caption))
    for failed in failures(found):
        screen.print(failed, style="yellow", markup=False)
    for line in identification_in_words(found):
        screen.print(line, markup=False)
    print_shown(screen, parameters_table(found))
    for warning in found.warnings:
        screen.print(f"warning: {warning}", style="yellow", markup=False)
    print_notes(screen, found.notes, files)
