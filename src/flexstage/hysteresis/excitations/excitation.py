"""A drive record for identification: how it moves, its parts, and what it sees of a memory."""

import math
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from flexstage.base.errors import ModelError
from flexstage.files.plain import picked
from flexstage.files.result import Result
from flexstage.hysteresis.model import Array, samples
from flexstage.records.record import Channel, Record

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


@dataclass(frozen=True, slots=True, kw_only=True)
class ExcitationPart:
    """One part of a drive record."""

    name: str
    """What it is."""
    first: int
    """Its first sample."""
    last: int
    """The sample after its last one."""
    start: float
    """Time of its first sample [s]."""
    duration: float
    """How long it takes [s]."""
    rate_hz: float
    """Rate of a major loop at its speed [Hz]."""
    voltage_range: tuple[float, float]
    """Lowest and highest voltage in it [V]."""
    turning_points: int
    """How often it turns."""
    largest_slope: float
    """Largest change of voltage between two samples, over the time between them [V/s]."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Excitation(Result):
    """A drive record for identification, and what it asks of the amplifier."""

    table_key: ClassVar[str] = "parts"

    time: Array
    """Time of each sample [s], shape (n,)."""
    voltage: Array
    """Command voltage [V], shape (n,)."""
    parts: tuple[ExcitationPart, ...]
    """What is run when."""
    shape: str
    """Shape of the movements."""
    sample_rate_hz: float
    """Samples in a second [Hz]."""
    sampled_for: str
    """What the sample rate was chosen for; empty where it was given."""
    rates_hz: tuple[float, ...]
    """Rates of the major loops [Hz]."""
    rest_voltage: float
    """Voltage at which it starts and ends [V]."""
    largest_slope: float
    """Largest change of voltage between two samples, over the time between them [V/s]."""
    largest_current: float | None
    """The same times the capacitance [A]; None where that is not given."""
    rms_current: float | None
    """Root mean square of the current [A]."""
    coverage: float
    """Share of the cells of threshold and mean that are set in motion one by one, of
    `memory_coverage` [1].
    """
    left_out: tuple[str, ...]
    """What did not fit into the time."""
    warnings: tuple[str, ...]
    """What the record cannot tell, and what was changed."""

    stage: str | None = None
    """Name of the stage that it is for, where one was given."""
    axis: str | None = None
    """Its axis."""
    natural_frequency_hz: float | None = None
    """Lowest natural frequency of the stage, where its model says it [Hz]."""

    def data(self) -> dict[str, Any]:
        return {
            **picked(self, "stage", "axis", "natural_frequency_hz", "shape", "sample_rate_hz"),
            "sampled_for": self.sampled_for or None,
            **picked(self, "samples=time.size", "duration", "rates_hz"),
            "voltage_range": [float(self.voltage.min()), float(self.voltage.max())],
            **picked(self, "rest_voltage", "largest_slope", "largest_current", "rms_current"),
            **picked(self, "coverage", "parts", "left_out", "warnings"),
        }

    @property
    def duration(self) -> float:
        """Time from the first to the last sample [s]."""
        return float(self.time[-1])

    def record(self) -> Record:
        """Return the drive signal as a record of one channel, ``voltage``."""
        channel = Channel(name="voltage", values=self.voltage, unit="V")
        return Record(channels=(channel,), time=self.time, source="flexstage excite")


def memory_coverage(u: ArrayLike, cells: int = 16) -> NDArray[np.bool_]:
    r"""Return which cells of threshold and mean a drive signal sets in motion one by one.

    Since the input turned at :math:`u_r`, all plays with thresholds below
    :math:`r = |u - u_r| / 2` move. As u goes on, the play with threshold r begins to move, from
    the mean :math:`s = (u + u_r) / 2`, and the slope of the output changes by its weight there:
    by the Preisach density at (r, s) (Mayergoyz 1991, section 1.2: the second derivative of the
    reversal curves). A cell counts as looked at where such a front has gone through it. A front
    that meets an earlier turning point goes on from the one before that (wiping-out).

    Parameters
    ----------
    u : array_like
        Drive signal [V], shape (n,), or its turning points.
    cells : int
        Number of cells K between threshold zero and half of the range.

    Returns
    -------
    numpy.ndarray
        True where a cell was looked at, False where not or where it lies outside the triangle
        ``|s - middle| <= range / 2 - r``, shape (K, 2 K): row by threshold, column by mean. There
        are ``K (K + 1)`` cells in the triangle.

    Raises
    ------
    ModelError
        The signal is no finite sequence, does not move, or `cells` is not positive.

    Notes
    -----
    Validity: says where a signal looks, and not how exactly: a cell counts once, at any rate and
    any noise. What was before the signal is not known, so its first movement counts for nothing.

    Examples
    --------
    A major loop sees the edges of the triangle alone:

    >>> seen = memory_coverage([0.0, 120.0, 0.0, 120.0, 0.0])
    >>> int(seen.sum()), 16 * 17
    (32, 272)
    """
    turning = _turning(samples(u, "drive signal"))
    if cells < 1:
        raise ModelError(f"a grid of memory needs at least one cell, got {cells}")
    low, high = float(turning.min()), float(turning.max())
    if not high > low:
        raise ModelError(f"the drive signal must move, got {low:g} throughout")
    x = (turning - low) / (high - low)
    seen = np.zeros((cells, 2 * cells), dtype=np.bool_)
    extremes: list[float] = []
    for start, end in zip(x[:-1].tolist(), x[1:].tolist(), strict=True):
        for base, a, b in _fronts(extremes, start, end):
            _mark(seen, base, a, b)
        extremes.append(end)
    return seen


def _turning(u: Array) -> Array:
    """Return the first value, every turning point, and the last value."""
    moved = u[np.concatenate(([True], np.diff(u) != 0.0))]
    turns = np.flatnonzero(np.diff(np.sign(np.diff(moved))) != 0) + 1
    return moved[np.unique(np.concatenate(([0], turns, [moved.size - 1])))]


def _fronts(extremes: list[float], start: float, end: float) -> list[tuple[float, float, float]]:
    """Move from start to end; return turning point, beginning and end of each piece of the front.

    The stack holds the turning points that are remembered, the last of them `start`; those that
    the movement wipes out are taken off.
    """
    pieces: list[tuple[float, float, float]] = []
    sign = 1.0 if end > start else -1.0
    at = start
    while extremes:
        base = extremes[-1]
        limit = extremes[-2] if len(extremes) > 1 else None
        if limit is None or sign * (end - limit) < 0.0:
            pieces.append((base, at, end))
            return pieces
        pieces.append((base, at, limit))
        del extremes[-2:]
        at = limit
    return pieces


def _mark(seen: NDArray[np.bool_], base: float, a: float, b: float) -> None:
    k = seen.shape[0]
    n = max(int(np.ceil(abs(b - a) * 16 * k)), 1)
    u = a + (b - a) * (np.arange(n) + 0.5) / n
    row = np.minimum((np.abs(u - base) * k).astype(np.intp), k - 1)
    column = np.clip(((u + base) * k).astype(np.intp), row, 2 * k - 1 - row)
    seen[row, column] = True
