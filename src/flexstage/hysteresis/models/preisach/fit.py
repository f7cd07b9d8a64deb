"""Fit of the Preisach model."""

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from flexstage.base.arrays import Array
from flexstage.hysteresis.identification.cycles import RecordSection
from flexstage.hysteresis.identification.model_fit import (
    FitData,
    FitResult,
    LinearFit,
    equations,
    folds_of,
)
from flexstage.hysteresis.identification.projection import Normal, residual_square
from flexstage.hysteresis.models.preisach.law import Preisach, preisach_columns

#: Candidate weights of the penalty on second differences of the density, from little to much noise.
_SMOOTHING = (3e-8, 3e-7, 3e-6, 3e-5)
#: Parts of the cycles that are held out in turn to choose the weight.
_PARTS = 4


class PreisachFit(LinearFit):
    """A density of relays on a grid of thresholds and means, smooth and not negative.

    Means are intervals of the plays' outputs. `smoothing` is the weight of the penalty on second
    differences of the density; None for the weight that best predicts held-out cycles.
    """

    law = Preisach

    def __init__(
        self, thresholds: int = 16, means: int = 16, smoothing: float | None = None
    ) -> None:
        self._thresholds, self._means, self._given = thresholds, means, smoothing
        self.size = thresholds * means
        self.floored = means  # those of threshold zero

    def _grid(self, data: FitData) -> tuple[Array, Array]:
        low, high = data.input_range
        # a play of more than half of the range moves once, on the way out of rest
        thresholds = 0.5 * (high - low) * np.arange(self._thresholds) / self._thresholds
        return thresholds, np.linspace(low, high, self._means + 1)

    def columns(self, section: RecordSection, data: FitData) -> Iterator[Array]:
        thresholds, knots = self._grid(data)
        for threshold in thresholds:
            yield preisach_columns(section.u, [threshold], knots)

    def build(self, coefficients: Array, data: FitData) -> Preisach:
        thresholds, knots = self._grid(data)
        slopes = coefficients.reshape(self._thresholds, self._means)
        return Preisach(thresholds=thresholds, knots=knots, slopes=slopes)

    def smoothing(self, data: FitData, moving: NDArray[np.bool_]) -> Array:
        # second differences along thresholds and along means; the first threshold, zero, is a gain
        # without memory and no neighbour of the others
        m, p = self._thresholds, self._means
        along = np.kron(np.eye(m), np.diff(np.eye(p), 2, axis=0))
        skip = np.zeros((m - 1, m))
        skip[:, 1:] = np.eye(m - 1)
        across = np.kron(np.diff(skip, 2, axis=0), np.eye(p))
        rows = np.concatenate((along, across))
        # densities without samples are no neighbours of the others
        rows = rows[~np.any((rows != 0.0) & ~moving, axis=1)]
        return self._weight(data) * (rows.T @ rows)

    def fit(self, data: FitData, start: Array | None = None) -> FitResult:
        key = f"{self.kind} smoothing"
        if self._given is None and key not in data.memo:
            data.memo[key] = [np.array(self._best_weight(data))]
        return super().fit(data, start)

    def _weight(self, data: FitData) -> float:
        if self._given is not None:
            return self._given
        weight = data.memo.get(f"{self.kind} smoothing")
        return _SMOOTHING[2] if weight is None else float(weight[0])

    def _best_weight(self, data: FitData) -> float:
        behind, _ = self.moving(data)
        # one run each: a density must also be valid slightly outside the fitted cycles
        folds = folds_of(data, _PARTS, runs=1)
        if len(folds) < 2:
            return _SMOOTHING[2]
        parts = [equations(behind, data.with_use(fold)) for fold in folds]
        total = equations(behind, data, self.kind)
        squares = {w: self._held_out(w, total, parts, data) for w in _SMOOTHING}
        best = min(_SMOOTHING, key=lambda w: squares[w].sum())
        # the smoothest that is equally good within the scatter between parts
        for weight in sorted(_SMOOTHING, reverse=True):
            worse = squares[weight] - squares[best]
            if worse.mean() <= worse.std(ddof=1) / np.sqrt(worse.size):
                return weight
        return best

    def _held_out(self, weight: float, total: Normal, parts: list[Normal], data: FitData) -> Array:
        """Mean square residual of each part, fitted to the others."""
        method = PreisachFit(self._thresholds, self._means, weight)
        squares = []
        for part in parts:
            if part.count in (0, total.count):
                continue
            # with the nuisance coefficients of the fitted parts, as in use
            solution = method.solution(total - part, data)
            squares.append(residual_square(part, solution) / part.count)
        return np.array(squares)
