"""Residual of a linear chain, with the best hysteresis of a coarse dictionary."""

import functools
import itertools
import math
import operator
from collections.abc import Mapping, Sequence
from copy import copy
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from flexstage.base.arrays import Array
from flexstage.hysteresis.chain.creep import CreepSpectrum, Start
from flexstage.hysteresis.identification.cycles import RecordSection, with_start
from flexstage.hysteresis.identification.fit_rows import (
    ChainValues,
    Rows,
    averaged,
    filtered,
    filtered_samples,
    rows_of,
)
from flexstage.hysteresis.identification.measurement import (
    IdentificationData,
    with_history,
    without_history,
)
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
    combined,
    group_sums,
    normal_equations,
    orthonormal,
    residual_square,
    residual_square_of_part,
    solve,
)
from flexstage.hysteresis.identification.residuals import jackknife
from flexstage.hysteresis.models.fits import PreisachFit

#: Plays and intervals of the dictionary that stands for any hysteresis.
_DICTIONARY = (8, 8)
#: Rows that the search uses.
_ROWS = 4000
#: Samples of a record that the search uses.
_SAMPLES = 25_000
#: Parts of the cycles that are omitted in turn, for the standard errors of the chain, ...
_PARTS = 8
#: ... and step of its values for these, as a share of the search range.
_STEP = 0.01

#: Samples of a record that a spectrum is fitted to.
_SPECTRUM_SAMPLES = 50_000
#: The shortest time constant is one over the angular frequency of the fastest cycles, divided by
#: this, as a faster lag acts on them as a delay; the others follow, one for each decade.
_FASTER = 3.0
#: Lags for each decade, ...
_LAGS_PER_DECADE = 2
#: ... and decays of these that are less than this apart from those of others are no columns.
_SIMILAR = 1e-2
#: Parts of the cycles of one or two records that are omitted in turn, and runs of neighbours in
#: each: small ones, so that the offset of a record is not extrapolated.
_SPECTRUM_PARTS, _SPECTRUM_RUNS = 12, 3
#: Times that the grid of delays is refined about the best one, by half.
_REFINEMENTS = 2
#: Weight of each lag that the first iteration begins with, ...
_FIRST_WEIGHT = 0.01
#: ... and that each begins with at least: one of zero stays zero.
_LEAST_WEIGHT = 1e-4
#: Largest number of iterations of densities and weights, and the change that ends them.
_ITERATIONS = 40
_CONVERGED = 1e-5

#: Mark of the rows of a part in each record.
_Part = tuple[NDArray[np.bool_], ...]


class ChainResidual:
    """Residual of a chain, with the best density of a coarse dictionary.

    Products of columns cost most of the time, and are formed once for many chains: creep adds the
    same share to each column, and a delay by a fraction of a sample mixes two samples.
    """

    def __init__(self, data: IdentificationData, train: tuple[int, int] | None) -> None:
        self._data = short_data(data, ChainValues(), _SAMPLES, train)
        sections = self._data.sections
        columns, moving, self._penalty = dictionary(self._data)
        self._moving = moving
        self._quasi = [np.asfortranarray(c) for c in columns]
        # every other threshold: the change shows the effect of the grid of thresholds
        coarse = np.arange(moving.size).reshape(_DICTIONARY)[::2].ravel()
        half = PreisachFit(_DICTIONARY[0] // 2, _DICTIONARY[1])
        self._coarse_penalty = _smoothing(half, self._data, moving[coarse])
        self._coarse = np.eye(moving.sum())[:, np.isin(np.flatnonzero(moving), coarse)]
        # creep acts on every column in the same way: its share of a column is computed once
        longest = max(1000.0, *(10.0 * s.u.size * s.dt for s in sections))
        self._unit = ChainValues(creep_per_decade=1.0, creep_longest=longest)
        self._known_modes: ChainValues | None = None
        self._columns = list(self._quasi)
        self._creep = [self._creep_response(i, s) for i, s in enumerate(sections)]
        self._both: dict[int, Array] = {}
        self._products: dict[tuple[int, int], Normal] = {}

    def _creep_response(self, i: int, section: RecordSection) -> Array:
        """Change of the columns of a section by a unit of creep, with the known modes."""
        added = filtered_samples(self._quasi[i], section, self._unit) - self._quasi[i]
        added = np.asfortranarray(added)
        return (
            added if self._known_modes is None else _behind_modes(added, section, self._known_modes)
        )

    def fix_modes(self, chain: ChainValues) -> None:
        """Pass all columns through known modes, once."""
        self._known_modes = replace(chain, creep_per_decade=0.0, delay=0.0)
        for i, section in enumerate(self._data.sections):
            self._columns[i] = _behind_modes(self._quasi[i], section, self._known_modes)
            self._creep[i] = _behind_modes(self._creep[i], section, self._known_modes)
        self._both, self._products = {}, {}

    def set_starts(self, starts: Sequence[Start]) -> None:
        """Set the motion of the drive before each record, for its creep."""
        for i, (start, section) in enumerate(zip(starts, self._data.sections, strict=True)):
            if start != section.start and not section.periodic:
                self._replace_section(i, replace(section, start=start))

    def set_memory(self, i: int, memory: str) -> None:
        """Set the motion before a record that set the memory of its hysteresis."""
        before = self._data.sections[i]
        if memory != before.memory:
            section = with_history(replace(without_history(before), memory=memory))
            rows, shift = list(self._data.rows), section.history - before.history
            rows[i] = replace(rows[i], at=rows[i].at + shift)
            self._data = replace(self._data, rows=tuple(rows))
            every = PreisachFit(*_DICTIONARY).columns(section, self._data)
            columns = np.concatenate(list(every), axis=1)[:, self._moving]
            self._columns[i] = self._quasi[i] = np.asfortranarray(columns)
            if self._known_modes is not None:
                self._columns[i] = _behind_modes(self._quasi[i], section, self._known_modes)
            self._replace_section(i, section)

    def _replace_section(self, i: int, section: RecordSection) -> None:
        sections = list(self._data.sections)
        sections[i] = section
        self._data = replace(self._data, sections=tuple(sections))
        self._creep[i] = self._creep_response(i, section)
        self._both.pop(i, None)
        self._products = {at: n for at, n in self._products.items() if at[0] != i}

    def rms(self, chain: ChainValues, *, common: bool = False) -> float:
        """Return the rms residual of a chain with the best density, over the stroke.

        With a common offset of all records, if they have one, or with one of each.
        """
        normal = self._normal(chain)
        solution = self._solve(normal)
        square = max(residual_square(normal, solution), 0.0) / normal.count
        square += variance_of_offsets(self._data, solution) if common else 0.0
        return math.sqrt(square) / self._data.stroke

    def _normal(self, chain: ChainValues) -> Normal:
        """Normal equations of the columns behind a chain."""
        gamma = chain.creep_per_decade
        if chain.resonance_hz > 0.0 and self._known_modes is None:
            columns = [c + gamma * k for c, k in zip(self._columns, self._creep, strict=True)]
            bare = replace(self._data, chain=replace(chain, creep_per_decade=0.0))
            return equations(behind_chain(columns, bare), bare)
        sections = []
        for i, section in enumerate(self._data.sections):
            late, share = divmod(chain.delay / section.dt, 1.0)
            mixed = [1.0 - share, (1.0 - share) * gamma, share, share * gamma]
            sections.append(group_sums(self._product(i, int(late)), np.array(mixed)))
        return functools.reduce(operator.add, sections)

    def _product(self, i: int, late: int) -> Normal:
        """Equations of the columns and their creep, delayed by a number of samples and one more."""
        if (i, late) not in self._products:
            section, use = self._data.sections[i], self._data.use[i]
            if i not in self._both:
                both = (self._columns[i], self._creep[i])
                self._both[i] = np.ascontiguousarray(np.hstack(both)[section.history :])
            at = self._data.rows[i].at[use]
            first = at - section.history - late
            last = self._both[i].shape[0] - 1
            columns = [
                self._both[i][k % last if section.periodic else np.maximum(k, 0)]
                for k in (first, first - 1)
            ]
            self._products[i, late] = normal_equations(
                np.concatenate(columns, axis=1), section.nuisance[at], section.y[at]
            )
        return self._products[i, late]

    def spread(self, best: ChainValues, limits: Mapping[str, float], runs: int) -> dict[str, float]:
        """Standard errors of values of the chain: the jackknife over parts of the cycles.

        The residual is a model error, correlated between neighbouring cycles. Its effect is the
        change of the best chain without a part of the cycles, with the hysteresis fitted anew
        (R. G. Miller, Biometrika 61 (1974) 1). The effect of the grid of the dictionary goes with
        the square of its pitch: a third of the change by every other threshold. Near the best chain
        the residual is a paraboloid, so that a few chains are enough.
        """
        names = tuple(limits)
        step = _STEP * np.array([limits[name] for name in names])
        at = np.maximum([getattr(best, name) for name in names], step)
        parts = folds_of(self._data, _PARTS, runs)
        if len(parts) < 3:
            return dict.fromkeys(names, math.inf)
        around = np.array(list(itertools.product((-1.0, 0.0, 1.0), repeat=len(names))))
        chains = [replace(best, **dict(zip(names, at + step * x, strict=True))) for x in around]
        equations_by_chain: dict[ChainValues, list[Normal]] = {}
        for chain in chains:
            bare = replace(chain, creep_per_decade=0.0)
            if bare not in equations_by_chain:
                equations_by_chain[bare] = self._part_equations(bare, parts)
        costs = np.array(
            [
                self._costs(
                    equations_by_chain[replace(c, creep_per_decade=0.0)], c.creep_per_decade
                )
                for c in chains
            ]
        )
        minima = np.array([_lowest(around, c) for c in costs.T]) * step
        (by_all, by_half), minima = minima[:2], minima[2:]
        grid = (by_half - by_all) / 3.0
        if not np.all(np.isfinite(minima)) or not np.all(np.isfinite(grid)):
            return dict.fromkeys(names, math.inf)
        error = np.hypot(jackknife(minima), grid)
        return {name: float(e) for name, e in zip(names, error, strict=True)}

    def held_out(self, chain: ChainValues) -> Array:
        """Return the mean squares of held-out stretches of cycles, for each stretch in turn."""
        parts = folds_of(self._data, _PARTS, runs=1)
        gamma = chain.creep_per_decade
        shares = np.array([1.0, gamma])
        total, *others = self._part_equations(replace(chain, creep_per_decade=0.0), parts)
        total = group_sums(total, shares)
        squares = []
        for fitted in (group_sums(n, shares) for n in others):
            held_out = total - fitted
            square = residual_square(held_out, self._solve(fitted))
            squares.append(square / max(held_out.count, 1))
        return np.array(squares)

    def _part_equations(self, chain: ChainValues, parts: list[_Part]) -> list[Normal]:
        """Equations of the columns and their creep: of all rows, and without each part."""
        if self._known_modes is not None:
            chain = replace(chain, resonance_hz=0.0)
        bare = replace(self._data, chain=chain)
        behind = [
            np.concatenate(pair, axis=1)
            for pair in zip(
                behind_chain(self._columns, bare), behind_chain(self._creep, bare), strict=True
            )
        ]
        total = equations(behind, bare)
        return [total, *(total - equations(behind, bare.with_use(part)) for part in parts)]

    def _costs(self, parts: list[Normal], gamma: float) -> Array:
        """Sums of squares: of all rows, of all by half of the dictionary, and without each part."""
        total, *others = (group_sums(n, np.array([1.0, gamma])) for n in parts)
        half = combined(total, self._coarse)
        costs = [residual_square(n, self._solve(n)) for n in (total, *others)]
        costs.insert(1, residual_square(half, self._solve(half, self._coarse_penalty)))
        return np.array(costs)

    def _solve(self, normal: Normal, penalty: Array | None = None) -> Solution:
        penalty = self._penalty if penalty is None else penalty
        return solve(normal, smoothing=penalty * (normal.count * self._data.input_scale**2))


def variance_of_offsets(data: FitData, solution: Solution) -> float:
    """Return the mean square that a common offset adds to a solution; 0 if records have none."""
    if data.zero != "one" or len(data.sections) == 1:
        return 0.0
    rows = [int(use.sum()) for use in data.use]
    return float(np.cov(solution.nuisance, fweights=rows, ddof=0))


def short_data(
    data: IdentificationData, chain: ChainValues, samples: int, train: tuple[int, int] | None
) -> FitData:
    """Return few rows of a measurement, averaged to a number of samples."""
    short = replace(data, sections=tuple(averaged(s, samples) for s in data.sections))
    rows = rows_of(short.sections, _ROWS)
    use = tuple(
        _rows_in_use(r, s, round(s.dt / w.dt), train)
        for r, s, w in zip(rows, short.sections, data.sections, strict=True)
    )
    return replace(fit_data(short, chain), rows=rows, use=use)


def dictionary(data: FitData) -> tuple[list[Array], NDArray[np.bool_], Array]:
    """Return the moving columns of the dictionary, which columns move, and their penalty."""
    method = PreisachFit(*_DICTIONARY)
    columns = [np.concatenate(list(method.columns(s, data)), axis=1) for s in data.sections]
    moving = moves(columns)
    return [c[:, moving] for c in columns], moving, _smoothing(method, data, moving)


def _smoothing(method: PreisachFit, data: FitData, moving: NDArray[np.bool_]) -> Array:
    """Penalty of the moving columns."""
    return method.smoothing(data, moving)[np.ix_(moving, moving)]


def _lowest(around: Array, cost: Array) -> Array:
    """Minimum of the paraboloid through costs; not a number if it has none."""
    n = around.shape[1]
    pairs = list(itertools.combinations_with_replacement(range(n), 2))
    columns = np.column_stack(
        (np.ones(cost.size), around, *(around[:, i] * around[:, j] for i, j in pairs))
    )
    coefficients = np.linalg.lstsq(columns, cost, rcond=None)[0]
    H = np.zeros((n, n))
    for (i, j), c in zip(pairs, coefficients[1 + n :], strict=True):
        H[i, j] += c
        H[j, i] += c
    if not np.linalg.eigvalsh(H)[0] > 0.0:
        return np.full(n, np.nan)
    return np.asarray(np.linalg.solve(H, -coefficients[1 : 1 + n]), dtype=np.float64)


def _rows_in_use(
    rows: Rows, section: RecordSection, every: int, train: tuple[int, int] | None
) -> NDArray[np.bool_]:
    """Mark the rows of an averaged section without held-out samples.

    Each sample of the section is the mean of `every` samples of the record, in which `train`
    counts.
    """
    if train is None:
        return np.ones(rows.at.size, dtype=bool)
    first = (rows.at - section.history) * every + section.first
    return (first >= train[0]) & (first + every <= train[1])


def _behind_modes(columns: Array, section: RecordSection, known: ChainValues) -> Array:
    return np.asfortranarray(filtered_samples(columns, section, known))


def is_better(before: Array, after: Array, reduction: float) -> bool:
    """Return true if held-out parts are predicted better: a typical one by a share, and the mean.

    Errors of parts differ by more than a decade if one has jumps; their ratios differ less.
    """
    if before.size < 2 or not 0.0 < after.mean() < before.mean():
        return False
    ratio = np.log(np.maximum(after, 1e-300) / np.maximum(before, 1e-300))
    by_chance = float(np.std(ratio, ddof=1)) / np.sqrt(ratio.size)
    return bool(ratio.mean() < min(np.log(1.0 - reduction), -by_chance))


class SpectrumFit:
    r"""Joint fit of delay and weights of creep, with the best density of a coarse dictionary.

    Output is linear in the density of a small Preisach model and in the weights of the lags behind
    it, but not in both: for each delay, each is found by non-negative least squares with the other
    fixed, in turn. A delay that is found without the lags takes the loss of the fast ones.

    .. math:: y = \Big(1 + \sum_i \frac{a_i}{1 + \tau_i s}\Big) \sum_j w_j \phi_j(u),
              \qquad a_i, w_j \ge 0

    Modes are those of a chain. A joint fit of the delay takes two lags for each decade, another one
    takes one.
    """

    def __init__(
        self,
        data: IdentificationData,
        modes: ChainValues,
        train: tuple[int, int] | None,
        *,
        joint: bool,
    ) -> None:
        self._joint = joint
        self._data = short_data(data, ChainValues(), _SPECTRUM_SAMPLES, train)
        self._columns, _, penalty = dictionary(self._data)
        self._modes = replace(modes, creep_per_decade=0.0, delay=0.0, spectrum=None)
        if modes.resonance_hz > 0.0:
            pairs = zip(self._columns, self._data.sections, strict=True)
            self._columns = [_behind_modes(c, s, self._modes) for c, s in pairs]
        self._penalty = penalty * self._data.input_scale**2
        longest = max(s.u.size * s.dt for s in data.sections)
        shortest = 1.0 / (2.0 * np.pi * _FASTER * data.rates_hz[-1])
        per_decade = _LAGS_PER_DECADE if joint else 1
        count = 1 + max(1, round(per_decade * np.log10(longest / shortest)))
        self._times = np.geomspace(shortest, longest, count)
        self._lags = [ChainValues().with_lag(float(t)) for t in self._times]

    def with_start(self, start: Start) -> "SpectrumFit":
        """Return the fit with other motion of the drive before each record."""
        return self._of_sections(with_start(self._data.sections, start))

    def with_any_start(self) -> "SpectrumFit":
        """Return the fit with the decay of each lag in the nuisance columns of the records."""
        return self._of_sections(tuple(self._unsettled(s) for s in self._data.sections))

    def _of_sections(self, sections: tuple[RecordSection, ...]) -> "SpectrumFit":
        other = copy(self)
        other._data = replace(self._data, sections=sections)
        return other

    def _unsettled(self, section: RecordSection) -> RecordSection:
        if section.periodic:
            return section
        time = np.maximum(np.arange(section.u.size) - section.history, 0) * section.dt
        decays = np.exp(-time[:, None] / self._times)
        columns = orthonormal(np.hstack((section.nuisance, decays)), _SIMILAR)
        return replace(section, nuisance=columns)

    def best(self, delays: Array) -> tuple[ChainValues, float]:
        """Return the best chain, by its delay on a grid that is refined, and its mean square."""
        solved: dict[float, tuple[Array, float]] = {}
        weights, grid, best = np.full(self._times.size, _FIRST_WEIGHT), delays, 0.0
        for _ in range(_REFINEMENTS + 1):
            for delay, (normal,) in zip(grid, self._equations(grid, self._lags), strict=True):
                solved[float(delay)] = self._weights(normal, weights)
                weights = solved[float(delay)][0]
            best = min(solved, key=lambda d: solved[d][1])
            at = np.array(sorted(solved))
            near = np.concatenate((at[at < best][-1:], at[at > best][:1]))
            weights, grid = solved[best][0], 0.5 * (best + near)
            if grid.size == 0:
                break
        chain, used = replace(self._modes, delay=best), weights > 0.0
        if used.any():
            spectrum = CreepSpectrum(times=tuple(self._times[used]), weights=tuple(weights[used]))
            rate = spectrum.rate_per_decade
            chain = replace(chain, spectrum=spectrum, creep_per_decade=rate)
        return chain, solved[best][1]

    def squares(self, chain: ChainValues) -> tuple[float, float]:
        """Return the mean square behind a chain, and with a common offset if records have one."""
        ((normal,),), factors = self._of_chain(chain)
        solution = self._densities(normal, factors)
        square = residual_square(group_sums(normal, factors), solution) / normal.count
        return square, square + variance_of_offsets(self._data, solution)

    def left_out(self, chain: ChainValues) -> Array:
        """Return the mean squares behind a chain of parts that are omitted in turn."""
        ((total, *others),), factors = self._of_chain(chain, self._parts())
        return self._left_out(total, others, [factors] * len(others))

    def _of_chain(
        self, chain: ChainValues, parts: Sequence[_Part] = ()
    ) -> tuple[list[list[Normal]], Array]:
        """Equations behind a known chain, and the factors of its columns and of their change."""
        creeps = [chain] if chain.creep_per_decade > 0.0 else []
        return self._equations([chain.delay], creeps, parts), np.ones(1 + len(creeps))

    def of_parts(self, chain: ChainValues) -> Array:
        """Return the mean squares of parts, each behind the weights that are fitted without it."""
        start = np.zeros(self._times.size)
        if chain.spectrum is not None:
            start[np.isin(self._times, chain.spectrum.times)] = chain.spectrum.weights
        ((total, *others),) = self._equations([chain.delay], self._lags, self._parts())
        weights = [self._weights(normal, start)[0] for normal in others]
        return self._left_out(total, others, [np.append(1.0, w) for w in weights])

    def errors(self, chain: ChainValues, delays: Array) -> dict[str, float]:
        """Standard errors of delay and creep: the jackknife over all records.

        The slowest and the fastest record decide most, and are omitted in turn as the others are.
        Without each record both are found anew on a grid of delays, as one makes up for the other.
        """
        use = self._data.use
        used = [k for k, rows in enumerate(use) if rows.any()]
        if len(used) < 3 or chain.spectrum is None:
            return dict.fromkeys(("delay", "creep_per_decade"), math.inf)
        records = [tuple(rows & (i == k) for i, rows in enumerate(use)) for k in used]
        _, *without = zip(*self._equations(delays, self._lags, records), strict=True)
        late, gains = np.empty((2, len(records)))
        for k, normals in enumerate(without):
            weights, fits = np.full(self._times.size, _FIRST_WEIGHT), []
            for normal in normals:
                weights, square = self._weights(normal, weights)
                fits.append((square, weights.sum()))
            squares, gain = np.array(fits).T
            late[k] = _lowest_between(delays, squares)
            gains[k] = np.interp(late[k], delays, gain)
        per_decade = chain.creep_per_decade / sum(chain.spectrum.weights)
        return {
            "delay": float(jackknife(late)),
            "creep_per_decade": per_decade * float(jackknife(gains)),
        }

    def _equations(
        self,
        delays: Sequence[float] | Array,
        creeps: Sequence[ChainValues],
        parts: Sequence[_Part] = (),
    ) -> list[list[Normal]]:
        """Equations behind each delay: of the columns, and of their change by each creep.

        Of all rows, and without each of some parts.
        """
        data = self._data
        sections = zip(self._columns, data.sections, data.rows, strict=True)
        behind = [_behind_delays(c, s, r, delays, creeps) for c, s, r in sections]
        every = []
        for columns in map(list, zip(*behind, strict=True)):
            total = equations(columns, data)
            without = [total - equations(columns, data.with_use(part)) for part in parts]
            every.append([total, *without])
        return every

    def _parts(self) -> list[_Part]:
        return _parts_to_leave_out(self._data, joint=self._joint)

    def _densities(self, normal: Normal, factors: Array) -> Solution:
        return solve(group_sums(normal, factors), smoothing=self._penalty * normal.count)

    def _left_out(self, total: Normal, others: Sequence[Normal], factors: Sequence[Array]) -> Array:
        """Mean squares of the rows that are not in each of some equations."""
        squares = []
        for fitted, f in zip(others, factors, strict=True):
            part, solution = group_sums(total - fitted, f), self._densities(fitted, f)
            known = np.diag(fitted.gram)[fitted.columns :] > 0.0
            squares.append(residual_square_of_part(part, solution, known) / part.count)
        return np.array(squares)

    def _weights(self, normal: Normal, start: Array) -> tuple[Array, float]:
        """Find densities and weights in turn; return the weights, shape (m,), and mean square."""
        a, last = np.maximum(start, _LEAST_WEIGHT), np.inf
        for _ in range(_ITERATIONS):
            w = self._densities(normal, np.append(1.0, a)).coefficients
            lags = combined(normal, np.kron(np.eye(a.size + 1), w[:, None]))
            share = solve(lags)
            if share.coefficients[0] <= 0.0:
                break
            a = share.coefficients[1:] / share.coefficients[0]
            square = residual_square(lags, share)
            if last - square <= _CONVERGED * square:
                break
            last = square
        return a, last / normal.count


def _parts_to_leave_out(data: FitData, *, joint: bool) -> list[_Part]:
    """Whole records at rates within those of others, or parts of the cycles if these are few.

    A spectrum is valid between the rates of its records, and cannot be judged beyond them.
    """
    used = [k for k, use in enumerate(data.use) if use.any()]
    rates = {k: float(np.median(data.sections[k].cycles.frequency_hz)) for k in used}
    inside = [
        k
        for k in used
        if min((rates[i] for i in used if i != k), default=math.inf)
        <= rates[k]
        <= max((rates[i] for i in used if i != k), default=0.0)
    ]
    if joint and len(inside) > 1:
        return [tuple(u & (i == k) for i, u in enumerate(data.use)) for k in inside]
    folds = folds_of(data, _SPECTRUM_PARTS, _SPECTRUM_RUNS)
    count = sum(int(use.sum()) for use in data.use)
    return [f for f in folds if 0 < sum(int(part.sum()) for part in f) < count]


def _lowest_between(x: Array, cost: Array) -> float:
    """Minimum of the parabola through the lowest cost and its neighbours, or the lowest end."""
    k = int(np.argmin(cost))
    near = slice(k - 1, k + 2)
    if not 0 < k < x.size - 1 or not np.all(np.isfinite(cost[near])):
        return float(x[k])
    square, slope, _ = np.polyfit(x[near] - x[k], cost[near], 2)
    return float(x[k] - 0.5 * slope / square) if square > 0.0 else float(x[k])


def _behind_delays(
    columns: Array,
    section: RecordSection,
    rows: Rows,
    delays: Sequence[float] | Array,
    creeps: Sequence[ChainValues],
) -> list[Array]:
    """Columns, and their change by each creep side by side, at the rows behind each delay."""
    late = np.concatenate([rows.at - delay / section.dt for delay in delays])
    every = replace(rows, at=late)
    plain = filtered(columns, section, every, ChainValues())
    bare = [replace(c, delay=0.0, resonance_hz=0.0) for c in creeps]
    changes = [filtered(columns, section, every, c) - plain for c in bare]
    return np.split(np.concatenate([plain, *changes], axis=1), len(delays))
