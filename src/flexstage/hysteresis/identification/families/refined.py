"""Models that no projection reaches: a start from a simpler model, then damped Gauss-Newton."""

from abc import abstractmethod
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from flexstage.errors import ModelError
from flexstage.hysteresis.identification.families.family import (
    Data,
    Family,
    Fit,
    behind_chain,
    equations,
)
from flexstage.hysteresis.identification.projection import Solution, solve
from flexstage.hysteresis.model import HysteresisModel

__all__ = ["RefinedFamily", "roughness"]

Array = NDArray[np.float64]

_ITERATIONS = 25
#: The search has ended when a step takes less than this share of the sum of squares away.
_DONE = 1e-5
#: Step of the differences that the output's change with a parameter is found with, of its scale.
_STEP = 1e-5


class RefinedFamily(Family):
    """A model with bounded parameters that is fitted from a good start.

    Each step solves the linearised problem, damped, with the bounds (Levenberg 1944; Marquardt
    1963; the bounds by non-negative least squares), in the output and behind the chain, so that
    noise of the output does not get into the columns.
    """

    @abstractmethod
    def begin(self, data: Data) -> Array:
        """Return the parameters that the search begins with.

        Parameters
        ----------
        data : Data
            The data.

        Returns
        -------
        numpy.ndarray
            The parameters, shape (k,).
        """

    @abstractmethod
    def build(self, parameters: Array, data: Data) -> HysteresisModel:
        """Return the model that some parameters make.

        Parameters
        ----------
        parameters : numpy.ndarray
            The parameters, shape (k,).
        data : Data
            The data.

        Returns
        -------
        HysteresisModel
            The model.

        Raises
        ------
        ModelError
            They make none.
        """

    @abstractmethod
    def bounds(self, data: Data) -> tuple[Array, Array]:
        """Return the lower bounds of the parameters, and by how much each may change at once.

        Parameters
        ----------
        data : Data
            The data.

        Returns
        -------
        tuple of numpy.ndarray
            Lowest values, minus infinity for none, and scales; shape (k,) each.
        """

    def penalty(self, data: Data) -> Array | None:
        """Return the penalty on parameters that differ from their neighbours.

        Parameters
        ----------
        data : Data
            The data.

        Returns
        -------
        numpy.ndarray or None
            Matrix of a quadratic form of the parameters over their scales, per sample and per
            square of the stroke, shape (k, k); None for none.
        """
        del data
        return None

    def fit(self, data: Data, start: Array | None = None) -> Fit:
        """Find the optimum next to the start.

        Parameters
        ----------
        data : Data
            The data.
        start : numpy.ndarray, optional
            Where the search begins, shape (k,); `begin` where not given.

        Returns
        -------
        Fit
            The fitted model.
        """
        low, scale = self.bounds(data)
        p = np.asarray(self.begin(data) if start is None else start, dtype=np.float64)
        p = np.maximum(p, low)
        cost, behind = self._evaluate(p, data)
        damping, J = 1e-3, self._jacobian(p, behind, scale, data)
        for _ in range(_ITERATIONS):
            trial = np.maximum(
                _step(p, behind, J, low, scale, damping, self.penalty(data), data), low
            )
            try:
                new, moved = self._evaluate(trial, data)
            except ModelError:  # beyond what the model allows
                new, moved = np.inf, behind
            if new >= cost:
                damping *= 8.0
                if damping > 1e8:
                    break
                continue
            gained = 1.0 - new / cost
            p, cost, behind = trial, new, moved
            damping = max(damping / 4.0, 1e-9)
            if gained < _DONE:
                break
            J = self._jacobian(p, behind, scale, data)
        return Fit(model=self.build(p, data), search=p, jacobian=self._active(J, p, low, data))

    def _evaluate(self, p: Array, data: Data) -> tuple[float, list[Array]]:
        model = self.build(p, data)
        behind = behind_chain(
            [model.simulate(s.u).values[:, None] for s in data.measurement.sections], data
        )
        left = _left(behind, data)
        rough = 0.0
        penalty = self.penalty(data)
        if penalty is not None:
            scaled = p / self.bounds(data)[1]
            rough = left.size * float(scaled @ penalty @ scaled)
        return float(left @ left) + rough, behind

    def _jacobian(self, p: Array, behind: list[Array], scale: Array, data: Data) -> list[Array]:
        """Change of the output with each parameter at every sample, by its scale."""
        sections = data.measurement.sections
        base = [self.build(p, data).simulate(s.u).values for s in sections]
        columns = [np.empty((s.u.size, p.size)) for s in sections]
        for j in range(p.size):
            moved = p.copy()
            moved[j] += _STEP * scale[j]
            model = self.build(moved, data)
            for k, s in enumerate(sections):
                columns[k][:, j] = (model.simulate(s.u).values - base[k]) / _STEP
        del behind
        return behind_chain(columns, data)

    def _active(self, J: list[Array], p: Array, low: Array, data: Data) -> Array:
        inside = np.flatnonzero(p > low)
        return np.concatenate([c[u][:, inside] for c, u in zip(J, data.use, strict=True)])


def _left(behind: list[Array], data: Data) -> Array:
    """What is left of the output over the stroke, with the best offset and settling."""
    every = []
    for c, s, r, use in zip(behind, data.measurement.sections, data.rows, data.use, strict=True):
        at = r.at[use]
        error = s.y[at] - c[use, 0]
        own = np.linalg.lstsq(s.nuisance[at], error, rcond=None)[0] if at.size else np.zeros(0)
        every.append(error - s.nuisance[at] @ own if at.size else error)
    return np.concatenate(every) / data.measurement.stroke


def _step(
    p: Array,
    behind: list[Array],
    J: list[Array],
    low: Array,
    scale: Array,
    damping: float,
    penalty: Array | None,
    data: Data,
) -> Array:
    """Return the parameters that the damped, linearised problem with bounds gives."""
    free = np.isinf(low)
    # counted from the lower bound: z = (p - low) / scale, and free parameters from where they are
    base = np.where(free, p, low)
    z0 = (p - base) / scale
    target = [
        s.y[r.at] - c[:, 0] + j @ z0
        for s, r, c, j in zip(data.measurement.sections, data.rows, behind, J, strict=True)
    ]
    sections = tuple(
        replace(s, y=_placed(s.y, r.at, t))
        for s, r, t in zip(data.measurement.sections, data.rows, target, strict=True)
    )
    moved = replace(data, measurement=replace(data.measurement, sections=sections))
    normal = equations(J, moved)
    weight = damping * np.diag(normal.gram)[: p.size]
    gram = normal.gram.copy()
    gram[np.arange(p.size), np.arange(p.size)] += weight
    right = normal.right.copy()
    right[: p.size] += weight * z0
    if penalty is not None:
        own = penalty * normal.count * data.measurement.stroke**2
        gram[: p.size, : p.size] += own
        right[: p.size] -= own @ (base / scale)
    solution: Solution = solve(replace(normal, gram=gram, right=right), free=free)
    return base + scale * solution.coefficients


def _placed(y: Array, at: NDArray[np.intp], values: Array) -> Array:
    made = y.copy()
    made[at] = values
    return made


def roughness(*groups: int) -> Array:
    """Return the quadratic form of second differences within groups of neighbours.

    Parameters
    ----------
    *groups : int
        Number of parameters of each group.

    Returns
    -------
    numpy.ndarray
        The matrix, shape (k, k), where k is their sum.
    """
    made, first = np.zeros((sum(groups), sum(groups))), 0
    for count in groups:
        own = np.diff(np.eye(count), 2, axis=0) if count > 2 else np.zeros((0, count))
        made[first : first + count, first : first + count] = own.T @ own
        first += count
    return made
