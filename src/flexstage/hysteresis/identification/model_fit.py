"""How a model is fitted: the data, the fit, and models linear in all of their parameters."""

import functools
import operator
from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from flexstage.base.arrays import Array
from flexstage.base.errors import ModelError
from flexstage.hysteresis.identification.fit_rows import (
    ChainValues,
    Rows,
    averaged,
    filtered,
    rows_of,
)
from flexstage.hysteresis.identification.measurement import IdentificationData
from flexstage.hysteresis.identification.projection import Normal, Solution, normal_equations, solve
from flexstage.hysteresis.identification.record_section import RecordSection
from flexstage.hysteresis.model import HysteresisModel
from flexstage.hysteresis.models.registry import MODELS, part

#: Parts that the cycles are divided into, each held out once.
_FOLDS = 5
#: Runs of neighbouring cycles in each part.
_RUNS = 2

#: Samples and rows that a search begins with, and how much more than elsewhere means may miss.
_COARSE_SAMPLES = 5000
_COARSE_ROWS = 2500
_COARSE_LOOSE = 10.0
#: Columns behind the chain that change by less than this, over the largest change, stand still.
_ROUNDING = 1e-9


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FitData(IdentificationData):
    """What a model is fitted to: a measurement behind a known chain, some samples of it."""

    chain: ChainValues
    """The chain behind the hysteresis."""
    rows: tuple[Rows, ...]
    """Samples of each section that are looked at."""
    use: tuple[NDArray[np.bool_], ...]
    """Which of them are fitted, shape (r,); the others are held out."""
    memo: dict[str, Any] = field(default_factory=dict)
    """What fits have worked out for all the rows, kept for the next choice of `use`."""

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
        made = []
        for s, r, values in zip(self.sections, self.rows, output, strict=True):
            y = s.y.copy()
            y[r.at] = values
            made.append(replace(s, y=y))
        return replace(self, sections=tuple(made))


def fit_data(
    data: IdentificationData,
    chain: ChainValues,
    rows: tuple[Rows, ...] | None = None,
    use: tuple[NDArray[np.bool_], ...] | None = None,
) -> FitData:
    """Return a measurement behind a chain; all of the usual rows are in use where not given."""
    rows = rows_of(data.sections) if rows is None else rows
    use = tuple(np.ones(r.at.size, dtype=bool) for r in rows) if use is None else use
    return FitData(**_of_measurement(data), chain=chain, rows=rows, use=use)


def _of_measurement(data: IdentificationData) -> dict[str, Any]:
    return {f.name: getattr(data, f.name) for f in fields(IdentificationData)}


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FitResult:
    """A fitted model."""

    model: HysteresisModel
    """The model."""
    search: Array = field(default_factory=lambda: np.zeros(0))
    """Where the search over nonlinear parameters ended, shape (s,)."""
    names: tuple[str, ...] = ()
    """Names of the parameters that have an uncertainty."""
    values: Array = field(default_factory=lambda: np.zeros(0))
    """Their values, shape (k,)."""
    notes: tuple[str, ...] = ()
    """What a reader should know."""
    jacobian: Array | None = None
    """Change of the output with each of them at all rows that are fitted, shape (r, k)."""


class ModelFit(ABC):
    """One model, and how it is fitted."""

    #: The model.
    law: ClassVar[type[HysteresisModel]]
    #: Number of parameters.
    size: int
    #: Whether it is tried where no model is named.
    automatic: bool = True

    @property
    def kind(self) -> str:
        """Name of the model."""
        return self.law.kind

    @abstractmethod
    def fit(self, data: FitData, start: Array | None = None) -> FitResult:
        """Fit the model.

        Start: where the search over nonlinear parameters begins; a grid over their range where
        None.
        """

    def refit(self, data: FitData, optimum: Array) -> FitResult:
        """Fit fewer samples, from the optimum of more of them, which is near.

        The result has not what standard errors need.
        """
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
    all samples are then formed once, and what is held out is taken off.
    """
    if not key:
        return _summed(behind, data)
    name = f"{key} equations"
    if name not in data.memo:
        data.memo[name] = data.use, _summed(behind, data)
    used, whole = data.memo[name]
    less = [a & ~b for a, b in zip(used, data.use, strict=True)]
    more = any(np.any(b & ~a) for a, b in zip(used, data.use, strict=True))
    if more or 2 * sum(map(np.sum, less)) > whole.count:
        return _summed(behind, data)
    if not any(map(np.any, less)):
        return whole
    return whole - _summed(behind, data.with_use(tuple(less)))


def _summed(behind: list[Array], data: FitData) -> Normal:
    own = []
    for c, s, r, use in zip(behind, data.sections, data.rows, data.use, strict=True):
        nuisance, y = s.nuisance[r.at], s.y[r.at]
        own.append(normal_equations(c, nuisance, y, runs(use)))
    return functools.reduce(operator.add, own)


def runs(use: NDArray[np.bool_]) -> list[slice]:
    """Return the runs of samples in use."""
    ends = np.flatnonzero(np.diff(use, prepend=False, append=False))
    return [slice(a, b) for a, b in ends.reshape(-1, 2).tolist()]


def coarse(data: FitData) -> FitData:
    """Return the data of a shorter record, to begin a search with that is ended on all of it.

    Means of neighbouring samples, and few rows of them; those that hold any held-out sample are
    held out. What searches begin with is that of all samples.
    """
    if "coarse" not in data.memo:
        share = _COARSE_SAMPLES // len(data.sections)
        sections = tuple(averaged(s, share, _COARSE_LOOSE) for s in data.sections)
        data.memo["coarse"] = sections, rows_of(sections, _COARSE_ROWS)
    sections, rows = data.memo["coarse"]
    use = tuple(
        _within(own.at, round(c.dt / s.dt), r.at, u)
        for own, c, s, r, u in zip(rows, sections, data.sections, data.rows, data.use, strict=True)
    )
    memo = {name: kept for name, kept in data.memo.items() if name.endswith(" start")}
    return replace(data, sections=sections, rows=rows, use=use, memo=memo)


def _within(
    means: NDArray[np.intp], every: int, at: NDArray[np.intp], use: NDArray[np.bool_]
) -> NDArray[np.bool_]:
    """Which means are of samples in use alone, by the rows next to their first and last one."""
    last = at.size - 1
    first = np.clip(np.searchsorted(at, means * every, side="right") - 1, 0, last)
    after = np.clip(np.searchsorted(at, (means + 1) * every - 1), 0, last)
    return use[first] & use[after]


def residual(behind: list[Array], solution: Solution, data: FitData) -> Array:
    """Return what a solution leaves of the output, at the samples in use."""
    left, first = [], 0
    for c, s, r, use in zip(behind, data.sections, data.rows, data.use, strict=True):
        count = s.nuisance.shape[1]
        own = solution.nuisance[first : first + count]
        first += count
        made = c @ solution.coefficients + s.nuisance[r.at] @ own
        left.append((s.y[r.at] - made)[use])
    return np.concatenate(left)


def folds_of(
    data: FitData, count: int = _FOLDS, runs: int = _RUNS
) -> list[tuple[NDArray[np.bool_], ...]]:
    """Divide the cycles of all sections into parts of about as many samples.

    With two runs of neighbours in each part, far from one another, drift is not extrapolated, and
    slow cycles and fast ones are in every part of a record of both. With one run a part that goes
    further than the others asks a model to extrapolate. Rows before the first and after the last
    cycle belong to its neighbour; there are fewer parts than `count` where there are fewer cycles.
    """
    section, cycle, size = [], [], []
    for k, (r, use) in enumerate(zip(data.rows, data.use, strict=True)):
        found, rows = np.unique(r.cycle[use], return_counts=True)
        section += [k] * found.size
        cycle += found.tolist()
        size += rows.tolist()
    parts = min(count, len(cycle))
    if parts == 0:
        return []
    blocks = min(runs * parts, len(cycle))
    middle = np.cumsum(size) - 0.5 * np.array(size)
    block = np.minimum((middle / np.sum(size) * blocks).astype(int), blocks - 1)
    # long cycles leave blocks empty: those that are not are numbered anew
    part = np.unique(block, return_inverse=True)[1] % parts
    held = {(k, c): p for k, c, p in zip(section, cycle, part.tolist(), strict=True)}
    return [
        tuple(
            np.isin(r.cycle, [c for (s, c), q in held.items() if s == k and q == p]) & use
            for k, (r, use) in enumerate(zip(data.rows, data.use, strict=True))
        )
        for p in range(int(part.max()) + 1)
    ]


class LinearFit(ModelFit):
    """A model that is a sum of known columns, each times a parameter that is not negative."""

    @abstractmethod
    def columns(self, section: RecordSection, data: FitData) -> Iterator[Array]:
        """Give the quasi-static output per unit of each parameter, some parameters at a time."""

    @abstractmethod
    def build(self, coefficients: Array, data: FitData) -> HysteresisModel:
        """Return the model that some parameters make."""

    def smoothing(self, data: FitData, moving: NDArray[np.bool_]) -> Array | None:
        """Return the penalty, added to the products of the columns that move; None for none.

        A quadratic form of parameters that differ from their neighbours, per sample and per square
        of the input's range; parameters that do not move get nothing.
        """
        del data, moving
        return None

    @abstractmethod
    def names(self) -> tuple[str, ...]:
        """Return what each parameter is called."""

    def fit(self, data: FitData, start: Array | None = None) -> FitResult:
        del start
        made = self.refit(data, np.zeros(0))
        behind, moving = self.moving(data)
        active = np.isin(np.array(self.names())[moving], made.names)
        parts = [c[:, active] for c in behind]
        used = [c if use.all() else c[use] for c, use in zip(parts, data.use, strict=True)]
        return replace(made, jacobian=np.concatenate(used))

    def refit(self, data: FitData, optimum: Array) -> FitResult:
        del optimum
        behind, moving = self.moving(data)
        x = np.zeros(moving.size)
        x[moving] = self.solution(equations(behind, data, self.kind), data).coefficients
        active = np.flatnonzero(x)
        names = self.names()
        return FitResult(
            model=self.build(x, data), names=tuple(names[i] for i in active), values=x[active]
        )

    def solution(self, normal: Normal, data: FitData) -> Solution:
        """Solve the normal equations of the columns that move."""
        _, moving = self.moving(data)
        penalty = self.smoothing(data, moving)
        if penalty is not None:
            penalty = penalty[np.ix_(moving, moving)] * (normal.count * data.input_scale**2)
        return solve(normal, smoothing=penalty)

    def moving(self, data: FitData) -> tuple[list[Array], NDArray[np.bool_]]:
        """Give the columns that move, behind the chain at the rows, worked out once.

        One that stands still cannot be told from the offset, and is none of this model.
        """
        if self.kind not in data.memo:
            parts, moving = [], []
            # a block at a time: all columns at all samples of a long record would not fit
            for block in zip(*(self.columns(s, data) for s in data.sections), strict=True):
                some = moves(block)
                parts.append(behind_chain([c[:, some] for c in block], data))
                moving.append(some)
            behind = [np.concatenate(own, axis=1) for own in zip(*parts, strict=True)]
            every, some = np.concatenate(moving), moves(behind, _ROUNDING)
            every[every] = some
            kept = behind if some.all() else [c[:, some] for c in behind]
            data.memo[self.kind] = kept, every
        return data.memo[self.kind]


def moves(columns: Sequence[Array], share: float = 0.0) -> NDArray[np.bool_]:
    """Return which columns change anywhere, by more than a share of the largest change."""
    spread = np.max([np.ptp(c, axis=0) for c in columns], axis=0)
    return spread > share * np.max(spread, initial=0.0)


def fits() -> Mapping[str, ModelFit]:
    """Return how each model that can be fitted is, by its name, from few parameters to many."""
    return _fits(tuple(MODELS.items()))


def models_named(names: Sequence[str]) -> tuple[str, ...]:
    """Return the models that are tried where these are named; auto stands for four of them.

    The others are tried when they are named: beside these four they were
    chosen for none of nine records that were measured, and take a third of the time.

    Raises
    ------
    ModelError
        There is no such model.
    """
    known = fits()
    if tuple(names) == ("auto",):
        return tuple(kind for kind, fit in known.items() if fit.automatic)
    allowed = f"choose from auto, {', '.join(known)}"
    if not names:
        raise ModelError(f"no model is named: {allowed}")
    for name in names:
        if name not in known:
            raise ModelError(f"the model '{name}' is not known: {allowed}")
    return tuple(names)


@functools.cache
def _fits(models: tuple[tuple[str, type[HysteresisModel]], ...]) -> Mapping[str, ModelFit]:
    found = (getattr(part(kind, "fit"), f"{law.__name__}Fit", None) for kind, law in models)
    made: list[ModelFit] = [fit() for fit in found if fit]
    return {fit.kind: fit for fit in sorted(made, key=lambda fit: fit.size)}
