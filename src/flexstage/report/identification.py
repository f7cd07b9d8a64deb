"""Results of an identification as tables and sentences."""

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


def candidates_table(result: Identification, caption: str = "") -> Table:
    """Return the candidate models, the selected one first."""
    errors = "fitted, % rms", "held out, as predicted, % rms", "with a free constant, % rms"
    rows = ((c.kind, c.size, *_percents(c)) for c in result.candidates)
    return table(caption, ("model", "parameters", *errors), rows)


def failures(result: Identification) -> list[str]:
    """Return the models that failed, with the reasons."""
    return [f"{c.kind}: {c.failed}" for c in result.candidates if c.failed]


def parameters_table(result: Identification) -> Table:
    """Return the identified parameters, with standard errors."""
    return table("parameters", ("name", "value", "standard error", "<unit"), _rows(result))


def predictions_table(predictions: Sequence[Prediction], caption: str = "") -> Table:
    """Return the prediction errors of a model on records, with a row for each of several rates."""
    errors = "as predicted, % rms", "with a free constant, % rms", "largest, %"
    rows = []
    for p in predictions:
        both = (p.as_predicted_rms_percent, p.free_constant_rms_percent)
        figures = (*(f"{e:.3f}" for e in both), f"{p.largest_percent:.2f}")
        rows.append((Path(p.source).name or "record", "all", len(p.cycles), *figures))
        for rate, count, predicted, free in p.rates if len(p.rates) > 1 else ():
            rows.append(("", f"{rate:.3g}", count, f"{predicted:.3f}", f"{free:.3f}", ""))
    return table(caption, ("record", "<rate, Hz", "cycles", *errors), rows)


def prediction_in_words(prediction: Prediction, model: DriveModel) -> list[str]:
    """Return sentences on the record of a prediction."""
    stroke = readable(model.output_unit or "output", prediction.stroke, digits=4)
    zero = _zero_in_words(model)
    mean = f"predicted{zero}" if zero else f"mean error {prediction.constant_percent:+.2f} % of it"
    size, omitted = prediction.time.size, prediction.warm_up
    counted = (
        f"the first {omitted} of {size} samples are not" if omitted else f"all {size} samples are"
    )
    lines = [
        f"{Path(prediction.source).name or 'record'}: stroke {stroke}; {mean}; {counted} counted"
    ]
    if model.creep is not None and prediction.starts:
        lines.append(f"assumed history: the drive {start_in_words(*prediction.starts)}")
    return lines


def command_in_words(command: Feedforward, drive: DriveModel) -> list[str]:
    """Return sentences on a command and its predicted error."""
    unit, output = drive.input_unit or "input", drive.output_unit or "output"
    low, high = float(command.command.min()), float(command.command.max())
    return [
        f"{command.time.size} samples of {readable(unit, low, high, digits=5)}, by the inverse of "
        f"{drive.hysteresis.kind}",
        f"predicted error: {readable(output, command.rms_error)} rms, "
        f"{readable(output, command.largest_error)} at most (for the model itself: its deviation "
        "from the measured drive adds to this)",
    ]


def _percents(candidate: Candidate) -> tuple[str, str, str]:
    """Return the errors of a model on the fitted and held-out samples, for the table."""
    c = candidate
    if c.rms_percent is None:
        return "failed", "", ""
    heldout = [
        "" if value is None else f"{value:.3f}" if value < 100.0 else "diverges"
        for value in (c.heldout_rms_percent, c.heldout_free_rms_percent)
    ]
    return f"{c.rms_percent:.3f}", heldout[0], heldout[1]


def identification_in_words(result: Identification) -> list[str]:
    """Return sentences on the fit and its errors."""
    m, (low, high) = result.model, result.measurement.input_range
    unit, factor = readable_unit(result.stroke, m.output_unit)  # one unit for all readings
    unit, input_unit = unit or "output", m.input_unit or "input"
    slope = factor * result.stroke / (high - low)
    ends = sorted({*result.measurement.rates_hz[:1], *result.measurement.rates_hz[-1:]})
    rates = f"; cycles at {readable('Hz', *ends, digits=3)}" if ends else ""
    lines = [
        f"fitted: {result.settings['fitted']}{rates}",
        f"stroke {factor * result.stroke:.4g} {unit} over "
        f"{readable(input_unit, low, high, digits=4)}, {slope:.3g} {unit}/{input_unit} on average; "
        f"noise about {result.noise_percent:.2f} % of the stroke",
    ]
    lines.append(
        heldout_in_words(result) or f"largest error {result.max_percent:.2f} % of the stroke"
    )
    if m.creep is not None:
        of = "the first record" if len(result.measurement.sections) > 1 else "the record"
        lines.append(
            f"estimated history before {of}: the drive {start_in_words(*result.starts)}; its creep "
            f"changes readings by up to {factor * result.settling:.2g} {unit}"
        )
    return lines


def _zero_in_words(model: DriveModel) -> str:
    """Return what was fitted to each record, after a blank; empty for one zero of all."""
    fitted = {"one": "", "each": "constant", "drift": "constant and drift"}[model.zero]
    return fitted and f" with the {fitted} of its record"


def heldout_in_words(result: Identification) -> str:
    """Return a sentence on the held-out error, or an empty one; its figures are one experiment."""
    r = result
    if r.heldout_rms_percent is None:
        return ""
    return (
        f"held out, as predicted{_zero_in_words(r.model)}: {r.heldout_rms_percent:.3f} % of the "
        f"stroke rms, "
        f"{interval_in_words(r)}; 95 % within {r.heldout_band_percent:.2f}, "
        f"largest {r.heldout_max_percent:.2f}"
    )


def interval_in_words(result: Identification) -> str:
    """Return the interval of the held-out error, or what there is without one."""
    another = "another record" if len(result.measurement.sections) > 1 else "another stretch"
    if result.heldout_interval_percent is None:
        return (
            f"{another} not determined: median of the stretches "
            f"{result.heldout_median_percent:.3g}, worst {result.heldout_worst_percent:.3g}"
        )
    low, high = result.heldout_interval_percent
    return f"{another} {low:.2g} to {high:.2g} (95 %)"


def quality_in_words(result: Identification) -> str:
    """Return a sentence on whether the model describes its records, and its residual."""
    if not result.quality.fits:
        return result.quality.reason
    records = "records" if len(result.measurement.sections) > 1 else "record"
    title = MODELS[result.kind].title
    error = result.heldout_rms_percent
    residual = (
        f"residual {result.rms_percent:.2g} % of the stroke rms"
        if error is None
        else f"residual on held-out cycles {error:.2g} % of the stroke rms"
    )
    return (
        f"{title} describes the {records}: {residual}; noise {result.noise_percent:.2g} %, "
        f"residual of a straight line {result.quality.line_percent:.2g} %"
    )


def band_in_words(predictions: Sequence[Prediction], band_percent: float) -> str:
    """Return the share of the errors within the band of the model, given by its half width."""
    errors = [(p.measured - p.predicted)[p.warm_up :] / p.stroke for p in predictions]
    every = np.concatenate([e[np.isfinite(e)] for e in errors])
    within = np.abs(every) <= 0.01 * band_percent
    return (
        f"band of the model, 95 % of its held-out errors: +-{band_percent:.2f} % of the stroke; "
        f"{100.0 * float(np.mean(within)):.1f} % of these samples are within it"
    )


def _rows(result: Identification) -> list[tuple[str, str, str, str]]:
    """Return name, value, standard error and unit of the parameters, in readable units."""
    m = result.model
    output_unit, factor = readable_unit(result.stroke, m.output_unit)
    estimates = (*result.chain, result.offset)
    unknown = {e.name for e in estimates if math.isinf(e.standard_error)}
    rows = []
    for name, row in result.parameter_rows().items():
        value, error = row["value"], row["standard_error"]
        if not isinstance(value, float) or (value == 0.0 and error is None):
            continue  # a table, or an unused parameter
        over, _, under = parameter_unit(result.kind, name, "input", "output").partition("/")
        power = ("output" in over) - ("output" in under)
        unit = parameter_unit(result.kind, name, m.input_unit, output_unit)
        rows.append((name, *_numbers(value, error, factor**power), unit))
    for name, row in result.chain_rows().items():
        if not isinstance(row, dict) or row["value"] is None:
            continue
        value, error = row["value"], row["standard_error"]
        chain_unit, scale = readable_unit(max(abs(value), error or 0.0), row["unit"])
        if name == "offset":
            chain_unit, scale = output_unit or "output", factor
        elif name == "creep_per_decade":
            chain_unit, scale = "%", 100.0
        number, error_text = _numbers(value, error, scale)
        error_text = "not determined" if name in unknown else error_text
        rows.append((name.replace("_", " "), number, error_text, chain_unit))
    return rows


def _numbers(value: float, error: float | None, factor: float) -> tuple[str, str]:
    """Return a value, rounded to its standard error, and that error."""
    value *= factor
    if not error:
        return f"{value:.4g}", ""
    error *= factor
    least = min(error, abs(value) or error)
    return f"{value:.{max(1 - math.floor(math.log10(least)), 0)}f}", f"{error:.2g}"
