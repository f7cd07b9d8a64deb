"""Requests of a run of a plan."""

from dataclasses import dataclass
from typing import Annotated, ClassVar

from flexstage.base.errors import FlexstageError, PlanError
from flexstage.files.ranges import Written
from flexstage.files.request import Request

_TEXT = Annotated[str, Written("TEXT")]


@dataclass(frozen=True, slots=True, kw_only=True)
class RunRequest(Request):
    """Steps of a plan that are carried out, operator, and remark for the records."""

    refused_as: ClassVar[type[FlexstageError]] = PlanError

    only: Annotated[tuple[str, ...], Written("NAMES", commas=True)] | None = None
    """Steps to carry out, separated by commas; the steps that they need are included."""
    resume: bool = False
    """Continue the interrupted run in --folder."""
    operator: _TEXT = ""
    """Name of the operator, for the records."""
    note: _TEXT = ""
    """A remark for the records."""

    def __post_init__(self) -> None:
        super(RunRequest, self).__post_init__()
        if self.only == ():
            raise PlanError("--only names no step: give names separated by commas")


@dataclass(frozen=True, slots=True, kw_only=True)
class BenchRequest(Request):
    """Instrument that carries out a plan, and catalogue of its records."""

    instrument: Annotated[str, Written("ADDRESS")] | None = None
    """Address: gcs://HOST:PORT, serial:///dev/ttyUSB0, ni://Dev1, or twin://?seed=3 for a
    simulation; required except with --dry-run.
    """
    catalogue: Annotated[str, Written("URL")] | None = None
    """Catalogue of the records: a file, or the URL of a database; 'none' for no catalogue (default:
    that of the user).
    """
    yes: bool = False
    """Do not ask for confirmation before a real instrument moves."""
