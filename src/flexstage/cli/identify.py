"""`flexstage identify`: a model of a drive from measured records."""

import dataclasses
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from flexstage.cli.options import (
    AxisOption,
    InputUnitOption,
    JsonOption,
    OutputUnitOption,
    QuietOption,
    from_docstring,
    positive_frequency,
    quantity,
    refuse,
    relative,
)
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
from flexstage.cli.reading import (
    AS_EVEN,
    WHOLE_FILE,
    BranchesOption,
    CurveOption,
    EvenTimeOptions,
    FileOptions,
    read_drive,
)
from flexstage.cli.stage_options import AS_DESCRIBED, StageOptions
from flexstage.errors import RecordError
from flexstage.files.plain import picked
from flexstage.stage.assumptions import DAMPING_RATIO

if TYPE_CHECKING:
    from rich.console import Console

    from flexstage.hysteresis.identification.identify import Identification
    from flexstage.records import Record


@from_docstring
def identify(
    records: Annotated[list[Path], typer.Argument()],
    input: str | None = None,
    output: str | None = None,
    branches: BranchesOption = None,
    curve: CurveOption = None,
    hysteresis_model: str = "auto",
    timing: EvenTimeOptions = AS_EVEN,
    input_unit: InputUnitOption = None,
    output_unit: OutputUnitOption = None,
    train: str | None = None,
    delay: str | None = None,
    creep: str | None = None,
    resonance: str | None = None,
    damping_ratio: Annotated[float, typer.Option(min=1e-4, max=0.9)] = DAMPING_RATIO,
    test_record: list[Path] | None = None,
    temperature: str | None = None,
    stage: str | None = None,
    taken: StageOptions = AS_DESCRIBED,
    axis: AxisOption = None,
    drift: bool = False,
    how: FileOptions = WHOLE_FILE,
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
    input
        COLUMN: Number or name of the input column (default: the one in V, or called so).
    output
        COLUMN: Number or name of the output column (default: the one in a unit of length or angle,
        or called so).
    hysteresis_model
        NAME: A hysteresis model, or several separated by commas, of bouc-wen, maxwell-slip,
        modified-prandtl-ishlinskii, preisach (auto tries these four), asymmetric-bouc-wen, dahl,
        duhem, generalised-bouc-wen, prandtl-ishlinskii. The simplest model is chosen that predicts
        held-out cycles as well as the best.
    train
        START:STOP: Samples to fit, numbered as for --rows; all others are held out (default: all
        are fitted, and held-out errors come from cross-validation over whole cycles).
    delay
        TIME: Known delay of the output, such as "5 ms"; delay and creep are then not fitted.
    creep
        SHARE: Known creep per decade of time, such as "1.2%"; delay and creep are then not fitted.
    resonance
        FREQUENCY: Known resonance of the stage with its drives in place, such as "808 Hz" (default:
        identified).
    damping_ratio
        RATIO: Damping ratio of the known resonance.
    test_record
        FILE: Another record, read with the same options, on which the model is tested without
        another fit; may be repeated.
    temperature
        LOW:HIGH: Temperature of the record, such as "294.5:296" in K; stored in the model file.
    stage
        STAGE: A stage file, or the name of a built-in design: the record is compared with its
        voltage range and stroke.
    drift
        Fit a drift of constant speed beside the model, in each record, and throw it away.
    out
        Write the model, as readable text.
    figure
        Draw measured and modelled loops, of four records at most. (.svg, .png or .pdf)
    """
    from flexstage.hysteresis.identification.identify import identify as run
    from flexstage.hysteresis.prediction import predict_each
    from flexstage.records.drives import train_range

    refuse(axis is not None and stage is None, "--axis needs --stage: it names an axis of that")
    taken.require_stage(stage, "--stage")
    one = "--curve files makes one record of all files: leave --test-record out"
    refuse(test_record and curve == "files", one, RecordError)
    given, driven, follows = read_drive(
        [*records, *(test_record or ())],
        input,
        output,
        branches=branches,
        curve=curve,
        units=(input_unit, output_unit),
        **vars(timing),
        **vars(how),
    )
    read, others = given[: len(records)], given[len(records) :]
    if (branches or curve) and timing.sample_rate is None and delay is None and creep is None:
        delay = "0 s"  # which rows without times do not tell
    known = None
    if resonance is not None:
        known = positive_frequency(resonance, "--resonance"), damping_ratio
    with progress_bar("identify", quiet=quiet):
        found = run(
            read,
            driven,
            follows,
            model=[word.strip() for word in hysteresis_model.split(",") if word.strip()],
            chain=_chain(delay, creep),
            resonance=known,
            temperature=_temperature(temperature),
            drift=drift,
            train=train_range(train, read),
        )
    tested = predict_each(found.model, others, driven, follows)
    if stage is not None:
        from flexstage.studies.measurement import against_description

        said = against_description(found, taken.stage(stage), axis)
        found = dataclasses.replace(found, warnings=(*said, *found.warnings))
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


def _chain(delay: str | None, creep: str | None) -> Any:
    if delay is None and creep is None:
        return None
    from flexstage.hysteresis.identification.fit_rows import ChainValues

    known = 0.0 if creep is None or creep.strip().rstrip("%") == "0" else relative(creep)
    seconds = 0.0 if delay is None else quantity(delay, "time")
    return ChainValues(delay=seconds, creep_per_decade=known)


def _temperature(text: str | None) -> tuple[float, float] | None:
    if text is None:
        return None
    words = text.split(":")
    sentence = f"--temperature must be one, or a range such as 294.5:296, got '{text}'"
    refuse(len(words) > 2, sentence)
    numbers = [quantity(word, "temperature", bare_unit="K") for word in words]
    return numbers[0], numbers[-1]


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
