"""Jumps and drift of the zero of a record, told from hysteresis and creep."""

import math
from collections.abc import Iterator, Sequence
from copy import copy
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from flexstage.base.arrays import Array
from flexstage.hysteresis.chain.creep import CreepSpectrum
from flexstage.hysteresis.drive_model import Start
from flexstage.hysteresis.identification.faults import RecordFault
from flexstage.hysteresis.identification.fit_rows import (
    ChainValues,
    Rows,
    averaged,
    filtered,
    rows_of,
)
from flexstage.hysteresis.identification.model_fit import FitData
from flexstage.hysteresis.identification.projection import Normal, orthonormal, solve
from flexstage.hysteresis.identification.record_section import RecordSection
from flexstage.hysteresis.models.preisach.fit import PreisachFit
from flexstage.quantities.units import readable, readable_unit


@dataclass(frozen=True, slots=True)
class _Thresholds:
    """What tells a change of the zero from hysteresis, creep and noise, and what is looked at."""

    samples: int = 12_000
    """Samples of all records that are looked at."""
    rows: int = 6000
    """Rows of them."""
    fewest_rows: int = 50
    """Records of fewer rows tell nothing of their zero."""
    jumps: int = 3
    """Jumps that are looked for in all records, at most."""
    worth: float = 0.15
    """A change is named where it takes this share of the mean square away."""
    certainty: float = 5.0
    """A change is named where it is so many times its standard error."""
    told: float = 0.01
    """A jump is named where this share of it could be neither hysteresis nor creep."""
    drift: float = 0.5
    """A drift over the record is named from this on [% of the stroke]."""
    goes_on: float = 0.5
    """A drift goes on in the slower half of the record at this share of its speed in the
    other: creep slows down.
    """
    creep: float = 0.3
    """Largest creep that is tried [1 per decade]."""
    usual_creep: float = 0.05
    """A spectrum whose slowest lag, as slow as the record is long, has more of the motion
    than this is none of creep: a drift is in it.
    """


_THRESHOLDS = _Thresholds()
#: Plays and intervals of the dictionary that stands for any hysteresis.
_DICTIONARY = (8, 8)


def zero_changes(data: FitData) -> list[RecordFault]:
    r"""Find where the zero of the output jumps, or that it drifts.

    A model takes much of either for creep, so that both are fitted together with all that a drive
    can do: a coarse Preisach model with its creep and the start of that, by projection. For a jump
    at :math:`k`, what is left of the output falls by :math:`(s_k^T e)^2 / s_k^T s_k`, where
    :math:`s_k` is the step less its projection on the model, on lags of every decade and on a
    trend: the most likely place is where that is largest (D. V. Hinkley, Biometrika 57 (1970) 1).
    A trend is compared with creep that goes with the logarithm of time, for each start of it.
    What is left is not white: its means over some samples, up to two cycles, scatter by more than
    they would if it were, and the squares count for so many times less.

    Validity: a step of the zero. One that takes seconds is named as a jump in its middle; creep
    that does not go with the logarithm of time may be named as a drift.
    """
    fit = _Fit(data)
    if min(r.at.size for r in fit.rows) < _THRESHOLDS.fewest_rows:
        return []
    rows: list[int] = []
    while len(rows) < _THRESHOLDS.jumps:
        found = fit.next_jump(rows)
        if found is None:
            break
        rows.append(found)
    jumps = fit.steps(rows)
    fits = [fit, *fit.others(data.chain)]
    without = min((f.solve(jumps) for f in fits), key=_square)
    made = [
        _jump_fault(data, *fit.place(row), float(size))
        for row, size in zip(rows, without.extra, strict=True)
    ]
    # a jump makes a trend, and is mended first
    if not made and not data.drift:
        made = _drifts(data, fits, _square(without))
    return sorted(made, key=lambda f: (f.record, f.at))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Solved:
    """Density and creep that fit best beside some columns, their coefficients, and what is left."""

    left: Array
    weights: Array
    creep: float
    extra: Array


class _Fit:
    """A coarse model of all records, one below the other."""

    def __init__(self, data: FitData) -> None:
        share = max(1, _THRESHOLDS.samples // len(data.sections))
        short = tuple(averaged(s, share) for s in data.sections)
        self.sections, self._full = short, data.sections
        self.rows = rows_of(short, _THRESHOLDS.rows)
        self._bare = replace(data.chain, creep_per_decade=0.0, spectrum=None)
        own = replace(data, sections=short, chain=self._bare, rows=self.rows, use=(), memo={})
        method = PreisachFit(*_DICTIONARY)
        self._quasi = [
            np.asfortranarray(np.concatenate(list(method.columns(s, own)), axis=1)) for s in short
        ]
        moving = np.any([np.ptp(c, axis=0) > 0.0 for c in self._quasi], axis=0)
        self._penalty = method.smoothing(own, moving) * own.input_scale**2
        plain = [filtered(c, s, r, self._bare) for c, s, r in self._each()]
        self._plain = np.concatenate(plain)
        self.y = np.concatenate([s.y[r.at] for s, r in zip(short, self.rows, strict=True)])
        self._take_creep(self._crept(short, None))
        self._begin = data.chain.creep_per_decade
        self.ends = np.cumsum([0, *(r.at.size for r in self.rows)])
        self._nuisance = self._own([s.nuisance[r.at] for _, s, r in self._each()])
        self.trends = self._own([_trend(r)[:, None] for r in self.rows])
        self._apart = [self._cycle(s, r) for _, s, r in self._each()]

    def _each(self) -> list[tuple[Array, RecordSection, Rows]]:
        return list(zip(self._quasi, self.sections, self.rows, strict=True))

    def _crept(self, sections: Sequence[RecordSection], spectrum: CreepSpectrum | None) -> Array:
        """What a unit of creep adds to the columns."""
        unit = replace(self._bare, creep_per_decade=1.0, spectrum=spectrum)
        own = zip(self._quasi, sections, self.rows, strict=True)
        return np.concatenate([filtered(c, s, r, unit) for c, s, r in own]) - self._plain

    def others(self, chain: ChainValues) -> Iterator["_Fit"]:
        """The same with creep that began otherwise, and with its spectrum where that is usual."""
        longest = max(s.u.size * s.dt for s in self.sections)
        starts: tuple[Start, ...] = ("rested", 0.0, longest, math.inf)
        begun = [
            [replace(s, start=start) for s in self.sections]
            for start in starts
            if any(s.start != start for s in self.sections)
        ]
        every: list[tuple[Sequence[RecordSection], CreepSpectrum | None]] = [
            (b, None) for b in begun
        ]
        if chain.spectrum is not None and chain.creep.lag_gains[-1] <= _THRESHOLDS.usual_creep:
            every.append((self.sections, chain.spectrum))
        for sections, spectrum in every:
            made = copy(self)
            made._take_creep(self._crept(sections, spectrum))
            yield made

    def _take_creep(self, creep: Array) -> None:
        """Take these columns for a unit of creep; products of all columns are found once."""
        self._creep = creep
        self._columns = np.column_stack((self._plain, creep))
        self._gram, self._right = self._columns.T @ self._columns, self._columns.T @ self.y

    def _own(self, columns: list[Array]) -> Array:
        """Columns of each record, zero in the others, shape (n, all columns)."""
        made = np.zeros((self.y.size, sum(c.shape[1] for c in columns)))
        first = 0
        for own, a, b in zip(columns, self.ends[:-1], self.ends[1:], strict=True):
            made[a:b, first : first + own.shape[1]] = own
            first += own.shape[1]
        return made

    @staticmethod
    def _cycle(section: RecordSection, rows: Rows) -> int:
        """Rows in a cycle."""
        every = int(np.median(np.diff(rows.at))) if rows.at.size > 1 else 1
        return max(int(np.median(np.diff(section.cycles.bounds))) // max(every, 1), 8)

    def steps(self, rows: Sequence[int]) -> Array:
        """Columns that rise by 1 at a row, and stay there to the end of its record."""
        made = np.zeros((self.y.size, len(rows)))
        for column, row in zip(made.T, rows, strict=True):
            column[row : self.ends[np.searchsorted(self.ends, row, side="right")]] = 1.0
        return made

    def place(self, row: int) -> tuple[int, float]:
        """Number of a row's record, and the time from its first sample [s]."""
        k = int(np.searchsorted(self.ends, row, side="right")) - 1
        at, s, full = self.rows[k].at, self.sections[k], self._full[k]
        own = row - int(self.ends[k])
        # between two rows the samples tell
        a, b = (round((at[own + i] - s.history) * s.dt / full.dt) + full.history for i in (-1, 0))
        b = min(max(b + 1, a + 2), full.y.size)
        sample = a + 1 + int(np.argmax(np.abs(np.diff(full.y[a:b]))))
        return k, full.begin + (sample - full.history) * full.dt

    def solve(self, extra: Array) -> _Solved:
        """Find density and creep in turn, with columns of any sign beside them."""
        beside = np.column_stack((extra, self._nuisance))
        m, k, n = self._plain.shape[1], beside.shape[1], self.y.size
        across = self._columns.T @ beside
        gram = np.block([[self._gram, across], [across.T, beside.T @ beside]])
        right = np.concatenate((self._right, beside.T @ self.y))
        square = float(self.y @ self.y)
        # columns that are fitted, as sums of all: with creep, beside them, and a change of creep
        mix = np.zeros((2 * m + k, m + k + 1))
        mix[:m, :m], mix[2 * m :, m:-1] = np.eye(m), np.eye(k)
        creep, weights = self._begin, np.zeros(m)
        found, total = np.zeros(k), np.zeros(2 * m + k)
        for turn in range(6):
            mix[m : 2 * m, :m] = creep * np.eye(m)
            now = mix if turn else mix[:, :-1]
            normal = Normal(
                gram=now.T @ gram @ now, right=now.T @ right, square=square, count=n, columns=m
            )
            solution = solve(normal, smoothing=self._penalty * n)
            weights, found = solution.coefficients, solution.nuisance
            total = now @ np.concatenate((weights, found))
            mix[m : 2 * m, -1] = weights
            if not turn:
                continue
            last, creep = creep, float(np.clip(creep + found[-1], 0.0, _THRESHOLDS.creep))
            if abs(creep - last) < 1e-5:
                break
        left = self.y - self._columns @ total[: 2 * m] - beside @ total[2 * m :]
        return _Solved(left=left, weights=weights, creep=creep, extra=found[: extra.shape[1]])

    def next_jump(self, known: list[int]) -> int | None:
        """Row of the most likely jump beside those that are known; None where there is none."""
        without = self.solve(self.steps(known))
        first = self._likely(without, known)
        # with the jump beside it the model is what it is without
        row, share, left, basis = self._likely(self.solve(self.steps([*known, first[0]])), known)
        if min(first[1], share) <= _THRESHOLDS.worth:
            return None
        if _square(self.solve(self.steps([*known, row]))) > (1.0 - _THRESHOLDS.worth) * _square(
            without
        ):
            return None
        step = self.steps([row])[:, 0]
        step -= basis @ (basis.T @ step)
        rest = left - step * float(step @ left) / float(step @ step)
        times = share / (1.0 - share) * self.y.size / self._alike(rest)
        return row if times > _THRESHOLDS.certainty**2 else None

    def _likely(self, solved: _Solved, known: list[int]) -> tuple[int, float, Array, Array]:
        """Row where a step takes most away, that share, what is left, and what the model takes."""
        share, left, basis = self._shares(solved, self.steps(known))
        for k in known:
            share[self._near(k)] = 0.0
        row = int(np.argmax(share))
        return row, float(share[row]), left, basis

    def _near(self, row: int) -> slice:
        apart = self._apart[int(np.searchsorted(self.ends, row, side="right")) - 1]
        return slice(max(row - apart, 0), row + apart)

    def _tangents(self, solved: _Solved) -> Array:
        """What the model can do about a solution: its density, and lags of every decade."""
        shortest = math.log10(10.0 * min(s.dt for s in self.sections))
        longest = math.log10(self._bare.creep_longest)
        parts = []
        for decade in range(math.ceil(shortest), math.floor(longest) + 1):
            lag = CreepSpectrum(times=(10.0**decade,), weights=(1.0,))
            chain = replace(self._bare, spectrum=lag, creep_per_decade=lag.rate_per_decade)
            own = [filtered((c @ solved.weights)[:, None], s, r, chain) for c, s, r in self._each()]
            parts.append(np.concatenate(own))
        held = solved.weights > 0.0
        return np.column_stack(((self._plain + solved.creep * self._creep)[:, held], *parts))

    def _shares(self, solved: _Solved, columns: Array) -> tuple[Array, Array, Array]:
        """Share of the squares that a step at each row takes away; what is left; what is taken."""
        every = (self._tangents(solved), self.trends, self._nuisance, columns)
        basis = orthonormal(np.column_stack(every))
        left = self.y - basis @ (basis.T @ self.y)
        share = np.zeros(self.y.size)
        for k, (a, b) in enumerate(zip(self.ends[:-1], self.ends[1:], strict=True)):
            product = np.cumsum(left[a:b][::-1])[::-1]
            taken = np.sum(np.cumsum(basis[a:b][::-1], axis=0)[::-1] ** 2, axis=1)
            after = np.arange(b - a, 0, -1.0)
            square = after - taken
            told = square > _THRESHOLDS.told * after * (1.0 - after / (b - a))
            own = np.where(told, product**2 / np.where(told, square, 1.0), 0.0)
            apart = self._apart[k]
            own[:apart] = own[max(b - a - apart, 0) :] = 0.0
            own[_steps(self.sections[k].u[self.rows[k].at], max(8, apart // 10))] = 0.0
            share[a:b] = own
        return share / max(float(left @ left), 1e-300), left, basis

    def _alike(self, left: Array) -> float:
        """How many neighbours are as good as one: by means over some of them, up to two cycles."""
        least, width = 1.0, 2
        whole = max(float(np.mean(left**2)), 1e-300)
        while width <= min(2 * max(self._apart), left.size // 8):
            means = left[: left.size // width * width].reshape(-1, width).mean(axis=1)
            least = max(least, width * float(np.mean(means**2)) / whole)
            width = math.ceil(1.5 * width)
        return least

    def error_of(self, solved: _Solved, column: Array, others: Array) -> float:
        """Standard error of the coefficient of a column."""
        held = solved.weights > 0.0
        model = (self._plain + solved.creep * self._creep)[:, held]
        basis = orthonormal(
            np.column_stack((model, self._creep @ solved.weights, self._nuisance, others))
        )
        own = column - basis @ (basis.T @ column)
        square = _square(solved) * self._alike(solved.left)
        return float(np.sqrt(square / max(float(own @ own), 1e-300)))


def _square(solved: _Solved) -> float:
    """Mean square that is left."""
    return float(np.mean(solved.left**2))


def _trend(rows: Rows) -> Array:
    """Rise by 1 from the first row to the last, about zero."""
    at = rows.at.astype(np.float64)
    return (at - at[0]) / max(at[-1] - at[0], 1.0) - 0.5


def _steps(u: Array, near: int) -> NDArray[np.bool_]:
    """Rows about steps of the input: what a model lacks changes there."""
    moved = np.abs(np.diff(u, prepend=u[0]))
    usual = float(np.median(moved[moved > 0.0])) if moved.any() else 0.0
    made = np.zeros(u.size, dtype=bool)
    for k in np.flatnonzero(moved > max(20.0 * usual, 0.01 * float(np.ptp(u)))):
        made[max(k - near, 0) : k + near] = True
    return made


def _jump_fault(data: FitData, record: int, at: float, size: float) -> RecordFault:
    jump = data.sign * size
    percent = 100.0 * jump / data.stroke
    return RecordFault(
        kind="jump",
        record=record,
        at=(at,),
        size=jump,
        percent=percent,
        text=f"the output jumps by {readable(data.output_unit, jump)} "
        f"({percent:.2g} % of the stroke) at {at:.6g} s and stays there, and the input "
        "does not: has the zero of the sensor changed, or has something slipped? "
        "Identify one side of it, by --rows",
    )


def _drifts(data: FitData, fits: Sequence[_Fit], without: float) -> list[RecordFault]:
    """Compare the best model without a trend with the best one with it, of every start of creep."""
    solved = [(f, f.solve(f.trends)) for f in fits]
    fit, best = min(solved, key=lambda pair: _square(pair[1]))
    if _square(best) > (1.0 - _THRESHOLDS.worth) * without:
        return []
    early, late = np.minimum(fit.trends, 0.0), np.maximum(fit.trends, 0.0)
    halves = fit.solve(np.column_stack((early, late))).extra
    made: list[RecordFault] = []
    count = len(data.sections)
    for k, s in enumerate(data.sections):
        # over what is compared, and then over the record
        r = fit.rows[k].at
        longer = fit.sections[k].u.size / float(r[-1] - r[0])
        others = np.delete(fit.trends, k, axis=1)
        size = longer * data.sign * float(best.extra[k])
        error = longer * fit.error_of(best, fit.trends[:, k], others)
        percent = 100.0 * size / data.stroke
        slow, fast = sorted((abs(halves[k]), abs(halves[count + k])))
        if (
            halves[k] * halves[count + k] <= 0.0
            or slow < _THRESHOLDS.goes_on * fast
            or abs(percent) < _THRESHOLDS.drift
            or abs(size) < _THRESHOLDS.certainty * error
        ):
            continue
        # starts that are as good give other trends
        good = [
            o.extra[k] for _, o in solved if (1.0 - _THRESHOLDS.worth) * _square(o) <= _square(best)
        ]
        error = math.hypot(error, 0.5 * longer * float(np.ptp(good)))
        unit, factor = readable_unit(size / (s.u.size * s.dt), f"{data.output_unit or 'units'}/s")
        per_second = factor / (s.u.size * s.dt)
        made.append(
            RecordFault(
                kind="drift",
                record=k,
                at=(),
                size=size,
                percent=percent,
                text=f"the output drifts by {size * per_second:.3g} {unit} "
                f"(standard error {error * per_second:.1g}), {percent:.2g} % of the stroke over "
                "the record, and does not slow down as creep does: fit it beside the model by "
                "--drift, and look for what warms up",
            )
        )
    return made
