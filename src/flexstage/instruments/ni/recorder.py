"""The recorder of a card: all its sensors at one clock, and the voltages of the drives."""

import math
from collections.abc import Callable, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from flexstage.base.arrays import Array
from flexstage.base.errors import ControllerError, ModelError
from flexstage.instruments.ni.setup import CardInfo, InputTask, NiBackend, NiSetup
from flexstage.instruments.protocol import Recorder, Signal
from flexstage.records import Channel, Record

Numbers = NDArray[np.int64]

_SIGNALS, _CAPACITY = 64, 20_000_000
_BUFFER_TIME = 10.0  # duration of the driver's buffer [s]


class NiRecorder(Recorder):
    """Recorder of sensors and voltages of a card.

    With drives, the card samples at a multiple of the requested rate, so that the outputs, which
    share the clock, have a sufficient update rate; the additional samples are dropped without a
    filter.
    """

    def __init__(self, backend: NiBackend, setup: NiSetup, card: CardInfo) -> None:
        self._backend, self._setup, self._card = backend, setup, card
        #: Whether outputs use the clock of the record, which must not stop then.
        self.busy: Callable[[], bool] = lambda: False
        self.base_rate_hz = card.largest_rate_hz(len(setup.inputs))
        self.capacity, self.signals = _CAPACITY // len(setup.inputs), _SIGNALS
        self._signals: tuple[Signal, ...] = ()
        self._rate, self._divider, self._samples = setup.output_rate_hz, 1, 0
        self._task: InputTask | None = None
        self._started = False
        self._ticks = 0  # samples read, at the rate of the clock
        self._parts: list[Array] = []
        self._latest: Array | None = None
        self._standing = {d.axis: np.array([d.begins_at]) for d in setup.outputs}
        self._voltages: dict[str, list[tuple[int, Array]]] = {}
        usual = setup.output_rate_hz
        if setup.outputs:
            self._require_rate(usual)
        #: Time between the conversions of successive sensors [s], as for `InputTask`.
        self.interval = self._actual_timing(min(usual, self.base_rate_hz))[1]

    def configure(self, signals: Sequence[Signal], rate_hz: float, samples: int) -> float:
        for signal in signals:
            self._source(signal)
        if not 1 <= samples <= self.capacity:
            raise ModelError(f"a record must have 1 to {self.capacity} samples, got {samples}")
        self._require_rate(rate_hz)
        self.release()
        changes = self._setup.output_rate_hz if self._setup.outputs else rate_hz
        divider = max(math.ceil(changes / rate_hz * (1.0 - 1e-9)), 1)
        divider = max(min(divider, math.floor(self.base_rate_hz / rate_hz)), 1)
        clock_rate, self.interval = self._actual_timing(rate_hz * divider)
        self._signals, self._samples, self._divider = tuple(signals), samples, divider
        self._rate = clock_rate / divider
        return self._rate

    def arm(self) -> None:
        self._open()

    def start(self) -> None:
        self._open().start()
        self._started = True

    def available(self) -> int:
        self.drain()
        self.rest()
        return min(-(-self._ticks // self._divider), self._samples)

    def read(self, first: int, count: int) -> Record:
        if first < 0 or count < 2 or first + count > self.available():
            raise ModelError(
                f"samples {first} to {first + count - 1} were requested, at least 2, and "
                f"{self.available()} are available"
            )
        k = np.arange(first, first + count, dtype=np.int64)
        volts = self._samples_at(first, count)
        return Record(
            channels=tuple(
                Channel(name=s.name, values=self._values(s, volts, k), unit=self._unit(s))
                for s in self._signals
            ),
            time=k / self._rate,
            source=f"NI card {self._setup.device}",
            notes=(self._card.note,) if self._card.simulated else (),
        )

    # with the outputs -----------------------------------------------------------------------------

    def clock(self) -> tuple[InputTask, bool] | None:
        """Return the clock of an armed or running record, and whether it has started."""
        if self._task is None:
            return None
        return self._task, self._started

    def note_voltages(self, voltages: Mapping[str, Array], first: bool) -> None:
        """Note the voltages by axis [V], shape (n,), that are output from now on.

        They use the clock of the record; with `first`, the record starts with them.
        """
        self._standing.update({axis: values[-1:] for axis, values in voltages.items()})
        if self._task is None:
            return
        if first:
            self._started = True
        tick = 0 if first else self._now()
        for axis, values in voltages.items():
            self._voltages.setdefault(axis, []).append((tick, values))

    def drain(self) -> None:
        """Read the driver's buffer, so that it does not overflow."""
        task = self._task  # another thread may end the record
        if task is None or not self._started or (count := task.available()) == 0:
            return
        samples = task.read(count)
        self._latest = samples[:, -1]
        lead = -self._ticks % self._divider
        self._ticks += samples.shape[1]
        if self._size < self._samples:
            self._parts.append(samples[:, lead :: self._divider])

    def rest(self) -> None:
        """Release the inputs when the record is complete and no output needs their clock."""
        if self._task is not None and self._started and self.full and not self.busy():
            self.release()

    def latest(self) -> Array | None:
        """Return the latest voltages of the inputs during a record [V], shape (channels,)."""
        if self._task is None or not self._started:
            return None
        self.drain()
        return self._latest

    def release(self) -> None:
        """Stop the clock and release the inputs; recorded samples can still be read."""
        task, self._task = self._task, None
        self._started = False
        if task is not None:
            task.close()

    @property
    def full(self) -> bool:
        """Whether the record is complete."""
        return self._size >= self._samples

    @property
    def _size(self) -> int:
        return sum(p.shape[1] for p in self._parts)

    def _now(self) -> int:
        if self._task is None or not self._started:
            return 0
        return self._ticks + self._task.available()

    def _require_rate(self, rate_hz: float) -> None:
        if not 0.0 < rate_hz <= self.base_rate_hz:
            raise ModelError(
                f"card '{self._setup.device}' ({self._card.model}) samples at up to "
                f"{self._card.rate_limit(len(self._setup.inputs))}, got {rate_hz!r} Hz"
            )

    def _actual_timing(self, rate_hz: float) -> tuple[float, float]:
        """Return the actual rate and interval of conversions for a requested rate."""
        task = self._backend.open_input(self._setup.inputs, rate_hz, 1000)
        try:
            return task.rate_hz, task.interval
        finally:
            task.close()

    def _open(self) -> InputTask:
        if not self._signals:
            raise ControllerError("no signals are selected: configure the recorder first")
        self.release()
        self._parts, self._ticks, self._latest = [], 0, None
        self._voltages = {axis: [(0, value)] for axis, value in self._standing.items()}
        rate = self._rate * self._divider
        self._task = self._backend.open_input(
            self._setup.inputs, rate, max(round(_BUFFER_TIME * rate), 1000)
        )
        return self._task

    def _samples_at(self, first: int, count: int) -> Array:
        if len(self._parts) > 1:
            self._parts = [np.hstack(self._parts)]
        return self._parts[0][:, first : first + count]

    def _values(self, signal: Signal, volts: Array, k: Numbers) -> Array:
        if signal.kind == "voltage":
            return self._voltages_at(signal.source, k * self._divider)
        number = self._source(signal)
        return self._setup.inputs[number - 1].reading(volts[number - 1])

    def _voltages_at(self, axis: str, ticks: Numbers) -> Array:
        out = np.empty(ticks.size)
        for tick, values in self._voltages[axis]:  # the first one starts at 0
            later = ticks >= tick
            out[later] = values[np.minimum(ticks[later] - tick, values.size - 1)]
        return out

    def _source(self, signal: Signal) -> int:
        """Return the number of the sensor of a signal; 0 for a voltage."""
        drives = {d.axis: d for d in self._setup.outputs}
        if signal.kind in ("position", "voltage") and signal.source in drives:
            if signal.kind == "voltage":
                return 0
            return self._setup.number(drives[signal.source].sensor)
        if signal.kind == "channel" and signal.source.isdecimal():
            number = int(signal.source)
            if 1 <= number <= len(self._setup.inputs):
                return number
        raise ModelError(
            f"card '{self._setup.device}' records 'position' and 'voltage' of "
            f"{', '.join(map(repr, drives)) or 'no axis'} and 'channel' 1 to "
            f"{len(self._setup.inputs)}, got '{signal.kind}' of '{signal.source}'"
        )

    def _unit(self, signal: Signal) -> str:
        number = self._source(signal)
        return self._setup.inputs[number - 1].unit if number else "V"
