"""Models that no projection reaches: a start from a simpler model, then damped Gauss-Newton."""

from abc import abstractmethod
from dataclasses import replace
from typing import ClassVar

import numpy as np

from flexstage.base.arrays import Array
from flexstage.base.errors import ModelError
from flexstage.hysteresis.identification.model_fit import (
    FitData,
    FitResult,
    ModelFit,
    behind_chain,
    coarse,
    equations,
)
from flexstage.hysteresis.identification.projection import Solution, solve
from flexstage.hysteresis.identification.record_section import RecordSection
from flexstage.hysteresis.model import HysteresisModel

_ITERATIONS = 25
#: The search has ended when a step takes less than this share of the sum of squares away.
_DONE = 1e-5
#: ... and this share where it began at the optimum of more samples.
_NEARLY = 1e-4
#: Step of the differences that the output's change with a parameter is found with, of its scale.
_STEP = 1e-5


class RefinedFit(ModelFit):
    """A model with bounded parameters that is fitted from a good start.

    Each step solves the linearised problem, damped, with the bounds (Levenberg 1944; Marquardt
    1963; the bounds by non-negative least squares), in the output and behind the chain, so that
    noise of the output does not get into the columns.
    """

    #: Penalty on parameters that differ from their neighbours: a quadratic form of the parameters
    #: over their scales, per sample and per square of the stroke, shape (k, k); None for none.
    penalty: ClassVar[Array | None] = None

    @abstractmethod
    def begin(self, data: FitData) -> Array:
        """Return the parameters that the search begins with."""

    @abstractmethod
    def build(self, parameters: Array, data: FitData) -> HysteresisModel:
        """Return the model that some parameters make; a ModelError where they make none."""

    @abstractmethod
    def bounds(self, data: FitData) -> tuple[Array, Array]:
        """Return lower bounds, minus infinity for none, and scales: how far each may go at once."""

    def fit(self, data: FitData, start: Array | None = None) -> FitResult:
        begin = self.begin(data) if start is None else np.asarray(start)
        begin, _ = self._descended(begin, coarse(data), None)
        p, J = self._descended(begin, data, self._kept(begin, data))
        data.memo[self._key(p)] = J
        low, _ = self.bounds(data)
        return FitResult(
            model=self.build(p, data), search=p, jacobian=self._active(J, p, low, data)
        )

    def refit(self, data: FitData, optimum: Array) -> FitResult:
        p, _ = self._descended(optimum, data, self._kept(optimum, data))
        return FitResult(model=self.build(p, data), search=p)

    def _key(self, p: Array) -> str:
        return f"{self.kind} at {p.tolist()}"

    def _kept(self, p: Array, data: FitData) -> list[Array]:
        """The change of the output with the parameters where more of the samples were fitted."""
        if self._key(p) not in data.memo:
            data.memo[self._key(p)] = self._jacobian(p, self.bounds(data)[1], data)
        return data.memo[self._key(p)]

    def _descended(
        self, begin: Array, data: FitData, known: list[Array] | None
    ) -> tuple[Array, list[Array]]:
        """Go down to the optimum; return it, and the output's change with the parameters there.

        Where that is known for the beginning it serves for all steps: the way is short.
        """
        low, scale = self.bounds(data)
        p = np.maximum(begin, low)
        cost, behind = self._evaluate(p, data)
        damping, J = 1e-3, self._jacobian(p, scale, data) if known is None else known
        for _ in range(_ITERATIONS):
            trial = np.maximum(_step(p, behind, J, low, scale, damping, self.penalty, data), low)
            try:
                new, moved = self._evaluate(trial, data)
            except ModelError:  # beyond what the model allows
                new, moved = np.inf, behind
            if new >= cost:
                # from a place that is known to be near, a step that gains nothing is the last
                damping *= 8.0
                if damping > (1e8 if known is None else 1.0):
                    break
                continue
            gained = 1.0 - new / cost
            p, cost, behind = trial, new, moved
            damping = max(damping / 4.0, 1e-9)
            if gained < (_DONE if known is None else _NEARLY):
                break
            if known is None:
                J = self._jacobian(p, scale, data)
        return p, J

    def _evaluate(self, p: Array, data: FitData) -> tuple[float, list[Array]]:
        model = self.build(p, data)
        behind = behind_chain([model.simulate(s.u).values[:, None] for s in data.sections], data)
        left = _left(behind, data)
        rough = 0.0
        if self.penalty is not None:
            scaled = p / self.bounds(data)[1]
            rough = left.size * float(scaled @ self.penalty @ scaled)
        return float(left @ left) + rough, behind

    def _jacobian(self, p: Array, scale: Array, data: FitData) -> list[Array]:
        """Change of the output with each parameter at the rows, by its scale."""
        quasi = [self.changes(p, scale, section, data) for section in data.sections]
        return behind_chain(quasi, data)

    def changes(self, p: Array, scale: Array, section: RecordSection, data: FitData) -> Array:
        """Return how the quasi-static output changes with each parameter over its scale, (n, k).

        Here by differences.
        """
        base = self.build(p, data).simulate(section.u).values
        made = np.empty((section.u.size, p.size), order="F")
        for j in range(p.size):
            moved = p.copy()
            moved[j] += _STEP * scale[j]
            made[:, j] = (self.build(moved, data).simulate(section.u).values - base) / _STEP
        return made

    def _active(self, J: list[Array], p: Array, low: Array, data: FitData) -> Array:
        inside = np.flatnonzero(p > low)
        return np.concatenate([c[np.ix_(u, inside)] for c, u in zip(J, data.use, strict=True)])


def _left(behind: list[Array], data: FitData) -> Array:
    """What is left of the output over the stroke, with the best offset."""
    every = []
    for c, s, r, use in zip(behind, data.sections, data.rows, data.use, strict=True):
        at = r.at[use]
        error = s.y[at] - c[use, 0]
        own = np.linalg.lstsq(s.nuisance[at], error, rcond=None)[0] if at.size else np.zeros(0)
        every.append(error - s.nuisance[at] @ own if at.size else error)
    return np.concatenate(every) / data.stroke


def _step(
    p: Array,
    behind: list[Array],
    J: list[Array],
    low: Array,
    scale: Array,
    damping: float,
    penalty: Array | None,
    data: FitData,
) -> Array:
    """Return the parameters that the damped, linearised problem with bounds gives."""
    free = np.isinf(low)
    # counted from the lower bound: z = (p - low) / scale, and free parameters from where they are
    base = np.where(free, p, low)
    z0 = (p - base) / scale
    target = [
        s.y[r.at] - c[:, 0] + j @ z0
        for s, r, c, j in zip(data.sections, data.rows, behind, J, strict=True)
    ]
    normal = equations(J, data.with_output(target))
    weight = damping * np.diag(normal.gram)[: p.size]
    gram = normal.gram.copy()
    gram[np.arange(p.size), np.arange(p.size)] += weight
    right = normal.right.copy()
    right[: p.size] += weight * z0
    if penalty is not None:
        own = penalty * normal.count * data.stroke**2
        gram[: p.size, : p.size] += own
        right[: p.size] -= own @ (base / scale)
    solution: Solution = solve(replace(normal, gram=gram, right=right), free=free)
    return base + scale * solution.coefficients


def roughness(*groups: int) -> Array:
    """Return the quadratic form of second differences within groups of neighbours."""
    made, first = np.zeros((sum(groups), sum(groups))), 0
    for count in groups:
        own = np.diff(np.eye(count), 2, axis=0) if count > 2 else np.zeros((0, count))
        made[first : first + count, first : first + count] = own.T @ own
        first += count
    return made
