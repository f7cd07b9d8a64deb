"""Carries out a plan on an instrument, and takes it up again where it was interrupted.

A step is not repeated where the hash of what it depends on, its fingerprint, is that of the run
before and its files are whole.
"""

import datetime
import os
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

from flexstage.base import progress
from flexstage.base.errors import FlexstageError, PlanError
from flexstage.base.provenance import content_hash, file_hash
from flexstage.experiments.dry_run import dry_run, natural_frequency
from flexstage.experiments.plan import Plan, Step, plan_stage
from flexstage.experiments.requests import RunRequest
from flexstage.experiments.results import PlanResult
from flexstage.experiments.state import (
    RunState,
    StepState,
    clear_leftovers,
    files_hash,
    fingerprint,
    is_whole,
    read_state,
    write_state,
)
from flexstage.experiments.verb import RunContext, base_rate_of
from flexstage.files.names import file_name
from flexstage.files.plain import json_text
from flexstage.files.request import request_of
from flexstage.files.write import write_whole
from flexstage.instruments.catalogue.catalogue import Catalogue
from flexstage.instruments.catalogue.entries import StageEntry
from flexstage.instruments.catalogue.folder import enter_folder
from flexstage.instruments.guard import guarded
from flexstage.instruments.lock import folder_lock, instrument_lock
from flexstage.instruments.protocol import Capability, Instrument
from flexstage.instruments.ramp import to_safe
from flexstage.instruments.recording.metadata import RunMetadata, StageRun
from flexstage.stage import Stage


def run_plan(
    plan: Plan,
    instrument: Instrument,
    folder: str | os.PathLike[str],
    request: RunRequest | None = None,
    *,
    stage: Stage | None = None,
    title: str = "",
    catalogue: str | None = None,
    held: str = "",
    **asked: Any,
) -> PlanResult:
    """Carry out a plan.

    Every record is on disk while it is taken, and how far the plan has come after every step. The
    stage is locked by its serial number, and stopped whatever ends the run.

    Parameters
    ----------
    plan : Plan
        The plan.
    instrument : Instrument
        What it is carried out on, real or simulated.
    folder : str or os.PathLike
        Where everything is written: ``run.json``, ``records/``, ``models/``, ``results.json``.
    request : RunRequest, optional
        Which steps are wanted, who works, and whether to take up what the folder holds: steps are
        repeated that are missing, or that depend on what has changed.
    stage : Stage, optional
        The stage; the one that the plan names where not given.
    title : str
        What the plan is called where it does not say so itself.
    catalogue : str, optional
        Database that every record is entered into; none where not given.
    held : str
        Name under which this program has locked the stage already; empty where it has not.
    **asked
        Fields of `RunRequest`, in place of those of `request`.

    Returns
    -------
    PlanResult
        What every step gave.

    Raises
    ------
    PlanError
        The plan cannot be carried out as it is; nothing has been moved.
    FlexstageError
        A step failed: what it had recorded is kept.

    Validity
    --------
    The lock holds off programs of the same user on the same computer. A simulated instrument is not
    locked; the folder always is.
    """
    request = request_of(RunRequest, request, asked)
    own = stage if stage is not None else plan_stage(plan)
    where = Path(folder)
    _require_possible(plan, own, request.only, instrument)
    run = RunMetadata(
        plan=plan.title or title,
        operator=request.operator,
        note=request.note,
        stage=own.name,
        stage_hash=content_hash(own),
        serial_number=plan.serial_number or instrument.identity.serial_number,
        instrument=instrument.identity,
        design=plan.stage,
        settings=dict(instrument.settings()),
    )
    context = RunContext(
        plan=plan,
        stage=own,
        instrument=instrument,
        folder=where,
        run=run,
        base_rate_hz=base_rate_of(instrument),
        frequency=natural_frequency(plan, own),
    )
    with folder_lock(where):
        steps = plan.chosen(request.only)
        return _carry_out(plan, context, steps, catalogue, resume=request.resume, held=held)


def _carry_out(
    plan: Plan,
    context: RunContext,
    steps: tuple[Step, ...],
    catalogue: str | None,
    *,
    resume: bool,
    held: str,
) -> PlanResult:
    instrument, where = context.instrument, context.folder
    state = _begun(context, resume=resume)
    began = time.monotonic()
    told: tuple[str, ...] = ()
    try:
        serial = context.run.serial_number
        locked = instrument_lock(instrument, serial or context.stage.name, held=held)
        with locked, guarded(instrument):
            for axis in instrument.axes.values():
                axis.reference()
            state = _run_steps(context, state, steps)
            to_safe(instrument)
    finally:
        # what was recorded until then is entered too
        told = _enter_all(context, catalogue)
    finished = _now()
    write_state(where, replace(state, finished=finished))
    result = PlanResult(
        plan=plan,
        stage=context.stage,
        run=replace(context.run, started=state.started),
        finished=finished,
        duration=time.monotonic() - began,
        folder=where,
        steps=tuple(context.results[s.name] for s in plan.steps if s.name in context.results),
        notes=(*_notes(context), *told),
    )
    write_whole(where / "results.json", json_text(result.to_dict()))
    return result


def new_run_folder(parent: Path, stage: str, plan: str) -> Path:
    """Return a folder for a run that is not there yet, named after time, stage and plan."""
    now = datetime.datetime.now(datetime.UTC).strftime("%Y%m%dT%H%M%SZ")
    words = [now, file_name(stage)]
    if plan != stage:
        words.append(file_name(plan))
    made = parent / "-".join(words)
    k = 2
    while made.exists():
        made = made.with_name(f"{'-'.join(words)}-{k}")
        k += 1
    return made


def _require_possible(
    plan: Plan, stage: Stage, only: tuple[str, ...] | None, instrument: Instrument
) -> None:
    """Refuse a plan of which a dry run shows that it cannot be carried out."""
    rate = base_rate_of(instrument)
    for problem in dry_run(plan, stage, only=only, base_rate_hz=rate).problems:
        raise PlanError(f"{problem}; nothing has been moved")
    struck = [step.name for step in plan.chosen(only) if step.action.struck]
    if struck and Capability.IMPACT not in instrument.capabilities:
        raise PlanError(
            f"the {instrument.identity.model} has no hammer for {', '.join(struck)}: leave these "
            "steps out by --only, or strike the stage by hand and evaluate the record of the "
            "hammer's own instrument; nothing has been moved"
        )


def _begun(context: RunContext, *, resume: bool) -> RunState:
    """Return the state to go on from, and make the folder."""
    folder = context.folder
    before = read_state(folder)
    if before is not None and not resume:
        raise PlanError(
            f"'{folder}' contains a run already: continue it with --resume, or choose another "
            "folder"
        )
    identity = context.instrument.identity
    if before is not None and before.instrument.simulated != identity.simulated:
        kinds = ("a real instrument", "a simulated one")
        raise PlanError(
            f"'{folder}' holds a run on {kinds[before.instrument.simulated]}, and this is "
            f"{kinds[identity.simulated]}: choose another folder"
        )
    if before is not None and before.stage != context.stage.name:
        raise PlanError(
            f"'{folder}' holds a run on the stage '{before.stage}', and this is "
            f"'{context.stage.name}': choose another folder"
        )
    for part in ("records", "models"):
        (folder / part).mkdir(parents=True, exist_ok=True)
    state = RunState(
        **{f.name: getattr(context.run, f.name) for f in fields(StageRun) if f.name != "started"},
        started=_now() if before is None else before.started,
        steps={} if before is None else before.steps,
    )
    write_state(folder, state)
    return state


def _run_steps(context: RunContext, state: RunState, steps: tuple[Step, ...]) -> RunState:
    outputs: dict[str, str] = {}
    identity = context.instrument.identity
    for k, step in enumerate(steps):
        with progress.subtask(k / len(steps), (k + 1) / len(steps)):
            progress.update(step.name[:17])
            mark = fingerprint(step, context.plan, context.stage, identity, outputs)
            before = state.steps.get(step.name)
            now = before is None or not is_whole(context.folder, before, mark)
            if now:
                state = _carried_out(context, state, step, mark)
            files = [context.folder / name for name in state.steps[step.name].files]
            with _told(context, state, step):
                context.results[step.name] = step.action.result(context, step.name, files, now=now)
            outputs[step.name] = _output(context, step, state.steps[step.name])
    return state


def _carried_out(context: RunContext, state: RunState, step: Step, mark: str) -> RunState:
    """Do a step; whatever happens, the state on disk says how far it came."""
    before = state.steps.get(step.name)
    partial = clear_leftovers(context.folder, step.name, () if before is None else before.partial)
    running = StepState(status="running", fingerprint=mark, partial=partial, started=_now())
    state = state.with_step(step.name, running)
    write_state(context.folder, state)
    with _told(context, state, step):
        files = step.action.run(context, step.name)
    digits = {path.relative_to(context.folder).as_posix(): file_hash(path) for path in files}
    done = replace(running, status="complete", files=digits, finished=_now())
    state = state.with_step(step.name, done)
    write_state(context.folder, state)
    return state


@contextmanager
def _told(context: RunContext, state: RunState, step: Step) -> Iterator[None]:
    """Write down why a step ended early, and name it in the message."""
    try:
        yield
    except BaseException as error:
        message = str(error) or type(error).__name__
        before = state.steps[step.name]
        # a record that is whole is kept, even if its evaluation fails
        if not before.files:
            status = "failed" if isinstance(error, Exception) else "interrupted"
            ended = replace(before, status=status, finished=_now(), message=message)
            # a full disk that ended the step takes no state either; the one there says "running"
            with suppress(OSError):
                write_state(context.folder, state.with_step(step.name, ended))
        if isinstance(error, FlexstageError) and f"'{step.name}'" not in message:
            error.args = (f"step '{step.name}': {message}", *error.args[1:])
        raise


def _output(context: RunContext, step: Step, done: StepState) -> str:
    """Return the hash of what later steps use of a step."""
    command = context.commands.get(step.name)
    if command is not None:
        return command.hash
    return files_hash(done.files) if done.files else done.fingerprint


def _notes(context: RunContext) -> tuple[str, ...]:
    notes = list(context.plan.notes)
    if context.instrument.identity.simulated:
        notes.insert(0, "the instrument is a simulation: nothing was measured")
    return tuple(notes)


def _now() -> str:
    return datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds")


def _enter_all(context: RunContext, catalogue: str | None) -> tuple[str, ...]:
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
        serial_number=context.run.serial_number,
        design=context.run.design,
        hash=context.run.stage_hash,
    )
    made = (step.model_entry(context, stage, runs) for step in context.results.values())
    entries = [entry for entry in made if entry is not None]
    if entries:
        with Catalogue.open(catalogue) as database:
            for entry in entries:
                database.enter_model(entry)
