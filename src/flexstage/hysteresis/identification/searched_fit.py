"""Models that are linear in most parameters: the rest is searched for by variable projection."""

import itertools
from abc import abstractmethod
from collections.abc import Iterator
from dataclasses import replace
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from flexstage.base.arrays import Array
from flexstage.hysteresis.identification.model_fit import (
    FitData,
    FitResult,
    ModelFit,
    behind_chain,
    coarse,
    equations,
    residual,
)
from flexstage.hysteresis.identification.projection import Normal, Solution, solve, square_left
from flexstage.hysteresis.identification.record_section import RecordSection
from flexstage.hysteresis.model import HysteresisModel

#: Points of the coarse search that are followed to their minimum.
_FOLLOWED = 3
#: How far about an optimum costs are looked at to find the one of fewer samples, and how far off
#: that is believed.
_ABOUT = 0.025
_NEAR = 0.06
#: Step of the differences that uncertainties are found with, relative to each parameter.
_STEP = 1e-4
#: Fields of models that are chosen and not fitted.
_NOT_FITTED = ("exponent", "lowest_input", "highest_input", "input_range")


class SearchedFit(ModelFit):
    """A model that is linear in all but a few parameters.

    For given values of the few, the others follow from linear least squares, and the misfit is a
    function of the few alone (variable projection: G. H. Golub, V. Pereyra, SIAM J. Numer. Anal. 10
    (1973) 413). They are scaled to run from 0 to 1.
    """

    #: Points of the coarse search along each searched parameter.
    grid: ClassVar[tuple[int, ...]]
    #: Which linear parameters may be negative, shape (m,); None where none may be.
    free: ClassVar[NDArray[np.bool_] | None] = None
    #: A quadratic form of the linear parameters, per sample; None for none.
    penalty: ClassVar[Array | None] = None

    @abstractmethod
    def columns(self, section: RecordSection, place: Array, data: FitData) -> Array:
        """Return the quasi-static output per unit of each linear parameter, shape (n, m)."""

    @abstractmethod
    def build(self, place: Array, coefficients: Array, data: FitData) -> HysteresisModel:
        """Return the model that some parameters make."""

    def project(self, place: Array, data: FitData) -> tuple[Solution, list[Array], Array]:
        """Find the linear parameters that belong to some searched ones.

        The linear parameters, their columns behind the chain, and what is left of the output over
        the stroke.
        """
        every = [self.columns(s, place, data) for s in data.sections]
        behind = behind_chain(every, data)
        solution = self._solved(equations(behind, data))
        return solution, behind, residual(behind, solution, data) / data.stroke

    def _solved(self, normal: Normal) -> Solution:
        smoothing = None if self.penalty is None else normal.count * self.penalty
        return solve(normal, free=self.free, smoothing=smoothing)

    def fit(self, data: FitData, start: Array | None = None) -> FitResult:
        place = self._found(data) if start is None else self._followed([np.asarray(start)], data)
        model = self.build(place, self.project(place, data)[0].coefficients, data)
        names, values, jacobian = _sensitivities(model, data)
        inner = np.all((place > 1e-3) & (place < 1.0 - 1e-3))
        notes = () if inner else ("a parameter ended at the border of its search range",)
        return FitResult(
            model=model, search=place, names=names, values=values, jacobian=jacobian, notes=notes
        )

    def _found(self, data: FitData) -> Array:
        """Search a grid on a short record, and end the best of what is found on the whole."""
        key = f"{self.kind} found"
        # the generalised model begins with what was found for the plain one
        if key in data.memo and data.memo[key][0] is data.use:
            return data.memo[key][1]
        lines = [(np.arange(n) + 0.5) / n for n in self.grid]
        points = [np.array(point) for point in itertools.product(*lines)]
        short = coarse(data)
        order = np.argsort([self._cost(point, short) for point in points])
        place = self._followed([points[i] for i in order[:_FOLLOWED]], data)
        data.memo[key] = data.use, place
        return place

    def _followed(self, begins: list[Array], data: FitData) -> Array:
        """Follow points to their minimum on a short record, and the best one on the whole."""
        short = coarse(data)
        ends = [self._minimise(begin, short, 1e-4) for begin in begins]
        best = min(ends, key=lambda place: self._cost(place, short))
        return self._minimise(best, data, 1e-9)

    def refit(self, data: FitData, optimum: Array) -> FitResult:
        place, solution = self._moved(optimum, data)
        return FitResult(model=self.build(place, solution.coefficients, data), search=place)

    def _moved(self, start: Array, data: FitData) -> tuple[Array, Solution]:
        """Go from the optimum of more samples to that of these.

        The first step is on a parabola through costs about the start, whose columns are worked out
        once for all parts that are held out; the next ones are by the slope where it has led. Where
        that goes far or uphill, as along a valley, it is searched for.
        """
        points = _stencil(start)
        costs = []
        for point in points:
            normal = self._kept(point, data)[1]
            costs.append(square_left(normal, solve(normal, free=self.free)))
        slope, bend = _parabola(np.array(costs), start.size)
        place = _downhill(points[0], slope, bend)
        for _ in range(place.size):
            place = _downhill(place, self._slope(place, data), bend)
        solution, _, left = self.project(place, data)
        behind, normal = self._kept(start, data)
        before = residual(behind, self._solved(normal), data) / data.stroke
        near = np.max(np.abs(place - start)) <= _NEAR
        if near and left @ left <= before @ before:
            return place, solution
        place = self._minimise(start, data, 1e-6)
        return place, self.project(place, data)[0]

    def _kept(self, place: Array, data: FitData) -> tuple[list[Array], Normal]:
        """Columns behind the chain that belong to a place, kept, and their equations."""
        key = f"{self.kind} at {place.tolist()}"
        if key not in data.memo:
            quasi = [self.columns(s, place, data) for s in data.sections]
            data.memo[key] = behind_chain(quasi, data)
        return data.memo[key], equations(data.memo[key], data, key)

    def _slope(self, place: Array, data: FitData) -> Array:
        """Change of the cost over the stencil's width with each searched parameter.

        At the best linear parameters it does not matter how these would change along.
        """
        solution, behind, left = self.project(place, data)
        x, sections = solution.coefficients, data.sections
        slope = np.empty(place.size)
        for k in range(place.size):
            other = place.copy()
            other[k] += _STEP if place[k] < 0.5 else -_STEP
            # column by column, as what the drive did before is not linear in their sum
            moved = behind_chain([self.columns(s, other, data) for s in sections], data)
            change = np.concatenate(
                [((m - c) @ x)[u] for m, c, u in zip(moved, behind, data.use, strict=True)]
            )
            slope[k] = -2.0 * _ABOUT * float(left @ change) / (other[k] - place[k])
        return slope * data.stroke

    def _cost(self, place: Array, data: FitData) -> float:
        left = self.project(place, data)[2]
        return float(left @ left)

    def _minimise(self, begin: Array, data: FitData, tolerance: float) -> Array:
        found = least_squares(
            lambda place: self.project(place, data)[2],
            np.clip(begin, 1e-6, 1.0 - 1e-6),
            bounds=(0.0, 1.0),
            diff_step=1e-5,
            x_scale=1.0,
            xtol=tolerance,
            ftol=tolerance,
            gtol=1e-12,
            max_nfev=60,
        )
        return np.asarray(found.x, dtype=np.float64)


def _stencil(centre: Array) -> list[Array]:
    """Places that determine a parabola: the middle, one to each side, and one between each two."""
    middle = np.clip(centre, _ABOUT, 1.0 - _ABOUT)
    sides = _ABOUT * np.eye(centre.size)
    pairs = [a + b for a, b in itertools.combinations(sides, 2)]
    return [middle, *(middle + sides), *(middle - sides), *(middle + pair for pair in pairs)]


def _parabola(costs: Array, size: int) -> tuple[Array, Array]:
    """Slope and bend over the stencil's width, in its middle, of the parabola through its costs."""
    here, up, down = costs[0], costs[1 : 1 + size], costs[1 + size : 1 + 2 * size]
    bend = np.diag(up - 2.0 * here + down)
    pairs = itertools.combinations(range(size), 2)
    for (j, k), cost in zip(pairs, costs[1 + 2 * size :], strict=True):
        bend[j, k] = bend[k, j] = cost - up[j] - up[k] + here
    return 0.5 * (up - down), bend


def _downhill(place: Array, slope: Array, bend: Array) -> Array:
    """The lowest place of a parabola; along a valley without a bottom it stays where it is."""
    values, vectors = np.linalg.eigh(bend)
    rising = values > 1e-9 * max(float(values.max()), 1e-300)
    way = np.where(rising, vectors.T @ slope / np.where(rising, values, 1.0), 0.0)
    step = _ABOUT * np.clip(vectors @ way, -3.0, 3.0)
    return np.clip(place - step, 1e-6, 1.0 - 1e-6)


def _sensitivities(model: HysteresisModel, data: FitData) -> tuple[tuple[str, ...], Array, Array]:
    """Change of the output with each number that the model holds, at the rows in use."""
    names, values, columns = [], [], []
    for name, value, element in _numbers(model):
        step = _STEP * abs(value)
        ends = [_with(model, name, value + sign * step, element) for sign in (1.0, -1.0)]
        moved = []
        for s in data.sections:
            up, down = (m.simulate(s.u).values for m in ends)
            moved.append(((up - down) / (2.0 * step))[:, None])
        names.append(name if element is None else f"{name}[{element}]")
        values.append(value)
        columns.append(
            np.concatenate(
                [c[use, 0] for c, use in zip(behind_chain(moved, data), data.use, strict=True)]
            )
        )
    return tuple(names), np.array(values), np.column_stack(columns)


def _numbers(model: HysteresisModel) -> Iterator[tuple[str, float, int | None]]:
    """Give each fitted number of a model: the field, the value, and which element of an array.

    All of them belong to the covariance, also those of arrays: what one of them is known to
    depends on the others.
    """
    for name, value in model.parameters().items():
        if name in _NOT_FITTED:
            continue
        if isinstance(value, float) and value != 0.0:
            yield name, value, None
        elif isinstance(value, np.ndarray):
            for i in np.flatnonzero(value):
                yield name, float(value[i]), int(i)


def _with(model: HysteresisModel, name: str, number: float, element: int | None) -> HysteresisModel:
    """The model with another number in a field, or in an element of an array there."""
    changed: Any = number
    if element is not None:
        changed = getattr(model, name).copy()
        changed[element] = number
    return replace(model, **{name: changed})  # type: ignore[type-var]
