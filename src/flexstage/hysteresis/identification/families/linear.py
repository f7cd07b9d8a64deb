"""Models whose output is linear in all of their parameters: one global optimum."""

from abc import abstractmethod
from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from flexstage.arrays import Array
from flexstage.hysteresis.identification.families.family import (
    Data,
    Family,
    Fit,
    behind_chain,
    equations,
)
from flexstage.hysteresis.identification.measurement import Section
from flexstage.hysteresis.identification.projection import Normal, Solution, solve
from flexstage.hysteresis.model import HysteresisModel

#: Columns behind the chain that change by less than this, over the largest change, stand still.
_ROUNDING = 1e-9


class LinearFamily(Family):
    """A model that is a sum of known columns, each times a parameter that is not negative."""

    @abstractmethod
    def columns(self, section: Section, data: Data) -> Iterator[Array]:
        """Give the quasi-static output per unit of each parameter, some parameters at a time."""

    @abstractmethod
    def build(self, coefficients: Array, data: Data) -> HysteresisModel:
        """Return the model that some parameters make."""

    def smoothing(self, data: Data, moving: NDArray[np.bool_]) -> Array | None:
        """Return the penalty, added to the products of the columns that move; None for none.

        A quadratic form of parameters that differ from their neighbours, per sample and per square
        of the input's range; parameters that do not move get nothing.
        """
        del data, moving
        return None

    @abstractmethod
    def names(self, data: Data) -> tuple[str, ...]:
        """Return what each parameter is called."""

    def fit(self, data: Data, start: Array | None = None) -> Fit:
        del start
        made = self.refit(data, np.zeros(0))
        behind, moving = self.moving(data)
        active = np.isin(np.array(self.names(data))[moving], made.names)
        parts = [c[:, active] for c in behind]
        used = [c if use.all() else c[use] for c, use in zip(parts, data.use, strict=True)]
        return replace(made, jacobian=np.concatenate(used))

    def refit(self, data: Data, optimum: Array) -> Fit:
        del optimum
        behind, moving = self.moving(data)
        x = np.zeros(moving.size)
        x[moving] = self.solution(equations(behind, data, self.kind), data).coefficients
        active = np.flatnonzero(x)
        names = self.names(data)
        return Fit(
            model=self.build(x, data), names=tuple(names[i] for i in active), values=x[active]
        )

    def solution(self, normal: Normal, data: Data) -> Solution:
        """Solve the normal equations of the columns that move."""
        _, moving = self.moving(data)
        penalty = self.smoothing(data, moving)
        if penalty is not None:
            penalty = penalty[np.ix_(moving, moving)] * (normal.count * data.input_scale**2)
        return solve(normal, smoothing=penalty)

    def moving(self, data: Data) -> tuple[list[Array], NDArray[np.bool_]]:
        """Give the columns that move, behind the chain at the rows, worked out once.

        One that stands still cannot be told from the offset, and is none of this model.
        """
        if self.kind not in data.memo:
            parts, moving = [], []
            # a block at a time: all columns at all samples of a long record would not fit
            for block in zip(
                *(self.columns(s, data) for s in data.measurement.sections), strict=True
            ):
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
