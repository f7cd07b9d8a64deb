"""`flexstage characterise`: the figures of a stage from measured records."""

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from flexstage.base.errors import ModelError
from flexstage.cli.characterise_tables import print_measurement
from flexstage.cli.options import JsonOption, QuietOption, from_docstring, refuse
from flexstage.cli.output import OutputFolder, console, print_result, progress_bar
from flexstage.cli.stage_options import AS_DESCRIBED, StageOptions
from flexstage.experiments.campaign.requests import CharacteriseRequest
from flexstage.files.plain import json_text
from flexstage.files.request import option_words
from flexstage.studies.requests import ComparisonRequest
from flexstage.system.requests import models_of

if TYPE_CHECKING:
    from flexstage.experiments.campaign.results import Characterisation

_PLANS = (".yaml", ".yml")


@from_docstring
def characterise(
    records: Annotated[list[Path] | None, typer.Argument()] = None,
    *,
    stage: str | None = None,
    virtual_seed: Annotated[int | None, typer.Option(min=0)] = None,
    request: CharacteriseRequest,
    beside: ComparisonRequest,
    taken: StageOptions = AS_DESCRIBED,
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
    written: dict[str, bytes] = {}
    plans = [file for file in files if file.suffix.lower() in _PLANS]
    if plans and len(files) > 1:
        raise ModelError(
            f"'{plans[0]}' describes tests and stands alone: give it without other files, or the "
            "measured files of one test"
        )
    if virtual_seed is not None or plans:
        _no_columns("--virtual-seed" if virtual_seed is not None else f"'{plans[0]}'", request)
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
            found = characterise_files(files, request)
        described = stage or _beside(found.stage, folder)
        taken.require_stage(described or None, "--stage")
        result = compare_measurement(
            found,
            taken.stage(described) if described else None,
            models_of(beside.model) if described else (),
        )
    if out is not None:
        written["report.html"] = measurement_text(result).encode()
        written["results.json"] = json_text(result.to_dict()).encode()
    saved = [] if out is None else write_files(out, written)
    if json:
        print_result(result.to_dict(), saved)
        return
    print_measurement(console(), result, saved)


def _no_columns(source: str, request: CharacteriseRequest) -> None:
    """Refuse options on columns and files where a description says all that."""
    idle = [word for word in option_words(request) if word.startswith("--")]
    refuse(
        idle,
        f"{', '.join(idle)} has no meaning with {source}, which says what its records hold: "
        "leave it out",
    )


def _beside(stage: str, folder: Path) -> str:
    """Return the stage that a description names: its files are named from its own folder."""
    from flexstage.stage.designs import DESIGNS

    if not stage or stage.casefold() in DESIGNS:
        return stage
    return str(folder / stage)


def _virtual(
    stage: str, taken: StageOptions, seed: int
) -> "tuple[Characterisation, dict[str, bytes]]":
    from flexstage.experiments.campaign.plan import campaign_text
    from flexstage.experiments.virtual_campaign import virtual_campaign
    from flexstage.records.write import record_bytes
    from flexstage.stage.designs import DESIGNS
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
