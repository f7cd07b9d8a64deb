"""Residuals of a model on a measurement, cross-validation, and errors of its parameters."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import block_diag
from scipy.special import stdtrit

from flexstage.base.arrays import Array
from flexstage.hysteresis.identification.model_fit import (
    FitData,
    FitResult,
    ModelFit,
    behind_chain,
    fitted_levels,
    folds_of,
)
from flexstage.hysteresis.model import HysteresisModel

#: Largest number of blocks of neighbouring cycles that are omitted in turn.
_BLOCKS = 10

#: Share of the held-out errors inside the confidence band.
BAND = 0.95
#: A parameter is undetermined if its standard error exceeds this share of it.
_UNDETERMINED = 0.5
#: Correlation above which two parameters cannot be separated.
_INSEPARABLE = 0.98


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Residuals:
    """Residuals of a model at the rows of each section."""

    of_fit: tuple[Array, ...]
    """Output less model and the nuisance columns of the section, shape (r,)."""
    of_prediction: tuple[Array, ...]
    """Output less model and baseline, shape (r,)."""
    baseline: tuple[Array, ...]
    """The common offset at every sample of each section, or the section's own nuisance columns if
    each record has its zero, shape (n,).
    """
    offset: float
    """The common offset: mean of the fitted nuisance columns over the rows in use."""

    def at(self, use: tuple[NDArray[np.bool_], ...]) -> Array:
        """Return the residuals of the fit at some of the rows, of all sections in one."""
        return np.concatenate([e[u] for e, u in zip(self.of_fit, use, strict=True)])

    def predicted_at(self, use: tuple[NDArray[np.bool_], ...]) -> list[Array]:
        """Return the errors of the prediction at some of the rows, section by section.

        Sections without such rows are omitted.
        """
        return [e[u] for e, u in zip(self.of_prediction, use, strict=True) if u.any()]


def residuals(model: HysteresisModel, data: FitData) -> Residuals:
    """Compare a model behind the chain with the output.

    The nuisance columns are fitted to the rows in use alone, or to all rows of a section without
    any; errors are of all rows.
    """
    sections = data.sections
    outputs = behind_chain([model.simulate(s.u).values[:, None] for s in sections], data)
    errors = [s.y[r.at] - c[:, 0] for c, s, r in zip(outputs, sections, data.rows, strict=True)]
    levels = fitted_levels(errors, data)
    every = [level[r.at[u]] for level, r, u in zip(levels, data.rows, data.use, strict=True)]
    offset = float(np.mean(np.concatenate(every)))
    baseline = [np.full(s.u.size, offset) for s in sections] if data.zero == "one" else levels
    of_fit, of_prediction = (
        tuple(e - values[r.at] for e, values, r in zip(errors, by_section, data.rows, strict=True))
        for by_section in (levels, baseline)
    )
    return Residuals(
        of_fit=of_fit, of_prediction=of_prediction, baseline=tuple(baseline), offset=offset
    )


def free_constant(errors: Sequence[Array]) -> Array:
    """Return errors less the mean of each part: the residuals with a refitted constant."""
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
    """The same, with a separate constant for each part."""
    largest: float
    """Largest absolute error there."""
    band: float
    """95 % quantile of the absolute errors in the worst part, since another record is another
    part.
    """
    mean_square: Array
    """Mean square of each part, shape (parts,)."""
    standard_error: float | None = None
    """Standard error of the rms over all, by its scatter between cycles."""
    values: tuple[Mapping[str, float], ...] = ()
    """Parameters by name, fitted without each part; an absent one is 0."""


def cross_validate(
    method: ModelFit, data: FitData, start: Array, *, stretches: bool = False
) -> Folds | None:
    """Fit to all cycles but one part, and compare with that part, for each part in turn.

    Rows not in use are omitted; the search begins at the optimum of all cycles. With `stretches`
    each part is one stretch, so that time and amplitude are extrapolated where they grow, as for
    another record; otherwise it is two that are far apart. None for fewer than two cycles.
    """
    folds = folds_of(data, runs=1) if stretches else folds_of(data)
    if len(folds) < 2:
        return None
    errors, free, values = [], [], []
    at_rows = [np.zeros(r.at.size) for r in data.rows]
    for held_out in folds:
        fitted_rows = tuple(u & ~h for u, h in zip(data.use, held_out, strict=True))
        part = data.with_use(fitted_rows)
        fit = method.refit(part, start)
        fold_residuals = residuals(fit.model, part)
        held_errors = fold_residuals.predicted_at(held_out)
        for row, error, of in zip(at_rows, fold_residuals.of_prediction, held_out, strict=True):
            row[of] = error[of]
        errors.append(np.concatenate(held_errors))
        free.append(free_constant(held_errors))
        values.append(dict(zip(fit.names, fit.values.tolist(), strict=True)))
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

    Errors of a model in neighbouring cycles are correlated: the jackknife omits blocks of them in
    turn (H. R. Kuensch, Ann. Statist. 17 (1989) 1217). Rows that are not in use are not counted;
    None for fewer than two cycles.
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
    """Return the standard error of figures estimated without each of several parts in turn."""
    count = values.shape[0]
    return _few_parts_factor(count) * np.sqrt((count - 1) * np.var(values, axis=0))


def another_stretch(rms: float, error: float, stretches: Array) -> float:
    """Return the standard error of the rms of another stretch of cycles of the drive.

    The error of the rms is by the scatter between held-out cycles; `stretches` are the rms of
    held-out stretches. These differ by more than the scatter of their cycles, and the residual of
    an extrapolation is larger.
    """
    scatter = _few_parts_factor(stretches.size) * float(np.std(stretches, ddof=1))
    extrapolation = float(np.sqrt(np.mean(stretches**2))) - rms
    return float(np.sqrt(error**2 + scatter**2 + extrapolation**2))


def _few_parts_factor(count: int) -> float:
    """Factor by which twice an error of few parts covers 95 % of Student's distribution."""
    return float(stdtrit(count - 1, 0.975)) / 1.96


@dataclass(frozen=True, slots=True, kw_only=True)
class ParameterEstimate:
    """A parameter with its uncertainty."""

    name: str
    """Its name."""
    value: float
    """Its value."""
    standard_error: float
    """Its standard error, in the same unit; infinite if the record does not determine it."""


def estimates(
    fit: FitResult,
    data: FitData,
    residual: Residuals,
    folds: Sequence[Folds],
    chain: Mapping[str, float],
) -> tuple[tuple[ParameterEstimate, ...], ParameterEstimate, tuple[str, ...]]:
    """Return the parameters of a model and its offset with standard errors, and warnings.

    Residuals are correlated within a cycle and independent between cycles, so the covariance is
    that of a sum over cycles (the sandwich estimator of K.-Y. Liang, S. L. Zeger, Biometrika 73
    (1986) 13), and not that of independent samples, which is many times too small. It includes the
    uncertainty of offsets and chain, which are fitted along. If the model was fitted without each
    part of the cycles in turn, the jackknife over those parts is used where it is larger
    (R. G. Miller, Biometrika 61 (1974) 1). `folds` are the fits without parts of the cycles, for
    each division. `chain` is the standard error of each identified value of the chain, which the
    errors of the parameters include.
    """
    # the columns after these are no parameters of the model
    named = slice(0, len(fit.names))
    first = 0 if fit.jacobian is None else fit.jacobian.shape[1]
    J = _jacobian(fit, data, tuple(chain))
    # the common offset is the mean of the nuisance columns, which are the last ones
    mean = np.zeros(J.shape[1])
    mean[first + len(chain) :] = J[:, first + len(chain) :].mean(axis=0)
    e = residual.at(data.use)
    scale = np.sqrt(np.maximum(np.sum(J**2, axis=0), 1e-300))
    J = J / scale
    bread = np.linalg.pinv(J.T @ J, rcond=1e-13, hermitian=True)
    sums = _sums_by_cycle(J * e[:, None], data)
    count = sums.shape[0]
    covariance = bread @ (sums.T @ sums) @ bread * count / max(count - 1, 1)
    plain = bread * float(e @ e) / max(e.size - J.shape[1], 1)
    # with few cycles the sum over them is too small, so the larger of the two is used
    error = np.sqrt(np.maximum(np.diag(covariance), np.diag(plain)))[named] / scale[named]
    for division in folds:
        without = np.array([[values.get(n, 0.0) for n in fit.names] for values in division.values])
        error = np.maximum(error, jackknife(without))
    for c, width in enumerate(chain.values(), start=first):
        along = bread[named, c] / max(bread[c, c], 1e-300) * scale[c] / scale[named]
        error = np.hypot(error, along * width)
    mean /= scale
    variance = max(mean @ covariance @ mean, mean @ plain @ mean)
    offset = ParameterEstimate(
        name="offset",
        value=residual.offset,
        standard_error=float(np.sqrt(variance)) if data.zero == "one" else math.inf,
    )
    parameters = tuple(
        ParameterEstimate(name=n, value=float(v), standard_error=float(s))
        for n, v, s in zip(fit.names, fit.values, error, strict=True)
    )
    return parameters, offset, _warnings(parameters, plain[named, named])


def _warnings(parameters: tuple[ParameterEstimate, ...], covariance: Array) -> tuple[str, ...]:
    warnings = [
        f"the record does not determine {e.name}: {e.value:.3g} with a standard error of "
        f"{e.standard_error:.2g}"
        for e in parameters
        if "[" not in e.name and e.value != 0.0 and e.standard_error > _UNDETERMINED * abs(e.value)
    ]
    sigma = np.sqrt(np.maximum(np.diag(covariance), 1e-300))
    correlation = covariance / np.outer(sigma, sigma)
    for i in range(len(parameters)):
        for j in range(i):
            if "[" in parameters[i].name or "[" in parameters[j].name:
                continue
            if abs(correlation[i, j]) > _INSEPARABLE:
                warnings.append(
                    f"the record hardly separates {parameters[j].name} and {parameters[i].name} "
                    f"(correlation {correlation[i, j]:.3f})"
                )
    return tuple(warnings)


def _jacobian(fit: FitResult, data: FitData, searched: Sequence[str]) -> Array:
    sections = data.sections
    parts = [fit.jacobian] if fit.jacobian is not None else []
    quasi = [fit.model.simulate(s.u).values[:, None] for s in sections]
    for name in searched:
        value = getattr(data.chain, name)
        step = 1e-3 * value if value > 0.0 else {"delay": sections[0].dt}.get(name, 1e-3)
        ends = []
        for shifted in (value + step, max(value - step, 0.0)):
            chain = replace(data.chain, **{name: shifted})
            outputs = behind_chain(quasi, replace(data, chain=chain))
            ends.append(np.concatenate([c[u, 0] for c, u in zip(outputs, data.use, strict=True)]))
        width = value + step - max(value - step, 0.0)
        parts.append(((ends[0] - ends[1]) / width)[:, None])
    blocks = [s.nuisance[r.at[u]] for s, r, u in zip(sections, data.rows, data.use, strict=True)]
    return np.concatenate([*parts, np.asarray(block_diag(*blocks))], axis=1)


def _sums_by_cycle(scores: Array, data: FitData) -> Array:
    labels, offset = [], 0
    for r, u in zip(data.rows, data.use, strict=True):
        labels.append(r.cycle[u] + offset)
        offset += int(r.cycle.max()) + 1
    _, which = np.unique(np.concatenate(labels), return_inverse=True)
    sums = np.zeros((int(which.max()) + 1, scores.shape[1]))
    np.add.at(sums, which, scores)
    return sums
