"""Metadata of a run, known before its first sample: stage, instrument, settings, operator."""

import datetime
import json
import uuid
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, fields, replace
from pathlib import Path
from typing import Any

from flexstage.base.errors import RecordError
from flexstage.base.version import __version__
from flexstage.files.decoder import Decoder, read_json
from flexstage.files.format import Format
from flexstage.files.nodes import node_of
from flexstage.instruments.protocol import Identity
from flexstage.records import Record

#: Format of the metadata in files.
RUN_DESCRIPTION = Format(
    noun="description of a run",
    error=RecordError,
    later=True,
    exact=True,
    mend="give the unchanged file of a run of flexstage",
)

#: Name of the metadata in the file and among the attributes of the record.
RUN = "run"
#: Names of further attributes: lost samples, and whether the writer ended the run.
LOST, ENDING = "lost", "ending"
# HDF5 stores attributes in the head of the file, which is limited to 64 KiB
_LONGEST = 1000


def utc_now() -> str:
    """Return the present date and time, UTC, ISO 8601 to the microsecond."""
    return datetime.datetime.now(datetime.UTC).isoformat(timespec="microseconds")


def utc_time(text: str, what: str) -> datetime.datetime:
    """Return a date and time in UTC; `what` is its name in messages."""
    try:
        time = datetime.datetime.fromisoformat(text)
        if time.tzinfo is not None:
            return time.astimezone(datetime.UTC)
    except (ValueError, OverflowError) as error:  # the latter at the ends of the calendar
        raise RecordError(
            f"{what} must be a date and time such as {utc_now()}, got {text!r}"
        ) from error
    raise RecordError(f"{what} must have a time zone, as in {text}+00:00, got {text!r}")


def new_identifier() -> str:
    """Return a unique identifier of a run."""
    return uuid.uuid4().hex


@dataclass(frozen=True, slots=True, kw_only=True)
class RunOrigin:
    """Plan, operator, remark and version of a run."""

    plan: str = ""
    """The plan."""
    operator: str = ""
    """The operator."""
    note: str = ""
    """A remark."""
    version: str = ""
    """Version of flexstage."""


@dataclass(frozen=True, slots=True, kw_only=True)
class StageRun(RunOrigin):
    """A run on a stage with an instrument, of one record or of a complete plan."""

    stage: str
    """Name of the stage."""
    stage_hash: str = ""
    """SHA-256 of its description (`flexstage.base.provenance.content_hash`)."""
    serial_number: str = ""
    """Serial number of the stage."""
    instrument: Identity
    """Identity of the instrument."""
    started: str = ""
    """Date and time of the start, UTC, ISO 8601; empty before the start."""


@dataclass(frozen=True, slots=True, kw_only=True)
class RunMetadata(StageRun):
    """Complete metadata of a run, for the head of its file.

    Examples
    --------
    >>> about = RunMetadata(stage="vgtu-piezo", instrument=Identity(vendor="v", model="m"))
    >>> RunMetadata.from_plain(about.plain()) == about
    True
    """

    version: str = __version__
    """Version of flexstage."""
    design: str = ""
    """Built-in design, or file, of the stage's description."""
    settings: Mapping[str, str] = field(default_factory=dict)
    """Settings of the instrument, as text (`Instrument.settings`)."""
    kind: str = ""
    """Kind of test: ``motion``, ``staircase``, ``hold``..."""
    axis: str = ""
    """The axis that moves."""
    step: str = ""
    """The step of the plan."""
    seed: int | None = None
    """Seed of a simulation, or of a designed command."""
    identifier: str = ""
    """Unique identifier, 32 hexadecimal digits; empty before the start, so that the metadata can be
    used for several runs.
    """

    def __post_init__(self) -> None:
        for f in fields(self):
            value = getattr(self, f.name)
            if f.type is str and not isinstance(value, str):
                raise RecordError(f"'{f.name}' of a run must be a text, got {value!r}")
        if self.seed is not None and (
            isinstance(self.seed, bool) or not isinstance(self.seed, int)
        ):
            raise RecordError(f"the seed of a run must be an integer, got {self.seed!r}")
        if not all(isinstance(k, str) and isinstance(v, str) for k, v in self.settings.items()):
            raise RecordError("the settings of an instrument must be texts by name")
        digits = self.identifier
        if digits and (len(digits) != 32 or not set(digits) <= set("0123456789abcdef")):
            raise RecordError(
                f"the identifier of a run must be 32 hexadecimal digits, got {digits!r}"
            )
        if self.started:
            self.start_time()

    def begun(self) -> "RunMetadata":
        """Return the metadata with start time and identifier, where they are missing."""
        return replace(
            self,
            started=self.started or utc_now(),
            identifier=self.identifier or new_identifier(),
        )

    def start_time(self) -> datetime.datetime:
        """Return the date and time of the start, in UTC."""
        return utc_time(self.started, "the start of a run")

    def plain(self) -> dict[str, Any]:
        """Return everything as plain data for JSON, by the names of the fields."""
        return {**asdict(self), "settings": dict(self.settings)}

    @classmethod
    def from_plain(cls, plain: Any) -> "RunMetadata":
        """Return the metadata from the output of `plain`; unknown names are ignored."""
        decoder = Decoder("metadata of a run", RUN_DESCRIPTION)
        return decoder.decode(cls, node_of(plain), "")

    def texts(self) -> dict[str, str]:
        """Return the non-empty metadata of most interest, as lines of text."""
        identity = self.instrument
        device = " ".join(w for w in (identity.vendor, identity.model, identity.serial_number) if w)
        lines = {f.name: getattr(self, f.name) for f in fields(self) if f.type is str}
        lines["instrument"] = f"{device} (simulated)" if identity.simulated else device
        lines["simulated"] = "yes" if identity.simulated else "no"
        lines["seed"] = "" if self.seed is None else str(self.seed)
        return {k: v for k, v in lines.items() if v}


def run_attributes(run: RunMetadata, complete: bool, lost: Sequence[str]) -> dict[str, str]:
    """Return the attributes of the record of a run: all metadata as JSON (``run``), and as text.

    `lost` are notes on lost and duplicate samples.
    """
    lines = {k: _line(v) for k, v in run.texts().items()}
    lines[ENDING] = "complete" if complete else "recovered"
    if lost:
        lines[LOST] = _line("; ".join(lost))
    return {**lines, RUN: json.dumps(run.plain())}


def _line(text: str) -> str:
    """Return a text that can be an HDF5 attribute."""
    line = " ".join(text.replace("\0", " ").split())[:_LONGEST]
    return line.encode("utf-8", "replace").decode("utf-8")


def read_metadata(record: Record) -> RunMetadata:
    """Return the metadata of a run from its record."""
    if RUN not in record.attributes:
        raise RecordError(
            f"the record '{record.source}' has no metadata of its run: flexstage did not record it"
        )
    return read_description(record.attributes[RUN], record.source)


def read_description(text: str | bytes, source: str | Path) -> RunMetadata:
    """Return the metadata of a run from the JSON in its file."""
    where = f"the description of the run in {source}"
    return read_json(RunMetadata, text, where, RUN_DESCRIPTION)
