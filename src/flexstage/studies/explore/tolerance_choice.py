"""Search of the cheapest tolerances with a required yield."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from flexstage.base.arrays import Array
from flexstage.base.errors import ModelError
from flexstage.base.progress import listen, update
from flexstage.studies.explore.figures import Requirement
from flexstage.studies.explore.manufactured_samples import process_of
from flexstage.studies.explore.spread import Yield, yield_of
from flexstage.studies.explore.tolerance import (
    MonteCarloSamples,
    ToleranceChoice,
    ToleranceStudy,
    yields_of,
)
from flexstage.studies.explore.workers import Workers
from flexstage.virtual.imperfections import Scatter

#: Finest and coarsest considered scatter, relative to the initial one.
FINEST, COARSEST = 0.02, 3.0


def choose_tolerances(
    study: ToleranceStudy,
    target: float,
    *,
    weights: Mapping[str, float] | None = None,
    workers: Workers | None = None,
) -> ToleranceChoice:
    r"""Return the cheapest tolerances with a required yield.

    The cost of a tolerance is inversely proportional to its width, as in the reciprocal model of
    K. W. Chase and W. H. Greenwood, Manufacturing Review 1 (1988) 50: the total is
    :math:`\sum_k w_k\,\sigma_{k,0}/\sigma_k`, by default with equal weights. It is minimised
    subject to the yield of a normal model, :math:`\mathrm{var}\,y = \sum_k s_k V_k` with
    :math:`s_k = (\sigma_k/\sigma_{k,0})^2` and :math:`V_k` from samples in which only kind k
    scatters; this includes the largest of several necks. Samples of the solution, with the same
    random numbers, correct the model. The iteration ends when the lower end of the interval of the
    yield reaches the target and the cost no longer falls. If it finds no solution, the last scatter
    is reduced in proportion.

    Parameters
    ----------
    study : ToleranceStudy
        The analysis with the initial scatter, and the requirements.
    target : float
        Required yield [1].
    weights : Mapping, optional
        Weights of the costs of kinds; 1 by default.
    workers : Workers, optional
        Workers; by default this process.

    Returns
    -------
    ToleranceChoice
        The scatter with its cost and yield, for the number of samples of the study.

    Raises
    ------
    ModelError
        There is no requirement, the target is not between 0 and 1, or the samples are too few.

    Notes
    -----
    Validity: the cost is relative to that of the initial scatter. The search covers 0.02 to 3 times
    the initial scatter.
    """
    requirements = study.requirements
    if not requirements:
        raise ModelError("a yield needs a requirement: name one")
    if not 0.0 < target < 1.0:
        raise ModelError(f"the target yield must lie between 0 and 100 %, got {100 * target:g} %")
    if yield_of(np.ones(study.samples, dtype=bool)).low < target:
        least = math.ceil(math.log(0.025) / math.log(target))
        raise ModelError(
            f"{study.samples} samples cannot confirm a yield of {100 * target:g} %, even if all "
            f"are good: use {least} or more"
        )
    if not study.monte_carlo.kinds:
        raise ModelError("no deviation has a scatter, so there is no tolerance to choose")
    _require_weights(weights or {}, study.monte_carlo.kinds)
    return _select(_new_search(study, target, weights or {}, workers or Workers(1)))


def _require_weights(weights: Mapping[str, float], kinds: Sequence[str]) -> None:
    for kind, weight in weights.items():
        if kind not in kinds:
            raise ModelError(f"the cost of {kind} has no effect, as it has no scatter")
        if not 0.0 < weight < math.inf:
            raise ModelError(f"the cost of {kind} must be positive, got {weight!r}")


def scaled(scatter: Scatter, factors: Mapping[str, float]) -> Scatter:
    """Return a scatter with factors on some of its fields."""
    return replace(scatter, **{name: f * getattr(scatter, name) for name, f in factors.items()})


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Trial:
    """A scatter with the yields of its samples, and the normal model of its figures."""

    factors: Array
    """Ratio to the initial scatter, shape (kinds,)."""
    scatter: Scatter
    yields: tuple[Yield, ...]
    mean: Array
    """Means of the required figures, shape (requirements,)."""
    shifts: Array
    """Shifts of the means by each kind alone, shape (requirements, kinds)."""
    variances: Array
    """Contributions of the kinds to the variances, shape (requirements, kinds)."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Search:
    """Problem of the search of tolerances."""

    study: ToleranceStudy
    target: float
    """Required yield [1]."""
    aim: float
    """Probit of the share of samples that confirms this yield."""
    workers: Workers
    kinds: tuple[str, ...]
    """Varied fields of the scatter."""
    weights: Array
    """Weights of their costs, shape (kinds,)."""
    requirements: tuple[Requirement, ...]
    columns: list[int]
    """Columns of the required figures."""
    nominal: Array
    """Required figures of the nominal stage, shape (requirements,)."""

    def is_good(self, trial: _Trial) -> bool:
        """Return whether the yield of a scatter is confirmed."""
        return trial.yields[-1].low >= self.target

    def cost(self, trial: _Trial) -> float:
        """Return the cost of a scatter relative to the initial one."""
        return float((self.weights / trial.factors).sum() / self.weights.sum())


def _new_search(
    study: ToleranceStudy, target: float, weights: Mapping[str, float], workers: Workers
) -> _Search:
    samples = study.monte_carlo
    columns = [samples.figures.index(r.figure) for r in study.requirements]
    return _Search(
        study=study,
        target=target,
        aim=_probit(_required_share(study.samples, target)),
        workers=workers,
        kinds=samples.kinds,
        weights=np.array([weights.get(kind, 1.0) for kind in samples.kinds]),
        requirements=study.requirements,
        columns=columns,
        nominal=samples.nominal()[columns],
    )


def _select(search: _Search) -> ToleranceChoice:
    """Return the cheapest confirmed scatter."""
    study, kinds = search.study, search.kinds
    with listen(_no_progress):
        initial = _trial(search, np.ones(len(kinds)), study.monte_carlo, study.values)
    violations = [
        f"{r.text} (it has {r.figure.text(value)})"
        for r, value in zip(search.requirements, search.nominal, strict=True)
        if not r.met(value)
    ]
    if violations:
        return _choice(
            search,
            initial,
            initial,
            f"no tolerance reaches {_percent(search.target)}: the nominal stage does not meet "
            f"{' and '.join(violations)}; change the stage",
        )
    best: _Trial | None = initial if search.is_good(initial) else None
    last, converged = initial, False
    for number in range(10):
        update("tolerances for the target yield", number / 10)
        trial = _sampled(search, _cheapest(search, last))
        # the model is exact at the last scatter only: the next one may be too fine or too coarse
        if search.is_good(trial):
            gain = 1.0 if best is None else 1.0 - search.cost(trial) / search.cost(best)
            best = trial if gain > 0.0 else best
            if converged := gain < 0.01:  # a further iteration would gain little
                break
        last = trial
    if best is None:
        best = _coarsest_in_proportion(search, last)
    if best is None:
        best = _sampled(search, np.full(len(kinds), FINEST))
        if not search.is_good(best):
            worst = min(best.yields[:-1], key=lambda y: y.share)
            assert worst.requirement is not None
            return _choice(
                search,
                initial,
                best,
                f"no tolerance down to {FINEST:g} of the initial one reaches "
                f"{_percent(search.target)}: with the finest ones "
                f"{_percent(best.yields[-1].share)} are good, and {_percent(worst.share)} meet "
                f"{worst.requirement.text}; change the stage",
            )
    total = best.yields[-1]
    return _choice(
        search,
        initial,
        best,
        f"{_percent(total.share)} of {total.count} simulated stages are good; the yield is at "
        f"least {_percent(total.low)} (97.5 % confidence) at {search.cost(best):.3g} times the cost"
        + ("" if converged else "; the search did not converge, so that cheaper ones may exist"),
    )


def _coarsest_in_proportion(search: _Search, trial: _Trial) -> _Trial | None:
    """Return the coarsest good scatter in proportion to one that misses the target, if any."""
    best, low, high = None, math.log(FINEST / float(trial.factors.max())), 0.0
    for _ in range(6):  # bisections between a good scatter and one that is not
        middle = 0.5 * (low + high)
        scaled_trial = _sampled(search, np.maximum(trial.factors * math.exp(middle), FINEST))
        if search.is_good(scaled_trial):
            best, low = scaled_trial, middle
        else:
            high = middle
    return best


def _sampled(search: _Search, factors: Array) -> _Trial:
    """Simulate the samples of a scatter."""
    study = search.study
    named = dict(zip(search.kinds, factors.tolist(), strict=True))
    process = process_of(
        study.stage, scaled(study.scatter, named), study.monte_carlo.process.environment
    )
    samples = replace(study.monte_carlo, process=process)
    with listen(_no_progress):  # progress of the batches is not that of the search
        values = samples.values(study.samples, search.workers)[0]
        return _trial(search, factors, samples, values)


def _trial(search: _Search, factors: Array, samples: MonteCarloSamples, values: Array) -> _Trial:
    """Return a scatter with its normal model, from samples and from those of each kind alone."""
    required = values[:, search.columns]
    count = min(len(values), 2000)
    shifts, variances = [], []
    for kind in search.kinds:
        # each kind alone, as a linear model does not include the largest of several necks
        others = dict.fromkeys(set(search.kinds) - {kind}, 0.0)
        process = replace(samples.process, scatter=scaled(samples.process.scatter, others))
        single = replace(samples, process=process)
        single_values = single.values(count, search.workers)[0][:, search.columns]
        shifts.append(np.nanmean(single_values, axis=0) - search.nominal)
        variances.append(np.nanvar(single_values, axis=0))
    contributions = np.array(variances).T
    # joint effects are distributed in proportion
    total = np.nanvar(required, axis=0)
    contributions *= (total / np.maximum(contributions.sum(axis=1), 1e-300))[:, None]
    return _Trial(
        factors=factors,
        scatter=samples.process.scatter,
        yields=yields_of(samples.figures, search.requirements, values),
        mean=np.nanmean(required, axis=0),
        shifts=np.array(shifts).T,
        variances=contributions,
    )


def _cheapest(search: _Search, trial: _Trial) -> Array:
    """Minimise the cost with the normal model about a scatter, corrected by its yield."""
    from scipy.optimize import minimize

    yields = trial.yields[-1]
    # no, or all, good samples are taken as half a sample
    share = min(max(yields.met, 0.5), yields.count - 0.5) / yields.count
    correction = _probit(share) - _yield_probit(search, trial, np.zeros(len(search.kinds)))

    def margin(x: Array) -> float:
        return _yield_probit(search, trial, x) + correction - search.aim

    low = np.log(FINEST / trial.factors)
    high = np.log(COARSEST / trial.factors)
    # a limited step: the normal model is valid near the sampled scatter
    low, high = np.maximum(low, math.log(0.2)), np.minimum(high, math.log(2.5))
    start = np.clip(np.full(len(search.kinds), -0.3 if margin(0.0 * low) < 0.0 else 0.0), low, high)
    weights = search.weights / trial.factors
    solution: Any = minimize(
        lambda x: float((weights * np.exp(-x)).sum() / weights.sum()),
        start,
        jac=lambda x: -weights * np.exp(-x) / weights.sum(),
        bounds=list(zip(low, high, strict=True)),
        constraints=[{"type": "ineq", "fun": margin}],
        method="SLSQP",
        options={"maxiter": 200, "ftol": 1e-8},
    )
    x = np.clip(solution.x, low, high)
    if margin(x) < -1e-3:  # no scatter within the step suffices: the finest one
        effective = trial.variances.sum(axis=0) > 0.0
        x = np.where(effective, low, x)
    return trial.factors * np.exp(x)


def _yield_probit(search: _Search, trial: _Trial, x: Array) -> float:
    """Return the probit of the yield by the normal model, with independent requirements.

    x is the logarithm of the ratio to the scatter of the trial.
    """
    from scipy.special import log_ndtr, ndtr

    variance = trial.variances @ np.exp(2.0 * x)
    # the shift of a mean, as by the largest of several necks, is proportional to the scatter; that
    # of joint effects is constant
    mean = trial.mean + trial.shifts @ np.expm1(x)
    deviation = np.sqrt(np.maximum(variance, 1e-300))
    total = 0.0
    for r, m, s in zip(search.requirements, mean, deviation, strict=True):
        above = math.inf if r.high is None else (r.high - m) / s
        below = math.inf if r.low is None else (m - r.low) / s
        inside = float(ndtr(above) - ndtr(-below))
        total += math.log(inside) if inside > 1e-12 else float(log_ndtr(min(above, below)))
    return _probit_log(total)


def _choice(search: _Search, initial: _Trial, selected: _Trial, conclusion: str) -> ToleranceChoice:
    return ToleranceChoice(
        target=search.target,
        reached=search.is_good(selected),
        initial=initial.scatter,
        selected=selected.scatter,
        kinds=search.kinds,
        cost=search.cost(selected),
        before=initial.yields,
        after=selected.yields,
        conclusion=conclusion,
    )


def _no_progress(what: str, done: float) -> None:
    """Ignore the progress of inner computations."""


def _required_share(samples: int, target: float) -> float:
    """Return the share of good samples for which the interval of the yield begins at the target."""
    from scipy.special import betaincinv

    low, high = math.ceil(target * samples), samples
    while low < high:
        k = (low + high) // 2
        enough = k == samples or betaincinv(k, samples - k + 1, 0.025) >= target
        low, high = (low, k) if enough else (k + 1, high)
    return min(low, samples - 0.5) / samples


def _probit(share: float) -> float:
    from scipy.special import ndtri

    return float(ndtri(share))


def _probit_log(logarithm: float) -> float:
    """Return the probit of a probability near 0 or 1 from its logarithm."""
    from scipy.special import ndtri, ndtri_exp

    if logarithm > -1e-3:
        return -float(ndtri(max(-math.expm1(logarithm), 1e-300)))
    return float(ndtri_exp(logarithm))


def _percent(share: float) -> str:
    return f"{100.0 * share:.4g} %"
