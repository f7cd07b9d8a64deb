"""How far a plan has come: kept on disk after every step, so that it can be taken up again.

What an earlier attempt at a step has left is kept under another name, never written over.
"""

import hashlib
import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, fields, replace
from pathlib import Path
from typing import Any

from flexstage.errors import PlanError, RecordError
from flexstage.files.write import write_whole

_NAME = "run.json"
_VERSION = 1


@dataclass(frozen=True, slots=True, kw_only=True)
class StepState:
    """How far one step has come."""

    status: str
    """``running``, ``complete``, ``interrupted`` or ``failed``."""
    fingerprint: str
    """Hash of everything that the step depends on."""
    files: Mapping[str, str] = field(default_factory=dict)
    """SHA-256 of each of its files, by its name from the folder of the run."""
    partial: tuple[str, ...] = ()
    """Files of attempts that were interrupted."""
    started: str = ""
    """Date and time of its start, UTC."""
    finished: str = ""
    """Date and time of its end, UTC."""
    identifier: str = ""
    """Name of the run in the catalogue; empty where it is in none."""
    message: str = ""
    """Why it ended early."""


@dataclass(frozen=True, slots=True, kw_only=True)
class RunState:
    """How far a plan has come."""

    plan: str = ""
    """Title or name of the plan."""
    stage: str = ""
    """Name of the stage."""
    stage_hash: str = ""
    """Hash of its description."""
    serial_number: str = ""
    """Its serial number."""
    instrument: Mapping[str, Any] = field(default_factory=dict)
    """What the instrument says it is."""
    operator: str = ""
    """Who carries it out."""
    note: str = ""
    """What they say about it."""
    version: str = ""
    """Version of flexstage."""
    started: str = ""
    """Date and time of the start, UTC."""
    finished: str = ""
    """Date and time of the end, UTC; empty until all is done."""
    steps: Mapping[str, StepState] = field(default_factory=dict)
    """Steps by name."""

    def with_step(self, name: str, step: StepState) -> "RunState":
        """Return the same with one step changed."""
        return replace(self, steps={**self.steps, name: step})


def file_hash(path: Path) -> str:
    """Return the SHA-256 of a file."""
    with path.open("rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()


def write_state(folder: Path, state: RunState) -> None:
    """Write the state whole, or leave the one that is there."""
    write_whole(folder / _NAME, json.dumps({"run": _VERSION, **asdict(state)}, indent=1) + "\n")


def read_state(folder: Path) -> RunState | None:
    """Read the state of a run; None where the folder holds none."""
    path = folder / _NAME
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        return None
    except (OSError, ValueError, RecursionError) as error:
        raise PlanError(
            f"'{path}' cannot be read as the state of a run ({error}): choose another folder, or "
            "remove it to begin anew"
        ) from error
    try:
        if content.pop("run") != _VERSION:
            raise ValueError("its version is not known")
        steps = {
            name: StepState(**{**step, "partial": tuple(step["partial"])})
            for name, step in content.pop("steps").items()
        }
        state = RunState(steps=steps, **content)
        for part in (state, *steps.values()):
            _require_kinds(part)
        return state
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise PlanError(
            f"'{path}' is not the state of a run ({error}): choose another folder, or remove it to "
            "begin anew"
        ) from error


def _require_kinds(state: StepState | RunState) -> None:
    """Refuse a state with a field of another kind than it should be."""
    for name, value in ((entry.name, getattr(state, entry.name)) for entry in fields(state)):
        if name in ("files", "instrument", "steps"):
            sound = isinstance(value, dict)
        else:
            sound = isinstance(value, tuple if name == "partial" else str)
        if not sound:
            raise TypeError(f"'{name}' is {json.dumps(value)[:60]}")
    files = (*state.partial, *state.files.values()) if isinstance(state, StepState) else ()
    if not all(isinstance(text, str) for text in files):
        raise TypeError("a file is no text")


def clear_leftovers(folder: Path, name: str, before: tuple[str, ...]) -> tuple[str, ...]:
    """Put aside what earlier attempts at a step have left; return all files ever put aside.

    Files are named from the folder of the run; `before` are those of earlier attempts.

    A stream that was cut short is recovered into ``NAME.partial-N.h5``; a record that is no longer
    valid becomes ``NAME.replaced-N.h5``.
    """
    kept = list(before)
    records = folder / "records"
    for path in sorted(records.iterdir()) if records.is_dir() else []:
        words = path.stem.split(".")
        # a name of a step has no dot; what follows one is the way in which a reference was followed
        aside = any(word.startswith(("partial-", "replaced-")) for word in words[1:])
        if words[0] != name or aside or path.suffix not in (".h5", ".stream"):
            continue
        if path.suffix == ".h5":
            target = _free(path, "replaced", ".h5")
            path.rename(target)
        else:
            target = _recovered(path)
        kept.append(target.relative_to(folder).as_posix())
    return tuple(kept)


def _recovered(stream: Path) -> Path:
    """Keep what a stream holds: as a record where it holds samples, else as it is."""
    from flexstage.instruments.recording.archive import archived

    target = _free(stream, "partial", ".h5")
    try:
        archived(stream, target)
    except RecordError:
        # no two whole samples are in it, or another program writes it: it is kept as it is
        target = _free(stream, "partial", ".stream")
        stream.rename(target)
        return target
    stream.unlink()
    return target


def _free(path: Path, word: str, suffix: str) -> Path:
    """Return a name that is not taken."""
    k = 1
    while (made := path.with_name(f"{path.stem}.{word}-{k}{suffix}")).exists():
        k += 1
    return made
