"""Residuals of a model, its errors on held-out stretches, and those of its parameters."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray
from scipy.special import stdtrit

from flexstage.base.arrays import Array
from flexstage.base.errors import ModelError
from flexstage.hysteresis.identification.model_fit import (
    FitData,
    FitResult,
    ModelFit,
    errors_of,
    fitted_levels,
    folds_of,
)
from flexstage.hysteresis.model import HysteresisModel


@dataclass(frozen=True, slots=True)
class _HeldOutRules:
    """Stretches that are held out in turn, and what they tell about another one."""

    stretches: int = 5
    """Stretches of one record: few, so that each is long and time is extrapolated to it."""
    records: int = 10
    """Largest number of groups of records, if there are several: each is fitted once more."""
    fewest: int = 4
    """Fewest stretches with an interval: three determine a scatter to a factor of five."""
    between: float = 0.4
    """Rms logarithm of the ratio of the error of a stretch to that held out in the record before
    it, over 67 measured stretches; records of equal loops do not show it by their scatter
    (`tests/literature/test_heldout_stretches.py`).
    """
    widest: float = 4.0
    """Largest factor from the error to an end of its interval: a wider one tells nothing."""
    within: float = 0.975
    """Share of the errors of the worst stretch inside the band; the other half of the 5 % outside
    is for a stretch that is worse than all of these.
    """
    undetermined: float = 0.5
    """Smallest standard error of an undetermined parameter, as a share of it."""


_RULES = _HeldOutRules()


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Residuals:
    """Residuals of a model at the rows of each section."""

    of_prediction: tuple[Array, ...]
    """Output less model and baseline, shape (r,)."""
    baseline: tuple[Array, ...]
    """The common offset at every sample of each section, or the section's own nuisance columns if
    each record has its zero, shape (n,).
    """
    offset: float
    """The common offset: mean of the fitted nuisance columns over the rows in use."""

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
    errors = errors_of(model, data)
    levels = fitted_levels(errors, data)
    every = [level[r.at[u]] for level, r, u in zip(levels, data.rows, data.use, strict=True)]
    offset = float(np.mean(np.concatenate(every)))
    baseline = [np.full(s.u.size, offset) for s in data.sections] if data.zero == "one" else levels
    of_prediction = tuple(
        e - level[r.at] for e, level, r in zip(errors, baseline, data.rows, strict=True)
    )
    return Residuals(of_prediction=of_prediction, baseline=tuple(baseline), offset=offset)


def free_constant(errors: Sequence[Array]) -> Array:
    """Return errors less the mean of each part: the residuals with a refitted constant."""
    return np.concatenate([e - np.mean(e) for e in errors])


def root_mean_square(values: Array) -> float:
    """Return the root of the mean of the squares."""
    return float(np.sqrt(np.mean(values**2)))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class HeldOut:
    """Errors on stretches that a model was not fitted to, as predicted, over the stroke [%]."""

    #: Figures of the report.
    names: ClassVar[tuple[str, ...]] = (
        "rms_percent", "free_rms_percent", "interval_percent", "median_percent", "worst_percent",
        "band_percent", "max_percent",
    )  # fmt: skip

    rms_percent: float
    """Root mean square over all stretches."""
    free_rms_percent: float
    """The same, with a separate constant for each stretch, or each record held out on request."""
    interval_percent: tuple[float, float] | None
    """Interval that contains the rms error of another stretch with a probability of 95 %; None if
    these stretches do not determine it.
    """
    stretches_percent: Array
    """Root mean square of each stretch, shape (n,)."""
    band_percent: float
    """Half the width of the band that holds 95 % of the errors on another stretch."""
    max_percent: float
    """Largest absolute error."""
    values: tuple[Mapping[str, float], ...] = ()
    """Parameters and offset by name, fitted without each stretch."""

    @property
    def median_percent(self) -> float:
        """Median of the stretches."""
        return float(np.median(self.stretches_percent))

    @property
    def worst_percent(self) -> float:
        """Largest of the stretches."""
        return float(np.max(self.stretches_percent))


def stretches_of(data: FitData) -> list[tuple[NDArray[np.bool_], ...]]:
    """Divide the rows in use into records or, of a single one, into stretches of its cycles."""
    used = [k for k, use in enumerate(data.use) if use.any()]
    if len(used) < 2:
        # an end of the range that is held out of the only period shows nothing of another period
        runs = 2 if data.periodic else 1
        return folds_of(data, _RULES.stretches, runs=runs)
    groups = np.array_split(used, min(len(used), _RULES.records))
    return [tuple(use & (k in group) for k, use in enumerate(data.use)) for group in groups]


def cross_validate(method: ModelFit, data: FitData, optimum: Array) -> HeldOut | None:
    """Fit to all stretches but one, and compare with that one, for each in turn.

    The search begins at the optimum of all rows in use. Whole stretches are held out, so that time
    is extrapolated, and amplitude and rate where they differ, as for another record. None for fewer
    than two stretches.
    """
    stretches = stretches_of(data)
    if len(stretches) < 2:
        return None
    errors, values = [], []
    for stretch in stretches:
        part = data.with_use(tuple(u & ~h for u, h in zip(data.use, stretch, strict=True)))
        model = method.refit(part, optimum).model
        left = residuals(model, part)
        errors.append(left.predicted_at(stretch))
        values.append(_values(model, left))
    return replace(held_out_errors(errors, data), values=tuple(values))


def held_out_errors(
    errors: Sequence[Sequence[Array]], data: FitData, parts: Sequence[Array] = ()
) -> HeldOut:
    """Return the figures of the errors of stretches, each in parts of one record.

    The free constants are those of other parts if these are given.
    """
    percent, is_only_period = 100.0 / data.stroke, data.periodic and len(data.sections) == 1
    stretches = [percent * np.concatenate(of_records) for of_records in errors]
    every = np.concatenate(stretches)
    each = np.array([root_mean_square(e) for e in stretches])
    rms = root_mean_square(every)
    free = free_constant(parts or [e for of_records in errors for e in of_records])
    return HeldOut(
        rms_percent=rms,
        free_rms_percent=percent * root_mean_square(free),
        interval_percent=None if is_only_period else _interval(rms, each),
        stretches_percent=each,
        band_percent=max(float(np.quantile(np.abs(e), _RULES.within)) for e in stretches),
        max_percent=float(np.max(np.abs(every))),
    )


def _interval(rms: float, stretches: Array) -> tuple[float, float] | None:
    """95 % interval of another stretch: Student's t of the logarithms, and their known scatter."""
    count = stretches.size
    if count < _RULES.fewest:
        return None
    scatter = float(np.std(np.log(np.maximum(stretches, 1e-300)), ddof=1))
    by_chance = float(stdtrit(count - 1, 0.975)) * scatter * math.sqrt(1.0 + 1.0 / count)
    width = math.hypot(by_chance, 1.96 * _RULES.between)
    if width > math.log(_RULES.widest):
        return None
    return rms * math.exp(-width), rms * math.exp(width)


def jackknife(values: Array) -> Array:
    """Return the standard error of figures estimated without each of several parts in turn.

    Residuals are errors of the model, correlated within a cycle and between neighbours, so that
    parts are omitted and not samples (R. G. Miller, Biometrika 61 (1974) 1). Twice the error
    covers 95 % of Student's distribution.
    """
    count = values.shape[0]
    few = float(stdtrit(count - 1, 0.975)) / 1.96
    return few * np.sqrt((count - 1) * np.var(values, axis=0))


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
    method: ModelFit,
    fit: FitResult,
    data: FitData,
    left: Residuals,
    validation: HeldOut | None,
    chain: Mapping[str, float],
) -> tuple[tuple[ParameterEstimate, ...], ParameterEstimate, tuple[str, ...]]:
    """Return the parameters of a model and its offset with standard errors, and warnings.

    The errors are those of the jackknife over the held-out stretches. `chain` is the standard
    error of each identified value of the chain: the model is fitted again behind a chain that is
    changed by it. Without a validation no parameter has an error; numbers that no fit changes are
    no parameters.
    """
    values = _values(fit.model, left)
    now = np.array(list(values.values()))
    error = np.full(now.size, np.inf)
    if validation is not None:
        without = np.array([[v[name] for name in values] for v in validation.values])
        error = np.where(np.all(without == now, axis=0), 0.0, jackknife(without))
        for name, width in chain.items():
            if width == 0.0:
                continue
            shifted = replace(data.chain, **{name: getattr(data.chain, name) + width})
            # columns belong to a chain, the choices of a fit do not
            memo = {k: m for k, m in data.memo.items() if k.endswith((" start", " smoothing"))}
            other = replace(data, chain=shifted, memo=memo)
            try:
                model = method.fit(other, fit.search).model
            except ModelError:  # behind such a chain there is no model of this kind
                error = np.full(now.size, np.inf)
                break
            changed = np.array(list(_values(model, residuals(model, other)).values()))
            error = np.hypot(error, changed - now)
    *parameters, offset = (
        ParameterEstimate(name=n, value=float(v), standard_error=float(e))
        for n, v, e in zip(values, now, error, strict=True)
    )
    if data.zero != "one":
        offset = replace(offset, standard_error=math.inf)
    named = tuple(e for e in parameters if 0.0 < e.standard_error < math.inf)
    warnings = tuple(
        f"the record does not determine {e.name}: {e.value:.3g} with a standard error of "
        f"{e.standard_error:.2g}"
        for e in named
        if "[" not in e.name and e.standard_error > _RULES.undetermined * abs(e.value) > 0.0
    )
    return named, offset, warnings


def _values(model: HysteresisModel, left: Residuals) -> dict[str, float]:
    """Return the numbers of a model by name, those of an array by index, and the offset."""
    values: dict[str, float] = {}
    for name, value in model.parameters().items():
        array = np.asarray(value, dtype=np.float64)
        for index in np.ndindex(array.shape):
            label = f"{name}[{','.join(map(str, index))}]" if index else name
            values[label] = float(array[index])
    return {**values, "offset": left.offset}
