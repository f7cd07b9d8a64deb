"""A simulated controller with its stage, in simulated time: motion of its axes."""

from collections.abc import Callable, Collection, Mapping, Sequence
from types import MappingProxyType

import numpy as np

from flexstage.base.arrays import Array
from flexstage.base.errors import ModelError
from flexstage.instruments.pi.simulated.axis_state import (
    AxisState,
    check_feedforward,
    check_wave,
    require_within,
)
from flexstage.instruments.pi.simulated.controller_core import ControllerCore
from flexstage.instruments.pi.simulated.device import Refusal, RefusedError, require
from flexstage.instruments.pi.simulated.tables import WaveRun
from flexstage.system.servo import ServoSettings

#: Relative tolerance of a speed limit for rounded texts.
_ROUNDING = 1e-6


class VirtualController(ControllerCore):
    """A controller of a simulated stage: axes, control, waveforms and a recorder.

    All values are SI, in simulated time. The axes are ``1``, ``2`` ... in the order of those of the
    stage; tables, channels and records are numbered from 1. Time passes only by `advance`; samples
    do not depend on its steps. A command acts with the next sample of the loop. A wrong command is
    refused by a `RefusedError` with its reason, without any change.

    Moves are ramps: under control at the speed of the axis, in open loop at the largest slew of its
    voltage. A new target starts from the present value of the old ramp. A wave table contains
    positions for an axis under control, and voltages for one in open loop; after its waveform an
    axis keeps the last sample.

    A piezo axis with a known range is zeroed at power-on (`set_zero`): it moves through its range
    and sets its zero near the low end.

    A piezo axis is on target after 5 ms within 20 nm of its target; the window of a screw is its
    smallest step. A record continues until its tables are full, unless the motion that started it
    is stopped; lower rates have no averaging.

    Notes
    -----
    Moves are linear ramps at the speed of the axis, without a limit of acceleration, as with piezo
    controllers: the corners of an open-loop ramp excite the first mode of the stage. Signals are
    recorded without the delays inside a real controller. One thread at a time: a server holds a
    lock during each call.

    Examples
    --------
    >>> from flexstage.stage.designs import design
    >>> from flexstage.virtual.build import virtual_stage
    >>> device = VirtualController(virtual_stage(design("vgtu-piezo"), model="lumped", seed=2))
    >>> device.set_servo("1", True)
    >>> device.set_targets({"1": 20e-6})
    >>> device.advance(0.5)
    >>> device.on_target("1"), round(device.position("1") * 1e6)
    (True, 20)
    """

    def servo_on(self, axis: str) -> bool:
        """Return whether position control is on; always for a screw."""
        return self._axis(axis).servo

    def set_servo(self, axis: str, on: bool) -> None:
        """Switch position control, without a step.

        When it is switched on, the target is the present reading, or the end of the range if this
        is outside; when it is switched off, the voltage stays.
        """
        state = self._axis(axis)
        if state.servo == on:
            return
        require(not state.screw, Refusal.NOT_ABLE)
        self._need_drives()
        self._need_no_wave(state)
        state.switch(on)
        low, high = state.description.limits.position or (-np.inf, np.inf)
        if on and not low <= state.target <= high:
            state.go(min(max(state.target, low), high), self._sample, state.speed)

    def set_zero(self, voltages: Mapping[str, float | None]) -> None:
        """Set the zero of axes at a voltage [V], by default slightly above the lowest.

        Control is switched off, and each axis first moves through its full range. The ends of the
        range are unchanged, relative to the new zero.
        """
        self._need_drives()
        states = {self._piezo(axis): value for axis, value in voltages.items()}
        for state, value in states.items():
            self._need_no_wave(state)
            if value is not None:
                states[state] = _allowed(state, value, servo=False)
        for state in states:
            if state.servo:
                state.switch(False)
        self._begin_zero(states)

    def zeroing(self, axis: str) -> bool:
        """Return whether the zero of an axis is being set."""
        return self._axis(axis) in self._zeroing

    def target(self, axis: str) -> float:
        """Return the target of a move or waveform; in open loop the last target [m]."""
        state = self._axis(axis)
        if state.servo and state.wave is not None:
            return state.present(self._sample)
        return state.target

    def set_targets(self, targets: Mapping[str, float]) -> None:
        """Command positions [m] of one or more axes: all of them or none."""
        self._go(targets, self._axis, servo=True)

    def command(self, axis: str) -> float:
        """Return the voltage command of a ramp or waveform; under control the last one [V]."""
        state = self._piezo(axis)
        if not state.servo and state.wave is not None:
            return state.present(self._sample)
        return state.voltage_command

    def set_commands(self, commands: Mapping[str, float]) -> None:
        """Command voltages [V] in open loop of one or more axes: all of them or none."""
        self._go(commands, self._piezo, servo=False)

    def _go(
        self, values: Mapping[str, float], find: Callable[[str], AxisState], *, servo: bool
    ) -> None:
        self._need_drives()
        states = {find(axis): value for axis, value in values.items()}
        for state, value in states.items():
            self._need_no_wave(state)
            require(state.servo == servo, Refusal.SERVO_OFF if servo else Refusal.SERVO_ON)
            states[state] = _allowed(state, value, servo=servo)
        for state, value in states.items():
            state.go(value, self._sample, state.speed if servo else state.largest_slew)
        self.recorder.trigger("move", self._sample + 1)

    def speed(self, axis: str) -> float:
        """Return the speed of moves [m/s]."""
        return self._axis(axis).speed

    def set_speed(self, axis: str, speed: float) -> None:
        """Set the speed of moves [m/s], from the next one."""
        state = self._axis(axis)
        largest = self.largest_speed(axis)
        require(0.0 < speed <= largest * (1.0 + _ROUNDING), Refusal.SPEED_OUT_OF_LIMITS)
        state.speed = min(float(speed), largest)

    def largest_speed(self, axis: str) -> float:
        """Return the largest speed of moves [m/s]."""
        return self._axis(axis).largest_speed

    def position(self, axis: str) -> float:
        """Return the present reading of the axis's own sensor; of a screw its advance [m]."""
        return self._axis(axis).reading

    def voltage(self, axis: str) -> float:
        """Return the voltage at the drive now [V]."""
        return self._piezo(axis).volts

    def on_target(self, axis: str) -> bool:
        """Return whether the axis has reached its target and stays there.

        The reading, smoothed over 1 ms, has been near the target for the settling time; in open
        loop the end of the ramp is sufficient. Mains in the reading may leave the window again
        shortly after the arrival.
        """
        return self._axis(axis).settled(self._sample)

    def moving(self, axis: str) -> bool:
        """Return whether a command or a waveform moves the axis."""
        return self._axis(axis).moving(self._sample)

    def channel(self, number: int) -> float:
        """Return the present reading of a sensor [m, or rad]."""
        require(1 <= number <= len(self.channels), Refusal.UNKNOWN)
        return float(self._readings[number - 1])

    def stop(self, axes: Sequence[str] | None = None) -> None:
        """Stop motion and waveforms immediately; the axes hold their position.

        Under control the target becomes the present reading; in open loop the commanded voltage
        stays, and a screw stops. A record that a waveform has started ends, unless a waveform still
        runs on another axis.
        """
        states = [self._axis(axis) for axis in (self._states if axes is None else axes)]
        for state in states:
            if self.drives_out or not (state.moving(self._sample) or state.servo):
                continue
            self._zeroing.pop(state, None)
            state.stop(self._sample)
        if not any(state.wave for state in self._states.values()):
            self.recorder.end(by="wave")

    def servo(self, axis: str) -> ServoSettings:
        """Return the settings of the position control."""
        return self.stage.servo_settings(self._piezo(axis).description.stage_axis)

    def set_servo_settings(self, axis: str, settings: ServoSettings) -> None:
        """Change the settings of the position control, immediately."""
        state = self._piezo(axis)
        try:
            settings.sections(self.sample_rate_hz)
            self.stage.set_servo_settings(state.description.stage_axis, settings)
        except ModelError as error:
            raise RefusedError(Refusal.BAD_VALUE) from error

    # waveforms ------------------------------------------------------------------------------

    def set_wave(self, table: int, samples: Array) -> None:
        """Replace the samples of a table; an empty sequence clears it."""
        self._need_idle(table)
        self.tables.replace(table, samples)

    def append_wave(self, table: int, samples: Array) -> None:
        """Add samples to those of a table."""
        self._need_idle(table)
        self.tables.append(table, samples)

    def _need_idle(self, table: int) -> None:
        self.tables.known(table)
        for name, state in self._states.items():
            require(state.wave is None or table not in self._choice[name], Refusal.WAVE_RUNNING)

    def set_wave_rate_divider(self, divider: int) -> None:
        """Set the duration of a table sample, in samples of the loop."""
        require(divider >= 1, Refusal.BAD_VALUE)
        for state in self._states.values():
            self._need_no_wave(state)
        self.wave_divider = int(divider)

    def wave_choice(self, axis: str) -> tuple[int, int]:
        """Return the table of an axis and that of its feedforward, 0 for none."""
        self._axis(axis)
        return self._choice[axis]

    def choose_wave(self, axis: str, table: int, feedforward: int = 0) -> None:
        """Select the table of an axis and that of its feedforward, 0 for none."""
        state = self._axis(axis)
        self._need_no_wave(state)
        if feedforward:
            self._piezo(axis)
        for number in (table, feedforward):
            if number:
                self.tables.known(number)
        self._choice[axis] = (int(table), int(feedforward))

    def set_wave_cycles(self, axis: str, cycles: int) -> None:
        """Set the number of cycles of the waveform of an axis; 0 for endless."""
        state = self._axis(axis)
        self._need_no_wave(state)
        require(cycles >= 0, Refusal.BAD_VALUE)
        self._cycles[axis] = int(cycles)

    def start_waves(
        self,
        axes: Sequence[str],
        onward: Collection[str] = (),
        scales: Mapping[str, tuple[float, float]] = MappingProxyType({}),
    ) -> None:
        """Check every sample of the selected tables against the limits, then start all axes.

        The cycles of axes in `onward` each start at the end of the previous one. With a unit [m or
        V] and an offset in `scales`, the command is the sum of table and offset in that unit. If
        any axis is refused, none is started.
        """
        self._need_drives()
        runs = [
            (state, self._prepared(axis, state, axis in onward, scales.get(axis, (1.0, 0.0))))
            for axis, state in self._named(axes)
        ]
        for state, run in runs:
            state.run(run, self._sample)
        self.recorder.trigger("wave", self._sample + 1)

    def stop_waves(self, axes: Sequence[str]) -> None:
        """Stop waveforms; their axes hold their position, other axes continue."""
        for _, state in self._named(axes):
            if state.wave is not None and state not in self._zeroing:
                state.stop(self._sample)

    def wave_running(self, axis: str) -> bool:
        """Return whether a waveform runs on an axis."""
        state = self._axis(axis)
        return state.wave is not None and state not in self._zeroing

    def _named(self, axes: Sequence[str]) -> list[tuple[str, AxisState]]:
        return [(axis, self._axis(axis)) for axis in dict.fromkeys(axes)]

    def _prepared(
        self, axis: str, state: AxisState, onward: bool, scale: tuple[float, float]
    ) -> WaveRun:
        self._need_no_wave(state)
        table, feedforward_table = self._choice[axis]
        unit, offset = scale
        samples = (self._filled(axis, table) + offset) * unit
        cycles = self._cycles[axis]
        divider = self.wave_divider
        shift = float(samples[-1] - samples[0]) if onward and cycles != 1 else 0.0
        samples = check_wave(
            state, samples, cycles, divider, state.present(self._sample), shift=shift
        )
        voltages = None
        if feedforward_table:
            voltages = check_feedforward(
                state, self._filled(axis, feedforward_table), samples.size, cycles, divider
            )
        return WaveRun(
            first=self._sample + 1,
            table=samples,
            divider=divider,
            cycles=cycles,
            feedforward=voltages,
            shift=shift,
        )

    def _filled(self, axis: str, table: int) -> Array:
        require(table, Refusal.NO_WAVE)
        samples = self.tables.samples(table)
        require(samples.size, Refusal.NO_WAVE)
        return samples


def _allowed(state: AxisState, value: float, *, servo: bool) -> float:
    limits = state.description.limits
    bounds = limits.position if servo else limits.voltage
    beyond = Refusal.OUT_OF_LIMITS if servo else Refusal.VOLTAGE_OUT_OF_LIMITS
    return float(require_within(np.array([value]), bounds, beyond)[0])
