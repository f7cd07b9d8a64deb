"""Quality report and warnings of an identification."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from flexstage.base.arrays import Array
from flexstage.hysteresis.identification.baseline_shift import baseline_shifts
from flexstage.hysteresis.identification.chain_residual import dictionary, short_data
from flexstage.hysteresis.identification.chain_search import ChainEstimate, rms_of_line
from flexstage.hysteresis.identification.cycles import RecordSection, unknown_history_warning
from flexstage.hysteresis.identification.faults import RecordFault, likely_shifts, shift_text
from flexstage.hysteresis.identification.fit_rows import ChainValues, Rows
from flexstage.hysteresis.identification.measurement import IdentificationData
from flexstage.hysteresis.identification.model_choice import FittedModel
from flexstage.hysteresis.identification.model_fit import FitData, behind_chain
from flexstage.hysteresis.identification.projection import orthonormal
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
    still: float = 0.1
    """Held-out samples over which the input moves by less than this share of its range have no
    motion.
    """
    shift: float = 0.05
    """Smallest shift in time, as a share of the fastest cycle: a model finds a smaller one."""
    shifted: float = 0.5
    """Largest share of the squared residual that it leaves."""
    good: float = 0.003
    """Residual of a coarse model, as a share of the stroke, that needs no shift."""
    repeats: float = 0.01
    """Inputs that differ by less, as a share of the range, do not show a shift."""
    equal: float = 1.5
    """Of shifts that leave less than this many times the smallest residual, the least is likely."""
    rows: int = 600
    """Rows of a record that shifts are tried with, and ..."""
    samples: int = 12_000
    """... samples that are searched for a change of gain: both bound the time."""
    gain: float = 0.015
    """Smallest change of gain: models follow changes with rate and amplitude within 1 %."""
    removed: float = 0.3
    """Smallest share of the squared residual that a change of gain with a jump removes, and share
    of the remainder that it removes if the jump is removed already.
    """
    separable: float = 0.01
    """Smallest share of a change of gain that neither the coarse model nor a jump represents."""


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
    misplaced = misrecorded(data)
    shifted = {f.record for f in misplaced if f.kind == "shift"}
    if shifted:  # of which other faults are consequences
        faults = [f for f in faults if f.kind == "spikes" or f.record not in shifted] + misplaced
    # a shift within a period is the difference of its ends
    elif not data.periodic and not any(f.kind == "butterfly" for f in faults):
        # a change of the gain causes jumps and a drift, and is corrected first
        faults += misplaced or baseline_shifts(data)
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


def misrecorded(data: FitData) -> list[RecordFault]:
    r"""Find an output that was recorded at another time than its input, or with two gains.

    Both are tested with a coarse model of any hysteresis. A shift in time is one that the
    correlation of input and output suggests, and that leaves less than half of the squared
    residual; for a change of gain, the model may also have a gain that depends on rate and
    amplitude, and its residual is projected on a step and on the step times the motion, at every
    row: the likeliest row is that at which both remove most (as of a jump: D. V. Hinkley,
    Biometrika 57 (1970) 1).

    Validity: cycles that are not all the same. One change of gain in a record, by 1.5 % and more,
    with motions of the same size before and after it.
    """
    short = short_data(data, data.chain, _THRESHOLDS.samples, None)
    columns = behind_chain(dictionary(short)[0], short)
    cycle = 1.0 / max(data.rates_hz, default=math.inf)
    faults = []
    for k, (s, r, model) in enumerate(zip(short.sections, short.rows, columns, strict=True)):
        if s.measured is not None or s.periodic or r.at.size < 4 * model.shape[1]:
            continue
        c = np.column_stack((model, s.nuisance[r.at]))
        few = slice(None, None, max(1, r.at.size // _THRESHOLDS.rows))
        delay = round(data.chain.delay / s.dt)
        lag = _shift(s, r.at[few], c[few], delay, round(_THRESHOLDS.shift * cycle / s.dt))
        if lag != 0:
            text = shift_text(lag * s.dt)
            faults.append(RecordFault.of("shift", k, (), 0.0, data.stroke, text))
            continue
        change, row = _gain_change(s, r, c)
        if change != 0.0:
            at = s.begin + (row - s.history) * s.dt
            text = (
                f"the gain changes by about {100.0 * change:.2g} % at {at:.4g} s: check sensor and "
                "amplifier for a change of range, and identify one side of it with --rows"
            )
            size = change * data.stroke
            faults.append(RecordFault.of("gain", k, (at,), size, data.stroke, text))
    return faults


def _shift(
    section: RecordSection, at: NDArray[np.intp], columns: Array, delay: int, least: int
) -> int:
    """Shift of the output [samples] with which it fits columns far better, else 0.

    The columns are those of outputs at the samples `at`, behind a delay.
    """
    first, size, span = section.warm_up, section.u.size, float(np.ptp(section.u))

    def left(outputs: NDArray[np.intp], use: NDArray[np.bool_]) -> float:
        target = section.y[outputs[use]]
        fit = columns[use] @ np.linalg.lstsq(columns[use], target, rcond=1e-9)[0]
        return float(np.mean((target - fit) ** 2))

    shares: dict[int, float] = {}
    good = (_THRESHOLDS.good * float(np.ptp(section.y))) ** 2
    if left(at, at >= first) < good:
        return 0
    for lag in likely_shifts(section.u[first:], section.y[first:], least):
        later = at + lag - delay
        # the same samples of the output, so that a fault elsewhere is no reason for a shift
        use = (later >= first + least) & (later < size - least)
        same = (at >= later[use].min()) & (at <= later[use].max())
        near = range(-least, least + 1, max(1, least // 25))
        differs = min(np.std(section.u[later[use] + k] - section.u[at[use]]) for k in near)
        if same.any() and differs > _THRESHOLDS.repeats * span:
            shares[lag] = left(later, use) / max(left(at, same), good)
    smallest = min(shares.values(), default=1.0)
    likely = [lag for lag, share in shares.items() if share <= _THRESHOLDS.equal * smallest]
    return min(likely, key=abs) if smallest < _THRESHOLDS.shifted else 0


def _gain_change(section: RecordSection, rows: Rows, columns: Array) -> tuple[float, int]:
    """Change of the gain of a record within it, else 0, and the sample at which it changes."""
    n, y = rows.at.size, section.y[rows.at]
    basis = orthonormal(np.column_stack((columns, np.arange(n, dtype=np.float64))))
    motion = basis @ (basis.T @ y)
    motion -= motion.mean()
    kinds = np.column_stack((section.cycles.frequency_hz, section.cycles.swing))[rows.cycle - 1]
    basis = orthonormal(np.column_stack((basis, kinds * motion[:, None])))
    residual = y - basis @ (basis.T @ y)
    steps = np.column_stack((np.ones(n), motion))
    # products from each row to the end, of the steps less their projections on the model
    right = _to_the_end(residual[:, None] * steps)
    model = _to_the_end(steps[:, :, None] * basis[:, None, :])
    gram = _to_the_end(steps[:, :, None] * steps[:, None, :]) - model @ model.transpose(0, 2, 1)
    inner = slice(n // 10, n - n // 10)
    jump = np.maximum(gram[inner, 0, 0], 1e-300)
    mixed = gram[inner, 0, 1] / jump
    bare = gram[inner, 1, 1] - mixed * gram[inner, 0, 1]
    separable = bare > _THRESHOLDS.separable * float(motion @ motion)
    by_jump = right[inner, 0] ** 2 / jump
    gain = (right[inner, 1] - mixed * right[inner, 0]) / np.where(separable, bare, math.inf)
    both = np.where(separable, by_jump + gain**2 * bare, 0.0)
    i, total = int(np.argmax(both)), float(residual @ residual)
    jump_alone = float(by_jump.max())
    certain = both[i] > _THRESHOLDS.removed * total and (
        both[i] - jump_alone > _THRESHOLDS.removed * (total - jump_alone)
    )
    large = abs(gain[i]) > _THRESHOLDS.gain
    return (float(gain[i]), int(rows.at[inner][i])) if certain and large else (0.0, 0)


def _to_the_end(values: Array) -> Array:
    """Sum from each row to the last."""
    return np.cumsum(values[::-1], axis=0)[::-1]


def _no_hysteresis(line_percent: float, noise_percent: float) -> tuple[str, ...]:
    """Warn of an output that is a straight line of its input."""
    if line_percent > 1.05 * noise_percent + _THRESHOLDS.straight:
        return ()
    return (
        f"the output is a straight line of the input within {line_percent:.2g} % of the stroke, "
        "noise included, where piezo drives leave more than 1 %: the input is probably a reading "
        "of the sensor or the reference of a feedback loop; record the command of the amplifier",
    )


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
    percent, low, high = 100.0 / data.stroke, *data.input_range
    noise = max(
        math.hypot(s.noise, s.input_noise * data.stroke / (high - low)) for s in data.sections
    )
    return (
        *_undetermined_chain(data, chain),
        *_zero_of_each(best, data, settling),
        *data.warnings,
        *filter(None, (unknown_history_warning(data.sections),)),
        *(_no_motion(data) if held_out else ()),
        *_no_hysteresis(rms_of_line(data, ChainValues()) * percent, noise * percent),
        *_earlier_motion(doubt, error_percent, data),
        *chain.notes,
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
    return max(ranges, default=0.0) < _THRESHOLDS.still * (high - low)


def _earlier_motion(doubt: float, error: float, data: FitData) -> tuple[str, ...]:
    """Warn if creep of unknown earlier motion exceeds the error of the model."""
    change = 100.0 * doubt / data.stroke
    if change <= max(error, 1e-3):  # errors are printed to 0.001 %
        return ()
    return (
        "several histories before the record fit equally well, and their creep changes readings by "
        f"up to {change:.2g} % of the stroke, more than the error of the model: before recording, "
        "let the drive rest or repeat its motion for as long as the record lasts",
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


def _missing_properties(best: FittedModel) -> tuple[str, ...]:
    """Name the properties that the model lacks."""
    return tuple(
        f"{best.fit.model.title}: not {c.name}: {c.detail}"
        for c in best.fit.model.properties()
        if not c.holds
    )
