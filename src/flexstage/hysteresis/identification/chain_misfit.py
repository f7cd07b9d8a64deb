"""What a linear chain leaves of a measurement, with the best hysteresis of a coarse dictionary."""

import functools
import itertools
import math
import operator
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from flexstage.base.arrays import Array
from flexstage.hysteresis.drive_model import Start
from flexstage.hysteresis.identification.fit_rows import (
    ChainValues,
    Rows,
    averaged,
    filtered_whole,
    rows_of,
)
from flexstage.hysteresis.identification.measurement import IdentificationData
from flexstage.hysteresis.identification.misfit import jackknife
from flexstage.hysteresis.identification.model_fit import (
    FitData,
    behind_chain,
    equations,
    fit_data,
    folds_of,
    moves,
)
from flexstage.hysteresis.identification.projection import (
    Normal,
    Solution,
    columns_chosen,
    groups_summed,
    normal_equations,
    solve,
    square_left,
)
from flexstage.hysteresis.identification.record_section import RecordSection
from flexstage.hysteresis.models.preisach.fit import PreisachFit

#: Plays and intervals of the dictionary that stands for any hysteresis.
_DICTIONARY = (8, 8)
#: Rows that the search looks at.
_ROWS = 4000
#: Samples of a record that the search works with.
_SAMPLES = 25_000
#: Parts of the cycles that are left out in turn, to see how the chain depends on them, ...
_PARTS = 8
#: ... and how far from the best one chains are compared for that, as a share of what is searched.
_STEP = 0.01


class ChainMisfit:
    """Misfit of a chain, with the best density of a coarse dictionary.

    Products of columns with one another are what costs, and they are formed once for many chains:
    creep adds its share to each column alike, and a delay of a part of a sample mixes two samples.
    """

    def __init__(self, whole: IdentificationData, train: tuple[int, int] | None) -> None:
        self._data = short_data(whole, ChainValues(), _SAMPLES, train)
        sections = self._data.sections
        columns, moving, self._penalty = dictionary(self._data)
        self._quasi = [np.asfortranarray(c) for c in columns]
        # every other threshold: what that changes says what a grid of thresholds does
        coarse = np.arange(moving.size).reshape(_DICTIONARY)[::2].ravel()
        half = PreisachFit(_DICTIONARY[0] // 2, _DICTIONARY[1])
        self._coarse_penalty = _smoothing(half, self._data, moving[coarse])
        self._coarse = np.flatnonzero(np.isin(np.flatnonzero(moving), coarse))
        # creep acts on every column alike: its share of a column is found once
        longest = max(1000.0, *(10.0 * s.u.size * s.dt for s in sections))
        self._unit = ChainValues(creep_per_decade=1.0, creep_longest=longest)
        self._known: ChainValues | None = None
        self._columns = list(self._quasi)
        self._creep = [self._crept(i, s) for i, s in enumerate(sections)]
        self._both: dict[int, Array] = {}
        self._products: dict[tuple[int, int], Normal] = {}

    def _crept(self, i: int, section: RecordSection) -> Array:
        """What creep adds to the columns of a section, with the modes that are known."""
        added = filtered_whole(self._quasi[i], section, self._unit) - self._quasi[i]
        added = np.asfortranarray(added)
        return added if self._known is None else _behind_modes(added, section, self._known)

    def fix_modes(self, chain: ChainValues) -> None:
        """Put known modes behind all columns, once."""
        self._known = replace(chain, creep_per_decade=0.0, delay=0.0)
        for i, section in enumerate(self._data.sections):
            self._columns[i] = _behind_modes(self._quasi[i], section, self._known)
            self._creep[i] = _behind_modes(self._creep[i], section, self._known)
        self._both, self._products = {}, {}

    def begin(self, starts: Sequence[Start]) -> None:
        """Let the drive have done something else before each record."""
        sections = list(self._data.sections)
        for i, start in enumerate(starts):
            if start != sections[i].start:
                sections[i] = replace(sections[i], start=start)
                self._creep[i] = self._crept(i, sections[i])
                self._both.pop(i, None)
                self._products = {at: own for at, own in self._products.items() if at[0] != i}
        self._data = replace(self._data, sections=tuple(sections))

    def rms(self, chain: ChainValues) -> float:
        """Misfit that the best density leaves behind a chain, over the stroke."""
        normal = self._normal(chain)
        left = max(square_left(normal, self._solve(normal)), 0.0)
        return math.sqrt(left / normal.count) / self._data.stroke

    def rms_of_one_zero(self, chain: ChainValues) -> float:
        """The same, where all records must have one constant: what the best density predicts."""
        normal = self._normal(chain)
        solution = self._solve(normal)
        zeros, rows, first = [], [], 0
        for s, r, use in zip(self._data.sections, self._data.rows, self._data.use, strict=True):
            columns = s.nuisance[r.at[use]]
            own = solution.nuisance[first : first + columns.shape[1]]
            first += columns.shape[1]
            # beside a drift the zero is that of its middle
            zeros.append(float(np.mean(columns @ own)))
            rows.append(columns.shape[0])
        apart = float(np.cov(zeros, fweights=rows, ddof=0)) if len(zeros) > 1 else 0.0
        left = max(square_left(normal, solution), 0.0) / normal.count
        return math.sqrt(left + apart) / self._data.stroke

    def _normal(self, chain: ChainValues) -> Normal:
        """Normal equations of the columns behind a chain."""
        gamma = chain.creep_per_decade
        if chain.resonance_hz > 0.0 and self._known is None:
            columns = [c + gamma * k for c, k in zip(self._columns, self._creep, strict=True)]
            bare = replace(self._data, chain=replace(chain, creep_per_decade=0.0))
            return equations(behind_chain(columns, bare), bare)
        made = []
        for i, section in enumerate(self._data.sections):
            late, share = divmod(chain.delay / section.dt, 1.0)
            mixed = [1.0 - share, (1.0 - share) * gamma, share, share * gamma]
            made.append(groups_summed(self._product(i, int(late)), np.array(mixed)))
        return functools.reduce(operator.add, made)

    def _product(self, i: int, late: int) -> Normal:
        """Equations of columns and of what creep adds, so many samples late and one more."""
        if (i, late) not in self._products:
            section, use = self._data.sections[i], self._data.use[i]
            if i not in self._both:
                both = (self._columns[i], self._creep[i])
                self._both[i] = np.ascontiguousarray(np.hstack(both)[section.history :])
            at = self._data.rows[i].at[use]
            first = at - section.history - late
            columns = [self._both[i][np.maximum(k, 0)] for k in (first, first - 1)]
            self._products[i, late] = normal_equations(
                np.concatenate(columns, axis=1), section.nuisance[at], section.y[at]
            )
        return self._products[i, late]

    def spread(self, best: ChainValues, limits: Mapping[str, float], runs: int) -> dict[str, float]:
        """Standard errors of values of the chain: the jackknife over parts of the cycles.

        What is left is the error of a model, alike in neighbouring cycles. How far the best chain
        moves where a part of the cycles is left out, with all of the hysteresis fitted anew, says
        what that does (R. G. Miller, Biometrika 61 (1974) 1). What the grid of the dictionary does
        goes with the square of its pitch: a third of what every other threshold changes. Near the
        best chain the misfit is a paraboloid, so that a few chains serve all.
        """
        names = tuple(limits)
        step = _STEP * np.array([limits[name] for name in names])
        at = np.maximum([getattr(best, name) for name in names], step)
        parts = folds_of(self._data, _PARTS, runs)
        if len(parts) < 3:
            return dict.fromkeys(names, math.inf)
        around = np.array(list(itertools.product((-1.0, 0.0, 1.0), repeat=len(names))))
        chains = [replace(best, **dict(zip(names, at + step * x, strict=True))) for x in around]
        made: dict[ChainValues, list[Normal]] = {}
        for chain in chains:
            bare = replace(chain, creep_per_decade=0.0)
            if bare not in made:
                made[bare] = self._parted(bare, parts)
        costs = np.array(
            [
                self._costs(made[replace(c, creep_per_decade=0.0)], c.creep_per_decade)
                for c in chains
            ]
        )
        moved = np.array([_lowest(around, c) for c in costs.T]) * step
        (by_all, by_half), moved = moved[:2], moved[2:]
        grid = (by_half - by_all) / 3.0
        if not np.all(np.isfinite(moved)) or not np.all(np.isfinite(grid)):
            return dict.fromkeys(names, math.inf)
        error = np.hypot(jackknife(moved), grid)
        return {name: float(e) for name, e in zip(names, error, strict=True)}

    def held_out(self, chain: ChainValues) -> Array:
        """Mean squares of stretches of cycles that the dictionary was not fitted to, in turn."""
        parts = folds_of(self._data, _PARTS, runs=1)
        gamma = chain.creep_per_decade
        shares = np.array([1.0, gamma])
        whole, *rests = self._parted(replace(chain, creep_per_decade=0.0), parts)
        every = groups_summed(whole, shares)
        made = []
        for rest in (groups_summed(n, shares) for n in rests):
            own = every - rest
            made.append(square_left(own, self._solve(rest)) / max(own.count, 1))
        return np.array(made)

    def _parted(
        self, chain: ChainValues, parts: list[tuple[NDArray[np.bool_], ...]]
    ) -> list[Normal]:
        """Equations of columns and of what creep adds: of all, and of all but each part."""
        if self._known is not None:
            chain = replace(chain, resonance_hz=0.0)
        bare = replace(self._data, chain=chain)
        behind = [
            np.concatenate(pair, axis=1)
            for pair in zip(
                behind_chain(self._columns, bare), behind_chain(self._creep, bare), strict=True
            )
        ]
        whole = equations(behind, bare)
        return [whole, *(whole - equations(behind, bare.with_use(part)) for part in parts)]

    def _costs(self, parted: list[Normal], gamma: float) -> Array:
        """Sums of squares: of all, of all by half of the dictionary, and of all but each part."""
        whole, *rest = (groups_summed(n, np.array([1.0, gamma])) for n in parted)
        half = columns_chosen(whole, self._coarse)
        costs = [square_left(n, self._solve(n)) for n in (whole, *rest)]
        costs.insert(1, square_left(half, self._solve(half, self._coarse_penalty)))
        return np.array(costs)

    def _solve(self, normal: Normal, penalty: Array | None = None) -> Solution:
        penalty = self._penalty if penalty is None else penalty
        return solve(normal, smoothing=penalty * (normal.count * self._data.input_scale**2))


def short_data(
    whole: IdentificationData, chain: ChainValues, samples: int, train: tuple[int, int] | None
) -> FitData:
    """Return few rows of a measurement that was averaged to so many samples."""
    data = replace(whole, sections=tuple(averaged(s, samples) for s in whole.sections))
    rows = rows_of(data.sections, _ROWS)
    use = tuple(
        _used_rows(r, s, round(s.dt / w.dt), train)
        for r, s, w in zip(rows, data.sections, whole.sections, strict=True)
    )
    return fit_data(data, chain, rows, use)


def dictionary(data: FitData) -> tuple[list[Array], NDArray[np.bool_], Array]:
    """Return columns that stand for any hysteresis: those that move, which, and their penalty."""
    method = PreisachFit(*_DICTIONARY)
    columns = [np.concatenate(list(method.columns(s, data)), axis=1) for s in data.sections]
    moving = moves(columns)
    return [c[:, moving] for c in columns], moving, _smoothing(method, data, moving)


def _smoothing(method: PreisachFit, data: FitData, moving: NDArray[np.bool_]) -> Array:
    """The part of a penalty that belongs to the columns that move."""
    return method.smoothing(data, moving)[np.ix_(moving, moving)]


def _lowest(around: Array, cost: Array) -> Array:
    """Where the paraboloid through some costs is lowest; not a number where it is none."""
    n = around.shape[1]
    pairs = list(itertools.combinations_with_replacement(range(n), 2))
    columns = np.column_stack(
        (np.ones(cost.size), around, *(around[:, i] * around[:, j] for i, j in pairs))
    )
    own = np.linalg.lstsq(columns, cost, rcond=None)[0]
    H = np.zeros((n, n))
    for (i, j), c in zip(pairs, own[1 + n :], strict=True):
        H[i, j] += c
        H[j, i] += c
    if not np.linalg.eigvalsh(H)[0] > 0.0:
        return np.full(n, np.nan)
    return np.asarray(np.linalg.solve(H, -own[1 : 1 + n]), dtype=np.float64)


def _used_rows(
    rows: Rows, section: RecordSection, every: int, train: tuple[int, int] | None
) -> NDArray[np.bool_]:
    """Which rows of an averaged section are looked at; what is held out must not be.

    Each sample of the section is the mean of `every` samples of the record, in which `train`
    counts.
    """
    if train is None:
        return np.ones(rows.at.size, dtype=bool)
    first = (rows.at - section.history) * every + section.first
    return (first >= train[0]) & (first + every <= train[1])


def _behind_modes(columns: Array, section: RecordSection, known: ChainValues) -> Array:
    return np.asfortranarray(filtered_whole(columns, section, known))
