"""Shifts of the baseline of a record: jumps and drift, separated from hysteresis and creep."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import block_diag
from scipy.optimize import minimize_scalar

from flexstage.base.arrays import Array
from flexstage.hysteresis.chain.creep import CreepSpectrum
from flexstage.hysteresis.identification.chain_residual import dictionary
from flexstage.hysteresis.identification.cycles import (
    RecordSection,
    possible_starts,
    with_start,
)
from flexstage.hysteresis.identification.faults import RecordFault
from flexstage.hysteresis.identification.fit_rows import (
    ChainValues,
    Rows,
    averaged,
    rows_of,
)
from flexstage.hysteresis.identification.model_fit import FitData, behind_chain
from flexstage.hysteresis.identification.projection import (
    Normal,
    Solution,
    group_sums,
    orthonormal,
    residual_square,
    solve,
)
from flexstage.quantities.units import readable, readable_unit


@dataclass(frozen=True, slots=True)
class _Thresholds:
    """Limits of the search.

    Those without a source were set so that clean records show no shift and that the shifts in
    ``tests/analytic/test_quality_report.py`` are found; that test checks both.
    """

    samples: int = 12_000
    """Samples that all records are averaged to: bounds the time of the search."""
    rows: int = 6000
    """Rows of these that the coarse model is fitted to: bounds the time of the search."""
    cycles: int = 3
    """Fewest cycles of a record after both ends of the range were reached: no jump is looked for in
    the first and the last one.
    """
    jumps: int = 3
    """Largest number of jumps in all records."""
    share: float = 0.15
    """Smallest share of the mean square that a shift removes."""
    certainty: float = 5.0
    """Smallest shift in standard errors: five, as every row is tested for a jump."""
    separable: float = 0.01
    """Smallest share of a step that the coarse model cannot represent; elsewhere a jump would be
    taken for hysteresis or creep.
    """
    drift: float = 0.5
    """Smallest drift over the record [% of the stroke]: models leave 0.1 to 2 %."""
    steadiness: float = 0.5
    """Smallest ratio of the speeds of a drift in the two halves of a record: logarithmic creep
    slows down more.
    """
    largest_creep: float = 0.3
    """Largest creep [1 per decade], far above the 1 to 2 % of piezo stacks (Physik Instrumente,
    Piezo Tutorial, "Creep").
    """
    creep_error: float = 1e-5
    """Largest error of that creep [1 per decade]."""
    usual_creep: float = 0.05
    """Largest weight of the slowest lag of a spectrum [1]: the same source; a larger weight
    includes a drift.
    """
    input_step: float = 0.01
    """A step of the input exceeds this share of its range ..."""
    input_step_ratio: float = 20.0
    """... and the median step this many times: the residual of the model changes there."""


_THRESHOLDS = _Thresholds()


def baseline_shifts(data: FitData) -> list[RecordFault]:
    r"""Find jumps of the baseline of the output, or its drift.

    A model takes much of either for creep, so that both are fitted together with all that a drive
    can do: a coarse Preisach model with its creep and the start of that, by projection. For a jump
    at :math:`k`, the residual falls by :math:`(s_k^T e)^2 / s_k^T s_k`, where :math:`s_k` is the
    step less its projection on the model, on lags of every decade and on a trend: the most likely
    place is where that is largest (D. V. Hinkley, Biometrika 57 (1970) 1). A trend is compared with
    creep in proportion to the logarithm of time, for each start of it. The residual is not white:
    the variance inflation of its means, up to two cycles, divides the squares.

    Validity: a step of the baseline. One that takes seconds is reported as a jump in its middle;
    creep that is not logarithmic may be reported as a drift.
    """
    records = _StackedRecords.of(data)
    if np.any(np.diff(records.ends) < _THRESHOLDS.cycles * np.array(records.cycle_rows)):
        return []
    model = _CoarseModel.of(records)
    rows: list[int] = []
    while len(rows) < _THRESHOLDS.jumps and (row := _next_jump(model, rows)) is not None:
        rows.append(row)
    jumps = records.steps(rows)
    models = [model, *_with_other_creep(model, data.chain)]
    best = min((m.solve(jumps) for m in models), key=_mean_square)
    faults = [
        _jump_fault(data, *records.locate(row), float(size))
        for row, size in zip(rows, best.extra, strict=True)
    ]
    # a jump causes a trend, and is corrected first
    if not faults and data.zero != "drift":
        faults = _drift_faults(data, models, _mean_square(best))
    return sorted(faults, key=lambda f: (f.record, f.at))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _StackedRecords:
    """Averaged records, one below the other: n rows in all."""

    full_sections: tuple[RecordSection, ...]
    """The records as they were measured."""
    data: FitData
    """The averaged records, behind the chain without creep."""
    ends: NDArray[np.intp]
    """First row of each record, and the row after the last, shape (records + 1,)."""
    y: Array
    """Output at the rows, shape (n,)."""

    @classmethod
    def of(cls, data: FitData) -> "_StackedRecords":
        """Average the records of an identification."""
        size = max(1, _THRESHOLDS.samples // len(data.sections))
        sections = tuple(averaged(s, size) for s in data.sections)
        # earlier motion affects samples until both ends were reached
        after = [replace(s, warm_up=max(s.warm_up, s.both_ends)) for s in sections]
        rows = rows_of(after, _THRESHOLDS.rows)
        chain = replace(data.chain, creep_per_decade=0.0, spectrum=None)
        return cls(
            full_sections=data.sections,
            data=replace(data, sections=sections, chain=chain, rows=rows, use=(), memo={}),
            ends=np.cumsum([0, *(r.at.size for r in rows)]),
            y=np.concatenate([s.y[r.at] for s, r in zip(sections, rows, strict=True)]),
        )

    @property
    def nuisance(self) -> Array:
        """Nuisance columns of each record, zero in the others, shape (n, k)."""
        pairs = zip(self.data.sections, self.data.rows, strict=True)
        return np.asarray(block_diag(*(s.nuisance[r.at] for s, r in pairs)))

    @property
    def trends(self) -> Array:
        """Rise by 1 over each record, about zero, and zero in the others, shape (n, records)."""
        return np.asarray(block_diag(*(_trend(r)[:, None] for r in self.data.rows)))

    @property
    def cycle_rows(self) -> tuple[int, ...]:
        """Number of rows in a cycle of each record."""
        pairs = zip(self.data.sections, self.data.rows, strict=True)
        return tuple(_rows_in_cycle(s, r) for s, r in pairs)

    def steps(self, rows: Sequence[int]) -> Array:
        """Columns that rise by 1 at a row, to the end of its record, shape (n, rows)."""
        columns = np.zeros((self.y.size, len(rows)))
        for column, row in zip(columns.T, rows, strict=True):
            column[row : self.ends[np.searchsorted(self.ends, row, side="right")]] = 1.0
        return columns

    def record_of(self, row: int) -> int:
        """Return the number of the record of a row."""
        return int(np.searchsorted(self.ends, row, side="right")) - 1

    def around(self, row: int) -> slice:
        """Return the rows within a cycle of a row."""
        cycle = self.cycle_rows[self.record_of(row)]
        return slice(max(row - cycle, 0), row + cycle)

    def locate(self, row: int) -> tuple[int, float]:
        """Return the number of a row's record, and the time from its first sample [s]."""
        k = self.record_of(row)
        at, s, full = self.data.rows[k].at, self.data.sections[k], self.full_sections[k]
        i = row - int(self.ends[k])
        # the largest step of the samples between two rows
        a, b = (round((at[j] - s.history) * s.dt / full.dt) + full.history for j in (i - 1, i))
        b = min(max(b + 1, a + 2), full.y.size)
        sample = a + 1 + int(np.argmax(np.abs(np.diff(full.y[a:b]))))
        return k, full.begin + (sample - full.history) * full.dt


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Solution:
    """Best density and creep of the coarse model, with extra columns."""

    residual: Array
    """Output less model, shape (n,)."""
    weights: Array
    """Density of the Preisach model, shape (m,)."""
    creep: float
    """Creep [1 per decade]."""
    extra: Array
    """Coefficients of the extra columns."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _CoarseModel:
    """A coarse Preisach model of all records, with creep and nuisance columns."""

    records: _StackedRecords
    """The records."""
    quasi_static: list[Array]
    """Columns of the Preisach model at every sample of each record, shape (samples, m)."""
    penalty: Array
    """Penalty of the density, per row."""
    columns: Array
    """The columns behind the chain, at the rows, and their change by a unit of creep, (n, 2 m)."""
    gram: Array
    """Products of these with one another."""

    @classmethod
    def of(cls, records: _StackedRecords) -> "_CoarseModel":
        """Return the coarse model of records, with logarithmic creep."""
        quasi_static, _, penalty = dictionary(records.data)
        none = np.zeros((0, 0))
        model = cls(
            records=records,
            quasi_static=[np.asfortranarray(c) for c in quasi_static],
            penalty=penalty * records.data.input_scale**2,
            columns=none,
            gram=none,
        )
        return model.with_creep(records.data.sections, None)

    def with_creep(
        self, sections: Sequence[RecordSection], spectrum: CreepSpectrum | None
    ) -> "_CoarseModel":
        """Return the model with creep of another start or spectrum."""
        data = replace(self.records.data, sections=tuple(sections))
        chain = replace(data.chain, creep_per_decade=1.0, spectrum=spectrum)
        plain, creep = (
            np.concatenate(behind_chain(self.quasi_static, d))
            for d in (data, replace(data, chain=chain))
        )
        columns = np.column_stack((plain, creep - plain))
        return replace(self, columns=columns, gram=columns.T @ columns)

    def solve(self, extra: Array) -> _Solution:
        """Find density and creep, with extra columns of any sign."""
        y, free = self.records.y, np.column_stack((extra, self.records.nuisance))
        across = self.columns.T @ free
        normal = Normal(
            gram=np.block([[self.gram, across], [across.T, free.T @ free]]),
            right=np.concatenate((self.columns.T @ y, free.T @ y)),
            square=float(y @ y),
            count=y.size,
            columns=self.columns.shape[1],
        )

        def fit(creep: float) -> tuple[float, Solution]:
            sums = group_sums(normal, np.array([1.0, creep]))
            density = solve(sums, smoothing=self.penalty * y.size)
            return residual_square(sums, density), density

        minimum: Any = minimize_scalar(
            lambda creep: fit(float(creep))[0],
            # less than none stands for a delay of the chain that is too long
            bounds=(-_THRESHOLDS.largest_creep, _THRESHOLDS.largest_creep),
            method="bounded",
            options={"xatol": _THRESHOLDS.creep_error},
        )
        creep = float(minimum.x)
        density = fit(creep)[1]
        model = self._with_creep(creep) @ density.coefficients
        return _Solution(
            residual=y - model - free @ density.nuisance,
            weights=density.coefficients,
            creep=creep,
            extra=density.nuisance[: extra.shape[1]],
        )

    def _with_creep(self, creep: float) -> Array:
        """Columns of the density with creep, shape (n, m)."""
        plain, change = np.hsplit(self.columns, 2)
        return plain + creep * change

    def active_columns(self, solution: _Solution) -> Array:
        """Columns of the density that is not zero, with the creep of a solution."""
        return self._with_creep(solution.creep)[:, solution.weights > 0.0]

    def tangents(self, solution: _Solution) -> Array:
        """Changes of the model about a solution: its density, and a lag for every decade."""
        data = self.records.data
        output = [(c @ solution.weights)[:, None] for c in self.quasi_static]
        shortest = math.log10(10.0 * min(s.dt for s in data.sections))
        lags = []
        for decade in range(
            math.ceil(shortest), math.floor(math.log10(data.chain.creep_longest)) + 1
        ):
            chain = data.chain.with_lag(10.0**decade)
            lags.append(np.concatenate(behind_chain(output, replace(data, chain=chain))))
        return np.column_stack((self.active_columns(solution), *lags))

    def standard_error(self, solution: _Solution, column: Array, others: Array) -> float:
        """Return the standard error of the coefficient of a column, with others fitted along."""
        model, nuisance = self.active_columns(solution), self.records.nuisance
        change = np.hsplit(self.columns, 2)[1]
        basis = orthonormal(np.column_stack((model, change @ solution.weights, nuisance, others)))
        remainder = column - basis @ (basis.T @ column)
        inflation = _variance_inflation(solution.residual, max(self.records.cycle_rows))
        square = _mean_square(solution) * inflation
        return float(np.sqrt(square / max(float(remainder @ remainder), 1e-300)))


def _with_other_creep(model: _CoarseModel, chain: ChainValues) -> Iterator[_CoarseModel]:
    """Yield the model for other starts of creep, and with the spectrum where that is usual."""
    sections = model.records.data.sections
    for start in possible_starts(sections):
        if any(s.start != start for s in sections if not s.periodic):
            yield model.with_creep(with_start(sections, start), None)
    if chain.spectrum is not None and chain.creep.lag_gains[-1] <= _THRESHOLDS.usual_creep:
        yield model.with_creep(sections, chain.spectrum)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _JumpCandidate:
    """The row at which a step reduces the residual most."""

    row: int
    share: float
    """Share of the sum of squares that the step removes [1]."""
    residual: Array
    """Output less its projection on the tangents, shape (n,)."""
    basis: Array
    """Orthonormal columns of the tangents, shape (n, k)."""


def _next_jump(model: _CoarseModel, jumps: list[int]) -> int | None:
    """Return the row of the most likely further jump; None where no jump is significant."""
    records = model.records
    without = model.solve(records.steps(jumps))
    first = _likeliest_jump(model, without, jumps)
    # again with that jump in the model, which is then not distorted by it
    solution = model.solve(records.steps([*jumps, first.row]))
    best = _likeliest_jump(model, solution, jumps)
    if min(first.share, best.share) <= _THRESHOLDS.share:
        return None
    with_jump = model.solve(records.steps([*jumps, best.row]))
    if _mean_square(with_jump) > (1.0 - _THRESHOLDS.share) * _mean_square(without):
        return None
    step = records.steps([best.row])[:, 0]
    step -= best.basis @ (best.basis.T @ step)
    remainder = best.residual - step * float(step @ best.residual) / float(step @ step)
    inflation = _variance_inflation(remainder, max(records.cycle_rows))
    square = best.share / (1.0 - best.share) * records.y.size / inflation
    return best.row if square > _THRESHOLDS.certainty**2 else None


def _likeliest_jump(model: _CoarseModel, solution: _Solution, jumps: list[int]) -> _JumpCandidate:
    """Return the most likely jump about a solution that is not near one of the jumps."""
    records = model.records
    tangents = (model.tangents(solution), records.trends, records.nuisance, records.steps(jumps))
    basis = orthonormal(np.column_stack(tangents))
    residual = records.y - basis @ (basis.T @ records.y)
    share = _removed_squares(records, residual, basis) / max(float(residual @ residual), 1e-300)
    for k in jumps:
        share[records.around(k)] = 0.0
    row = int(np.argmax(share))
    return _JumpCandidate(row=row, share=float(share[row]), residual=residual, basis=basis)


def _removed_squares(records: _StackedRecords, residual: Array, basis: Array) -> Array:
    """Sum of squares that a step at each row removes from the residual, shape (n,).

    Zero where the tangents represent the step, and near ends of records and steps of the input.
    """
    removed = np.zeros(residual.size)
    ends = zip(records.ends[:-1], records.ends[1:], strict=True)
    for k, (a, b) in enumerate(ends):
        product = np.cumsum(residual[a:b][::-1])[::-1]
        projected = np.sum(np.cumsum(basis[a:b][::-1], axis=0)[::-1] ** 2, axis=1)
        after = np.arange(b - a, 0, -1.0)
        square = after - projected
        separable = square > _THRESHOLDS.separable * after * (1.0 - after / (b - a))
        part = np.where(separable, product**2 / np.where(separable, square, 1.0), 0.0)
        cycle = records.cycle_rows[k]
        part[:cycle] = part[max(b - a - cycle, 0) :] = 0.0
        u = records.data.sections[k].u[records.data.rows[k].at]
        part[_near_steps(u, max(8, cycle // 10))] = 0.0
        removed[a:b] = part
    return removed


def _variance_inflation(residual: Array, cycle: int) -> float:
    """Return how many times larger the variance of means is than that of white noise.

    The largest factor of means over 2 rows to 2 cycles, at least 1; the rows over it are the
    effective sample size.
    """
    inflation, width = 1.0, 2
    variance = max(float(np.mean(residual**2)), 1e-300)
    while width <= min(2 * cycle, residual.size // 8):
        means = residual[: residual.size // width * width].reshape(-1, width).mean(axis=1)
        inflation = max(inflation, width * float(np.mean(means**2)) / variance)
        width = math.ceil(1.5 * width)
    return inflation


def _mean_square(solution: _Solution) -> float:
    """Mean square of the residual."""
    return float(np.mean(solution.residual**2))


def _trend(rows: Rows) -> Array:
    """Rise by 1 from the first row to the last, about zero."""
    at = rows.at.astype(np.float64)
    return (at - at[0]) / max(at[-1] - at[0], 1.0) - 0.5


def _rows_in_cycle(section: RecordSection, rows: Rows) -> int:
    """Median number of rows in a cycle of a record."""
    every = int(np.median(np.diff(rows.at))) if rows.at.size > 1 else 1
    return max(int(np.median(np.diff(section.cycles.bounds))) // max(every, 1), 8)


def _near_steps(u: Array, distance: int) -> NDArray[np.bool_]:
    """Mark rows near steps of the input, where the residual of the model changes."""
    change = np.abs(np.diff(u, prepend=u[0]))
    usual = float(np.median(change[change > 0.0])) if change.any() else 0.0
    least = max(_THRESHOLDS.input_step_ratio * usual, _THRESHOLDS.input_step * float(np.ptp(u)))
    near = np.zeros(u.size, dtype=bool)
    for k in np.flatnonzero(change > least):
        near[max(k - distance, 0) : k + distance] = True
    return near


def _jump_fault(data: FitData, record: int, at: float, size: float) -> RecordFault:
    jump = data.sign * size
    percent = 100.0 * jump / data.stroke
    text = (
        f"the output jumps by {readable(data.output_unit, jump)} ({percent:.2g} % of the stroke) "
        f"at {at:.6g} s and keeps the new level, without a step of the input: check the sensor for "
        "a shift of its zero and the mounting for slip, and identify one side of the jump with "
        "--rows"
    )
    return RecordFault.of("jump", record, (at,), jump, data.stroke, text)


def _drift_faults(
    data: FitData, models: Sequence[_CoarseModel], square_without: float
) -> list[RecordFault]:
    """Return the significant drifts, with the best start of creep.

    `square_without` is the mean square of the best model without a trend.
    """
    trends = models[0].records.trends
    solutions = [(m, m.solve(trends)) for m in models]
    model, best = min(solutions, key=lambda pair: _mean_square(pair[1]))
    if _mean_square(best) > (1.0 - _THRESHOLDS.share) * square_without:
        return []
    halves = model.solve(np.column_stack((np.minimum(trends, 0.0), np.maximum(trends, 0.0)))).extra
    faults: list[RecordFault] = []
    count = len(data.sections)
    for k, section in enumerate(data.sections):
        # the trend is over the rows, the drift over the record
        r = model.records.data.rows[k].at
        longer = model.records.data.sections[k].u.size / float(r[-1] - r[0])
        others = np.delete(trends, k, axis=1)
        size = longer * data.sign * float(best.extra[k])
        error = longer * model.standard_error(best, trends[:, k], others)
        slow, fast = sorted((abs(halves[k]), abs(halves[count + k])))
        if (
            halves[k] * halves[count + k] <= 0.0
            or slow < _THRESHOLDS.steadiness * fast
            or abs(100.0 * size / data.stroke) < _THRESHOLDS.drift
            or abs(size) < _THRESHOLDS.certainty * error
        ):
            continue
        # other starts of creep that fit as well give other trends
        equal = [
            s.extra[k]
            for _, s in solutions
            if (1.0 - _THRESHOLDS.share) * _mean_square(s) <= _mean_square(best)
        ]
        error = math.hypot(error, 0.5 * longer * float(np.ptp(equal)))
        faults.append(_drift_fault(data, k, size, error, section.u.size * section.dt))
    return faults


def _drift_fault(
    data: FitData, record: int, size: float, error: float, duration: float
) -> RecordFault:
    percent = 100.0 * size / data.stroke
    unit, factor = readable_unit(size / duration, f"{data.output_unit or 'units'}/s")
    per_second = factor / duration
    text = (
        f"the output drifts by {size * per_second:.3g} {unit} (standard error "
        f"{error * per_second:.1g}), {percent:.2g} % of the stroke over the record, and does not "
        "slow down as creep does: fit a linear drift with --zero drift, and look for a source of "
        "heat"
    )
    return RecordFault.of("drift", record, (), size, data.stroke, text)
