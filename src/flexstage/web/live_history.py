"""Hours of samples in little memory: the newest as they came, all by least and greatest."""

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

#: What a stage at the bench is read in.
VOLTAGE = Quantity("voltage", "V", "Voltage", "V", 1.0)
POSITION = Quantity("position", "m", "Position", "µm", 1e6)

#: Points of a channel in a window: more than a screen is wide.
POINTS = 2000

_SAMPLES = 2**16  # samples that are kept as they came
_BINS = 2**18  # of the finest tier at most
_FACTOR = 4  # from one tier to the next
_FEWEST = 64  # bins of the coarsest tier, about


@dataclass(frozen=True, slots=True)
class LiveChannel:
    """A channel of a history."""

    name: str
    """What it is called on the page."""
    quantity: Quantity
    """What its values are, in its `unit`; channels of one quantity share a panel."""


@dataclass(frozen=True, slots=True, kw_only=True)
class HistoryWindow:
    """What a history holds of a while: samples, or bins with their least and greatest value."""

    tier: int
    """0 for samples, 1 and up for longer and longer bins, -n for every n-th sample."""
    step: float
    """Length of a bin, 0 for samples [s]."""
    times: Array
    """Times of samples, or of the middles of bins, shape (n,) [s]."""
    low: Array
    """Least value, shape (n, channels)."""
    high: Array
    """Greatest value; of samples the same array."""


@dataclass(eq=False)
class _Tier:
    """Least and greatest values in bins of one length; new ones take the places of old ones."""

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
        kept = slice(max(numbers.size - self.count, 0), None)
        places = numbers[kept] % self.count
        self.numbers[places] = numbers[kept]
        self.low[places], self.high[places] = low[kept], high[kept]

    def between(self, begin: float, end: float) -> tuple[Array, Array, Array]:
        """Return middles, least and greatest of the bins that have a part between two times."""
        first = max(math.floor(begin / self.step), self.newest - self.count + 1, 0)
        last = min(math.floor(end / self.step), self.newest)
        numbers = np.arange(first, last + 1)
        places = numbers % self.count
        held = self.numbers[places] == numbers
        places = places[held]
        middles = (numbers[held].astype(np.float64) + 0.5) * self.step
        return middles, self.low[places], self.high[places]


class LiveHistory:
    """What channels read over hours, for pages that show windows of it; any thread may use it.

    The newest 65 536 samples stay as they came. Of all others the least and the greatest value in
    bins of some lengths are kept, so that a window of any length has enough points and no more.

    Parameters
    ----------
    channels
        What is read, by different names.
    rate_hz
        How often, about [Hz].
    hours
        How much is kept [h].

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
        # by which pages ask for it
        self.key = secrets.token_hex(8)
        # of the points that a page has already
        self.generation = secrets.randbits(32)
        self._lock = threading.Lock()
        width, step = len(self.channels), max(_FACTOR / self.rate_hz, self.seconds / _BINS)
        # twice as long as what is kept: what stands in the second half moves to the first at times
        self._times = np.empty(2 * _SAMPLES)
        self._values = np.empty((2 * _SAMPLES, width))
        self._filled = self._total = 0
        self._origin = 0.0
        self._tiers: list[_Tier] = []
        while not self._tiers or self.seconds / step > _FEWEST:
            self._tiers.append(_Tier(step, math.ceil(self.seconds / step) + 1, width))
            step *= _FACTOR

    def append(self, times_s: ArrayLike, values: ArrayLike) -> None:
        """Take samples.

        Parameters
        ----------
        times_s
            Their times, rising and after all before, shape (n,) [s].
        values
            Their values, shape (n, channels); NaN where a channel has none.

        Raises
        ------
        ModelError
            They are not of these shapes, or go back in time.
        """
        times = np.atleast_1d(np.asarray(times_s, dtype=np.float64))
        read = np.asarray(values, dtype=np.float64)
        shape = (times.size, len(self.channels))
        if times.ndim != 1 or read.shape != shape:
            raise ModelError(f"samples of a history have shape {shape}, got {read.shape}")
        if not times.size:
            return
        with self._lock:
            last = self._times[self._filled - 1] if self._filled else -math.inf
            if not (np.isfinite(times).all() and times[0] > last and (np.diff(times) > 0.0).all()):
                raise ModelError(
                    f"times of samples rise: {times[0]:g} s to {times[-1]:g} s came after "
                    f"{last:g} s"
                )
            if not self._total:
                self._origin = float(times[0])
            self._total += times.size
            for tier in self._tiers:
                tier.add(times - self._origin, read)
            self._keep(times[-_SAMPLES:], read[-_SAMPLES:])

    def _keep(self, times: Array, values: Array) -> None:
        if self._filled + times.size > 2 * _SAMPLES:
            rest = _SAMPLES - times.size
            kept = slice(self._filled - rest, self._filled)
            self._times[:rest], self._values[:rest] = self._times[kept], self._values[kept]
            self._filled = rest
        new = slice(self._filled, self._filled + times.size)
        self._times[new], self._values[new] = times, values
        self._filled = new.stop

    @property
    def span(self) -> tuple[float, float] | None:
        """Times of the first sample that ever came and of the newest [s]; None where none came."""
        with self._lock:
            return (self._origin, float(self._times[self._filled - 1])) if self._filled else None

    @property
    def newest(self) -> Array:
        """Values of the newest sample, NaN where none came."""
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
        """Return samples where they are few enough and still kept, or else bins.

        Parameters
        ----------
        begin, end
            Between which times [s].
        points
            How many of a channel at most.
        known
            A tier, and the time after which points of it are wanted, for one who has those before.
        """
        points = max(points, _FEWEST)
        with self._lock:
            held = self._held(begin, end)
            few = max((end - begin) * self.rate_hz, held.stop - held.start) <= points
            whole = self._total <= _SAMPLES or self._times[self._first] <= begin
            if few and whole:
                if known is not None and known[0] == 0:
                    held = self._held(max(begin, np.nextafter(known[1], math.inf)), end)
                return self._samples(held, 0, 1)
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
        """Return the samples between two times that are still kept; of many every n-th."""
        with self._lock:
            every = 1
            if points is not None:
                held = self._held(begin, end)
                most = max((end - begin) * self.rate_hz, held.stop - held.start)
                every = max(math.ceil(most / points), 1)
            held = self._held(max(begin, np.nextafter(after, math.inf)), end)
            return self._samples(held, -every, every)

    @property
    def _first(self) -> int:
        return max(self._filled - _SAMPLES, 0)

    def _held(self, begin: float, end: float) -> slice:
        times = self._times[self._first : self._filled]
        first, last = np.searchsorted(times, begin), np.searchsorted(times, end, side="right")
        return slice(self._first + int(first), self._first + int(max(first, last)))

    def _samples(self, held: slice, tier: int, every: int) -> HistoryWindow:
        # always the same ones of all that ever came, whatever the window
        skipped = -(self._total - self._filled + held.start) % every
        taken = slice(held.start + skipped, held.stop, every)
        values = self._values[taken].copy()
        return HistoryWindow(
            tier=tier, step=0.0, times=self._times[taken].copy(), low=values, high=values
        )
