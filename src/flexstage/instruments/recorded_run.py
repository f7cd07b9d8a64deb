"""One record, from the choice of its signals to its last sample."""

from collections.abc import Callable, Mapping, Sequence
from contextlib import AbstractContextManager
from typing import Protocol

import numpy as np

from flexstage import progress
from flexstage.arrays import Array
from flexstage.errors import ControllerError, LimitError, ModelError, NotConnectedError
from flexstage.instruments.protocol import Instrument, Signal
from flexstage.records import Channel, Record


class SampleWriter(Protocol):
    """Takes samples as they come."""

    def append(self, first: int, columns: Mapping[str, Array]) -> object:
        """Keep samples of every column."""
        ...


class RecordedRun:
    """One record, from the choice of its signals to its last sample.

    Samples are read while they are recorded; each is looked at, kept, and handed to the writer.
    """

    def __init__(
        self,
        instrument: Instrument,
        signals: Sequence[Signal],
        writer: SampleWriter | None,
        *,
        first: int = 0,
        extra: tuple[str, float] | None = None,
    ) -> None:
        names = [s.name for s in signals] + ([extra[0]] if extra else [])
        if not signals or len(set(names)) != len(names):
            raise ModelError(
                "a record needs one signal or more, each with a name of its own, got "
                f"{', '.join(names) or 'none'}"
            )
        self.instrument, self.signals, self.writer = instrument, tuple(signals), writer
        self.first, self.extra = first, extra
        self.rate, self.samples, self.done = 0.0, 0, 0
        self.notes: list[str] = []
        self._parts: list[dict[str, Array]] = []
        self._waited = 0.0

    def configure(self, rate_hz: float, samples: Callable[[float], int]) -> None:
        """Choose what is recorded, and how much at the rate that the instrument keeps."""
        recorder, rate = self.instrument.recorder, float(rate_hz)
        if not 0.0 < rate < np.inf:
            raise ModelError(f"the rate of a record must be positive and finite, got {rate_hz!r}")
        if len(self.signals) > recorder.signals:
            raise LimitError(
                f"the instrument records {recorder.signals} signals at once, and "
                f"{len(self.signals)} are asked for: record them in several runs"
            )
        for _ in range(2):
            wanted = samples(rate)
            if wanted < 2:
                raise ModelError(f"a record has 2 samples or more, got {wanted}")
            if wanted > recorder.capacity:
                raise LimitError(
                    f"the record would have {wanted} samples, and the instrument keeps "
                    f"{recorder.capacity}: record at {rate * recorder.capacity / wanted:.4g} Hz or "
                    "slower, or for a shorter time"
                )
            self.rate, self.samples = recorder.configure(self.signals, rate, wanted), wanted
            if samples(self.rate) == wanted:
                return
            rate = self.rate

    def stopping(self) -> AbstractContextManager[None]:
        """Stop the instrument when the block fails, and say what is safe when the link fails."""
        return _Stopping(self)

    def read(self, timeout: float | None, until: int | None = None) -> None:
        """Read samples until all of them, or as many as are asked for, are there."""
        recorder = self.instrument.recorder
        goal = self.samples if until is None else until
        expected = (goal - self.done) / self.rate
        most = expected + (10.0 + 0.5 * expected if timeout is None else timeout)
        step = min(max(expected / 50.0, 0.01), 0.25)
        waited = 0.0
        while True:
            there = min(recorder.available(), self.samples)
            # A record has two samples at least: a single one waits for its neighbour.
            if there - self.done >= 2 or (there == self.samples and there > self.done):
                self._take(there)
            if self.done >= goal or (there >= goal and until is not None):
                return
            if waited > most:
                raise ControllerError(
                    f"{self.done} of {self.samples} samples came in {waited:.4g} s, and all should "
                    f"have come in {expected:.4g} s: check that the recorder was started, and its "
                    "rate"
                )
            self.instrument.pause(step)
            waited += step

    def wait(self, busy: Callable[[], bool], what: str, timeout: float | None) -> None:
        """Wait until something has ended."""
        waited, most = 0.0, 10.0 if timeout is None else timeout
        while busy():
            if waited > most:
                raise ControllerError(
                    f"{what} still runs {waited:.4g} s after its record ended: it was stopped"
                )
            self.instrument.pause(0.01)
            waited += 0.01

    def record(self) -> Record:
        """Return all samples."""
        identity = self.instrument.identity
        columns = [(s.name, s.unit) for s in self.signals]
        if self.extra is not None:
            columns.append((self.extra[0], "m"))
        notes = ("simulated: nothing in it was measured",) if identity.simulated else ()
        return Record(
            channels=tuple(
                Channel(name=n, values=np.concatenate([p[n] for p in self._parts]), unit=u)
                for n, u in columns
            ),
            time=np.arange(self.done) / self.rate,
            source=f"{identity.vendor} {identity.model} {identity.serial_number}".strip(),
            notes=(*notes, *self.notes),
            attributes={
                **self.instrument.settings(),
                "simulated": "yes" if identity.simulated else "no",
            },
        )

    def _take(self, there: int) -> None:
        first = min(self.done, there - 2)
        found = self.instrument.recorder.read(first, there - first)
        columns = {
            s.name: np.asarray(found.channel(s.name).values, dtype=np.float64)[self.done - first :]
            for s in self.signals
        }
        if wrong := [n for n, v in columns.items() if v.size != there - self.done]:
            raise ControllerError(
                f"samples {self.done} to {there - 1} of '{wrong[0]}' were asked for, and "
                f"{columns[wrong[0]].size} came: what was read before them is whole"
            )
        bad = ~np.isfinite(np.array(list(columns.values())))
        good = int(np.argmax(bad.any(axis=0))) if bad.any() else there - self.done
        self._keep({n: v[:good] for n, v in columns.items()}, good)
        if bad.any():
            which = int(np.argmax(bad[:, good]))
            raise ControllerError(self._no_number(self.signals[which], columns, good))
        progress.update("recording", self.done / self.samples)

    def _keep(self, columns: dict[str, Array], count: int) -> None:
        if not count:
            return
        if self.extra is not None:
            columns[self.extra[0]] = np.full(count, self.extra[1])
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
                f"'{signal.name}' ({where}) is not known from {at} on: the stage was stopped, and "
                f"the {self.done} samples before it are good"
            )
        return (
            f"'{signal.name}' ({where}) reads {columns[signal.name][good]} at {at}: the stage was "
            f"stopped, the {self.done} samples before it are good; look at the sensor and its cable"
        )


class _Stopping(AbstractContextManager[None]):
    def __init__(self, run: RecordedRun) -> None:
        self._run = run

    def __enter__(self) -> None:
        return None

    def __exit__(self, kind: object, error: BaseException | None, trace: object) -> None:
        if error is None:
            return
        run = self._run
        run.instrument.stop()
        if isinstance(error, NotConnectedError):
            kept = "were read and not kept" if run.writer is None else "are safe with the writer"
            of = f", of {run.first + run.samples}" if run.samples else ""
            raise NotConnectedError(
                f"{error}; {run.first + run.done} samples {kept}{of}"
            ) from error
