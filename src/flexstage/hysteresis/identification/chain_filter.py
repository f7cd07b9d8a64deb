"""What the linear chain makes of the columns of a model."""

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from flexstage.arrays import Array
from flexstage.errors import ModelError
from flexstage.hysteresis.chain.creep import Creep, CreepSpectrum, LogCreep
from flexstage.hysteresis.chain.lag import Lag
from flexstage.hysteresis.chain.stage_modes import StageModes
from flexstage.hysteresis.compiled import compiled
from flexstage.hysteresis.drive_model import creep_start
from flexstage.hysteresis.identification.measurement import IdentificationData, Section

#: Samples that a fit looks at, at most; the models themselves see every sample.
_MOST_ROWS = 30_000
#: Samples of the columns that are filtered at once, which bounds the memory.
_BLOCK = 4_000_000


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
    """Part of the motion that goes through the mode; the rest follows at once [1]."""
    creep_shortest: float = 0.01
    """Time at which creep begins [s]."""
    creep_longest: float = 1000.0
    """Time at which creep ends [s]."""
    spectrum: CreepSpectrum | None = None
    """Time constants of the creep and their weights, which `creep_per_decade` scales; those that go
    with the logarithm of time where not given.
    """

    def __post_init__(self) -> None:
        for name in ("delay", "creep_per_decade", "resonance_hz"):
            value = getattr(self, name)
            if not (value >= 0.0 and math.isfinite(value)):
                raise ModelError(
                    f"the {name} of a chain must be finite and not negative, got {value:g}"
                )

    @property
    def creep(self) -> Creep:
        """The creep as an element of the chain."""
        if self.spectrum is not None:
            return self.spectrum.scaled(self.creep_per_decade)
        return LogCreep(
            rate_per_decade=self.creep_per_decade,
            shortest=self.creep_shortest,
            longest=self.creep_longest,
            per_decade=1,
        )

    @property
    def lag(self) -> Lag:
        """The delay as an element of the chain."""
        return Lag(delay=self.delay)

    @property
    def modes(self) -> StageModes | None:
        """The resonance as an element of the chain; None where there is none."""
        if self.resonance_hz == 0.0:
            return None
        return StageModes(
            frequency_hz=(self.resonance_hz,),
            damping_ratio=(self.damping_ratio,),
            share=(self.resonance_share,),
        )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Rows:
    """The samples of a section that a fit looks at."""

    at: NDArray[np.intp]
    """Samples, shape (r,)."""
    cycle: NDArray[np.intp]
    """Number of the cycle that each lies in, shape (r,)."""


def rows_of(data: IdentificationData, most: int = _MOST_ROWS) -> tuple[Rows, ...]:
    """Choose the samples that a fit looks at, `most` of all: after the warm-up, evenly thinned."""
    total = sum(s.u.size - s.warm_up for s in data.sections)
    every = max(1, -(-total // most))
    chosen = []
    for s in data.sections:
        at = np.arange(s.warm_up, s.u.size, every)
        for stands in (s.straight, s.measured):
            at = at if stands is None else at[stands[at]]
        # rows before the first and after the last cycle belong to their neighbour
        cycle = np.searchsorted(s.cycles.bounds, at, side="right")
        cycle = np.clip(cycle, 1, max(s.cycles.swing.size, 1))
        chosen.append(Rows(at=at, cycle=cycle))
    return tuple(chosen)


def filtered(columns: Array, section: Section, rows: Rows, chain: ChainValues) -> Array:
    """Pass quasi-static columns, shape (n, m), through the chain, to the rows, shape (r, m)."""
    # what stands for the time before the record is memory, and no motion
    columns, first = columns[section.history :], rows.at - section.history
    n, m = columns.shape
    behind = np.empty((m, first.size))
    at = np.clip(first - chain.delay / section.dt, 0.0, n - 1.0)
    before = np.minimum(at.astype(np.intp), n - 2)
    share = np.asarray(at - before, dtype=np.float64)
    for block in _blocks(n, m):
        # column by column, as they lie in memory
        part = np.ascontiguousarray(columns[:, block].T)
        if chain.creep_per_decade > 0.0 or chain.resonance_hz > 0.0:
            part = _dynamic(part, section, chain)
        _between(part, before, share, behind[block])
    return behind.T


def _blocks(n: int, m: int) -> Iterator[slice]:
    width = max(1, _BLOCK // n)
    for start in range(0, m, width):
        yield slice(start, min(start + width, m))


def _dynamic(columns: Array, section: Section, chain: ChainValues) -> Array:
    """What creep and modes make of columns, each of them in a row, shape (m, n)."""
    dt, modes = section.dt, chain.modes
    if chain.creep_per_decade > 0.0:
        creep = chain.creep
        starts = creep_start(creep, columns, dt, section.start)
        columns = creep.simulate_rows(columns, dt, starts)
    if modes is not None:
        columns = np.array([modes.simulate(column, dt).values for column in columns])
    return columns


@compiled
def _between(rows: Array, before: NDArray[np.intp], share: Array, out: Array) -> None:
    """Read rows between samples, on straight lines."""
    for j in range(rows.shape[0]):
        for k in range(before.size):
            low = rows[j, before[k]]
            out[j, k] = low + share[k] * (rows[j, before[k] + 1] - low)
