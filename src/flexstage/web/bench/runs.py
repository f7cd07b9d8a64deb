"""Runs at the bench: records, waveforms and plans, as the commands do them."""

import math
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import numpy as np

from flexstage.base.errors import FlexstageError, LimitError, ModelError, RecordError
from flexstage.base.provenance import content_hash
from flexstage.experiments import run_plan
from flexstage.experiments.axis_limits import axis_setting
from flexstage.experiments.command import CommandWaveform
from flexstage.experiments.excitations import EqualCycles
from flexstage.experiments.plan import find_plan, read_plan
from flexstage.experiments.requests import RunRequest
from flexstage.experiments.runner import new_run_folder
from flexstage.experiments.verb import base_rate_of
from flexstage.experiments.verbs.excite import whole_part
from flexstage.files.write import write_whole
from flexstage.hysteresis import Tracking, cycles, loop_width, tracking
from flexstage.instruments.limits import check_position, check_voltage, check_waveform
from flexstage.instruments.protocol import Capability, Instrument, Signal, Waveform
from flexstage.instruments.record_run import record_now
from flexstage.instruments.recording.archive import examine, rescued
from flexstage.instruments.recording.metadata import RunMetadata
from flexstage.instruments.recording.stream import STREAM_SUFFIX, in_use
from flexstage.instruments.recording.writer import RunWriter
from flexstage.records import Record, read_record
from flexstage.report.run import run_text
from flexstage.stage import Stage

if TYPE_CHECKING:
    from flexstage.experiments import PlanResult
    from flexstage.instruments.catalogue.entries import RunEntry

#: Columns of a command that follows a reference.
COMMAND, REFERENCE = "command", "reference"


def loop_of(record: Record, axis: str) -> tuple[str, str] | None:
    """Return the columns of a loop: over the reference, else over the command."""
    names = [channel.name for channel in record.channels]
    x_column = next((n for n in (REFERENCE, f"voltage {axis}", COMMAND) if n in names), None)
    return (x_column, axis) if x_column is not None and axis in names else None


def loop_figures(record: Record, loop: tuple[str, str]) -> tuple[Tracking, int] | None:
    """Return the width of a loop [m], the tracking error [m], and the number of cycles.

    The errors are NaN without a reference; None without a complete cycle.
    """
    command, along = (record.channel(name) for name in loop)
    bounds = cycles(command.values, 1.0 / record.sample_rate_hz).bounds
    if bounds.size < 2:
        return None
    count = bounds.size - 1
    if command.name == REFERENCE:
        return tracking(command.values, along.values, bounds), count
    width = loop_width(command.values, along.values, bounds)
    return Tracking(loop_width=width, rms=np.nan, largest=np.nan), count


#: Samples per cycle of a built waveform, with linear interpolation.
_SAMPLES_PER_CYCLE = 500
#: File of the state of a plan; an interrupted plan has it, and no results.
_STATE = "run.json"


@dataclass(frozen=True, slots=True, kw_only=True)
class RunDescription:
    """Folder and metadata of a run."""

    parent: Path
    """Parent of the folder of the run."""
    stage: Stage
    """The stage."""
    name: str = ""
    """Name of the run; by default that of the stage."""
    operator: str = ""
    """Operator."""
    note: str = ""
    """Note of the operator."""

    def folder(self, kind: str) -> Path:
        """Return a new folder for the run."""
        return new_run_folder(self.parent, self.name or self.stage.name, kind)

    def metadata(self, device: Instrument, kind: str, axis: str) -> RunMetadata:
        """Return the metadata of its record."""
        return RunMetadata(
            stage=self.stage.name,
            stage_hash=content_hash(self.stage),
            serial_number=device.identity.serial_number,
            instrument=device.identity,
            settings=dict(device.settings()),
            kind=kind,
            axis=axis,
            operator=self.operator,
            note=self.note,
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class RunOutcome:
    """Result of a run."""

    folder: Path
    """Folder of the run."""
    record: Record | None = None
    """The record; None for a plan, which may have many."""
    file: Path
    """The file of the record, or the report of the plan."""
    loop: tuple[str, str] | None = None
    """Columns of a loop in the record: command or reference, and measured position."""
    plan: "PlanResult | None" = None
    """Result of a plan."""
    notes: tuple[str, ...] = field(default=())
    """Notes on the run."""


@dataclass(frozen=True, slots=True, kw_only=True)
class WaveformRequest:
    """Parameters of a waveform."""

    axis: str
    """The axis."""
    shape: Literal["cosine", "triangle", "steps"]
    """Shape of a cycle, from the low end to the high end and back."""
    low: float
    """Low end [V, or m in closed loop]."""
    high: float
    """High end [V, or m]."""
    rate_hz: float
    """Frequency [Hz]."""
    cycles: int
    """Number of cycles."""


def build_waveform(device: Instrument, stage: Stage, request: WaveformRequest) -> CommandWaveform:
    """Return a waveform within the limits of voltage, or of position in closed loop.

    Raises
    ------
    FlexstageError
        The waveform exceeds the limits, or its parameters are invalid.
    """
    axis = device.axes[request.axis]
    closed_loop = axis.closed_loop
    limits = axis.limits
    for end in (request.low, request.high):
        (check_position if closed_loop else check_voltage)(limits, end, request.axis)
    if not request.low < request.high:
        raise ModelError("the low end of a waveform must be below its high end")
    setting = axis_setting(stage, request.axis, closed_loop=closed_loop, limits=limits)
    span = setting.high - setting.low
    cycles = EqualCycles(
        axis=request.axis,
        rate=request.rate_hz,
        cycles=request.cycles,
        condition=0,
        shape=request.shape,
        low=min(max((request.low - setting.low) / span, 0.0), 1.0),
        high=min(max((request.high - setting.low) / span, 0.0), 1.0),
        closed_loop=closed_loop,
    )
    base = base_rate_of(device)
    rate = whole_part(min(_SAMPLES_PER_CYCLE * request.rate_hz, base), base)
    return require_runnable(device, cycles.samples({request.axis: setting}, rate, base))


def waveform_from(device: Instrument, path: Path, axis: str, cycles: int) -> CommandWaveform:
    """Return the waveform in a record, in V, or in m in closed loop.

    It is the column `command`, else the first column of that unit. Voltages that were computed for
    a reference are returned with it.
    """
    record = read_record(path)
    unit = "m" if device.axes[axis].closed_loop else "V"
    candidates = sorted(
        (c for c in record.channels if c.unit == unit), key=lambda c: c.name != COMMAND
    )
    column = next(iter(candidates), None)
    if column is None or record.over != "time" or not record.uniform:
        columns = ", ".join(f"{c.name} [{c.unit}]" for c in record.channels)
        raise RecordError(
            f"'{path.name}' has no column in {unit} with uniform sampling; axis '{axis}' "
            f"needs one, as position control is {'on' if unit == 'm' else 'off'}; found {columns}"
        )
    waveform = Waveform(
        values={axis: column.values},
        sample_rate_hz=record.sample_rate_hz,
        quantity="position" if unit == "m" else "voltage",
    )
    reference_values = [c.values for c in record.channels if (c.name, c.unit) == (REFERENCE, "m")]
    reference = {axis: reference_values[0]} if reference_values and unit == "V" else {}
    return require_runnable(
        device, CommandWaveform(waveform=waveform, cycles=cycles, reference=reference)
    )


def require_runnable(device: Instrument, command: CommandWaveform) -> CommandWaveform:
    """Return a waveform that the instrument can run within its limits, else raise an error."""
    limits = {name: axis.limits for name, axis in device.axes.items()}
    check_waveform(limits, command.waveform, cycles=command.cycles)
    size = command.waveform.size
    if Capability.WAVE_GENERATOR in device.capabilities and size > device.waves.capacity:
        raise LimitError(
            f"the waveform has {size} samples, more than the {device.waves.capacity} of the "
            "instrument: reduce the number of cycles"
        )
    return command


def signals_of(device: Instrument, first: str = "") -> list[Signal]:
    """Return the recorded signals: position and voltage, up to the recorder capacity."""
    signals = []
    for name in sorted(device.axes, key=lambda n: n != first):
        signals.append(Signal(kind="position", source=name, name=name))
        if Capability.OPEN_LOOP in device.axes[name].capabilities:
            signals.append(Signal(kind="voltage", source=name, name=f"voltage {name}", unit="V"))
    return signals[: device.recorder.signals]


def take_record(
    device: Instrument, about: RunDescription, duration: float, rate_hz: float
) -> RunOutcome:
    """Record positions and voltages for a duration [s], without moving the stage."""
    if not 0.0 < duration < math.inf:
        raise ModelError(f"the duration of a record must be positive, got {duration:g} s")
    folder = about.folder("record")
    stream = _stream(folder, "record")
    signals = signals_of(device)
    rate = device.recorder.configure(signals, rate_hz, 2)
    try:
        with RunWriter(
            stream,
            [(s.name, s.unit) for s in signals],
            rate,
            about.metadata(device, "record", ""),
        ) as writer:
            record_now(device, signals, rate_hz, max(round(duration * rate), 2), writer)
    finally:
        notes = _save_record(stream)
    return _record_outcome(stream, "", notes)


def run_command(
    device: Instrument, about: RunDescription, command: CommandWaveform, rate_hz: float
) -> RunOutcome:
    """Run a waveform and record the response; other axes do not move."""
    (axis,) = command.axes
    folder = about.folder(f"waveform-{axis}")
    stream = _stream(folder, "waveform")
    metadata = about.metadata(device, "waveform", axis)
    try:
        command.record(
            device, signals_of(device, axis), rate_hz, stream, metadata, others_to_rest=False
        )
    finally:
        notes = _save_record(stream)
    return _record_outcome(stream, axis, notes)


def run_plan_file(
    device: Instrument,
    about: RunDescription,
    source: str,
    folder: Path | None,
    only: tuple[str, ...] | None,
    lock_name: str,
) -> RunOutcome:
    """Run a plan; with its folder, resume an interrupted one."""
    from flexstage.instruments.catalogue.database import default_catalogue

    path = find_plan(source)
    plan = read_plan(path)
    run_folder = folder or about.folder(path.stem)
    if folder is None:
        run_folder.mkdir(parents=True)
        # the copy of the plan, for resuming
        write_whole(run_folder / f"{path.stem}.yaml", path.read_bytes())
    result = run_plan(
        plan,
        device,
        run_folder,
        RunRequest(only=only, resume=folder is not None, operator=about.operator, note=about.note),
        stage=about.stage,
        title=path.stem,
        catalogue=default_catalogue(),
        locked_as=lock_name,
    )
    write_whole(run_folder / "report.html", run_text(result).encode("utf-8"))
    return RunOutcome(
        folder=run_folder, file=run_folder / "report.html", plan=result, notes=result.notes
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class InterruptedRun:
    """An interrupted run."""

    path: Path
    """Stream of the record, or folder of the plan."""
    about: str
    """Description of the saved data."""
    plan: Path | None = None
    """The plan, which can be resumed."""


def interrupted_runs(parent: Path) -> list[InterruptedRun]:
    """Return the interrupted runs, the newest first."""
    runs = []
    for folder in sorted(parent.iterdir(), reverse=True) if parent.is_dir() else []:
        if (folder / _STATE).exists():
            plan = next(iter(folder.glob("*.yaml")), None)
            if plan is not None and not (folder / "results.json").exists():
                runs.append(InterruptedRun(path=folder, about="unfinished plan", plan=plan))
            continue
        for stream in sorted(folder.glob(f"records/*{STREAM_SUFFIX}")):
            with suppress(RecordError, OSError):
                if not in_use(stream):
                    count = examine(stream).samples
                    runs.append(InterruptedRun(path=stream, about=f"{count} samples saved"))
    return runs


def recover_stream(stream: Path) -> Path:
    """Convert a stream to a record next to it, remove it, and enter the record in the catalogue."""
    target = rescued(stream, remove=True)
    _enter(target)
    return target


def _enter(file: Path) -> tuple[str, ...]:
    """Enter the folder of a record in the user's catalogue; return the problems."""
    from flexstage.instruments.catalogue.catalogue import enter_folder

    return tuple(enter_folder(file.parent.parent).problems)


def open_run(entry: "RunEntry") -> RunOutcome:
    """Return the result of an earlier run, by its entry in the catalogue."""
    file = Path(entry.folder) / entry.file
    record = read_record(file)
    return RunOutcome(
        folder=Path(entry.folder), record=record, file=file, loop=loop_of(record, entry.axis)
    )


def _stream(folder: Path, name: str) -> Path:
    (folder / "records").mkdir(parents=True)
    return folder / "records" / f"{name}{STREAM_SUFFIX}"


def _save_record(stream: Path) -> tuple[str, ...]:
    """Save the record, also of a stopped run, and enter it in the catalogue."""
    if stream.exists():
        with suppress(FlexstageError, OSError):
            rescued(stream, remove=True)
    return _enter(stream)


def _record_outcome(stream: Path, axis: str, notes: Sequence[str]) -> RunOutcome:
    file = stream.with_suffix(".h5")
    record = read_record(file)
    return RunOutcome(
        folder=stream.parent.parent,
        record=record,
        file=file,
        loop=loop_of(record, axis) if axis else None,
        notes=tuple(notes),
    )
