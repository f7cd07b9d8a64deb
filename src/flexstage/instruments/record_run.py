"""Recorded runs on any instrument: waveforms, dwells, hammer impacts and moves.

Samples are read during the record and passed to a writer immediately, so that those before a lost
connection or a crash are kept.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Protocol

import numpy as np

from flexstage.base import progress
from flexstage.base.arrays import Array
from flexstage.base.errors import ControllerError, LimitError, ModelError, NotConnectedError
from flexstage.instruments.limits import check_feedforward, check_position, check_waveform
from flexstage.instruments.protocol import Capability, Instrument, Signal, Waveform
from flexstage.instruments.ramp import lead_to, require_loop
from flexstage.records import Channel, Record

#: Settling time at a position before its record [s].
_SETTLE = 0.1


class SampleWriter(Protocol):
    """Writer of samples as they arrive."""

    def append(self, first: int, columns: Mapping[str, Array]) -> object:
        """Write samples of every column [SI]; `first` is the number of the first one, from 0."""
        ...


def run_waveform(
    instrument: Instrument,
    waveform: Waveform,
    signals: Sequence[Signal],
    *,
    rate_hz: float,
    cycles: int = 1,
    feedforward: Waveform | None = None,
    writer: SampleWriter | None = None,
    timeout: float | None = None,
) -> Record:
    """Run a waveform and record it.

    The complete waveform is checked before any motion. The axes are ramped slowly to its first
    sample. The recorder starts with the waveform, so that sample 0 of the record coincides with
    sample 0 of the waveform.

    Position control must be off for a waveform of voltages, and on for one of positions, to which
    feedforward voltages can be added. The record contains the actual sample rate. `timeout` is the
    longest wait for the record beyond its duration [s] (default: 10 s plus half of that duration).

    Raises
    ------
    LimitError, ModelError
        The waveform exceeds the limits, the record does not fit into the recorder, or the arguments
        are inconsistent; the stage has not moved.
    ControllerError
        The instrument refuses, a sensor gives no number, or the record does not end; the stage was
        stopped.
    NotConnectedError
        The connection was lost; the message gives the number of saved samples.
    """
    if cycles < 1:
        raise LimitError(f"a recorded waveform needs at least 1 cycle, got {cycles}")
    limits = {name: axis.limits for name, axis in instrument.axes.items()}
    check_waveform(limits, waveform, cycles=cycles)
    if feedforward is not None:
        check_feedforward(limits, waveform, feedforward, cycles=cycles)
    first = {name: float(values[0]) for name, values in waveform.values.items()}
    require_loop(instrument, first, waveform.quantity)
    duration = waveform.duration * cycles

    def samples(rate: float) -> int:
        return max(round(duration * rate), 2)

    run = RecordedRun(instrument, signals, writer)
    run.configure(rate_hz, samples)  # an impossible record is refused before any motion
    with run.stopping():
        lead_to(instrument, first, waveform.quantity)
        waves = instrument.waves
        waves.load(waveform, feedforward=feedforward)
        run.configure(rate_hz, samples)
        instrument.recorder.arm()
        waves.start(cycles)
        run.read(timeout)
        waited, most = 0.0, 10.0 if timeout is None else timeout
        while waves.running():
            if waited > most:
                raise ControllerError(
                    f"the waveform still ran {waited:.4g} s after its record ended: it was stopped"
                )
            instrument.pause(0.01)
            waited += 0.01
    return run.record()


def record_now(
    instrument: Instrument,
    signals: Sequence[Signal],
    rate_hz: float,
    samples: int,
    writer: SampleWriter | None = None,
) -> Record:
    """Record the present state or motion of the instrument, such as a held position.

    At least 2 samples; errors are those of `run_waveform`.
    """
    run = RecordedRun(instrument, signals, writer)
    with run.stopping():
        run.configure(rate_hz, lambda _: samples)
        instrument.recorder.start()
        run.read()
    return run.record()


def record_impact(
    instrument: Instrument,
    axis: str,
    signals: Sequence[Signal],
    rate_hz: float,
    samples: int,
    writer: SampleWriter | None = None,
) -> Record:
    """Record a hammer impact along an axis; `signals` are its ``force`` and ``response``."""
    if Capability.IMPACT not in instrument.capabilities:
        raise ModelError(
            f"the {instrument.identity.model} has no hammer: excite the stage by hand and read the "
            "record of the hammer's instrument"
        )
    run = RecordedRun(instrument, signals, writer)
    with run.stopping():
        run.configure(rate_hz, lambda _: samples)
        instrument.recorder.arm()
        instrument.strike(axis)
        run.read()
    return run.record()


def run_moves(
    instrument: Instrument,
    axis: str,
    positions: Sequence[float],
    dwell: float,
    signals: Sequence[Signal],
    *,
    rate_hz: float,
    writer: SampleWriter | None = None,
) -> Record:
    """Move an axis from position to position [m] and record while it dwells at each.

    For instruments without a wave generator, and for slow drives. At each position the axis settles
    for 0.1 s, then the record lasts for `dwell` [s]. The column ``command`` is the commanded
    position. The time counts recorded samples only.
    """
    if not len(positions):
        raise ModelError("moves need at least one position, got none")
    require_loop(instrument, {axis: 0.0}, "position")
    mover = instrument.axes[axis]
    for position in positions:
        check_position(mover.limits, position, axis)
    parts: list[Record] = []
    count = 0
    for k, position in enumerate(positions):
        with progress.subtask(k / len(positions), (k + 1) / len(positions)):
            run = RecordedRun(instrument, signals, writer, first=count, command=float(position))
            with run.stopping():
                mover.move_to(float(position))
                instrument.pause(_SETTLE)
                run.configure(rate_hz, lambda rate: max(round(dwell * rate), 2))
                instrument.recorder.start()
                run.read()
            parts.append(run.record())
            count += parts[-1].size
    rate = parts[0].sample_rate_hz
    return Record(
        channels=tuple(
            Channel(
                name=c.name, values=np.concatenate([p.channel(c.name).values for p in parts]),
                unit=c.unit,
            )
            for c in parts[0].channels
        ),
        time=np.arange(count) / rate,
        source=parts[0].source,
        notes=(*parts[0].notes, "the time does not include the moves between positions"),
        attributes=parts[0].attributes,
    )  # fmt: skip


class RecordedRun:
    """One record, from its configuration to its last sample.

    Samples are read during the record, checked, kept, and passed to the writer, for which the first
    one has the number `first`. `command` is the constant position of the column of that name [m].
    """

    def __init__(
        self,
        instrument: Instrument,
        signals: Sequence[Signal],
        writer: SampleWriter | None,
        *,
        first: int = 0,
        command: float | None = None,
    ) -> None:
        names = [s.name for s in signals] + ["command"] * (command is not None)
        if not signals or len(set(names)) != len(names):
            raise ModelError(
                "a record needs at least one signal, each with a different name, got "
                f"{', '.join(names) or 'none'}"
            )
        self.instrument, self.signals, self.writer = instrument, tuple(signals), writer
        self.first, self.command = first, command
        self.rate, self.samples, self.done = 0.0, 0, 0
        self._parts: list[dict[str, Array]] = []

    def configure(self, rate_hz: float, samples: Callable[[float], int]) -> None:
        """Configure the recorder; `samples` is the number of samples at the actual rate [Hz]."""
        recorder, rate = self.instrument.recorder, float(rate_hz)
        if not 0.0 < rate < np.inf:
            raise ModelError(f"the rate of a record must be positive and finite, got {rate_hz!r}")
        if len(self.signals) > recorder.signals:
            raise LimitError(
                f"the instrument can record {recorder.signals} signals at once, got "
                f"{len(self.signals)}: record them in several runs"
            )
        for _ in range(2):
            count = samples(rate)
            if count < 2:
                raise ModelError(f"a record needs at least 2 samples, got {count}")
            if count > recorder.capacity:
                raise LimitError(
                    f"the record would have {count} samples, and the memory of the instrument has "
                    f"{recorder.capacity}: record at {rate * recorder.capacity / count:.4g} Hz or "
                    "slower, or for a shorter time"
                )
            self.rate, self.samples = recorder.configure(self.signals, rate, count), count
            if samples(self.rate) == count:
                return
            rate = self.rate

    @contextmanager
    def stopping(self) -> Iterator[None]:
        """Stop the instrument when the block fails, and report how many samples are saved."""
        try:
            yield
        except BaseException as error:
            self.instrument.stop()
            if not isinstance(error, NotConnectedError):
                raise
            fate = "were read but not saved" if self.writer is None else "are saved by the writer"
            of = f", of {self.first + self.samples}" if self.samples else ""
            raise NotConnectedError(
                f"{error}; {self.first + self.done} samples {fate}{of}"
            ) from error

    def read(self, timeout: float | None = None) -> None:
        """Read samples until the record is complete.

        `timeout` is in addition to the duration of the record [s], on the instrument's clock.
        """
        recorder, goal = self.instrument.recorder, self.samples
        expected = goal / self.rate
        most = expected + (10.0 + 0.5 * expected if timeout is None else timeout)
        step = min(max(expected / 50.0, 0.01), 0.25)
        waited = 0.0
        while True:
            available = min(recorder.available(), goal)
            # A record has at least two samples: a single one waits for the next.
            if available - self.done >= 2 or (available == goal and available > self.done):
                self._take(available)
            if self.done >= goal:
                return
            if waited > most:
                raise ControllerError(
                    f"{self.done} of {goal} samples arrived in {waited:.4g} s instead of "
                    f"{expected:.4g} s: check that the recorder was started, and its rate"
                )
            self.instrument.pause(step)
            waited += step

    def record(self) -> Record:
        """Return all samples; the time counts from 0 [s]."""
        identity = self.instrument.identity
        columns = [(s.name, s.unit) for s in self.signals]
        if self.command is not None:
            columns.append(("command", "m"))
        return Record(
            channels=tuple(
                Channel(name=n, values=np.concatenate([p[n] for p in self._parts]), unit=u)
                for n, u in columns
            ),
            time=np.arange(self.done) / self.rate,
            source=f"{identity.vendor} {identity.model} {identity.serial_number}".strip(),
            notes=("simulated, not measured data",) if identity.simulated else (),
            attributes={
                **self.instrument.settings(),
                "simulated": "yes" if identity.simulated else "no",
            },
        )

    def _take(self, available: int) -> None:
        first = min(self.done, available - 2)
        portion = self.instrument.recorder.read(first, available - first)
        columns = {
            s.name: np.asarray(portion.channel(s.name).values, dtype=np.float64)[
                self.done - first :
            ]
            for s in self.signals
        }
        if wrong := [n for n, v in columns.items() if v.size != available - self.done]:
            raise ControllerError(
                f"samples {self.done} to {available - 1} of '{wrong[0]}' were requested, and "
                f"{columns[wrong[0]].size} arrived: the samples before them are complete"
            )
        bad = ~np.isfinite(np.array(list(columns.values())))
        good = int(np.argmax(bad.any(axis=0))) if bad.any() else available - self.done
        self._keep({n: v[:good] for n, v in columns.items()}, good)
        if bad.any():
            which = int(np.argmax(bad[:, good]))
            raise ControllerError(self._no_number(self.signals[which], columns, good))
        progress.update("recording", self.done / self.samples)

    def _keep(self, columns: dict[str, Array], count: int) -> None:
        if not count:
            return
        if self.command is not None:
            columns["command"] = np.full(count, self.command)
        self._parts.append(columns)
        at = self.first + self.done
        self.done += count
        if self.writer is not None:
            self.writer.append(at, columns)

    def _no_number(self, signal: Signal, columns: Mapping[str, Array], good: int) -> str:
        where = f"channel {signal.source}" if signal.kind == "channel" else (
            f"the {signal.kind} of axis '{signal.source}'"
        )  # fmt: skip
        at = f"sample {self.done} ({self.done / self.rate:g} s)"
        if signal.kind == "voltage":
            return (
                f"'{signal.name}' ({where}) is unknown from {at}: the stage was stopped, and the "
                f"{self.done} samples before it are valid"
            )
        return (
            f"'{signal.name}' ({where}) reads {columns[signal.name][good]} at {at}: the stage was "
            f"stopped, and the {self.done} samples before it are valid; check the sensor and its "
            "cable"
        )
