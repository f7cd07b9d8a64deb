"""`flexstage characterise`: characteristics of a stage from measured records."""

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from flexstage.base.errors import ConvergenceError, ModelError, StageError
from flexstage.cli.options import JsonOption, QuietOption, from_docstring, refuse
from flexstage.cli.output import (
    OutputFolder,
    console,
    display_table,
    print_notes,
    print_result,
    print_table,
    progress_bar,
)
from flexstage.cli.stage_options import AS_DESCRIBED, StageOptions
from flexstage.experiments.requests import CharacteriseRequest
from flexstage.files.plain import json_text
from flexstage.files.request import option_words
from flexstage.studies.requests import ComparisonRequest
from flexstage.system.requests import models_of

if TYPE_CHECKING:
    from rich.console import Console

    from flexstage.experiments.campaign.results import Characterisation, TestResult
    from flexstage.fem.stroke import FiniteStroke
    from flexstage.stage import Stage
    from flexstage.studies import MeasurementComparison

_PLANS = (".yaml", ".yml")


@from_docstring
def characterise(
    records: Annotated[list[Path] | None, typer.Argument()] = None,
    *,
    stage: str | None = None,
    virtual_seed: Annotated[int | None, typer.Option(min=0)] = None,
    request: CharacteriseRequest,
    comparison: ComparisonRequest,
    options: StageOptions = AS_DESCRIBED,
    out: OutputFolder = None,
    quiet: QuietOption = False,
    json: JsonOption = False,
) -> None:
    """Evaluate stroke, resolution, straightness and modes.

    Each value is reported with its uncertainty and its difference from models of the stage and from
    published values.

    Parameters
    ----------
    records
        FILE...: One test description (.yaml), or the measured files of one test.
    stage
        STAGE: A stage file, or the name of a built-in design, to compare with its models and
        published values.
    virtual_seed
        SEED: Simulate the measurements of --stage with this random seed, in place of files.
    out
        Write report.html and results.json, and the records of a virtual stage.
    """
    from flexstage.experiments.campaign.plan import read_campaign
    from flexstage.experiments.campaign.results import characterise as run
    from flexstage.experiments.campaign.results import characterise_files
    from flexstage.files.write import write_files
    from flexstage.report.measurement import measurement_text
    from flexstage.studies import compare_measurement

    files = records or []
    contents: dict[str, bytes] = {}
    plans = [file for file in files if file.suffix.lower() in _PLANS]
    if plans and len(files) > 1:
        raise ModelError(
            f"'{plans[0]}' is a test description and takes no further files: give it alone, or the "
            "measured files of one test"
        )
    if virtual_seed is not None or plans:
        _refuse_columns("--virtual-seed" if virtual_seed is not None else f"'{plans[0]}'", request)
    folder = Path()
    with progress_bar("characterise", quiet=quiet):
        if virtual_seed is not None:
            if files or stage is None:
                raise ModelError(
                    "--virtual-seed needs --stage and no files: it simulates its own records"
                )
            models = models_of(comparison.model)
            measurement, contents = _simulate(stage, options, virtual_seed, models)
        elif plans:
            folder = plans[0].parent
            measurement = run(read_campaign(plans[0]), folder)
        else:
            refuse(
                not files,
                "no files: give measured files or a test description (.yaml), or "
                "--virtual-seed with --stage",
            )
            measurement = characterise_files(files, request)
        stage_name = stage or _stage_path(measurement.stage, folder)
        options.require_stage(stage_name or None, "--stage")
        result = compare_measurement(
            measurement,
            options.stage(stage_name) if stage_name else None,
            models_of(comparison.model) if stage_name else (),
        )
    if out is not None:
        contents["report.html"] = measurement_text(result).encode()
        contents["results.json"] = json_text(result.to_dict()).encode()
    saved: list[Path] = [] if out is None else write_files(out, contents)
    if json:
        print_result(result.to_dict(), saved)
        return
    print_measurement(console(), result, saved)


def _refuse_columns(source: str, request: CharacteriseRequest) -> None:
    """Refuse options on columns and files that a test description already states."""
    unused = [word for word in option_words(request) if word.startswith("--")]
    refuse(
        unused,
        f"{', '.join(unused)} cannot be used with {source}, which describes its own records: "
        "omit it",
    )


def _stage_path(stage: str, folder: Path) -> str:
    """Return the stage of a test description; its path is relative to the description."""
    from flexstage.stage.designs import DESIGNS

    if not stage or stage.casefold() in DESIGNS:
        return stage
    return str(folder / stage)


def _simulate(
    stage: str, options: StageOptions, seed: int, models: Sequence[str]
) -> "tuple[Characterisation, dict[str, bytes]]":
    from flexstage.experiments.campaign.plan import campaign_text
    from flexstage.experiments.virtual_campaign import virtual_campaign
    from flexstage.records.write import record_bytes
    from flexstage.stage.designs import DESIGNS
    from flexstage.virtual.as_built import as_built

    described = options.stage(stage)
    strokes = _plane_strokes(described) if "plane" in models else ()
    built = as_built(described, seed=seed, strokes={path.axis: path for path in strokes})
    simulated = virtual_campaign(built, seed=seed)
    files = {name: record_bytes(record, "csv") for name, record in simulated.records.items()}
    campaign = simulated.campaign
    if stage.casefold() not in DESIGNS or options != AS_DESCRIBED:
        # the description must find its stage wherever the folder is moved
        from flexstage.stage.file import stage_to_text

        files["stage.yaml"] = stage_to_text(described).encode()
        campaign = replace(campaign, stage="stage.yaml")
    files["campaign.yaml"] = campaign_text(campaign).encode()
    return simulated.evaluated(), files


def _plane_strokes(stage: "Stage") -> "tuple[FiniteStroke, ...]":
    """Return the paths by finite elements of a stage whose straightness is not published."""
    from flexstage.quantities.characteristic import measured_value
    from flexstage.studies.models import run_model
    from flexstage.studies.requests import ModelOptions

    if all(measured_value(stage.published, "straightness", axis.name) for axis in stage.axes):
        return ()
    # the comparison with the models gives the reason of a failure
    with suppress(ConvergenceError, ModelError, StageError):
        return run_model(stage, "plane", ModelOptions(stroke=True)).strokes
    return ()


def print_measurement(
    screen: "Console", result: "MeasurementComparison", saved: list[Path]
) -> None:
    """Print figures, tests of positioning, notes, and the files that were written."""
    from flexstage.quantities.characteristic import shown_units
    from flexstage.quantities.quantity import value_and_uncertainty
    from flexstage.quantities.table import Column
    from flexstage.report.measurement import stroke_ranges
    from flexstage.report.tables import column_group, column_title

    # simulated figures have no differences
    columns = [c for c in result.references if any(c in row.differences for row in result.rows)]
    main_columns = ("published-measured", *columns[-1:])
    titles = [
        Column(column_title(c), "figures", column_group(c), c not in main_columns) for c in columns
    ]
    rows = []
    units = shown_units(row.figure for row in result.rows)
    simulated = any(row.source for row in result.rows)
    for row in result.rows:
        quantity = units[row.figure.quantity]
        estimate = row.figure.estimate
        cells = [
            *value_and_uncertainty(
                estimate.value * quantity.factor, estimate.expanded * quantity.factor
            ),
            quantity.shown_unit,
        ]
        for name in columns:
            difference = row.differences.get(name)
            cells.append("" if difference is None else _difference(difference))
        source = (row.source_kind,) if simulated else ()
        rows.append((quantity.label, row.figure.axis, *cells[:3], *source, *cells[3:]))
    heads = "quantity", "<axis", "value", "± (95 %)", "<unit", *(("<source",) if simulated else ())
    print_table(screen, result.title, (*heads, *titles), rows)
    if columns:
        screen.print("Differences from each model and publication; * significant at 95 %.")
    for measured in result.characterisation.results:
        if (ranges := stroke_ranges(measured)) is not None:
            display_table(screen, ranges)
        if "positioning" in measured.details:
            _print_positioning(screen, measured)
    print_notes(screen, result.notes, saved)


def _print_positioning(screen: "Console", result: "TestResult") -> None:
    from flexstage.report.measurement import positioning_tables

    tables = positioning_tables(result.details["positioning"])
    title = f"{result.test.name}, axis {result.test.axis}: ISO 230-2, values in {tables.unit}"
    for part in (tables.axis, tables.targets):
        print_table(screen, title, part.columns, part.rows)
        title = ""


def _difference(difference: Any) -> str:
    mark = "*" if difference.significant else ""
    # relative to a value near zero a percentage has no meaning
    if difference.percent is None or abs(difference.percent) > 1e4:
        return f"–{mark}"
    return f"{difference.percent:+.2f} %{mark}".replace("-", "−")
