"""Fits of models: data, results, and models linear in all of their parameters."""

import functools
import math
import operator
from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from flexstage.base.arrays import Array
from flexstage.base.errors import ModelError, RecordError
from flexstage.hysteresis.identification.cycles import RecordSection
from flexstage.hysteresis.identification.fit_rows import (
    ChainValues,
    Rows,
    averaged,
    filtered,
    rows_of,
)
from flexstage.hysteresis.identification.measurement import IdentificationData
from flexstage.hysteresis.identification.projection import (
    Normal,
    Solution,
    normal_equations,
    residual_square,
    solve,
)
from flexstage.hysteresis.model import HysteresisModel
from flexstage.hysteresis.models.registry import MODELS, fit_class
from flexstage.hysteresis.requests import OSCILLATOR

#: Samples and rows of the coarse search, and the factor on its limits of averaging.
_COARSE_SAMPLES = 5000
_COARSE_ROWS = 2500
_COARSE_LOOSE = 10.0
#: Smallest slope just after a turn, over the mean slope, which an inverse needs. Where the true
#: slope is zero, it adds 3 to 5 % to the residual of simulated loops, and 0.05 up to 280 %.
_FLATTEST = 0.01
#: Errors within this factor are the same.
SAME = 1.1
#: A column behind the chain is constant if it changes by less than this, over the largest change.
_ROUNDING = 1e-9


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FitData(IdentificationData):
    """Data of a fit: a measurement behind a known chain, and the rows in use."""

    chain: ChainValues
    """The chain behind the hysteresis."""
    rows: tuple[Rows, ...]
    """Rows of each section."""
    use: tuple[NDArray[np.bool_], ...]
    """True for fitted rows, shape (r,); the others are held out."""
    memo: dict[str, Any] = field(default_factory=dict)
    """Cached results of fits for all rows, for other values of `use`."""

    @property
    def input_scale(self) -> float:
        """Range of the input."""
        low, high = self.input_range
        return high - low

    @property
    def measurement(self) -> IdentificationData:
        """The measurement alone."""
        return IdentificationData(**_of_measurement(self))

    def with_use(self, use: tuple[NDArray[np.bool_], ...]) -> "FitData":
        """Return the same data with other samples held out."""
        return replace(self, use=use)

    def with_output(self, output: list[Array]) -> "FitData":
        """Return the same data with another output."""
        sections = []
        for s, r, values in zip(self.sections, self.rows, output, strict=True):
            y = s.y.copy()
            y[r.at] = values
            sections.append(replace(s, y=y))
        return replace(self, sections=tuple(sections))


def fit_data(
    data: IdentificationData,
    chain: ChainValues,
    train: tuple[int, int] | None = None,
) -> FitData:
    """Return a measurement behind a chain; the first sample to use, and the one after the last."""
    rows = rows_of(data.sections)
    first, stop = train or (-math.inf, math.inf)
    at = [r.at - s.history + s.first for r, s in zip(rows, data.sections, strict=True)]
    use = tuple((a >= first) & (a < stop) for a in at)
    if train is not None:
        in_use, held_out = sum(int(u.sum()) for u in use), sum(int((~u).sum()) for u in use)
        if in_use < 50 or held_out < 50:
            raise RecordError(
                f"samples {first} to {stop} give {in_use} fitted and {held_out} held-out "
                "samples after the warm-up: at least 50 of each are needed"
            )
    return FitData(**_of_measurement(data), chain=chain, rows=rows, use=use)


def _of_measurement(data: IdentificationData) -> dict[str, Any]:
    return {f.name: getattr(data, f.name) for f in fields(IdentificationData)}


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FitResult:
    """A fitted model."""

    model: HysteresisModel
    """The model."""
    search: Array = field(default_factory=lambda: np.zeros(0))
    """Optimum of the nonlinear parameters, shape (s,)."""
    notes: tuple[str, ...] = ()
    """Warnings."""


class ModelFit(ABC):
    """Fitting method of a model."""

    #: The model.
    law: ClassVar[type[HysteresisModel]]
    #: Number of parameters.
    size: int
    #: True if it is a candidate when no model is named.
    automatic: bool = True

    @property
    def kind(self) -> str:
        """Name of the model."""
        return self.law.kind

    @abstractmethod
    def fit(self, data: FitData, start: Array | None = None) -> FitResult:
        """Fit the model.

        `start` is the first value of the nonlinear parameters; a grid over their range if None.
        """

    def refit(self, data: FitData, optimum: Array) -> FitResult:
        """Fit fewer samples, from the optimum of more of them, which is near."""
        return self.fit(data, optimum if optimum.size else None)


def behind_chain(columns: list[Array], data: FitData) -> list[Array]:
    """Pass columns through the chain.

    From every sample of each section, shape (n, m), to its rows, shape (r, m).
    """
    return [
        filtered(c, s, r, data.chain)
        for c, s, r in zip(columns, data.sections, data.rows, strict=True)
    ]


def equations(behind: list[Array], data: FitData, key: str = "") -> Normal:
    """Form the normal equations of the samples in use.

    Columns are behind the chain, at the rows of each section. A key names these columns: sums over
    all samples are then formed once, and those of held-out samples are subtracted.
    """
    if not key:
        return _summed(behind, data)
    name = f"{key} equations"
    if name not in data.memo:
        data.memo[name] = data.use, _summed(behind, data)
    rows_of_total, total = data.memo[name]
    less = [a & ~b for a, b in zip(rows_of_total, data.use, strict=True)]
    more = any(np.any(b & ~a) for a, b in zip(rows_of_total, data.use, strict=True))
    if more or 2 * sum(map(np.sum, less)) > total.count:
        return _summed(behind, data)
    if not any(map(np.any, less)):
        return total
    return total - _summed(behind, data.with_use(tuple(less)))


def _summed(behind: list[Array], data: FitData) -> Normal:
    sections = []
    for c, s, r, use in zip(behind, data.sections, data.rows, data.use, strict=True):
        nuisance, y = s.nuisance[r.at], s.y[r.at]
        sections.append(normal_equations(c, nuisance, y, runs(use)))
    return functools.reduce(operator.add, sections)


def runs(use: NDArray[np.bool_]) -> list[slice]:
    """Return the runs of samples in use."""
    ends = np.flatnonzero(np.diff(use, prepend=False, append=False))
    return [slice(a, b) for a, b in ends.reshape(-1, 2).tolist()]


def coarse(data: FitData) -> FitData:
    """Return averaged data for the first stage of a search.

    Means of neighbouring samples, and few rows of them; means with any held-out sample are held
    out. Cached starts of searches are those of all samples.
    """
    if "coarse" not in data.memo:
        share = _COARSE_SAMPLES // len(data.sections)
        sections = tuple(averaged(s, share, _COARSE_LOOSE) for s in data.sections)
        data.memo["coarse"] = sections, rows_of(sections, _COARSE_ROWS)
    sections, rows = data.memo["coarse"]
    use = tuple(
        _within(coarse_rows.at, round(c.dt / s.dt), r.at, u)
        for coarse_rows, c, s, r, u in zip(
            rows, sections, data.sections, data.rows, data.use, strict=True
        )
    )
    memo = {name: value for name, value in data.memo.items() if name.endswith(" start")}
    return replace(data, sections=sections, rows=rows, use=use, memo=memo)


def _within(
    means: NDArray[np.intp], every: int, at: NDArray[np.intp], use: NDArray[np.bool_]
) -> NDArray[np.bool_]:
    """Mark the means of samples in use, by the rows next to their first and last sample."""
    last = at.size - 1
    first = np.clip(np.searchsorted(at, means * every, side="right") - 1, 0, last)
    after = np.clip(np.searchsorted(at, (means + 1) * every - 1), 0, last)
    return use[first] & use[after]


def residual(behind: list[Array], solution: Solution, data: FitData) -> Array:
    """Return the residual of a solution at the rows in use."""
    left, first = [], 0
    for c, s, r, use in zip(behind, data.sections, data.rows, data.use, strict=True):
        count = s.nuisance.shape[1]
        coefficients = solution.nuisance[first : first + count]
        first += count
        model_output = c @ solution.coefficients + s.nuisance[r.at] @ coefficients
        left.append((s.y[r.at] - model_output)[use])
    return np.concatenate(left)


def errors_of(model: HysteresisModel, data: FitData) -> list[Array]:
    """Return the output less a model behind the chain, at the rows of each section."""
    outputs = behind_chain([model.simulate(s.u).values[:, None] for s in data.sections], data)
    parts = zip(outputs, data.sections, data.rows, strict=True)
    return [s.y[r.at] - c[:, 0] for c, s, r in parts]


def fitted_levels(errors: Sequence[Array], data: FitData) -> list[Array]:
    """Fit the nuisance columns of each section to errors at its rows.

    To those in use, or to all if none is; returned at every sample of the section, shape (n,).
    """
    levels = []
    for error, s, r, use in zip(errors, data.sections, data.rows, data.use, strict=True):
        used = use if use.any() else np.ones_like(use)
        columns = s.nuisance[r.at[used]]
        levels.append(s.nuisance @ np.linalg.lstsq(columns, error[used], rcond=None)[0])
    return levels


def folds_of(data: FitData, count: int, runs: int) -> list[tuple[NDArray[np.bool_], ...]]:
    """Divide the cycles of all sections into parts with similar numbers of samples.

    With two distant runs of neighbours in each part, drift is not extrapolated, and every part of a
    record with slow and fast cycles has both. With one run, a model is extrapolated to a part of
    larger range. Rows before the first and after the last cycle belong to its neighbour; there are
    fewer parts than `count` if there are fewer cycles.
    """
    section, cycle, size = [], [], []
    for k, (r, use) in enumerate(zip(data.rows, data.use, strict=True)):
        numbers, rows = np.unique(r.cycle[use], return_counts=True)
        section += [k] * numbers.size
        cycle += numbers.tolist()
        size += rows.tolist()
    parts = min(count, len(cycle))
    if parts == 0:
        return []
    blocks = min(runs * parts, len(cycle))
    middle = np.cumsum(size) - 0.5 * np.array(size)
    block = np.minimum((middle / np.sum(size) * blocks).astype(int), blocks - 1)
    # long cycles leave blocks empty: the others are renumbered
    part = np.unique(block, return_inverse=True)[1] % parts
    fold_of_cycle = {(k, c): p for k, c, p in zip(section, cycle, part.tolist(), strict=True)}
    return [
        tuple(
            np.isin(r.cycle, [c for (s, c), q in fold_of_cycle.items() if s == k and q == p]) & use
            for k, (r, use) in enumerate(zip(data.rows, data.use, strict=True))
        )
        for p in range(int(part.max()) + 1)
    ]


class LinearFit(ModelFit):
    """A model that is a sum of known columns, each times a parameter that is not negative.

    The first parameters are slopes just after a turn, and have a floor: then there is an inverse.
    """

    #: Number of parameters with a floor.
    floored: int = 1

    @abstractmethod
    def columns(self, section: RecordSection, data: FitData) -> Iterator[Array]:
        """Yield the quasi-static output per unit of each parameter, in blocks of parameters."""

    @abstractmethod
    def build(self, coefficients: Array, data: FitData) -> HysteresisModel:
        """Return the model of these parameters."""

    def smoothing(self, data: FitData, moving: NDArray[np.bool_]) -> Array | None:
        """Return the penalty on differences of neighbouring parameters; None for none.

        A quadratic form, per sample and per square of the range of the input, that is added to the
        products of moving columns; it is zero for parameters of constant columns.
        """
        del data, moving
        return None

    def fit(self, data: FitData, start: Array | None = None) -> FitResult:
        del start
        x = self._coefficients(data)
        is_flattest = np.any((x <= self._floor(data))[: self.floored])
        return FitResult(model=self.build(x, data), notes=self._price(data) if is_flattest else ())

    def refit(self, data: FitData, optimum: Array) -> FitResult:
        del optimum
        return FitResult(model=self.build(self._coefficients(data), data))

    def _coefficients(self, data: FitData) -> Array:
        behind, moving = self.moving(data)
        x = self._floor(data)
        x[moving] = self.solution(equations(behind, data, self.kind), data).coefficients
        return x

    def solution(self, normal: Normal, data: FitData, *, floor: bool = True) -> Solution:
        """Solve the normal equations of the moving columns."""
        _, moving = self.moving(data)
        penalty = self.smoothing(data, moving)
        if penalty is not None:
            penalty = penalty[np.ix_(moving, moving)] * (normal.count * data.input_scale**2)
        least = self._floor(data)[moving] if floor else None
        return solve(normal, smoothing=penalty, least=least)

    def _floor(self, data: FitData) -> Array:
        slope = _FLATTEST * data.stroke / data.input_scale
        return np.where(np.arange(self.size) < self.floored, slope, 0.0)

    def _price(self, data: FitData) -> tuple[str, ...]:
        """Report the error that the floor adds, if that is much."""
        normal = equations(self.moving(data)[0], data, self.kind)
        solutions = [self.solution(normal, data, floor=floor) for floor in (True, False)]
        squares = [max(residual_square(normal, solution), 0.0) for solution in solutions]
        error, without = 100.0 * np.sqrt(np.array(squares) / normal.count) / data.stroke
        note = (
            f"{self.kind}: for an inverse, its slope after a turn is at least "
            f"{100 * _FLATTEST:g} % of the mean slope; its error on fitted samples is {error:.2g} "
            f"% of the stroke, and {without:.2g} % without this"
        )
        return (note,) if error > SAME * without else ()

    def moving(self, data: FitData) -> tuple[list[Array], NDArray[np.bool_]]:
        """Return the moving columns behind the chain, at the rows, and which columns move.

        A constant column cannot be separated from the offset, and does not belong to the model.
        """
        if self.kind not in data.memo:
            parts, moving = [], []
            # a block at a time: all columns at all samples of a long record would not fit
            for block in zip(*(self.columns(s, data) for s in data.sections), strict=True):
                moves_here = moves(block)
                parts.append(behind_chain([c[:, moves_here] for c in block], data))
                moving.append(moves_here)
            behind = [np.concatenate(blocks, axis=1) for blocks in zip(*parts, strict=True)]
            every, moves_here = np.concatenate(moving), moves(behind, _ROUNDING)
            every[every] = moves_here
            moving_columns = behind if moves_here.all() else [c[:, moves_here] for c in behind]
            data.memo[self.kind] = moving_columns, every
        return data.memo[self.kind]


def moves(columns: Sequence[Array], share: float = 0.0) -> NDArray[np.bool_]:
    """Mark the columns that change by more than a share of the largest change."""
    spread = np.max([np.ptp(c, axis=0) for c in columns], axis=0)
    return spread > share * np.max(spread, initial=0.0)


def fits() -> Mapping[str, ModelFit]:
    """Return the fitting methods by name of the model, by increasing number of parameters."""
    return _fits(tuple(MODELS.items()))


def selected_models(names: Sequence[str]) -> tuple[str, ...]:
    """Return the candidate models of a request; auto selects five of them.

    The others are candidates only by name: compared with these they were selected for none of
    nine measured records, and need a third of the time.

    Raises
    ------
    ModelError
        There is no such model.
    """
    available = fits()
    if tuple(names) == ("auto",):
        return tuple(kind for kind, fit in available.items() if fit.automatic)
    allowed = f"choose from auto, {', '.join(available)}"
    if not names:
        raise ModelError(f"no model is given: {allowed}")
    if OSCILLATOR in names:
        raise ModelError(
            f"the model '{OSCILLATOR}' is identified alone, by `identify_oscillator` or on the "
            f"command line: {allowed}"
        )
    for name in names:
        if name not in available:
            raise ModelError(f"the model '{name}' is not known: {allowed}")
    return tuple(names)


@functools.cache
def _fits(models: tuple[tuple[str, type[HysteresisModel]], ...]) -> Mapping[str, ModelFit]:
    classes = (fit_class(kind) for kind, _ in models)
    instances: list[ModelFit] = [fit() for fit in classes if fit]
    return {fit.kind: fit for fit in sorted(instances, key=lambda fit: fit.size)}
