"""How well a record determines each parameter."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import stdtrit

from flexstage.arrays import Array
from flexstage.hysteresis.identification.families.family import Data, Fit, behind_chain
from flexstage.hysteresis.identification.misfit import Folds, Misfit

#: A parameter whose standard error exceeds this share of it is not determined.
_UNDETERMINED = 0.5
#: Correlation above which two parameters cannot be told apart.
_INSEPARABLE = 0.98


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
    fit: Fit, data: Data, left: Misfit, folds: Sequence[Folds], chain: Mapping[str, float]
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
        error = np.maximum(error, _jackknife(without))
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


def _jackknife(values: Array) -> Array:
    many = values.shape[0]
    # few parts: the factor makes twice the error cover what the distribution of Student does
    few = float(stdtrit(many - 1, 0.975)) / 1.96
    return few * np.sqrt((many - 1) * np.var(values, axis=0))


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


def _jacobian(fit: Fit, data: Data, searched: Sequence[str]) -> Array:
    sections = data.measurement.sections
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


def _sums_by_cycle(scores: Array, data: Data) -> Array:
    labels, offset = [], 0
    for r, u in zip(data.rows, data.use, strict=True):
        labels.append(r.cycle[u] + offset)
        offset += int(r.cycle.max()) + 1
    _, which = np.unique(np.concatenate(labels), return_inverse=True)
    sums = np.zeros((int(which.max()) + 1, scores.shape[1]))
    np.add.at(sums, which, scores)
    return sums
