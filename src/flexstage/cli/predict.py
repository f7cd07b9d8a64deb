"""`flexstage predict`: an identified model on a record that it was not made from."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from flexstage.cli.options import (
    JsonOption,
    from_docstring,
)
from flexstage.cli.output import (
    FigureFile,
    console,
    print_notes,
    print_result,
    print_shown,
    print_text,
    write_picture,
)
from flexstage.hysteresis.requests import PredictRequest
from flexstage.records.read_options import DriveColumns, ReadOptions

if TYPE_CHECKING:
    from collections.abc import Sequence

    from rich.console import Console

    from flexstage.hysteresis import DriveModel, Prediction


@from_docstring
def predict(
    model: Annotated[Path, typer.Argument()],
    records: Annotated[list[Path], typer.Argument()],
    *,
    columns: DriveColumns,
    request: PredictRequest,
    how: ReadOptions,
    figure: FigureFile = None,
    json: JsonOption = False,
) -> None:
    """Test an identified model on other records.

    The model is not fitted again. The motion before the record, from which its creep begins, is
    estimated from the first samples, until both ends of the range were reached. These samples do
    not count in the errors. If that motion is known, give it by `--start`.

    Parameters
    ----------
    model
        MODEL: A model file written by `flexstage identify --out`.
    records
        RECORD...: Measured files of the same drive.
    figure
        Draw the measured and the predicted loop of the first record. (.svg, .png or .pdf)
    """
    from flexstage.hysteresis.prediction import predict_by_file
    from flexstage.records.drives import read_drive
    from flexstage.report.identification import band_in_words

    read, driven, follows = read_drive(records, columns, how)
    result = predict_by_file(model, read, driven, follows, request)
    written = write_picture(figure, result.plot)
    if json:
        print_result(result.to_dict(), written)
        return
    screen, drive = console(), result.file.model
    print_predictions(screen, result.predictions, drive, f"{drive.hysteresis.kind}, {model}")
    if result.band is not None:
        screen.print(band_in_words(result.predictions, result.band))
    print_notes(screen, (), written)


def print_predictions(
    screen: "Console", found: "Sequence[Prediction]", model: "DriveModel", title: str
) -> None:
    """Print a table of how a model predicts records."""
    from flexstage.report.identification import prediction_in_words, predictions_table

    print_shown(screen, predictions_table(found, title))
    for p in found:
        for said in prediction_in_words(p, model):
            print_text(screen, said)
        print_notes(screen, p.notes, style="yellow")
