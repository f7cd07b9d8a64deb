"""How a drive signal goes from one voltage to the next, and how fast it may."""

import math
from dataclasses import dataclass

import numpy as np

from flexstage.errors import ModelError
from flexstage.hysteresis.model import Array

#: The shapes of a movement.
SHAPES = ("smooth", "sine", "triangle")

#: A loop is run at the speed of the major loop, and at most this many times as often.
_MOST_OFTEN = 5.0
#: A smooth movement rises to its speed, and falls from it, over at least this share of its time.
_SHORTEST_RAMP = 0.1
#: Fewest samples in a movement: with fewer its shape is not that which was asked.
_FEWEST_SAMPLES = 8


@dataclass(frozen=True, slots=True, kw_only=True)
class Movement:
    r"""Monotone movements between two voltages, within a limit of the slope.

    A movement by a in the time T is a ``triangle`` (constant speed), a ``sine`` (half a cosine)
    or ``smooth``: the speed rises to its largest value over a time :math:`\beta T` as half a
    cosine does, is constant, and falls as it rose. The largest speed is a/T,
    :math:`\pi a / (2 T)` and :math:`a / ((1 - \beta) T)`.

    A whole loop over `span` takes 1/rate. Smaller loops are run at the same speed, which keeps
    slope and current, until they would repeat more often than `highest_frequency_hz` or five times
    the rate.
    """

    shape: str
    """``smooth``, ``sine`` or ``triangle``."""
    span: float
    """Voltage that a major loop goes over [V]."""
    sample_rate_hz: float
    """Samples in a second [Hz]."""
    slope_limit: float = math.inf
    """Largest slope [V/s]; infinite where there is none."""
    turn_time: float = 0.0
    """Time over which the speed of a smooth movement rises or falls, where the movement is long
    enough for it [s].
    """
    highest_frequency_hz: float = math.inf
    """How often a loop may repeat [Hz]."""

    def shortest(self, distance: float) -> float:
        """Return the shortest time that a movement may take by the limit of the slope.

        Examples
        --------
        >>> smooth = Movement(
        ...     shape="smooth", span=120.0, sample_rate_hz=1e4, slope_limit=1000.0, turn_time=0.01
        ... )
        >>> round(smooth.shortest(90.0), 6), round(smooth.shortest(5.0), 6)
        (0.1, 0.01)
        """
        least = distance / self.slope_limit
        if self.shape == "triangle":
            return least
        if self.shape == "sine":
            return 0.5 * math.pi * least
        # T (1 - beta) rises with T; this is its inverse on its three pieces
        return max(least / (1.0 - _SHORTEST_RAMP), min(2.0 * least, least + self.turn_time))

    def highest_rate(self) -> float:
        """Return the highest rate of a major loop [Hz] that the limits allow."""
        time = max(self.shortest(self.span), _FEWEST_SAMPLES / self.sample_rate_hz)
        return min(0.5 / time, self.highest_frequency_hz)

    def count(self, distance: float, rate_hz: float) -> int:
        """Return the steps of a movement over a distance [V], of major loops of a rate [Hz]."""
        if distance == 0.0:
            return 0
        often = min(_MOST_OFTEN * rate_hz, max(rate_hz, self.highest_frequency_hz))
        time = max(distance / self.span / (2.0 * rate_hz), 0.5 / often, self.shortest(distance))
        # a whole number of steps: every turning point is a sample, and is reached
        return max(math.ceil(time * self.sample_rate_hz * (1.0 - 1e-12)), _FEWEST_SAMPLES)

    def samples(self, start: float, end: float, count: int) -> Array:
        """Return the voltages of a movement after its start, `count` of them."""
        s = np.arange(1, count + 1) / count
        if self.shape == "sine":
            s = 0.5 * (1.0 - np.cos(np.pi * s))
        elif self.shape == "smooth":
            share = self.turn_time * self.sample_rate_hz / count if count else 0.0
            s = _smooth(s, min(max(share, _SHORTEST_RAMP), 0.5))
        values = start + (end - start) * s
        values[-1:] = end
        return values


def _smooth(s: Array, ramp: float) -> Array:
    """Way covered at the time s, both as shares, with ramps of speed over the share `ramp`."""
    # by symmetry the second half is the first one backwards
    t = np.minimum(s, 1.0 - s)
    rising = 0.5 * t - ramp / (2.0 * np.pi) * np.sin(np.pi * np.minimum(t, ramp) / ramp)
    way = np.where(t < ramp, rising, t - 0.5 * ramp) / (1.0 - ramp)
    return np.where(s <= 0.5, way, 1.0 - way)


def multisine(band_hz: tuple[float, float], time: float, sample_rate_hz: float, seed: int) -> Array:
    """Return a sum of sines of equal size in a band, which begins and ends at rest.

    The phases are random, the best of 32 draws for a low crest factor, so that the energy in the
    band is large for the peak. The signal fades in and out over a tenth of its time. Its sines
    are ``1 / time`` apart; it begins one step after the start, has a peak of 1, and ends with 0.

    Examples
    --------
    >>> x = multisine((120.0, 560.0), 0.5, 8000.0, 3)
    >>> x.size, float(abs(x).max())
    (4000, 1.0)
    """
    low, high = band_hz
    lines = np.arange(math.ceil(low * time), math.floor(high * time) + 1)
    if not 0.0 < low < high or lines.size == 0:
        raise ModelError(f"a band of frequencies must rise from above 0 Hz, got {low:g}:{high:g}")
    if high > 0.2 * sample_rate_hz:
        raise ModelError(
            f"frequencies up to {high:g} Hz need a sample rate of at least {5.0 * high:g} Hz, got "
            f"{sample_rate_hz:g} Hz: raise it, or leave the resonance out"
        )
    n = math.ceil(time * sample_rate_hz)
    edge = np.minimum(np.arange(1, n + 1), n - np.arange(1, n + 1)) / (0.1 * n)
    fade = 0.5 * (1.0 - np.cos(np.pi * np.minimum(edge, 1.0)))
    rng = np.random.default_rng(seed)
    # a draw on few points an oscillation is enough to compare crests
    spectrum = np.zeros(n // 2 + 1, dtype=np.complex128)
    best: Array | None = None
    for _ in range(32):
        spectrum[lines] = np.exp(2j * np.pi * rng.random(lines.size))
        draw = np.fft.irfft(spectrum, n) * fade
        draw /= np.abs(draw).max()
        if best is None or np.sum(draw**2) > np.sum(best**2):
            best = draw
    assert best is not None
    return best
