"""Selection of one of the fitted models."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import stdtrit

from flexstage.hysteresis.identification.model_fit import FitData, FitResult, ModelFit
from flexstage.hysteresis.identification.residuals import (
    BAND,
    Folds,
    Residuals,
    cross_validate,
    free_constant,
    residuals,
    rms_standard_error,
    root_mean_square,
)

#: A model with a residual more than this many times that of the best is worse than it; ...
_SAME = 1.1
#: ... models with residuals below this are equal [% of the stroke].
_NEGLIGIBLE = 1e-5
#: A model with a held-out error above this has no predictive value [% of the stroke].
_NO_PREDICTION = 100.0
_DIVERGES = "it diverges: its held-out error exceeds the stroke"


@dataclass(frozen=True, slots=True, kw_only=True)
class Candidate:
    """One of the candidate models."""

    kind: str
    """Name of the model."""
    size: int
    """Number of its parameters."""
    rms_percent: float | None
    """Rms error of the prediction on fitted samples, over the stroke [%]; None if it could not be
    fitted.
    """
    heldout_rms_percent: float | None
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
    folds: Folds | None
    """Cross-validation errors; None without cross-validation."""

    def rms(self, data: FitData) -> float:
        """Return the rms error on held-out cycles, or of the fit [unit of the output]."""
        if self.folds is not None:
            return self.folds.rms
        return root_mean_square(self.residuals.at(data.use))


def invertibility_warning(
    models: Mapping[str, FittedModel], candidates: Sequence[Candidate]
) -> tuple[str, ...]:
    """Name the models that predict better than the selected one, but have no inverse."""
    score = {c.kind: c.heldout_rms_percent for c in candidates}
    selected = score[candidates[0].kind]
    if selected is None or not _invertible(models[candidates[0].kind]):
        return ()
    better = [
        kind
        for kind, error in score.items()
        if error is not None and error < selected / _SAME and not _invertible(models[kind])
    ]
    if not better:
        return ()
    return (
        f"{', '.join(better)} would predict better, but cannot be inverted: if the model need not "
        "compute commands, select one by --model",
    )


def failed_candidate(method: ModelFit, reason: str) -> Candidate:
    """Describe a model that could not be fitted."""
    return Candidate(
        kind=method.kind,
        size=method.size,
        rms_percent=None,
        heldout_rms_percent=None,
        failed=reason,
    )


def fit_model(method: ModelFit, data: FitData, *, validate: bool) -> FittedModel:
    """Fit a model, and cross-validate it on request."""
    fit = method.fit(data)
    folds = cross_validate(method, data, fit.search) if validate else None
    return FittedModel(method=method, fit=fit, residuals=residuals(fit.model, data), folds=folds)


@dataclass(frozen=True, slots=True, kw_only=True)
class PredictionErrors:
    """Errors of the prediction over the stroke [%]; None if nothing was held out."""

    rms: float
    """Rms error on fitted samples."""
    largest: float
    """Largest absolute value there."""
    heldout: float | None = None
    """Rms error on held-out samples."""
    heldout_free: float | None = None
    """The same, with the constant refitted."""
    heldout_error: float | None = None
    """Standard error of that root mean square."""
    heldout_largest: float | None = None
    """Largest absolute value there."""
    heldout_band: float | None = None
    """Half the width of the band that holds 95 % there."""


def prediction_errors(model: FittedModel, data: FitData) -> PredictionErrors:
    """Return the errors of a model, on held-out samples or else by cross-validation."""
    percent = 100.0 / data.stroke
    fit_errors = np.concatenate(model.residuals.predicted_at(data.use)) * percent
    errors = PredictionErrors(
        rms=root_mean_square(fit_errors), largest=float(np.max(np.abs(fit_errors)))
    )
    held_out = tuple(~u for u in data.use)
    if any(h.any() for h in held_out):
        parts = model.residuals.predicted_at(held_out)
        held_errors = np.concatenate(parts) * percent
        return replace(
            errors,
            heldout=root_mean_square(held_errors),
            heldout_free=root_mean_square(free_constant(parts)) * percent,
            heldout_error=_scaled(
                rms_standard_error(model.residuals.of_prediction, data.with_use(held_out)), percent
            ),
            heldout_largest=float(np.max(np.abs(held_errors))),
            heldout_band=float(np.quantile(np.abs(held_errors), BAND)),
        )
    if model.folds is None:
        return errors
    return replace(
        errors,
        heldout=model.folds.rms * percent,
        heldout_free=model.folds.free_rms * percent,
        heldout_error=_scaled(model.folds.standard_error, percent),
        heldout_largest=model.folds.largest * percent,
        heldout_band=model.folds.band * percent,
    )


def _scaled(error: float | None, percent: float) -> float | None:
    return None if error is None else error * percent


def choose(models: Mapping[str, FittedModel], data: FitData) -> tuple[str, tuple[Candidate, ...]]:
    """Select the simplest model that is as good as the best on held-out cycles, within noise."""
    rows = {name: prediction_errors(t, data) for name, t in models.items()}
    percent = 100.0 / data.stroke
    # held-out samples without motion are no test: the fitted samples are cross-validated then
    score = {
        n: t.folds.rms * percent if t.folds is not None else (rows[n].heldout or rows[n].rms)
        for n, t in models.items()
    }
    # one that has no inverse cannot compensate, however well it fits
    usable = [n for n in score if _invertible(models[n])] or list(score)
    best = min(usable, key=lambda n: score[n])
    scatter = {n: _by_chance(t.folds, models[best].folds, data) for n, t in models.items()}
    # squares are compared, as they are means over the parts and their difference is normal; the
    # factor is a second bound, as one bad part makes the spread of a model as large as its excess
    close = [
        n
        for n in usable
        if score[n] <= _SAME * score[best] + _NEGLIGIBLE
        and score[n] ** 2 - score[best] ** 2 <= scatter[n] + _NEGLIGIBLE**2
    ]
    selected = min(close, key=lambda n: (models[n].method.size, score[n]))
    order = [selected, *sorted((n for n in score if n != selected), key=lambda n: score[n])]
    return selected, tuple(
        Candidate(
            kind=n,
            size=models[n].method.size,
            rms_percent=rows[n].rms,
            heldout_rms_percent=rows[n].heldout,
            heldout_free_rms_percent=rows[n].heldout_free,
            failed=_DIVERGES if score[n] > _NO_PREDICTION else "",
        )
        for n in order
    )


def _invertible(model: FittedModel) -> bool:
    return all(c.holds for c in model.fit.model.properties() if c.name == "invertible")


def _by_chance(folds: Folds | None, best: Folds | None, data: FitData) -> float:
    """Largest difference of two held-out mean squares by chance, 95 %, by their parts [%^2]."""
    if folds is None or best is None:
        return 0.0
    difference = (folds.mean_square - best.mean_square) * (100.0 / data.stroke) ** 2
    return float(
        stdtrit(difference.size - 1, BAND) * np.std(difference, ddof=1) / np.sqrt(difference.size)
    )
