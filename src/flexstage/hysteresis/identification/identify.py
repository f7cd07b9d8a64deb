"""Identification of a drive from measured records: a model with its errors and warnings."""

import math
from collections.abc import Sequence
from dataclasses import asdict, replace
from typing import Any

import numpy as np

from flexstage.base import progress
from flexstage.base.arrays import Array
from flexstage.base.errors import ModelError
from flexstage.base.provenance import content_hash, provenance
from flexstage.files.request import request_of
from flexstage.hysteresis.chain.creep import Start
from flexstage.hysteresis.drive_model import DriveModel, ValidityRange
from flexstage.hysteresis.identification.chain_search import (
    ChainEstimate,
    find_chain,
    find_memories,
    find_starts,
    other_chains,
    with_spectrum,
)
from flexstage.hysteresis.identification.cycles import RecordSection, with_start
from flexstage.hysteresis.identification.fit_rows import (
    ChainValues,
    averaged,
    filtered_samples,
)
from flexstage.hysteresis.identification.measurement import (
    IdentificationData,
    measurement,
    without_history,
)
from flexstage.hysteresis.identification.model_choice import (
    Candidate,
    FittedModel,
    choose,
    fit_model,
)
from flexstage.hysteresis.identification.model_fit import (
    FitData,
    behind_chain,
    fit_data,
    fits,
    fitted_levels,
    selected_models,
)
from flexstage.hysteresis.identification.quality_report import (
    fit_warnings,
    quality_report,
    stands_still,
)
from flexstage.hysteresis.identification.residuals import (
    HeldOut,
    ParameterEstimate,
    cross_validate,
    estimates,
    root_mean_square,
)
from flexstage.hysteresis.identification.result import Identification
from flexstage.hysteresis.model_file import ModelFile
from flexstage.hysteresis.models.registry import MODELS
from flexstage.hysteresis.requests import IdentifyRequest
from flexstage.records import Record
from flexstage.records.drives import train_range

#: Largest number of samples that models are fitted to; longer records are averaged.
_MOST_SAMPLES = 40_000
#: Starts whose residuals differ by less than this factor fit equally well.
_EQUAL = 1.01
#: Two starts are the same if they differ by less than this share of the largest difference.
_SAME_START = 0.05


def identify(
    records: Record | Sequence[Record],
    input_column: str | int,
    output_column: str | int,
    request: IdentifyRequest | None = None,
    *,
    chain: ChainValues | None = None,
    **options: Any,
) -> Identification:
    """Identify the hysteresis of a drive and the linear chain behind it.

    Delay, creep and resonance are found first, by projection over a dictionary of hysteresis; then
    the models are fitted. If the problem is linear, its optimum is the global one (non-negative
    least squares); otherwise one or two parameters are searched for and the others are projected
    out (Golub and Pereyra 1973), or all are refined from the best simpler model.

    Parameters
    ----------
    records : Record or sequence of Record
        Records of one drive; two or more rates separate lag and creep from hysteresis.
    input_column : str or int
        The column that drives.
    output_column : str or int
        The column that follows.
    request : IdentifyRequest, optional
        Candidate models, samples to fit, and known values. Of several models, the simplest is
        selected that is as good as the best on held-out cycles, within noise.
    chain : ChainValues, optional
        The chain, if all of it is known; identified where not given.
    **options
        Fields of `IdentifyRequest`, in place of those of `request`.

    Returns
    -------
    Identification
        The model with its errors.

    Raises
    ------
    RecordError
        The records are unsuitable.
    ModelError
        There is no such model.
    """
    request = request_of(IdentifyRequest, request, options)
    known, resonance = request.known, request.known.mode
    if chain is None and known.has_lag:
        chain = ChainValues(delay=known.delay or 0.0, creep_per_decade=known.creep or 0.0)
        if resonance is not None:
            chain = replace(chain, resonance_hz=resonance[0], damping_ratio=resonance[1])
    names = selected_models(request.model)
    sources = [records] if isinstance(records, Record) else list(records)
    train = train_range(request.train, sources)
    # numbers of samples and a drift belong to a record over time
    is_over_time = train is not None or request.zero == "drift"
    periodic = request.periodic or (False if is_over_time else None)
    data = measurement(sources, input_column, output_column, zero=request.zero, periodic=periodic)
    progress.update("linear chain", 0.0)
    fit_data(data, ChainValues(), train)  # refuses a range with too few samples
    data, estimate = _chain_and_start(data, chain, train, resonance)
    if chain is None:
        data, estimate = with_spectrum(data, estimate, train=train)
    short = data
    if train is None:  # which counts samples of the records
        # fits to all samples of long records would take minutes, for the same result
        share = max(1, _MOST_SAMPLES // len(data.sections))
        short = replace(data, sections=tuple(averaged(s, share) for s in data.sections))
    fitted_rows = fit_data(short, estimate.values, train)
    still = train is not None and stands_still(fitted_rows)
    model_fits: dict[str, FittedModel] = {}
    chains: dict[str, tuple[FitData, ChainEstimate]] = {}
    failed: list[Candidate] = []
    for i, name in enumerate(names):
        progress.update(MODELS[name].title, 0.2 + 0.8 * i / len(names))
        reason = ""
        for other in (*other_chains(fitted_rows, estimate, name), estimate):
            same = other is estimate
            behind = fitted_rows if same else replace(fitted_rows, chain=other.values, memo={})
            try:
                trial = fit_model(fits()[name], behind, validate=train is None or still)
            except ModelError as error:
                reason = f"it cannot be fitted to this record: {error}"
                continue
            if name not in model_fits or trial.score(behind) < model_fits[name].score(behind):
                model_fits[name], chains[name] = trial, (behind, other)
        if name not in model_fits:
            failed.append(Candidate(kind=name, size=fits()[name].size, failed=reason))
    if not model_fits:
        raise ModelError("; ".join(f"{c.kind}: {c.failed}" for c in failed))
    selected, candidates = choose(model_fits, fitted_rows)
    result = _result(model_fits[selected], (*candidates, *failed), *chains[selected], train)
    return replace(
        result,
        request=request,
        records=tuple(record.source for record in sources),
        notes=tuple(sorted({note for record in sources for note in record.notes})),
        settings={**result.settings, "fitted": _fitted(sources, data, train)},
    )


def _chain_and_start(
    data: IdentificationData,
    chain: ChainValues | None,
    train: tuple[int, int] | None,
    resonance: tuple[float, float] | None,
) -> tuple[IdentificationData, ChainEstimate]:
    """Find the chain, and memory and start of each record, by their common residual."""
    estimate = find_chain(data, chain, train=train, resonance=resonance)
    if any(s.both_ends > s.warm_up for s in data.sections):
        with_memories = find_memories(data, estimate, train=train)
        pairs = zip(with_memories.sections, data.sections, strict=True)
        if any(after.memory != before.memory for after, before in pairs):
            data = with_memories
            estimate = find_chain(data, chain, train=train, resonance=resonance)
    starts, width = find_starts(data, estimate, train=train)
    if all(start == s.start for start, s in zip(starts, data.sections, strict=True)):
        return data, _wider(estimate, width)
    sections = [replace(s, start=start) for s, start in zip(data.sections, starts, strict=True)]
    data = replace(data, sections=tuple(sections))
    return data, _wider(find_chain(data, chain, train=train, resonance=resonance), width)


def _wider(estimate: ChainEstimate, width: float) -> ChainEstimate:
    """Add the uncertainty of the start to the standard error of creep."""
    if "creep_per_decade" not in estimate.errors:
        return estimate
    error = math.hypot(estimate.errors["creep_per_decade"], width)
    return replace(estimate, errors={**estimate.errors, "creep_per_decade": error})


def _fitted(
    records: Sequence[Record], data: IdentificationData, train: tuple[int, int] | None
) -> str:
    """Describe the fitted samples of the records."""
    parts = []
    for record, s in zip(records, data.sections, strict=True):
        first = s.first + s.warm_up - s.history
        stop = first + s.u.size - s.warm_up - s.periodic
        if train is not None:
            first, stop = max(first, train[0]), min(stop, train[1])
        if stop <= first:
            parts.append(f"none of {record.size} samples")
            continue
        begin, end = _times_in_file(record)[[first, stop - 1]]
        parts.append(f"{stop - first} of {record.size} samples, {begin:.4g} to {end:.4g} s")
    return "; ".join(parts)


def _times_in_file(record: Record) -> Array:
    """Times from the first sample of the file [s], of which a part may have been read."""
    numbers, since = record.numbers, record.time - record.time[0]
    if numbers is None or not numbers[-1] > numbers[0] or np.isnan(numbers).any():
        return since  # rows of a table are in no order of time
    return since + float(numbers[0] * since[-1] / (numbers[-1] - numbers[0]))


def _result(
    best: FittedModel,
    candidates: tuple[Candidate, ...],
    data: FitData,
    estimate: ChainEstimate,
    train: tuple[int, int] | None,
) -> Identification:
    validation = best.validation or cross_validate(best.method, data, best.fit.search)
    parameters, offset, parameter_warnings = estimates(
        best.method, best.fit, data, best.residuals, validation, estimate.widths
    )
    errors, held_out = best.errors_percent(data), best.held_out
    rms = root_mean_square(errors)
    error = rms if held_out is None else held_out.rms_percent
    figures: dict[str, Any] = {
        f"heldout_{name}": getattr(held_out, name, None) for name in HeldOut.names
    }
    settling, doubt, starts = _before(best, data)
    m = data.measurement
    drive = _drive_model(best, data)
    noise = max(s.noise for s in m.sections) * 100.0 / m.stroke
    report = quality_report(data, rms, noise)
    return Identification(
        model=drive,
        kind=best.method.kind,
        rms_percent=rms,
        max_percent=float(np.max(np.abs(errors))),
        **figures,
        stroke=m.stroke,
        noise_percent=noise,
        parameters=parameters,
        chain=_chain(estimate),
        offset=replace(offset, value=m.sign * offset.value),
        warnings=(
            *report.sentences,
            *fit_warnings(
                best, data, estimate, error, (settling, doubt), held_out=train is not None
            ),
            *parameter_warnings,
        ),
        settling=settling,
        starts=starts,
        candidates=candidates,
        measurement=replace(m, sections=tuple(map(_as_measured, m.sections))),
        predicted=_predicted(best, data),
        quality=report,
        settings={"model": best.method.kind, "sections": str(len(m.sections))},
    )


def _as_measured(section: RecordSection) -> RecordSection:
    """Measured part of a section: without history, and with gaps of the output as NaN."""
    bare = without_history(section)
    if bare.measured is None:
        return bare
    return replace(bare, y=np.where(bare.measured, bare.y, np.nan))


def _before(best: FittedModel, data: FitData) -> tuple[float, float, tuple[Start, ...]]:
    """Largest changes of readings by any and by unknown earlier motion, and its possible starts."""
    sections = data.sections
    assumed = _known_start(sections[0])
    if data.chain.creep_per_decade == 0.0:
        return 0.0, 0.0, (assumed,)
    quasi = [best.fit.model.simulate(s.u).values[:, None] for s in sections]
    outputs: dict[Start, list[Array]] = {}
    starts: tuple[Start, ...] = (assumed, "rested", 0.0, math.inf)
    for start in dict.fromkeys(starts):
        begun = replace(data, sections=with_start(sections, start))
        outputs[start] = [c[:, 0] for c in behind_chain(quasi, begun)]
    use, rows = data.use[0], data.rows
    rms: dict[Start, float] = {}
    for start, output in outputs.items():
        errors = [s.y[r.at] - c for c, s, r in zip(output, sections, rows, strict=True)]
        left = errors[0] - fitted_levels(errors, data)[0][rows[0].at]
        rms[start] = float(np.std(left[use] if use.any() else left))
    possible: list[Start] = [s for s, value in rms.items() if value <= _EQUAL * rms[assumed]]
    every = [np.concatenate(outputs[s]) for s in ("rested", 0.0, math.inf)]
    settling = float(np.max(np.ptp(every, axis=0)))
    if sections[0].periodic:
        return settling, 0.0, (assumed,)
    if "rested" in possible and np.max(np.abs(every[0] - every[1])) < _SAME_START * settling:
        possible = [s for s in possible if s != 0.0]  # a rest at the low end
    doubt = float(np.max(np.ptp([np.concatenate(outputs[s]) for s in possible], axis=0)))
    return settling, doubt, tuple(possible)


def _chain(estimate: ChainEstimate) -> tuple[ParameterEstimate, ...]:
    """Values of the chain with their standard errors."""
    return tuple(
        ParameterEstimate(name=name, value=getattr(estimate.values, name), standard_error=error)
        for name, error in estimate.errors.items()
    )


def _known_start(section: RecordSection) -> Start:
    """Start of a record for other motions: after many periods, it is motion for long."""
    return math.inf if section.periodic else section.start


def _drive_model(best: FittedModel, data: FitData) -> DriveModel:
    chain, rates = data.chain, data.rates_hz or (0.0, 0.0)
    levels, offset = best.residuals.baseline, best.residuals.offset
    ends = [
        data.sign * (s.y - level + offset)[s.warm_up :]
        for s, level in zip(data.sections, levels, strict=True)
    ]
    return DriveModel(
        hysteresis=best.fit.model,
        creep=chain.creep if chain.creep_per_decade > 0.0 else None,
        modes=chain.modes,
        lag=chain.lag if chain.delay > 0.0 else None,
        offset=data.sign * offset,
        sign=data.sign,
        input_unit=data.input_unit,
        output_unit=data.output_unit,
        validity=ValidityRange(
            input_range=data.input_range,
            output_range=(float(min(e.min() for e in ends)), float(max(e.max() for e in ends))),
            rate_range_hz=(rates[0], rates[-1]),
        ),
        start=_known_start(data.sections[0]),
        zero=data.zero,
    )


def _predicted(best: FittedModel, data: FitData) -> tuple[Array, ...]:
    readings = []
    for s, level in zip(data.sections, best.residuals.baseline, strict=True):
        quasi = best.fit.model.simulate(s.u).values[:, None]
        output = filtered_samples(quasi, s, data.chain)[:, 0] + level
        readings.append(data.sign * output[s.history :])
    return tuple(readings)


def identified_file(identification: Identification, records: Sequence[Record]) -> ModelFile:
    """Return the content of the model file of an identification, with its records."""
    origin = provenance(
        content_hash(tuple(r.source_hash for r in records)), identification.settings
    )
    return ModelFile(
        model=identification.model,
        provenance={
            **asdict(origin),
            "records": [{"file": r.source, "sha256": r.source_hash} for r in records],
        },
        errors={
            "rms": identification.rms_percent,
            "max": identification.max_percent,
            "heldout_rms": identification.heldout_rms_percent,
            "heldout_max": identification.heldout_max_percent,
            "heldout_free_constant": identification.heldout_free_rms_percent,
            "heldout_95": identification.heldout_band_percent,
        },
        warnings=identification.warnings,
    )
