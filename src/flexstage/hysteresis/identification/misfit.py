"""What a model leaves of a measurement, and how well that determines its parameters."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.special import stdtrit

from flexstage.base.arrays import Array
from flexstage.hysteresis.identification.model_fit import (
    FitData,
    FitResult,
    ModelFit,
    behind_chain,
    folds_of,
)
from flexstage.hysteresis.model import HysteresisModel

#: Blocks of neighbouring cycles that are left out in turn, at most.
_BLOCKS = 10

#: Share of the held-out errors that a band of confidence holds.
BAND = 0.95
#: A parameter whose standard error exceeds this share of it is not determined.
_UNDETERMINED = 0.5
#: Correlation above which two parameters cannot be told apart.
_INSEPARABLE = 0.98


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


def misfit(model: HysteresisModel, data: FitData) -> Misfit:
    """Compare a model behind the chain with the output.

    The nuisance columns are fitted to the rows in use alone; errors are of all rows.
    """
    sections = data.sections
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
    method: ModelFit, data: FitData, start: Array, *, stretches: bool = False
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
        found = method.refit(part, start)
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


def rms_standard_error(errors: Sequence[Array], data: FitData) -> float | None:
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
    return float(jackknife(without))


def jackknife(values: Array) -> Array:
    """Return the standard error of figures that were found without each of some parts in turn."""
    many = values.shape[0]
    return _few(many) * np.sqrt((many - 1) * np.var(values, axis=0))


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


@dataclass(frozen=True, slots=True, kw_only=True)
class ParameterEstimate:
    """A parameter with its uncertainty."""

    name: str
    """Its name."""
    value: float
    """Its value."""
    standard_error: float
    """Its standard error, in the same unit; infinite where the record does not determine it."""


def estimates(
    fit: FitResult, data: FitData, left: Misfit, folds: Sequence[Folds], chain: Mapping[str, float]
) -> tuple[tuple[ParameterEstimate, ...], ParameterEstimate, tuple[str, ...]]:
    """Return the standard errors of the parameters of a model, and what cannot be told apart.

    Errors that are left are alike within a cycle and from one cycle to the next only by chance, so
    the covariance is that of a sum over cycles (the sandwich estimator of K.-Y. Liang, S. L. Zeger,
    Biometrika 73 (1986) 13), and not that of independent samples, which is many times too small.
    Offsets and chain are fitted along, so that their uncertainty is in it. Where the model was
    fitted without each part of the cycles in turn, the jackknife over those parts counts where it
    is larger (R. G. Miller, Biometrika 61 (1974) 1). Folds: the fits without parts of the cycles,
    for each way of dividing them. Chain: how far each value that was found may be off; what the
    parameters move with it, all others fitted anew, is in their errors. Returned: parameters, the
    offset, warnings.
    """
    # the columns behind these belong to nothing by themselves
    named = slice(0, len(fit.names))
    first = 0 if fit.jacobian is None else fit.jacobian.shape[1]
    J = _jacobian(fit, data, tuple(chain))
    # the offset that is kept is the mean of what the nuisance columns, the last ones, make
    mean = np.zeros(J.shape[1])
    mean[first + len(chain) :] = J[:, first + len(chain) :].mean(axis=0)
    e = left.at(data.use)
    scale = np.sqrt(np.maximum(np.sum(J**2, axis=0), 1e-300))
    J = J / scale
    bread = np.linalg.pinv(J.T @ J, rcond=1e-13, hermitian=True)
    sums = _sums_by_cycle(J * e[:, None], data)
    many = sums.shape[0]
    covariance = bread @ (sums.T @ sums) @ bread * many / max(many - 1, 1)
    plain = bread * float(e @ e) / max(e.size - J.shape[1], 1)
    # with few cycles the sum over them is too small, so the larger of the two is taken
    error = np.sqrt(np.maximum(np.diag(covariance), np.diag(plain)))[named] / scale[named]
    for divided in folds:
        without = np.array([[own.get(n, 0.0) for n in fit.names] for own in divided.values])
        error = np.maximum(error, jackknife(without))
    for c, width in enumerate(chain.values(), start=first):
        along = bread[named, c] / max(bread[c, c], 1e-300) * scale[c] / scale[named]
        error = np.hypot(error, along * width)
    mean /= scale
    offset = ParameterEstimate(
        name="offset",
        value=left.offset,
        standard_error=float(np.sqrt(max(mean @ covariance @ mean, mean @ plain @ mean))),
    )
    found = tuple(
        ParameterEstimate(name=n, value=float(v), standard_error=float(s))
        for n, v, s in zip(fit.names, fit.values, error, strict=True)
    )
    return found, offset, _warnings(found, plain[named, named])


def _warnings(found: tuple[ParameterEstimate, ...], covariance: Array) -> tuple[str, ...]:
    said = [
        f"the record does not determine {e.name}: {e.value:.3g} with a standard error of "
        f"{e.standard_error:.2g}"
        for e in found
        if "[" not in e.name and e.value != 0.0 and e.standard_error > _UNDETERMINED * abs(e.value)
    ]
    sigma = np.sqrt(np.maximum(np.diag(covariance), 1e-300))
    correlation = covariance / np.outer(sigma, sigma)
    for i in range(len(found)):
        for j in range(i):
            if "[" in found[i].name or "[" in found[j].name:
                continue
            if abs(correlation[i, j]) > _INSEPARABLE:
                said.append(
                    f"the record hardly separates {found[j].name} and {found[i].name} "
                    f"(correlation {correlation[i, j]:.3f})"
                )
    return tuple(said)


def _jacobian(fit: FitResult, data: FitData, searched: Sequence[str]) -> Array:
    sections = data.sections
    parts = [fit.jacobian] if fit.jacobian is not None else []
    quasi = [fit.model.simulate(s.u).values[:, None] for s in sections]
    for name in searched:
        value = getattr(data.chain, name)
        step = 1e-3 * value if value > 0.0 else {"delay": sections[0].dt}.get(name, 1e-3)
        ends = []
        for moved in (value + step, max(value - step, 0.0)):
            chain = replace(data.chain, **{name: moved})
            behind = behind_chain(quasi, replace(data, chain=chain))
            ends.append(np.concatenate([c[u, 0] for c, u in zip(behind, data.use, strict=True)]))
        width = value + step - max(value - step, 0.0)
        parts.append(((ends[0] - ends[1]) / width)[:, None])
    first = 0
    total = sum(int(u.sum()) for u in data.use)
    for s, r, u in zip(sections, data.rows, data.use, strict=True):
        own = np.zeros((total, s.nuisance.shape[1]))
        count = int(u.sum())
        own[first : first + count] = s.nuisance[r.at[u]]
        parts.append(own)
        first += count
    return np.concatenate(parts, axis=1)


def _sums_by_cycle(scores: Array, data: FitData) -> Array:
    labels, offset = [], 0
    for r, u in zip(data.rows, data.use, strict=True):
        labels.append(r.cycle[u] + offset)
        offset += int(r.cycle.max()) + 1
    _, which = np.unique(np.concatenate(labels), return_inverse=True)
    sums = np.zeros((int(which.max()) + 1, scores.shape[1]))
    np.add.at(sums, which, scores)
    return sums
