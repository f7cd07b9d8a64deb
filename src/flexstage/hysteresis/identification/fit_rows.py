"""Rows of a fit: samples of records or means of them, and columns behind the linear chain."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from flexstage.base.arrays import Array
from flexstage.hysteresis.chain.creep import Creep, CreepSpectrum, LogCreep, creep_start
from flexstage.hysteresis.chain.lag import Lag
from flexstage.hysteresis.chain.stage_modes import StageModes
from flexstage.hysteresis.compiled import compiled
from flexstage.hysteresis.identification.cycles import RecordSection
from flexstage.hysteresis.identification.measurement import (
    with_history,
    without_history,
)
from flexstage.hysteresis.model import checked
from flexstage.records.quality import difference_noise

#: Largest deviation of a signal from straight lines between means, over its range, rms, ...
_STRAIGHT = 3e-4
#: ... and over its noise. Other means are omitted from fits, up to this share.
_NOISE = 3.0
_OMITTED = 0.04
#: Largest error of means at turning points of the input, over its range, rms, without its noise.
_BLUNT = 3e-4
#: Largest number of rows of a fit; the models are simulated at every sample.
_MOST_ROWS = 30_000
#: Parts of a period that take the place of cycles.
_PERIOD_PARTS = 10
#: Number of values that are filtered at once, which limits the memory.
_BLOCK = 4_000_000


def averaged(section: RecordSection, most: int, loose: float = 1.0) -> RecordSection:
    """Average neighbouring samples of a long record.

    Input and output are averaged in the same way, which changes neither a linear chain nor a delay;
    white noise falls with the square root of the number of samples. Where input or output deviate
    from straight lines between means, as in sharp turns, jumps and tones, the hysteresis of a mean
    is not the mean of the hysteresis: those means are omitted from fits. Blocks are short enough
    that they are few, and that turning points remain. `loose` is a factor on these limits. The
    section is returned unchanged if it is short enough, too fast, or one period.
    """
    if section.measured is not None or section.periodic:
        return section
    measured = without_history(section)
    every = -(-measured.u.size // most)
    noise = difference_noise(measured.u, 3), measured.noise
    while every >= 2:
        means = _means(measured, every, noise, loose)
        if means is not None:
            return with_history(means) if section.history else means
        every = min(every - 1, int(0.8 * every))
    return section


def _means(
    section: RecordSection, every: int, noise: tuple[float, float], loose: float
) -> RecordSection | None:
    """Section of means; None if they do not represent the motion."""
    u, y = (_blocks(x, every).mean(axis=1) for x in (section.u, section.y))
    straight = np.ones(u.size, dtype=bool)
    for values, means, noise_rms in zip((section.u, section.y), (u, y), noise, strict=True):
        bound = (loose * _STRAIGHT * np.ptp(values)) ** 2 + (_NOISE * noise_rms) ** 2
        straight &= _bend(values, means, every) <= bound
    if np.mean(~straight) > _OMITTED:
        return None
    # the line to a wrong mean is wrong for its neighbours as well
    straight[1:-1] &= straight[2:] & straight[:-2]
    turning = section.cycles.turning
    bound = loose * _BLUNT * float(np.ptp(section.u)) + _NOISE * noise[0]
    if _blunting(section.u, u, turning, every) > bound:
        return None
    moves = section.cycles
    nuisance = [_blocks(c, every).mean(axis=1) for c in section.nuisance.T]
    return replace(
        section,
        u=u,
        y=y,
        dt=section.dt * every,
        cycles=replace(moves, bounds=moves.bounds // every, turning=moves.turning // every),
        warm_up=-(-section.warm_up // every),
        nuisance=np.column_stack(nuisance),
        noise=section.noise / np.sqrt(every),
        straight=straight,
    )


def _blocks(values: Array, every: int) -> Array:
    """Values in rows of neighbours, without the last ones, which fill no row."""
    count = values.size // every
    return values[: count * every].reshape(count, every)


def _bend(values: Array, means: Array, every: int) -> Array:
    """Mean square distance of each block from straight lines between the means of neighbours."""
    place = (np.arange(every) + 0.5) / every - 0.5
    before = np.concatenate((2.0 * means[:1] - means[1:2], means[:-1]))
    after = np.concatenate((means[1:], 2.0 * means[-1:] - means[-2:-1]))
    square = np.zeros(means.size)
    for position, column in zip(place, _blocks(values, every).T, strict=True):
        other = before if position < 0.0 else after
        square += (column - means - abs(position) * (other - means)) ** 2
    return square / every


def _blunting(u: Array, means: Array, turning: NDArray[np.intp], every: int) -> float:
    """Error of the means at the turning points, rms."""
    at = np.clip(turning // every, 1, means.size - 2)
    if at.size == 0 or means.size < 3:
        return 0.0
    near = np.stack((means[at - 1], means[at], means[at + 1]))
    return float(np.sqrt(np.mean(np.min(np.abs(near - u[turning]), axis=0) ** 2)))


@dataclass(frozen=True, slots=True, kw_only=True)
class ChainValues:
    """Values of the linear chain behind a hysteresis model."""

    delay: float = 0.0
    """Delay of the output against the input [s]."""
    creep_per_decade: float = 0.0
    """Log-type creep, over the step, in each decade of time [1]."""
    resonance_hz: float = 0.0
    """Frequency of the lowest mode in the output [Hz]; 0 for none."""
    damping_ratio: float = 0.02
    """Its damping ratio [1]."""
    resonance_share: float = 1.0
    """Share of the motion through the mode; the rest follows without delay [1]."""
    creep_longest: float = 1000.0
    """Time at which creep ends [s]."""
    spectrum: CreepSpectrum | None = None
    """Time constants of the creep and their weights, which `creep_per_decade` scales; logarithmic
    creep where not given.
    """

    def __post_init__(self) -> None:
        for name in ("delay", "creep_per_decade", "resonance_hz"):
            checked(getattr(self, name), f"{name} of a chain", "finite and not negative")

    def with_lag(self, time: float) -> "ChainValues":
        """Return the chain with one lag of unit weight, of a time constant [s], as its creep."""
        lag = CreepSpectrum(times=(time,), weights=(1.0,))
        return replace(self, spectrum=lag, creep_per_decade=lag.rate_per_decade)

    @property
    def creep(self) -> Creep:
        """The creep as an element of the chain."""
        if self.spectrum is not None:
            return self.spectrum.scaled(self.creep_per_decade)
        return LogCreep(
            rate_per_decade=self.creep_per_decade,
            longest=self.creep_longest,
            per_decade=1,
        )

    @property
    def lag(self) -> Lag:
        """The delay as an element of the chain."""
        return Lag(delay=self.delay)

    @property
    def modes(self) -> StageModes | None:
        """The resonance as an element of the chain; None for none."""
        if self.resonance_hz == 0.0:
            return None
        return StageModes(
            frequency_hz=(self.resonance_hz,),
            damping_ratio=(self.damping_ratio,),
            share=(self.resonance_share,),
        )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Rows:
    """Samples of a section that are used in a fit."""

    at: NDArray[np.intp]
    """Samples, shape (r,)."""
    cycle: NDArray[np.intp]
    """Number of the cycle of each, shape (r,)."""


def rows_of(sections: Sequence[RecordSection], most: int = _MOST_ROWS) -> tuple[Rows, ...]:
    """Select at most `most` samples for a fit: after the warm-up, uniformly thinned."""
    total = sum(s.u.size - s.warm_up for s in sections)
    every = max(1, -(-total // most))
    rows = []
    for s in sections:
        stop = s.u.size - s.periodic  # without the copy of the first sample
        at = np.arange(s.warm_up, stop, every)
        for mask in (s.straight, s.measured):
            at = at if mask is None else at[mask[at]]
        # rows before the first and after the last cycle belong to their neighbour
        cycle = np.searchsorted(s.cycles.bounds, at, side="right")
        cycle = np.clip(cycle, 1, max(s.cycles.swing.size, 1))
        if s.periodic:  # parts of the only period are held out: its copies would be no evidence
            cycle = 1 + (at - s.warm_up) * _PERIOD_PARTS // (stop - s.warm_up)
        rows.append(Rows(at=at, cycle=cycle))
    return tuple(rows)


def filtered(columns: Array, section: RecordSection, rows: Rows, chain: ChainValues) -> Array:
    """Pass quasi-static columns, shape (n, m), through the chain, to the rows, shape (r, m)."""
    # samples before the record set the memory, and are no motion
    columns, first = columns[section.history :], rows.at - section.history
    n, m = columns.shape
    behind = np.empty((m, first.size))
    at = first - chain.delay / section.dt
    at = at % (n - 1.0) if section.periodic else np.clip(at, 0.0, n - 1.0)
    before = np.minimum(at.astype(np.intp), n - 2)
    share = np.asarray(at - before, dtype=np.float64)
    width = max(1, _BLOCK // n)
    for block in (slice(start, start + width) for start in range(0, m, width)):
        # column by column, in the order of memory
        part = np.ascontiguousarray(columns[:, block].T)
        if chain.creep_per_decade > 0.0 or chain.resonance_hz > 0.0:
            part = _dynamic(part, section, chain)
        _between(part, before, share, behind[block])
    return behind.T


def filtered_samples(columns: Array, section: RecordSection, chain: ChainValues) -> Array:
    """Pass quasi-static columns, shape (n, m), through the chain, to every sample."""
    at = np.arange(columns.shape[0])
    return filtered(columns, section, Rows(at=at, cycle=at), chain)


def _dynamic(columns: Array, section: RecordSection, chain: ChainValues) -> Array:
    """Pass columns through creep and modes, each column in a row, shape (m, n)."""
    dt, modes = section.dt, chain.modes
    if chain.creep_per_decade > 0.0:
        creep = chain.creep
        starts = creep_start(creep, columns, dt, section.start)
        columns = creep.simulate_rows(columns, dt, starts)
    if modes is not None:
        n = columns.shape[1]
        if section.periodic:  # ringing fades within a period
            columns = np.concatenate((columns[:, :-1], columns), axis=1)
        columns = np.array([modes.simulate(column, dt).values[-n:] for column in columns])
    return columns


@compiled
def _between(rows: Array, before: NDArray[np.intp], share: Array, out: Array) -> None:
    """Interpolate rows between samples, linearly."""
    for j in range(rows.shape[0]):
        for k in range(before.size):
            low = rows[j, before[k]]
            out[j, k] = low + share[k] * (rows[j, before[k] + 1] - low)
