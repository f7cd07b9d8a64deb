"""The catalogue: which runs there are, on which stage, and what came of them."""

from datetime import datetime
from typing import Any

from sqlalchemy import select
from sqlalchemy.orm import Session

from flexstage.errors import RecordError
from flexstage.instruments.catalogue.database import Database
from flexstage.instruments.catalogue.entries import (
    CalibrationEntry,
    ModelEntry,
    RunEntry,
    RunStatus,
    StageEntry,
)
from flexstage.instruments.catalogue.tables import (
    CalibrationRow,
    ModelRow,
    RunRow,
    StageRow,
    calibration_entry,
    clean,
    fill,
    model_entry,
    of_stage,
    run_entry,
    run_row,
    stage_entry,
    stage_row,
)


class Catalogue(Database):
    """Stages, runs, calibrations and models in a database.

    Several programs may read and write it at once. It holds nothing that the folders of the runs do
    not hold: what could not be entered can be entered later, and a lost catalogue can be made again
    from the folders, but for calibrations and models. Where the database cannot be reached, a
    method raises `NotConnectedError`.

    Examples
    --------
    >>> import tempfile
    >>> from datetime import UTC
    >>> stage = StageEntry(name="vgtu-piezo", serial_number="7")
    >>> start = datetime(2031, 5, 17, 9, 30, tzinfo=UTC)
    >>> run = RunEntry(identifier="0123" * 8, stage=stage, started=start, kind="motion")
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     with Catalogue.open(f"{folder}/catalogue.sqlite") as catalogue:
    ...         entered = catalogue.enter_run(run)
    ...         found = catalogue.runs(serial_number="7")
    >>> entered, found == [run]
    (True, True)
    """

    def enter_run(self, entry: RunEntry) -> bool:
        """Enter a run, or what is new of one that was entered before; say whether it is new."""

        def work(session: Session) -> bool:
            row = session.scalar(select(RunRow).where(RunRow.identifier == entry.identifier))
            new = row is None
            if row is None:
                row = RunRow()
                session.add(row)
            with session.no_autoflush:
                row.stage = stage_row(session, entry.stage)
                fill(row, entry)
            return new

        return self.write(work)

    def enter_calibration(self, entry: CalibrationEntry) -> None:
        """Enter a calibration; those before it stay.

        The run that it comes from must be in the catalogue.
        """

        def work(session: Session) -> None:
            row = CalibrationRow()
            fill(row, entry)
            row.run = run_row(session, entry.run)
            row.stage = stage_row(session, entry.stage)
            session.add(row)

        self.write(work)

    def enter_model(self, entry: ModelEntry) -> None:
        """Enter a model; one of the same file of the same run is replaced.

        The run that it comes from must be in the catalogue.
        """

        def work(session: Session) -> None:
            run = run_row(session, entry.run)
            asked = select(ModelRow).where(ModelRow.file == clean(entry.file))
            row = session.scalars(asked.where(ModelRow.run == run)).first() or ModelRow()
            with session.no_autoflush:
                row.run = run
                row.stage = stage_row(session, entry.stage)
                fill(row, entry)
                session.add(row)

        self.write(work)

    def stages(self) -> list[StageEntry]:
        """Return all stages, by name and serial number."""
        asked = select(StageRow).order_by(StageRow.name, StageRow.serial_number, StageRow.id)
        return self.read(lambda session: [stage_entry(row) for row in session.scalars(asked)])

    def runs(
        self,
        *,
        stage: str | None = None,
        serial_number: str | None = None,
        kind: str | None = None,
        axis: str | None = None,
        plan: str | None = None,
        status: RunStatus | None = None,
        since: datetime | None = None,
        until: datetime | None = None,
        simulated: bool | None = None,
        limit: int | None = None,
    ) -> list[RunEntry]:
        """Return runs, the latest first.

        They began from `since` on and before `until`, which are times with their zones.
        """
        asked = select(RunRow).join(RunRow.stage)
        equal: list[tuple[Any, Any]] = [
            (StageRow.name, stage),
            (StageRow.serial_number, serial_number),
            (RunRow.kind, kind),
            (RunRow.axis, axis),
            (RunRow.plan, plan),
            (RunRow.status, status),
            (RunRow.simulated, simulated),
        ]
        for column, value in equal:
            if value is not None:
                asked = asked.where(column == value)
        if since is not None:
            asked = asked.where(RunRow.started >= since)
        if until is not None:
            asked = asked.where(RunRow.started < until)
        asked = asked.order_by(RunRow.started.desc(), RunRow.id.desc()).limit(limit)
        return self.read(lambda session: [run_entry(row) for row in session.scalars(asked)])

    def run(self, identifier: str) -> RunEntry:
        """Return a run by its identifier, or the beginning of it that no other has."""
        wanted = identifier.strip().lower()
        if not wanted or not set(wanted) <= set("0123456789abcdef"):
            raise RecordError(
                "a run is named by the beginning of its identifier, hexadecimal digits such as "
                f"3f9a, got '{identifier[:40]}'"
            )
        asked = select(RunRow).where(RunRow.identifier.startswith(wanted)).limit(3)
        found = self.read(lambda session: [run_entry(row) for row in session.scalars(asked)])
        if len(found) == 1:
            return found[0]
        if found:
            raise RecordError(
                f"the identifiers of several runs begin with '{wanted}', such as "
                f"{found[0].identifier} and {found[1].identifier}: give more digits"
            )
        raise RecordError(
            f"no run of the catalogue has an identifier that begins with '{wanted}': list them "
            "with 'flexstage runs'"
        )

    def calibrations(
        self,
        *,
        stage: str | None = None,
        serial_number: str | None = None,
        what: str | None = None,
        at: datetime | None = None,
    ) -> list[CalibrationEntry]:
        """Return calibrations, the latest first.

        Of each only the one that holds `at` a time, where given: the latest that began before.
        """
        asked = of_stage(select(CalibrationRow).join(CalibrationRow.stage), stage, serial_number)
        if what is not None:
            asked = asked.where(CalibrationRow.what == what)
        if at is not None:
            asked = asked.where(CalibrationRow.valid_from <= at)
        asked = asked.order_by(CalibrationRow.valid_from.desc(), CalibrationRow.id.desc())
        found = self.read(
            lambda session: [calibration_entry(row) for row in session.scalars(asked)]
        )
        if at is None:
            return found
        holding: dict[tuple[str, str, str], CalibrationEntry] = {}
        for entry in found:
            holding.setdefault((entry.stage.name, entry.stage.serial_number, entry.what), entry)
        return list(holding.values())

    def models(
        self,
        *,
        stage: str | None = None,
        serial_number: str | None = None,
        kind: str | None = None,
        axis: str | None = None,
        run: str | None = None,
    ) -> list[ModelEntry]:
        """Return models, the latest first; `run` is the identifier of the one they come from."""
        asked = of_stage(select(ModelRow).join(ModelRow.stage), stage, serial_number)
        if kind is not None:
            asked = asked.where(ModelRow.kind == kind)
        if axis is not None:
            asked = asked.where(ModelRow.axis == axis)
        if run is not None:
            asked = asked.where(ModelRow.run.has(RunRow.identifier == run))
        asked = asked.order_by(ModelRow.created.desc(), ModelRow.id.desc())
        return self.read(lambda session: [model_entry(row) for row in session.scalars(asked)])
