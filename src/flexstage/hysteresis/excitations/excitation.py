"""Drive record for identification: its movements, its parts, and its coverage of the memory."""

import math
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from flexstage.base.errors import ModelError
from flexstage.files.plain import picked
from flexstage.files.result import Result
from flexstage.hysteresis.excitations.segments import ExcitationSegment
from flexstage.hysteresis.model import Array, samples
from flexstage.records.record import Channel, Record


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
            f"{sample_rate_hz:g} Hz: raise it, or omit the resonance"
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
    """Part of a drive record."""

    name: str
    """Its name."""
    first: int
    """Its first sample."""
    last: int
    """The sample after its last one."""
    start: float
    """Time of its first sample [s]."""
    duration: float
    """Its duration [s]."""
    rate_hz: float
    """Rate of a major loop at its speed [Hz]."""
    voltage_range: tuple[float, float]
    """Lowest and highest voltage in it [V]."""
    turning_points: int
    """Number of turning points."""
    largest_slope: float
    """Largest change of voltage between two samples, over the time between them [V/s]."""

    @classmethod
    def of(
        cls, segment: ExcitationSegment, voltage: Array, first: int, sample_rate_hz: float
    ) -> "ExcitationPart":
        """Describe a segment by its samples, with the one before it."""
        steps = np.diff(voltage)
        directions = np.sign(steps[steps != 0.0])
        return cls(
            name=segment.name,
            first=first + 1,
            last=first + voltage.size,
            start=first / sample_rate_hz,
            duration=steps.size / sample_rate_hz,
            rate_hz=segment.rate_hz,
            voltage_range=(float(voltage.min()), float(voltage.max())),
            turning_points=int(np.count_nonzero(np.diff(directions))),
            largest_slope=float(np.abs(steps).max()) * sample_rate_hz,
        )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Excitation(Result):
    """Drive record for identification, and its demands on the amplifier."""

    table_key: ClassVar[str] = "parts"

    time: Array
    """Time of each sample [s], shape (n,)."""
    voltage: Array
    """Command voltage [V], shape (n,)."""
    parts: tuple[ExcitationPart, ...]
    """Its parts, in order."""
    shape: str
    """Shape of the movements."""
    sample_rate_hz: float
    """Sample rate [Hz]."""
    sampled_for: str
    """Requirement that determines the sample rate; empty if it was given."""
    rates_hz: tuple[float, ...]
    """Rates of the major loops [Hz]."""
    rest_voltage: float
    """Voltage at which it starts and ends [V]."""
    largest_slope: float
    """Largest change of voltage between two samples, over the time between them [V/s]."""
    largest_current: float | None
    """The same times the capacitance [A]; None without a capacitance."""
    rms_current: float | None
    """Root mean square of the current [A]."""
    coverage: float
    """Share of the cells of threshold and mean that are set in motion one by one, of
    `memory_coverage` [1].
    """
    omitted: tuple[str, ...]
    """Parts that did not fit into the time."""
    warnings: tuple[str, ...]
    """Quantities that the record does not determine, and changes of the request."""

    stage: str | None = None
    """Name of the stage, if one was given."""
    axis: str | None = None
    """Its axis."""
    natural_frequency_hz: float | None = None
    """Lowest natural frequency of the stage, if its model has one [Hz]."""

    def data(self) -> dict[str, Any]:
        return {
            **picked(self, "stage", "axis", "natural_frequency_hz", "shape", "sample_rate_hz"),
            "sampled_for": self.sampled_for or None,
            **picked(self, "samples=time.size", "duration", "rates_hz"),
            "voltage_range": [float(self.voltage.min()), float(self.voltage.max())],
            **picked(self, "rest_voltage", "largest_slope", "largest_current", "rms_current"),
            **picked(self, "coverage", "parts", "omitted", "warnings"),
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
    r"""Return the cells of threshold and mean that a drive signal moves one by one.

    Since the input turned at :math:`u_r`, all plays with thresholds below
    :math:`r = |u - u_r| / 2` move. As u continues, the play with threshold r begins to move, from
    the mean :math:`s = (u + u_r) / 2`, and the slope of the output changes by its weight there:
    by the Preisach density at (r, s) (Mayergoyz 1991, section 1.2: the second derivative of the
    reversal curves). A cell is covered if such a front has passed it. A front that meets an
    earlier turning point continues from the one before that (wiping-out).

    Parameters
    ----------
    u : array_like
        Drive signal [V], shape (n,), or its turning points.
    cells : int
        Number of cells K between threshold zero and half of the range.

    Returns
    -------
    numpy.ndarray
        True for covered cells, False for others and outside the triangle
        ``|s - middle| <= range / 2 - r``, shape (K, 2 K): row by threshold, column by mean. There
        are ``K (K + 1)`` cells in the triangle.

    Raises
    ------
    ModelError
        The signal is no finite sequence, does not move, or `cells` is not positive.

    Notes
    -----
    Validity: coverage, not accuracy: a cell counts once, at any rate and any noise. Motion before
    the signal is unknown, so that its first movement does not count.

    Examples
    --------
    A major loop covers the edges of the triangle alone:

    >>> covered = memory_coverage([0.0, 120.0, 0.0, 120.0, 0.0])
    >>> int(covered.sum()), 16 * 17
    (32, 272)
    """
    turning = _turning(samples(u, "drive signal"))
    if cells < 1:
        raise ModelError(f"a grid of memory needs at least one cell, got {cells}")
    low, high = float(turning.min()), float(turning.max())
    if not high > low:
        raise ModelError(f"the drive signal must move, got {low:g} throughout")
    x = (turning - low) / (high - low)
    moved = np.zeros((cells, 2 * cells), dtype=np.bool_)
    extremes: list[float] = []
    for start, end in zip(x[:-1].tolist(), x[1:].tolist(), strict=True):
        for base, a, b in _fronts(extremes, start, end):
            _mark(moved, base, a, b)
        extremes.append(end)
    return moved


def _turning(u: Array) -> Array:
    """Return the first value, every turning point, and the last value."""
    moved = u[np.concatenate(([True], np.diff(u) != 0.0))]
    turns = np.flatnonzero(np.diff(np.sign(np.diff(moved))) != 0) + 1
    return moved[np.unique(np.concatenate(([0], turns, [moved.size - 1])))]


def _fronts(extremes: list[float], start: float, end: float) -> list[tuple[float, float, float]]:
    """Move from start to end; return turning point, beginning and end of each piece of the front.

    The list `extremes` has the turning points in memory, the last of them `start`; those that the
    movement wipes out are removed.
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


def _mark(cells: NDArray[np.bool_], base: float, a: float, b: float) -> None:
    k = cells.shape[0]
    n = max(int(np.ceil(abs(b - a) * 16 * k)), 1)
    u = a + (b - a) * (np.arange(n) + 0.5) / n
    row = np.minimum((np.abs(u - base) * k).astype(np.intp), k - 1)
    column = np.clip(((u + base) * k).astype(np.intp), row, 2 * k - 1 - row)
    cells[row, column] = True
