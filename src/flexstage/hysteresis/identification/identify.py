"""From measured records to a model of the drive, with its errors and its warnings."""

import math
from collections.abc import Sequence
from dataclasses import asdict, replace
from typing import Any

import numpy as np

from flexstage.base import progress
from flexstage.base.arrays import Array
from flexstage.base.errors import ModelError, RecordError
from flexstage.base.provenance import content_hash, provenance
from flexstage.files.request import request_of
from flexstage.hysteresis.drive_model import DriveModel, Start, ValidityRange
from flexstage.hysteresis.identification.chain_search import FoundChain, find_chain, find_starts
from flexstage.hysteresis.identification.creep_spectrum import with_spectrum
from flexstage.hysteresis.identification.fit_rows import (
    ChainValues,
    averaged,
    filtered_whole,
    rows_of,
)
from flexstage.hysteresis.identification.measurement import (
    IdentificationData,
    measurement,
    without_history,
)
from flexstage.hysteresis.identification.misfit import (
    ParameterEstimate,
    another_stretch,
    cross_validate,
    estimates,
)
from flexstage.hysteresis.identification.model_choice import (
    Candidate,
    FittedModel,
    choose,
    failed_candidate,
    fit_model,
    passed_over,
    prediction_errors,
)
from flexstage.hysteresis.identification.model_fit import (
    FitData,
    behind_chain,
    fit_data,
    fits,
    models_named,
)
from flexstage.hysteresis.identification.record_section import RecordSection
from flexstage.hysteresis.identification.result import Identification
from flexstage.hysteresis.identification.verdict import remarks, stands_still, verdict
from flexstage.hysteresis.model_file import ModelFile
from flexstage.hysteresis.models.registry import MODELS
from flexstage.hysteresis.requests import IdentifyRequest
from flexstage.records import Record
from flexstage.records.drives import train_range

#: Samples of all records that models are fitted with; those of longer ones are averaged.
_MOST_SAMPLES = 40_000
#: What a drive did before is told by a misfit that is larger by this factor with anything else.
_ALIKE = 1.01
#: Two starts that differ by less than this share of what starts can change are the same.
_SAME_START = 0.05


def identify(
    records: Record | Sequence[Record],
    input_column: str | int,
    output_column: str | int,
    request: IdentifyRequest | None = None,
    *,
    chain: ChainValues | None = None,
    **asked: Any,
) -> Identification:
    """Identify the hysteresis of a drive and the linear chain behind it.

    Delay, creep and resonance are found first, by projection over a dictionary of hysteresis; then
    the model is fitted behind them. Where the problem is linear its optimum is the global one
    (non-negative least squares); elsewhere one or two parameters are searched for and the others
    are projected out (Golub and Pereyra 1973), or all are refined from the best simpler model.

    Parameters
    ----------
    records : Record or sequence of Record
        Records of one drive; those at two or more rates tell lag and creep from hysteresis.
    input_column : str or int
        The column that drives.
    output_column : str or int
        The column that follows.
    request : IdentifyRequest, optional
        Which models are tried, which samples are fitted, and what is known. Of several models, the
        simplest one is taken that is as good as the best on held-out cycles, within noise.
    chain : ChainValues, optional
        The chain where all of it is known; found where not given.
    **asked
        Fields of `IdentifyRequest`, in place of those of `request`.

    Returns
    -------
    Identification
        The model with its errors.

    Raises
    ------
    RecordError
        The records cannot serve.
    ModelError
        There is no such model.
    """
    request = request_of(IdentifyRequest, request, asked)
    known, resonance = request.known, request.known.mode
    if chain is None and known.has_lag:
        chain = ChainValues(delay=known.delay or 0.0, creep_per_decade=known.creep or 0.0)
    names = models_named(request.model)
    given = [records] if isinstance(records, Record) else list(records)
    train = train_range(request.train, given)
    data = measurement(given, input_column, output_column, drift=request.drift)
    progress.update("linear chain", 0.0)
    every = _data(data, ChainValues(), train)  # refuses a range that leaves too little
    data, found = _chain_and_start(data, chain, train, resonance)
    if chain is None:
        found = replace(found, values=with_spectrum(data, found.values, train=train))
    if train is None:  # whose samples are counted as they were recorded
        # models would take minutes with long records and gain nothing
        share = max(1, _MOST_SAMPLES // len(data.sections))
        short = replace(data, sections=tuple(averaged(s, share) for s in data.sections))
        every = _data(short, found.values, None)
    every = fit_data(data, found.values, every.rows, every.use) if train else every
    still = train is not None and stands_still(every)
    tried: dict[str, FittedModel] = {}
    failed: list[Candidate] = []
    for i, name in enumerate(names):
        progress.update(MODELS[name].title, 0.2 + 0.8 * i / len(names))
        try:
            tried[name] = fit_model(fits()[name], every, validate=train is None or still)
        except ModelError as error:
            failed.append(
                failed_candidate(fits()[name], f"it cannot be fitted to this record: {error}")
            )
    if not tried:
        raise ModelError("; ".join(f"{c.kind}: {c.failed}" for c in failed))
    chosen, candidates = choose(tried, every)
    made = _result(tried[chosen], (*candidates, *failed), every, found, train)
    made = replace(
        made,
        request=request,
        records=tuple(record.source for record in given),
        notes=tuple(sorted({note for record in given for note in record.notes})),
        warnings=(*made.warnings, *passed_over(tried, candidates)),
        settings={**made.settings, "fitted": _fitted(given, data, train)},
    )
    return made if request.temperature is None else _at(made, request.temperature)


def _chain_and_start(
    data: IdentificationData,
    chain: ChainValues | None,
    train: tuple[int, int] | None,
    resonance: tuple[float, float] | None,
) -> tuple[IdentificationData, FoundChain]:
    """Find the chain, and what the drive did before each record, by what they leave together."""
    found = find_chain(data, chain, train=train, resonance=resonance)
    starts, width = find_starts(data, found, train=train)
    if all(start == s.start for start, s in zip(starts, data.sections, strict=True)):
        return data, _wider(found, width)
    sections = [replace(s, start=start) for s, start in zip(data.sections, starts, strict=True)]
    data = replace(data, sections=tuple(sections))
    return data, _wider(find_chain(data, chain, train=train, resonance=resonance), width)


def _wider(found: FoundChain, width: float) -> FoundChain:
    """Add what is not known of the past of a drive to the error of its creep."""
    if "creep_per_decade" not in found.errors:
        return found
    error = math.hypot(found.errors["creep_per_decade"], width)
    return replace(found, errors={**found.errors, "creep_per_decade": error})


def _fitted(
    given: Sequence[Record], data: IdentificationData, train: tuple[int, int] | None
) -> str:
    """Say which samples of the records were fitted."""
    said = []
    for record, s in zip(given, data.sections, strict=True):
        first = s.first + s.warm_up - s.history
        stop = record.size
        if train is not None:
            first, stop = max(first, train[0]), min(stop, train[1])
        if stop <= first:
            said.append(f"none of {record.size} samples")
            continue
        begin, end = _times_in_file(record)[[first, stop - 1]]
        said.append(f"{stop - first} of {record.size} samples, {begin:.4g} to {end:.4g} s")
    return "; ".join(said)


def _times_in_file(record: Record) -> Array:
    """Times from the first sample of the file [s], of which a part may have been read."""
    numbers, since = record.numbers, record.time - record.time[0]
    if numbers is None or np.isnan(numbers).any():
        return since
    return since + float(numbers[0] * since[-1] / (numbers[-1] - numbers[0]))


def _at(made: Identification, temperature: tuple[float, float]) -> Identification:
    """Say at which temperature a model was identified."""
    if not 0.0 < temperature[0] <= temperature[1] < 2000.0:
        raise ModelError(
            f"the temperature must be a rising range in K, such as 294 to 297, got {temperature!r}"
        )
    assert made.model.validity is not None
    validity = replace(made.model.validity, temperature=temperature)
    return replace(made, model=replace(made.model, validity=validity))


def _data(data: IdentificationData, chain: ChainValues, train: tuple[int, int] | None) -> FitData:
    rows = rows_of(data.sections)
    if train is None:
        use = tuple(np.ones(r.at.size, dtype=bool) for r in rows)
    else:
        at = [r.at - s.history + s.first for r, s in zip(rows, data.sections, strict=True)]
        use = tuple((a >= train[0]) & (a < train[1]) for a in at)
        fitted, held = sum(int(u.sum()) for u in use), sum(int((~u).sum()) for u in use)
        if fitted < 50 or held < 50:
            raise RecordError(
                f"samples {train[0]} to {train[1]} leave {fitted} to fit and {held} to hold out, "
                "after the warm-up: at least 50 of each are needed"
            )
    return fit_data(data, chain, rows, use)


def _result(
    tried: FittedModel,
    candidates: tuple[Candidate, ...],
    data: FitData,
    found: FoundChain,
    train: tuple[int, int] | None,
) -> Identification:
    errors = prediction_errors(tried, data)
    cut = cross_validate(tried.method, data, tried.fit.search, stretches=True)
    if cut is not None and tried.folds is not None:
        percent = 100.0 / data.stroke
        own = another_stretch(
            tried.folds.rms, tried.folds.standard_error or 0.0, np.sqrt(cut.mean_square)
        )
        errors = replace(errors, held_band=cut.band * percent, held_error=own * percent)
    parts = tuple(f for f in (tried.folds, cut) if f is not None)
    parameters, offset, said = estimates(tried.fit, data, tried.left, parts, found.widths)
    settling, starts = _before(tried, data)
    m = data.measurement
    drive = _drive_model(tried, data)
    noise = max(s.noise for s in m.sections) * 100.0 / m.stroke
    error = max(errors.rms, errors.held or 0.0)
    judged = verdict(data, error, noise)
    return Identification(
        model=drive,
        kind=tried.method.kind,
        rms_percent=errors.rms,
        max_percent=errors.largest,
        heldout_rms_percent=errors.held,
        heldout_free_rms_percent=errors.held_free,
        heldout_standard_error=errors.held_error,
        heldout_max_percent=errors.held_largest,
        heldout_band_percent=errors.held_band,
        stroke=m.stroke,
        noise_percent=noise,
        parameters=parameters,
        chain=_chain(found),
        offset=replace(offset, value=m.sign * offset.value),
        warnings=(
            *judged.sentences,
            *remarks(tried, data, found, errors, settling, held_out=train is not None),
            *said,
        ),
        settling=settling,
        starts=starts,
        candidates=candidates,
        measurement=replace(m, sections=tuple(map(_as_measured, m.sections))),
        predicted=_predicted(tried, data),
        verdict=judged,
        settings={"model": tried.method.kind, "sections": str(len(m.sections))},
    )


def _as_measured(section: RecordSection) -> RecordSection:
    """A section without what was not measured: the time before it, and gaps of its output."""
    bare = without_history(section)
    if bare.measured is None:
        return bare
    return replace(bare, y=np.where(bare.measured, bare.y, np.nan))


def _before(tried: FittedModel, data: FitData) -> tuple[float, tuple[Start, ...]]:
    """How much what the drive did before may change readings, and which of it fits alike."""
    sections = data.sections
    kept = sections[0].start
    if data.chain.creep_per_decade == 0.0:
        return 0.0, (kept,)
    quasi = [tried.fit.model.simulate(s.u).values[:, None] for s in sections]
    ends: dict[Start, list[Array]] = {}
    for start in dict.fromkeys((kept, "rested", 0.0, math.inf)):
        moved = tuple(replace(s, start=start) for s in sections)
        own = replace(data, sections=moved)
        ends[start] = [c[:, 0] for c in behind_chain(quasi, own)]
    use = data.use[0]
    y = sections[0].y[data.rows[0].at]
    rms: dict[Start, float] = {}
    for start, (first, *_) in ends.items():
        rms[start] = float(np.std((y - first)[use] if use.any() else y - first))
    alike: list[Start] = [s for s, own in rms.items() if own <= _ALIKE * rms[kept]]
    every = [np.concatenate(ends[s]) for s in ("rested", 0.0, math.inf)]
    settling = float(np.max(np.ptp(every, axis=0)))
    if "rested" in alike and np.max(np.abs(every[0] - every[1])) < _SAME_START * settling:
        alike = [s for s in alike if s != 0.0]  # it rested at the low end
    return settling, tuple(alike)


def _chain(found: FoundChain) -> tuple[ParameterEstimate, ...]:
    """What was found of the chain, with its errors."""
    return tuple(
        ParameterEstimate(name=name, value=getattr(found.values, name), standard_error=error)
        for name, error in found.errors.items()
    )


def _drive_model(tried: FittedModel, data: FitData) -> DriveModel:
    chain, rates = data.chain, data.rates_hz or (0.0, 0.0)
    ends = [data.sign * s.y[s.warm_up :] for s in data.sections]
    return DriveModel(
        hysteresis=tried.fit.model,
        creep=chain.creep if chain.creep_per_decade > 0.0 else None,
        modes=chain.modes,
        lag=chain.lag if chain.delay > 0.0 else None,
        offset=data.sign * tried.left.offset,
        sign=data.sign,
        input_unit=data.input_unit,
        output_unit=data.output_unit,
        validity=ValidityRange(
            input_range=data.input_range,
            output_range=(float(min(e.min() for e in ends)), float(max(e.max() for e in ends))),
            rate_range_hz=(rates[0], rates[-1]),
        ),
        start=data.sections[0].start,
    )


def _predicted(tried: FittedModel, data: FitData) -> tuple[Array, ...]:
    made = []
    for s in data.sections:
        quasi = tried.fit.model.simulate(s.u).values[:, None]
        behind = filtered_whole(quasi, s, data.chain)[s.history :, 0]
        made.append(data.sign * (behind + tried.left.offset))
    return tuple(made)


def identified_file(found: Identification, read: Sequence[Record]) -> ModelFile:
    """Return the content of the model file of an identification, with the records that it is of."""
    origin = provenance(content_hash(tuple(r.source_hash for r in read)), found.settings)
    return ModelFile(
        model=found.model,
        provenance={
            **asdict(origin),
            "records": [{"file": r.source, "sha256": r.source_hash} for r in read],
        },
        errors={
            "rms": found.rms_percent,
            "max": found.max_percent,
            "heldout_rms": found.heldout_rms_percent,
            "heldout_max": found.heldout_max_percent,
            "heldout_free_constant": found.heldout_free_rms_percent,
            "heldout_95": found.heldout_band_percent,
        },
        warnings=found.warnings,
    )
