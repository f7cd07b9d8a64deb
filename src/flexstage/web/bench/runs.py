"""What is carried out at the bench: records, waveforms and plans, as the commands do it."""

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

#: Columns of a command that was made to follow a reference.
COMMAND, REFERENCE = "command", "reference"


def loop_of(record: Record, axis: str) -> tuple[str, str] | None:
    """Return which columns are a loop: over what was wanted, else over what was commanded."""
    known = [channel.name for channel in record.channels]
    over = next((n for n in (REFERENCE, f"voltage {axis}", COMMAND) if n in known), None)
    return (over, axis) if over is not None and axis in known else None


def loop_figures(record: Record, loop: tuple[str, str]) -> tuple[Tracking, int] | None:
    """Return the width of a loop [m], the error of a reference [m], and the number of cycles.

    The errors are NaN where nothing was wanted; None where there is no whole cycle.
    """
    over, along = (record.channel(name) for name in loop)
    bounds = cycles(over.values, 1.0 / record.sample_rate_hz).bounds
    if bounds.size < 2:
        return None
    count = bounds.size - 1
    if over.name == REFERENCE:
        return tracking(over.values, along.values, bounds), count
    width = loop_width(over.values, along.values, bounds)
    return Tracking(loop_width=width, rms=np.nan, largest=np.nan), count


#: Samples in a cycle of a waveform that is made here; straight lines between them.
_IN_CYCLE = 500
#: A plan that was begun and not ended is known by this file.
_STATE = "run.json"


@dataclass(frozen=True, slots=True, kw_only=True)
class AboutRun:
    """Where a run is written, and what is said of it."""

    parent: Path
    """Folder in which it gets a folder of its own."""
    stage: Stage
    """The stage."""
    name: str = ""
    """What they call it; the stage where they give it no name."""
    operator: str = ""
    """Who works."""
    note: str = ""
    """What they say about it."""

    def folder(self, kind: str) -> Path:
        """Return a folder for it that is not there yet."""
        return new_run_folder(self.parent, self.name or self.stage.name, kind)

    def metadata(self, device: Instrument, kind: str, axis: str) -> RunMetadata:
        """Return what is written at the head of its record."""
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
    """What a run gave."""

    folder: Path
    """Its folder."""
    record: Record | None = None
    """What was recorded; None of a plan, which may have many."""
    file: Path
    """The file of the record, or the report of the plan."""
    loop: tuple[str, str] | None = None
    """Which columns of the record are a loop: what was commanded or wanted, and what followed."""
    plan: "PlanResult | None" = None
    """What a plan gave."""
    notes: tuple[str, ...] = field(default=())
    """What is to be known of it."""


@dataclass(frozen=True, slots=True, kw_only=True)
class WaveformOrder:
    """A waveform as a person orders it."""

    axis: str
    """The axis."""
    shape: Literal["cosine", "triangle"]
    """How each cycle runs, from the low end and back."""
    low: float
    """Low end [V, or m under control]."""
    high: float
    """High end [V, or m]."""
    rate_hz: float
    """Cycles in a second [Hz]."""
    cycles: int
    """How many."""


def made_waveform(device: Instrument, stage: Stage, order: WaveformOrder) -> CommandWaveform:
    """Return a waveform whose every sample is within the limits: of voltages, or under control.

    Raises
    ------
    FlexstageError
        It leaves the limits, or is none.
    """
    axis = device.axes[order.axis]
    closed = axis.closed_loop
    limits = axis.limits
    for end in (order.low, order.high):
        (check_position if closed else check_voltage)(limits, end, order.axis)
    if not order.low < order.high:
        raise ModelError("a waveform runs from a low end to a high end: give the lower one first")
    setting = axis_setting(stage, order.axis, closed_loop=closed, limits=limits)
    span = setting.high - setting.low
    cycles = EqualCycles(
        axis=order.axis,
        rate=order.rate_hz,
        cycles=order.cycles,
        condition=0,
        shape=order.shape,
        low=min(max((order.low - setting.low) / span, 0.0), 1.0),
        high=min(max((order.high - setting.low) / span, 0.0), 1.0),
        closed_loop=closed,
    )
    base = base_rate_of(device)
    rate = whole_part(min(_IN_CYCLE * order.rate_hz, base), base)
    return checked(device, cycles.samples({order.axis: setting}, rate, base))


def waveform_from(device: Instrument, path: Path, axis: str, cycles: int) -> CommandWaveform:
    """Return the waveform that a record holds, in V, or in m under control.

    It is the column that is called a command, or else the first one of that unit. Voltages that
    were made to follow a reference have it with them.
    """
    record = read_record(path)
    unit = "m" if device.axes[axis].closed_loop else "V"
    fitting = sorted(
        (c for c in record.channels if c.unit == unit), key=lambda c: c.name != COMMAND
    )
    column = next(iter(fitting), None)
    if column is None or record.over != "time" or not record.uniform:
        found = ", ".join(f"{c.name} [{c.unit}]" for c in record.channels)
        raise RecordError(
            f"'{path.name}' has no column in {unit} over even times, which axis '{axis}' takes "
            f"with its position control {'on' if unit == 'm' else 'off'}: it has {found}"
        )
    waveform = Waveform(
        values={axis: column.values},
        sample_rate_hz=record.sample_rate_hz,
        quantity="position" if unit == "m" else "voltage",
    )
    wanted = [c.values for c in record.channels if (c.name, c.unit) == (REFERENCE, "m")]
    reference = {axis: wanted[0]} if wanted and unit == "V" else {}
    return checked(device, CommandWaveform(waveform=waveform, cycles=cycles, reference=reference))


def checked(device: Instrument, command: CommandWaveform) -> CommandWaveform:
    """Return a waveform that the axes of an instrument may run, or refuse it."""
    limits = {name: axis.limits for name, axis in device.axes.items()}
    check_waveform(limits, command.waveform, cycles=command.cycles)
    size = command.waveform.size
    if Capability.WAVE_GENERATOR in device.capabilities and size > device.waves.capacity:
        raise LimitError(
            f"the waveform has {size} samples, and the instrument holds {device.waves.capacity}: "
            "let it have fewer cycles"
        )
    return command


def signals_of(device: Instrument, first: str = "") -> list[Signal]:
    """Return what is recorded: position and voltage of all axes, as many as the recorder takes."""
    found = []
    for name in sorted(device.axes, key=lambda n: n != first):
        found.append(Signal(kind="position", source=name, name=name))
        if Capability.OPEN_LOOP in device.axes[name].capabilities:
            found.append(Signal(kind="voltage", source=name, name=f"voltage {name}", unit="V"))
    return found[: device.recorder.signals]


def take_record(device: Instrument, about: AboutRun, duration: float, rate_hz: float) -> RunOutcome:
    """Record what the stage does, for some time [s]."""
    if not 0.0 < duration < math.inf:
        raise ModelError(f"a record takes a positive time, got {duration:g} s")
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
        notes = _kept(stream)
    return _recorded(stream, "", notes)


def run_command(
    device: Instrument, about: AboutRun, command: CommandWaveform, rate_hz: float
) -> RunOutcome:
    """Run a waveform and record what follows; other axes stay where they are."""
    (axis,) = command.axes
    folder = about.folder(f"waveform-{axis}")
    stream = _stream(folder, "waveform")
    metadata = about.metadata(device, "waveform", axis)
    try:
        command.record(
            device, signals_of(device, axis), rate_hz, stream, metadata, others_to_rest=False
        )
    finally:
        notes = _kept(stream)
    return _recorded(stream, axis, notes)


def carry_out(
    device: Instrument,
    about: AboutRun,
    source: str,
    folder: Path | None,
    only: tuple[str, ...] | None,
    held: str,
) -> RunOutcome:
    """Carry out a plan; with its folder go on with one that was interrupted."""
    from flexstage.instruments.catalogue.database import default_catalogue

    path = find_plan(source)
    plan = read_plan(path)
    where = folder or about.folder(path.stem)
    if folder is None:
        where.mkdir(parents=True)
        # by which it is found again
        write_whole(where / f"{path.stem}.yaml", path.read_bytes())
    result = run_plan(
        plan,
        device,
        where,
        RunRequest(only=only, resume=folder is not None, operator=about.operator, note=about.note),
        stage=about.stage,
        title=path.stem,
        catalogue=default_catalogue(),
        locked_as=held,
    )
    write_whole(where / "report.html", run_text(result).encode("utf-8"))
    return RunOutcome(folder=where, file=where / "report.html", plan=result, notes=result.notes)


@dataclass(frozen=True, slots=True, kw_only=True)
class LeftOver:
    """What a run has left that did not come to its end."""

    path: Path
    """Its stream, or the folder of its plan."""
    about: str
    """What there is of it, in words."""
    plan: Path | None = None
    """The plan that can be gone on with."""


def left_over(parent: Path) -> list[LeftOver]:
    """Return what runs have left that were interrupted, the newest first."""
    found = []
    for folder in sorted(parent.iterdir(), reverse=True) if parent.is_dir() else []:
        if (folder / _STATE).exists():
            plan = next(iter(folder.glob("*.yaml")), None)
            if plan is not None and not (folder / "results.json").exists():
                found.append(LeftOver(path=folder, about="a plan that has not ended", plan=plan))
            continue
        for stream in sorted(folder.glob(f"records/*{STREAM_SUFFIX}")):
            with suppress(RecordError, OSError):
                if not in_use(stream):
                    count = examine(stream).samples
                    found.append(LeftOver(path=stream, about=f"{count} samples are safe"))
    return found


def recovered(stream: Path) -> Path:
    """Recover a stream beside itself, remove it, and enter it in the catalogue."""
    target = rescued(stream, remove=True)
    _entered(target)
    return target


def _entered(file: Path) -> tuple[str, ...]:
    """Enter the folder of a record in the user's catalogue; return what could not be."""
    from flexstage.instruments.catalogue.folder import enter_folder

    return tuple(enter_folder(file.parent.parent).problems)


def earlier(entry: "RunEntry") -> RunOutcome:
    """Return what an earlier run gave, by its entry in the catalogue."""
    file = Path(entry.folder) / entry.file
    record = read_record(file)
    return RunOutcome(
        folder=Path(entry.folder), record=record, file=file, loop=loop_of(record, entry.axis)
    )


def _stream(folder: Path, name: str) -> Path:
    (folder / "records").mkdir(parents=True)
    return folder / "records" / f"{name}{STREAM_SUFFIX}"


def _kept(stream: Path) -> tuple[str, ...]:
    """Keep what was recorded, also of what was stopped, and enter it in the catalogue."""
    if stream.exists():
        with suppress(FlexstageError, OSError):
            rescued(stream, remove=True)
    return _entered(stream)


def _recorded(stream: Path, axis: str, notes: Sequence[str]) -> RunOutcome:
    file = stream.with_suffix(".h5")
    record = read_record(file)
    return RunOutcome(
        folder=stream.parent.parent,
        record=record,
        file=file,
        loop=loop_of(record, axis) if axis else None,
        notes=tuple(notes),
    )
