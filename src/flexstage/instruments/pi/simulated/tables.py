"""The tables of a simulated controller: records of its signals and of blows, and waveforms.

A waveform runs along straight lines between the samples of a table, cycle by cycle.
"""

from collections.abc import Callable
from dataclasses import dataclass
from fractions import Fraction
from typing import Literal

import numpy as np

from flexstage.base.arrays import Array
from flexstage.instruments.pi.simulated.device import Refusal, require
from flexstage.instruments.protocol import Signal

Trigger = Literal["wave", "move", "now"]


class DataRecorder:
    """Tables that record signals of the loop.

    A recording begins with the sample after its trigger, takes every d-th sample as it is, and goes
    on until the tables are full, also when the waveform that started it has ended. What is read may
    be read while it goes on. A trigger starts one recording: it is armed anew for each.
    """

    def __init__(self, count: int, capacity: int) -> None:
        self.count, self.capacity = count, capacity
        self.clear()

    def clear(self) -> None:
        """Forget what was recorded and what was to be recorded."""
        #: What each table is to record, and samples of the loop for one of a record.
        self.signals: dict[int, Signal] = {}
        self._recorded: dict[int, Signal] = {}
        self._data: dict[int, Array] = {}
        self._blow: dict[int, Array] = {}
        self.divider = self._recorded_divider = 1
        self._armed: Trigger | None = None
        self._by: Trigger | None = None
        self._first = 0
        self._filled = 0
        self._length = 0

    @property
    def recorded(self) -> int:
        """Samples of each table that are there."""
        return self._filled

    @property
    def recording(self) -> bool:
        """Whether it runs."""
        return self._filled < self._length

    def known(self, table: int) -> int:
        """Return the number of a table, from 1; refuse one that there is not."""
        require(1 <= table <= self.count, Refusal.UNKNOWN)
        return table

    def signal(self, table: int) -> Signal | None:
        """Return what a table records; None for nothing."""
        return self.signals.get(self.known(table))

    def choose(self, table: int, signal: Signal | None) -> None:
        """Choose what a table records, from the next trigger on."""
        self.signals.pop(self.known(table), None)
        if signal is not None:
            self.signals[table] = signal

    def set_divider(self, divider: int) -> None:
        """Choose the rate, from the next trigger on."""
        require(divider >= 1, Refusal.BAD_VALUE)
        self.divider = divider

    def arm(self, trigger: Trigger) -> None:
        """Wait for a trigger; a recording that runs is ended."""
        self._length = self._filled
        self._armed = trigger

    def trigger(
        self, what: Trigger, sample: int, blow: Callable[[str, str], Array] | None = None
    ) -> None:
        """Start with this sample of the loop if it was armed for what happens.

        `blow` gives samples of a blow, at the rate of the record, by kind and source of the signal.
        """
        if self._armed != what:
            return
        self._armed, self._by = None, what
        self._first, self._filled = sample, 0
        self._recorded, self._recorded_divider = dict(self.signals), self.divider
        self._length = self.capacity if self._recorded else 0
        self._data = {table: np.zeros(self._length) for table in self._recorded}
        self._blow = {}
        if blow is not None:
            impacts = {
                table: blow(s.kind, s.source) for table, s in self._recorded.items() if _struck(s)
            }
            self._length = min([self._length, *(v.size for v in impacts.values())])
            self._blow = impacts

    def end(self, by: Trigger | None = None) -> None:
        """End a recording that runs; only one that was started by this, where it is given."""
        if by is None or by == self._by:
            self._length = self._filled

    def take(self, first: int, count: int, values: Callable[[Signal], Array]) -> None:
        """Keep what belongs to a recording that runs, of the loop's samples from `first` on."""
        if not self.recording:
            return
        d = self._recorded_divider
        start = self._first + self._filled * d - first
        new = min(len(range(start, count, d)), self._length - self._filled)
        if not new:
            return
        to = slice(self._filled, self._filled + new)
        for table, signal in self._recorded.items():
            if table in self._blow:
                self._data[table][to] = self._blow[table][to]
            elif not _struck(signal):
                self._data[table][to] = values(signal)[start : start + (new - 1) * d + 1 : d]
        self._filled += new

    def read(self, table: int, first: int, count: int) -> Array:
        """Return samples of a table, from number `first`, counted from 0."""
        require(self.known(table) in self._data, Refusal.UNKNOWN)
        require(first >= 0 and count >= 0 and first + count <= self._filled, Refusal.BAD_VALUE)
        return self._data[table][first : first + count].copy()


def _struck(signal: Signal) -> bool:
    return signal.kind in ("force", "response")


def resampled(values: Array, from_hz: float, to_hz: float) -> Array:
    """Return a decaying record at another rate, by its Fourier series; the first sample stays.

    Notes
    -----
    What lies below half of both rates is kept as it is, and what lies above is left out. Validity:
    a record that does not begin and end at 0 rings at its ends.

    Examples
    --------
    >>> t = np.arange(512) / 512.0
    >>> pulse = np.exp(-0.5 * ((t - 0.4) / 0.02) ** 2)
    >>> finer = resampled(pulse, 512.0, 800.0)
    >>> finer.size, round(float(finer[320]), 6)
    (800, 1.0)
    """
    ratio = Fraction(to_hz / from_hz).limit_denominator(10**5)
    # whole periods at both rates: zeros behind the record
    padded = np.zeros(-(-values.size // ratio.denominator) * ratio.denominator)
    padded[: values.size] = values
    size = padded.size * ratio.numerator // ratio.denominator
    spectrum = np.fft.rfft(padded)
    spectrum_out = np.zeros(size // 2 + 1, dtype=np.complex128)
    below = (min(padded.size, size) + 1) // 2  # what is below both Nyquist frequencies
    spectrum_out[:below] = spectrum[:below]
    out = np.fft.irfft(spectrum_out, n=size) * (size / padded.size)
    return out[: max(1, int(values.size * ratio))]


class WaveTables:
    """The memory of a wave generator: tables, and a capacity [samples] over all of them."""

    def __init__(self, count: int, capacity: int) -> None:
        self.count, self.capacity = count, capacity
        #: What was appended, to be joined when it is read, and how many samples that is.
        self._parts: dict[int, list[Array]] = {}
        self._sizes: dict[int, int] = {}

    def clear(self) -> None:
        """Empty every table."""
        self._parts.clear()
        self._sizes.clear()

    def known(self, table: int) -> int:
        """Return the number of a table, from 1; refuse one that there is not."""
        require(1 <= table <= self.count, Refusal.UNKNOWN)
        return table

    def samples(self, table: int) -> Array:
        """Return the samples of a table, not to be written to; none of an empty one."""
        parts = self._parts.get(self.known(table), [_EMPTY])
        if len(parts) > 1:
            parts[:] = [_fixed(np.concatenate(parts))]
        return parts[0]

    def size(self, table: int) -> int:
        """Return how many samples a table has."""
        return self._sizes.get(self.known(table), 0)

    def room(self, table: int) -> int:
        """Return how many samples a table can have beside the others."""
        return self.capacity - sum(self._sizes.values()) + self._sizes.get(table, 0)

    def replace(self, table: int, samples: Array) -> None:
        """Replace the samples of a table; none clear it."""
        new = self._checked(table, samples, 0)
        self._parts[table], self._sizes[table] = [new], new.size

    def append(self, table: int, samples: Array) -> None:
        """Add samples to those of a table; the time that it takes does not grow with these."""
        present = self.size(table)
        new = self._checked(table, samples, present)
        self._parts.setdefault(table, []).append(new)
        self._sizes[table] = present + new.size

    def _checked(self, table: int, samples: Array, present: int) -> Array:
        """Return samples that may stand behind those that are held."""
        self.known(table)
        new = np.array(samples, dtype=np.float64).reshape(-1)
        require(np.isfinite(new).all(), Refusal.BAD_VALUE)
        require(present + new.size <= self.room(table), Refusal.TABLE_FULL)
        return _fixed(new)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class WaveRun:
    """A waveform that runs.

    A table of L samples at a divider d takes L d samples of the loop a cycle. Straight lines join
    its samples, and the last one to the first of the next cycle; the last cycle ends with its last
    sample, which is held.

    Examples
    --------
    >>> run = WaveRun(first=7, table=np.array([0.0, 1.0, 4.0]), divider=2, cycles=2)
    >>> run.values(7, 13)
    array([0. , 0.5, 1. , 2.5, 4. , 2. , 0. , 0.5, 1. , 2.5, 4. , 4. , 4. ])
    >>> run.last
    18
    """

    first: int
    """Number of the loop's sample with which it begins."""
    table: Array
    """Samples [m, or V], shape (L,)."""
    divider: int
    """Samples of the loop for one of the table."""
    cycles: int
    """How often it runs; 0 for endlessly."""
    feedforward: Array | None = None
    """Voltages beside it [V], shape (L,); they end with the waveform."""
    shift: float = 0.0
    """How much further each cycle begins than the one before [m, or V]."""

    @property
    def end(self) -> float:
        """Last value of the last cycle [m, or V]."""
        return float(self.table[-1]) + self.shift * max(self.cycles - 1, 0)

    @property
    def last(self) -> int | None:
        """Number of the last sample of the loop that belongs to it; None if it runs endlessly."""
        if not self.cycles:
            return None
        return self.first + self.cycles * self.table.size * self.divider - 1

    def running(self, sample: int) -> bool:
        """Say whether it still runs."""
        last = self.last
        return last is None or sample < last

    def values(self, first: int, count: int) -> Array:
        """Return values [m, or V] at samples of the loop, from `first`, not before its own."""
        return self._along(self.table, first, count, self.shift)

    def voltages(self, first: int, count: int) -> Array:
        """Return voltages [V] beside it, as `values`; NaN where there are none."""
        if self.feedforward is None:
            return np.full(count, np.nan)
        values = self._along(self.feedforward, first, count)
        if self.last is not None:
            values[max(self.last + 1 - first, 0) :] = np.nan
        return values

    def _along(self, table: Array, first: int, count: int, shift: float = 0.0) -> Array:
        size, d = table.size, self.divider
        k = np.arange(first - self.first, first - self.first + count)
        i = k // d
        if self.cycles:
            i = np.minimum(i, self.cycles * size - 1)  # the last sample of the last cycle is held
        value = table[i % size] + shift * (i // size)
        if d == 1:
            return value
        j = i + 1 if not self.cycles else np.minimum(i + 1, self.cycles * size - 1)
        after = table[j % size] + shift * (j // size)
        return value + (after - value) * (k % d / d)


def _fixed(samples: Array) -> Array:
    samples.flags.writeable = False
    return samples


_EMPTY = _fixed(np.zeros(0))
