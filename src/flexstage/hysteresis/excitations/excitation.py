"""A drive record for identification, its parts, and the part of a memory that it looks at."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from flexstage.errors import ModelError
from flexstage.hysteresis.model import Array, samples
from flexstage.records.record import Channel, Record


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
class Excitation:
    """A drive record for identification, and what it asks of the amplifier."""

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
