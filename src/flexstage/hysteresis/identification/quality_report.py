"""Quality report and warnings of an identification."""

import math
from dataclasses import dataclass

import numpy as np

from flexstage.hysteresis.identification.baseline_shift import baseline_shifts
from flexstage.hysteresis.identification.chain_search import ChainEstimate, rms_of_line
from flexstage.hysteresis.identification.cycles import unknown_history_warning
from flexstage.hysteresis.identification.faults import RecordFault
from flexstage.hysteresis.identification.fit_rows import ChainValues
from flexstage.hysteresis.identification.measurement import IdentificationData
from flexstage.hysteresis.identification.model_choice import FittedModel
from flexstage.hysteresis.identification.model_fit import FitData
from flexstage.hysteresis.identification.residuals import free_constant
from flexstage.quantities.units import readable

#: Residual of a fitted model of a piezo drive: 0.1 to 2 % of the stroke, depending on the session.
#: A model with a larger residual, and ...
_USUAL = 2.0
#: ... with more than this share of the residual of a straight line, explains no hysteresis; ...
_SHARE_OF_LINE = 1.0 / 3.0
#: ... and one with a larger residual than this is useless [% of the stroke].
_USELESS = 5.0
#: Stages ring at about 100 Hz: cycles faster than these may show it.
_SHOWS_MODES_HZ = 10.0
#: Piezo drives creep by 1 to 3 % per decade of time: a larger value has another cause.
_UNUSUAL_CREEP = 0.05
#: Held-out samples over which the input moves by less than this share of its range have no motion.
_STILL = 0.1


@dataclass(frozen=True, slots=True, kw_only=True)
class QualityReport:
    """Assessment of the best model against its records."""

    fits: bool
    """True if the model explains the records."""
    reason: str
    """Reason why it does not; empty otherwise."""
    line_percent: float
    """Residual of a straight line, over the stroke, rms [%]."""
    findings: tuple[RecordFault, ...]
    """Faults of the records."""

    @property
    def sentences(self) -> tuple[str, ...]:
        """Warnings of the report, the reason first."""
        reason = () if self.fits else (self.reason,)
        return (*reason, *(f.text for f in self.findings))


def quality_report(data: FitData, error_percent: float, noise_percent: float) -> QualityReport:
    """Compare the residual of the best model with the noise and the residual of a straight line.

    The error is the rms residual of the best model where it was fitted, over the stroke [%]: one on
    a stretch beyond the range or the rate of the others is of the prediction. The noise is that of
    the output [%].
    """
    percent = 100.0 / data.stroke
    faults = list(data.findings)
    # a shift within the only period is the difference of its ends
    if not data.shows_one_period and not any(f.kind == "butterfly" for f in faults):
        faults += baseline_shifts(data)
    line = rms_of_line(data, ChainValues()) * percent
    excess = float(np.sqrt(max(error_percent**2 - noise_percent**2, 0.0)))
    explains = excess <= _USUAL or (excess <= _USELESS and excess <= _SHARE_OF_LINE * line)
    is_butterfly = any(f.kind == "butterfly" for f in faults)
    reason = ""
    if is_butterfly or not explains:
        kinds = sorted({f.kind for f in faults} - {"spikes"})
        remedy = f"correct the {' and the '.join(kinds)} reported here" if kinds else (
            "check that input and output belong together, and that everything that moves the "
            "output is recorded"
        )  # fmt: skip
        reason = (
            f"no model fits: the smallest residual is {error_percent:.2g} % of the stroke, the "
            f"noise is {noise_percent:.2g} %, the residual of a straight line is {line:.2g} %, and "
            f"that of a piezo drive is usually at most {_USUAL:g} %; {remedy}"
        )
    return QualityReport(fits=not reason, reason=reason, line_percent=line, findings=tuple(faults))


def fit_warnings(
    best: FittedModel,
    data: FitData,
    chain: ChainEstimate,
    error_percent: float,
    settling: float,
    *,
    held_out: bool,
) -> tuple[str, ...]:
    """Return the warnings about a model, and about what its records do not determine.

    The error is that of the model, held out where there is such a figure [%]; `settling` is the
    largest change of readings by earlier motion [unit of the output]; `held_out` is true if a range
    of the record was held out on request.
    """
    return (
        *_undetermined_chain(data, chain),
        *_zero_of_each(best, data, settling),
        *data.warnings,
        *filter(None, (unknown_history_warning(data.sections),)),
        *(_no_motion(data) if held_out else ()),
        *_earlier_motion(settling, error_percent, data),
        *chain.notes,
        *_unusual_creep(chain, data),
        *_hidden_mode(chain, data),
        *_missing_properties(best),
        *best.fit.notes,
    )


def _undetermined_chain(m: IdentificationData, chain: ChainEstimate) -> tuple[str, ...]:
    """Warn of values of the chain that are not identifiable one by one."""
    names = " and ".join(n.split("_")[0] for n, e in chain.errors.items() if math.isinf(e))
    alone = f"; the values of {names} are not individually identifiable and hold for this fit only"
    if len(m.rates_hz) > 1:
        return (f"the records do not determine {names}{alone}",) if names else ()
    at = f"{m.rates_hz[0]:.3g} Hz" if m.rates_hz else "one rate"
    return (
        f"one rate only ({at}): lag, creep and hysteresis cannot be separated"
        f"{alone if names else ''}; record the same cycles at a second rate, ten times slower or "
        "faster",
    )


def _zero_of_each(best: FittedModel, data: FitData, settling: float) -> tuple[str, ...]:
    """Warn of records whose constants differ by more than residual and earlier motion explain."""
    errors = best.residuals.predicted_at(data.use)
    apart = float(np.ptp([np.mean(e) for e in errors]))
    if apart <= max(settling, float(np.max(np.abs(free_constant(errors))))):
        return ()
    return (
        f"the constants of the records differ by {readable(data.output_unit, apart)} "
        f"({100.0 * apart / data.stroke:.2g} % of the stroke), more than creep explains: if the "
        "sensor has a zero of its own in each record (interferometer, encoder, AC coupling), give "
        "--zero each; otherwise its zero has moved",
    )


def _no_motion(data: FitData) -> tuple[str, ...]:
    """Warn of held-out samples without motion."""
    if not stands_still(data):
        return ()
    return (
        "the input hardly moves over the held-out samples: their error does not include the "
        "hysteresis, and the model was selected by cross-validation over the fitted samples; hold "
        "out whole cycles",
    )


def stands_still(data: FitData) -> bool:
    """Return true if the input hardly moves where samples are held out."""
    low, high = data.input_range
    ranges = [
        float(np.ptp(s.u[r.at[~use]]))
        for s, r, use in zip(data.sections, data.rows, data.use, strict=True)
        if not use.all()
    ]
    return max(ranges, default=0.0) < _STILL * (high - low)


def _earlier_motion(settling: float, error: float, data: FitData) -> tuple[str, ...]:
    """Warn if creep from earlier motion exceeds the error of the model."""
    change = 100.0 * settling / data.stroke
    if change <= error:
        return ()
    return (
        f"creep from earlier motion changes readings by up to {change:.2g} % of the stroke, more "
        "than the error of the model: before recording, and before using the model, let the drive "
        "rest or repeat its motion for as long as the record lasts",
    )


def _unusual_creep(chain: ChainEstimate, data: FitData) -> tuple[str, ...]:
    """Warn of unusually large creep, unless the search has warned of it."""
    creep = data.chain.creep_per_decade
    if (
        not chain.searched
        or creep <= _UNUSUAL_CREEP
        or any(n.startswith("the creep reached") for n in chain.notes)
    ):
        return ()
    return (
        f"creep of {100.0 * creep:.2g} % per decade is more than that of piezo drives (1 to 3 %): "
        "a drift of the output (compare with --zero drift), a shift of its baseline or a slow "
        "sensor may be mistaken for creep",
    )


def _hidden_mode(chain: ChainEstimate, data: IdentificationData) -> tuple[str, ...]:
    """Warn of a resonance that may be mistaken for creep: both change fast cycles."""
    if chain.values.resonance_hz > 0.0 or len(data.rates_hz) < 2 or not chain.searched:
        return ()
    fastest = data.rates_hz[-1]
    if fastest < _SHOWS_MODES_HZ:
        return ()
    return (
        f"no resonance was found: one below {readable('Hz', 30.0 * fastest)} would change cycles "
        f"at {fastest:.3g} Hz by 0.1 % or more, and would be mistaken for creep; give its "
        "frequency by --known, or record a small multisine around it",
    )


def _missing_properties(best: FittedModel) -> tuple[str, ...]:
    """Name the properties that the model lacks."""
    return tuple(
        f"{best.fit.model.title}: not {c.name}: {c.detail}"
        for c in best.fit.model.properties()
        if not c.holds
    )
