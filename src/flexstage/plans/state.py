"""How far a plan has come: kept on disk after every step, so that it can be taken up again."""

import hashlib
import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, fields, replace
from pathlib import Path
from typing import Any

from flexstage.errors import PlanError
from flexstage.plans.files import write_text

__all__ = ["RunState", "StepState", "file_hash", "read_state", "write_state"]

_NAME = "run.json"
_VERSION = 1


@dataclass(frozen=True, slots=True, kw_only=True)
class StepState:
    """How far one step has come.

    Parameters
    ----------
    status : str
        ``running``, ``complete``, ``interrupted`` or ``failed``.
    fingerprint : str
        Hash of everything that the step depends on.
    files : Mapping
        SHA-256 of each of its files, by its name from the folder of the run.
    partial : tuple of str
        Files of attempts that were interrupted.
    started, finished : str
        Dates and times, UTC.
    identifier : str
        Name of the run in the catalogue; empty where it is in none.
    message : str
        Why it ended early.
    """

    status: str
    fingerprint: str
    files: Mapping[str, str] = field(default_factory=dict)
    partial: tuple[str, ...] = ()
    started: str = ""
    finished: str = ""
    identifier: str = ""
    message: str = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class RunState:
    """How far a plan has come.

    Parameters
    ----------
    plan : str
        Title or name of the plan.
    stage, stage_hash, serial_number : str
        The stage.
    instrument : Mapping
        What the instrument says it is.
    operator, note : str
        Who carries it out, and what they say about it.
    version : str
        Version of flexstage.
    started, finished : str
        Dates and times, UTC; `finished` is empty until all is done.
    steps : Mapping
        Steps by name.
    """

    plan: str = ""
    stage: str = ""
    stage_hash: str = ""
    serial_number: str = ""
    instrument: Mapping[str, Any] = field(default_factory=dict)
    operator: str = ""
    note: str = ""
    version: str = ""
    started: str = ""
    finished: str = ""
    steps: Mapping[str, StepState] = field(default_factory=dict)

    def with_step(self, name: str, step: StepState) -> "RunState":
        """Return the same with one step changed.

        Parameters
        ----------
        name : str
            Name of the step.
        step : StepState
            How far it has come.

        Returns
        -------
        RunState
            The new state.
        """
        return replace(self, steps={**self.steps, name: step})


def file_hash(path: Path) -> str:
    """Return the SHA-256 of a file.

    Parameters
    ----------
    path : pathlib.Path
        The file.

    Returns
    -------
    str
        64 hexadecimal digits.
    """
    with path.open("rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()


def write_state(folder: Path, state: RunState) -> None:
    """Write the state whole, or leave the one that is there.

    Parameters
    ----------
    folder : pathlib.Path
        Folder of the run.
    state : RunState
        The state.

    Raises
    ------
    OSError
        It cannot be written.
    """
    write_text(folder / _NAME, json.dumps({"run": _VERSION, **asdict(state)}, indent=1) + "\n")


def read_state(folder: Path) -> RunState | None:
    """Read the state of a run.

    Parameters
    ----------
    folder : pathlib.Path
        Folder of the run.

    Returns
    -------
    RunState or None
        The state; None where the folder holds none.

    Raises
    ------
    PlanError
        What is there is no state of a run.
    """
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
