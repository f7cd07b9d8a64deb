"""`flexstage predict`: test of an identified model on other records."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from flexstage.base.errors import RecordError
from flexstage.cli.options import JsonOption, from_docstring, refuse
from flexstage.cli.output import (
    FigureFile,
    console,
    display_table,
    print_notes,
    print_result,
    print_text,
    write_picture,
)
from flexstage.hysteresis.requests import PredictRequest
from flexstage.records.read_options import DriveColumns, ReadOptions

if TYPE_CHECKING:
    from collections.abc import Sequence

    from rich.console import Console

    from flexstage.hysteresis import DriveModel, Prediction
    from flexstage.hysteresis.coupled_drives.prediction import CoupledPredictions


@from_docstring
def predict(
    model: Annotated[Path, typer.Argument()],
    records: Annotated[list[Path], typer.Argument()],
    *,
    columns: DriveColumns,
    request: PredictRequest,
    read_options: ReadOptions,
    figure: FigureFile = None,
    json: JsonOption = False,
) -> None:
    """Test an identified model on other records.

    The model is not refitted. The motion before the record, which determines the creep in it, is
    estimated from the first samples, until both ends of the range have been reached. These samples
    do not count in the errors. If that motion is known, give it by `--after`.

    Parameters
    ----------
    model
        MODEL: A model file written by `flexstage identify --out`.
    records
        RECORD...: Measured files of the same drive.
    figure
        Draw the measured and the predicted loop of the first record (.svg, .png or .pdf).
    """
    from flexstage.hysteresis.coupled_drives.model_file import is_coupled_model
    from flexstage.hysteresis.oscillator.model_file import is_oscillator, read_oscillator
    from flexstage.records.drives import read_drive
    from flexstage.report.coupled_drives import coupled_predictions_table

    if (oscillator := is_oscillator(model)) or is_coupled_model(model):
        kind = "an oscillator" if oscillator else "coupled drives"
        refuse(request.after != "auto", f"--after is not known for {kind}: omit it", RecordError)
        if oscillator:
            records_read, *pair = read_drive(records, columns, read_options)
            coupled = read_oscillator(model).predictions(records_read, *pair)
        else:
            missing = not columns.input or not columns.output
            refuse(missing, f"{kind} need --input and --output: name the columns", RecordError)
            coupled = _coupled_drives(model, records, columns, read_options)
        files = write_picture(figure, coupled.plot)
        if json:
            print_result(coupled.to_dict(), files)
            return
        display_table(console(), coupled_predictions_table(coupled, f"{kind}, {model}"))
        print_notes(console(), coupled.notes, files)
        return
    from flexstage.hysteresis.prediction import predict_by_file
    from flexstage.report.identification import band_in_words

    records_read, driven, follows = read_drive(records, columns, read_options)
    result = predict_by_file(model, records_read, driven, follows, request, read_options)
    files = write_picture(figure, result.plot)
    if json:
        print_result(result.to_dict(), files)
        return
    screen, drive = console(), result.file.model
    print_predictions(screen, result.predictions, drive, f"{drive.hysteresis.kind}, {model}")
    if result.band is not None:
        screen.print(band_in_words(result.predictions, result.band))
    print_notes(screen, (), files)


def _coupled_drives(
    model: Path, files: list[Path], columns: DriveColumns, read_options: ReadOptions
) -> "CoupledPredictions":
    from flexstage.hysteresis.coupled_drives.prediction import predict_coupled_drives
    from flexstage.records.read import read_files

    names = [*columns.input, *columns.output]
    records = read_files(files, names, options=read_options, even=True)
    return predict_coupled_drives(model, records, columns.input, columns.output)


def print_predictions(
    screen: "Console", predictions: "Sequence[Prediction]", model: "DriveModel", title: str
) -> None:
    """Print the errors of a model on records."""
    from flexstage.report.identification import prediction_in_words, predictions_table

    display_table(screen, predictions_table(predictions, title))
    for prediction in predictions:
        for line in prediction_in_words(prediction, model):
            print_text(screen, line)
        print_notes(screen, prediction.notes, style="yellow")
