"""From measured records to a model of the drive, with its errors and its warnings."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from flexstage.errors import ModelError, RecordError
from flexstage.hysteresis.drive_model import DriveModel, ValidityRange
from flexstage.hysteresis.identification.chain_filter import ChainValues, rows_of
from flexstage.hysteresis.identification.chain_search import FoundChain, find_chain
from flexstage.hysteresis.identification.creep_spectrum import with_spectrum
from flexstage.hysteresis.identification.families import FAMILIES
from flexstage.hysteresis.identification.families.family import Data, Family, Fit
from flexstage.hysteresis.identification.measurement import Measurement, measurement, thinned
from flexstage.hysteresis.identification.misfit import Folds, Misfit, cross_validate, misfit
from flexstage.hysteresis.identification.uncertainty import Estimate, estimates
from flexstage.progress import tell
from flexstage.records import Record

__all__ = ["Candidate", "Identification", "identify"]

#: Stages ring at some 100 Hz: faster cycles than these may show it.
_SHOWS_MODES_HZ = 10.0
#: Samples of all records that models are fitted with, where the cycles keep so many each.
_MOST_SAMPLES = 120_000
_CYCLE_SAMPLES = 400

Array = NDArray[np.float64]

#: A model that leaves more than this many times what the best one leaves is not as good, ...
_SAME = 1.1
#: ... and of those that leave less than this nothing is better [% of the stroke].
_NOTHING = 1e-5
#: A sample further off than this many times the typical distance is none of the motion.
_FAR_OFF = 12.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Candidate:
    """One of the models that were tried.

    Parameters
    ----------
    kind : str
        Name of the model.
    size : int
        Number of its parameters.
    rms_percent : float
        Root mean square of what it leaves, over the stroke [%].
    heldout_rms_percent : float or None
        The same on cycles that it was not fitted to [%].
    heldout_error_percent : float
        How much the held-out figure differs from the best one by chance [%].
    """

    kind: str
    size: int
    rms_percent: float
    heldout_rms_percent: float | None
    heldout_error_percent: float = 0.0


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Identification:
    """A model of a drive, and how far it can be trusted.

    Parameters
    ----------
    model : DriveModel
        The model.
    kind : str
        Name of the hysteresis model.
    rms_percent : float
        Root mean square of output less model where it was fitted, over the stroke [%].
    max_percent : float
        Largest absolute value of that [%].
    heldout_rms_percent : float or None
        Root mean square on cycles that the model was not fitted to [%]; None where there are none.
    heldout_max_percent : float or None
        Largest absolute value there [%].
    stroke : float
        Range of the output, in its unit.
    noise_percent : float
        Estimated noise of the output, over the stroke [%].
    parameters : tuple of Estimate
        Parameters that mean something by themselves, with standard errors.
    chain : tuple of Estimate
        Values of the linear chain that were found, with standard errors.
    warnings : tuple of str
        What the records cannot tell, and which experiment is missing.
    candidates : tuple of Candidate
        All models that were tried, the chosen one first.
    measurement : Measurement
        What it was identified from. Records of more than 120 000 samples are thinned evenly, as far
        as the fastest cycle keeps 400 of its samples.
    predicted : tuple of numpy.ndarray
        Output of the model beside each section, with its offset and settling, shape (n,).
    settings : Mapping
        Choices that change the result.
    """

    model: DriveModel
    kind: str
    rms_percent: float
    max_percent: float
    heldout_rms_percent: float | None
    heldout_max_percent: float | None
    stroke: float
    noise_percent: float
    parameters: tuple[Estimate, ...]
    chain: tuple[Estimate, ...]
    warnings: tuple[str, ...]
    candidates: tuple[Candidate, ...]
    measurement: Measurement
    predicted: tuple[Array, ...]
    settings: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Tried:
    """A family with its fit, and what it leaves."""

    family: Family
    fit: Fit
    left: Misfit
    folds: Folds | None


def identify(
    records: Record | Sequence[Record],
    input_column: str | int,
    output_column: str | int,
    *,
    model: str | Sequence[str] = "auto",
    chain: ChainValues | None = None,
    train: tuple[int, int] | None = None,
    resonance: tuple[float, float] | None = None,
    temperature: tuple[float, float] | None = None,
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
    model : str or sequence of str
        Name of a model, or of several; ``auto`` is all of them. Of several, the simplest one is
        taken that is as good as the best on held-out cycles, within noise.
    chain : ChainValues, optional
        The chain where it is known; found where not given.
    train : tuple of int, optional
        First sample to fit, and the one after the last, of every record; the others are held out.
        All are fitted where not given, and held-out errors come from cross-validation over cycles.
    resonance : tuple of float, optional
        Frequency [Hz] and damping ratio of a mode that is known, as from a model of the stage with
        its drives in place; looked for where not given.
    temperature : tuple of float, optional
        Lowest and highest temperature while it was recorded [K], for the validity of the model.

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
    wanted = (model,) if isinstance(model, str) else tuple(model)
    names = tuple(FAMILIES) if wanted == ("auto",) else wanted
    if not names:
        raise ModelError(f"no model is named: choose from auto, {', '.join(FAMILIES)}")
    for name in names:
        if name not in FAMILIES:
            raise ModelError(
                f"the model '{name}' is not known: choose from auto, {', '.join(FAMILIES)}"
            )
    given = [records] if isinstance(records, Record) else list(records)
    data = measurement(given, input_column, output_column)
    tell("linear chain", 0.0)
    every = _data(data, ChainValues(), train)  # refuses a range that leaves too little
    found = find_chain(data, chain, train=train, resonance=resonance)
    if chain is None:
        found = replace(found, values=with_spectrum(data, found.values, train=train))
    if train is None:  # whose samples are counted as they were recorded
        every = _data(_thinned(data, found), found.values, None)
    every = replace(every, chain=found.values)
    tried: dict[str, _Tried] = {}
    for i, name in enumerate(names):
        tell(FAMILIES[name].title, 0.2 + 0.8 * i / len(names))
        try:
            tried[name] = _try(FAMILIES[name], every, validate=train is None)
        except ModelError:
            if len(names) == 1:
                raise
    if not tried:
        raise ModelError("none of the models could be fitted to the records: name one to see why")
    chosen, candidates = _choose(tried, every)
    made = _result(tried[chosen], candidates, every, found, train)
    return made if temperature is None else _at(made, temperature)


def _at(made: Identification, temperature: tuple[float, float]) -> Identification:
    """Say at which temperature a model was identified."""
    if not 0.0 < temperature[0] <= temperature[1] < 2000.0:
        raise ModelError(
            f"the temperature must be a rising range in K, such as 294 to 297, got {temperature!r}"
        )
    assert made.model.validity is not None
    validity = replace(made.model.validity, temperature=temperature)
    return replace(made, model=replace(made.model, validity=validity))


def _thinned(data: Measurement, found: FoundChain) -> Measurement:
    """Leave samples of long records out, which models would take minutes with and gain nothing."""
    share = max(1, _MOST_SAMPLES // len(data.sections))
    mode = found.values.resonance_hz if found.resonance is not None else 0.0
    sections = tuple(thinned(s, share, _CYCLE_SAMPLES, mode) for s in data.sections)
    return replace(data, sections=sections)


def _data(data: Measurement, chain: ChainValues, train: tuple[int, int] | None) -> Data:
    rows = rows_of(data)
    if train is None:
        use = tuple(np.ones(r.at.size, dtype=bool) for r in rows)
    else:
        use = tuple((r.at >= train[0]) & (r.at < train[1]) for r in rows)
        fitted, held = sum(int(u.sum()) for u in use), sum(int((~u).sum()) for u in use)
        if fitted < 50 or held < 50:
            raise RecordError(
                f"samples {train[0]} to {train[1]} leave {fitted} to fit and {held} to hold out, "
                "after the warm-up: at least 50 of each are needed"
            )
    return Data(measurement=data, chain=chain, rows=rows, use=use)


def _try(family: Family, data: Data, *, validate: bool) -> _Tried:
    fit = family.fit(data)
    folds = cross_validate(family, data, fit.search) if validate else None
    return _Tried(family=family, fit=fit, left=misfit(fit.model, data), folds=folds)


def _errors(tried: _Tried, data: Data) -> tuple[float, float, float | None, float | None]:
    """Rms and largest error where fitted and where held out, over the stroke [%]."""
    percent = 100.0 / data.measurement.stroke
    own = tried.left.at(data.use) * percent
    rms, largest = float(np.sqrt(np.mean(own**2))), float(np.max(np.abs(own)))
    if tried.folds is not None:
        return rms, largest, tried.folds.rms * percent, tried.folds.largest * percent
    held = tuple(~u for u in data.use)
    if not any(h.any() for h in held):
        return rms, largest, None, None
    other = tried.left.at(held) * percent
    return rms, largest, float(np.sqrt(np.mean(other**2))), float(np.max(np.abs(other)))


def _choose(tried: Mapping[str, _Tried], data: Data) -> tuple[str, tuple[Candidate, ...]]:
    """Take the simplest model that is as good as the best on held-out cycles, within noise."""
    rows = {name: _errors(t, data) for name, t in tried.items()}
    score = {n: r[2] if r[2] is not None else r[0] for n, r in rows.items()}
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
    chosen = min(close, key=lambda n: (tried[n].family.size, score[n]))
    order = [chosen, *sorted((n for n in score if n != chosen), key=lambda n: score[n])]
    return chosen, tuple(
        Candidate(
            kind=n,
            size=tried[n].family.size,
            rms_percent=rows[n][0],
            heldout_rms_percent=rows[n][2],
            heldout_error_percent=spread[n] / max(2.0 * score[n], 1e-300),
        )
        for n in order
    )


def _invertible(tried: _Tried) -> bool:
    return all(c.holds for c in tried.fit.model.conditions() if c.name == "invertible")


def _by_chance(own: Folds | None, best: Folds | None, data: Data) -> float:
    """Standard error of the difference of two held-out mean squares, from part to part [%^2]."""
    if own is None or best is None:
        return 0.0
    difference = (own.mean_square - best.mean_square) * (100.0 / data.measurement.stroke) ** 2
    return float(np.std(difference, ddof=1) / np.sqrt(difference.size))


def _result(
    tried: _Tried,
    candidates: tuple[Candidate, ...],
    data: Data,
    found: FoundChain,
    train: tuple[int, int] | None,
) -> Identification:
    rms, largest, held, held_largest = _errors(tried, data)
    parameters, said = estimates(tried.fit, data, tried.left, found.searched)
    own = len(tried.fit.names)
    m = data.measurement
    drive = _drive_model(tried, data)
    percent = 100.0 / m.stroke
    settings = {"model": tried.family.kind, "sections": str(len(m.sections))}
    if train is not None:
        settings["fitted samples"] = f"{train[0]} to {train[1]}"
    return Identification(
        model=drive,
        kind=tried.family.kind,
        rms_percent=rms,
        max_percent=largest,
        heldout_rms_percent=held,
        heldout_max_percent=held_largest,
        stroke=m.stroke,
        noise_percent=max(s.noise for s in m.sections) * percent,
        parameters=parameters[:own],
        chain=(*parameters[own:], *_resonance(found)),
        warnings=(
            *m.warnings,
            *_hidden_mode(found, m),
            *_left_out(tried, data),
            *_broken(tried),
            *tried.fit.notes,
            *said,
        ),
        candidates=candidates,
        measurement=m,
        predicted=_predicted(tried, data),
        settings=settings,
    )


def _left_out(tried: _Tried, data: Data) -> tuple[str, ...]:
    """Say where samples lie far off, as spikes do: they pull a least-squares fit."""
    left = np.abs(tried.left.at(data.use))
    # most samples of a perfect record differ by rounding alone, of which nothing is far off
    typical = max(1.4826 * float(np.median(left)), 1e-4 * data.measurement.stroke)
    far = int(np.sum(left > _FAR_OFF * typical))
    if far == 0 or far > 0.01 * left.size:
        return ()
    return (
        f"{far} samples lie more than {_FAR_OFF:g} times the typical error off the model, as "
        "spikes do: look at the record, and take them out",
    )


def _resonance(found: FoundChain) -> tuple[Estimate, ...]:
    """The resonance where it was found by itself, and not along with the chain."""
    if found.resonance is None:
        return ()
    mode = found.resonance
    frequency = Estimate(
        name="resonance_hz", value=mode.frequency_hz, standard_error=mode.frequency_error_hz
    )
    if "delay" in found.searched:
        return (frequency,)
    return Estimate(name="delay", value=mode.delay, standard_error=mode.delay_error), frequency


def _hidden_mode(found: FoundChain, data: Measurement) -> tuple[str, ...]:
    """Warn of a resonance that may hide in creep: it too makes fast cycles other than slow ones."""
    if found.values.resonance_hz > 0.0 or len(data.rates_hz) < 2 or not found.searched:
        return ()
    fastest = data.rates_hz[-1]
    if fastest < _SHOWS_MODES_HZ:
        return ()
    return (
        f"no resonance was seen: one below {30.0 * fastest:.3g} Hz would change cycles at "
        f"{fastest:.3g} Hz by 0.1 % and more, and be taken for creep; name it, or record a small "
        "multisine about it",
    )


def _broken(tried: _Tried) -> tuple[str, ...]:
    return tuple(
        f"{tried.family.title}: not {c.name}: {c.detail}"
        for c in tried.fit.model.conditions()
        if not c.holds
    )


def _drive_model(tried: _Tried, data: Data) -> DriveModel:
    m, chain = data.measurement, data.chain
    rates = m.rates_hz or (0.0, 0.0)
    ends = [m.sign * s.y[s.warm_up :] for s in m.sections]
    return DriveModel(
        hysteresis=tried.fit.model,
        creep=chain.creep if chain.creep_per_decade > 0.0 else None,
        modes=chain.modes,
        lag=chain.lag if chain.delay > 0.0 else None,
        offset=m.sign * float(tried.left.nuisance[0][0]),
        sign=m.sign,
        input_unit=m.input_unit,
        output_unit=m.output_unit,
        validity=ValidityRange(
            input_range=m.input_range,
            output_range=(float(min(e.min() for e in ends)), float(max(e.max() for e in ends))),
            rate_range_hz=(rates[0], rates[-1]),
        ),
    )


def _predicted(tried: _Tried, data: Data) -> tuple[Array, ...]:
    from flexstage.hysteresis.identification.chain_filter import Rows, filtered

    made = []
    for s, own in zip(data.measurement.sections, tried.left.nuisance, strict=True):
        at = np.arange(s.u.size)
        rows = Rows(at=at, cycle=at)
        quasi = tried.fit.model.simulate(s.u).values[:, None]
        made.append(
            data.measurement.sign * (filtered(quasi, s, rows, data.chain)[:, 0] + s.nuisance @ own)
        )
    return tuple(made)
