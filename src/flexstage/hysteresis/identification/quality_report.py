"""Quality report and warnings of an identification."""

import math
from dataclasses import dataclass

import numpy as np

from flexstage.hysteresis.identification.chain_search import ChainEstimate, rms_of_line
from flexstage.hysteresis.identification.cycles import unknown_history_warning
from flexstage.hysteresis.identification.faults import RecordFault
from flexstage.hysteresis.identification.fit_rows import ChainValues
from flexstage.hysteresis.identification.measurement import IdentificationData
from flexstage.hysteresis.identification.model_choice import FittedModel
from flexstage.hysteresis.identification.model_fit import FitData
from flexstage.hysteresis.identification.record_changes import record_changes
from flexstage.hysteresis.identification.residuals import free_constant
from flexstage.quantities.units import readable


@dataclass(frozen=True, slots=True)
class _Thresholds:
    """Limits of a good fit, and of what contradicts it."""

    usual: float = 2.0
    """Residual of a fitted model of a piezo drive: 0.1 to 2 % of the stroke, depending on the
    session. A model with a larger residual, and ...
    """
    share_of_line: float = 1.0 / 3.0
    """... with more than this share of the residual of a straight line, explains no hysteresis."""
    useless: float = 5.0
    """A model with a larger residual than this is useless [% of the stroke]."""
    straight: float = 0.1
    """Largest residual of a straight line beyond the noise, of an output without hysteresis [% of
    the stroke]: the loop of a piezo drive leaves 1 % and more.
    """
    shows_modes: float = 10.0
    """Stages ring at about 100 Hz: cycles faster than this may show it [Hz]."""
    creep: float = 0.05
    """Piezo drives creep by 1 to 3 % per decade of time: a larger value has another cause."""
    still: float = 0.1
    """Held-out samples over which the input moves by less than this share of its range have no
    motion.
    """


_THRESHOLDS = _Thresholds()


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
        return (*filter(None, (self.reason,)), *(f.text for f in self.findings))


def quality_report(data: FitData, error_percent: float, noise_percent: float) -> QualityReport:
    """Compare the residual of the best model with the noise and the residual of a straight line.

    The error is the rms residual of the best model where it was fitted, over the stroke [%]: one on
    a stretch beyond the range or the rate of the others is of the prediction. The noise is that of
    the output [%].
    """
    percent = 100.0 / data.stroke
    changes = record_changes(data)
    # a shift in time causes other faults
    shifted = {f.record for f in changes if f.kind == "shift"}
    faults = [f for f in data.findings if f.kind == "spikes" or f.record not in shifted]
    faults += changes
    line = rms_of_line(data, ChainValues()) * percent
    excess = float(np.sqrt(max(error_percent**2 - noise_percent**2, 0.0)))
    explains = excess <= _THRESHOLDS.usual or (
        excess <= _THRESHOLDS.useless and excess <= _THRESHOLDS.share_of_line * line
    )
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
            f"that of a piezo drive is usually at most {_THRESHOLDS.usual:g} %; {remedy}"
        )
    return QualityReport(fits=not reason, reason=reason, line_percent=line, findings=tuple(faults))


def fit_warnings(
    best: FittedModel,
    data: FitData,
    chain: ChainEstimate,
    error_percent: float,
    earlier_motion: tuple[float, float],
    *,
    held_out: bool,
) -> tuple[str, ...]:
    """Return the warnings about a model, and about what its records do not determine.

    The error is that of the model, held out where there is such a figure [%]. Earlier motion
    changes readings by two amounts at most [unit of the output]: any motion, and that of the
    histories before the record that fit equally well. `held_out` is true if a range of the record
    was held out on request.
    """
    settling, doubt = earlier_motion
    percent, (low, high) = 100.0 / data.stroke, data.input_range
    warnings = [
        *_undetermined_chain(data, chain),
        *_zero_of_each(best, data, settling),
        *data.warnings,
        *filter(None, (unknown_history_warning(data.sections),)),
    ]
    if held_out and stands_still(data):
        warnings.append(
            "the input hardly moves over the held-out samples: their error does not include the "
            "hysteresis, and the model was selected by cross-validation over the fitted samples; "
            "hold out whole cycles"
        )
    noise = max(
        math.hypot(s.noise, s.input_noise * data.stroke / (high - low)) for s in data.sections
    )
    line = rms_of_line(data, ChainValues()) * percent
    if line <= 1.05 * noise * percent + _THRESHOLDS.straight:
        warnings.append(
            f"the output is a straight line of the input within {line:.2g} % of the stroke, noise "
            "included, where piezo drives leave more than 1 %: the input is probably a reading of "
            "the sensor or the reference of a feedback loop; record the command of the amplifier"
        )
    if doubt * percent > max(error_percent, 1e-3):  # errors are printed to 0.001 %
        warnings.append(
            "several histories before the record fit equally well, and their creep changes "
            f"readings by up to {doubt * percent:.2g} % of the stroke, more than the error of the "
            "model: before recording, let the drive rest or repeat its motion for as long as the "
            "record lasts"
        )
    title, properties = best.fit.model.title, best.fit.model.properties()
    return (
        *warnings,
        *_chain_notes(chain, data),
        *_hidden_mode(chain, data),
        *(f"{title}: not {c.name}: {c.detail}" for c in properties if not c.holds),
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


def stands_still(data: FitData) -> bool:
    """Return true if the input hardly moves where samples are held out."""
    low, high = data.input_range
    ranges = [
        float(np.ptp(s.u[r.at[~use]]))
        for s, r, use in zip(data.sections, data.rows, data.use, strict=True)
        if not use.all()
    ]
    return max(ranges, default=0.0) < _THRESHOLDS.still * (high - low)


def _chain_notes(chain: ChainEstimate, data: FitData) -> tuple[str, ...]:
    """Warnings of the search for the chain, and of the creep that the model has in the end."""
    creep, limit = data.chain.creep_per_decade, "the creep reached"
    if data.chain.spectrum is None and any(n.startswith(limit) for n in chain.notes):
        return chain.notes
    notes = tuple(n for n in chain.notes if not n.startswith(limit))
    if not chain.searched or creep <= _THRESHOLDS.creep:
        return notes
    of = "" if data.chain.spectrum is None else " on average over its spectrum"
    return (
        *notes,
        f"creep of {100.0 * creep:.2g} % per decade{of} is more than that of piezo drives (1 to "
        "3 %): a drift of the output (compare with --zero drift), a shift of its baseline or a "
        "slow sensor may be mistaken for creep",
    )


def _hidden_mode(chain: ChainEstimate, data: IdentificationData) -> tuple[str, ...]:
    """Warn of a resonance that may be mistaken for creep: both change fast cycles."""
    if chain.values.resonance_hz > 0.0 or len(data.rates_hz) < 2 or not chain.searched:
        return ()
    fastest = data.rates_hz[-1]
    if fastest < _THRESHOLDS.shows_modes:
        return ()
    return (
        f"no resonance was found: one below {readable('Hz', 30.0 * fastest)} would change cycles "
        f"at {fastest:.3g} Hz by 0.1 % or more, and would be mistaken for creep; give its "
        "frequency by --known, or record a small multisine around it",
    )
