"""How a hysteresis model is fitted: its columns, and what is searched for."""

import functools
import operator
from abc import ABC, abstractmethod
from dataclasses import dataclass, field, replace
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from flexstage.hysteresis.identification.chain_filter import ChainValues, Rows, filtered
from flexstage.hysteresis.identification.measurement import Measurement
from flexstage.hysteresis.identification.projection import (
    Normal,
    Solution,
    normal_equations,
)
from flexstage.hysteresis.model import HysteresisModel

__all__ = ["Data", "Family", "Fit", "behind_chain", "equations", "residual"]

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Data:
    """What a family fits: a measurement behind a known chain, some samples of it.

    Parameters
    ----------
    measurement : Measurement
        The measurement.
    chain : ChainValues
        The chain behind the hysteresis.
    rows : tuple of Rows
        Samples of each section that are looked at.
    use : tuple of numpy.ndarray
        Which of them are fitted, shape (r,); the others are held out.
    memo : dict
        What families have worked out for all the rows, kept for the next choice of `use`.
    """

    measurement: Measurement
    chain: ChainValues
    rows: tuple[Rows, ...]
    use: tuple[NDArray[np.bool_], ...]
    memo: dict[str, list[Array]] = field(default_factory=dict)

    @property
    def input_scale(self) -> float:
        """Range of the input."""
        low, high = self.measurement.input_range
        return high - low

    def with_use(self, use: tuple[NDArray[np.bool_], ...]) -> "Data":
        """Return the same data with other samples held out.

        Parameters
        ----------
        use : tuple of numpy.ndarray
            Which samples of each section are fitted, shape (r,).

        Returns
        -------
        Data
            The data.
        """
        return replace(self, use=use)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Fit:
    """A fitted model.

    Parameters
    ----------
    model : HysteresisModel
        The model.
    search : numpy.ndarray
        Where the search over nonlinear parameters ended, shape (s,).
    names : tuple of str
        Names of the parameters that have an uncertainty.
    values : numpy.ndarray
        Their values, shape (k,).
    notes : tuple of str
        What a reader should know.
    jacobian : numpy.ndarray or None
        Change of the output with each of them at all rows that are fitted, shape (r, k).
    """

    model: HysteresisModel
    search: Array = field(default_factory=lambda: np.zeros(0))
    names: tuple[str, ...] = ()
    values: Array = field(default_factory=lambda: np.zeros(0))
    notes: tuple[str, ...] = ()
    jacobian: Array | None = None


class Family(ABC):
    """One model, and how it is fitted."""

    #: Name of the model.
    kind: ClassVar[str]
    #: What it is called in text.
    title: ClassVar[str]

    @abstractmethod
    def fit(self, data: Data, start: Array | None = None) -> Fit:
        """Fit the model.

        Parameters
        ----------
        data : Data
            The data.
        start : numpy.ndarray, optional
            Where the search over nonlinear parameters begins, shape (s,); a grid over all of their
            range where not given.

        Returns
        -------
        Fit
            The fitted model.
        """

    @property
    @abstractmethod
    def size(self) -> int:
        """Number of parameters."""


def behind_chain(columns: list[Array], data: Data) -> list[Array]:
    """Pass columns through the chain.

    Parameters
    ----------
    columns : list of numpy.ndarray
        Quasi-static columns at every sample of each section, shape (n, m).
    data : Data
        The data.

    Returns
    -------
    list of numpy.ndarray
        The columns at the rows of each section, shape (r, m).
    """
    return [
        filtered(c, s, r, data.chain)
        for c, s, r in zip(columns, data.measurement.sections, data.rows, strict=True)
    ]


def equations(behind: list[Array], data: Data) -> Normal:
    """Form the normal equations of the samples in use.

    Parameters
    ----------
    behind : list of numpy.ndarray
        Columns behind the chain at the rows of each section, shape (r, m).
    data : Data
        The data.

    Returns
    -------
    Normal
        The equations.
    """
    own = [
        normal_equations(c[use], s.nuisance[r.at[use]], s.y[r.at[use]])
        for c, s, r, use in zip(behind, data.measurement.sections, data.rows, data.use, strict=True)
    ]
    return functools.reduce(operator.add, own)


def residual(behind: list[Array], solution: Solution, data: Data) -> Array:
    """Return what a solution leaves of the output, at the samples in use.

    Parameters
    ----------
    behind : list of numpy.ndarray
        Columns behind the chain at the rows of each section, shape (r, m).
    solution : Solution
        Their coefficients, and those of the nuisance columns, section by section.
    data : Data
        The data.

    Returns
    -------
    numpy.ndarray
        Output less model, shape (all rows in use,).
    """
    left, first = [], 0
    for c, s, r, use in zip(behind, data.measurement.sections, data.rows, data.use, strict=True):
        count = s.nuisance.shape[1]
        own = solution.nuisance[first : first + count]
        first += count
        at = r.at[use]
        left.append(s.y[at] - c[use] @ solution.coefficients - s.nuisance[at] @ own)
    return np.concatenate(left)
