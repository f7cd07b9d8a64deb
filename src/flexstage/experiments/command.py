"""A command that is ready to run, and its run, recorded to disk beside what the sensors read."""

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
from flexstage.instruments.record_run import record_blow, run_moves, run_waveform
from flexstage.instruments.recording.metadata import RunMetadata
from flexstage.instruments.recording.writer import RunWriter
from flexstage.stage import PiezoStack, Stage

if TYPE_CHECKING:
    from flexstage.records import Record

#: Highest rate of samples of an instrument that nobody has asked [Hz].
BASE_RATE_HZ = 10e3

#: What the acceleration at a blow is called.
RESPONSE = "acceleration {}"


def require_size(size: float, kind: str) -> None:
    """Refuse a command that would not fit into memory, before it is made."""
    # more samples do not fit into memory
    most_samples = 5_000_000
    if size > most_samples:
        raise PlanError(
            f"the command '{kind}' would have {size:.0f} samples, and at most {most_samples} are "
            "allowed: make it shorter, or lower command_rate"
        )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class CommandWaveform:
    """What axes are to do."""

    waveform: Waveform
    """The samples."""
    cycles: int = 1
    """How often they are run."""
    first: int = 0
    """Samples at its beginning that prepare, and are not evaluated, over all cycles."""
    period: int = 0
    """Samples of a cycle; 0 where there are none."""
    reference: Mapping[str, Array]
    """Positions that shall be followed, by axis [m], shape (n,); empty for a mere command."""
    corner: Array | None = None
    """Number of the corner at which both axes rest, -1 on the way, shape (n,)."""
    notes: tuple[str, ...] = ()
    """What a reader should know."""

    @property
    def axes(self) -> tuple[str, ...]:
        """The axes that it moves."""
        return tuple(self.waveform.values)

    @property
    def quantity(self) -> Quantity:
        """Whether voltages or positions are commanded."""
        return self.waveform.quantity

    @property
    def duration(self) -> float:
        """How long it takes [s]."""
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
        found = hashlib.sha256(f"{self.quantity} {self.waveform.sample_rate_hz!r}".encode())
        for axis, values in self.values.items():
            found.update(axis.encode())
            found.update(values.tobytes())
        return found.hexdigest()

    def prepared(self, record: "Record") -> tuple[int, int]:
        """Return how many samples of its record prepare, and how many a cycle has."""
        rate = record.sample_rate_hz / self.waveform.sample_rate_hz
        # a record that was taken at places has no samples between them
        whole = abs(record.size - self.waveform.size * rate) < 3.0 * max(rate, 1.0)
        return (round(self.first * rate), round(self.period * rate)) if whole else (0, 0)

    def signals(
        self, sensors: Sequence[Signal], outputs: Sequence[str], stage: Stage
    ) -> list[Signal]:
        """Return what is recorded: sensors, and the voltages of the drives that have one."""
        del outputs
        found = [*sensors]
        for axis in self.axes:
            if isinstance(stage.drive_of(axis), PiezoStack):
                name = _named("voltage", axis, self)
                found.append(Signal(kind="voltage", source=axis, name=name, unit="V"))
        return found

    def at(self, axis: str, time: Array) -> Array:
        """Return the command of an axis at times from its first sample [V, or m].

        Before its beginning it is that of the first sample, after its end that of the last.
        """
        return self._at(self.values[axis], time)

    def corner_at(self, time: Array) -> Array:
        """Return the number of the corner at some times, -1 on the way."""
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
        parked: bool = True,
    ) -> Path:
        """Run it and record it to disk.

        Samples go to the stream while they come; the file beside it ends in ``.h5``. Where the run
        fails, what was recorded until then is in the stream. Other axes are `parked` first, or stay
        where they are.
        """
        prepare_loops(instrument, self.axes, self.quantity)
        if parked:
            park(instrument, self.axes)
        if Capability.WAVE_GENERATOR not in instrument.capabilities:
            return _by_moves(instrument, self, signals, rate_hz, stream, metadata)
        rate = instrument.recorder.configure(signals, rate_hz, 2)

        def more(number: Array) -> dict[str, Array]:
            time = number / rate
            made = {_named("command", a, self): self.at(a, time) for a in self.axes}
            for a, positions in self.reference.items():
                made[_named("reference", a, self)] = self._at(positions, time)
            if self.corner is not None:
                made["corner"] = self.corner_at(time)
            return made

        channels = [(s.name, s.unit) for s in signals]
        channels += [
            (n, "1" if n == "corner" else "m" if n.startswith("reference") else self.unit)
            for n in more(np.zeros(2))
        ]
        with RunWriter(stream, channels, rate, metadata) as writer:
            run_waveform(
                instrument,
                self.waveform,
                signals,
                rate_hz=rate_hz,
                cycles=self.cycles,
                feedforward=feedforward,
                writer=_Numbered(writer, more),
            )
        return stream.with_suffix(".h5")

    def _at(self, values: Array, time: Array) -> Array:
        k = np.asarray(time) * self.waveform.sample_rate_hz
        # a time on a sample is that sample, whatever rounding says
        k = np.where(np.abs(k - np.round(k)) < 1e-6, np.round(k), k)
        n = values.size
        k = np.clip(k, 0.0, n * self.cycles - 1.0)
        # from the last sample to the first of the next cycle the way is straight too
        return np.interp(k % n, np.arange(n + 1), np.append(values, values[0]))


class _Numbered:
    """Hands samples on with further columns that follow from their number."""

    def __init__(
        self, writer: RunWriter, more: Callable[[Array], Mapping[str, Array]], offset: int = 0
    ) -> None:
        self._writer, self._more, self.offset = writer, more, offset

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
        wanted = Capability.CLOSED_LOOP if quantity == "position" else Capability.OPEN_LOOP
        if wanted not in axis.capabilities:
            raise PlanError(f"axis '{name}' of the instrument has no {wanted.value}")
        if axis.closed_loop != (quantity == "position"):
            axis.set_closed_loop(quantity == "position")


def park(instrument: Instrument, busy: Sequence[str]) -> None:
    """Lead all axes that are not used to their low end, so that every run finds them there."""
    for name, axis in instrument.axes.items():
        if name in busy:
            continue
        limits = axis.limits
        if limits.voltage is not None and Capability.OPEN_LOOP in axis.capabilities:
            prepare_loops(instrument, [name], "voltage")
            lead_to(instrument, {name: limits.safe_voltage}, "voltage")
        elif limits.position is not None and axis.closed_loop:
            lead_to(instrument, {name: limits.position[0]}, "position")


def _named(what: str, axis: str, command: CommandWaveform) -> str:
    return what if len(command.axes) == 1 else f"{what} {axis}"


def _by_moves(
    instrument: Instrument,
    command: CommandWaveform,
    signals: Sequence[Signal],
    rate_hz: float,
    stream: Path,
    metadata: RunMetadata,
) -> Path:
    """Go to the places where the command rests, one by one."""
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
    # runs without a generator of waveforms stop at no more places than this
    most_places = 2000
    if command.quantity != "position" or len(command.axes) != 1:
        raise PlanError(
            "this instrument runs no waveforms, and only positions of one axis can be gone to "
            "without: choose another step, or an instrument with a wave generator"
        )
    values = command.waveform.values[command.axes[0]][command.first :]
    starts = np.concatenate(([0], np.flatnonzero(np.diff(values) != 0.0) + 1, [values.size]))
    rests = np.diff(starts)
    if np.count_nonzero(rests > 3) >= 2:
        kept = rests > 3
        places, dwell = values[starts[:-1][kept]], float(np.median(rests[kept]))
    else:
        # a smooth motion: some places on each way
        step = max(command.period // 40, 1) if command.period else max(values.size // 200, 1)
        places, dwell = values[::step], float(step)
    if places.size > most_places:
        raise PlanError(
            f"this instrument runs no waveforms, and {places.size} places would have to be gone to"
        )
    return places, dwell / command.waveform.sample_rate_hz


@dataclass(frozen=True, slots=True, kw_only=True)
class Strike:
    """Blows of a hammer."""

    axis: str
    """The axis along which the stage is struck."""
    hits: int
    """How often."""

    values: ClassVar[Mapping[str, Array]] = {}
    """None: nothing is commanded."""
    unit: ClassVar[str] = "N"
    """Unit of what acts."""
    notes: ClassVar[tuple[str, ...]] = ()
    """What a reader should know: nothing."""

    @property
    def time(self) -> Array:
        """No times."""
        return np.empty(0)

    @property
    def hash(self) -> str:
        """SHA-256 of it."""
        return content_hash(self)

    def prepared(self, record: "Record") -> tuple[int, int]:
        """Return that no sample of its record prepares, and that there are no cycles."""
        del record
        return 0, 0

    def signals(
        self, sensors: Sequence[Signal], outputs: Sequence[str], stage: Stage
    ) -> list[Signal]:
        """Return what is recorded: the force, and accelerations along axes."""
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
        """Strike the stage some times, and record the blows one after the other."""
        # how long a blow is recorded [s]; what of it comes before the blow is the instrument's own
        blow_time = 0.8
        park(instrument, ())
        rate = instrument.recorder.configure(signals, rate_hz, 2)
        samples = round(blow_time * rate)
        channels = [(s.name, s.unit) for s in signals]
        with RunWriter(stream, channels, rate, metadata) as writer:
            for hit in range(self.hits):
                with progress.subtask(hit / self.hits, (hit + 1) / self.hits):
                    numbered = _Numbered(writer, lambda _: {}, offset=hit * samples)
                    record_blow(instrument, self.axis, signals, rate_hz, samples, numbered)
        return stream.with_suffix(".h5")


#: What a step of measure runs.
Command = CommandWaveform | Strike
