"""History of live channels over hours: the newest samples, and minima and maxima of all."""

import math
import secrets
import threading
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike

from flexstage.base.arrays import Array, Integers
from flexstage.base.errors import ModelError
from flexstage.quantities.quantity import Quantity

#: Quantities of a stage at the bench.
VOLTAGE = Quantity("voltage", "V", "Voltage", "V", 1.0)
POSITION = Quantity("position", "m", "Position", "µm", 1e6)

#: Largest number of points of a channel in a window: more than the pixels of a screen.
POINTS = 2000

_SAMPLES = 2**16  # number of newest samples in the history
_BINS = 2**18  # largest number of bins, in the finest tier
_FACTOR = 4  # ratio of the bin lengths of two tiers
_FEWEST = 64  # approximate number of bins of the coarsest tier


@dataclass(frozen=True, slots=True)
class LiveChannel:
    """A channel of a history."""

    name: str
    """Name on the page."""
    quantity: Quantity
    """Quantity of the values, in its `unit`; channels of one quantity share a panel."""


@dataclass(frozen=True, slots=True, kw_only=True)
class HistoryWindow:
    """A time window of a history: samples, or bins with their minimum and maximum."""

    tier: int
    """0 for samples, 1 and above for bins of increasing length, -n for every n-th sample."""
    step: float
    """Length of a bin [s]; 0 for samples."""
    times: Array
    """Times of samples or of bin centres, shape (n,) [s]."""
    low: Array
    """Minimum, shape (n, channels)."""
    high: Array
    """Maximum; for samples the same array as `low`."""


@dataclass(eq=False)
class _Tier:
    """Ring buffer of minima and maxima in bins of one length."""

    step: float
    count: int
    channels: int
    newest: int = -1
    numbers: Integers = field(init=False)
    low: Array = field(init=False)
    high: Array = field(init=False)

    def __post_init__(self) -> None:
        self.numbers = np.full(self.count, -1, dtype=np.intp)
        self.low = np.full((self.count, self.channels), np.nan)
        self.high = self.low.copy()

    def add(self, elapsed: Array, values: Array) -> None:
        of_sample = np.floor(elapsed / self.step).astype(np.intp)
        starts = np.flatnonzero(np.diff(of_sample, prepend=-1))
        numbers = of_sample[starts]
        low = np.fmin.reduceat(values, starts, axis=0)
        high = np.fmax.reduceat(values, starts, axis=0)
        if numbers[0] == self.newest:
            place = self.newest % self.count
            low[0] = np.fmin(low[0], self.low[place])
            high[0] = np.fmax(high[0], self.high[place])
        self.newest = int(numbers[-1])
        newest_bins = slice(max(numbers.size - self.count, 0), None)
        places = numbers[newest_bins] % self.count
        self.numbers[places] = numbers[newest_bins]
        self.low[places], self.high[places] = low[newest_bins], high[newest_bins]

    def between(self, begin: float, end: float) -> tuple[Array, Array, Array]:
        """Return centres, minima and maxima of the bins that overlap a time interval."""
        first = max(math.floor(begin / self.step), self.newest - self.count + 1, 0)
        last = min(math.floor(end / self.step), self.newest)
        numbers = np.arange(first, last + 1)
        places = numbers % self.count
        is_valid = self.numbers[places] == numbers
        places = places[is_valid]
        middles = (numbers[is_valid].astype(np.float64) + 0.5) * self.step
        return middles, self.low[places], self.high[places]


class LiveHistory:
    """Values of channels over hours, for pages that show windows; it is safe for threads.

    The history has the newest 65 536 samples, and the minimum and maximum of all samples in bins
    of several lengths. A window of any length therefore has enough points and no more.

    Parameters
    ----------
    channels
        The channels, with different names.
    rate_hz
        Approximate sample rate [Hz].
    hours
        Length of the history [h].

    Examples
    --------
    >>> history = LiveHistory([LiveChannel("x", POSITION)], rate_hz=100.0)
    >>> t = np.arange(360_000) / 100.0
    >>> history.append(t, 1e-6 * np.sin(t)[:, None])
    >>> hour = history.window(0.0, 3600.0)
    >>> hour.times.size, f"{hour.high.max():.3e}", history.window(3590.0, 3600.0).times.size
    (1407, '1.000e-06', 1000)
    """

    def __init__(self, channels: Sequence[LiveChannel], rate_hz: float, hours: float = 2.0) -> None:
        self.channels = tuple(channels)
        self.rate_hz = rate_hz
        self.seconds = 3600.0 * hours
        # key of the history in requests of pages
        self.key = secrets.token_hex(8)
        # tag of the points that a page has already
        self.generation = secrets.randbits(32)
        self._lock = threading.Lock()
        width, step = len(self.channels), max(_FACTOR / self.rate_hz, self.seconds / _BINS)
        # twice the retained length: a full buffer moves its second half to the first
        self._times = np.empty(2 * _SAMPLES)
        self._values = np.empty((2 * _SAMPLES, width))
        self._filled = self._total = 0
        self._origin = 0.0
        self._tiers: list[_Tier] = []
        while not self._tiers or self.seconds / step > _FEWEST:
            self._tiers.append(_Tier(step, math.ceil(self.seconds / step) + 1, width))
            step *= _FACTOR

    def append(self, times_s: ArrayLike, values: ArrayLike) -> None:
        """Append samples.

        Parameters
        ----------
        times_s
            Times, increasing and later than all earlier ones, shape (n,) [s].
        values
            Values, shape (n, channels); NaN for a channel without value.

        Raises
        ------
        ModelError
            The shapes are wrong, or the times do not increase.
        """
        times = np.atleast_1d(np.asarray(times_s, dtype=np.float64))
        samples = np.asarray(values, dtype=np.float64)
        shape = (times.size, len(self.channels))
        if times.ndim != 1 or samples.shape != shape:
            raise ModelError(f"samples of a history have shape {shape}, got {samples.shape}")
        if not times.size:
            return
        with self._lock:
            last = self._times[self._filled - 1] if self._filled else -math.inf
            if not (np.isfinite(times).all() and times[0] > last and (np.diff(times) > 0.0).all()):
                raise ModelError(
                    f"times of samples must increase: {times[0]:g} s to {times[-1]:g} s came after "
                    f"{last:g} s"
                )
            if not self._total:
                self._origin = float(times[0])
            self._total += times.size
            for tier in self._tiers:
                tier.add(times - self._origin, samples)
            self._keep(times[-_SAMPLES:], samples[-_SAMPLES:])

    def _keep(self, times: Array, values: Array) -> None:
        if self._filled + times.size > 2 * _SAMPLES:
            length = _SAMPLES - times.size
            source = slice(self._filled - length, self._filled)
            self._times[:length], self._values[:length] = self._times[source], self._values[source]
            self._filled = length
        new = slice(self._filled, self._filled + times.size)
        self._times[new], self._values[new] = times, values
        self._filled = new.stop

    @property
    def span(self) -> tuple[float, float] | None:
        """Times of the first and the newest sample [s]; None without samples."""
        with self._lock:
            return (self._origin, float(self._times[self._filled - 1])) if self._filled else None

    @property
    def newest(self) -> Array:
        """Values of the newest sample; NaN without samples."""
        with self._lock:
            if not self._filled:
                return np.full(len(self.channels), np.nan)
            return self._values[self._filled - 1].copy()

    def window(
        self,
        begin: float,
        end: float,
        points: int = POINTS,
        *,
        known: tuple[int, float] | None = None,
    ) -> HistoryWindow:
        """Return samples if they are few enough and still available, else bins.

        Parameters
        ----------
        begin, end
            Interval of time [s].
        points
            Largest number of points of a channel.
        known
            Tier and newest time of the points that the caller has: only later points are returned.
        """
        points = max(points, _FEWEST)
        with self._lock:
            available = self._slice(begin, end)
            is_short = max((end - begin) * self.rate_hz, available.stop - available.start) <= points
            is_complete = self._total <= _SAMPLES or self._times[self._first] <= begin
            if is_short and is_complete:
                if known is not None and known[0] == 0:
                    available = self._slice(max(begin, np.nextafter(known[1], math.inf)), end)
                return self._samples(available, 0, 1)
            level, tier = next(
                (level, tier)
                for level, tier in enumerate(self._tiers, start=1)
                if tier is self._tiers[-1] or (end - begin) / tier.step <= points
            )
            if known is not None and known[0] == level:
                begin = max(begin, known[1] + 0.75 * tier.step)
            times, low, high = tier.between(begin - self._origin, end - self._origin)
            return HistoryWindow(
                tier=level, step=tier.step, times=times + self._origin, low=low, high=high
            )

    def samples(
        self, begin: float, end: float, points: int | None = None, *, after: float = -math.inf
    ) -> HistoryWindow:
        """Return the available samples of a time interval; of many, every n-th."""
        with self._lock:
            every = 1
            if points is not None:
                window = self._slice(begin, end)
                count = max((end - begin) * self.rate_hz, window.stop - window.start)
                every = max(math.ceil(count / points), 1)
            window = self._slice(max(begin, np.nextafter(after, math.inf)), end)
            return self._samples(window, -every, every)

    @property
    def _first(self) -> int:
        return max(self._filled - _SAMPLES, 0)

    def _slice(self, begin: float, end: float) -> slice:
        times = self._times[self._first : self._filled]
        first, last = np.searchsorted(times, begin), np.searchsorted(times, end, side="right")
        return slice(self._first + int(first), self._first + int(max(first, last)))

    def _samples(self, window: slice, tier: int, every: int) -> HistoryWindow:
        # the same samples in every window
        skipped = -(self._total - self._filled + window.start) % every
        selected = slice(window.start + skipped, window.stop, every)
        values = self._values[selected].copy()
        return HistoryWindow(
            tier=tier, step=0.0, times=self._times[selected].copy(), low=values, high=values
        )
