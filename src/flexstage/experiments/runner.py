"""Run a plan on an instrument, and resume an interrupted run.

A step is not repeated where its fingerprint, the hash of everything that it depends on, is that of
the earlier run and its files are complete.
"""

import datetime
import hashlib
import json
import os
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import asdict, dataclass, field, fields, replace
from pathlib import Path
from typing import Any, Literal

from flexstage.base import progress
from flexstage.base.errors import FlexstageError, PlanError, RecordError
from flexstage.base.provenance import content_hash, file_hash
from flexstage.experiments.plan import Plan, Step, dry_run, natural_frequency, plan_stage
from flexstage.experiments.requests import RunRequest
from flexstage.experiments.results import PlanResult
from flexstage.experiments.verb import PlanLookup, RunContext, SensorEntry, base_rate_of
from flexstage.files.decoder import read_json
from flexstage.files.format import Format
from flexstage.files.names import file_name
from flexstage.files.plain import json_text
from flexstage.files.request import request_of
from flexstage.files.write import write_whole
from flexstage.instruments.catalogue.catalogue import Catalogue, enter_folder
from flexstage.instruments.catalogue.entries import StageEntry
from flexstage.instruments.guard import guarded
from flexstage.instruments.lock import folder_lock, instrument_lock
from flexstage.instruments.protocol import Capability, Identity, Instrument
from flexstage.instruments.ramp import to_safe
from flexstage.instruments.recording.metadata import RunMetadata, StageRun, utc_time
from flexstage.stage import Stage

_NAME = "run.json"

#: The file that keeps the state of a run.
STATE_FILE = Format(
    noun="state of a run",
    key="run",
    error=PlanError,
    exact=True,
    mend="choose another folder, or remove the file to restart the run",
)


@dataclass(frozen=True, slots=True, kw_only=True)
class StepState:
    """State of one step."""

    status: Literal["running", "complete", "interrupted", "failed"]
    """Status."""
    fingerprint: str
    """Hash of everything that the step depends on."""
    files: Mapping[str, str] = field(default_factory=dict)
    """SHA-256 of each of its files, by its name relative to the folder of the run."""
    partial: tuple[str, ...]
    """Files of interrupted attempts."""
    started: str = ""
    """Date and time of its start, UTC."""
    finished: str = ""
    """Date and time of its end, UTC."""
    message: str = ""
    """Reason why it failed."""

    def __post_init__(self) -> None:
        _require_times(self, "a step")


@dataclass(frozen=True, slots=True, kw_only=True)
class RunState(StageRun):
    """State of a run."""

    finished: str = ""
    """Date and time of the end, UTC; empty until the run is complete."""
    steps: Mapping[str, StepState]
    """Steps by name."""

    def __post_init__(self) -> None:
        _require_times(self, "a run")

    def with_step(self, name: str, step: StepState) -> "RunState":
        """Return the state with one step replaced."""
        return replace(self, steps={**self.steps, name: step})


def _require_times(state: StepState | RunState, what: str) -> None:
    for text, which in ((state.started, "start"), (state.finished, "end")):
        if text:
            try:
                utc_time(text, f"the {which} of {what}")
            except RecordError as error:
                raise PlanError(str(error)) from error


def write_state(folder: Path, state: RunState) -> None:
    """Write the state completely, or keep the present file."""
    content = {STATE_FILE.key: STATE_FILE.version, **asdict(state)}
    write_whole(folder / _NAME, json.dumps(content, indent=1) + "\n")


def read_state(folder: Path) -> RunState | None:
    """Read the state of a run; None where the folder has none."""
    path = folder / _NAME
    try:
        return read_json(RunState, path.read_bytes(), str(path), STATE_FILE)
    except FileNotFoundError:
        return None
    except OSError as error:
        reason = error.strerror or error
        raise PlanError(f"the file {path} cannot be read: {reason}{STATE_FILE.ending}") from None


def fingerprint(
    step: Step, plan: PlanLookup, stage: Stage, instrument: Identity, upstream: Mapping[str, str]
) -> str:
    """Return the hash of everything that the result of a step depends on."""
    words = [step.name, content_hash(step.action), content_hash(stage), content_hash(plan.defaults)]
    words += [f"{name}={upstream[name]}" for name in step.needs]
    if step.action.moving:
        # the channels of the sensors, but not their uncertainties
        sensors = tuple(SensorEntry(name=s.name, channel=s.channel, unit=s.unit)
                        for s in plan.sensors)  # fmt: skip
        words += [content_hash(sensors), content_hash(replace(instrument, firmware=""))]
    words += [content_hash(part) for part in step.action.depends_on(plan)]
    return hashlib.sha256("\n".join(words).encode()).hexdigest()


def files_hash(files: Mapping[str, str]) -> str:
    """Return the hash of files from the hashes of each."""
    words = "\n".join(f"{name} {files[name]}" for name in sorted(files))
    return hashlib.sha256(words.encode()).hexdigest()


def is_complete(folder: Path, step: StepState, mark: str) -> bool:
    """Return whether a step need not be repeated."""
    if step.status != "complete" or step.fingerprint != mark:
        return False
    for name, digest in step.files.items():
        path = folder / name
        if not path.is_file() or file_hash(path) != digest:
            return False
    return True


def clear_leftovers(folder: Path, name: str, before: tuple[str, ...]) -> tuple[str, ...]:
    """Rename the files of earlier attempts at a step; return all files that were ever renamed.

    Names are relative to the folder of the run; `before` are those of earlier attempts.

    An incomplete stream is recovered into ``NAME.partial-N.h5``; a record that is no longer valid
    becomes ``NAME.replaced-N.h5``.
    """
    partial = list(before)
    records = folder / "records"
    for path in sorted(records.iterdir()) if records.is_dir() else []:
        words = path.stem.split(".")
        # a name of a step has no dot; a control mode may follow one
        aside = any(word.startswith(("partial-", "replaced-")) for word in words[1:])
        if words[0] != name or aside or path.suffix not in (".h5", ".stream"):
            continue
        if path.suffix == ".h5":
            target = _free(path, "replaced", ".h5")
            path.rename(target)
        else:
            target = _recovered(path)
        partial.append(target.relative_to(folder).as_posix())
    return tuple(partial)


def _recovered(stream: Path) -> Path:
    """Keep the samples of a stream as a record, or the stream itself where it has none."""
    from flexstage.instruments.recording.archive import archived

    target = _free(stream, "partial", ".h5")
    try:
        archived(stream, target)
    except RecordError:
        # fewer than two complete samples, or another program writes it: the stream is kept
        target = _free(stream, "partial", ".stream")
        stream.rename(target)
        return target
    stream.unlink()
    return target


def _free(path: Path, word: str, suffix: str) -> Path:
    """Return an unused name."""
    k = 1
    while (candidate := path.with_name(f"{path.stem}.{word}-{k}{suffix}")).exists():
        k += 1
    return candidate


def run_plan(
    plan: Plan,
    instrument: Instrument,
    folder: str | os.PathLike[str],
    request: RunRequest | None = None,
    *,
    stage: Stage | None = None,
    title: str = "",
    catalogue: str | None = None,
    locked_as: str = "",
    **options: Any,
) -> PlanResult:
    """Carry out a plan.

    Records are written to disk while they are measured, and the state of the run after every step.
    The stage is locked by its serial number. It is stopped however the run ends.

    Parameters
    ----------
    plan : Plan
        The plan.
    instrument : Instrument
        The instrument, real or simulated.
    folder : str or os.PathLike
        Folder of the run: ``run.json``, ``records/``, ``models/``, ``results.json``.
    request : RunRequest, optional
        Steps, operator, and whether to resume the run in the folder. A resumed run repeats steps
        that are missing, and those whose inputs have changed.
    stage : Stage, optional
        The stage (default: that of the plan).
    title : str
        Title of a plan that has none itself.
    catalogue : str, optional
        Database for the entries of all records (default: none).
    locked_as : str
        Name under which this program has already locked the stage; empty where it has not.
    **options
        Fields of `RunRequest`, in place of those of `request`.

    Returns
    -------
    PlanResult
        Results of all steps.

    Raises
    ------
    PlanError
        The plan cannot be carried out; the stage has not moved.
    FlexstageError
        A step failed; its recorded samples are kept.

    Validity
    --------
    The lock excludes programs of the same user on the same computer. A simulated instrument is not
    locked; the folder always is.
    """
    request = request_of(RunRequest, request, options)
    run_stage = stage if stage is not None else plan_stage(plan)
    path = Path(folder)
    _require_possible(plan, run_stage, request.only, instrument)
    run = RunMetadata(
        plan=plan.title or title,
        operator=request.operator,
        note=request.note,
        stage=run_stage.name,
        stage_hash=content_hash(run_stage),
        serial_number=plan.serial_number or instrument.identity.serial_number,
        instrument=instrument.identity,
        design=plan.stage,
        settings=dict(instrument.settings()),
    )
    context = RunContext(
        plan=plan,
        stage=run_stage,
        instrument=instrument,
        folder=path,
        run=run,
        base_rate_hz=base_rate_of(instrument),
        frequency=natural_frequency(plan, run_stage),
    )
    with folder_lock(path):
        steps = plan.selected(request.only)
        return _carry_out(
            plan, context, steps, catalogue, resume=request.resume, locked_as=locked_as
        )


def _carry_out(
    plan: Plan,
    context: RunContext,
    steps: tuple[Step, ...],
    catalogue: str | None,
    *,
    resume: bool,
    locked_as: str,
) -> PlanResult:
    instrument, folder = context.instrument, context.folder
    state = _initial_state(context, resume=resume)
    start = time.monotonic()
    problems: tuple[str, ...] = ()
    try:
        serial = context.run.serial_number
        lock = instrument_lock(instrument, serial or context.stage.name, locked_as=locked_as)
        with lock, guarded(instrument):
            for axis in instrument.axes.values():
                axis.reference()
            state = _run_steps(context, state, steps)
            to_safe(instrument)
    finally:
        # an interrupted run is entered too
        problems = _enter_all(context, catalogue)
    finished = _now()
    write_state(folder, replace(state, finished=finished))
    result = PlanResult(
        plan=plan,
        stage=context.stage,
        run=replace(context.run, started=state.started),
        finished=finished,
        duration=time.monotonic() - start,
        folder=folder,
        steps=tuple(context.results[s.name] for s in plan.steps if s.name in context.results),
        notes=(*_notes(context), *problems),
    )
    write_whole(folder / "results.json", json_text(result.to_dict()))
    return result


def new_run_folder(parent: Path, stage: str, plan: str) -> Path:
    """Return a new folder for a run, named after time, stage and plan."""
    now = datetime.datetime.now(datetime.UTC).strftime("%Y%m%dT%H%M%SZ")
    words = [now, file_name(stage)]
    if plan != stage:
        words.append(file_name(plan))
    folder = parent / "-".join(words)
    k = 2
    while folder.exists():
        folder = folder.with_name(f"{'-'.join(words)}-{k}")
        k += 1
    return folder


def _require_possible(
    plan: Plan, stage: Stage, only: tuple[str, ...] | None, instrument: Instrument
) -> None:
    """Refuse a plan that fails a dry run."""
    rate = base_rate_of(instrument)
    for problem in dry_run(plan, stage, only=only, base_rate_hz=rate).problems:
        raise PlanError(f"{problem}; the stage has not moved")
    impacts = [step.name for step in plan.selected(only) if step.action.by_hammer]
    if impacts and Capability.IMPACT not in instrument.capabilities:
        raise PlanError(
            f"the {instrument.identity.model} has no hammer for {', '.join(impacts)}: exclude "
            "these steps with --only, or excite the stage by hand and evaluate the record of the "
            "hammer's instrument; the stage has not moved"
        )


def _initial_state(context: RunContext, *, resume: bool) -> RunState:
    """Return the state to resume from, and create the folder."""
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
            f"'{folder}' contains a run on {kinds[before.instrument.simulated]}, and this is "
            f"{kinds[identity.simulated]}: choose another folder"
        )
    if before is not None and before.stage != context.stage.name:
        raise PlanError(
            f"'{folder}' contains a run on the stage '{before.stage}', and this is "
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
            now = before is None or not is_complete(context.folder, before, mark)
            if now:
                state = _run_step(context, state, step, mark)
            files = [context.folder / name for name in state.steps[step.name].files]
            with _failure_recorded(context, state, step):
                context.results[step.name] = step.action.result(context, step.name, files, now=now)
            outputs[step.name] = _output(context, step, state.steps[step.name])
    return state


def _run_step(context: RunContext, state: RunState, step: Step, mark: str) -> RunState:
    """Carry out a step; the state on disk is current, however it ends."""
    before = state.steps.get(step.name)
    partial = clear_leftovers(context.folder, step.name, () if before is None else before.partial)
    running = StepState(status="running", fingerprint=mark, partial=partial, started=_now())
    state = state.with_step(step.name, running)
    write_state(context.folder, state)
    with _failure_recorded(context, state, step):
        files = step.action.run(context, step.name)
    hashes = {path.relative_to(context.folder).as_posix(): file_hash(path) for path in files}
    complete = replace(running, status="complete", files=hashes, finished=_now())
    state = state.with_step(step.name, complete)
    write_state(context.folder, state)
    return state


@contextmanager
def _failure_recorded(context: RunContext, state: RunState, step: Step) -> Iterator[None]:
    """Write the reason of a failed step to the state, and name the step in the message."""
    try:
        yield
    except BaseException as error:
        message = str(error) or type(error).__name__
        before = state.steps[step.name]
        # a complete record is kept, even if its evaluation fails
        if not before.files:
            status = "failed" if isinstance(error, Exception) else "interrupted"
            ended = replace(before, status=status, finished=_now(), message=message)
            # a full disk accepts no state either; the old state says "running"
            with suppress(OSError):
                write_state(context.folder, state.with_step(step.name, ended))
        if isinstance(error, FlexstageError) and f"'{step.name}'" not in message:
            error.args = (f"step '{step.name}': {message}", *error.args[1:])
        raise


def _output(context: RunContext, step: Step, state: StepState) -> str:
    """Return the hash of the output of a step, which later steps use."""
    command = context.commands.get(step.name)
    if command is not None:
        return command.hash
    return files_hash(state.files) if state.files else state.fingerprint


def _notes(context: RunContext) -> tuple[str, ...]:
    notes = list(context.plan.notes)
    if context.instrument.identity.simulated:
        notes.insert(0, "simulated instrument: these are not measured data")
    return tuple(notes)


def _now() -> str:
    return datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds")


def _enter_all(context: RunContext, catalogue: str | None) -> tuple[str, ...]:
    """Enter all records and models of a run; return notes on those that could not be entered."""
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
        f"not in the catalogue: {problem}; enter it later with 'flexstage runs add "
        f"{context.folder}'"
        for problem in problems
    )


def _enter_models(context: RunContext, catalogue: str, runs: Mapping[str, str]) -> None:
    stage = StageEntry(
        name=context.stage.name,
        serial_number=context.run.serial_number,
        design=context.run.design,
        hash=context.run.stage_hash,
    )
    candidates = (step.model_entry(context, stage, runs) for step in context.results.values())
    entries = [entry for entry in candidates if entry is not None]
    if entries:
        with Catalogue.open(catalogue) as database:
            for entry in entries:
                database.enter_model(entry)
