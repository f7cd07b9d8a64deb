"""The clockwork of a simulated controller: commands in, samples of stage and recorder out."""

import math
from collections.abc import Callable, Mapping
from typing import Literal

import numpy as np

from flexstage.arrays import Array
from flexstage.errors import ModelError
from flexstage.instruments.pi.simulated.axis_state import AxisState
from flexstage.instruments.pi.simulated.device import AxisDescription, Refusal, RefusedError
from flexstage.instruments.pi.simulated.wave_tables import WaveTables
from flexstage.instruments.protocol import Capability, Signal
from flexstage.stage import Stage
from flexstage.virtual.stage import StageSamples, VirtualStage

#: Samples of the loop that are computed at once.
_BLOCK = 1000
#: Part of a sample by which a time may miss it because seconds are rounded.
_ROUNDING = 1e-6
#: Tables of the wave generator and of the recorder, and their samples.
_TABLES, _SAMPLES = 8, 2**18
#: When a piezo axis has come to its target: within this [m], for this long [s].
_WINDOW, _SETTLE = 20e-9, 5e-3
_PIEZO = frozenset(
    {
        Capability.CLOSED_LOOP,
        Capability.OPEN_LOOP,
        Capability.SERVO_TUNING,
        Capability.FEEDFORWARD_TABLE,
    }
)
_SCREW = frozenset({Capability.CLOSED_LOOP})


class ControllerCore:
    """Axes, tables and recorder of a simulated controller, and the time that passes for them."""

    def __init__(self, stage: VirtualStage) -> None:
        #: The stage in time; its sensors in the order of their numbers; rate of the loop [Hz].
        self.stage, self.channels = stage, stage.channels
        self.sample_rate_hz = float(stage.sample_rate_hz)
        self._states: dict[str, AxisState] = {}
        for index, name in enumerate(stage.axes):
            near = _WINDOW if stage.kind == "piezo" else _smallest_step(stage.stage, name)
            description = AxisDescription(
                name=str(index + 1),
                stage_axis=name,
                kind=stage.kind,
                limits=stage.limits[name],
                capabilities=_PIEZO if stage.kind == "piezo" else _SCREW,
                window=near,
                settle=_SETTLE,
            )
            state = AxisState(description, index, self.sample_rate_hz)
            self._states[description.name] = state
        #: Its axes by identifier.
        self.axes: Mapping[str, AxisDescription] = {
            name: s.description for name, s in self._states.items()
        }
        self._delivered = {
            name: stage.servo_settings(s.description.stage_axis)
            for name, s in self._states.items()
            if not s.screw
        }
        self._tables = WaveTables(_TABLES, _SAMPLES)
        self._recorder = DataRecorder(_TABLES, _SAMPLES)
        self._switch_on()

    @property
    def now(self) -> float:
        """Simulated time of the latest sample since it was switched on [s]; the first is at 0."""
        return self._sample / self.sample_rate_hz

    def advance(self, seconds: float) -> None:
        """Let simulated time [s] pass, rounded to whole samples; the rest is kept."""
        self._owed += duration(seconds) * self.sample_rate_hz
        due = math.floor(self._owed + _ROUNDING)
        self._owed -= due
        while due > 0:
            count = min(due, _BLOCK)
            self._step(count)
            due -= count

    def reboot(self) -> None:
        """Switch off and on: control off, tables and settings as delivered, the stage relaxed."""
        self.stage.reset()
        for name, settings in self._delivered.items():
            self.stage.set_servo_settings(self._states[name].description.stage_axis, settings)
        self._switch_on()

    def _switch_on(self) -> None:
        for state in self._states.values():
            state.reset()
        self._tables.clear()
        self._recorder.clear()
        self._choice: dict[str, tuple[int, int]] = dict.fromkeys(self._states, (0, 0))
        self._cycles = dict.fromkeys(self._states, 1)
        self._divider = 1
        self._drives_out = False
        self._sample = -1
        self._owed = 0.0
        self._readings = np.zeros(len(self.stage.channels))
        # the sample at time 0, so that there is a reading from the beginning
        self._step(1)

    def _step(self, count: int) -> None:
        """Compute the next samples."""
        first = self._sample + 1
        size = len(self._states)
        command, feedforward = np.empty((size, count)), np.empty((size, count))
        for state in self._states.values():
            state.fill(first, command[state.index], feedforward[state.index])
        control = [s.servo and not s.screw for s in self._states.values()]
        block = self.stage.run(
            command, control, None if np.isnan(feedforward).all() else feedforward
        )
        self._sample += count
        for state in self._states.values():
            row = state.index
            source = block.command if state.screw else block.reading
            state.take(self._sample, command[row], source[row])
            state.volts, state.asked = float(block.voltage[row, -1]), float(block.command[row, -1])
        self._readings = block.reading[:, -1]
        self._recorder.take(first, count, lambda signal: self._values(signal, command, block))

    def _values(self, signal: Signal, command: Array, block: StageSamples) -> Array:
        """Return the samples of a block that a signal stands for."""
        if signal.kind == "channel":
            return block.reading[int(signal.source) - 1]
        state = self._states[signal.source]
        if signal.kind == "position":
            return (block.command if state.screw else block.reading)[state.index]
        if signal.kind == "voltage":
            return block.voltage[state.index]
        if state.servo:
            return command[state.index]
        return np.full(command.shape[1], state.target)

    def _axis(self, axis: str) -> AxisState:
        if axis not in self._states:
            raise RefusedError(
                Refusal.UNKNOWN, f"there is no axis '{axis}': they are {', '.join(self._states)}"
            )
        return self._states[axis]

    def _piezo(self, axis: str) -> AxisState:
        state = self._axis(axis)
        if state.screw:
            raise RefusedError(
                Refusal.NOT_ABLE, f"axis '{axis}' is a screw: it has neither voltage nor a servo"
            )
        return state

    def _need_no_wave(self, state: AxisState) -> None:
        if state.wave is not None:
            raise RefusedError(
                Refusal.WAVE_RUNNING,
                f"a waveform runs on axis '{state.description.name}': stop it first",
            )

    def _need_drives(self) -> None:
        if self._drives_out:
            raise RefusedError(
                Refusal.NOT_ABLE, "the drives are taken out: put them back before moving the stage"
            )


def duration(seconds: float) -> float:
    """Return a time [s]; refuse what is none that can pass."""
    if not 0.0 <= seconds < math.inf:
        raise ModelError(f"time passes by 0 s or more, got {seconds!r}")
    return seconds


def _smallest_step(stage: Stage, axis: str) -> float:
    return stage.drive(stage.axis(axis).drive).smallest_displacement or _WINDOW


Trigger = Literal["wave", "move", "now"]


class DataRecorder:
    """Tables that record signals of the loop.

    A recording begins with the sample after its trigger, takes every d-th sample as it is, and goes
    on until the tables are full, also when the waveform that started it has ended. What is read may
    be read while it goes on. A trigger starts one recording: it is armed anew for each.
    """

    def __init__(self, count: int, capacity: int) -> None:
        self.count, self.capacity = count, capacity
        self.clear()

    def clear(self) -> None:
        """Forget what was recorded and what was to be recorded."""
        #: What each table is to record, and samples of the loop for one of a record.
        self.signals: dict[int, Signal] = {}
        self._kept: dict[int, Signal] = {}
        self._data: dict[int, Array] = {}
        self._blow: dict[int, Array] = {}
        self.divider = self._kept_divider = 1
        self._armed: Trigger | None = None
        self._by: Trigger | None = None
        self._first = 0
        self._filled = 0
        self._length = 0

    @property
    def recorded(self) -> int:
        """Samples of each table that are there."""
        return self._filled

    @property
    def recording(self) -> bool:
        """Whether it runs."""
        return self._filled < self._length

    def known(self, table: int) -> int:
        """Return the number of a table, from 1; refuse one that there is not."""
        if not 1 <= table <= self.count:
            raise RefusedError(
                Refusal.UNKNOWN, f"there is no record table {table}: they are 1 to {self.count}"
            )
        return table

    def choose(self, table: int, signal: Signal | None) -> None:
        """Choose what a table records, from the next trigger on."""
        self.signals.pop(self.known(table), None)
        if signal is not None:
            self.signals[table] = signal

    def set_divider(self, divider: int) -> None:
        """Choose the rate, from the next trigger on."""
        if divider < 1:
            raise RefusedError(
                Refusal.BAD_VALUE, f"a record takes every sample or fewer, got a rate of {divider}"
            )
        self.divider = divider

    def arm(self, trigger: Trigger) -> None:
        """Wait for a trigger; a recording that runs is ended."""
        self._length = self._filled
        self._armed = trigger

    def trigger(
        self, what: Trigger, sample: int, blow: Callable[[str, str], Array] | None = None
    ) -> None:
        """Start with this sample of the loop if it was armed for what happens.

        `blow` gives samples of a blow, at the rate of the record, by kind and source of the signal.
        """
        if self._armed != what:
            return
        self._armed, self._by = None, what
        self._first, self._filled = sample, 0
        self._kept, self._kept_divider = dict(self.signals), self.divider
        self._length = self.capacity if self._kept else 0
        self._data = {table: np.zeros(self._length) for table in self._kept}
        self._blow = {}
        if blow is not None:
            given = {table: blow(s.kind, s.source) for table, s in self._kept.items() if _struck(s)}
            self._length = min([self._length, *(v.size for v in given.values())])
            self._blow = given

    def end(self, by: Trigger | None = None) -> None:
        """End a recording that runs; only one that was started by this, where it is given."""
        if by is None or by == self._by:
            self._length = self._filled

    def take(self, first: int, count: int, values: Callable[[Signal], Array]) -> None:
        """Keep what belongs to a recording that runs, of the loop's samples from `first` on."""
        if not self.recording:
            return
        d = self._kept_divider
        start = self._first + self._filled * d - first
        new = min(len(range(start, count, d)), self._length - self._filled)
        if not new:
            return
        to = slice(self._filled, self._filled + new)
        for table, signal in self._kept.items():
            if table in self._blow:
                self._data[table][to] = self._blow[table][to]
            elif not _struck(signal):
                self._data[table][to] = values(signal)[start : start + (new - 1) * d + 1 : d]
        self._filled += new

    def read(self, table: int, first: int, count: int) -> Array:
        """Return samples of a table, from number `first`, counted from 0."""
        if self.known(table) not in self._data:
            raise RefusedError(Refusal.UNKNOWN, f"record table {table} has recorded nothing")
        if first < 0 or count < 0 or first + count > self._filled:
            raise RefusedError(
                Refusal.BAD_VALUE,
                f"{count} samples from number {first} on are not there: {self._filled} are "
                "recorded",
            )
        return self._data[table][first : first + count].copy()


def _struck(signal: Signal) -> bool:
    return signal.kind in ("force", "response")
