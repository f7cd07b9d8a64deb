"""Models that are linear in most parameters: the rest is searched for by variable projection."""

import itertools
from abc import abstractmethod
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from flexstage.hysteresis.identification.chain_filter import Rows
from flexstage.hysteresis.identification.families.family import (
    Data,
    Family,
    Fit,
    behind_chain,
    equations,
    residual,
)
from flexstage.hysteresis.identification.measurement import Section
from flexstage.hysteresis.identification.projection import Solution, solve
from flexstage.hysteresis.model import HysteresisModel

__all__ = ["SearchFamily"]

Array = NDArray[np.float64]

#: Rows that the coarse search looks at.
_COARSE_ROWS = 2500
#: Points of the coarse search that are followed to their minimum.
_FOLLOWED = 3
#: Step of the differences that uncertainties are found with, relative to each parameter.
_STEP = 1e-4
#: Fields of models that are chosen and not fitted.
_NOT_FITTED = ("exponent", "lowest_input", "highest_input", "input_range")


class SearchFamily(Family):
    """A model that is linear in all but a few parameters.

    For given values of the few, the others follow from linear least squares, and the misfit is a
    function of the few alone (variable projection: G. H. Golub, V. Pereyra, SIAM J. Numer. Anal. 10
    (1973) 413). They are scaled to run from 0 to 1.
    """

    #: Points of the coarse search along each searched parameter.
    grid: tuple[int, ...]

    @abstractmethod
    def columns(self, section: Section, place: Array, data: Data) -> Array:
        """Return the output per unit of each linear parameter.

        Parameters
        ----------
        section : Section
            The section.
        place : numpy.ndarray
            The searched parameters, each from 0 to 1, shape (s,).
        data : Data
            The data, for what belongs to all sections.

        Returns
        -------
        numpy.ndarray
            Quasi-static columns at every sample, shape (n, m).
        """

    @abstractmethod
    def build(self, place: Array, coefficients: Array, data: Data) -> HysteresisModel:
        """Return the model that some parameters make.

        Parameters
        ----------
        place : numpy.ndarray
            The searched parameters, each from 0 to 1, shape (s,).
        coefficients : numpy.ndarray
            The linear parameters, shape (m,).
        data : Data
            The data.

        Returns
        -------
        HysteresisModel
            The model.
        """

    def free(self, data: Data) -> NDArray[np.bool_] | None:
        """Return which linear parameters may be negative.

        Parameters
        ----------
        data : Data
            The data.

        Returns
        -------
        numpy.ndarray or None
            Shape (m,); None where none may be.
        """
        del data
        return None

    def penalty(self, data: Data) -> Array | None:
        """Return the penalty on linear parameters.

        Parameters
        ----------
        data : Data
            The data.

        Returns
        -------
        numpy.ndarray or None
            Matrix of a quadratic form of them, per sample, shape (m, m); None for none.
        """
        del data
        return None

    def starts(self, data: Data) -> list[Array]:
        """Return the points of the coarse search.

        Parameters
        ----------
        data : Data
            The data.

        Returns
        -------
        list of numpy.ndarray
            Points, each of shape (s,).
        """
        del data
        lines = [(np.arange(n) + 0.5) / n for n in self.grid]
        return [np.array(point) for point in itertools.product(*lines)]

    def project(self, place: Array, data: Data) -> tuple[Solution, list[Array], Array]:
        """Find the linear parameters that belong to some searched ones.

        Parameters
        ----------
        place : numpy.ndarray
            The searched parameters, each from 0 to 1, shape (s,).
        data : Data
            The data.

        Returns
        -------
        Solution, list of numpy.ndarray and numpy.ndarray
            The linear parameters, their columns behind the chain, and what is left of the output
            over the stroke.
        """
        every = [self.columns(s, place, data) for s in data.measurement.sections]
        behind = behind_chain(every, data)
        normal, penalty = equations(behind, data), self.penalty(data)
        smoothing = None if penalty is None else normal.count * penalty
        solution = solve(normal, free=self.free(data), smoothing=smoothing)
        return solution, behind, residual(behind, solution, data) / data.measurement.stroke

    def fit(self, data: Data, start: Array | None = None) -> Fit:
        """Find the optimum.

        Parameters
        ----------
        data : Data
            The data.
        start : numpy.ndarray, optional
            Where the search begins, shape (s,), each from 0 to 1; the best points of a grid over
            all of their range where not given.

        Returns
        -------
        Fit
            The fitted model.
        """
        begins = [np.asarray(start, dtype=np.float64)] if start is not None else self._best(data)
        found = [self._follow(begin, data) for begin in begins]
        cost, place = min(found, key=lambda pair: pair[0])
        del cost
        solution, _, _ = self.project(place, data)
        model = self.build(place, solution.coefficients, data)
        names, values, jacobian = _sensitivities(model, data)
        inner = np.all((place > 1e-3) & (place < 1.0 - 1e-3))
        notes = () if inner else ("a parameter ended at the border of its search range",)
        return Fit(
            model=model, search=place, names=names, values=values, jacobian=jacobian, notes=notes
        )

    def _best(self, data: Data) -> list[Array]:
        coarse = _thinned(data)
        points = self.starts(data)
        costs = []
        for point in points:
            _, _, left = self.project(point, coarse)
            costs.append(float(left @ left))
        order = np.argsort(costs)
        return [points[i] for i in order[:_FOLLOWED]]

    def _follow(self, begin: Array, data: Data) -> tuple[float, Array]:
        coarse = self._minimise(begin, _thinned(data), 1e-4)
        place = self._minimise(coarse, data, 1e-9)
        left = self.project(place, data)[2]
        return float(left @ left), place

    def _minimise(self, begin: Array, data: Data, tolerance: float) -> Array:
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


def _thinned(data: Data) -> Data:
    total = sum(r.at.size for r in data.rows)
    every = max(1, total // _COARSE_ROWS)
    rows = tuple(Rows(at=r.at[::every], cycle=r.cycle[::every]) for r in data.rows)
    use = tuple(u[::every] for u in data.use)
    return replace(data, rows=rows, use=use, memo={})


def _sensitivities(model: HysteresisModel, data: Data) -> tuple[tuple[str, ...], Array, Array]:
    """Change of the output with each number that the model holds, at the rows in use."""
    names, values, columns = [], [], []
    for name, value, changed in _numbers(model):
        step = _STEP * abs(value)
        ends = [changed(value + sign * step) for sign in (1.0, -1.0)]
        moved = []
        for s in data.measurement.sections:
            up, down = (m.simulate(s.u).values for m in ends)
            moved.append(((up - down) / (2.0 * step))[:, None])
        names.append(name)
        values.append(value)
        columns.append(
            np.concatenate(
                [c[use, 0] for c, use in zip(behind_chain(moved, data), data.use, strict=True)]
            )
        )
    return tuple(names), np.array(values), np.column_stack(columns)


def _numbers(
    model: HysteresisModel,
) -> Iterator[tuple[str, float, Callable[[float], HysteresisModel]]]:
    """Give each fitted number of a model, and how to make the model with another one.

    All of them belong to the covariance, also those of arrays: what one of them is known to
    depends on the others.
    """
    for name, value in model.parameters().items():
        if name in _NOT_FITTED:
            continue
        if isinstance(value, float) and value != 0.0:
            yield name, value, partial(_with_number, model, name)
        elif isinstance(value, np.ndarray):
            for i in np.flatnonzero(value):
                own = float(value[i])
                yield f"{name}[{i}]", own, partial(_with_element, model, name, value, int(i))


def _with_number(model: HysteresisModel, name: str, value: float) -> HysteresisModel:
    return replace(model, **{name: value})  # type: ignore[type-var]


def _with_element(
    model: HysteresisModel, name: str, array: Array, i: int, value: float
) -> HysteresisModel:
    changed = array.copy()
    changed[i] = value
    return replace(model, **{name: changed})  # type: ignore[type-var]
