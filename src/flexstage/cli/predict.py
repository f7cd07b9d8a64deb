"""`flexstage predict`: an identified model on a record that it was not made from."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from flexstage.cli.options import (
    JsonOption,
    from_docstring,
)
from flexstage.cli.output import (
    FigureFile,
    console,
    print_json,
    print_notes,
    print_shown,
    print_text,
    write_picture,
)
from flexstage.files.plain import picked
from flexstage.hysteresis.requests import PredictRequest
from flexstage.records.read_options import DriveColumns, ReadOptions

if TYPE_CHECKING:
    from collections.abc import Sequence

    from rich.console import Console

    from flexstage.hysteresis import DriveModel, Prediction
    from flexstage.hysteresis.drive_model import Start


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
    from flexstage.hysteresis.model_file import read_model_file
    from flexstage.hysteresis.prediction import predict_each
    from flexstage.records.drives import read_drive
    from flexstage.report.figures.identification import draw_prediction
    from flexstage.report.identification import band_in_words

    file = read_model_file(model)
    read, driven, follows = read_drive(records, columns, how)
    found = predict_each(file.model, read, driven, follows, request.known_start)
    band = file.errors.get("heldout_95")
    written = write_picture(figure, lambda: draw_prediction(found[0], file.model, band))
    result = {
        "model": file.model.hysteresis.kind,
        "file": str(model),
        "output_unit": file.model.output_unit,
        "errors_percent_of_stroke": dict(file.errors),
        **_total(found),
        "records": [prediction_result(p) for p in found],
        "warnings": list(file.warnings),
        "notes": sorted({note for r in read for note in r.notes}),
        "files": [str(path) for path in written],
    }
    if json:
        print_json(result)
        return
    screen = console()
    print_predictions(screen, found, file.model, f"{file.model.hysteresis.kind}, {model}")
    if band is not None:
        screen.print(band_in_words(found, band))
    print_notes(screen, (), written)


def _total(found: "Sequence[Prediction]") -> dict[str, float]:
    """Both errors over all records, each sample with the same weight."""
    import numpy as np

    sizes = np.array([p.time.size - p.warm_up for p in found], dtype=np.float64)
    made = {}
    for name in ("as_predicted_rms_percent", "free_constant_rms_percent"):
        squares = np.array([getattr(p, name) ** 2 for p in found])
        made[name] = float(np.sqrt(np.sum(sizes * squares) / np.sum(sizes)))
    return made


def start_value(start: "Start") -> str | float:
    """Return what a drive did before as JSON can hold it: a time [s], or a word."""
    return "long" if start == float("inf") else start


def prediction_result(found: "Prediction") -> dict[str, Any]:
    """Return a prediction as plain values."""
    return {
        **picked(found, "record=source", "as_predicted_rms_percent", "free_constant_rms_percent"),
        **picked(found, "constant_percent", "largest_percent", "stroke"),
        "start": start_value(found.start),
        "samples_not_counted": found.warm_up,
        "rates": [
            {
                "rate_hz": rate,
                "cycles": many,
                "as_predicted_rms_percent": predicted,
                "free_constant_rms_percent": free,
            }
            for rate, many, predicted, free in found.rates
        ],
        **picked(found, "cycles", "notes"),
    }


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
