"""Models whose output is linear in all of their parameters: one global optimum."""

from abc import abstractmethod
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from flexstage.hysteresis.identification.families.family import (
    Data,
    Family,
    Fit,
    behind_chain,
    equations,
)
from flexstage.hysteresis.identification.measurement import Section
from flexstage.hysteresis.identification.projection import Normal, solve
from flexstage.hysteresis.model import HysteresisModel

__all__ = ["LinearFamily", "moving_columns"]

Array = NDArray[np.float64]


class LinearFamily(Family):
    """A model that is a sum of known columns, each times a parameter that is not negative."""

    @abstractmethod
    def columns(self, section: Section, data: Data) -> Iterator[Array]:
        """Give the output per unit of each parameter, some parameters at a time.

        Parameters
        ----------
        section : Section
            The section.
        data : Data
            The data, for what belongs to all sections.

        Yields
        ------
        numpy.ndarray
            Quasi-static columns at every sample, shape (n, some of m).
        """

    @abstractmethod
    def build(self, coefficients: Array, data: Data) -> HysteresisModel:
        """Return the model that some parameters make.

        Parameters
        ----------
        coefficients : numpy.ndarray
            The parameters, shape (m,).
        data : Data
            The data.

        Returns
        -------
        HysteresisModel
            The model.
        """

    def smoothing(self, data: Data, moving: NDArray[np.bool_]) -> Array | None:
        """Return what is added to the products of the columns.

        Parameters
        ----------
        data : Data
            The data.
        moving : numpy.ndarray
            Which columns move in the records, shape (m,); the others get nothing.

        Returns
        -------
        numpy.ndarray or None
            Matrix of a penalty on parameters that differ from their neighbours, per sample and per
            square of the input's range, shape (m, m); None for none.
        """
        del data, moving
        return None

    @abstractmethod
    def names(self, data: Data) -> tuple[str, ...]:
        """Return what each parameter is called.

        Parameters
        ----------
        data : Data
            The data.

        Returns
        -------
        tuple of str
            Names, shape (m,).
        """

    def fit(self, data: Data, start: Array | None = None) -> Fit:
        """Find the global optimum.

        Parameters
        ----------
        data : Data
            The data.
        start : numpy.ndarray, optional
            Not used: there is nothing to search for.

        Returns
        -------
        Fit
            The fitted model.
        """
        del start
        behind = self._behind(data)
        x = self.coefficients(equations(behind, data, self.kind), behind, data)
        active = np.flatnonzero(x > 0.0)
        names = self.names(data)
        return Fit(
            model=self.build(x, data),
            names=tuple(names[i] for i in active),
            values=x[active],
            jacobian=np.concatenate(
                [c[np.ix_(use, active)] for c, use in zip(behind, data.use, strict=True)]
            ),
        )

    def coefficients(self, normal: Normal, behind: list[Array], data: Data) -> Array:
        """Solve the normal equations.

        Parameters
        ----------
        normal : Normal
            Equations of the samples that are fitted.
        behind : list of numpy.ndarray
            Columns behind the chain at the rows of each section, shape (r, m).
        data : Data
            The data.

        Returns
        -------
        numpy.ndarray
            The parameters, shape (m,), zero for columns that do not move.
        """
        key = f"{self.kind} moving"
        if key not in data.memo:
            data.memo[key] = moving_columns(behind)
        moving = data.memo[key]
        penalty = self.smoothing(data, moving)
        gram, right = normal.gram.copy(), normal.right.copy()
        if penalty is not None:
            m = normal.columns
            gram[:m, :m] += penalty * normal.count * data.input_scale**2
        # a column that stands still cannot be told from the offset, and is none of this model
        still = np.flatnonzero(~moving)
        gram[still, :] = gram[:, still] = 0.0
        gram[still, still] = 1.0
        right[still] = 0.0
        x = solve(replace(normal, gram=gram, right=right)).coefficients
        x[still] = 0.0
        return x

    def _behind(self, data: Data) -> list[Array]:
        """Columns behind the chain at the rows, worked out once."""
        if self.kind not in data.memo:
            # a block at a time: all columns at all samples of a long record would not fit
            blocks = zip(*(self.columns(s, data) for s in data.measurement.sections), strict=True)
            parts = [behind_chain(list(block), data) for block in blocks]
            data.memo[self.kind] = [np.concatenate(own, axis=1) for own in zip(*parts, strict=True)]
        return data.memo[self.kind]


def moving_columns(behind: list[Array]) -> NDArray[np.bool_]:
    """Return which columns change by more than rounding anywhere.

    Parameters
    ----------
    behind : list of numpy.ndarray
        Columns at the rows of each section, shape (r, m).

    Returns
    -------
    numpy.ndarray
        Shape (m,).
    """
    spread = np.max([np.ptp(c, axis=0) for c in behind], axis=0)
    return spread > 1e-9 * max(float(spread.max()), 1e-300)
