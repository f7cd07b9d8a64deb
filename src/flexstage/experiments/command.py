"""Commands of a plan, and their runs, which are recorded to disk with the sensor readings."""

import hashlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from flexstage.base import progress
from flexstage.base.arrays import Array
from flexstage.base.choose import has_no
from flexstage.base.errors import PlanError
from flexstage.base.provenance import content_hash
from flexstage.instruments.protocol import Capability, Instrument, Quantity, Signal, Waveform
from flexstage.instruments.ramp import lead_to
from flexstage.instruments.record_run import record_impact, run_moves, run_waveform
from flexstage.instruments.recording.metadata import RunMetadata
from flexstage.instruments.recording.writer import RunWriter
from flexstage.stage import PiezoStack, Stage

if TYPE_CHECKING:
    from flexstage.records import Record

#: Highest sample rate of an unknown instrument [Hz].
BASE_RATE_HZ = 10e3

#: Name of the acceleration of an axis after an impact.
RESPONSE = "acceleration {}"


def require_size(size: float, kind: str) -> None:
    """Refuse a command that would not fit into memory, before it is computed."""
    # largest command in memory
    most_samples = 5_000_000
    if size > most_samples:
        raise PlanError(
            f"the command '{kind}' would have {size:.0f} samples, and the limit is {most_samples}: "
            "make it shorter, or lower command_rate"
        )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class CommandWaveform:
    """Command of one or more axes, as a waveform."""

    waveform: Waveform
    """The samples."""
    cycles: int = 1
    """Number of repetitions."""
    first: int = 0
    """Number of conditioning samples at the start, over all cycles, which are not evaluated."""
    period: int = 0
    """Samples of a cycle; 0 where there are none."""
    reference: Mapping[str, Array]
    """Reference positions by axis [m], shape (n,); empty where there is no reference."""
    corner: Array | None = None
    """Number of the corner at which both axes dwell, -1 between corners, shape (n,)."""
    notes: tuple[str, ...] = ()
    """Notes for the report."""

    @property
    def axes(self) -> tuple[str, ...]:
        """The axes that it moves."""
        return tuple(self.waveform.values)

    @property
    def quantity(self) -> Quantity:
        """Commanded quantity, voltage or position."""
        return self.waveform.quantity

    @property
    def duration(self) -> float:
        """Duration [s]."""
        return self.waveform.duration * self.cycles

    @property
    def values(self) -> Mapping[str, Array]:
        """Its samples by axis [V or m], each of shape (n,)."""
        return self.waveform.values

    @property
    def unit(self) -> str:
        """Unit of its samples."""
        return "V" if self.quantity == "voltage" else "m"

    @property
    def time(self) -> Array:
        """Times of its samples [s], shape (n,)."""
        return np.arange(self.waveform.size) / self.waveform.sample_rate_hz

    @property
    def hash(self) -> str:
        """SHA-256 of its samples."""
        digest = hashlib.sha256(f"{self.quantity} {self.waveform.sample_rate_hz!r}".encode())
        for axis, values in self.values.items():
            digest.update(axis.encode())
            digest.update(values.tobytes())
        return digest.hexdigest()

    def prepared(self, record: "Record") -> tuple[int, int]:
        """Return the numbers of conditioning samples of its record, and of samples per cycle."""
        rate = record.sample_rate_hz / self.waveform.sample_rate_hz
        # a record of separate positions has no samples between them
        continuous = abs(record.size - self.waveform.size * rate) < 3.0 * max(rate, 1.0)
        return (round(self.first * rate), round(self.period * rate)) if continuous else (0, 0)

    def signals(
        self, sensors: Sequence[Signal], outputs: Sequence[str], stage: Stage
    ) -> list[Signal]:
        """Return the recorded signals: sensors, and voltages of piezo drives."""
        del outputs
        signals = [*sensors]
        for axis in self.axes:
            if isinstance(stage.drive_of(axis), PiezoStack):
                name = _column_name("voltage", axis, self)
                signals.append(Signal(kind="voltage", source=axis, name=name, unit="V"))
        return signals

    def at(self, axis: str, time: Array) -> Array:
        """Return the command of an axis at times from its first sample [V, or m].

        Before the start it is the first sample, after the end the last one.
        """
        return self._at(self.values[axis], time)

    def corner_at(self, time: Array) -> Array:
        """Return the number of the corner at some times, -1 between corners."""
        if self.corner is None:
            return np.full(time.size, -1.0)
        k = np.clip(np.floor(time * self.waveform.sample_rate_hz + 1e-6), 0, self.corner.size - 1)
        return self.corner[k.astype(np.intp)]

    def record(
        self,
        instrument: Instrument,
        signals: Sequence[Signal],
        rate_hz: float,
        stream: Path,
        metadata: RunMetadata,
        *,
        feedforward: Waveform | None = None,
        others_to_rest: bool = True,
    ) -> Path:
        """Run it and record it to disk.

        Samples are written to the stream as they arrive; the resulting file has the same name with
        ``.h5``. If the run fails, the stream contains the samples so far. With `others_to_rest` the
        other axes move to their rest position first.
        """
        prepare_loops(instrument, self.axes, self.quantity)
        if others_to_rest:
            move_to_rest(instrument, self.axes)
        if Capability.WAVE_GENERATOR not in instrument.capabilities:
            return _by_moves(instrument, self, signals, rate_hz, stream, metadata)
        rate = instrument.recorder.configure(signals, rate_hz, 2)

        def columns_at(number: Array) -> dict[str, Array]:
            time = number / rate
            columns = {_column_name("command", a, self): self.at(a, time) for a in self.axes}
            for a, positions in self.reference.items():
                columns[_column_name("reference", a, self)] = self._at(positions, time)
            if self.corner is not None:
                columns["corner"] = self.corner_at(time)
            return columns

        channels = [(s.name, s.unit) for s in signals]
        channels += [
            (n, "1" if n == "corner" else "m" if n.startswith("reference") else self.unit)
            for n in columns_at(np.zeros(2))
        ]
        with RunWriter(stream, channels, rate, metadata) as writer:
            run_waveform(
                instrument,
                self.waveform,
                signals,
                rate_hz=rate_hz,
                cycles=self.cycles,
                feedforward=feedforward,
                writer=_Numbered(writer, columns_at),
            )
        return stream.with_suffix(".h5")

    def _at(self, values: Array, time: Array) -> Array:
        k = np.asarray(time) * self.waveform.sample_rate_hz
        # a time at a sample is that sample, despite rounding
        k = np.where(np.abs(k - np.round(k)) < 1e-6, np.round(k), k)
        n = values.size
        k = np.clip(k, 0.0, n * self.cycles - 1.0)
        # from the last sample to the first of the next cycle, too, interpolation is linear
        return np.interp(k % n, np.arange(n + 1), np.append(values, values[0]))


class _Numbered:
    """Writer that adds columns which depend on the number of the sample."""

    def __init__(
        self, writer: RunWriter, columns_at: Callable[[Array], Mapping[str, Array]], offset: int = 0
    ) -> None:
        self._writer, self._more, self.offset = writer, columns_at, offset

    def append(self, first: int, columns: Mapping[str, Array]) -> object:
        size = len(next(iter(columns.values())))
        number = np.arange(float(first), float(first + size))
        return self._writer.append(first + self.offset, {**columns, **self._more(number)})


def prepare_loops(instrument: Instrument, axes: Sequence[str], quantity: Quantity) -> None:
    """Switch position control on for positions and off for voltages."""
    for name in axes:
        if name not in instrument.axes:
            raise PlanError(has_no("the instrument", "axis", name, instrument.axes))
        axis = instrument.axes[name]
        required = Capability.CLOSED_LOOP if quantity == "position" else Capability.OPEN_LOOP
        if required not in axis.capabilities:
            raise PlanError(f"axis '{name}' of the instrument has no {required.value}")
        if axis.closed_loop != (quantity == "position"):
            axis.set_closed_loop(quantity == "position")


def move_to_rest(instrument: Instrument, busy: Sequence[str]) -> None:
    """Move all unused axes to their low end, so that every run has the same initial state."""
    for name, axis in instrument.axes.items():
        if name in busy:
            continue
        limits = axis.limits
        if limits.voltage is not None and Capability.OPEN_LOOP in axis.capabilities:
            prepare_loops(instrument, [name], "voltage")
            lead_to(instrument, {name: limits.safe_voltage}, "voltage")
        elif limits.position is not None and axis.closed_loop:
            lead_to(instrument, {name: limits.position[0]}, "position")


def _column_name(what: str, axis: str, command: CommandWaveform) -> str:
    return what if len(command.axes) == 1 else f"{what} {axis}"


def _by_moves(
    instrument: Instrument,
    command: CommandWaveform,
    signals: Sequence[Signal],
    rate_hz: float,
    stream: Path,
    metadata: RunMetadata,
) -> Path:
    """Move to the positions at which the command dwells, one by one."""
    places, dwell = _places(command)
    rate = instrument.recorder.configure(signals, rate_hz, 2)
    channels = [*((s.name, s.unit) for s in signals), ("command", "m")]
    with RunWriter(stream, channels, rate, metadata) as writer:
        run_moves(
            instrument, command.axes[0], places.tolist(), dwell, signals, rate_hz=rate_hz,
            writer=writer,
        )  # fmt: skip
    return stream.with_suffix(".h5")


def _places(command: CommandWaveform) -> tuple[Array, float]:
    # largest number of positions of a run without a wave generator
    most_places = 2000
    if command.quantity != "position" or len(command.axes) != 1:
        raise PlanError(
            "this instrument has no wave generator, so it can move only one axis from position to "
            "position: choose another step, or an instrument with a wave generator"
        )
    values = command.waveform.values[command.axes[0]][command.first :]
    starts = np.concatenate(([0], np.flatnonzero(np.diff(values) != 0.0) + 1, [values.size]))
    lengths = np.diff(starts)
    if np.count_nonzero(lengths > 3) >= 2:
        dwelling = lengths > 3
        places, dwell = values[starts[:-1][dwelling]], float(np.median(lengths[dwelling]))
    else:
        # a smooth motion: sample positions along it
        step = max(command.period // 40, 1) if command.period else max(values.size // 200, 1)
        places, dwell = values[::step], float(step)
    if places.size > most_places:
        raise PlanError(
            f"this instrument has no wave generator, and the command has {places.size} positions: "
            f"the limit is {most_places}"
        )
    return places, dwell / command.waveform.sample_rate_hz


@dataclass(frozen=True, slots=True, kw_only=True)
class Strike:
    """Hammer impacts on the stage."""

    axis: str
    """Axis of the impacts."""
    impacts: int
    """Number of impacts."""

    values: ClassVar[Mapping[str, Array]] = {}
    """Samples of the command: none."""
    unit: ClassVar[str] = "N"
    """Unit of the force."""
    notes: ClassVar[tuple[str, ...]] = ()
    """Notes for the report: none."""

    @property
    def time(self) -> Array:
        """Times of the samples: none."""
        return np.empty(0)

    @property
    def hash(self) -> str:
        """SHA-256 of the description."""
        return content_hash(self)

    def prepared(self, record: "Record") -> tuple[int, int]:
        """Return zeros, since its record has neither conditioning samples nor cycles."""
        del record
        return 0, 0

    def signals(
        self, sensors: Sequence[Signal], outputs: Sequence[str], stage: Stage
    ) -> list[Signal]:
        """Return the recorded signals: the force, and accelerations along axes."""
        del sensors, stage
        return [
            Signal(kind="force", source=self.axis, name="force", unit="N"),
            *(
                Signal(kind="response", source=a, name=RESPONSE.format(a), unit="m/s^2")
                for a in outputs or (self.axis,)
            ),
        ]

    def record(
        self,
        instrument: Instrument,
        signals: Sequence[Signal],
        rate_hz: float,
        stream: Path,
        metadata: RunMetadata,
    ) -> Path:
        """Excite the stage with a hammer repeatedly, and record the impacts in succession."""
        # duration of the record of an impact [s]; the instrument determines the time before it
        impact_time = 0.8
        move_to_rest(instrument, ())
        rate = instrument.recorder.configure(signals, rate_hz, 2)
        samples = round(impact_time * rate)
        channels = [(s.name, s.unit) for s in signals]
        n = self.impacts
        with RunWriter(stream, channels, rate, metadata) as writer:
            for k in range(n):
                with progress.subtask(k / n, (k + 1) / n):
                    numbered = _Numbered(writer, lambda _: {}, offset=k * samples)
                    record_impact(instrument, self.axis, signals, rate_hz, samples, numbered)
        return stream.with_suffix(".h5")


#: Command of a step of measure.
Command = CommandWaveform | Strike
