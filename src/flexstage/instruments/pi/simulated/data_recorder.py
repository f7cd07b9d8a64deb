"""The recorder of a simulated controller: signals of the loop, and blows, in tables."""

from collections.abc import Callable
from fractions import Fraction
from typing import Literal

import numpy as np

from flexstage.arrays import Array
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
        self._kept: dict[int, Signal] = {}
        self._data: dict[int, Array] = {}
        self._blow: dict[int, Array] = {}
        self.divider = self._kept_divider = 1
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
        require(
            1 <= table <= self.count,
            Refusal.UNKNOWN,
            f"there is no record table {table}: they are 1 to {self.count}",
        )
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
        require(
            divider >= 1,
            Refusal.BAD_VALUE,
            f"a record takes every sample or fewer, got a rate of {divider}",
        )
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
        self._kept, self._kept_divider = dict(self.signals), self.divider
        self._length = self.capacity if self._kept else 0
        self._data = {table: np.zeros(self._length) for table in self._kept}
        self._blow = {}
        if blow is not None:
            given = {table: blow(s.kind, s.source) for table, s in self._kept.items() if _struck(s)}
            self._length = min([self._length, *(v.size for v in given.values())])
            self._blow = given

    def end(self, by: Trigger | None = None) -> None:
        """End a recording that runs; only one that was started by this, where it is given."""
        if by is None or by == self._by:
            self._length = self._filled

    def take(self, first: int, count: int, values: Callable[[Signal], Array]) -> None:
        """Keep what belongs to a recording that runs, of the loop's samples from `first` on."""
        if not self.recording:
            return
        d = self._kept_divider
        start = self._first + self._filled * d - first
        new = min(len(range(start, count, d)), self._length - self._filled)
        if not new:
            return
        to = slice(self._filled, self._filled + new)
        for table, signal in self._kept.items():
            if table in self._blow:
                self._data[table][to] = self._blow[table][to]
            elif not _struck(signal):
                self._data[table][to] = values(signal)[start : start + (new - 1) * d + 1 : d]
        self._filled += new

    def read(self, table: int, first: int, count: int) -> Array:
        """Return samples of a table, from number `first`, counted from 0."""
        require(
            self.known(table) in self._data,
            Refusal.UNKNOWN,
            f"record table {table} has recorded nothing",
        )
        require(
            first >= 0 and count >= 0 and first + count <= self._filled,
            Refusal.BAD_VALUE,
            f"{count} samples from number {first} on are not there: {self._filled} are recorded",
        )
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
    kept = np.zeros(size // 2 + 1, dtype=np.complex128)
    below = (min(padded.size, size) + 1) // 2  # what is below both Nyquist frequencies
    kept[:below] = spectrum[:below]
    out = np.fft.irfft(kept, n=size) * (size / padded.size)
    return out[: max(1, int(values.size * ratio))]
