"""Tables of a simulated controller: records of signals and hammer impacts, and waveforms.

A waveform interpolates the samples of a table linearly, cycle by cycle.
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

    A record starts with the sample after its trigger, contains every d-th sample, and continues
    until the tables are full, even after the end of the waveform that started it. It can be read
    while it runs. A trigger starts one record, and must be armed again for each.
    """

    def __init__(self, count: int, capacity: int) -> None:
        self.count, self.capacity = count, capacity
        self.clear()

    def clear(self) -> None:
        """Delete the record and its configuration."""
        #: Signal of each table.
        self.signals: dict[int, Signal] = {}
        self._recorded: dict[int, Signal] = {}
        self._data: dict[int, Array] = {}
        self._impact: dict[int, Array] = {}
        self.divider = self._recorded_divider = 1
        self._armed: Trigger | None = None
        self._by: Trigger | None = None
        self._first = 0
        self._filled = 0
        self._length = 0

    @property
    def recorded(self) -> int:
        """Number of recorded samples of each table."""
        return self._filled

    @property
    def recording(self) -> bool:
        """Whether it runs."""
        return self._filled < self._length

    def known(self, table: int) -> int:
        """Return the number of a table, from 1; refuse an unknown one."""
        require(1 <= table <= self.count, Refusal.UNKNOWN)
        return table

    def signal(self, table: int) -> Signal | None:
        """Return the signal of a table; None for none."""
        return self.signals.get(self.known(table))

    def choose(self, table: int, signal: Signal | None) -> None:
        """Select the signal of a table, from the next trigger."""
        self.signals.pop(self.known(table), None)
        if signal is not None:
            self.signals[table] = signal

    def set_divider(self, divider: int) -> None:
        """Set the rate, from the next trigger."""
        require(divider >= 1, Refusal.BAD_VALUE)
        self.divider = divider

    def arm(self, trigger: Trigger) -> None:
        """Wait for a trigger; a running record ends."""
        self._length = self._filled
        self._armed = trigger

    def trigger(
        self, what: Trigger, sample: int, impact: Callable[[str, str], Array] | None = None
    ) -> None:
        """Start with this sample of the loop if the recorder is armed for this trigger.

        `impact` returns samples of an impact, at the rate of the record, by kind and source of the
        signal.
        """
        if self._armed != what:
            return
        self._armed, self._by = None, what
        self._first, self._filled = sample, 0
        self._recorded, self._recorded_divider = dict(self.signals), self.divider
        self._length = self.capacity if self._recorded else 0
        self._data = {table: np.zeros(self._length) for table in self._recorded}
        self._impact = {}
        if impact is not None:
            impacts = {
                table: impact(s.kind, s.source)
                for table, s in self._recorded.items()
                if _of_impact(s)
            }
            self._length = min([self._length, *(v.size for v in impacts.values())])
            self._impact = impacts

    def end(self, by: Trigger | None = None) -> None:
        """End a running record; with `by`, only a record with this trigger."""
        if by is None or by == self._by:
            self._length = self._filled

    def take(self, first: int, count: int, values: Callable[[Signal], Array]) -> None:
        """Store samples of the loop, from number `first`, in a running record."""
        if not self.recording:
            return
        d = self._recorded_divider
        start = self._first + self._filled * d - first
        new = min(len(range(start, count, d)), self._length - self._filled)
        if not new:
            return
        to = slice(self._filled, self._filled + new)
        for table, signal in self._recorded.items():
            if table in self._impact:
                self._data[table][to] = self._impact[table][to]
            elif not _of_impact(signal):
                self._data[table][to] = values(signal)[start : start + (new - 1) * d + 1 : d]
        self._filled += new

    def read(self, table: int, first: int, count: int) -> Array:
        """Return samples of a table, from number `first`, counted from 0."""
        require(self.known(table) in self._data, Refusal.UNKNOWN)
        require(first >= 0 and count >= 0 and first + count <= self._filled, Refusal.BAD_VALUE)
        return self._data[table][first : first + count].copy()


def _of_impact(signal: Signal) -> bool:
    return signal.kind in ("force", "response")


def resampled(values: Array, from_hz: float, to_hz: float) -> Array:
    """Return a decaying record at another rate, by its Fourier series, from the same first sample.

    Notes
    -----
    The content below half of both rates is unchanged, and above it is removed. Validity: a record
    that does not start and end at 0 rings at its ends.

    Examples
    --------
    >>> t = np.arange(512) / 512.0
    >>> pulse = np.exp(-0.5 * ((t - 0.4) / 0.02) ** 2)
    >>> finer = resampled(pulse, 512.0, 800.0)
    >>> finer.size, round(float(finer[320]), 6)
    (800, 1.0)
    """
    ratio = Fraction(to_hz / from_hz).limit_denominator(10**5)
    # an integer number of periods at both rates, by zeros after the record
    padded = np.zeros(-(-values.size // ratio.denominator) * ratio.denominator)
    padded[: values.size] = values
    size = padded.size * ratio.numerator // ratio.denominator
    spectrum = np.fft.rfft(padded)
    spectrum_out = np.zeros(size // 2 + 1, dtype=np.complex128)
    below = (min(padded.size, size) + 1) // 2  # lines below both Nyquist frequencies
    spectrum_out[:below] = spectrum[:below]
    out = np.fft.irfft(spectrum_out, n=size) * (size / padded.size)
    return out[: max(1, int(values.size * ratio))]


class WaveTables:
    """The memory of a wave generator: tables with a common capacity [samples]."""

    def __init__(self, count: int, capacity: int) -> None:
        self.count, self.capacity = count, capacity
        #: Appended parts, which are joined when they are read, and their numbers of samples.
        self._parts: dict[int, list[Array]] = {}
        self._sizes: dict[int, int] = {}

    def clear(self) -> None:
        """Empty every table."""
        self._parts.clear()
        self._sizes.clear()

    def known(self, table: int) -> int:
        """Return the number of a table, from 1; refuse an unknown one."""
        require(1 <= table <= self.count, Refusal.UNKNOWN)
        return table

    def samples(self, table: int) -> Array:
        """Return the samples of a table, read-only; empty for an empty table."""
        parts = self._parts.get(self.known(table), [_EMPTY])
        if len(parts) > 1:
            parts[:] = [_fixed(np.concatenate(parts))]
        return parts[0]

    def size(self, table: int) -> int:
        """Return the number of samples of a table."""
        return self._sizes.get(self.known(table), 0)

    def room(self, table: int) -> int:
        """Return the largest possible number of samples of a table."""
        return self.capacity - sum(self._sizes.values()) + self._sizes.get(table, 0)

    def replace(self, table: int, samples: Array) -> None:
        """Replace the samples of a table; an empty array clears it."""
        new = self._checked(table, samples, 0)
        self._parts[table], self._sizes[table] = [new], new.size

    def append(self, table: int, samples: Array) -> None:
        """Append samples to a table, in a time that does not depend on its size."""
        present = self.size(table)
        new = self._checked(table, samples, present)
        self._parts.setdefault(table, []).append(new)
        self._sizes[table] = present + new.size

    def _checked(self, table: int, samples: Array, present: int) -> Array:
        """Return samples that may follow the present number of samples."""
        self.known(table)
        new = np.array(samples, dtype=np.float64).reshape(-1)
        require(np.isfinite(new).all(), Refusal.BAD_VALUE)
        require(present + new.size <= self.room(table), Refusal.TABLE_FULL)
        return _fixed(new)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class WaveRun:
    """A running waveform.

    A table of L samples with a divider d has L d samples of the loop per cycle. Interpolation is
    linear between its samples, and from the last one to the first of the next cycle; the last cycle
    ends with its last sample, which is held.

    Examples
    --------
    >>> run = WaveRun(first=7, table=np.array([0.0, 1.0, 4.0]), divider=2, cycles=2)
    >>> run.values(7, 13)
    array([0. , 0.5, 1. , 2.5, 4. , 2. , 0. , 0.5, 1. , 2.5, 4. , 4. , 4. ])
    >>> run.last
    18
    """

    first: int
    """Number of its first sample of the loop."""
    table: Array
    """Samples [m, or V], shape (L,)."""
    divider: int
    """Samples of the loop for one of the table."""
    cycles: int
    """Number of cycles; 0 for endless."""
    feedforward: Array | None = None
    """Feedforward voltages [V], shape (L,); they end with the waveform."""
    shift: float = 0.0
    """Shift of each cycle from the previous one [m, or V]."""

    @property
    def end(self) -> float:
        """Last value of the last cycle [m, or V]."""
        return float(self.table[-1]) + self.shift * max(self.cycles - 1, 0)

    @property
    def last(self) -> int | None:
        """Number of its last sample of the loop; None if it is endless."""
        if not self.cycles:
            return None
        return self.first + self.cycles * self.table.size * self.divider - 1

    def running(self, sample: int) -> bool:
        """Return whether it still runs."""
        last = self.last
        return last is None or sample < last

    def values(self, first: int, count: int) -> Array:
        """Return values [m, or V] at samples of the loop, from `first`, not before the start."""
        return self._along(self.table, first, count, self.shift)

    def voltages(self, first: int, count: int) -> Array:
        """Return feedforward voltages [V], like `values`; NaN where there are none."""
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
