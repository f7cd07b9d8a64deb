"""Core of a simulated controller: time steps of axes, stage, tables and recorder."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np

from flexstage.base.arrays import Array
from flexstage.base.errors import ModelError
from flexstage.base.version import __version__
from flexstage.instruments.pi.simulated.axis_state import AxisState
from flexstage.instruments.pi.simulated.device import (
    AxisDescription,
    Refusal,
    require,
)
from flexstage.instruments.pi.simulated.tables import (
    DataRecorder,
    Trigger,
    WaveRun,
    WaveTables,
    resampled,
)
from flexstage.instruments.protocol import Capability, Identity, Signal
from flexstage.stage import Stage
from flexstage.virtual.stage import StageSamples, VirtualStage

_KINDS = ("position", "target", "error", "voltage", "channel", "force", "response")
#: Number of samples of the loop that are computed at once.
_BLOCK = 1000
#: Tolerance of rounded times, in samples.
_ROUNDING = 1e-6
#: Numbers of tables of wave generator and recorder, and of their samples.
_TABLES, _SAMPLES = 8, 2**18
#: On-target window [m] and settling time [s] of a piezo axis.
_WINDOW, _SETTLE = 20e-9, 5e-3
#: Voltage of the zero above the lowest voltage, over the range, so that control has a reserve of
#: voltage at the low end.
_ZERO_SHARE = 0.05
#: Duration of each move of the zeroing, and of the dwell after them [s].
_WAY, _REST = 0.1, 0.2
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
    """Axes, tables, recorder and hammer of a simulated controller, with simulated time."""

    def __init__(
        self,
        stage: VirtualStage,
        *,
        serial_number: str = "",
        names: Sequence[str] = (),
        zero_at_start: bool = True,
    ) -> None:
        #: The simulated stage; its sensors in the order of their numbers; rate of the loop [Hz].
        self.stage, self.channels = stage, stage.channels
        self.sample_rate_hz = float(stage.sample_rate_hz)
        self._states: dict[str, AxisState] = {}
        self._zero_at_start = zero_at_start
        for index, name in enumerate(stage.axes):
            near = _WINDOW if stage.kind == "piezo" else _smallest_step(stage.stage, name)
            description = AxisDescription(
                name=names[index] if index < len(names) else str(index + 1),
                stage_axis=name,
                kind=stage.kind,
                limits=stage.limits[name],
                capabilities=_PIEZO if stage.kind == "piezo" else _SCREW,
                window=near,
                settle=_SETTLE,
            )
            state = AxisState(description, index, self.sample_rate_hz)
            self._states[description.name] = state
        self._delivered = {
            name: stage.servo_settings(s.description.stage_axis)
            for name, s in self._states.items()
            if not s.screw
        }
        #: Its identity, which states that it is simulated.
        self.identity = Identity(
            vendor="flexstage",
            model=f"simulated {stage.stage.name}",
            serial_number=serial_number,
            firmware=__version__,
            simulated=True,
        )
        #: Its tables of waveforms, and of records.
        self.tables = WaveTables(_TABLES, _SAMPLES)
        self.recorder = DataRecorder(_TABLES, _SAMPLES)
        self._switch_on()
        for state in self._states.values():
            low, high = state.description.limits.position or (0.0, 0.0)
            zero = self._zero[state.index]
            if zero:
                limits = replace(state.description.limits, position=(low - zero, high - zero))
                state.description = replace(state.description, limits=limits)
        #: Its axes by identifier.
        self.axes: Mapping[str, AxisDescription] = {
            name: s.description for name, s in self._states.items()
        }

    @property
    def now(self) -> float:
        """Simulated time of the latest sample since power-on [s]; the first is at 0."""
        return self._sample / self.sample_rate_hz

    def advance(self, seconds: float) -> None:
        """Let simulated time [s] pass, rounded to complete samples; the remainder is kept."""
        self._owed += duration(seconds) * self.sample_rate_hz
        due = math.floor(self._owed + _ROUNDING)
        self._owed -= due
        while due > 0:
            ends = [run.first - 1 + run.table.size for run in self._zeroing.values()]
            count = min(due, _BLOCK, *(end - self._sample for end in ends))
            self._step(count)
            due -= count

    def reboot(self) -> None:
        """Restart: control off, tables, settings and zero as delivered."""
        self.stage.reset()
        for name, settings in self._delivered.items():
            self.stage.set_servo_settings(self._states[name].description.stage_axis, settings)
        self._switch_on()

    def _switch_on(self) -> None:
        for state in self._states.values():
            state.reset()
        self.tables.clear()
        self.recorder.clear()
        self._choice: dict[str, tuple[int, int]] = dict.fromkeys(self._states, (0, 0))
        self._cycles = dict.fromkeys(self._states, 1)
        #: Samples of the loop for one of a table; whether the drives are removed, for impacts.
        self.wave_divider = 1
        self.drives_out = False
        self._sample = -1
        self._owed = 0.0
        self._readings = np.zeros(len(self.stage.channels))
        #: Zero of each sensor in stage coordinates [m, or rad]; axes whose zero is being set.
        self._zero = np.zeros(len(self.stage.channels))
        self._zeroing: dict[AxisState, WaveRun] = {}
        # the sample at time 0, so that there is a reading from the start
        self._step(1)
        known = [s for s in self._states.values() if not s.screw and s.description.limits.position]
        if self._zero_at_start and known:
            self._begin_zero(dict.fromkeys(known))
            while self._zeroing:
                self.advance(_REST)
            self._sample, self._owed = 0, 0.0

    def _begin_zero(self, voltages: Mapping[AxisState, float | None]) -> None:
        """Move through the full range in open loop, and then to the voltage of the zero [V].

        The moves do not depend on the history, so that the zero is reproducible, except for creep.
        """
        for state, voltage in voltages.items():
            low, high = state.description.limits.voltage or (0.0, 0.0)
            end = low + _ZERO_SHARE * (high - low) if voltage is None else voltage
            size = max(_WAY, 2.0 * (high - low) / state.largest_slew) * self.sample_rate_hz
            rise = 0.5 - 0.5 * np.cos(np.pi * np.arange(1, math.ceil(size) + 1) / math.ceil(size))
            places = (state.present(self._sample), high, low, end)
            ways = [a + (b - a) * rise for a, b in pairwise(places)]
            rest = np.full(math.ceil(_REST * self.sample_rate_hz), end)
            run = WaveRun(
                first=self._sample + 1, table=np.concatenate((*ways, rest)), divider=1, cycles=1
            )
            state.run(run, self._sample)
            self._zeroing[state] = run

    def set_record_signal(self, table: int, signal: Signal | None) -> None:
        """Select the signal of a table, from the next record; None for none.

        The `source` of a signal is the identifier of an axis or the number of a channel.
        """
        self.recorder.known(table)
        if signal is not None:
            self._require_signal(signal)
        self.recorder.choose(table, signal)

    def arm_recorder(self, trigger: Trigger) -> None:
        """Arm the recorder for the next waveform or impact, the next move, or start it now.

        The previous record can be read until then.
        """
        require(trigger in ("wave", "move", "now"), Refusal.BAD_VALUE)
        self.recorder.arm(trigger)
        if trigger == "now":
            self.recorder.trigger("now", self._sample + 1)

    def remove_drives(self, removed: bool) -> None:
        """Remove the drives, or install them; no axis may move or be under control."""
        for state in self._states.values():
            require(
                not state.moving(self._sample),
                Refusal.NOT_ABLE if state.wave is None else Refusal.WAVE_RUNNING,
            )
            require(state.screw or not state.servo, Refusal.SERVO_ON)
        self.drives_out = bool(removed)

    def strike(self, axis: str) -> None:
        """Excite the stage with a hammer; a recorder armed for a waveform records the impact.

        The record starts shortly before the impact. Force and response have their own rate and are
        resampled to that of the record, unchanged within their band and without content above half
        of the lower rate. They arrive as simulated time passes. The response is along the excited
        axis; that of other axes is zero.
        """
        state = self._axis(axis)
        require(self.drives_out, Refusal.NOT_ABLE)
        impact = self.stage.strike(state.description.stage_axis)
        rate = self.sample_rate_hz / self.recorder.divider
        force = resampled(impact.force, impact.sample_rate_hz, rate)
        response = resampled(impact.response, impact.sample_rate_hz, rate)

        def samples(kind: str, source: str) -> Array:
            if kind == "force":
                return force
            return response if source == axis else np.zeros_like(response)

        self.recorder.trigger("wave", self._sample + 1, samples)

    def _step(self, count: int) -> None:
        """Compute the next samples."""
        first = self._sample + 1
        size = len(self._states)
        command, feedforward = np.empty((size, count)), np.empty((size, count))
        for state in self._states.values():
            state.fill(first, command[state.index], feedforward[state.index])
        control = [s.servo and not s.screw for s in self._states.values()]
        targets = command + np.where(control, self._zero[:size], 0.0)[:, None]
        block = self.stage.run(
            targets, control, None if np.isnan(feedforward).all() else feedforward
        )
        block.reading[:] -= self._zero[:, None]
        self._sample += count
        for state in self._states.values():
            row = state.index
            source = block.command if state.screw else block.reading
            state.take(self._sample, command[row], source[row])
            state.volts = float(block.voltage[row, -1])
            state.amplifier_input = float(block.command[row, -1])
        self._readings = block.reading[:, -1]
        self.recorder.take(first, count, lambda signal: self._values(signal, command, block))
        for state, run in list(self._zeroing.items()):
            if state.wave is not run:
                self._zero[state.index] += self._readings[state.index]
                del self._zeroing[state]

    def _values(self, signal: Signal, command: Array, block: StageSamples) -> Array:
        """Return the samples of a signal in a block."""
        if signal.kind == "channel":
            return block.reading[int(signal.source) - 1]
        state = self._states[signal.source]
        if signal.kind == "position":
            return (block.command if state.screw else block.reading)[state.index]
        if signal.kind == "voltage":
            return block.voltage[state.index]
        target = command[state.index] if state.servo else np.full(command.shape[1], state.target)
        if signal.kind == "error":
            return target - (block.command if state.screw else block.reading)[state.index]
        return target

    def _require_signal(self, signal: Signal) -> None:
        require(signal.kind in _KINDS, Refusal.UNKNOWN)
        if signal.kind == "channel":
            numbers = {str(c.number) for c in self.stage.channels}
            require(signal.source in numbers, Refusal.UNKNOWN)
        elif signal.kind == "voltage":
            self._piezo(signal.source)
        else:
            self._axis(signal.source)

    def _axis(self, axis: str) -> AxisState:
        require(axis in self._states, Refusal.UNKNOWN)
        return self._states[axis]

    def _piezo(self, axis: str) -> AxisState:
        state = self._axis(axis)
        require(not state.screw, Refusal.NOT_ABLE)
        return state

    def _need_no_wave(self, state: AxisState) -> None:
        require(state.wave is None, Refusal.WAVE_RUNNING)

    def _need_drives(self) -> None:
        require(not self.drives_out, Refusal.NOT_ABLE)


def duration(seconds: float) -> float:
    """Return a time [s]; refuse negative and infinite ones."""
    if not 0.0 <= seconds < math.inf:
        raise ModelError(f"time can advance by 0 s or more, got {seconds!r}")
    return seconds


def _smallest_step(stage: Stage, axis: str) -> float:
    return stage.drive_of(axis).smallest_displacement or _WINDOW
