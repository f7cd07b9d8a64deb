"""Rows of the tables from entries, and entries from rows."""

from collections.abc import Mapping
from typing import Any, cast

from sqlalchemy import Select, select
from sqlalchemy.orm import Session

from flexstage.errors import RecordError
from flexstage.instruments.catalogue.entries import (
    CalibrationEntry,
    ModelEntry,
    RunEntry,
    StageEntry,
)
from flexstage.instruments.catalogue.tables import Calibration, Model, Run, StageRow

_STAGE_FIELDS = ("name", "serial_number", "design", "hash")
_RUN_FIELDS = (
    "identifier",
    "started",
    "plan",
    "step",
    "kind",
    "axis",
    "operator",
    "note",
    "version",
    "instrument",
    "simulated",
    "folder",
    "file",
    "sha256",
    "status",
    "samples",
    "sample_rate_hz",
    "lost",
)


def fill_run(session: Session, row: Run, entry: RunEntry) -> None:
    """Give the row of a run what its entry says."""
    row.stage = stage_row(session, entry.stage)
    for name in _RUN_FIELDS:
        setattr(row, name, getattr(entry, name))
    # whole numbers of any size, which no database has
    row.seed = None if entry.seed is None else str(entry.seed)


def of_stage(asked: Select[Any], stage: str | None, serial_number: str | None) -> Select[Any]:
    """Narrow a question to a stage."""
    if stage is not None:
        asked = asked.where(StageRow.name == stage)
    if serial_number is not None:
        asked = asked.where(StageRow.serial_number == serial_number)
    return asked


def stage_row(session: Session, entry: StageEntry) -> StageRow:
    """Return the row of a stage, a new one where there is none."""
    asked = select(StageRow)
    for name in _STAGE_FIELDS:
        asked = asked.where(getattr(StageRow, name) == getattr(entry, name))
    row = session.scalars(asked).first()
    if row is None:
        row = StageRow(**{name: getattr(entry, name) for name in _STAGE_FIELDS})
        session.add(row)
    return row


def run_row(session: Session, identifier: str) -> Run | None:
    """Return the row of a run."""
    if not identifier:
        return None
    row = session.scalar(select(Run).where(Run.identifier == identifier))
    if row is None:
        raise RecordError(
            f"run {identifier[:40]} is not in the catalogue: enter it first, with 'flexstage runs "
            "add FOLDER'"
        )
    return row


def stage_entry(row: StageRow) -> StageEntry:
    """Return the entry of a stage."""
    return StageEntry(**{name: getattr(row, name) for name in _STAGE_FIELDS})


def run_entry(row: Run) -> RunEntry:
    """Return the entry of a run."""
    fields: Mapping[str, Any] = {name: getattr(row, name) for name in _RUN_FIELDS}
    seed = None if row.seed is None else int(row.seed)
    return RunEntry(**fields, seed=seed, stage=stage_entry(row.stage))


def calibration_entry(row: Calibration) -> CalibrationEntry:
    """Return the entry of a calibration."""
    return CalibrationEntry(
        what=row.what,
        value=row.value,
        unit=row.unit,
        standard_uncertainty=row.standard_uncertainty,
        valid_from=row.valid_from,
        stage=stage_entry(row.stage),
        run=row.run.identifier if row.run else "",
        note=row.note,
    )


def model_entry(row: Model) -> ModelEntry:
    """Return the entry of a model."""
    return ModelEntry(
        kind=row.kind,
        file=row.file,
        stage=stage_entry(row.stage),
        created=row.created,
        axis=row.axis,
        figures=cast(Mapping[str, float], row.figures),
        run=row.run.identifier if row.run else "",
        sha256=row.sha256,
    )
