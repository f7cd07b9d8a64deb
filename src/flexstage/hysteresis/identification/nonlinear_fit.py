"""Nonlinear fits: by variable projection, or by damped Gauss-Newton steps from a simpler model."""

import itertools
from abc import abstractmethod
from dataclasses import replace
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from flexstage.base.arrays import Array
from flexstage.base.errors import ModelError
from flexstage.hysteresis.identification.cycles import RecordSection
from flexstage.hysteresis.identification.model_fit import (
    FitData,
    FitResult,
    ModelFit,
    behind_chain,
    coarse,
    equations,
    errors_of,
    fitted_levels,
    residual,
)
from flexstage.hysteresis.identification.projection import solve
from flexstage.hysteresis.model import HysteresisModel

#: Number of points of the coarse grid with a local search.
_LOCAL_SEARCHES = 3
#: Step of finite differences, relative to each parameter.
_STEP = 1e-4

#: Largest number of steps of a refinement.
_ITERATIONS = 25
#: The search ends when a step reduces the sum of squares by less than this share, ...
_CONVERGED = 1e-5
#: ... or this share if it began at the optimum of more samples.
_CONVERGED_NEAR = 1e-4
#: Step of the finite differences of a Jacobian, over the scale of the parameter.
_JACOBIAN_STEP = 1e-5


class SearchedFit(ModelFit):
    """A model that is linear in all but a few parameters.

    For given values of the few, the others follow from linear least squares, and the residual is a
    function of the few alone (variable projection: G. H. Golub, V. Pereyra, SIAM J. Numer. Anal. 10
    (1973) 413). They are scaled to run from 0 to 1.
    """

    #: Points of the coarse search along each searched parameter.
    grid: ClassVar[tuple[int, ...]]
    #: True for linear parameters that may be negative, shape (m,); None if none may be.
    free: ClassVar[NDArray[np.bool_] | None] = None
    #: A quadratic form of the linear parameters, per sample; None for none.
    penalty: ClassVar[Array | None] = None

    @abstractmethod
    def columns(self, section: RecordSection, place: Array, data: FitData) -> Array:
        """Return the quasi-static output per unit of each linear parameter, shape (n, m)."""

    @abstractmethod
    def build(self, place: Array, coefficients: Array, data: FitData) -> HysteresisModel:
        """Return the model of these parameters."""

    def project(self, place: Array, data: FitData) -> tuple[Array, Array]:
        """Find the linear parameters for values of the searched ones, and the residual.

        The residual is over the stroke.
        """
        every = [self.columns(s, place, data) for s in data.sections]
        behind = behind_chain(every, data)
        normal = equations(behind, data)
        smoothing = None if self.penalty is None else normal.count * self.penalty
        solution = solve(normal, free=self.free, smoothing=smoothing)
        return solution.coefficients, residual(behind, solution, data) / data.stroke

    def fit(self, data: FitData, start: Array | None = None) -> FitResult:
        place = (
            self._global_minimum(data)
            if start is None
            else self._best_minimum([np.asarray(start)], data)
        )
        model = self.build(place, self.project(place, data)[0], data)
        inner = np.all((place > 1e-3) & (place < 1.0 - 1e-3))
        notes = () if inner else ("a parameter reached the limit of its search range",)
        return FitResult(model=model, search=place, notes=notes)

    def _global_minimum(self, data: FitData) -> Array:
        """Search a grid on a short record, and refine the best point on the full record."""
        key = f"{self.kind} minimum"
        # the generalised model begins with the minimum of the plain one
        if key in data.memo and data.memo[key][0] is data.use:
            return data.memo[key][1]
        lines = [(np.arange(n) + 0.5) / n for n in self.grid]
        points = [np.array(point) for point in itertools.product(*lines)]
        short = coarse(data)
        order = np.argsort([self._cost(point, short) for point in points])
        place = self._best_minimum([points[i] for i in order[:_LOCAL_SEARCHES]], data)
        data.memo[key] = data.use, place
        return place

    def _best_minimum(self, begins: list[Array], data: FitData) -> Array:
        """Minimise from points on a short record, and from the best minimum on the full record."""
        short = coarse(data)
        ends = [self._minimise(begin, short, 1e-4) for begin in begins]
        best = min(ends, key=lambda place: self._cost(place, short))
        return self._minimise(best, data, 1e-9)

    def refit(self, data: FitData, optimum: Array) -> FitResult:
        place = self._minimise(optimum, data, 1e-6)
        model = self.build(place, self.project(place, data)[0], data)
        return FitResult(model=model, search=place)

    def _cost(self, place: Array, data: FitData) -> float:
        left = self.project(place, data)[1]
        return float(left @ left)

    def _minimise(self, begin: Array, data: FitData, tolerance: float) -> Array:
        minimum = least_squares(
            lambda place: self.project(place, data)[1],
            np.clip(begin, 1e-6, 1.0 - 1e-6),
            bounds=(0.0, 1.0),
            diff_step=1e-5,
            x_scale=1.0,
            xtol=tolerance,
            ftol=tolerance,
            gtol=1e-12,
            max_nfev=60,
        )
        return np.asarray(minimum.x, dtype=np.float64)


class RefinedFit(ModelFit):
    """A model with bounded parameters that is refined from a good start.

    Each step solves the linearised problem, damped, with the bounds (Levenberg 1944; Marquardt
    1963; the bounds by non-negative least squares), in the output and behind the chain, so that
    the columns contain no noise of the output.
    """

    #: Penalty on parameters that differ from their neighbours: a quadratic form of the parameters
    #: over their scales, per sample and per square of the stroke, shape (k, k); None for none.
    penalty: ClassVar[Array | None] = None

    @abstractmethod
    def begin(self, data: FitData) -> Array:
        """Return the first parameters of the search."""

    @abstractmethod
    def build(self, parameters: Array, data: FitData) -> HysteresisModel:
        """Return the model of these parameters; a ModelError if they are invalid."""

    @abstractmethod
    def bounds(self, data: FitData) -> tuple[Array, Array]:
        """Return lower bounds, minus infinity for none, and scales of a step."""

    def fit(self, data: FitData, start: Array | None = None) -> FitResult:
        begin = self.begin(data) if start is None else np.asarray(start)
        begin, _ = self._descend(begin, coarse(data), None)
        p, J = self._descend(begin, data, self._cached_jacobian(begin, data))
        data.memo[self._key(p)] = J
        return FitResult(model=self.build(p, data), search=p)

    def refit(self, data: FitData, optimum: Array) -> FitResult:
        p, _ = self._descend(optimum, data, self._cached_jacobian(optimum, data))
        return FitResult(model=self.build(p, data), search=p)

    def _key(self, p: Array) -> str:
        return f"{self.kind} at {p.tolist()}"

    def _cached_jacobian(self, p: Array, data: FitData) -> list[Array]:
        """Jacobian at a place, cached from fits of more samples."""
        if self._key(p) not in data.memo:
            data.memo[self._key(p)] = self._jacobian(p, self.bounds(data)[1], data)
        return data.memo[self._key(p)]

    def _descend(
        self, begin: Array, data: FitData, jacobian: list[Array] | None
    ) -> tuple[Array, list[Array]]:
        """Go down to the optimum; return it with its Jacobian.

        A known Jacobian of the beginning is used for all steps, as the optimum is near.
        """
        low, scale = self.bounds(data)
        p = np.maximum(begin, low)
        cost, errors = self._evaluate(p, data)
        damping, J = 1e-3, self._jacobian(p, scale, data) if jacobian is None else jacobian
        for _ in range(_ITERATIONS):
            trial = np.maximum(_step(p, errors, J, low, scale, damping, self.penalty, data), low)
            try:
                new, new_errors = self._evaluate(trial, data)
            except ModelError:  # invalid parameters
                new, new_errors = np.inf, errors
            if new >= cost:
                # near the optimum, a step without a reduction is the last
                damping *= 8.0
                if damping > (1e8 if jacobian is None else 1.0):
                    break
                continue
            reduction = 1.0 - new / cost
            p, cost, errors = trial, new, new_errors
            damping = max(damping / 4.0, 1e-9)
            if reduction < (_CONVERGED if jacobian is None else _CONVERGED_NEAR):
                break
            if jacobian is None:
                J = self._jacobian(p, scale, data)
        return p, J

    def _evaluate(self, p: Array, data: FitData) -> tuple[float, list[Array]]:
        errors = errors_of(self.build(p, data), data)
        left = _residual(errors, data)
        rough = 0.0
        if self.penalty is not None:
            scaled = p / self.bounds(data)[1]
            rough = left.size * float(scaled @ self.penalty @ scaled)
        return float(left @ left) + rough, errors

    def _jacobian(self, p: Array, scale: Array, data: FitData) -> list[Array]:
        """Derivatives of the output by each parameter over its scale, at the rows."""
        quasi = [self.changes(p, scale, section, data) for section in data.sections]
        return behind_chain(quasi, data)

    def changes(self, p: Array, scale: Array, section: RecordSection, data: FitData) -> Array:
        """Return derivatives of the quasi-static output by parameters over their scales, (n, k).

        By finite differences here.
        """
        base = self.build(p, data).simulate(section.u).values
        derivatives = np.empty((section.u.size, p.size), order="F")
        for j in range(p.size):
            shifted = p.copy()
            shifted[j] += _JACOBIAN_STEP * scale[j]
            derivatives[:, j] = (
                self.build(shifted, data).simulate(section.u).values - base
            ) / _JACOBIAN_STEP
        return derivatives


def _residual(errors: list[Array], data: FitData) -> Array:
    """Errors at the rows in use over the stroke, with the best offset."""
    parts = zip(errors, fitted_levels(errors, data), data.rows, data.use, strict=True)
    return np.concatenate([(e - level[r.at])[u] for e, level, r, u in parts]) / data.stroke


def _step(
    p: Array,
    errors: list[Array],
    J: list[Array],
    low: Array,
    scale: Array,
    damping: float,
    penalty: Array | None,
    data: FitData,
) -> Array:
    """Return the parameters that the damped, linearised problem with bounds gives."""
    free, at = np.isinf(low), p / scale
    target = [e + j @ at for e, j in zip(errors, J, strict=True)]
    normal = equations(J, data.with_output(target))
    weight = damping * np.diag(normal.gram)[: p.size]
    gram = normal.gram.copy()
    gram[np.arange(p.size), np.arange(p.size)] += weight
    right = normal.right.copy()
    right[: p.size] += weight * at
    smoothing = None if penalty is None else penalty * normal.count * data.stroke**2
    damped, least = replace(normal, gram=gram, right=right), np.where(free, 0.0, low / scale)
    return scale * solve(damped, free=free, smoothing=smoothing, least=least).coefficients


def roughness(*groups: int) -> Array:
    """Return the quadratic form of second differences within groups of neighbours."""
    form, first = np.zeros((sum(groups), sum(groups))), 0
    for count in groups:
        differences = np.diff(np.eye(count), 2, axis=0) if count > 2 else np.zeros((0, count))
        form[first : first + count, first : first + count] = differences.T @ differences
        first += count
    return form
