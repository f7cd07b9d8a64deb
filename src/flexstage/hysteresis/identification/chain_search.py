"""The linear chain behind a hysteresis that is not known yet."""

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares, minimize, minimize_scalar

from flexstage.hysteresis.identification.averaging import averaged
from flexstage.hysteresis.identification.chain_filter import ChainValues, Rows, filtered, rows_of
from flexstage.hysteresis.identification.families.family import (
    Data,
    behind_chain,
    equations,
    residual,
)
from flexstage.hysteresis.identification.families.preisach import PreisachFamily
from flexstage.hysteresis.identification.measurement import Measurement, Section
from flexstage.hysteresis.identification.projection import solve
from flexstage.hysteresis.identification.resonance_search import Resonance, find_resonance

__all__ = ["FoundChain", "find_chain", "used_rows"]

Array = NDArray[np.float64]

#: Plays and intervals of the dictionary that stands for any hysteresis.
_DICTIONARY = (8, 8)
#: Rows that the search looks at.
_ROWS = 4000
#: Samples of a record that the search works with.
_SAMPLES = 25_000
#: Longest delay that is looked for, as a share of the shortest cycle.
_LONGEST_DELAY = 0.08
#: Largest creep that is looked for [1 per decade].
_LARGEST_CREEP = 0.12
#: A resonance is looked for where the fastest cycles are slower than it by at most this factor, ...
_FARTHEST_RESONANCE = 60.0
#: ... and it is kept where it takes this share of the misfit away.
_WORTH = 0.02
#: Smoothing of the model that a mode is polished behind: that of records with some noise.
_POLISHED_SMOOTHING = 3e-7
#: It is followed at all where a coarse look at it takes this share away.
_GLIMPSE = 0.002


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FoundChain:
    """The chain that explains a measurement best, whatever its hysteresis.

    Parameters
    ----------
    values : ChainValues
        The chain.
    searched : tuple of str
        The values that were found, and not given.
    rms : float
        Misfit that is left with a coarse dictionary, over the stroke [1].
    resonance : Resonance or None
        The resonance, where a part of a record was made to show it.
    """

    values: ChainValues
    searched: tuple[str, ...]
    rms: float
    resonance: Resonance | None = None


def find_chain(
    data: Measurement,
    given: ChainValues | None = None,
    *,
    train: tuple[int, int] | None = None,
    resonance: tuple[float, float] | None = None,
) -> FoundChain:
    """Find delay, creep and resonance by projection over a dictionary of hysteresis.

    A small Preisach model stands for any hysteresis. For each chain its best density follows from
    non-negative least squares, and the misfit is a function of the chain alone.

    Parameters
    ----------
    data : Measurement
        The measurement.
    given : ChainValues, optional
        A chain that is known; nothing is searched for then.
    train : tuple of int, optional
        First sample to look at, and the one after the last, of every record; all where not given.
    resonance : tuple of float, optional
        Frequency [Hz] and damping ratio of a mode that is known, as from a model of the stage.

    Returns
    -------
    FoundChain
        The chain.

    Examples
    --------
    >>> import numpy as np
    >>> from flexstage.hysteresis.identification import measurement
    >>> from flexstage.records import Channel, Record
    >>> t = np.arange(4000) / 200.0
    >>> def drive(t):
    ...     return 60.0 - (60.0 - 2.0 * t) * np.cos(2.0 * np.pi * t)
    >>> u, y = Channel(name="u", values=drive(t)), Channel(name="y", values=drive(t - 0.007))
    >>> found = find_chain(measurement([Record(channels=(u, y), time=t)], "u", "y"))
    >>> round(found.values.delay, 3)
    0.007
    """
    search = _Search(data, train)
    longest = max(10.0 * s.u.size * s.dt for s in data.sections)
    start = ChainValues(creep_longest=max(1000.0, longest))
    if given is not None:
        return FoundChain(values=given, searched=(), rms=search.rms(given))
    if resonance is not None:
        start = replace(start, resonance_hz=resonance[0], damping_ratio=resonance[1])
        search.fix_modes(start)
    seen = _seen(data, train) if resonance is None else None
    if seen is not None:
        start = replace(
            start,
            resonance_hz=seen.frequency_hz,
            damping_ratio=seen.damping_ratio,
            delay=seen.delay,
        )
        search.fix_modes(start)
        if math.isfinite(seen.delay_error):
            best = _creep(search, start)
            return FoundChain(
                values=best, searched=("creep_per_decade",), rms=search.rms(best), resonance=seen
            )
    most = _LONGEST_DELAY / max(*data.rates_hz, 1e-9) if data.rates_hz else 0.0
    best = _delay_and_creep(search, start, most)
    searched: tuple[str, ...] = ("delay", "creep_per_decade")
    rms = search.rms(best)
    if seen is not None:
        best, error = _polished(data, best, train)
        seen = replace(
            seen,
            frequency_hz=best.resonance_hz,
            damping_ratio=best.damping_ratio,
            frequency_error_hz=error,
        )
        return FoundChain(values=best, searched=searched, rms=search.rms(best), resonance=seen)
    rung = _resonance(search, best, data, most) if resonance is None else None
    if rung is not None and search.rms(rung) < (1.0 - _WORTH) * rms:
        return FoundChain(values=rung, searched=(*searched, "resonance_hz"), rms=search.rms(rung))
    return FoundChain(values=best, searched=searched, rms=rms)


def _seen(data: Measurement, train: tuple[int, int] | None) -> Resonance | None:
    """The best determined of the resonances that records show, outside what is held out."""
    looked_at = []
    for s in data.sections:
        part = slice(None)
        if train is not None:
            part = slice(max(train[0] - s.first, 0), max(train[1] - s.first, 0))
        looked_at.append(replace(s, u=s.u[s.history :][part], y=s.y[s.history :][part]))
    found = [r for r in map(find_resonance, looked_at) if r is not None]
    return min(found, key=lambda r: r.frequency_error_hz / r.frequency_hz, default=None)


class _Search:
    """Misfit of a chain, with the best density of a coarse dictionary."""

    def __init__(self, whole: Measurement, train: tuple[int, int] | None) -> None:
        data = replace(whole, sections=tuple(averaged(s, _SAMPLES) for s in whole.sections))
        self._modes_known = False
        rows = rows_of(data, _ROWS)
        use = tuple(
            used_rows(r, s, round(s.dt / w.dt), train)
            for r, s, w in zip(rows, data.sections, whole.sections, strict=True)
        )
        self._data = Data(measurement=data, chain=ChainValues(), rows=rows, use=use)
        family = PreisachFamily(*_DICTIONARY)
        self._columns = [
            np.asfortranarray(np.concatenate(list(family.columns(s, self._data)), axis=1))
            for s in data.sections
        ]
        moving = np.any([np.ptp(c, axis=0) > 0.0 for c in self._columns], axis=0)
        self._penalty = family.smoothing(self._data, moving)
        # creep acts on every column alike: its share of a column is found once
        unit = ChainValues(creep_per_decade=1.0)
        longest = max(1000.0, *(10.0 * s.u.size * s.dt for s in data.sections))
        unit = replace(unit, creep_longest=longest)
        self._creep = [
            np.asfortranarray(_every(c, s, unit) - c)
            for c, s in zip(self._columns, data.sections, strict=True)
        ]

    def fix_modes(self, chain: ChainValues) -> None:
        """Put known modes behind all columns, once."""
        only = replace(chain, creep_per_decade=0.0, delay=0.0)
        sections = self._data.measurement.sections
        for kept in (self._columns, self._creep):
            for i, section in enumerate(sections):
                kept[i] = np.asfortranarray(_every(kept[i], section, only))
        self._modes_known = True

    def rms(self, chain: ChainValues) -> float:
        """Misfit that the best density leaves behind a chain, over the stroke."""
        if self._modes_known:
            chain = replace(chain, resonance_hz=0.0)
        bare = replace(self._data, chain=replace(chain, creep_per_decade=0.0))
        gamma = chain.creep_per_decade
        if chain.resonance_hz > 0.0:
            pairs = zip(self._columns, self._creep, strict=True)
            behind = behind_chain([c + gamma * k for c, k in pairs], bare)
        else:
            # a delay takes samples of both alike, so they need not be added at every sample
            pairs = zip(
                behind_chain(self._columns, bare), behind_chain(self._creep, bare), strict=True
            )
            behind = [c + gamma * k for c, k in pairs]
        normal = equations(behind, bare)
        assert self._penalty is not None
        solution = solve(normal, smoothing=self._penalty * normal.count * bare.input_scale**2)
        left = residual(behind, solution, bare) / bare.measurement.stroke
        return float(np.sqrt(np.mean(left**2)))


def used_rows(
    rows: Rows, section: Section, every: int, train: tuple[int, int] | None
) -> NDArray[np.bool_]:
    """Which rows of an averaged section are looked at: what is held out must not be seen here."""
    if train is None:
        return np.ones(rows.at.size, dtype=bool)
    first = (rows.at - section.history) * every + section.first
    return (first >= train[0]) & (first + every <= train[1])


def _every(columns: Array, section: Section, chain: ChainValues) -> Array:
    at = np.arange(columns.shape[0])
    return filtered(columns, section, Rows(at=at, cycle=at), chain)


def _polished(
    data: Measurement, chain: ChainValues, train: tuple[int, int] | None
) -> tuple[ChainValues, float]:
    """Fit mode and delay behind a full model; give the standard error of the frequency as well.

    Where jumps have made the stage ring, some parts in a thousand of the frequency decide whether
    the model rings along with it or against it.
    """
    rows, error = rows_of(data), math.inf
    pairs = zip(rows, data.sections, strict=True)
    use = tuple(used_rows(r, s, 1, train) for r, s in pairs)
    for _ in range(2):
        whole = Data(measurement=data, chain=chain, rows=rows, use=use)
        model = PreisachFamily(smoothing=_POLISHED_SMOOTHING).fit(whole).model
        quasi = [model.simulate(s.u).values[:, None] for s in data.sections]
        scale = np.array(
            [
                0.01 * chain.resonance_hz,
                0.1 * chain.damping_ratio,
                min(s.dt for s in data.sections),
            ]
        )

        def moved(x: Array, own: ChainValues = chain, scale: Array = scale) -> ChainValues:
            f, damping, delay = (float(v) for v in x * scale)
            return replace(own, resonance_hz=f, damping_ratio=damping, delay=max(delay, 0.0))

        def left(x: Array, own: Data = whole, columns: list[Array] = quasi) -> Array:
            behind = behind_chain(columns, replace(own, chain=moved(x)))
            solution = solve(equations(behind, own))
            return residual(behind, solution, own) / own.measurement.stroke

        # a delay that is a period too long rings along almost as well: look over more than one
        delays = np.append(np.linspace(0.0, 1.25 / chain.resonance_hz, 16), chain.delay)
        starts = [np.array([chain.resonance_hz, chain.damping_ratio, d]) / scale for d in delays]
        begin = min(starts, key=lambda x: float(np.sum(left(x) ** 2)))
        low = np.array([0.8 * begin[0], 0.2 * begin[1], -1.0])
        high = np.array([1.2 * begin[0], 5.0 * begin[1], begin[2] + 20.0])
        found = least_squares(left, begin, bounds=(low, high), diff_step=1e-3, max_nfev=25)
        chain = moved(np.asarray(found.x, dtype=np.float64))
        spread = np.linalg.pinv(found.jac.T @ found.jac)[0, 0] * 2.0 * found.cost / found.fun.size
        error = float(np.sqrt(spread) * scale[0])
    return chain, error


def _creep(search: _Search, start: ChainValues) -> ChainValues:
    """Find the creep where all the rest is known."""
    found: Any = minimize_scalar(
        lambda x: search.rms(replace(start, creep_per_decade=float(x))),
        bounds=(0.0, _LARGEST_CREEP),
        method="bounded",
        options={"xatol": 1e-5},
    )
    return replace(start, creep_per_decade=float(found.x))


def _delay_and_creep(search: _Search, start: ChainValues, longest: float) -> ChainValues:
    def chain(x: Array) -> ChainValues:
        return replace(
            start,
            delay=float(np.clip(x[0], 0.0, 1.0)) * longest,
            creep_per_decade=float(np.clip(x[1], 0.0, 1.0)) * _LARGEST_CREEP,
        )

    def cost(x: Array) -> float:
        outside = float(np.sum(np.maximum(0.0, -x) + np.maximum(0.0, x - 1.0)))
        return search.rms(chain(x)) * (1.0 + outside)

    grid = [np.array([a, b]) for a in (0.0, 0.1, 0.25, 0.5, 0.8) for b in (0.0, 0.1, 0.3)]
    begin = min(grid, key=cost)
    simplex = begin + np.array([[0.0, 0.0], [0.07, 0.0], [0.0, 0.07]])
    found = minimize(
        cost,
        begin,
        method="Nelder-Mead",
        options={"initial_simplex": simplex, "xatol": 1e-3, "fatol": 1e-7, "maxfev": 80},
    )
    return chain(np.asarray(found.x))


def _resonance(
    search: _Search, start: ChainValues, data: Measurement, longest: float
) -> ChainValues | None:
    """Look for a resonance where fast cycles could show it; None where they could not."""
    rates = data.rates_hz
    if len(rates) < 2:
        return None
    fastest = rates[-1]
    # a slow record of few samples says nothing of a resonance, and does not hide it either
    nyquist = max(0.5 / s.dt for s in data.sections)
    high = min(_FARTHEST_RESONANCE * fastest, 0.9 * nyquist)
    low = 3.0 * fastest
    if low >= high:
        return None

    def chain(x: Array) -> ChainValues:
        return replace(
            start,
            resonance_hz=float(low * (high / low) ** np.clip(x[0], 0.0, 1.0)),
            delay=float(np.clip(x[1], 0.0, 1.0)) * longest,
            creep_per_decade=float(np.clip(x[2], 0.0, 1.0)) * _LARGEST_CREEP,
        )

    def cost(x: Array) -> float:
        outside = float(np.sum(np.maximum(0.0, -x) + np.maximum(0.0, x - 1.0)))
        return search.rms(chain(x)) * (1.0 + outside)

    rest = [start.delay / longest, start.creep_per_decade / _LARGEST_CREEP]
    points = [np.array([a, *rest]) for a in np.linspace(0.0, 1.0, 7)]
    begin = min(points, key=cost)
    if cost(begin) > (1.0 - _GLIMPSE) * search.rms(start):
        return None
    steps = np.diag([0.1, -0.03 if rest[0] > 0.05 else 0.03, 0.03])
    found = minimize(
        cost,
        begin,
        method="Nelder-Mead",
        options={
            "initial_simplex": np.vstack((begin, begin + steps)),
            "xatol": 1e-3,
            "fatol": 1e-8,
            "maxfev": 150,
        },
    )
    return chain(np.asarray(found.x))
