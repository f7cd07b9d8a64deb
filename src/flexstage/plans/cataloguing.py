"""Entering what a plan has recorded into the catalogue."""

import datetime
from pathlib import Path

from flexstage.errors import FlexstageError
from flexstage.instruments.catalogue.catalogue import Catalogue
from flexstage.instruments.catalogue.entries import ModelEntry, StageEntry
from flexstage.instruments.catalogue.folder import enter_folder
from flexstage.plans.results import IdentifiedStep
from flexstage.plans.state import file_hash
from flexstage.plans.work import Work
from flexstage.provenance import content_hash


def enter_all(work: Work, catalogue: str | None) -> tuple[str, ...]:
    """Enter every record and model of a run; what cannot be entered is told and never lost."""
    if catalogue is None:
        return ()
    try:
        entered = enter_folder(work.folder, catalogue)
        problems = list(entered.problems)
        if not problems:
            runs = {entry.file: entry.identifier for entry in entered.runs}
            _enter_models(work, catalogue, runs)
    except (FlexstageError, OSError) as error:
        problems = [str(error)]
    return tuple(
        f"not in the catalogue: {said}; enter it later by 'flexstage runs add {work.folder}'"
        for said in problems
    )


def _enter_models(work: Work, catalogue: str, runs: dict[str, str]) -> None:
    found = [step for step in work.results.values() if isinstance(step, IdentifiedStep)]
    if not found:
        return
    stage = StageEntry(
        name=work.stage.name,
        serial_number=work.serial_number,
        design=work.plan.stage,
        hash=content_hash(work.stage),
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
                    run=_source(work, step.name, runs),
                    sha256=file_hash(step.file),
                )
            )


def _made(file: Path) -> datetime.datetime:
    return datetime.datetime.fromtimestamp(file.stat().st_mtime, datetime.UTC)


def _source(work: Work, name: str, runs: dict[str, str]) -> str:
    """Return the identifier of the last record that a model was identified from."""
    action = work.plan.step(name).action
    last = getattr(action, "of", ("",))[-1]
    file = work.measured(last).file.relative_to(work.folder).as_posix()
    return runs.get(file, "")
