"""A card that is not there: its sensors follow its drives by straight lines."""

import math
from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from flexstage.errors import ControllerError
from flexstage.instruments.ni.backend import InputTask
from flexstage.instruments.ni.setup import DriveOutput, SensorInput

__all__ = ["SimulatedBackend"]

Array = NDArray[np.float64]

_CALL = 1e-4  # what a call takes [s]


class SimulatedBackend:
    r"""A simulated card with a stage that has no dynamics and no hysteresis.

    .. math:: v_i(t) = a_i + \sum_j g_{ij} u_j(t) + e

    An output changes at an edge of its clock, and an input that is sampled at the same edge still
    sees what was before, as it is with a card.

    Validity: for trying a program without a card; nothing of the stage is in it. Time passes by
    `pause` and a little by each call.

    Parameters
    ----------
    wiring : Mapping
        Change of each input by outputs [V/V]: ``{"Dev1/ai0": {"Dev1/ao0": 0.7}}``; inputs that are
        not named read their noise.
    at_rest : Mapping, optional
        What inputs read with all outputs at 0 V [V]; zero where not given.
    noise : float
        Standard deviation of the inputs [V].
    seed : int
        Of the noise.
    note : str
        Why there is no card.
    """

    def __init__(
        self,
        wiring: Mapping[str, Mapping[str, float]],
        *,
        at_rest: Mapping[str, float] | None = None,
        noise: float = 0.0,
        seed: int = 0,
        note: str = "simulated: asked for",
    ) -> None:
        self._wiring, self._at_rest, self._noise = wiring, at_rest or {}, noise
        self._rng = np.random.default_rng(np.random.SeedSequence(seed))
        self._note = note
        self._standing: dict[str, float] = {}
        self._output: _Output | None = None
        self._input: _Input | None = None
        self.now = 0.0

    @property
    def simulated(self) -> bool:
        """True."""
        return True

    @property
    def note(self) -> str:
        """Why there is no card."""
        return self._note

    def identify(self, device: str) -> tuple[str, str]:
        """Return the type and the serial number of the card.

        Parameters
        ----------
        device : str
            Its name.

        Returns
        -------
        tuple of str
            The same for every name.
        """
        return f"simulated card {device}", ""

    def read_now(self, inputs: Sequence[SensorInput]) -> Array:
        """Return what stands at inputs now.

        Parameters
        ----------
        inputs : sequence of SensorInput
            The inputs.

        Returns
        -------
        numpy.ndarray
            Their voltages [V], shape (channels,).
        """
        self._call()
        if self._input is not None and self._input.begin <= self.now:
            raise ControllerError("the inputs are reserved by a record", -50103)
        return self.read_at(inputs, np.array([self.now]))[:, 0]

    def write_now(self, outputs: Sequence[DriveOutput], volts: Array) -> None:
        """Put out voltages now.

        Parameters
        ----------
        outputs : sequence of DriveOutput
            The outputs.
        volts : numpy.ndarray
            Their voltages [V], shape (channels,).
        """
        self._call()
        if self._output is not None:
            raise ControllerError("the outputs are reserved by a waveform", -50103)
        if self._input is not None:
            self._input.sample()  # what was before is sampled as it was
        for drive, value in zip(outputs, volts, strict=True):
            self._standing[drive.channel] = float(value)

    def kept_rate(self, inputs: Sequence[SensorInput], rate_hz: float) -> float:
        """Return the rate that a card with a timebase of 100 MHz keeps.

        Parameters
        ----------
        inputs : sequence of SensorInput
            The inputs.
        rate_hz : float
            Rate that is wanted [Hz].

        Returns
        -------
        float
            The next higher whole part of the timebase [Hz].
        """
        return 1e8 / max(math.floor(1e8 / rate_hz * (1.0 + 1e-12)), 1)

    def open_input(self, inputs: Sequence[SensorInput], rate_hz: float, buffer: int) -> "_Input":
        """Prepare inputs.

        Parameters
        ----------
        inputs : sequence of SensorInput
            The inputs.
        rate_hz : float
            Rate of samples [Hz].
        buffer : int
            How many samples of each are kept until they are read.

        Returns
        -------
        InputTask
            The task.
        """
        self._input = _Input(self, inputs, self.kept_rate(inputs, rate_hz), buffer)
        return self._input

    def open_output(
        self,
        outputs: Sequence[DriveOutput],
        volts: Array,
        rate_hz: float,
        *,
        clock: InputTask | None,
        wait_for_start: bool,
    ) -> "_Output":
        """Prepare outputs.

        Parameters
        ----------
        outputs : sequence of DriveOutput
            The outputs.
        volts : numpy.ndarray
            What they put out [V], shape (channels, n).
        rate_hz : float
            Rate of their own clock [Hz].
        clock : InputTask or None
            Inputs with whose clock they go.
        wait_for_start : bool
            Whether the start of the inputs starts them.

        Returns
        -------
        OutputTask
            The task.
        """
        if self._output is not None:
            raise ControllerError("the outputs are reserved by a waveform", -50103)
        source = clock if isinstance(clock, _Input) else None
        self._output = _Output(
            self, [d.channel for d in outputs], volts, rate_hz, source, wait_for_start
        )
        return self._output

    def pause(self, seconds: float) -> None:
        """Let simulated time pass.

        Parameters
        ----------
        seconds : float
            How much [s].
        """
        self.now += seconds

    def close(self) -> None:
        """Give all free."""
        self._input = self._output = None

    def read_at(self, inputs: Sequence[SensorInput], time: Array) -> Array:
        """Return what inputs see at some times, the output that changes then not yet counted.

        Parameters
        ----------
        inputs : sequence of SensorInput
            The inputs.
        time : numpy.ndarray
            Rising times [s], shape (n,).

        Returns
        -------
        numpy.ndarray
            Their voltages, clipped at their ranges [V], shape (channels, n).
        """
        out = np.empty((len(inputs), time.size))
        for k, sensor in enumerate(inputs):
            out[k] = self._at_rest.get(sensor.channel, 0.0)
            for channel, gain in self._wiring.get(sensor.channel, {}).items():
                out[k] += gain * self._given(channel, time)
            if self._noise:
                out[k] += self._noise * self._rng.standard_normal(time.size)
            np.clip(out[k], *sensor.voltage_range, out=out[k])
        return out

    def _given(self, channel: str, time: Array) -> Array:
        standing = self._standing.get(channel, 0.0)
        if self._output is None or channel not in self._output.channels:
            return np.full(time.size, standing)
        return self._output.given(channel, time, standing)

    def _call(self) -> None:
        self.now += _CALL

    def _end_output(self, task: "_Output") -> None:
        for channel, values in zip(task.channels, task.volts, strict=True):
            if n := task.generated():
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
        self._kept = np.empty((len(inputs), 0))
        self._sampled = 0

    def start(self) -> None:
        self._owner._call()
        self.begin = self._owner.now

    def sample(self) -> None:
        """Take all samples up to now: before an output task begins or ends, and when asked."""
        until = self._owner.now - self.begin
        total = 0 if until < 0.0 else math.floor(until * self.rate_hz + 1e-6) + 1
        if total > self._sampled:
            time = self.begin + np.arange(self._sampled, total) / self.rate_hz
            self._kept = np.hstack([self._kept, self._owner.read_at(self._inputs, time)])
            self._sampled = total

    def available(self) -> int:
        self._owner._call()
        self.sample()
        if self._kept.shape[1] > self._buffer:
            raise ControllerError(
                "samples were overwritten before they were read: read more often", -200279
            )
        return self._kept.shape[1]

    def read(self, count: int) -> Array:
        out, self._kept = self._kept[:, :count], self._kept[:, count:]
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
        wait: bool,
    ) -> None:
        self._owner, self.channels, self.volts = owner, tuple(channels), volts
        self._rate = rate if clock is None else clock.rate_hz
        self._clock, self._wait = clock, wait
        self._armed = False
        self._begin, self._stopped = math.inf, math.inf

    def start(self) -> None:
        self._owner._call()
        if self._clock is None:
            self._begin = self._owner.now
        elif self._wait:
            self._armed = True
        else:  # with the next edge of a clock that runs
            self._clock.sample()
            edges = math.ceil((self._owner.now - self._clock.begin) * self._rate)
            self._begin = self._clock.begin + edges / self._rate

    def begin(self) -> float:
        if self._armed and self._clock is not None:
            return self._clock.begin
        return self._begin

    def _count(self, time: Array) -> NDArray[np.intp]:
        """Samples that were put out before some times."""
        passed = (np.minimum(time, self._stopped) - self.begin()) * self._rate
        passed = np.where(np.isfinite(passed), passed, 0.0)
        return np.clip(np.ceil(passed - 1e-6), 0, self.volts.shape[1]).astype(np.intp)

    def given(self, channel: str, time: Array, standing: float) -> Array:
        values = np.append(standing, self.volts[self.channels.index(channel)])
        return values[self._count(time)]

    def done(self) -> bool:
        self._owner._call()
        return self.generated() == self.volts.shape[1]

    def stop(self) -> None:
        if self._owner._input is not None:
            self._owner._input.sample()
        self._stopped = min(self._stopped, self._owner.now)

    def generated(self) -> int:
        return int(self._count(np.array([self._owner.now + 1e-9]))[0])

    def close(self) -> None:
        if self._owner._input is not None:
            self._owner._input.sample()
        self._owner._end_output(self)
