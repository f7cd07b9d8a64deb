"""State of a run, written to disk after every step, so that the run can be resumed.

Files of earlier attempts at a step are renamed, never overwritten.
"""

import hashlib
import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Literal

from flexstage.base.errors import PlanError, RecordError
from flexstage.base.provenance import content_hash, file_hash
from flexstage.experiments.plan import Step
from flexstage.experiments.verb import PlanLookup, SensorEntry
from flexstage.files.decoder import read_json
from flexstage.files.format import Format
from flexstage.files.write import write_whole
from flexstage.instruments.protocol import Identity
from flexstage.instruments.recording.metadata import StageRun, utc_time
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
