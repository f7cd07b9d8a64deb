"""What an identification found, as tables, as sentences and as data."""

import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from flexstage.hysteresis import Feedforward, Identification, Prediction
from flexstage.hysteresis.drive_model import DriveModel, parameter_unit, start_in_words
from flexstage.hysteresis.identification.model_choice import Candidate
from flexstage.hysteresis.models.registry import MODELS
from flexstage.quantities.table import Table, table
from flexstage.quantities.units import readable, readable_unit


def candidates_table(found: Identification, caption: str = "") -> Table:
    """Set the models that were tried side by side, the chosen one first."""
    errors = "fitted, % rms", "held out, as predicted, % rms", "with a free constant, % rms"
    rows = ((c.kind, c.size, *_percents(c)) for c in found.candidates)
    return table(caption, ("model", "parameters", *errors), rows)


def failures(found: Identification) -> list[str]:
    """Return which models failed, and why."""
    return [f"{c.kind}: {c.failed}" for c in found.candidates if c.failed]


def parameters_table(found: Identification) -> Table:
    """Set out what was found, with standard errors."""
    return table("parameters", ("name", "value", "standard error", "<unit"), _rows(found))


def predictions_table(found: Sequence[Prediction], caption: str = "") -> Table:
    """Set out how a model predicts records, with a row for each rate where there are several."""
    errors = "as predicted, % rms", "with a free constant, % rms", "largest, %"
    rows = []
    for p in found:
        both = (p.as_predicted_rms_percent, p.free_constant_rms_percent)
        figures = (*(f"{e:.3f}" for e in both), f"{p.largest_percent:.2f}")
        rows.append((Path(p.source).name or "record", "all", len(p.cycles), *figures))
        for rate, many, predicted, free in p.rates if len(p.rates) > 1 else ():
            rows.append(("", f"{rate:.3g}", many, f"{predicted:.3f}", f"{free:.3f}", ""))
    return table(caption, ("record", "<rate, Hz", "cycles", *errors), rows)


def prediction_in_words(found: Prediction, model: DriveModel) -> list[str]:
    """Say what a model was tried on, line by line."""
    stroke = readable(model.output_unit or "output", found.stroke, digits=4)
    said = [
        f"{Path(found.source).name or 'record'}: stroke {stroke}; mean error "
        f"{found.constant_percent:+.2f} % of it; the first {found.warm_up} of {found.time.size} "
        "samples are not counted"
    ]
    if model.creep is not None:
        said.append(f"before, the drive is taken to have {start_in_words(*found.starts)}")
    return said


def command_in_words(made: Feedforward, drive: DriveModel) -> list[str]:
    """Say what a command is, and how near the model comes to the reference with it."""
    unit, output = drive.input_unit or "input", drive.output_unit or "output"
    low, high = float(made.command.min()), float(made.command.max())
    return [
        f"{made.time.size} samples of {readable(unit, low, high, digits=5)}, by the inverse of "
        f"{drive.hysteresis.kind}",
        f"predicted error: {readable(output, made.rms_error)} rms, "
        f"{readable(output, made.largest_error)} at most (the model with itself: what it leaves "
        "of a measured drive adds to it)",
    ]


def _percents(candidate: Candidate) -> tuple[str, str, str]:
    """What a model leaves where it was fitted, and on what was held out, for the table."""
    c = candidate
    if c.rms_percent is None:
        return "failed", "", ""
    if c.failed:
        return f"{c.rms_percent:.3f}", "diverges", ""
    held = [
        "" if value is None else f"{value:.3f}"
        for value in (c.heldout_rms_percent, c.heldout_free_rms_percent)
    ]
    return f"{c.rms_percent:.3f}", held[0], held[1]


def identification_in_words(found: Identification) -> list[str]:
    """What was fitted and how well, line by line."""
    m, (low, high) = found.model, found.measurement.input_range
    shown, factor = readable_unit(found.stroke, m.output_unit)  # one unit for all readings
    shown, driven = shown or "output", m.input_unit or "input"
    slope = factor * found.stroke / (high - low)
    said = [
        f"fitted: {found.settings['fitted']}",
        f"stroke {factor * found.stroke:.4g} {shown} over {readable(driven, low, high, digits=4)}, "
        f"{slope:.3g} {shown}/{driven} on average; noise about {found.noise_percent:.2f} % of the "
        "stroke",
    ]
    if found.heldout_rms_percent is not None:
        error = found.heldout_standard_error
        known = "" if error is None else f" +- {error:.3f} (standard error)"
        said.append(
            f"held out, as predicted: {found.heldout_rms_percent:.3f}{known} % of the stroke rms; "
            f"95 % within {found.heldout_band_percent:.2f}, largest {found.heldout_max_percent:.2f}"
        )
    else:
        said.append(f"largest error {found.max_percent:.2f} % of the stroke")
    if m.creep is not None:
        of = "the first record" if len(found.measurement.sections) > 1 else "the record"
        said.append(
            f"before {of} the drive seems to have {start_in_words(*found.starts)}; creep "
            f"of that changes readings by up to {factor * found.settling:.2g} {shown}"
        )
    return said


def quality_in_words(found: Identification) -> str:
    """Say whether the model explains its records, and what it leaves of held-out cycles."""
    if not found.quality.fits:
        return found.quality.reason
    records = "records" if len(found.measurement.sections) > 1 else "record"
    title = MODELS[found.kind].title
    error = found.heldout_rms_percent
    left = (
        f"it leaves {found.rms_percent:.2g} % of the stroke rms"
        if error is None
        else f"on cycles that it was not fitted to it leaves {error:.2g} % of the stroke rms"
    )
    return (
        f"{title} explains the {records}: {left}; the noise is {found.noise_percent:.2g} %, a "
        f"straight line leaves {found.quality.line_percent:.2g} %"
    )


def band_in_words(found: Sequence[Prediction], band_percent: float) -> str:
    """Say which share of the errors lies within the band of the model, that of half this width."""
    errors = [(p.measured - p.predicted)[p.warm_up :] / p.stroke for p in found]
    every = np.concatenate([e[np.isfinite(e)] for e in errors])
    within = np.abs(every) <= 0.01 * band_percent
    return (
        f"band of the model, 95 % of its held-out errors: +-{band_percent:.2f} % of the stroke; "
        f"{100.0 * float(np.mean(within)):.1f} % of these samples lie within it"
    )


def _rows(found: Identification) -> list[tuple[str, str, str, str]]:
    """Name, value, standard error and unit of what was found, as people read them."""
    m = found.model
    shown, factor = readable_unit(found.stroke, m.output_unit)
    unknown = {e.name for e in found.chain if math.isinf(e.standard_error)}
    made = []
    for name, row in found.parameter_rows().items():
        value, error = row["value"], row["standard_error"]
        if not isinstance(value, float) or (value == 0.0 and error is None):
            continue  # a table, or what this model does without
        over, _, under = parameter_unit(found.kind, name, "input", "output").partition("/")
        power = ("output" in over) - ("output" in under)
        unit = parameter_unit(found.kind, name, m.input_unit, shown)
        made.append((name, *_numbers(value, error, factor**power), unit))
    for name, row in found.chain_rows().items():
        if not isinstance(row, dict) or row["value"] is None:
            continue
        value, error = row["value"], row["standard_error"]
        own, times = readable_unit(max(abs(value), error or 0.0), row["unit"])
        if name == "offset":
            own, times = shown or "output", factor
        elif name == "creep_per_decade":
            own, times = "%", 100.0
        number, known = _numbers(value, error, times)
        known = "not determined" if name in unknown else known
        made.append((name.replace("_", " "), number, known, own))
    return made


def _numbers(value: float, error: float | None, factor: float) -> tuple[str, str]:
    """A value to the digits that its standard error leaves, and that error."""
    value *= factor
    if not error:
        return f"{value:.4g}", ""
    error *= factor
    least = min(error, abs(value) or error)
    return f"{value:.{max(1 - math.floor(math.log10(least)), 0)}f}", f"{error:.2g}"
