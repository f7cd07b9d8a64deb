"""Entering what a plan has recorded into the catalogue."""

from collections.abc import Mapping

from flexstage.errors import FlexstageError
from flexstage.experiments.run_context import RunContext
from flexstage.instruments.catalogue.catalogue import Catalogue
from flexstage.instruments.catalogue.entries import StageEntry
from flexstage.instruments.catalogue.folder import enter_folder
from flexstage.provenance import content_hash


def enter_all(context: RunContext, catalogue: str | None) -> tuple[str, ...]:
    """Enter every record and model of a run; what cannot be entered is told and never lost."""
    if catalogue is None:
        return ()
    try:
        entered = enter_folder(context.folder, catalogue)
        problems = list(entered.problems)
        if not problems:
            runs = {entry.file: entry.identifier for entry in entered.runs}
            _enter_models(context, catalogue, runs)
    except (FlexstageError, OSError) as error:
        problems = [str(error)]
    return tuple(
        f"not in the catalogue: {said}; enter it later by 'flexstage runs add {context.folder}'"
        for said in problems
    )


def _enter_models(context: RunContext, catalogue: str, runs: Mapping[str, str]) -> None:
    stage = StageEntry(
        name=context.stage.name,
        serial_number=context.serial_number,
        design=context.plan.stage,
        hash=content_hash(context.stage),
    )
    made = (step.model_entry(context, stage, runs) for step in context.results.values())
    entries = [entry for entry in made if entry is not None]
    if entries:
        with Catalogue.open(catalogue) as database:
            for entry in entries:
                database.enter_model(entry)
