"""The data recorder of a PI controller."""

import re
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from flexstage.base.errors import ControllerError, LimitError, ModelError
from flexstage.instruments.pi.axis import PiAxis
from flexstage.instruments.pi.connection import Connection, describe
from flexstage.instruments.pi.replies import parse_array
from flexstage.instruments.protocol import Recorder, Signal
from flexstage.records import Channel, Record

#: Patterns of the record options of a kind of signal, the best first.
_OPTIONS = {
    "position": (r"^(current|real|actual) position of axis", r"^(current|real|actual) position"),
    "target": (r"^(target|commanded) position of axis", r"^(target|commanded) position"),
    "voltage": (r"^control voltage of output", r"^voltage of output", r"voltage"),
    "channel": (r"sensor.*mech\.? ?linear", r"sensor.*elec\.? ?linear", r"sensor"),
    "force": (r"hammer force",),
    "response": (r"response to .*\[m/s\^2\]",),
}
#: Units of signals that are recorded in SI, unless the option names another unit in brackets.
_PLAIN = {"voltage": "V", "force": "N", "response": "m/s^2"}
_BRACKETS = re.compile(r"\[([^]]+)\]")
#: Patterns of the trigger options for a start with a waveform, and immediately.
_WITH_WAVE = (r"wave", r"any c.*chang", r"next command")
_AT_ONCE = (r"immediate",)
#: Relative tolerance of the sample interval.
_RATE_TOLERANCE = 1e-4


@dataclass(frozen=True, slots=True, kw_only=True)
class ChannelFacts:
    """Properties of a sensor."""

    number: int
    """Its number."""
    name: str
    """Its name if the controller reports one; otherwise its number."""
    unit: str
    """SI unit: ``m`` or ``rad``."""
    factor: float
    """SI value of one unit of the controller."""


class PiRecorder(Recorder):
    """Recorder with tables of the controller, each of `capacity` samples.

    The highest rate is that of its loop. No samples are available before the start, even if older
    records exist.
    """

    def __init__(
        self,
        connection: Connection,
        axes: dict[str, PiAxis],
        channels: dict[int, ChannelFacts],
        *,
        base_rate_hz: float,
        capacity: int,
        tables: int,
    ) -> None:
        self._connection, self._axes, self._channels = connection, axes, channels
        self.base_rate_hz, self.capacity, self.signals = base_rate_hz, capacity, tables
        self._signals: tuple[Signal, ...] = ()
        self._factors: tuple[float, ...] = ()
        self._samples, self._rate = 0, base_rate_hz
        self._used = tables
        self._waiting = True

    def configure(self, signals: Sequence[Signal], rate_hz: float, samples: int) -> float:
        if not 1 <= len(signals) <= self.signals:
            raise LimitError(
                f"the recorder has {self.signals} tables, got {len(signals)} signals: record them "
                "in several runs"
            )
        if not 2 <= samples <= self.capacity:
            raise LimitError(
                f"a table of the recorder must have 2 to {self.capacity} samples, got {samples}: "
                "record at a lower rate, or for a shorter time"
            )
        if not 0.0 < rate_hz < float("inf"):
            raise ModelError(f"the rate of a record must be positive and finite, got {rate_hz!r}")
        sources = [self._source(signal) for signal in signals]
        divider = max(1, round(self.base_rate_hz / rate_hz))
        for table, (source, option, _) in enumerate(sources, 1):
            self._connection.tell(f"DRC {table} {source} {option}")
        if 0 in self._connection.profile.record_options:
            # older records of a table, also of other programs, would interfere
            for table in range(len(sources) + 1, self._used + 1):
                self._connection.tell(f"DRC {table} 0 0")
            self._used = len(sources)
        self._connection.divider = None
        self._connection.tell(f"RTR {divider}")
        self._connection.divider = divider
        self._signals, self._factors = tuple(signals), tuple(t[2] for t in sources)
        self._samples, self._rate, self._waiting = samples, self.base_rate_hz / divider, True
        return self._rate

    def arm(self) -> None:
        self._require_choice()
        option = self._connection.profile.trigger_option(*_WITH_WAVE)
        self._waiting = True
        self._connection.tell(f"DRT 0 {1 if option is None else option} 0")

    def start(self) -> None:
        self._require_choice()
        option = self._connection.profile.trigger_option(*_AT_ONCE)
        if option is None:
            raise ModelError(
                "the recorder of this controller cannot be started immediately: it starts with "
                f"{describe(self._connection.profile.trigger_options)}"
            )
        self._connection.tell(f"DRT 0 {option} 0")
        self._waiting = False

    def triggered(self) -> None:
        """Note that the recorder was triggered."""
        self._waiting = False

    def available(self) -> int:
        if self._waiting or not self._signals:
            return 0
        tables = [str(t) for t in range(1, len(self._signals) + 1)]
        counts = self._connection.client.ask_values("DRL?", tables)
        return min(self._samples, int(min(counts)))

    def read(self, first: int, count: int) -> Record:
        if first < 0 or count < 2 or first + count > self._samples:
            raise ModelError(
                f"the record has samples 0 to {self._samples - 1}, of which at least two are read "
                f"at once, got {count} from {first}"
            )
        parts = []
        for start in range(first, first + count, self._connection.transfer.rows):
            rows = min(self._connection.transfer.rows, first + count - start)
            parts.append(self._portion(start, rows))
        values = np.concatenate(parts, axis=1)
        return Record(
            channels=tuple(
                Channel(name=s.name, values=row * factor, unit=s.unit)
                for s, row, factor in zip(self._signals, values, self._factors, strict=True)
            ),
            time=np.arange(first, first + count) / self._rate,
            source=self._connection.client.identity,
        )

    def _portion(self, start: int, rows: int) -> np.ndarray:
        width = len(self._signals)
        tables = " ".join(str(t) for t in range(1, width + 1))
        question = f"DRR? {start + 1} {rows} {tables}"
        lines = self._connection.client.ask(question)
        columns, interval = parse_array(lines, width, rows, question)
        if interval is not None and not abs(interval * self._rate - 1.0) <= _RATE_TOLERANCE:
            self._connection.check_state()
            raise ControllerError(
                f"the sample interval of the recorder was set to {1.0 / self._rate:.6g} s, but the "
                f"record has {interval:.6g} s: this is not the requested record"
            )
        return columns

    def _source(self, signal: Signal) -> tuple[str, int, float]:
        """Return source, option and SI value of one unit of a signal."""
        option = None
        if signal.kind in _OPTIONS:
            option = self._connection.profile.record_option(*_OPTIONS[signal.kind])
        if option is None:
            raise ModelError(
                f"the recorder of this controller cannot record the kind '{signal.kind}': its "
                f"options are {describe(self._connection.profile.record_options)}"
            )
        if signal.kind == "channel":
            channel = self._channel(signal.source)
            source, factor, unit = signal.source, channel.factor, channel.unit
        else:
            axis = self._axis(signal.source)
            unit, factor = "m", axis.facts.unit.factor
            if signal.kind in _PLAIN:
                unit_of_option = _BRACKETS.search(self._connection.profile.record_options[option])
                unit, factor = unit_of_option[1] if unit_of_option else _PLAIN[signal.kind], 1.0
            source = axis.facts.identifier
            if signal.kind == "voltage":
                if axis.facts.output is None:
                    raise ModelError(f"axis '{signal.source}' has no voltage to record")
                source = axis.facts.output
        if signal.unit != unit:
            raise ModelError(
                f"'{signal.name}' is recorded in {unit}, but its signal has {signal.unit!r}"
            )
        return source, option, factor

    def _axis(self, name: str) -> PiAxis:
        if name not in self._axes:
            raise ModelError(
                f"there is no axis '{name}' to record: the axes are "
                f"{', '.join(map(repr, self._axes))}"
            )
        return self._axes[name]

    def _channel(self, text: str) -> ChannelFacts:
        channel = self._channels.get(int(text)) if text.isdecimal() else None
        if channel is None:
            raise ModelError(
                f"there is no sensor '{text}' to record: the sensors are "
                f"{', '.join(map(str, self._channels)) or 'none'}"
            )
        return channel

    def _require_choice(self) -> None:
        if not self._signals:
            raise ModelError("no signals are selected: call configure first")
