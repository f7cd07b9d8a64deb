"""Sensor: gain, offset, lag, noise, mains pick-up and quantisation."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from flexstage.base.arrays import Complex
from flexstage.base.errors import ModelError
from flexstage.hysteresis.chain.element import ChainElement, positive_step
from flexstage.hysteresis.chain.lag import Lag
from flexstage.hysteresis.model import Array, Response, checked, samples

# Number of samples of a noise block; each block has its own random stream, so that a record does
# not depend on its division into calls.
_BLOCK = 4096


@dataclass(frozen=True, slots=True, kw_only=True)
class Sensor(ChainElement):
    r"""A sensor whose reading is a line, delayed by a first-order lag, with noise and steps.

    .. math:: y_k = q\,\mathrm{round}\left(\frac{1}{q}\left[g\,l(t_k) + o + \sigma \nu_k
              + m \sin(2\pi f_m t_k + \varphi)\right]\right), \qquad
              T \dot l + l = x

    State: the input, the lag, and the number of the next sample, which noise and mains go by.

    Validity: the noise is white and normal, of unit :math:`\nu`, and is added after the lag.

    Raises
    ------
    ModelError
        The gain is 0, or a quantity that must not be is negative.

    Examples
    --------
    >>> import numpy as np
    >>> sensor = Sensor(gain=1.003, offset=2e-8, noise_rms=5e-9, quantisation=1e-9, seed=7)
    >>> y = sensor.simulate(np.full(20000, 3.1e-6), 1e-4).values
    >>> round(float(y.mean()) * 1e9, 1), round(float(y.std()) * 1e9, 1)
    (3129.3, 5.0)
    """

    gain: float = 1.0
    """Reading over input g [unit of y / unit of x]."""
    offset: float = 0.0
    """Reading at no input o [unit of y]."""
    bandwidth_hz: float | None = None
    """Frequency at which a small sine has fallen by 3 dB [Hz]; no lag where not given."""
    noise_rms: float = 0.0
    """Standard deviation of the noise of a sample [unit of y]."""
    quantisation: float = 0.0
    """Smallest step of the reading q [unit of y]; 0 for none."""
    mains_amplitude: float = 0.0
    """Amplitude of the pick-up of the mains m [unit of y]."""
    mains_frequency_hz: float = 50.0
    """Frequency of the mains [Hz]."""
    mains_phase: float = 0.0
    """Phase of the pick-up at the first sample [rad]."""
    seed: int = 0
    """Seed of the noise; two sensors need two."""

    def __post_init__(self) -> None:
        checked(self.gain, "gain of a sensor", "finite, not 0")
        for name in ("noise_rms", "quantisation", "mains_frequency_hz"):
            checked(getattr(self, name), f"{name} of a sensor", "finite and not negative")
        if self.bandwidth_hz is not None:
            hint = "Hz: omit it for none"
            checked(self.bandwidth_hz, "bandwidth of a sensor", "positive and finite", hint)
        if self.seed < 0:
            raise ModelError(f"the seed of a sensor must not be negative, got {self.seed!r}")

    def settled(self, x: float, dt: float) -> Array:
        del dt
        return np.array([x, x, 0.0])

    def simulate(self, x: ArrayLike, dt: float, state: ArrayLike | None = None) -> Response:
        inputs = samples(x, "input of a sensor")
        h = positive_step(dt)
        now = self._initial_state(inputs[0], h, state, "a sensor")
        lagged = self._lag().simulate(inputs, h, now[:2])
        count = int(now[2])
        y = self.gain * lagged.values + self.offset
        if self.mains_amplitude != 0.0:
            t = h * np.arange(count, count + inputs.size)
            turn = 2.0 * math.pi * self.mains_frequency_hz * t + self.mains_phase
            y += self.mains_amplitude * np.sin(turn)
        if self.noise_rms > 0.0:
            y += self.noise_rms * self._noise(count, inputs.size)
        if self.quantisation > 0.0:
            y = self.quantisation * np.round(y / self.quantisation)
        return Response(values=y, state=np.append(lagged.state, float(count + inputs.size)))

    def frequency_response(self, frequency_hz: ArrayLike) -> Complex:
        return self.gain * self._lag().frequency_response(frequency_hz)

    def _lag(self) -> Lag:
        if self.bandwidth_hz is None:
            return Lag()
        return Lag(time_constant=1.0 / (2.0 * math.pi * self.bandwidth_hz))

    def _noise(self, first: int, count: int) -> Array:
        blocks = range(first // _BLOCK, (first + count - 1) // _BLOCK + 1)
        noise = [
            np.random.default_rng(np.random.SeedSequence(self.seed, spawn_key=(b,))).normal(
                size=_BLOCK
            )
            for b in blocks
        ]
        offset = first - blocks[0] * _BLOCK
        return np.concatenate(noise)[offset : offset + count]
