"""The cheapest tolerances that reach a yield."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from flexstage.base.arrays import Array
from flexstage.base.errors import ModelError
from flexstage.base.progress import listen, update
from flexstage.studies.explore.manufactured_samples import process_of
from flexstage.studies.explore.spread import Yield, yield_of
from flexstage.studies.explore.tolerance import Lot, ToleranceChoice, ToleranceStudy, yields_of
from flexstage.studies.explore.workers import Workers
from flexstage.virtual.imperfections import Scatter

#: Finest and coarsest scatter that is thought of, as parts of the given one.
FINEST, COARSEST = 0.02, 3.0


def choose_tolerances(
    study: ToleranceStudy,
    target: float,
    *,
    weights: Mapping[str, float] | None = None,
    workers: Workers | None = None,
) -> ToleranceChoice:
    r"""Find the cheapest tolerances that reach a yield.

    A tolerance costs in inverse proportion to its width, as in the reciprocal model of K. W. Chase
    and W. H. Greenwood, Manufacturing Review 1 (1988) 50: the cost is
    :math:`\sum_k w_k\,\sigma_{k,usual}/\sigma_k`, the kinds of deviations alike where no weights
    are given. It is minimised subject to the yield of
    a normal model, :math:`\mathrm{var}\,y = \sum_k s_k V_k` with
    :math:`s_k = (\sigma_k/\sigma_{k,usual})^2` and :math:`V_k` from lots in which the kind
    scatters alone, which holds for the largest of several necks too. What comes out is drawn with
    the same random numbers; its yield corrects the model, and so on, until the lower end of its
    interval reaches the target and the cost no longer falls. Where that finds nothing, the last
    scatter is made finer in proportion until it is good.

    Parameters
    ----------
    study : ToleranceStudy
        The lot with the usual scatter, and what is required.
    target : float
        Share of good stages [1].
    weights : Mapping, optional
        Weight of the cost of a kind; 1 where not given.
    workers : Workers, optional
        Who computes; this process where not given.

    Returns
    -------
    ToleranceChoice
        The scatter, its cost, and its yield from as many samples as the study has.

    Raises
    ------
    ModelError
        Nothing is required, the target is no share, or so few samples cannot show it.

    Notes
    -----
    Validity: a cost in parts of the usual one, not money. From 0.02 to 3 times the usual scatter is
    thought of.
    """
    requirements = study.requirements
    if not requirements:
        raise ModelError("a yield is that of a requirement: name one")
    if not 0.0 < target < 1.0:
        raise ModelError(f"a yield to reach must lie between 0 and 100 %, got {100 * target:g} %")
    if yield_of(np.ones(study.samples, dtype=bool)).low < target:
        least = math.ceil(math.log(0.025) / math.log(target))
        raise ModelError(
            f"{study.samples} samples cannot show a yield of {100 * target:g} %, even where all "
            f"are good: take {least} or more"
        )
    if not study.lot.kinds:
        raise ModelError("nothing scatters, so there is no tolerance to choose")
    _known(weights or {}, study.lot.kinds)
    return _Search(study, target, weights or {}, workers or Workers(1)).choose()


def _known(weights: Mapping[str, float], kinds: Sequence[str]) -> None:
    for kind, weight in weights.items():
        if kind not in kinds:
            raise ModelError(f"a cost is given for {kind}, which does not scatter")
        if not 0.0 < weight < math.inf:
            raise ModelError(f"the cost of {kind} must be positive, got {weight!r}")


def scaled(scatter: Scatter, factors: Mapping[str, float]) -> Scatter:
    """Return a scatter with some of its fields multiplied."""
    return replace(scatter, **{name: f * getattr(scatter, name) for name, f in factors.items()})


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Drawn:
    """A scatter that was drawn, and the normal model of its figures."""

    factors: Array
    scatter: Scatter
    yields: tuple[Yield, ...]
    mean: Array
    """Means of the required figures, shape (requirements,)."""
    shifts: Array
    """What each kind by itself takes them off by, shape (requirements, kinds)."""
    parts: Array
    """What each kind gives to their variances, shape (requirements, kinds)."""


class _Search:
    """The loop between the normal model and drawn lots."""

    def __init__(
        self,
        study: ToleranceStudy,
        target: float,
        weights: Mapping[str, float],
        workers: Workers,
    ) -> None:
        self.study, self.target, self.workers = study, target, workers
        self.kinds = study.lot.kinds
        self.weights = np.array([weights.get(kind, 1.0) for kind in self.kinds])
        self.required = study.requirements
        self.column = [study.lot.figures.index(r.figure) for r in self.required]
        nominal = study.lot.nominal()
        self.nominal = nominal[self.column]
        self.needed = _needed(study.samples, target)

    def choose(self) -> ToleranceChoice:
        """Return the cheapest scatter that was confirmed."""
        outside = [
            r for r, value in zip(self.required, self.nominal, strict=True) if not r.met(value)
        ]
        with listen(_silent):
            usual = self._modelled(np.ones(len(self.kinds)), self.study.lot, self.study.values)
        if outside:
            told = " and ".join(
                f"{r.text} (it has {r.figure.text(self.nominal[self.required.index(r)])})"
                for r in outside
            )
            return self._result(
                usual,
                usual,
                f"no tolerance reaches {_percent(self.target)}: the stage as drawn does not meet "
                f"{told}; change the stage",
            )
        best: _Drawn | None = usual if self._good(usual) else None
        last, aim = usual, _probit(self.needed)
        settled = False
        for round_ in range(10):
            update("tolerances that reach the yield", round_ / 10)
            factors = self._cheapest(last, aim)
            drawn = self._draw(factors)
            # the model is right at the last drawn scatter; beyond it goes a little too far or short
            if self._good(drawn):
                gain = 1.0 if best is None else 1.0 - self._cost(drawn) / self._cost(best)
                best = drawn if gain > 0.0 else best
                if settled := gain < 0.01:  # not worth another round
                    break
            last = drawn
        if best is None:
            best = self._nearest(last)
        if best is None:
            finest = self._draw(np.full(len(self.kinds), FINEST))
            if not self._good(finest):
                worst = min(finest.yields[:-1], key=lambda y: y.share)
                assert worst.requirement is not None
                return self._result(
                    usual,
                    finest,
                    f"no tolerance from {FINEST:g} of the usual one on reaches "
                    f"{_percent(self.target)}: with all of them so fine "
                    f"{_percent(finest.yields[-1].share)} are good, and {worst.requirement.text} "
                    f"is met by {_percent(worst.share)}; change the stage",
                )
            best = finest
        whole = best.yields[-1]
        return self._result(
            usual,
            best,
            f"{_percent(whole.share)} of {whole.count} drawn stages are good, and so at least "
            f"{_percent(whole.low)} of all (97.5 % sure), at {self._cost(best):.3g} times the cost"
            + ("" if settled else "; the search did not settle, so that cheaper ones may exist"),
        )

    def _nearest(self, missed: _Drawn) -> _Drawn | None:
        """Return the widest scatter in proportion to one that misses the target, or None."""
        found, low, high = None, math.log(FINEST / float(missed.factors.max())), 0.0
        for _ in range(6):  # halvings of the step between a good scatter and one that is not
            middle = 0.5 * (low + high)
            drawn = self._draw(np.maximum(missed.factors * math.exp(middle), FINEST))
            if self._good(drawn):
                found, low = drawn, middle
            else:
                high = middle
        return found

    def _good(self, drawn: _Drawn) -> bool:
        return drawn.yields[-1].low >= self.target

    def _cost(self, drawn: _Drawn) -> float:
        return float((self.weights / drawn.factors).sum() / self.weights.sum())

    def _draw(self, factors: Array) -> _Drawn:
        scatter = self._scatter(factors)
        lot = replace(self.study.lot, process=process_of(self.study.stage, scatter))
        with listen(_silent):  # the batches of a round are not those of the search
            return self._modelled(factors, lot, lot.values(self.study.samples, self.workers)[0])

    def _scatter(self, factors: Array) -> Scatter:
        named = dict(zip(self.kinds, factors.tolist(), strict=True))
        return scaled(self.study.scatter, named)

    def _modelled(self, factors: Array, lot: Lot, values: Array) -> _Drawn:
        taken = values[:, self.column]
        count = min(len(values), 2000)
        shift, variance = [], []
        for kind in self.kinds:
            # by itself, as a straight line does not see what is the largest of several necks
            rest = dict.fromkeys(set(self.kinds) - {kind}, 0.0)
            alone = replace(
                lot, process=replace(lot.process, scatter=scaled(lot.process.scatter, rest))
            )
            found = alone.values(count, self.workers)[0][:, self.column]
            shift.append(np.nanmean(found, axis=0) - self.nominal)
            variance.append(np.nanvar(found, axis=0))
        total = np.nanvar(taken, axis=0)
        part = np.array(variance).T
        # what kinds do jointly goes with each of them
        part *= (total / np.maximum(part.sum(axis=1), 1e-300))[:, None]
        return _Drawn(
            factors=factors,
            scatter=lot.process.scatter,
            yields=yields_of(lot.figures, self.required, values),
            mean=np.nanmean(taken, axis=0),
            shifts=np.array(shift).T,
            parts=part,
        )

    def _cheapest(self, at: _Drawn, aim: float) -> Array:
        """Minimise the cost in the model about a drawn scatter, made right there by its yield."""
        from scipy.optimize import minimize

        passed = at.yields[-1]
        # none and all good say little: half a sample stands for what was not seen
        seen = min(max(passed.met, 0.5), passed.count - 0.5) / passed.count
        short = _probit(seen) - self._probit_of(at, np.zeros(len(self.kinds)))

        def lacking(x: Array) -> float:
            return self._probit_of(at, x) + short - aim

        low = np.log(FINEST / at.factors)
        high = np.log(COARSEST / at.factors)
        # a step at a time: the normal model holds near what was drawn
        low, high = np.maximum(low, math.log(0.2)), np.minimum(high, math.log(2.5))
        start = np.clip(
            np.full(len(self.kinds), -0.3 if lacking(0.0 * low) < 0.0 else 0.0), low, high
        )
        weights = self.weights / at.factors
        found: Any = minimize(
            lambda x: float((weights * np.exp(-x)).sum() / weights.sum()),
            start,
            jac=lambda x: -weights * np.exp(-x) / weights.sum(),
            bounds=list(zip(low, high, strict=True)),
            constraints=[{"type": "ineq", "fun": lacking}],
            method="SLSQP",
            options={"maxiter": 200, "ftol": 1e-8},
        )
        x = np.clip(found.x, low, high)
        if lacking(x) < -1e-3:  # nothing within a step is good enough: the finest of it
            useful = at.parts.sum(axis=0) > 0.0
            x = np.where(useful, low, x)
        return at.factors * np.exp(x)

    def _probit_of(self, at: _Drawn, x: Array) -> float:
        """Probit of the yield of the normal model, requirements taken as independent."""
        from scipy.special import log_ndtr, ndtr

        after = at.parts @ np.exp(2.0 * x)
        # what the mean is off by comes from the scatter as well: of the largest of several necks
        # it goes with the scatter, and what the kinds do jointly is left as it is
        mean = at.mean + at.shifts @ np.expm1(x)
        deviation = np.sqrt(np.maximum(after, 1e-300))
        total = 0.0
        for r, m, s in zip(self.required, mean, deviation, strict=True):
            above = math.inf if r.high is None else (r.high - m) / s
            below = math.inf if r.low is None else (m - r.low) / s
            inside = float(ndtr(above) - ndtr(-below))
            total += math.log(inside) if inside > 1e-12 else float(log_ndtr(min(above, below)))
        return _probit_log(total)

    def _result(self, usual: _Drawn, chosen: _Drawn, verdict: str) -> ToleranceChoice:
        return ToleranceChoice(
            target=self.target,
            reached=self._good(chosen),
            usual=usual.scatter,
            chosen=chosen.scatter,
            kinds=self.kinds,
            cost=self._cost(chosen),
            before=usual.yields,
            after=chosen.yields,
            verdict=verdict,
        )


def _silent(what: str, done: float) -> None:
    """Hear what the work in a round says of itself, and pass it on to nobody."""


def _needed(samples: int, target: float) -> float:
    """Return the share of samples that must be good for the interval to begin at the target."""
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
    """Probit of a probability by its logarithm, also where it is nearly one or nearly nothing."""
    from scipy.special import ndtri, ndtri_exp

    if logarithm > -1e-3:
        return -float(ndtri(max(-math.expm1(logarithm), 1e-300)))
    return float(ndtri_exp(logarithm))


def _percent(share: float) -> str:
    return f"{100.0 * share:.4g} %"
