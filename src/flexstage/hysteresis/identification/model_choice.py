"""Which of the fitted models is kept."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from flexstage.hysteresis.identification.misfit import (
    BAND,
    Folds,
    Misfit,
    cross_validate,
    free_constant,
    misfit,
    rms_standard_error,
    root_mean_square,
)
from flexstage.hysteresis.identification.model_fit import FitData, FitResult, ModelFit

#: A model that leaves more than this many times what the best one leaves is not as good, ...
_SAME = 1.1
#: ... and of those that leave less than this nothing is better [% of the stroke].
_NOTHING = 1e-5
#: A model that leaves more than this of what was held out predicts nothing [% of the stroke].
_NO_PREDICTION = 100.0
_DIVERGES = "it diverges: on what was held out it is further off than the whole stroke"


@dataclass(frozen=True, slots=True, kw_only=True)
class Candidate:
    """One of the models that were tried."""

    kind: str
    """Name of the model."""
    size: int
    """Number of its parameters."""
    rms_percent: float | None
    """Root mean square error where it was fitted, as the model predicts, over the stroke [%]; None
    where it could not be fitted.
    """
    heldout_rms_percent: float | None
    """The same on cycles that it was not fitted to [%]."""
    heldout_free_rms_percent: float | None = None
    """The same, where the constant is fitted again to what was held out [%]."""
    failed: str = ""
    """Why it cannot serve; empty where it can."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FittedModel:
    """A method with its fit, and what it leaves."""

    method: ModelFit
    """How it is fitted."""
    fit: FitResult
    """The fit."""
    left: Misfit
    """What it leaves of all rows."""
    folds: Folds | None
    """What fits without parts of the cycles leave of those; None where none was made."""


def passed_over(
    tried: Mapping[str, FittedModel], candidates: Sequence[Candidate]
) -> tuple[str, ...]:
    """Say which models predict better than the chosen one, but have no inverse."""
    score = {c.kind: c.heldout_rms_percent for c in candidates}
    chosen = score[candidates[0].kind]
    if chosen is None or not _invertible(tried[candidates[0].kind]):
        return ()
    better = [
        kind
        for kind, own in score.items()
        if own is not None and own < chosen / _SAME and not _invertible(tried[kind])
    ]
    if not better:
        return ()
    return (
        f"{', '.join(better)} would predict better, and cannot be inverted: where no command is to "
        "be made from the model, name one by --model",
    )


def failed_candidate(method: ModelFit, why: str) -> Candidate:
    """Describe a model that could not be fitted."""
    return Candidate(
        kind=method.kind, size=method.size, rms_percent=None, heldout_rms_percent=None, failed=why
    )


def fit_model(method: ModelFit, data: FitData, *, validate: bool) -> FittedModel:
    """Fit a model; where asked, also to all cycles but some, in turn."""
    fit = method.fit(data)
    folds = cross_validate(method, data, fit.search) if validate else None
    return FittedModel(method=method, fit=fit, left=misfit(fit.model, data), folds=folds)


@dataclass(frozen=True, slots=True, kw_only=True)
class PredictionErrors:
    """Errors of the prediction over the stroke [%]; None where nothing was held out."""

    rms: float
    """Root mean square where it was fitted."""
    largest: float
    """Largest absolute value there."""
    held: float | None = None
    """Root mean square where it was not."""
    held_free: float | None = None
    """The same, the constant fitted again."""
    held_error: float | None = None
    """Standard error of that root mean square."""
    held_largest: float | None = None
    """Largest absolute value there."""
    held_band: float | None = None
    """Half the width of the band that holds 95 % there."""


def prediction_errors(tried: FittedModel, data: FitData) -> PredictionErrors:
    """Return the errors of a model, on samples held out or else by cross-validation."""
    percent = 100.0 / data.stroke
    own = np.concatenate(tried.left.predicted_at(data.use)) * percent
    made = PredictionErrors(rms=root_mean_square(own), largest=float(np.max(np.abs(own))))
    held = tuple(~u for u in data.use)
    if any(h.any() for h in held):
        parts = tried.left.predicted_at(held)
        every = np.concatenate(parts) * percent
        return replace(
            made,
            held=root_mean_square(every),
            held_free=root_mean_square(free_constant(parts)) * percent,
            held_error=_of(rms_standard_error(tried.left.predicted, data.with_use(held)), percent),
            held_largest=float(np.max(np.abs(every))),
            held_band=float(np.quantile(np.abs(every), BAND)),
        )
    if tried.folds is None:
        return made
    return replace(
        made,
        held=tried.folds.rms * percent,
        held_free=tried.folds.free_rms * percent,
        held_error=_of(tried.folds.standard_error, percent),
        held_largest=tried.folds.largest * percent,
        held_band=tried.folds.band * percent,
    )


def _of(error: float | None, percent: float) -> float | None:
    return None if error is None else error * percent


def choose(tried: Mapping[str, FittedModel], data: FitData) -> tuple[str, tuple[Candidate, ...]]:
    """Take the simplest model that is as good as the best on held-out cycles, within noise."""
    rows = {name: prediction_errors(t, data) for name, t in tried.items()}
    percent = 100.0 / data.stroke
    # what was held out says nothing where it stands still: parts of what was fitted were held out
    score = {
        n: t.folds.rms * percent if t.folds is not None else (rows[n].held or rows[n].rms)
        for n, t in tried.items()
    }
    # one that has no inverse cannot compensate, however well it fits
    usable = [n for n in score if _invertible(tried[n])] or list(score)
    best = min(usable, key=lambda n: score[n])
    spread = {n: _by_chance(t.folds, tried[best].folds, data) for n, t in tried.items()}
    # squares are compared, as they are means over the parts and their difference is normal; a part
    # that a model fails on makes its spread as large as its excess, so that both are bounded
    close = [
        n
        for n in usable
        if score[n] <= _SAME * score[best] + _NOTHING
        and score[n] ** 2 - score[best] ** 2 <= spread[n] + _NOTHING**2
    ]
    chosen = min(close, key=lambda n: (tried[n].method.size, score[n]))
    order = [chosen, *sorted((n for n in score if n != chosen), key=lambda n: score[n])]
    return chosen, tuple(
        Candidate(
            kind=n,
            size=tried[n].method.size,
            rms_percent=rows[n].rms,
            heldout_rms_percent=rows[n].held,
            heldout_free_rms_percent=rows[n].held_free,
            failed=_DIVERGES if score[n] > _NO_PREDICTION else "",
        )
        for n in order
    )


def _invertible(tried: FittedModel) -> bool:
    return all(c.holds for c in tried.fit.model.properties() if c.name == "invertible")


def _by_chance(own: Folds | None, best: Folds | None, data: FitData) -> float:
    """Standard error of the difference of two held-out mean squares, from part to part [%^2]."""
    if own is None or best is None:
        return 0.0
    difference = (own.mean_square - best.mean_square) * (100.0 / data.stroke) ** 2
    return float(np.std(difference, ddof=1) / np.sqrt(difference.size))
