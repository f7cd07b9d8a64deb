"""Changes within a record that no drive makes: of zero, gain or time of the output, and drift."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from flexstage.base.arrays import Array
from flexstage.hysteresis.chain.creep import Start
from flexstage.hysteresis.identification.chain_residual import dictionary
from flexstage.hysteresis.identification.cycles import RecordSection
from flexstage.hysteresis.identification.faults import RecordFault, likely_shifts, shift_text
from flexstage.hysteresis.identification.fit_rows import (
    ChainValues,
    Rows,
    averaged,
    filtered,
    rows_of,
)
from flexstage.hysteresis.identification.model_fit import FitData
from flexstage.hysteresis.identification.projection import (
    normal_equations,
    orthonormal,
    solve,
)
from flexstage.quantities.units import readable, readable_unit


@dataclass(frozen=True, slots=True)
class _Thresholds:
    """Limits of the search.

    Those without a source were set so that clean records show no change and that the changes in
    ``tests/analytic/test_quality_report.py`` are found; that test checks both.
    """

    samples: int = 12_000
    """Samples that a record is averaged to: bounds the time of the search."""
    rows: int = 6000
    """Rows of these that the coarse model is fitted to: bounds the time of the search."""
    cycles: int = 3
    """Fewest cycles of a record after both ends of the range were reached: no jump is looked for in
    the first and the last one.
    """
    turns: int = 2
    """Fits of density and creep in turn: the second one changes creep by a few per cent."""
    jumps: int = 3
    """Largest number of jumps in a record."""
    share: float = 0.15
    """Smallest share of the mean square that a change removes; a change of gain also of what the
    best jump leaves.
    """
    certainty: float = 5.0
    """Smallest change in standard errors: five, as every row is tested."""
    separable: float = 0.01
    """Smallest share of a step that the coarse model cannot represent; elsewhere a jump would be
    taken for hysteresis or creep.
    """
    gain: float = 0.015
    """Smallest change of gain: models follow changes with rate and amplitude within 1 %."""
    drift: float = 0.005
    """Smallest drift over the record, as a share of the stroke: models leave 0.001 to 0.02."""
    steadiness: float = 0.5
    """Smallest ratio of the speeds of a drift in the two halves of a record: logarithmic creep
    slows down more.
    """
    input_step: float = 0.01
    """A step of the input exceeds this share of its range ..."""
    input_step_ratio: float = 20.0
    """... and the median step this many times: the residual of the model changes there."""
    shift: float = 0.05
    """Smallest shift in time, as a share of the fastest cycle: a model finds a smaller one."""
    shifted: float = 0.5
    """Largest share of the squared residual that it leaves."""
    good: float = 0.003
    """Residual of a coarse model, as a share of the stroke, that needs no shift."""
    repeats: float = 0.01
    """Inputs that differ by less, as a share of the range, do not show a shift."""
    equal: float = 1.5
    """Of shifts that leave less than this many times the smallest residual, the least is likely."""
    shift_rows: int = 600
    """Rows that shifts are tried with: bounds the time."""


_THRESHOLDS = _Thresholds()


def record_changes(data: FitData) -> list[RecordFault]:
    r"""Find an output recorded at another time than its input, and changes of its gain or zero.

    A coarse Preisach model with its creep stands for all that a drive can do. A shift in time is
    one that the correlation of input and output suggests, and that leaves less than half of the
    squared residual. A step :math:`s_k` of the zero at row :math:`k`, projected on the model, on
    lags of every decade, a trend, and a gain that depends on rate and amplitude, removes
    :math:`(s_k^T e)^2 / s_k^T s_k` of the squared residual :math:`e`; one of the gain is the same
    step times the motion. The likeliest row is that at which it removes most (D. V. Hinkley,
    Biometrika 57 (1970) 1). The residual is not white: the variance inflation of its means, up to
    two cycles, divides the squares. A trend is compared with creep in proportion to the logarithm
    of time, for each start of it. Of a shift, a gain, jumps and a drift the first ones cause the
    others, and are corrected first.

    Validity: cycles that are not all the same; one change of gain, by 1.5 % and more; a step of the
    zero. One that takes seconds is reported as a jump in its middle; creep that is not logarithmic
    may be reported as a drift.
    """
    turned = {f.record for f in data.findings if f.kind == "butterfly"}
    return [
        fault
        for k, section in enumerate(data.sections)
        if section.measured is None and not section.periodic
        for fault in _changes_of(data, k, zero=k not in turned)
    ]


def _changes_of(data: FitData, number: int, *, zero: bool) -> list[RecordFault]:
    section = data.sections[number]
    model = _CoarseModel.of(data, section)
    if model.y.size < 4 * model.plain.shape[1]:
        return []

    def fault(kind: str, at: Sequence[float], size: float, text: str) -> RecordFault:
        return RecordFault.of(kind, number, at, size, data.stroke, text)

    fastest = max(data.rates_hz, default=math.inf)
    lag = _shift(model, round(_THRESHOLDS.shift / (fastest * model.section.dt)))
    if lag != 0:
        return [fault("shift", (), 0.0, shift_text(lag * model.section.dt))]
    rows, gain = _steps(model)
    if gain != 0.0:
        at = model.time_of(rows[0], section)
        text = (
            f"the gain changes by about {100.0 * gain:.2g} % at {at:.4g} s: check sensor and "
            "amplifier for a change of range, and identify one side of it with --rows"
        )
        return [fault("gain", (at,), gain * data.stroke, text)]
    if not zero or model.y.size < _THRESHOLDS.cycles * model.cycle:
        return []
    best = model.fits(model.steps(rows))[0]
    faults = []
    for row, step in sorted(zip(rows, best.extra, strict=True)):
        at, size = model.time_of(row, section), data.sign * float(step)
        text = (
            f"the output jumps by {readable(data.output_unit, size)} "
            f"({100.0 * size / data.stroke:.2g} % of the stroke) at {at:.6g} s and keeps the new "
            "level, without a step of the input: check the sensor for a shift of its zero and the "
            "mounting for slip, and identify one side of the jump with --rows"
        )
        faults.append(fault("jump", (at,), size, text))
    if faults or data.zero == "drift":
        return faults
    drift, error = _drift(model, best, data.stroke)
    if drift == 0.0:
        return []
    size, duration = data.sign * drift, section.u.size * section.dt
    unit, factor = readable_unit(size / duration, f"{data.output_unit or 'units'}/s")
    text = (
        f"the output drifts by {size * factor / duration:.3g} {unit} "
        f"(standard error {error * factor / duration:.1g}), {100.0 * size / data.stroke:.2g} % of "
        "the stroke over the record, and does not slow down as creep does: fit a linear drift with "
        "--zero drift, and look for a source of heat"
    )
    return [fault("drift", (), size, text)]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Fit:
    """Best density and creep of the coarse model, with extra columns."""

    residual: Array
    """Output less model, shape (n,)."""
    output: Array
    """Output of the Preisach model at every sample, shape (samples, 1)."""
    active: Array
    """Columns of the density that is not zero, of creep, and nuisance columns, shape (n, k)."""
    extra: Array
    """Coefficients of the extra columns."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _CoarseModel:
    """A coarse Preisach model of a record of n rows, with creep and nuisance columns."""

    section: RecordSection
    """The averaged record."""
    rows: Rows
    """Its rows, after both ends of the range were reached."""
    chain: ChainValues
    """The chain without creep."""
    quasi_static: Array
    """Columns of the Preisach model at every sample, shape (samples, m)."""
    penalty: Array
    """Penalty of the density, per row."""
    plain: Array
    """The columns behind the chain, at the rows, shape (n, m)."""

    @classmethod
    def of(cls, data: FitData, section: RecordSection) -> "_CoarseModel":
        """Return the coarse model of a record."""
        short = averaged(section, _THRESHOLDS.samples)
        # earlier motion affects samples until both ends were reached
        later = replace(short, warm_up=max(short.warm_up, short.both_ends))
        chain = replace(data.chain, creep_per_decade=0.0, spectrum=None)
        (columns,), _, penalty = dictionary(replace(data, sections=(short,), memo={}))
        columns, (rows,) = np.asfortranarray(columns), rows_of([later], _THRESHOLDS.rows)
        return cls(
            section=short,
            rows=rows,
            chain=chain,
            quasi_static=columns,
            penalty=penalty * data.input_scale**2,
            plain=filtered(columns, short, rows, chain),
        )

    @property
    def y(self) -> Array:
        """Output at the rows, shape (n,)."""
        return self.section.y[self.rows.at]

    @property
    def nuisance(self) -> Array:
        """Nuisance columns at the rows, shape (n, k)."""
        return self.section.nuisance[self.rows.at]

    @property
    def trend(self) -> Array:
        """Rise by 1 over the record, about zero at the middle row, shape (n,)."""
        at = self.rows.at.astype(np.float64)
        return (at - 0.5 * (at[0] + at[-1])) / self.section.u.size

    @property
    def cycle(self) -> int:
        """Number of rows in a cycle."""
        every = max(int(np.median(np.diff(self.rows.at))), 1)
        return max(int(np.median(np.diff(self.section.cycles.bounds))) // every, 8)

    def steps(self, rows: Sequence[int]) -> Array:
        """Columns that rise by 1 at a row, shape (n, rows)."""
        return (np.arange(self.y.size)[:, None] >= np.array(rows)).astype(np.float64)

    def time_of(self, row: int, full: RecordSection) -> float:
        """Time of a step [s]: that of the largest step of the samples before a row."""
        every = round(self.section.dt / full.dt)
        a, b = ((self.rows.at[[row - 1, row]] - self.section.history) * every).tolist()
        y = full.y[full.history :]
        sample = a + 1 + int(np.argmax(np.abs(np.diff(y[a : max(b + 1, a + 2)]))))
        return full.begin + sample * full.dt

    def fits(self, extra: Array) -> list[_Fit]:
        """Find density and creep with extra columns of any sign, for each start, the best first."""
        plain = self._fit(extra, np.zeros((self.y.size, 0)))
        chain = replace(self.chain, creep_per_decade=1.0)
        starts: tuple[Start, ...] = ("rested", 0.0, self.section.u.size * self.section.dt, math.inf)
        fits = []
        for start in starts:
            section, fit = replace(self.section, start=start), plain
            for _ in range(_THRESHOLDS.turns):  # density and creep in turn
                fit = self._fit(extra, filtered(fit.output, section, self.rows, chain))
            fits.append(fit)
        return sorted(fits, key=_mean_square)

    def _fit(self, extra: Array, creep: Array) -> _Fit:
        free = np.column_stack((extra, creep, self.nuisance))
        normal = normal_equations(self.plain, free, self.y)
        density = solve(normal, smoothing=self.penalty * self.y.size)
        w = density.coefficients
        return _Fit(
            residual=self.y - self.plain @ w - free @ density.nuisance,
            output=(self.quasi_static @ w)[:, None],
            active=np.column_stack((self.plain[:, w > 0.0], creep, self.nuisance)),
            extra=density.nuisance[: extra.shape[1]],
        )

    def tangents(self, fit: _Fit) -> Array:
        """Changes of the model about a fit: its density, a lag for every decade, and a trend."""
        shortest = math.ceil(math.log10(10.0 * self.section.dt))
        decades = range(shortest, math.floor(math.log10(self.chain.creep_longest)) + 1)
        chains = [self.chain.with_lag(10.0**decade) for decade in decades]
        lags = [filtered(fit.output, self.section, self.rows, chain) for chain in chains]
        return np.column_stack((fit.active, *lags, self.trend))


def _shift(model: _CoarseModel, least: int) -> int:
    """Shift of the output [samples] with which it fits the model far better, else 0."""
    section, few = model.section, slice(None, None, max(1, model.y.size // _THRESHOLDS.shift_rows))
    at, first, size = model.rows.at[few], int(model.rows.at[0]), section.u.size
    # of creep only a trend, as a shift is mistaken for creep
    columns = np.column_stack((model.plain, model.nuisance, model.trend))[few]
    delay, span = round(model.chain.delay / section.dt), float(np.ptp(section.u))

    def left(outputs: NDArray[np.intp], use: NDArray[np.bool_]) -> float:
        target = section.y[outputs[use]]
        fit = columns[use] @ np.linalg.lstsq(columns[use], target, rcond=1e-9)[0]
        return float(np.mean((target - fit) ** 2))

    shares: dict[int, float] = {}
    good = (_THRESHOLDS.good * float(np.ptp(section.y))) ** 2
    if left(at, at >= first) < good:
        return 0
    for lag in likely_shifts(section.u[first:], section.y[first:], least):
        later = at + lag - delay
        # the same samples of the output, so that a fault elsewhere is no reason for a shift
        use = (later >= first + least) & (later < size - least)
        same = (at >= later[use].min()) & (at <= later[use].max())
        near = range(-least, least + 1, max(1, least // 25))
        differs = min(np.std(section.u[later[use] + k] - section.u[at[use]]) for k in near)
        if same.any() and differs > _THRESHOLDS.repeats * span:
            shares[lag] = left(later, use) / max(left(at, same), good)
    smallest = min(shares.values(), default=1.0)
    likely = [lag for lag, share in shares.items() if share <= _THRESHOLDS.equal * smallest]
    return min(likely, key=abs) if smallest < _THRESHOLDS.shifted else 0


def _steps(model: _CoarseModel) -> tuple[list[int], float]:
    """Rows of jumps of the zero, and 0; or the row of a change of the gain, and that change."""
    rows: list[int] = []
    while len(rows) < _THRESHOLDS.jumps:
        first = _likeliest_step(model, rows, rows)
        # again with that jump in the model, which is then not distorted by it
        best = first if first.gain else _likeliest_step(model, rows, [*rows, first.row])
        if best.gain != 0.0:
            return [best.row], best.gain
        if first.size == 0.0 or best.size <= _THRESHOLDS.certainty:
            break
        rows.append(best.row)
    return rows, 0.0


@dataclass(frozen=True, slots=True)
class _Step:
    """The row at which a step reduces the residual most."""

    row: int
    size: float
    """Size in standard errors; 0 if the step removes too little."""
    gain: float
    """Change of the gain there, if that is certain; else 0."""


def _likeliest_step(model: _CoarseModel, jumps: list[int], fitted: list[int]) -> _Step:
    """Return the most likely step that is not near a jump, about a fit with steps."""
    fit = model.fits(model.steps(fitted))[0]
    motion = (model.y - fit.residual) - model.steps(fitted) @ fit.extra
    motion -= motion.mean()
    moves = model.section.cycles
    kinds = np.column_stack((moves.frequency_hz, moves.swing))[model.rows.cycle - 1]
    basis = orthonormal(
        np.column_stack((model.tangents(fit), model.steps(jumps), kinds * motion[:, None]))
    )
    residual = model.y - basis @ (basis.T @ model.y)
    n, total = residual.size, max(float(residual @ residual), 1e-300)
    steps = np.column_stack((np.ones(n), motion))
    # products from each row to the end, of the steps less their projections on the model
    right = _to_the_end(residual[:, None] * steps)
    inside = _to_the_end(steps[:, :, None] * basis[:, None, :])
    gram = _to_the_end(steps[:, :, None] * steps[:, None, :]) - inside @ inside.transpose(0, 2, 1)
    after = np.arange(n, 0, -1.0)
    jump = np.maximum(gram[:, 0, 0], 1e-300)
    far = _far_from_steps(model, jumps)
    separable = far & (jump > _THRESHOLDS.separable * after * (1.0 - after / n))
    by_jump = np.where(separable, right[:, 0] ** 2 / jump, 0.0)
    row = int(np.argmax(by_jump))
    removed = float(by_jump[row])
    mixed = gram[:, 0, 1] / jump
    bare = gram[:, 1, 1] - mixed * gram[:, 0, 1]
    inner = (np.arange(n) >= n // 10) & (np.arange(n) < n - n // 10)
    separable = inner & (bare > _THRESHOLDS.separable * float(motion @ motion))
    gain = (right[:, 1] - mixed * right[:, 0]) / np.where(separable, bare, math.inf)
    both = np.where(separable, right[:, 0] ** 2 / jump + gain**2 * bare, 0.0)
    k, share = int(np.argmax(both)), _THRESHOLDS.share
    is_gain = not jumps and abs(gain[k]) > _THRESHOLDS.gain and both[k] > share * total
    if is_gain and both[k] - removed > share * (total - removed):
        both_steps = model.steps([k]) * steps
        return _Step(k, 0.0, float(model.fits(both_steps)[0].extra[1]))
    if removed <= share * total:
        return _Step(row, 0.0, 0.0)
    step = model.steps([row])[:, 0] - basis @ inside[row, 0]
    remainder = residual - step * float(right[row, 0] / jump[row])
    square = removed / (total - removed) * n / _variance_inflation(remainder, model.cycle)
    return _Step(row, math.sqrt(square), 0.0)


def _to_the_end(values: Array) -> Array:
    """Sum from each row to the last."""
    return np.cumsum(values[::-1], axis=0)[::-1]


def _far_from_steps(model: _CoarseModel, jumps: list[int]) -> NDArray[np.bool_]:
    """Mark rows away from ends, jumps, and steps of the input, where the residual changes."""
    n, cycle = model.y.size, model.cycle
    change = np.abs(np.diff(model.section.u[model.rows.at], prepend=np.nan))
    usual, span = float(np.nanmedian(change)), float(np.ptp(model.section.u))
    least = max(_THRESHOLDS.input_step_ratio * usual, _THRESHOLDS.input_step * span)
    input_steps = np.flatnonzero(change > least)
    far = np.ones(n, dtype=bool)
    for distance, places in ((cycle, (0, n, *jumps)), (max(8, cycle // 10), input_steps)):
        for k in places:
            far[max(k - distance, 0) : k + distance] = False
    return far


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


def _mean_square(fit: _Fit) -> float:
    """Mean square of the residual."""
    return float(np.mean(fit.residual**2))


def _drift(model: _CoarseModel, without: _Fit, stroke: float) -> tuple[float, float]:
    """Drift over the record, and its standard error; 0 if there is none."""
    trend = model.trend
    fits = model.fits(trend[:, None])
    fit, share_left = fits[0], 1.0 - _THRESHOLDS.share
    if _mean_square(fit) > share_left * _mean_square(without):
        return 0.0, 0.0
    size = float(fit.extra[0])
    halves = model.fits(np.column_stack((np.minimum(trend, 0.0), np.maximum(trend, 0.0))))[0].extra
    slow, fast = sorted((halves * np.sign(size)).tolist())
    basis = orthonormal(fit.active)
    bare = trend - basis @ (basis.T @ trend)
    square = _mean_square(fit) * _variance_inflation(fit.residual, model.cycle)
    error = math.sqrt(square / max(float(bare @ bare), 1e-300))
    large = abs(size) > max(_THRESHOLDS.drift * stroke, _THRESHOLDS.certainty * error)
    if not large or slow <= 0.0 or slow < _THRESHOLDS.steadiness * fast:
        return 0.0, 0.0
    # other starts of creep that fit as well give other trends
    equal = [f.extra[0] for f in fits if share_left * _mean_square(f) <= _mean_square(fit)]
    return size, math.hypot(error, 0.5 * float(np.ptp(equal)))
