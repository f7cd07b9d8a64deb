"""Tables of waveforms, and how a waveform runs: straight lines between samples, cycle by cycle."""

from dataclasses import dataclass

import numpy as np

from flexstage.arrays import Array
from flexstage.instruments.pi.simulated.device import Refusal, RefusedError, require


class WaveTables:
    """The memory of a wave generator: tables, and a capacity [samples] over all of them."""

    def __init__(self, count: int, capacity: int) -> None:
        self.count, self.capacity = count, capacity
        self._samples: dict[int, Array] = {}

    def clear(self) -> None:
        """Empty every table."""
        self._samples.clear()

    def known(self, table: int) -> int:
        """Return the number of a table, from 1; refuse one that there is not."""
        require(
            1 <= table <= self.count,
            Refusal.UNKNOWN,
            f"there is no wave table {table}: they are 1 to {self.count}",
        )
        return table

    def samples(self, table: int) -> Array:
        """Return the samples of a table, not to be written to; none of an empty one."""
        return self._samples.get(self.known(table), _EMPTY)

    def replace(self, table: int, samples: Array) -> None:
        """Replace the samples of a table; none clear it."""
        self.known(table)
        new = np.array(samples, dtype=np.float64).reshape(-1)
        bad = np.flatnonzero(~np.isfinite(new))
        if bad.size:
            raise RefusedError(
                Refusal.BAD_VALUE,
                f"sample {bad[0] + 1} of wave table {table} is {new[bad[0]]}: it must be finite",
            )
        others = sum(held.size for number, held in self._samples.items() if number != table)
        require(
            others + new.size <= self.capacity,
            Refusal.TABLE_FULL,
            f"{new.size} samples do not fit into wave table {table}: {self.capacity - others} "
            f"of {self.capacity} are free",
        )
        new.flags.writeable = False
        self._samples[table] = new


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


_EMPTY = np.zeros(0)
_EMPTY.flags.writeable = False
