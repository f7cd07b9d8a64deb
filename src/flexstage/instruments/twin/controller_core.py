"""The clockwork of a simulated controller: commands in, a stage's samples out, block by block."""

import math
from collections.abc import Mapping, Sequence

import numpy as np

from flexstage.arrays import Array
from flexstage.instruments.protocol import Capability, Signal
from flexstage.instruments.twin.axis_state import AxisState
from flexstage.instruments.twin.data_recorder import DataRecorder
from flexstage.instruments.twin.device import (
    AxisDescription,
    ChannelDescription,
    Refusal,
    RefusedError,
)
from flexstage.instruments.twin.stage import StageSamples, VirtualStage
from flexstage.instruments.twin.time_source import duration
from flexstage.instruments.twin.wave_tables import WaveTables
from flexstage.stage import Stage

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

    def __init__(
        self, stage: VirtualStage, *, window: float = _WINDOW, settle: float = _SETTLE
    ) -> None:
        self._stage = stage
        self._rate = float(stage.sample_rate_hz)
        self._states: dict[str, AxisState] = {}
        for index, name in enumerate(stage.axes):
            near = window if stage.kind == "piezo" else _smallest_step(stage.stage, name)
            description = AxisDescription(
                name=str(index + 1),
                stage_axis=name,
                kind=stage.kind,
                limits=stage.limits[name],
                capabilities=_PIEZO if stage.kind == "piezo" else _SCREW,
                window=near,
                settle=settle,
            )
            state = AxisState(description, index, self._rate)
            self._states[description.name] = state
        self._descriptions = {name: s.description for name, s in self._states.items()}
        self._delivered = {
            name: stage.servo_settings(s.description.stage_axis)
            for name, s in self._states.items()
            if not s.screw
        }
        self._tables = WaveTables(_TABLES, _SAMPLES)
        self._recorder = DataRecorder(_TABLES, _SAMPLES)
        self._switch_on()

    @property
    def stage(self) -> VirtualStage:
        """The stage in time."""
        return self._stage

    @property
    def axes(self) -> Mapping[str, AxisDescription]:
        """Its axes by identifier."""
        return self._descriptions

    @property
    def channels(self) -> Sequence[ChannelDescription]:
        """Its sensors, in the order of their numbers."""
        return self._stage.channels

    @property
    def sample_rate_hz(self) -> float:
        """Rate of its loop [Hz]."""
        return self._rate

    @property
    def now(self) -> float:
        """Simulated time of the latest sample since it was switched on [s]; the first is at 0."""
        return self._sample / self._rate

    def advance(self, seconds: float) -> None:
        """Let simulated time [s] pass, rounded to whole samples; the rest is kept."""
        self._owed += duration(seconds) * self._rate
        due = math.floor(self._owed + _ROUNDING)
        self._owed -= due
        while due > 0:
            count = min(due, _BLOCK)
            self._step(count)
            due -= count

    def reboot(self) -> None:
        """Switch off and on: control off, tables and settings as delivered, the stage relaxed."""
        self._stage.reset()
        for name, settings in self._delivered.items():
            self._stage.set_servo_settings(self._states[name].description.stage_axis, settings)
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
        self._readings = np.zeros(len(self._stage.channels))
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
        block = self._stage.run(
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


def _smallest_step(stage: Stage, axis: str) -> float:
    return stage.drive(stage.axis(axis).drive).smallest_displacement or _WINDOW
