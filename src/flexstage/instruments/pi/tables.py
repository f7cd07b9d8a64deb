"""The tables of a PI controller: its wave generator and its data recorder."""

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from flexstage.base.errors import ControllerError, LimitError, ModelError
from flexstage.instruments.limits import check_feedforward, check_waveform, range_of
from flexstage.instruments.pi.axis import PiAxis
from flexstage.instruments.pi.connection import Connection, describe, first_matching
from flexstage.instruments.pi.replies import VOLTS, WireUnit, parse_array
from flexstage.instruments.protocol import Capability, Recorder, Signal, Waveform, WaveGenerator
from flexstage.records import Channel, Record
from flexstage.stage.limits import AxisLimits

#: Number of samples that are read back at each checked position.
_LOOK = 3
#: Tolerance of the present value at the first sample, in addition to the slew, over the range.
_START = 1e-3
#: Tolerance of a sample that was read back, in steps of the transmitted digits.
_STEPS = 2.0
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
class _Table:
    """One transmitted table."""

    number: int
    axis: str
    texts: list[str]
    unit: WireUnit


class PiWaves(WaveGenerator):
    """Generator of waveforms from tables of points.

    Axis number i of the controller uses table i, and its feedforward table number of axes + i. The
    tables are written point by point. A few points are read back before any motion, which reveals a
    controller with other units. The highest rate is that of the loop; `capacity` is the number of
    samples of all tables. `on_start` is called when a waveform starts.
    """

    def __init__(
        self,
        connection: Connection,
        axes: Mapping[str, PiAxis],
        *,
        base_rate_hz: float,
        capacity: int,
        tables: int,
        on_start: Callable[[], None],
    ) -> None:
        self._connection, self._axes = connection, axes
        self.base_rate_hz, self.capacity, self._tables = base_rate_hz, capacity, tables
        self._on_start = on_start
        self._feedforward = connection.profile.parameter(r"feed-?forward wave table")
        self._loaded: Waveform | None = None
        self._sent: tuple[_Table, ...] = ()

    def load(self, waveform: Waveform, *, feedforward: Waveform | None = None) -> None:
        self._check(waveform, feedforward)
        divider = self._divider(waveform.sample_rate_hz)
        tables = self._tables_of(waveform, 0)
        if feedforward is not None:
            tables += self._tables_of(feedforward, self._count)
        self._loaded, self._sent = None, ()
        self._connection.tell(f"WTR 0 {divider} 1")
        if self._connection.profile.knows("WOS"):
            # a generator may have an offset of an earlier program
            ids = [str(self._index(name) + 1) for name in waveform.values]
            self._connection.tell("WOS " + " ".join(f"{g} 0" for g in ids))
        for table in tables:
            for line in point_lines(
                table.number, table.texts, self._connection.transfer.line_limit
            ):
                self._connection.tell(line)
        for table in tables:
            self._read_back(table)
        self._choose(waveform, feedforward)
        self._loaded, self._sent = waveform, tables

    def start(self, cycles: int = 1) -> None:
        waveform = self._loaded
        if waveform is None:
            raise ControllerError("no waveform was loaded: load one before the start")
        self._connection.check_state()
        check_waveform(self._limits, waveform, cycles=cycles)
        for name in waveform.values:
            self._check_start(waveform, name)
        generators = [str(self._index(name) + 1) for name in waveform.values]
        stops = self._connection.client.stops
        self._connection.restore_drives()
        self._connection.tell("WGC " + " ".join(f"{g} {cycles}" for g in generators))
        for name in waveform.values:
            self._axes[name].started()
        self._connection.tell("WGO " + " ".join(f"{g} 1" for g in generators))
        if self._connection.client.stops != stops:
            # a stop before the start of the generators has not ended them
            self._connection.client.stop()
            raise ControllerError("the waveform was stopped at its start", 10)
        self._on_start()

    def running(self) -> bool:
        if self._connection.profile.knows("#9"):
            return bool(self._connection.client.ask_whole("\x09", base=16))
        names = [str(i + 1) for i in range(self._count)]
        return any(int(v) & 1 for v in self._connection.client.ask_values("WGO?", names))

    def stop(self) -> None:
        names = self._axes if self._loaded is None else self._loaded.values
        self._connection.tell("WGO " + " ".join(f"{self._index(name) + 1} 0" for name in names))

    @property
    def _limits(self) -> dict[str, AxisLimits]:
        return {name: axis.limits for name, axis in self._axes.items()}

    @property
    def _count(self) -> int:
        return 1 + max(axis.facts.index for axis in self._axes.values())

    def _index(self, name: str) -> int:
        return self._axes[name].facts.index

    def _check(self, waveform: Waveform, feedforward: Waveform | None) -> None:
        check_waveform(self._limits, waveform)
        needed = waveform.size * len(waveform.values)
        if feedforward is not None:
            check_feedforward(self._limits, waveform, feedforward)
            if self._feedforward is None or 2 * self._count > self._tables:
                raise ModelError(
                    "this controller cannot add voltages under position control: run the positions "
                    "alone, or the voltages in open loop"
                )
            if (
                feedforward.size != waveform.size
                or feedforward.sample_rate_hz != waveform.sample_rate_hz
                or not set(feedforward.values) <= set(waveform.values)
            ):
                raise ModelError(
                    "a feedforward needs the number of samples and the rate of its waveform, and "
                    "no other axes"
                )
            needed += feedforward.size * len(feedforward.values)
        if needed > self.capacity:
            raise LimitError(
                f"the wave tables have {self.capacity} samples, and the waveform needs {needed}: "
                "use a lower rate or a shorter waveform"
            )

    def _divider(self, rate_hz: float) -> int:
        divider = round(self.base_rate_hz / rate_hz)
        if divider < 1 or abs(self.base_rate_hz / divider - rate_hz) > 1e-9 * rate_hz:
            nearest = self.base_rate_hz / max(divider, 1)
            raise ModelError(
                f"the rate of a waveform must be an integer fraction of {self.base_rate_hz:g} Hz, "
                f"got {rate_hz:.9g} Hz: the nearest is {nearest:.9g} Hz"
            )
        return divider

    def _tables_of(self, waveform: Waveform, offset: int) -> tuple[_Table, ...]:
        tables = []
        for name, values in waveform.values.items():
            axis = self._axes[name]
            voltage = waveform.quantity == "voltage"
            unit = VOLTS if voltage else axis.facts.unit
            bounds = range_of(axis.limits, waveform.quantity)
            tables.append(
                _Table(
                    number=offset + axis.facts.index + 1,
                    axis=name,
                    texts=unit.texts(values, bounds),
                    unit=unit,
                )
            )
        return tuple(tables)

    def _choose(self, waveform: Waveform, feedforward: Waveform | None) -> None:
        places = {name: self._index(name) + 1 for name in waveform.values}
        self._connection.tell("WSL " + " ".join(f"{i} {i}" for i in places.values()))
        if self._feedforward is None:
            return
        with_it = () if feedforward is None else feedforward.values
        for name, place in places.items():
            # a screw accepts no voltages, and no selection of their table
            if Capability.FEEDFORWARD_TABLE not in self._axes[name].capabilities:
                continue
            table = self._count + place if name in with_it else 0
            identifier = self._axes[name].facts.identifier
            self._connection.tell(f"SPA {identifier} 0x{self._feedforward:08X} {table}")

    def _read_back(self, table: _Table) -> None:
        """Compare start, extreme and end of a table with the transmitted values."""
        if not self._connection.profile.knows("GWD?"):
            return
        sent = np.array([float(text) for text in table.texts])
        places = {0, int(np.argmax(np.abs(sent))), sent.size - 1}
        for place in sorted({min(p, max(sent.size - _LOOK, 0)) for p in places}):
            rows = min(_LOOK, sent.size - place)
            question = f"GWD? {place + 1} {rows} {table.number}"
            lines = self._connection.client.ask(question)
            read = parse_array(lines, 1, rows, question)[0][0]
            written = sent[place : place + rows]
            # the controller may print ten digits, or have single precision
            allowed = _STEPS * 10.0**-table.unit.decimals + 1e-6 * float(np.max(np.abs(sent)))
            if not np.all(np.abs(read - written) <= allowed):
                k = int(np.argmax(~(np.abs(read - written) <= allowed)))
                self._forget(table.number)
                raise ControllerError(
                    f"wave table {table.number} of axis '{table.axis}' contains {read[k]:.9g} at "
                    f"point {place + k + 1}, where {written[k]:.9g} was written: the controller "
                    "uses other units or changed the points, so the waveform is not run"
                )

    def _forget(self, table: int) -> None:
        if self._connection.profile.knows("WCL"):
            self._connection.tell(f"WCL {table}")

    def _check_start(self, waveform: Waveform, name: str) -> None:
        axis = self._axes[name]
        closed, voltage = axis.closed_loop, waveform.quantity == "voltage"
        if closed == voltage:
            raise ControllerError(
                f"the position control of axis '{name}' is {'on' if closed else 'off'}, and the "
                f"waveform consists of {'voltages' if voltage else 'positions'}: switch the "
                f"control {'off' if voltage else 'on'} first"
            )
        bounds = range_of(axis.limits, waveform.quantity)
        span = 0.0 if bounds is None else bounds[1] - bounds[0]
        here = axis.voltage() if voltage else self._target(axis)
        # the step from end to start was checked before; this checks the first step
        one = Waveform(
            values={name: waveform.values[name]},
            sample_rate_hz=waveform.sample_rate_hz,
            quantity=waveform.quantity,
        )
        check_waveform(self._limits, one, start={name: here}, tolerance=_START * span)

    def _target(self, axis: PiAxis) -> float:
        if not self._connection.profile.knows("MOV?"):
            return axis.position()
        value = self._connection.client.ask_values("MOV?", [axis.facts.identifier])[0]
        return value * axis.facts.unit.factor


def point_lines(table: int, texts: Sequence[str], limit: int) -> list[str]:
    """Return the commands, of `limit` characters at most, that write points to a table.

    The first replaces what is in the table, the others append.

    Examples
    --------
    >>> point_lines(2, ["0.5", "1.25", "2"], 24)
    ['WAV 2 X PNT 1 2 0.5 1.25', 'WAV 2 & PNT 3 1 2']
    """
    lines: list[str] = []
    begin = 0
    while begin < len(texts):
        head = len(f"WAV {table} X PNT {begin + 1} {len(texts)}")
        end = begin
        size = head
        while end < len(texts) and (end == begin or size + 1 + len(texts[end]) <= limit):
            size += 1 + len(texts[end])
            end += 1
        how = "&" if begin else "X"
        points = " ".join(texts[begin:end])
        lines.append(f"WAV {table} {how} PNT {begin + 1} {end - begin} {points}")
        begin = end
    return lines


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
        axes: Mapping[str, PiAxis],
        channels: Mapping[int, ChannelFacts],
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
        option = first_matching(self._connection.profile.trigger_options, *_WITH_WAVE)
        self._waiting = True
        self._connection.tell(f"DRT 0 {1 if option is None else option} 0")

    def start(self) -> None:
        self._require_choice()
        option = first_matching(self._connection.profile.trigger_options, *_AT_ONCE)
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
            option = first_matching(self._connection.profile.record_options, *_OPTIONS[signal.kind])
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
