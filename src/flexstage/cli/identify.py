"""`flexstage identify`: a model of a drive from measured records."""

import dataclasses
import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from flexstage.cli.common import (
    AxisOption,
    InputUnitOption,
    JsonOption,
    OutputUnitOption,
    QuietOption,
    console,
    figure_option,
    file_option,
    make_table,
    print_json,
    progress_bar,
    write_file,
)
from flexstage.cli.drive_records import BranchesOption, CurveOption, read_drive, train_range
from flexstage.cli.predict import (
    on_records,
    prediction_result,
    print_predictions,
    start_value,
)
from flexstage.cli.records import (
    DatasetOption,
    DecimalOption,
    DelimiterOption,
    FormatOption,
    ResampleOption,
    RowsOption,
    SampleRateOption,
    SkipLinesOption,
    TimeOption,
)
from flexstage.errors import ModelError, RecordError

if TYPE_CHECKING:
    from rich.console import Console

    from flexstage.hysteresis.identification.identify import Identification
    from flexstage.hysteresis.identification.model_choice import Candidate
    from flexstage.records import Record


def identify(
    records: Annotated[
        list[Path],
        typer.Argument(
            metavar="RECORD...",
            help="Measured files of one drive. Files at two or more rates separate lag and creep "
            "from hysteresis.",
        ),
    ],
    input: Annotated[
        str, typer.Option(metavar="COLUMN", help="Number or name of the input column.")
    ],
    output: Annotated[
        str | None,
        typer.Option(metavar="COLUMN", help="Number or name of the output column."),
    ] = None,
    branches: BranchesOption = None,
    curve: CurveOption = None,
    hysteresis_model: Annotated[
        str,
        typer.Option(
            metavar="NAME",
            help="A hysteresis model, such as bouc-wen or preisach, or several separated by "
            "commas; auto tries all. The simplest model is chosen that predicts held-out cycles "
            "as well as the best.",
        ),
    ] = "auto",
    sample_rate: SampleRateOption = None,
    time: TimeOption = None,
    resample: ResampleOption = None,
    input_unit: InputUnitOption = None,
    output_unit: OutputUnitOption = None,
    train: Annotated[
        str | None,
        typer.Option(
            metavar="START:STOP",
            help="Samples to fit, numbered as for --rows; all others are held out (default: all "
            "are fitted, and held-out errors come from cross-validation over whole cycles).",
        ),
    ] = None,
    delay: Annotated[
        str | None,
        typer.Option(
            metavar="TIME",
            help='Known delay of the output, such as "5 ms"; delay and creep are then not fitted.',
        ),
    ] = None,
    creep: Annotated[
        str | None,
        typer.Option(
            metavar="SHARE",
            help='Known creep per decade of time, such as "1.2%"; delay and creep are then not '
            "fitted.",
        ),
    ] = None,
    resonance: Annotated[
        str | None,
        typer.Option(
            metavar="FREQUENCY",
            help='Known resonance of the stage with its drives in place, such as "808 Hz" '
            "(default: identified).",
        ),
    ] = None,
    damping_ratio: Annotated[
        float,
        typer.Option(
            metavar="RATIO", min=1e-4, max=0.9, help="Damping ratio of the known resonance."
        ),
    ] = 0.01,
    test_record: Annotated[
        list[Path] | None,
        typer.Option(
            metavar="FILE",
            help="Another record, read with the same options, on which the model is tested without "
            "another fit; may be repeated.",
        ),
    ] = None,
    temperature: Annotated[
        str | None,
        typer.Option(
            metavar="LOW:HIGH",
            help='Temperature of the record, such as "294.5:296" in K; stored in the model file.',
        ),
    ] = None,
    stage: Annotated[
        str | None,
        typer.Option(
            metavar="STAGE",
            help="A stage file, or the name of a built-in design: the record is compared with its "
            "voltage range and stroke.",
        ),
    ] = None,
    axis: AxisOption = None,
    drift: Annotated[
        bool,
        typer.Option(
            "--drift",
            help="Fit a drift of constant speed beside the model, in each record, and throw it "
            "away.",
        ),
    ] = False,
    rows: RowsOption = None,
    format: FormatOption = None,
    dataset: DatasetOption = None,
    skip_lines: SkipLinesOption = 0,
    delimiter: DelimiterOption = None,
    decimal: DecimalOption = None,
    out: Annotated[
        Path | None,
        file_option("Write the model, as readable text."),
    ] = None,
    figure: Annotated[
        Path | None,
        figure_option("Draw measured and modelled loops, of four records at most."),
    ] = None,
    quiet: QuietOption = False,
    json: JsonOption = False,
) -> None:
    """Identify hysteresis, lag, creep and resonance of a drive."""
    from flexstage.hysteresis.identification.identify import identify as run

    if axis is not None and stage is None:
        raise ModelError("--axis needs --stage: it names an axis of that")
    if test_record and curve == "files":
        raise RecordError("--curve files makes one record of all files: leave --test-record out")
    given, driven, follows = read_drive(
        [*records, *(test_record or ())],
        input,
        output,
        branches=branches,
        curve=curve,
        units=(input_unit, output_unit),
        sample_rate=sample_rate,
        time=time,
        resample=resample,
        format=format,
        dataset=dataset,
        rows=rows,
        skip_lines=skip_lines,
        delimiter=delimiter,
        decimal=decimal,
    )
    read, others = given[: len(records)], given[len(records) :]
    if (branches or curve) and sample_rate is None and delay is None and creep is None:
        delay = "0 s"  # which rows without times do not tell
    with progress_bar("identify", quiet=quiet):
        found = run(
            read,
            driven,
            follows,
            model=[word.strip() for word in hysteresis_model.split(",") if word.strip()],
            chain=_chain(delay, creep),
            resonance=_mode(resonance, damping_ratio),
            temperature=_temperature(temperature),
            drift=drift,
            train=train_range(train, read),
        )
    tested = on_records(found.model, others, driven, follows)
    if stage is not None:
        from flexstage.cli.drive_description import against_description

        said = against_description(found, stage, axis)
        found = dataclasses.replace(found, warnings=(*said, *found.warnings))
    files = _write(found, read, out, figure)
    result = _result(found, read, files)
    if tested:
        result["test"] = [prediction_result(p) for p in tested]
    if json:
        print_json(result)
        return
    _print(console(), found, result)
    if tested:
        print_predictions(console(), tested, found.model, "on other records")


def _chain(delay: str | None, creep: str | None) -> Any:
    if delay is None and creep is None:
        return None
    from flexstage.cli.common import relative
    from flexstage.hysteresis.identification.chain_filter import ChainValues
    from flexstage.units import parse

    known = 0.0 if creep is None or creep.strip().rstrip("%") == "0" else relative(creep)
    seconds = 0.0 if delay is None else parse(delay, "time")
    return ChainValues(delay=seconds, creep_per_decade=known)


def _mode(resonance: str | None, damping: float) -> tuple[float, float] | None:
    if resonance is None:
        return None
    from flexstage.errors import ModelError
    from flexstage.units import parse

    frequency = parse(resonance, "frequency", bare_unit="Hz")
    if not frequency > 0.0:
        raise ModelError(f"--resonance must be a positive frequency, got '{resonance}'")
    return frequency, damping


def _temperature(text: str | None) -> tuple[float, float] | None:
    if text is None:
        return None
    from flexstage.errors import ModelError
    from flexstage.units import parse

    words = text.split(":")
    if len(words) > 2:
        raise ModelError(f"--temperature must be one, or a range such as 294.5:296, got '{text}'")
    numbers = [parse(word, "temperature", bare_unit="K") for word in words]
    return numbers[0], numbers[-1]


def _write(
    found: "Identification", read: "list[Record]", out: Path | None, figure: Path | None
) -> list[Path]:
    content: list[tuple[Path, bytes]] = []
    if out is not None:
        from flexstage.hysteresis.model_file import model_text

        content.append((out, model_text(_file(found, read)).encode()))
    if figure is not None:
        from flexstage.report.figures.identification import draw_identification
        from flexstage.report.figures.style import encode

        drawn = draw_identification(found, [r.source for r in read])
        image = encode(drawn, figure.suffix.lower().lstrip("."))
        content.append((figure, image))
    for path, own in content:
        write_file(path, own)
    return [path for path, _ in content]


def _file(found: "Identification", read: "list[Record]") -> Any:
    from flexstage.hysteresis.model_file import ModelFile
    from flexstage.provenance import content_hash, provenance

    origin = provenance(content_hash(tuple(r.source_hash for r in read)), found.settings)
    return ModelFile(
        model=found.model,
        provenance={
            **dataclasses.asdict(origin),
            "records": [{"file": r.source, "sha256": r.source_hash} for r in read],
        },
        errors={
            "rms": found.rms_percent,
            "max": found.max_percent,
            "heldout_rms": found.heldout_rms_percent,
            "heldout_max": found.heldout_max_percent,
            "heldout_free_constant": found.heldout_free_rms_percent,
            "heldout_95": found.heldout_band_percent,
        },
        warnings=found.warnings,
    )


def _result(found: "Identification", read: "list[Record]", files: list[Path]) -> dict[str, Any]:
    import dataclasses

    return {
        "records": [r.source for r in read],
        "model": found.kind,
        "rms_percent": found.rms_percent,
        "max_percent": found.max_percent,
        "heldout_rms_percent": found.heldout_rms_percent,
        "heldout_free_constant_rms_percent": found.heldout_free_rms_percent,
        "heldout_standard_error_percent": found.heldout_standard_error,
        "heldout_max_percent": found.heldout_max_percent,
        "heldout_band_percent": found.heldout_band_percent,
        "start": start_value(found.model.start),
        "settling": {"value": found.settling, "unit": found.model.output_unit},
        "noise_percent": found.noise_percent,
        "fitted": found.settings["fitted"],
        "stroke": {"value": found.stroke, "unit": found.model.output_unit},
        "parameters": _parameters(found),
        "chain": _chain_values(found),
        "candidates": [
            {
                "model": c.kind,
                "parameters": c.size,
                "rms_percent": c.rms_percent,
                "heldout_rms_percent": c.heldout_rms_percent,
                "heldout_free_constant_rms_percent": c.heldout_free_rms_percent,
                "failed": c.failed or None,
            }
            for c in found.candidates
        ],
        "verdict": dataclasses.asdict(found.verdict),
        "warnings": list(found.warnings),
        "notes": sorted({note for r in read for note in r.notes}),
        "files": [str(file) for file in files],
    }


def _percents(candidate: "Candidate") -> tuple[str, str, str]:
    """What a model leaves where it was fitted, and on what was held out, for the table."""
    c = candidate
    if c.rms_percent is None:
        return "failed", "", ""
    if c.failed:
        return f"{c.rms_percent:.3f}", "diverges", ""
    held = [
        "" if value is None else f"{value:.3f}"
        for value in (c.heldout_rms_percent, c.heldout_free_rms_percent)
    ]
    return f"{c.rms_percent:.3f}", held[0], held[1]


def _parameters(found: "Identification") -> dict[str, Any]:
    """Value, standard error and unit of each parameter; arrays of them for arrays."""
    import numpy as np

    from flexstage.hysteresis.identification.parameter_units import parameter_unit

    m = found.model
    made: dict[str, Any] = {}
    for name, value in m.hysteresis.parameters().items():
        array = np.asarray(value, dtype=np.float64)
        error = np.full(array.shape, np.nan)
        for estimate in found.parameters:
            base, _, index = estimate.name.partition("[")
            if base == name:
                place = tuple(int(i) for i in index.rstrip("]").split(",")) if index else ()
                error[place] = estimate.standard_error
        made[name] = {
            "value": array.tolist(),
            "standard_error": _without_nan(error),
            "unit": parameter_unit(found.kind, name, m.input_unit, m.output_unit),
        }
    return made


def _without_nan(value: Any) -> Any:
    """Numbers as JSON can hold them, which has none that is no number; None where all are none."""
    import numpy as np

    array = np.asarray(value, dtype=np.float64)
    if np.isnan(array).all():
        return None
    made = array.astype(object)
    made[np.isnan(array)] = None
    return made.tolist()


def _chain_values(found: "Identification") -> dict[str, Any]:
    m = found.model
    errors = {e.name: e.standard_error for e in found.chain}
    return {
        "delay": {
            "value": m.lag.delay if m.lag is not None else 0.0,
            "standard_error": _finite(errors.get("delay")),
            "unit": "s",
        },
        "creep_per_decade": {
            "value": m.creep.rate_per_decade if m.creep is not None else 0.0,
            "standard_error": _finite(errors.get("creep_per_decade")),
            "unit": "1",
        },
        "resonance": {
            "value": m.modes.frequency_hz[0] if m.modes is not None else None,
            "standard_error": _finite(errors.get("resonance_hz")),
            "unit": "Hz",
        },
        "offset": {
            "value": m.offset,
            "standard_error": found.offset.standard_error,
            "unit": m.output_unit,
        },
        "sign": m.sign,
    }


def _finite(error: float | None) -> float | None:
    return None if error is None or math.isinf(error) else error  # JSON has no infinity


def _print(screen: "Console", found: "Identification", result: dict[str, Any]) -> None:
    table = make_table(
        f"{found.kind}: {', '.join(result['records'])}",
        "model",
        "parameters",
        "fitted, % rms",
        "held out, as predicted, % rms",
        "with a free constant, % rms",
    )
    for c in found.candidates:
        table.add_row(c.kind, str(c.size), *_percents(c))
    screen.print(table)
    for c in found.candidates:
        if c.failed:
            screen.print(f"{c.kind}: {c.failed}", style="yellow", markup=False)
    for line in _in_words(found):
        screen.print(line, markup=False)
    values = make_table("parameters", "name", "value", "standard error", "<unit")
    for row in _rows(found, result):
        values.add_row(*row)
    screen.print(values)
    for warning in found.warnings:
        screen.print(f"warning: {warning}", style="yellow", markup=False)
    for note in result["notes"]:
        screen.print(f"note: {note}", style="dim", markup=False)
    for file in result["files"]:
        screen.print(f"wrote {file}", markup=False, soft_wrap=True)


def _in_words(found: "Identification") -> list[str]:
    """What was fitted and how well, line by line."""
    from flexstage.hysteresis.drive_model import start_in_words
    from flexstage.units import readable, readable_unit

    m, (low, high) = found.model, found.measurement.input_range
    shown, factor = readable_unit(found.stroke, m.output_unit)  # one unit for all readings
    shown, driven = shown or "output", m.input_unit or "input"
    slope = factor * found.stroke / (high - low)
    said = [
        f"fitted: {found.settings['fitted']}",
        f"stroke {factor * found.stroke:.4g} {shown} over {readable(driven, low, high, digits=4)}, "
        f"{slope:.3g} {shown}/{driven} on average; noise about {found.noise_percent:.2f} % of the "
        "stroke",
    ]
    if found.heldout_rms_percent is not None:
        error = found.heldout_standard_error
        known = "" if error is None else f" +- {error:.3f} (standard error)"
        said.append(
            f"held out, as predicted: {found.heldout_rms_percent:.3f}{known} % of the stroke rms; "
            f"95 % within {found.heldout_band_percent:.2f}, largest {found.heldout_max_percent:.2f}"
        )
    else:
        said.append(f"largest error {found.max_percent:.2f} % of the stroke")
    if m.creep is not None:
        of = "the first record" if len(found.measurement.sections) > 1 else "the record"
        said.append(
            f"before {of} the drive seems to have {start_in_words(*found.starts)}; creep "
            f"of that changes readings by up to {factor * found.settling:.2g} {shown}"
        )
    return said


def _rows(found: "Identification", result: dict[str, Any]) -> list[tuple[str, str, str, str]]:
    """Name, value, standard error and unit of what was found, as people read them."""
    from flexstage.hysteresis.identification.parameter_units import parameter_unit
    from flexstage.units import readable_unit

    m = found.model
    shown, factor = readable_unit(found.stroke, m.output_unit)
    unknown = {e.name for e in found.chain if math.isinf(e.standard_error)}
    made = []
    for name, row in result["parameters"].items():
        value, error = row["value"], row["standard_error"]
        if not isinstance(value, float) or (value == 0.0 and error is None):
            continue  # a table, or what this model does without
        power = _power(parameter_unit(found.kind, name, "input", "output"))
        unit = parameter_unit(found.kind, name, m.input_unit, shown)
        made.append((name, *_numbers(value, error, factor**power), unit))
    for name, row in result["chain"].items():
        if not isinstance(row, dict) or row["value"] is None:
            continue
        value, error = row["value"], row["standard_error"]
        own, times = readable_unit(max(abs(value), error or 0.0), row["unit"])
        if name == "offset":
            own, times = shown or "output", factor
        elif name == "creep_per_decade":
            own, times = "%", 100.0
        number, known = _numbers(value, error, times)
        known = "not determined" if name in unknown else known
        made.append((name.replace("_", " "), number, known, own))
    return made


def _power(unit: str) -> int:
    """Whether the output is over or under the line of a unit."""
    over, _, under = unit.partition("/")
    return ("output" in over) - ("output" in under)


def _numbers(value: float, error: float | None, factor: float) -> tuple[str, str]:
    """A value to the digits that its standard error leaves, and that error."""
    value *= factor
    if not error:
        return f"{value:.4g}", ""
    error *= factor
    least = min(error, abs(value) or error)
    return f"{value:.{max(1 - math.floor(math.log10(least)), 0)}f}", f"{error:.2g}"
