"""Entering what a plan has recorded into the catalogue."""

import datetime
from pathlib import Path

from flexstage.errors import FlexstageError
from flexstage.experiments.results import IdentifiedStep
from flexstage.experiments.run_context import RunContext
from flexstage.experiments.state import file_hash
from flexstage.instruments.catalogue.catalogue import Catalogue
from flexstage.instruments.catalogue.entries import ModelEntry, StageEntry
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


def _enter_models(context: RunContext, catalogue: str, runs: dict[str, str]) -> None:
    found = [step for step in context.results.values() if isinstance(step, IdentifiedStep)]
    if not found:
        return
    stage = StageEntry(
        name=context.stage.name,
        serial_number=context.serial_number,
        design=context.plan.stage,
        hash=content_hash(context.stage),
    )
    with Catalogue.open(catalogue) as database:
        for step in found:
            database.enter_model(
                ModelEntry(
                    kind=step.kind,
                    file=str(step.file.resolve()),
                    axis=step.axis,
                    figures={f"{k} [%]": v for k, v in step.errors_percent.items()},
                    stage=stage,
                    created=_made(step.file),
                    run=_source(context, step.name, runs),
                    sha256=file_hash(step.file),
                )
            )


def _made(file: Path) -> datetime.datetime:
    return datetime.datetime.fromtimestamp(file.stat().st_mtime, datetime.UTC)


def _source(context: RunContext, name: str, runs: dict[str, str]) -> str:
    """Return the identifier of the last record that a model was identified from."""
    action = context.plan.step(name).action
    last = getattr(action, "of", ("",))[-1]
    file = context.measured(last).file.relative_to(context.folder).as_posix()
    return runs.get(file, "")
