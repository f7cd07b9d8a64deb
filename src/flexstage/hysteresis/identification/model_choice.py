"""Selection of one of the fitted models."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from scipy.special import stdtrit

from flexstage.base.arrays import Array
from flexstage.hysteresis.identification.model_fit import SAME, FitData, FitResult, ModelFit
from flexstage.hysteresis.identification.residuals import (
    HeldOut,
    Residuals,
    cross_validate,
    held_out_errors,
    residuals,
    root_mean_square,
    stretches_of,
)

#: Models with residuals below this are equal [% of the stroke].
_NEGLIGIBLE = 1e-5
#: A model with a held-out error above this has no predictive value [% of the stroke].
_NO_PREDICTION = 100.0
_DIVERGES = "it diverges: its held-out error exceeds the stroke"
_NO_INVERSE = "it has no inverse: if none is needed, select it alone by --model"


@dataclass(frozen=True, slots=True, kw_only=True)
class Candidate:
    """One of the candidate models."""

    kind: str
    """Name of the model."""
    size: int
    """Number of its parameters."""
    rms_percent: float | None = None
    """Rms error of the prediction on fitted samples, over the stroke [%]; None if it could not be
    fitted.
    """
    heldout_rms_percent: float | None = None
    """The same on held-out cycles [%]."""
    heldout_free_rms_percent: float | None = None
    """The same, with the constant fitted to the held-out samples [%]."""
    failed: str = ""
    """Reason why it is unusable; empty if it is usable."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FittedModel:
    """Fitted model, with its method and residuals."""

    method: ModelFit
    """The fitting method."""
    fit: FitResult
    """The fit."""
    residuals: Residuals
    """Its residuals at all rows."""
    validation: HeldOut | None
    """Errors on fitted stretches, held out in turn; None without cross-validation."""
    held_out: HeldOut | None
    """Errors to report: on samples that were held out on request, or else of the validation."""

    def errors_percent(self, data: FitData) -> Array:
        """Return the errors of the prediction at the fitted rows, over the stroke [%]."""
        return np.concatenate(self.residuals.predicted_at(data.use)) * (100.0 / data.stroke)

    @property
    def scored(self) -> HeldOut | None:
        """Errors by which models are compared: held-out samples without motion are no test."""
        return self.validation or self.held_out

    def score(self, data: FitData) -> float:
        """Return the rms error on held-out stretches, or else of the fit, over the stroke [%]."""
        if self.scored is None:
            return root_mean_square(self.errors_percent(data))
        return self.scored.rms_percent


def fit_model(method: ModelFit, data: FitData, *, validate: bool) -> FittedModel:
    """Fit a model, and cross-validate it on request."""
    fit = method.fit(data)
    left = residuals(fit.model, data)
    validation = cross_validate(method, data, fit.search) if validate else None
    others = data.with_use(tuple(~u for u in data.use))
    errors = [left.predicted_at(stretch) for stretch in stretches_of(others)]
    held_out = validation
    if errors:
        held_out = held_out_errors(errors, data, left.predicted_at(others.use))
    return FittedModel(
        method=method, fit=fit, residuals=left, validation=validation, held_out=held_out
    )


def choose(models: Mapping[str, FittedModel], data: FitData) -> tuple[str, tuple[Candidate, ...]]:
    """Select the simplest model that is as good as the best on held-out cycles, within noise."""
    rms = {n: root_mean_square(t.errors_percent(data)) for n, t in models.items()}
    score = {n: t.score(data) for n, t in models.items()}
    # one that has no inverse cannot compensate, however well it fits
    usable = [n for n in score if _invertible(models[n])] or list(score)
    best = min(usable, key=lambda n: score[n])
    scatter = {n: _by_chance(t.scored, models[best].scored) for n, t in models.items()}
    # squares are compared, as they are means over the parts and their difference is normal; the
    # factor is a second bound, as one bad part makes the spread of a model as large as its excess
    close = [
        n
        for n in usable
        if score[n] <= SAME * score[best] + _NEGLIGIBLE
        and score[n] ** 2 - score[best] ** 2 <= scatter[n] + _NEGLIGIBLE**2
    ]
    selected = min(close, key=lambda n: (models[n].method.size, score[n]))
    order = [selected, *sorted((n for n in score if n != selected), key=lambda n: score[n])]
    return selected, tuple(
        Candidate(
            kind=n,
            size=models[n].method.size,
            rms_percent=rms[n],
            heldout_rms_percent=None if other is None else other.rms_percent,
            heldout_free_rms_percent=None if other is None else other.free_rms_percent,
            failed=_DIVERGES if score[n] > _NO_PREDICTION else ("" if n in usable else _NO_INVERSE),
        )
        for n in order
        for other in [models[n].held_out]
    )


def _invertible(model: FittedModel) -> bool:
    return all(c.holds for c in model.fit.model.properties() if c.name == "invertible")


def _by_chance(one: HeldOut | None, best: HeldOut | None) -> float:
    """Largest difference of two held-out mean squares by chance, 95 %, by stretches [%^2]."""
    if one is None or best is None or best.stretches_percent.size < 2:
        return 0.0
    difference = one.stretches_percent**2 - best.stretches_percent**2
    standard_error = np.std(difference, ddof=1) / np.sqrt(difference.size)
    return float(stdtrit(difference.size - 1, 0.95) * standard_error)
