"""State of an axis of a simulated controller, its commands sample by sample, and their checks."""

import math
from dataclasses import dataclass

import numpy as np

from flexstage.base.arrays import Array
from flexstage.hysteresis.compiled import compiled
from flexstage.instruments.pi.simulated.device import (
    AxisDescription,
    Refusal,
    require,
)
from flexstage.instruments.pi.simulated.tables import WaveRun

#: Time constant of the smoothing of the reading before the comparison with the target [s].
_SMOOTHING = 1e-3
#: Time of a full travel at the default speed [s].
_TRAVEL_TIME = 0.1
#: Time of a full range of a drive whose slew limit is unknown [s].
_RANGE_TIME = 10e-3


@dataclass(frozen=True, slots=True, kw_only=True)
class Ramp:
    """A linear ramp from one value to another, which is constant afterwards.

    Every sample has a closed form in its number, so that the samples do not depend on the blocks in
    which they are computed.

    Examples
    --------
    >>> Ramp(first=10, start=2.0, end=-1.0, step=1.25).values(9, 5)
    array([ 2.  ,  0.75, -0.5 , -1.  , -1.  ])
    """

    first: int
    """Number of its first sample, which is one step from the start."""
    start: float
    """Value before its first step [m, or V]."""
    end: float
    """Final value [m, or V]."""
    step: float
    """Largest change from one sample to the next [m, or V]."""

    @classmethod
    def hold(cls, value: float) -> "Ramp":
        """Return a constant value, as a completed ramp."""
        return cls(first=0, start=value, end=value, step=math.inf)

    @property
    def last(self) -> int:
        """Number of the first sample at the end."""
        steps = abs(self.end - self.start) / self.step
        count = math.ceil(steps)
        # the quotient is rounded: correct it by the samples
        while count and (count - 1) * self.step >= abs(self.end - self.start):
            count -= 1
        while count * self.step < abs(self.end - self.start):
            count += 1
        return self.first + max(count, 1) - 1

    def values(self, first: int, count: int) -> Array:
        """Return samples."""
        distance = abs(self.end - self.start)
        if distance == 0.0:
            return np.full(count, self.end)
        steps = np.arange(first - self.first + 1, first - self.first + 1 + count, dtype=np.float64)
        way = np.maximum(steps, 0.0) * self.step
        return np.where(
            way >= distance, self.end, self.start + math.copysign(1.0, self._rise) * way
        )

    @property
    def _rise(self) -> float:
        return self.end - self.start


class AxisState:
    """State of an axis in the controller.

    Commands are positions [m] under control, and voltages [V] in open loop; samples are numbered as
    those of the loop. `index` is the index of the axis, from 0.
    """

    def __init__(self, description: AxisDescription, index: int, rate_hz: float) -> None:
        self.description, self.index = description, index
        self.period = 1.0 / rate_hz
        self._window = description.window
        self._settle = max(1, round(description.settle * rate_hz))
        self._share = 1.0 - math.exp(-self.period / _SMOOTHING)
        self.reset()

    def reset(self) -> None:
        """Restore the state after power-on."""
        self.servo = self.screw
        self.ramp = Ramp.hold(0.0)
        self.wave: WaveRun | None = None
        self.speed = self._first_speed()
        self.target = 0.0  # last commanded position
        self.voltage_command = 0.0  # last commanded voltage
        self.reading = 0.0
        self.volts = self.amplifier_input = (
            0.0  # voltage at the drive, and command of its amplifier
        )
        self._smooth, self._inside = 0.0, 0

    @property
    def screw(self) -> bool:
        """Whether it is a screw, which is always under control."""
        return self.description.kind == "screw"

    @property
    def largest_speed(self) -> float:
        """Largest speed of moves and waveforms [m/s].

        Without a limit of speed, the mean speed at the largest slew of the voltage.
        """
        limits = self.description.limits
        if limits.speed is not None:
            return limits.speed
        return _span(limits.position, 1e-4) / _span(limits.voltage, 100.0) * self.largest_slew

    @property
    def largest_slew(self) -> float:
        """Largest rate of the voltage [V/s]; the full range in 10 ms where there is no limit."""
        limits = self.description.limits
        return _span(limits.voltage, 100.0) / _RANGE_TIME if limits.slew is None else limits.slew

    @property
    def largest_rate(self) -> float:
        """Largest rate of a waveform in the present mode [m/s, or V/s]."""
        return self.largest_speed if self.servo else self.largest_slew

    def _first_speed(self) -> float:
        if self.screw and self.description.limits.speed is not None:
            return self.description.limits.speed
        return min(self.largest_speed, _span(self.description.limits.position, 1e-4) / _TRAVEL_TIME)

    def present(self, sample: int) -> float:
        """Return the command at a sample: a position under control, else a voltage."""
        begun = self.wave is not None and sample >= self.wave.first
        source = self.wave if self.wave is not None and begun else self.ramp
        return float(source.values(sample, 1)[0])

    def moving(self, sample: int) -> bool:
        """Return whether a command or a waveform still moves it."""
        return self.wave is not None or sample < self.ramp.last

    def settled(self, sample: int) -> bool:
        """Return whether it has reached its target, and under control stays near it."""
        if self.moving(sample):
            return False
        return not self.servo or self._inside >= self._settle

    def go(self, value: float, sample: int, rate: float) -> None:
        """Start a ramp of the command to a value, at a rate [m/s, or V/s]."""
        here = self.present(sample)
        self.ramp = Ramp(first=sample + 1, start=here, end=value, step=rate * self.period)
        self._inside = 0
        self._note(value)

    def hold(self, value: float) -> None:
        """Command a constant value from the next sample, and end any motion."""
        self.wave = None
        self.ramp = Ramp.hold(value)
        self._inside = 0
        self._note(value)

    def run(self, wave: WaveRun, sample: int) -> None:
        """Follow a waveform from its first sample."""
        self.ramp = Ramp.hold(self.present(sample))
        self.wave = wave
        self._inside = 0

    def stop(self, sample: int) -> None:
        """Hold the present reading under control, else the present command."""
        self.hold(self.reading if self.servo and not self.screw else self.present(sample))

    def switch(self, on: bool) -> None:
        """Switch control on, holding the present reading, or off, holding the voltage."""
        self.servo = on
        self._smooth = self.reading
        self.hold(self.reading if on else self.amplifier_input)

    def fill(self, first: int, command: Array, feedforward: Array) -> None:
        """Write the commands of the next samples; feedforward [V] is NaN for none."""
        source = self.ramp if self.wave is None else self.wave
        command[:] = source.values(first, command.size)
        feedforward[:] = np.nan if self.wave is None else self.wave.voltages(first, command.size)

    def take(self, last: int, command: Array, reading: Array) -> None:
        """Update the state from the commands and readings of a block [m]."""
        self.reading = float(reading[-1])
        if self.servo:
            share = 1.0 if self.screw else self._share
            self._smooth, self._inside = _settle(
                command, reading, self._window, share, self._smooth, self._inside
            )
        if self.wave is not None and not self.wave.running(last):
            inside = self._inside
            self.hold(self.wave.end)
            self._inside = inside

    def _note(self, value: float) -> None:
        if self.servo:
            self.target = value
        else:
            self.voltage_command = value


def _span(bounds: tuple[float, float] | None, unknown: float) -> float:
    return unknown if bounds is None else bounds[1] - bounds[0]


@compiled
def _settle(
    command: Array, reading: Array, window: float, share: float, smooth: float, inside: int
) -> tuple[float, int]:
    """Smooth the reading by a first-order lag, and count the samples near the command."""
    for k in range(command.size):
        smooth += share * (reading[k] - smooth)
        inside = inside + 1 if abs(smooth - command[k]) <= window else 0
    return smooth, inside


#: Tolerances for rounded texts: of a value, over its range, which is then clipped to the end of the
#: range; and of a slope, over its limit.
_VALUE, _SLOPE = 1e-6, 1e-3


def require_within(
    values: Array, bounds: tuple[float, float] | None, reason: Refusal = Refusal.OUT_OF_LIMITS
) -> Array:
    """Refuse values [m, or V] outside a range; return them, clipped where rounding exceeds it.

    An unknown range has no limits.
    """
    require(np.isfinite(values).all(), Refusal.BAD_VALUE)
    if bounds is None:
        return values
    low, high = bounds
    slack = _VALUE * (high - low)
    require(np.all((low - slack <= values) & (values <= high + slack)), reason)
    return np.clip(values, low, high)


def check_wave(
    state: AxisState,
    samples: Array,
    cycles: int,
    divider: int,
    present: float,
    *,
    shift: float = 0.0,
) -> Array:
    """Check a complete waveform, and return its samples [m, or V].

    It runs `cycles` times, with `divider` samples of the loop for one of the table, from the
    present value of the axis; each cycle starts `shift` beyond the previous one [m, or V].

    A step between samples of the table takes the time of one of them. The step from the present
    value to the first sample takes one sample of the loop, however slow the table is.
    """
    limits = state.description.limits
    bounds = limits.position if state.servo else limits.voltage
    samples = require_within(samples, bounds)
    require(cycles or not shift, Refusal.OUT_OF_LIMITS)
    if shift:
        require_within(samples + shift * (cycles - 1), bounds)
    largest = state.largest_rate * state.period
    joined = cycles if not shift else 1  # a cycle starts where the previous one has ended
    _check_steps(samples, joined, largest * divider)
    require(abs(samples[0] - present) <= largest * (1.0 + _SLOPE), Refusal.OUT_OF_LIMITS)
    return samples


def check_feedforward(
    state: AxisState, voltages: Array, size: int, cycles: int, divider: int
) -> Array:
    """Check the feedforward voltages [V] of a waveform of positions, with the same size."""
    require(state.servo, Refusal.SERVO_OFF)
    require(voltages.size == size, Refusal.BAD_VALUE)
    voltages = require_within(voltages, state.description.limits.voltage)
    _check_steps(voltages, cycles, state.largest_slew * state.period * divider)
    return voltages


def _check_steps(values: Array, cycles: int, largest: float) -> None:
    steps = np.abs(np.diff(values if cycles == 1 else np.append(values, values[0])))
    require(np.all(steps <= largest * (1.0 + _SLOPE)), Refusal.OUT_OF_LIMITS)
