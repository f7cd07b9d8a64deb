"""A simulated card, whose sensors are linear functions of its drives."""

import math
from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from flexstage.base.arrays import Array
from flexstage.base.errors import ControllerError
from flexstage.instruments.ni.setup import (
    CardInfo,
    DriveOutput,
    InputTask,
    NiBackend,
    NiSetup,
    SensorInput,
)

_CALL = 1e-4  # duration of a call [s]
_RATE = 250e3  # of all inputs together, and of the outputs [Hz]
_SETTLING = 10e-6  # settling time that the driver adds to each conversion if possible [s]


class SimulatedBackend(NiBackend):
    r"""A simulated card with a stage that has no dynamics and no hysteresis.

    .. math:: v_i(t) = a_i + \sum_j g_{ij} u_j(t) + e

    An output changes at an edge of its clock, and an input that is sampled at the same edge still
    reads the previous output, as with a real card. Inputs are converted one after the other, unless
    `simultaneous`.

    `wiring` is the gain from outputs to each input [V/V]: ``{"Dev1/ai0": {"Dev1/ao0": 0.7}}``.
    `at_rest` are the inputs with all outputs at 0 V [V], `noise` their standard deviation [V],
    `standing` the outputs when the program starts [V]; they can be read back if they are
    `readable`. `note` is the reason for the simulation.

    Validity: for tests of a program without a card; it has no model of the stage. Time passes by
    `pause` and slightly by each call.
    """

    def __init__(
        self,
        wiring: Mapping[str, Mapping[str, float]],
        *,
        at_rest: Mapping[str, float] | None = None,
        noise: float = 0.0,
        seed: int = 0,
        note: str = "simulated, as requested",
        simultaneous: bool = False,
        standing: Mapping[str, float] | None = None,
        readable: bool = True,
    ) -> None:
        self._wiring, self._at_rest, self._noise = wiring, at_rest or {}, noise
        self._rng = np.random.default_rng(np.random.SeedSequence(seed))
        self._note = note
        self._standing, self._readable = dict(standing or {}), readable
        self.simultaneous = simultaneous
        self._output: _Output | None = None
        self._input: _Input | None = None
        self.now = 0.0

    def describe(self, setup: NiSetup) -> CardInfo:
        return CardInfo(
            vendor="flexstage",
            model=f"simulated card {setup.device}",
            simulated=True,
            note=self._note,
            single_rate_hz=_RATE,
            total_rate_hz=_RATE,
            output_rate_hz=_RATE,
            simultaneous=self.simultaneous,
        )

    def read_now(self, inputs: Sequence[SensorInput]) -> Array:
        self._call()
        if self._input is not None and self._input.begin <= self.now:
            raise ControllerError("the inputs are reserved by a record", -50103)
        return self.read_at(inputs, np.array([self.now]))[:, 0]

    def write_now(self, outputs: Sequence[DriveOutput], volts: Array) -> None:
        self._call()
        if self._output is not None:
            raise ControllerError("the outputs are reserved by a waveform", -50103)
        if self._input is not None:
            self._input.sample()  # up to now with the previous voltages
        for drive, value in zip(outputs, volts, strict=True):
            self._standing[drive.channel] = float(value)

    def read_outputs(self, outputs: Sequence[DriveOutput]) -> Array:
        self._call()
        if not self._readable:
            return np.full(len(outputs), np.nan)
        if self._input is not None:
            raise ControllerError("the inputs are reserved by a record", -50103)
        now = np.array([self.now])
        return np.array([self._voltages(d.channel, now)[0] for d in outputs])

    def open_input(self, inputs: Sequence[SensorInput], rate_hz: float, buffer: int) -> "_Input":
        # a timebase of 100 MHz is divided by an integer
        rate = 1e8 / max(math.floor(1e8 / rate_hz * (1.0 + 1e-12)), 1)
        self._input = _Input(self, inputs, rate, buffer)
        return self._input

    def open_output(
        self,
        outputs: Sequence[DriveOutput],
        volts: Array,
        rate_hz: float,
        *,
        clock: InputTask | None,
    ) -> "_Output":
        if self._output is not None:
            raise ControllerError("the outputs are reserved by a waveform", -50103)
        source = clock if isinstance(clock, _Input) else None
        self._output = _Output(self, [d.channel for d in outputs], volts, rate_hz, source)
        return self._output

    def pause(self, seconds: float) -> None:
        self.now += seconds

    def close(self) -> None:
        self._input = self._output = None

    def read_at(self, inputs: Sequence[SensorInput], time: Array, interval: float = 0.0) -> Array:
        """Return the inputs at ascending times of the first one [V], shape (channels, n), clipped.

        Each further input is converted an `interval` later [s]. An output that changes at one of
        the times has its previous value.
        """
        out = np.empty((len(inputs), time.size))
        for k, sensor in enumerate(inputs):
            out[k] = self._at_rest.get(sensor.channel, 0.0)
            for channel, gain in self._wiring.get(sensor.channel, {}).items():
                out[k] += gain * self._voltages(channel, time + k * interval)
            if self._noise:
                out[k] += self._noise * self._rng.standard_normal(time.size)
            np.clip(out[k], *sensor.voltage_range, out=out[k])
        return out

    def _voltages(self, channel: str, time: Array) -> Array:
        standing = self._standing.get(channel, 0.0)
        if self._output is None or channel not in self._output.channels:
            return np.full(time.size, standing)
        return self._output.voltages(channel, time, standing)

    def _call(self) -> None:
        self.now += _CALL

    def _end_output(self, task: "_Output") -> None:
        for channel, values in zip(task.channels, task.volts, strict=True):
            if n := task.put_out():
                self._standing[channel] = float(values[n - 1])
        if self._output is task:
            self._output = None

    def _end_input(self, task: "_Input") -> None:
        if self._input is task:
            self._input = None


class _Input:
    def __init__(
        self, owner: SimulatedBackend, inputs: Sequence[SensorInput], rate: float, buffer: int
    ) -> None:
        self._owner, self._inputs, self._buffer = owner, inputs, buffer
        self.rate_hz, self.begin = rate, math.inf
        fastest = min(1.0 / _RATE + _SETTLING, 1.0 / (rate * len(inputs)))
        self.interval = 0.0 if owner.simultaneous or len(inputs) == 1 else fastest
        self._samples = np.empty((len(inputs), 0))
        self._sampled = 0

    def start(self) -> None:
        self._owner._call()
        self.begin = self._owner.now

    def sample(self) -> None:
        """Sample up to now: before an output task starts or ends, and on request."""
        until = self._owner.now - self.begin
        total = 0 if until < 0.0 else math.floor(until * self.rate_hz + 1e-6) + 1
        if total > self._sampled:
            time = self.begin + np.arange(self._sampled, total) / self.rate_hz
            self._samples = np.hstack(
                [self._samples, self._owner.read_at(self._inputs, time, self.interval)]
            )
            self._sampled = total

    def available(self) -> int:
        self._owner._call()
        self.sample()
        if self._samples.shape[1] > self._buffer:
            raise ControllerError(
                "samples were overwritten before they were read: read more often", -200279
            )
        return self._samples.shape[1]

    def read(self, count: int) -> Array:
        out, self._samples = self._samples[:, :count], self._samples[:, count:]
        return out

    def close(self) -> None:
        self._owner._end_input(self)


class _Output:
    def __init__(
        self,
        owner: SimulatedBackend,
        channels: Sequence[str],
        volts: Array,
        rate: float,
        clock: _Input | None,
    ) -> None:
        self._owner, self.channels, self.volts = owner, tuple(channels), volts
        self._rate = rate if clock is None else clock.rate_hz
        self._clock = clock
        self._armed = False
        self._begin, self._stopped = math.inf, math.inf

    def start(self) -> None:
        self._owner._call()
        if self._clock is None:
            self._begin = self._owner.now
        elif self._clock.begin == math.inf:  # the outputs start with its first edge
            self._armed = True
        else:  # with the next edge of a running clock
            self._clock.sample()
            edges = math.ceil((self._owner.now - self._clock.begin) * self._rate)
            self._begin = self._clock.begin + edges / self._rate

    def begin(self) -> float:
        if self._armed and self._clock is not None:
            return self._clock.begin
        return self._begin

    def _count(self, time: Array) -> NDArray[np.intp]:
        """Return the number of samples that were output before given times."""
        passed = (np.minimum(time, self._stopped) - self.begin()) * self._rate
        passed = np.where(np.isfinite(passed), passed, 0.0)
        return np.clip(np.ceil(passed - 1e-6), 0, self.volts.shape[1]).astype(np.intp)

    def voltages(self, channel: str, time: Array, standing: float) -> Array:
        values = np.append(standing, self.volts[self.channels.index(channel)])
        return values[self._count(time)]

    def done(self) -> bool:
        self._owner._call()
        return self.put_out() == self.volts.shape[1]

    def stop(self) -> None:
        if self._owner._input is not None:
            self._owner._input.sample()
        self._stopped = min(self._stopped, self._owner.now)

    def generated(self) -> int:
        return self.put_out()

    def put_out(self) -> int:
        return int(self._count(np.array([self._owner.now + 1e-9]))[0])

    def close(self) -> None:
        if self._owner._input is not None:
            self._owner._input.sample()
        self._owner._end_output(self)
