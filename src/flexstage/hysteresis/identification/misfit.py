"""What a model leaves of a measurement, where it was fitted and where it was not."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from flexstage.hysteresis.identification.families.family import Data, Family, behind_chain
from flexstage.hysteresis.identification.families.folds import folds_of
from flexstage.hysteresis.model import HysteresisModel

__all__ = ["Folds", "Misfit", "cross_validate", "misfit"]

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Misfit:
    """What a model leaves at the rows of each section.

    Parameters
    ----------
    left : tuple of numpy.ndarray
        Output less model, shape (r,), of each section.
    nuisance : tuple of numpy.ndarray
        Coefficients of the nuisance columns of each section: the offset first.
    """

    left: tuple[Array, ...]
    nuisance: tuple[Array, ...]

    def at(self, use: tuple[NDArray[np.bool_], ...]) -> Array:
        """Return what is left at some of the rows.

        Parameters
        ----------
        use : tuple of numpy.ndarray
            Which rows of each section, shape (r,).

        Returns
        -------
        numpy.ndarray
            What is left there, of all sections.
        """
        return np.concatenate([e[u] for e, u in zip(self.left, use, strict=True)])


def misfit(model: HysteresisModel, data: Data) -> Misfit:
    """Compare a model behind the chain with the output.

    Parameters
    ----------
    model : HysteresisModel
        The model.
    data : Data
        The data. Offset and settling are fitted to the rows in use; for the rows that are held out,
        to all.

    Returns
    -------
    Misfit
        What is left at all rows, in use or held out.
    """
    sections = data.measurement.sections
    behind = behind_chain([model.simulate(s.u).values[:, None] for s in sections], data)
    left, found = [], []
    for c, s, r, use in zip(behind, sections, data.rows, data.use, strict=True):
        error, nuisance = s.y[r.at] - c[:, 0], s.nuisance[r.at]
        chosen = use if use.any() else np.ones_like(use)
        own = np.linalg.lstsq(nuisance[chosen], error[chosen], rcond=None)[0]
        whole = np.linalg.lstsq(nuisance, error, rcond=None)[0]
        # offset and settling are the record's and not the model's: to extrapolate them to where
        # nothing was fitted would say more of the record than of the model
        left.append(np.where(use, error - nuisance @ own, error - nuisance @ whole))
        found.append(own)
    return Misfit(left=tuple(left), nuisance=tuple(found))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Folds:
    """Errors of a model on cycles that it was not fitted to.

    Parameters
    ----------
    rms : float
        Root mean square over all held-out rows, in the unit of the output.
    largest : float
        Largest absolute error there.
    mean_square : numpy.ndarray
        Mean square of each part, shape (parts,).
    values : tuple of Mapping
        Parameters by name where each part was left out; one that is absent is 0.
    """

    rms: float
    largest: float
    mean_square: Array
    values: tuple[Mapping[str, float], ...] = ()


def cross_validate(family: Family, data: Data, start: Array) -> Folds | None:
    """Fit to all cycles but some, and compare with those, in turn.

    Parameters
    ----------
    family : Family
        The model.
    data : Data
        The data; rows that are not in use are left out of all.
    start : numpy.ndarray
        Where the search over nonlinear parameters begins.

    Returns
    -------
    Folds or None
        The held-out errors; None where there are fewer than two cycles.
    """
    folds = folds_of(data)
    if len(folds) < 2:
        return None
    errors, values = [], []
    for held in folds:
        rest = tuple(u & ~h for u, h in zip(data.use, held, strict=True))
        part = data.with_use(rest)
        found = family.fit(part, start if start.size else None)
        errors.append(misfit(found.model, part).at(held))
        values.append(dict(zip(found.names, found.values.tolist(), strict=True)))
    every = np.concatenate(errors)
    return Folds(
        rms=float(np.sqrt(np.mean(every**2))),
        largest=float(np.max(np.abs(every))),
        mean_square=np.array([float(np.mean(e**2)) for e in errors]),
        values=tuple(values),
    )
