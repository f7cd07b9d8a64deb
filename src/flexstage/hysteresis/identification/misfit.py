"""What a model leaves of a measurement, where it was fitted and where it was not."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import stdtrit

from flexstage.arrays import Array
from flexstage.hysteresis.identification.families.family import Data, Family, behind_chain, folds_of
from flexstage.hysteresis.model import HysteresisModel

#: Blocks of neighbouring cycles that are left out in turn, at most.
_BLOCKS = 10

#: Share of the held-out errors that a band of confidence holds.
BAND = 0.95


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Misfit:
    """What a model leaves at the rows of each section."""

    left: tuple[Array, ...]
    """Output less model and the nuisance columns of the section, shape (r,)."""
    predicted: tuple[Array, ...]
    """Output less what the model predicts with the one offset that is kept, shape (r,)."""
    nuisance: tuple[Array, ...]
    """Coefficients of the nuisance columns of each section: the offset first."""
    offset: float
    """The offset that is kept: the mean of what the nuisance columns make of the rows in use."""

    def at(self, use: tuple[NDArray[np.bool_], ...]) -> Array:
        """Return what is left at some of the rows, of all sections in one."""
        return np.concatenate([e[u] for e, u in zip(self.left, use, strict=True)])

    def predicted_at(self, use: tuple[NDArray[np.bool_], ...]) -> list[Array]:
        """Return the error of the prediction at some of the rows, section by section.

        Sections without such rows are left out.
        """
        return [e[u] for e, u in zip(self.predicted, use, strict=True) if u.any()]


def misfit(model: HysteresisModel, data: Data) -> Misfit:
    """Compare a model behind the chain with the output.

    The nuisance columns are fitted to the rows in use alone; errors are of all rows.
    """
    sections = data.measurement.sections
    behind = behind_chain([model.simulate(s.u).values[:, None] for s in sections], data)
    errors = [s.y[r.at] - c[:, 0] for c, s, r in zip(behind, sections, data.rows, strict=True)]
    fitted, level, found = [], [], []
    for error, s, r, use in zip(errors, sections, data.rows, data.use, strict=True):
        columns = s.nuisance[r.at]
        chosen = use if use.any() else np.ones_like(use)
        own = np.linalg.lstsq(columns[chosen], error[chosen], rcond=None)[0]
        fitted.append(columns @ own)
        level.append(np.full(int(use.sum()), float(np.mean(columns[chosen] @ own))))
        found.append(own)
    offset = float(np.mean(np.concatenate(level)))
    return Misfit(
        left=tuple(e - n for e, n in zip(errors, fitted, strict=True)),
        # a drift that was fitted beside the model is the record's: only its mean is predicted
        predicted=tuple(
            e - n + (np.mean(n[u]) if u.any() else np.mean(n)) - offset
            for e, n, u in zip(errors, fitted, data.use, strict=True)
        ),
        nuisance=tuple(found),
        offset=offset,
    )


def free_constant(errors: Sequence[Array]) -> Array:
    """Return errors less the mean of each part: what is left where the constant is fitted again."""
    return np.concatenate([e - np.mean(e) for e in errors])


def root_mean_square(values: Array) -> float:
    """Return the root of the mean of the squares."""
    return float(np.sqrt(np.mean(values**2)))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Folds:
    """Errors of a model on cycles that it was not fitted to."""

    rms: float
    """Root mean square over all held-out rows, as predicted, in the unit of the output."""
    free_rms: float
    """The same, where each part may have a constant of its own."""
    largest: float
    """Largest absolute error there."""
    band: float
    """Absolute error that 95 % of them stay below in the worst part, as another record is another
    part.
    """
    mean_square: Array
    """Mean square of each part, shape (parts,)."""
    standard_error: float | None = None
    """Standard error of the root mean square over all, by its scatter between cycles."""
    values: tuple[Mapping[str, float], ...] = ()
    """Parameters by name where each part was left out; one that is absent is 0."""


def cross_validate(
    family: Family, data: Data, start: Array, *, stretches: bool = False
) -> Folds | None:
    """Fit to all cycles but some, and compare with those, in turn.

    Rows not in use are left out of all; the search begins where that for all cycles has ended. With
    `stretches` each part is one stretch, so that time and amplitude are extrapolated where they
    grow, as on another record; otherwise it is two that are far apart. None of fewer than two
    cycles.
    """
    folds = folds_of(data, runs=1) if stretches else folds_of(data)
    if len(folds) < 2:
        return None
    errors, free, values = [], [], []
    at_rows = [np.zeros(r.at.size) for r in data.rows]
    for held in folds:
        rest = tuple(u & ~h for u, h in zip(data.use, held, strict=True))
        part = data.with_use(rest)
        found = family.refit(part, start)
        left = misfit(found.model, part)
        own = left.predicted_at(held)
        for row, error, of in zip(at_rows, left.predicted, held, strict=True):
            row[of] = error[of]
        errors.append(np.concatenate(own))
        free.append(free_constant(own))
        values.append(dict(zip(found.names, found.values.tolist(), strict=True)))
    every = np.concatenate(errors)
    return Folds(
        rms=root_mean_square(every),
        free_rms=root_mean_square(np.concatenate(free)),
        largest=float(np.max(np.abs(every))),
        band=max(float(np.quantile(np.abs(e), BAND)) for e in errors),
        mean_square=np.array([float(np.mean(e**2)) for e in errors]),
        standard_error=rms_standard_error(at_rows, data),
        values=tuple(values),
    )


def rms_standard_error(errors: Sequence[Array], data: Data) -> float | None:
    """Return the standard error of a root mean square, by its scatter between cycles.

    Errors of a model are alike in neighbouring cycles: the jackknife leaves out blocks of them in
    turn (H. R. Kuensch, Ann. Statist. 17 (1989) 1217). Rows that are not in use are not counted;
    None of fewer than two cycles.
    """
    blocks = folds_of(data, _BLOCKS, runs=1)
    if len(blocks) < 2:
        return None
    parts = [np.concatenate([e[b] for e, b in zip(errors, block, strict=True)]) for block in blocks]
    squares = np.array([float(np.sum(part**2)) for part in parts])
    sizes = np.array([part.size for part in parts])
    without = np.sqrt((squares.sum() - squares) / (sizes.sum() - sizes))
    many = without.size
    return _few(many) * float(np.sqrt((many - 1) * np.var(without)))


def another_stretch(rms: float, error: float, stretches: Array) -> float:
    """Return the standard error of what another stretch of cycles of the drive will show.

    The error of the rms is by the scatter between held-out cycles; `stretches` are the rms of
    stretches that were held out as a whole. These differ by more than their cycles do by chance,
    and extrapolating to one leaves more.
    """
    apart = _few(stretches.size) * float(np.std(stretches, ddof=1))
    further = float(np.sqrt(np.mean(stretches**2))) - rms
    return float(np.sqrt(error**2 + apart**2 + further**2))


def _few(many: int) -> float:
    """Factor by which twice an error of few parts covers what the distribution of Student does."""
    return float(stdtrit(many - 1, 0.975)) / 1.96
