"""`flexstage characterise`: the figures of a stage from measured records."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from flexstage.cli.characterise_tables import print_measurement
from flexstage.cli.options import (
    JsonOption,
    ModelsOption,
    QuietOption,
    from_docstring,
    model_names,
    optional,
    quantity,
    refuse,
    relative,
)
from flexstage.cli.output import OutputFolder, console, print_json, progress_bar
from flexstage.cli.reading import (
    AS_TIMED,
    WHOLE_FILE,
    FileOptions,
    TimeOptions,
)
from flexstage.cli.stage_options import AS_DESCRIBED, StageOptions
from flexstage.errors import ModelError
from flexstage.files.plain import json_text

if TYPE_CHECKING:
    from flexstage.experiments.campaign.plan import Columns, FileReading
    from flexstage.experiments.campaign.results import Characterisation

_PLANS = (".yaml", ".yml")


@dataclass(frozen=True, kw_only=True)
class ColumnOptions:
    """Which column holds what.

    Parameters
    ----------
    command
        COLUMN: Number or name of the column of the command.
    along
        COLUMN: Number or name of the column of the position along the axis.
    across
        COLUMN: Number or name of the column of the transverse motion in the plane.
    vertical
        COLUMN: Number or name of the column of the motion out of the plane.
    roll
        COLUMN: Number or name of the column of the rotation about the axis.
    pitch
        COLUMN: Number or name of the column of the rotation about the transverse direction.
    yaw
        COLUMN: Number or name of the column of the rotation about the normal.
    input
        COLUMN: Number or name of the column of the force or other excitation.
    output
        COLUMNS: Columns of the response, separated by commas.
    corner
        COLUMN: Number or name of the column of the number of the corner.
    x
        COLUMN: Number or name of the column of the reading in x at the corners.
    y
        COLUMN: Number or name of the column of the reading in y at the corners.
    spheres
        NAMES: Names of the spheres, separated by commas.
    direction
        COLUMN: Number or name of the column of the direction of approach: up or down, 1 or -1.
    upward
        COLUMNS: For a table with a row for each target: columns of the upward runs, separated by
        commas.
    downward
        COLUMNS: For such a table: columns of the downward runs.
    """

    command: str | None = None
    along: str | None = None
    across: str | None = None
    vertical: str | None = None
    roll: str | None = None
    pitch: str | None = None
    yaw: str | None = None
    input: str | None = None
    output: str | None = None
    corner: str | None = None
    x: str | None = None
    y: str | None = None
    spheres: str | None = None
    direction: str | None = None
    upward: str | None = None
    downward: str | None = None


#: None of them given.
_NO_COLUMNS = ColumnOptions()


@from_docstring
def characterise(
    records: Annotated[list[Path] | None, typer.Argument()] = None,
    stage: str | None = None,
    taken: StageOptions = AS_DESCRIBED,
    virtual_seed: Annotated[int | None, typer.Option(min=0)] = None,
    test: str = "motion",
    axis: str = "x",
    columns: ColumnOptions = _NO_COLUMNS,
    cycle: str = "auto",
    deviations: bool = False,
    commands: str | None = None,
    column_unit: list[str] | None = None,
    calibration: str | None = None,
    alignment: str | None = None,
    confidence: Annotated[float, typer.Option(min=0.5, max=0.9999)] = 0.95,
    models: ModelsOption = "lumped,superelement",
    timing: TimeOptions = AS_TIMED,
    how: FileOptions = WHOLE_FILE,
    out: OutputFolder = None,
    quiet: QuietOption = False,
    json: JsonOption = False,
) -> None:
    """Evaluate stroke, resolution, straightness and modes.

    Every value has its uncertainty, and its difference from models of the stage and published
    values.

    Parameters
    ----------
    records
        FILE...: One test description (.yaml), or the measured files of one test.
    stage
        STAGE: A stage file, or the name of a built-in design, to compare with its models and
        published values.
    virtual_seed
        SEED: Instead of files: simulate the measurements of --stage, with this random seed.
    test
        KIND: Kind of test: motion, spheres, positioning, staircase, hold, response, ring-down or
        workspace.
    axis
        NAME: The axis that moves; for a workspace both, as xy.
    cycle
        FORM: For positioning with a row for each approach: standard (series up and down) or step
        (each target from both sides in turn); auto also finds rests of several samples.
    deviations
        For positioning: the readings are deviations from the targets, not positions.
    commands
        LENGTHS: For spheres: command at each station, separated by commas, if there is no such
        column: "0 um,5 um,10 um,5 um,0 um".
    column_unit
        ROLE=UNIT: Unit of a column without one, such as "along=um"; may be repeated.
    calibration
        SHARE: Relative standard uncertainty of the sensor sensitivity, such as "0.05%".
    alignment
        ANGLE: Standard uncertainty of the direction of the sensors, such as "1 mrad".
    confidence
        SHARE: For a staircase: confidence level of a step.
    out
        Write report.html and results.json, and the records of a virtual stage.
    """
    from flexstage.experiments.campaign.plan import Campaign, Test, read_campaign
    from flexstage.experiments.campaign.results import characterise as run
    from flexstage.files.write import write_files
    from flexstage.report.measurement import measurement_text
    from flexstage.sensor import SensorSpecification
    from flexstage.studies import compare_measurement
    from flexstage.studies.measurement import measurement_results

    files = records or []
    written: dict[str, bytes] = {}
    plans = [file for file in files if file.suffix.lower() in _PLANS]
    if plans and len(files) > 1:
        raise ModelError(
            f"'{plans[0]}' describes tests and stands alone: give it without other files, or the "
            "measured files of one test"
        )
    if virtual_seed is not None or plans:
        _no_columns(
            "--virtual-seed" if virtual_seed is not None else f"'{plans[0]}'",
            {
                **vars(columns),
                "commands": commands,
                "column_unit": column_unit,
                "deviations": deviations,
                "cycle": cycle != "auto",
                "calibration": calibration,
                "alignment": alignment,
                **vars(timing),
                **vars(how),
            },
        )
    folder = Path()
    with progress_bar("characterise", quiet=quiet):
        if virtual_seed is not None:
            if files or stage is None:
                raise ModelError(
                    "--virtual-seed needs --stage and no files: it makes its own records"
                )
            found, written = _virtual(stage, taken, virtual_seed)
        elif plans:
            folder = plans[0].parent
            found = run(read_campaign(plans[0]), folder)
        else:
            refuse(
                not files,
                "no file is given: give measured files or a test description (.yaml), or "
                "--virtual-seed with --stage",
            )
            sensor = SensorSpecification(
                name="sensor",
                calibration=0.0 if calibration is None else relative(calibration),
                alignment=0.0 if alignment is None else quantity(alignment, "angle"),
            )
            one = Test(
                name=test,
                kind=test,
                axis=axis,
                records=tuple(map(str, files)),
                columns=_columns(columns),
                units=_units(column_unit or []),
                reading=_reading(timing, how),
                along="sensor",
                transverse="sensor",
                angle="sensor",
                confidence=confidence,
                commands=tuple(quantity(text, "length") for text in _words(commands)),
                cycle=cycle,
                deviations=deviations,
            )
            campaign = Campaign(instruments=(sensor,), tests=(one,))
            found = run(campaign, Path())
        described = stage or _beside(found.stage, folder)
        taken.require_stage(described or None, "--stage")
        result = compare_measurement(
            found,
            taken.stage(described) if described else None,
            model_names(models) if described else (),
        )
    results = measurement_results(result)
    if out is not None:
        written["report.html"] = measurement_text(result).encode()
        written["results.json"] = json_text(results).encode()
        saved = [str(path) for path in write_files(out, written)]
    else:
        saved = []
    if json:
        print_json({**results, "files": saved})
        return
    print_measurement(console(), result, saved)


def _words(text: str | None) -> tuple[str, ...]:
    return tuple(w.strip() for w in (text or "").split(",") if w.strip())


def _no_columns(source: str, given: dict[str, Any]) -> None:
    """Refuse options on columns and files where a description says all that."""
    idle = [f"--{name.replace('_', '-')}" for name, value in given.items() if value]
    refuse(
        idle,
        f"{', '.join(idle)} has no meaning with {source}, which says what its records hold: "
        "leave it out",
    )


def _beside(stage: str, folder: Path) -> str:
    """Return the stage that a description names: its files are named from its own folder."""
    from flexstage.designs import DESIGNS

    if not stage or stage.casefold() in DESIGNS:
        return stage
    return str(folder / stage)


def _virtual(
    stage: str, taken: StageOptions, seed: int
) -> "tuple[Characterisation, dict[str, bytes]]":
    from flexstage.designs import DESIGNS
    from flexstage.experiments.campaign.plan import campaign_text
    from flexstage.experiments.virtual_campaign import virtual_campaign
    from flexstage.records.write import record_bytes
    from flexstage.virtual.as_built import as_built

    described = taken.stage(stage)
    made = virtual_campaign(as_built(described, seed=seed), seed=seed)
    files = {name: record_bytes(record, "csv") for name, record in made.records.items()}
    campaign = made.campaign
    if stage.casefold() not in DESIGNS or taken != AS_DESCRIBED:
        # the description must find the stage that it belongs to, wherever the folder is taken
        from flexstage.stage.file import stage_to_text

        files["stage.yaml"] = stage_to_text(described).encode()
        campaign = replace(campaign, stage="stage.yaml")
    files["campaign.yaml"] = campaign_text(campaign).encode()
    return made.evaluated(), files


def _columns(given: ColumnOptions) -> "Columns":
    from flexstage.experiments.campaign.plan import Columns

    several = {"output", "spheres", "upward", "downward"}
    roles: dict[str, Any] = {
        role: _words(text) if role in several else text for role, text in vars(given).items()
    }
    return Columns(**roles)


def _reading(timing: TimeOptions, how: FileOptions) -> "FileReading":
    from flexstage.experiments.campaign.plan import FileReading

    rate = timing.sample_rate
    hertz = optional(rate, "frequency", bare_unit="Hz")
    return FileReading(sample_rate=hertz, time=timing.time, **vars(how))


def _units(given: list[str]) -> Any:
    from dataclasses import fields

    from flexstage.experiments.campaign.plan import Columns

    roles = [f.name for f in fields(Columns)]
    found: dict[str, Any] = {}
    for text in given:
        role, _, unit = (word.strip() for word in text.partition("="))
        refuse(
            role not in roles or not unit,
            f'--column-unit must be a role and a unit such as "along=um", got "{text}" (roles: '
            f"{', '.join(roles)})",
        )
        found[role] = (unit,) if isinstance(getattr(Columns(), role), tuple) else unit
    return Columns(**found)
