"""Search for the linear chain behind an unknown hysteresis."""

import itertools
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any, ClassVar

import numpy as np
from scipy.optimize import minimize, minimize_scalar

from flexstage.base.arrays import Array
from flexstage.hysteresis.chain.creep import Start
from flexstage.hysteresis.identification.chain_residual import (
    ChainResidual,
    SpectrumFit,
    is_better,
)
from flexstage.hysteresis.identification.cycles import (
    RecordSection,
    memories,
    possible_starts,
    with_start,
)
from flexstage.hysteresis.identification.fit_rows import ChainValues
from flexstage.hysteresis.identification.jump_response import jump_response
from flexstage.hysteresis.identification.measurement import (
    IdentificationData,
    with_history,
    without_history,
)
from flexstage.hysteresis.identification.model_fit import (
    FitData,
    behind_chain,
    equations,
)
from flexstage.hysteresis.identification.projection import residual_square, solve
from flexstage.hysteresis.identification.resonance_search import Resonance, find_resonance
from flexstage.hysteresis.models.line.law import Line

#: A drive is assumed to have rested before a record unless another start reduces the residual by
#: this factor.
_BETTER = 0.99

#: Motion of a drive before a record, for its creep: rest, none since the low end, long motion.
_STARTS: tuple[Start, ...] = ("rested", 0.0, math.inf)
#: The usual memory is assumed unless another reduces the residual by this factor: less is within
#: the error of a coarse dictionary.
_OTHER_MEMORY = 0.9

#: Largest delay, as a share of the shortest cycle.
_LONGEST_DELAY = 0.08
#: Delays of the first search with a spectrum of creep, and about the best one of these for a
#: second one, as shares of the largest.
_DELAYS = 0.0, 0.05, 0.1, 0.2, 0.45, 1.0
_NEAR = -0.06, -0.03, 0.0, 0.03, 0.06
#: Largest creep [1 per decade].
_LARGEST_CREEP = 0.12
#: Creep of piezo stacks [1 per decade], and half of the range in data sheets (1 to 2 %: Physik
#: Instrumente, Piezo Tutorial, "Creep"): prior for records of one rate, which hide creep.
_USUAL_CREEP, _CREEP_RANGE = 0.015, 0.005
#: Number of values of creep between the best and the usual one.
_CREEP_STEPS = 11
#: Records have a common offset if it increases the residual by less than this factor.
_COMMON_OFFSET = 1.5
#: Starts whose residuals are within this factor of the least are all possible.
_POSSIBLE = 1.25
#: Largest ratio of a resonance to the rate of the fastest cycles, ...
_FARTHEST_RESONANCE = 60.0
#: ... smallest reduction of the residual by a resonance, ...
_REDUCTION = 0.02
#: A spectrum of creep is used if it reduces the mean square of a typical part by this share: a
#: coarse dictionary reduces that of logarithmic creep by an eighth as well, ...
_SPECTRUM_REDUCTION = 0.2
#: ... and with a free delay by a third.
_JOINT_REDUCTION = 0.5
#: ... and smallest reduction on the coarse grid for a search.
_COARSE_REDUCTION = 0.002


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ChainEstimate:
    """Best linear chain of a measurement, for any hysteresis."""

    #: Piezo drives creep by 1 to 3 % per decade of time: a larger value has another cause.
    high_creep: ClassVar[float] = 0.05

    values: ChainValues
    """The chain."""
    searched: tuple[str, ...] = ()
    """The values that were searched for, and not given."""
    errors: Mapping[str, float] = field(default_factory=dict)
    """Standard errors of the values; infinite if the records do not determine them."""
    longest_delay: float = math.inf
    """Largest delay of the search [s]."""
    ringing_hz: float = 0.0
    """Frequency of ringing after jumps that is not one mode [Hz]; 0 for none."""

    @property
    def widths(self) -> Mapping[str, float]:
        """Standard error of each searched value, of undetermined creep that of its search range."""
        any_creep = {"creep_per_decade": _LARGEST_CREEP / math.sqrt(12.0)}
        return {
            name: error if math.isfinite(error) else any_creep.get(name, 0.0)
            for name, error in self.errors.items()
            if name in self.searched
        }

    @property
    def notes(self) -> tuple[str, ...]:
        """Warnings of unexplained ringing, and of values beyond those of piezo drives."""
        notes, creep = [], self.values.creep_per_decade
        if self.ringing_hz > 0.0:
            notes.append(
                f"after jumps of the input the output rings at about {self.ringing_hz:.4g} Hz; "
                "this is not the ringing of one mode and is not in the model: give the mode by "
                "--known, or record a small multisine around it"
            )
        if self.searched and self.values.delay > 0.99 * self.longest_delay:
            notes.append(
                f"the delay reached its upper limit ({1e3 * self.longest_delay:.3g} ms, "
                f"{100 * _LONGEST_DELAY:g} % of the fastest cycle): check the columns and the "
                "sample rate, or give the delay by --known"
            )
        if self.searched and self.values.spectrum is None and creep > 0.99 * _LARGEST_CREEP:
            notes.append(
                f"the creep reached its upper limit ({100 * _LARGEST_CREEP:g} % per decade): "
                "another effect is mistaken for creep, such as a drift of the output (compare "
                "with --zero drift), a slow sensor or noise of the input"
            )
        elif self.searched and creep > self.high_creep:
            of = "" if self.values.spectrum is None else " on average over its spectrum"
            notes.append(
                f"creep of {100.0 * creep:.2g} % per decade{of} is more than that of piezo drives "
                "(1 to 3 %): a drift of the output (compare with --zero drift), a shift of its "
                "baseline or a slow sensor may be mistaken for creep"
            )
        return tuple(notes)


def find_chain(
    data: IdentificationData,
    chain: ChainValues | None = None,
    *,
    train: tuple[int, int] | None = None,
    resonance: tuple[float, float] | None = None,
) -> ChainEstimate:
    """Find delay, creep and resonance by projection over a dictionary of hysteresis.

    A small Preisach model represents any hysteresis. For each chain its best density follows from
    non-negative least squares, and the residual is a function of the chain alone.

    Parameters
    ----------
    data : IdentificationData
        The measurement.
    chain : ChainValues, optional
        The known chain; nothing is searched for then.
    train : tuple of int, optional
        First sample to use, and the one after the last, of every record; all where not given.
    resonance : tuple of float, optional
        Frequency [Hz] and damping ratio of a mode that is known, as from a model of the stage.

    Returns
    -------
    ChainEstimate
        The chain.

    Examples
    --------
    >>> import numpy as np
    >>> from flexstage.hysteresis.identification.measurement import measurement
    >>> from flexstage.records import Channel, Record
    >>> t = np.arange(4000) / 200.0
    >>> def drive(t):
    ...     return 60.0 - (60.0 - 2.0 * t) * np.cos(2.0 * np.pi * t)
    >>> u, y = Channel(name="u", values=drive(t)), Channel(name="y", values=drive(t - 0.007))
    >>> chain = find_chain(measurement([Record(channels=(u, y), time=t)], "u", "y"))
    >>> round(chain.values.delay, 3)
    0.007
    """
    if chain is not None:
        return ChainEstimate(values=chain)
    search = ChainResidual(data, train)
    longest = max(10.0 * s.u.size * s.dt for s in data.sections)
    start = ChainValues(creep_longest=max(1000.0, longest))
    sections = _fitted_parts(data, train)
    jumps, excited = _best_jump_response(sections), None
    if resonance is not None:
        start = replace(start, resonance_hz=resonance[0], damping_ratio=resonance[1])
        search.fix_modes(start)
    else:
        excited = _excited_resonance(sections)
        if excited is None and jumps is not None and jumps.frequency_hz > 0.0:
            excited = jumps
    if excited is not None:
        start = replace(
            start,
            resonance_hz=excited.frequency_hz,
            damping_ratio=excited.damping_ratio,
            resonance_share=excited.share,
            delay=excited.delay,
        )
        search.fix_modes(start)
        estimate = _with_delay(search, start, excited.delay_error, data)
        errors = {**estimate.errors, "resonance_hz": excited.frequency_error_hz}
        return replace(estimate, errors=errors)
    estimate = _by_cycles(search, start, data, modes=resonance is None)
    if jumps is None:
        return estimate
    # with a known mode, and its ringing, jumps determine the delay
    no_mode_found = estimate.values.resonance_hz == start.resonance_hz
    if jumps.delay_error < estimate.errors["delay"] and no_mode_found:
        at = replace(start, delay=jumps.delay)
        estimate = _with_delay(search, at, jumps.delay_error, data)
    ringing_hz = jumps.unexplained_hz if resonance is None else 0.0
    return replace(estimate, ringing_hz=ringing_hz)


def find_memories(
    data: IdentificationData, estimate: ChainEstimate, *, train: tuple[int, int] | None = None
) -> IdentificationData:
    """Return the records with the motion before them that set the memory of the hysteresis.

    It matters until both ends of the range were reached. If samples before that are counted, all
    samples of the record are compared with each memory, with the best start of creep. Creep is the
    usual one unless it is known: a free one would replace the memory.

    Validity: motion that ended with a loop inside the range leaves a memory that is none of these;
    a single record of one closed loop fits almost any memory.
    """
    late = [i for i, s in enumerate(data.sections) if s.both_ends > s.warm_up]
    chain = estimate.values
    if estimate.searched:
        chain = replace(chain, creep_per_decade=_USUAL_CREEP)
    sections = [
        replace(s, warm_up=s.history) if i in late else s for i, s in enumerate(data.sections)
    ]
    search = ChainResidual(replace(data, sections=tuple(sections)), train)
    if chain.resonance_hz > 0.0:
        search.fix_modes(chain)
    names = tuple(memories((0.0, 1.0), 0.0))
    best: dict[int, str] = {}
    least, start = math.inf, _STARTS[0]
    # first the same memory of all records, then another one of each
    for memory in names:
        for i in late:
            search.set_memory(i, memory)
        residuals: dict[Start, float] = {}
        for trial in _STARTS:
            search.set_starts((trial,) * len(sections))
            residuals[trial] = search.rms(chain)
        trial = min(residuals, key=lambda t: residuals[t])
        if residuals[trial] < _OTHER_MEMORY * least:
            best, least, start = dict.fromkeys(late, memory), residuals[trial], trial
    search.set_starts((start,) * len(sections))
    for i, memory in itertools.product(late if len(late) > 1 else (), names):
        trial_memories = {**best, i: memory}
        for k in late:
            search.set_memory(k, trial_memories[k])
        if (rms := search.rms(chain)) < _OTHER_MEMORY * least:
            best, least = trial_memories, rms
    for i, memory in best.items():
        bare = without_history(data.sections[i])
        sections[i] = with_history(replace(bare, memory=memory))
    return replace(data, sections=tuple(sections))


def find_starts(
    data: IdentificationData, estimate: ChainEstimate, *, train: tuple[int, int] | None = None
) -> tuple[tuple[Start, ...], float]:
    """Find the motion of the drive before each record, which affects its creep.

    Delay and creep, unless known, are searched for with each possible start. The drive is assumed
    to have rested unless another start reduces the residual. `train` is the first sample to use,
    and the one after the last, of every record. The second result is the standard error that the
    unknown start adds to the creep [1].
    """
    best: tuple[Start, ...] = tuple(s.start for s in data.sections)
    no_creep = not estimate.searched and estimate.values.creep_per_decade == 0.0
    if no_creep or data.periodic:
        return best, 0.0
    search = ChainResidual(data, train)
    chain = replace(estimate.values, delay=0.0, creep_per_decade=0.0)
    if chain.resonance_hz > 0.0:
        search.fix_modes(chain)
    every = possible_starts(data.sections)
    chains, residuals = [], []
    for start in every:
        search.set_starts((start,) * len(best))
        if not estimate.searched or (start == every[0] and len(data.rates_hz) > 1):
            chains.append(estimate.values)
        elif "delay" not in estimate.searched:
            chains.append(_creep(search, replace(chain, delay=estimate.values.delay)))
        else:
            chains.append(_delay_and_creep(search, chain, _longest_delay(data)))
        residuals.append([search.rms(chains[-1], common=common) for common in (False, True)])
    # the records have a common offset if some start makes it likely
    common = any(offset <= _COMMON_OFFSET * free for free, offset in residuals)
    k = _likeliest([rms[common] for rms in residuals], _BETTER)
    values, least = chains[k], residuals[k][common]
    best = tuple(s.start for s in with_start(data.sections, every[k]))
    # a start is possible by either residual: offsets may differ for an unknown reason
    limits = _POSSIBLE * np.min(residuals, axis=0)
    width = max(
        abs(c.creep_per_decade - values.creep_per_decade)
        for c, rms in zip(chains, residuals, strict=True)
        if np.any(rms <= limits)
    )
    if len(best) > 1 and values.creep_per_decade > 0.0:
        for i, start in itertools.product(range(len(best)), every):
            trial = (*best[:i], start, *best[i + 1 :])
            if not data.sections[i].periodic:
                search.set_starts(trial)
                if (rms := search.rms(values, common=common)) < _BETTER * least:
                    best, least = trial, rms
    # the largest change is two standard errors
    return best, 0.5 * width


def with_spectrum(
    data: IdentificationData, estimate: ChainEstimate, *, train: tuple[int, int] | None = None
) -> tuple[IdentificationData, ChainEstimate]:
    """Fit a weight of creep for each time constant, and with it the delay and the starts.

    Delay and starts follow from three or more rates; otherwise, and if they do not halve the mean
    square of held-out records, they are those of the estimate. Data and estimate are returned
    unchanged at one rate, where hysteresis and spectrum cannot be separated, for steady loops at
    two rates, which determine one number of creep, if the rms error of held-out cycles falls by
    less than a tenth, and if that with a common zero rises.

    Validity: records of one drive in one state. Differences between records of different rates for
    another reason, such as the range of a sensor or the temperature, are mistaken for relaxation.
    """
    rates = data.rates_hz
    if len(rates) < 2 or (len(rates) < 3 and all(s.periodic for s in data.sections)):
        return data, estimate
    joint = None
    if len(rates) > 2 and "delay" in estimate.searched:
        joint = _joint_spectrum(data, estimate, train)
    if joint is not None:
        return joint
    fit = SpectrumFit(data, estimate.values, train, joint=False)
    chain, _ = fit.best(np.array([estimate.values.delay]))
    before, after = fit.left_out(estimate.values), fit.of_parts(chain)
    is_worse = chain.spectrum is None or fit.squares(chain)[1] > fit.squares(estimate.values)[1]
    if is_worse or not is_better(before, after, _SPECTRUM_REDUCTION):
        return data, estimate
    return data, replace(estimate, values=chain)


def _joint_spectrum(
    data: IdentificationData, estimate: ChainEstimate, train: tuple[int, int] | None
) -> tuple[IdentificationData, ChainEstimate] | None:
    """Fit delay, spectrum and starts: first for any start of each record, then for likely ones."""
    before, longest = estimate.values, _longest_delay(data)
    fit = SpectrumFit(data, before, train, joint=True)
    fit_before, (square, square_common) = fit, fit.squares(before)
    delays = np.union1d(longest * np.array(_DELAYS), min(before.delay, longest))
    chain, least = fit.with_any_start().best(delays)
    if least > (1.0 - _JOINT_REDUCTION) * square or chain.spectrum is None:
        return None
    fit, sections = _spectrum_starts(fit, data, chain.delay)
    near = np.unique(np.clip(chain.delay + longest * np.array(_NEAR), 0.0, longest))
    chain, _ = fit.best(near)
    if chain.spectrum is None or fit.squares(chain)[1] > square_common:
        return None
    if not is_better(fit_before.left_out(before), fit.of_parts(chain), _JOINT_REDUCTION):
        return None
    # those of both grids, without any that differ by rounding alone
    delays = np.unique(np.round(np.append(delays, near) / longest, 6)) * longest
    errors = fit.errors(chain, delays)
    known = {n: e for n, e in errors.items() if n in estimate.errors}
    return replace(data, sections=sections), replace(
        estimate,
        values=chain,
        errors={**estimate.errors, **known},
        longest_delay=longest,
    )


def _spectrum_starts(
    fit: SpectrumFit, data: IdentificationData, delay: float
) -> tuple[SpectrumFit, tuple[RecordSection, ...]]:
    """Find the motion before the records, the same for all that are not periodic."""
    every = possible_starts(data.sections)
    trials = [fit.with_start(start) for start in every]
    squares = [trial.squares(trial.best(np.array([delay]))[0]) for trial in trials]
    # the records have a common offset if some start makes it likely
    free, offset = np.min(squares, axis=0)
    common = int(offset <= _COMMON_OFFSET**2 * free)
    k = _likeliest([square[common] for square in squares], _BETTER**2)
    return trials[k], with_start(data.sections, every[k])


def _likeliest(residuals: Sequence[float], better: float) -> int:
    """Return the first of some residuals, or one that is less by a factor, from first to last."""
    best = 0
    for k, residual in enumerate(residuals):
        best = k if residual < better * residuals[best] else best
    return best


def _with_delay(
    search: ChainResidual, start: ChainValues, delay_error: float, data: IdentificationData
) -> ChainEstimate:
    """Estimate creep, with all other values known."""
    names = ("creep_per_decade",) if _shows_creep(data) else ()
    best = _creep(search, start) if names else start
    errors = {"delay": delay_error, **_errors(search, best, names, data)}
    return ChainEstimate(values=best, searched=names, errors=errors)


def _by_cycles(
    search: ChainResidual, start: ChainValues, data: IdentificationData, *, modes: bool
) -> ChainEstimate:
    """Estimate the chain from cycles alone."""
    longest = _longest_delay(data)
    names: tuple[str, ...] = ("delay",)
    if not _shows_creep(data):
        best = _delay(search.rms, start, longest)
    else:
        best, names = _delay_and_creep(search, start, longest), (*names, "creep_per_decade")
        if len(data.rates_hz) < 2:
            best = _with_usual_creep(search, best, longest)
    with_mode = _resonance(search, best, data, longest) if modes else None
    if with_mode is not None and search.rms(with_mode) < (1.0 - _REDUCTION) * search.rms(best):
        best, names = with_mode, (*names, "resonance_hz")
    errors = _errors(search, best, names, data)
    return ChainEstimate(values=best, searched=names, errors=errors, longest_delay=longest)


def _with_usual_creep(search: ChainResidual, best: ChainValues, longest: float) -> ChainValues:
    """Combine the creep of cycles of one rate with the usual creep of piezo stacks.

    Hysteresis and slow drift cannot be separated from creep there, so that the best creep is often
    a multiple of that of held-out stretches. Between the best and the usual creep, the value is
    selected that minimises a sum of two terms: the square of Student's t of the logarithm of the
    ratio of held-out residuals, and twice the logarithm of a Cauchy prior, whose tails allow for
    drives of another kind.
    """
    fitted, usual = best.creep_per_decade, _USUAL_CREEP
    shortest = _delay(search.rms, replace(best, creep_per_decade=usual), longest).delay

    def between(share: float) -> ChainValues:
        # along the valley of the residual: more creep goes with less delay
        return replace(
            best,
            delay=best.delay + share * (shortest - best.delay),
            creep_per_decade=fitted + share * (usual - fitted),
        )

    shares = np.linspace(0.0, 1.0, _CREEP_STEPS)
    held_out = np.array([search.held_out(between(share)) for share in shares])
    if held_out.shape[1] < 3:
        return best
    # residuals of stretches differ, their ratios less
    worse = np.log(np.maximum(held_out, 1e-300) / np.maximum(held_out[0], 1e-300))
    error = np.std(worse, axis=1, ddof=1) / math.sqrt(held_out.shape[1])
    t = np.maximum(worse.mean(axis=1), 0.0) / np.maximum(error, 1e-300)
    unusual = (1.0 - shares) * (fitted - usual) / _CREEP_RANGE
    return between(float(shares[int(np.argmin(t**2 + 2.0 * np.log1p(unusual**2)))]))


def _shows_creep(data: IdentificationData) -> bool:
    """Return false for periods of one rate: steady creep is an ellipse there, as hysteresis is."""
    return len(data.rates_hz) > 1 or not data.periodic


def other_chains(data: FitData, estimate: ChainEstimate, kind: str) -> tuple[ChainEstimate, ...]:
    """Return simpler chains that a model is also tried with.

    The estimated chain is that of any hysteresis of the dictionary, which takes its errors for lag:
    without a second rate or an earlier motion nothing contradicts that, and no lag is tried, too. A
    straight line is tried without lag and with a delay alone: creep at one rate is weighted with
    that of piezo stacks, which a drive without hysteresis need not have.
    """
    if "delay" not in estimate.searched:
        return ()
    none = replace(estimate.values, delay=0.0, creep_per_decade=0.0, spectrum=None)
    chains = (none,) if kind == Line.kind or not _shows_creep(data) else ()
    if kind == Line.kind:
        chains = none, _delay(partial(rms_of_line, data), none, _longest_delay(data))
    errors = {n: e for n, e in estimate.errors.items() if n != "creep_per_decade"}
    searched = tuple(n for n in estimate.searched if n in errors)
    other = replace(estimate, searched=searched, errors=errors, longest_delay=_longest_delay(data))
    return tuple(replace(other, values=c) for c in chains)


def rms_of_line(data: FitData, chain: ChainValues) -> float:
    """Return the rms residual of a straight line behind a chain, in the unit of the output."""
    part = replace(data, chain=chain, memo={})
    normal = equations(behind_chain([s.u[:, None] for s in data.sections], part), part)
    return math.sqrt(max(residual_square(normal, solve(normal)), 0.0) / normal.count)


def _longest_delay(data: IdentificationData) -> float:
    return _LONGEST_DELAY / max(*data.rates_hz, 1e-9) if data.rates_hz else 0.0


def _errors(
    search: ChainResidual, best: ChainValues, names: tuple[str, ...], data: IdentificationData
) -> dict[str, float]:
    """Standard errors of the chain by cycles; infinite for one rate."""
    if len(data.rates_hz) < 2:
        return dict.fromkeys(names, math.inf)
    limits = {
        "delay": _longest_delay(data),
        "creep_per_decade": _LARGEST_CREEP,
        "resonance_hz": best.resonance_hz,
    }
    limits = {name: limits[name] for name in names}
    # for slow effects whole stretches are omitted, for fast ones similar cycles
    errors = search.spread(best, limits, runs=2)
    if "creep_per_decade" in errors:
        slow = search.spread(best, limits, runs=1)["creep_per_decade"]
        errors["creep_per_decade"] = max(errors["creep_per_decade"], slow)
    return errors


def _fitted_parts(
    data: IdentificationData, train: tuple[int, int] | None
) -> tuple[RecordSection, ...]:
    """Measured samples of the records, without those held out."""
    parts = []
    for s in data.sections:
        first, stop = train or (0, s.first + s.u.size)
        part = slice(max(first - s.first, 0), max(stop - s.first, 0))
        bare = without_history(s)
        parts.append(replace(bare, u=bare.u[part], y=bare.y[part]))
    return tuple(parts)


def _excited_resonance(sections: tuple[RecordSection, ...]) -> Resonance | None:
    """Resonance with the smallest error of those excited by a multisine."""
    modes = [r for r in map(find_resonance, sections) if r is not None]
    return min(modes, key=lambda r: r.frequency_error_hz / r.frequency_hz, default=None)


def _best_jump_response(sections: tuple[RecordSection, ...]) -> Resonance | None:
    """Best response to jumps: a mode rather than a delay alone."""
    responses = [r for r in map(jump_response, sections) if r is not None]
    return min(responses, key=lambda r: (r.frequency_hz == 0.0, r.delay_error), default=None)


def _creep(search: ChainResidual, start: ChainValues) -> ChainValues:
    """Find the creep, with all other values known."""
    minimum: Any = minimize_scalar(
        lambda x: search.rms(replace(start, creep_per_decade=float(x))),
        bounds=(0.0, _LARGEST_CREEP),
        method="bounded",
        options={"xatol": 1e-5},
    )
    return replace(start, creep_per_decade=float(minimum.x))


def _delay(rms: Callable[[ChainValues], float], start: ChainValues, longest: float) -> ChainValues:
    """Find the delay, with all other values known; zero if no other is better."""
    minimum: Any = minimize_scalar(
        lambda x: rms(replace(start, delay=float(x))),
        bounds=(0.0, longest),
        method="bounded",
        options={"xatol": 1e-3 * longest},
    )
    none = replace(start, delay=0.0)
    return replace(start, delay=float(minimum.x)) if minimum.fun < rms(none) else none


def _delay_and_creep(search: ChainResidual, start: ChainValues, longest: float) -> ChainValues:
    def chain(x: Array) -> ChainValues:
        return replace(
            start,
            delay=float(np.clip(x[0], 0.0, 1.0)) * longest,
            creep_per_decade=float(np.clip(x[1], 0.0, 1.0)) * _LARGEST_CREEP,
        )

    cost = _cost(search, chain)
    grid = [np.array([a, b]) for a in (0.0, 0.1, 0.25, 0.5, 0.8) for b in (0.0, 0.1, 0.3)]
    begin = min(grid, key=cost)
    return chain(_lowest(cost, begin, 0.07 * np.eye(2), 1e-7, 80))


def _resonance(
    search: ChainResidual, start: ChainValues, data: IdentificationData, longest: float
) -> ChainValues | None:
    """Search for a resonance in the range that fast cycles show; None without such a range."""
    rates = data.rates_hz
    if len(rates) < 2:
        return None
    fastest = rates[-1]
    # a slow record of few samples neither shows nor hides a resonance
    nyquist = max(0.5 / s.dt for s in data.sections)
    high = min(_FARTHEST_RESONANCE * fastest, 0.9 * nyquist)
    low = 3.0 * fastest
    if low >= high:
        return None

    def chain(x: Array) -> ChainValues:
        return replace(
            start,
            resonance_hz=float(low * (high / low) ** np.clip(x[0], 0.0, 1.0)),
            delay=float(np.clip(x[1], 0.0, 1.0)) * longest,
            creep_per_decade=float(np.clip(x[2], 0.0, 1.0)) * _LARGEST_CREEP,
        )

    cost = _cost(search, chain)
    lag = [start.delay / longest, start.creep_per_decade / _LARGEST_CREEP]
    points = [np.array([a, *lag]) for a in np.linspace(0.0, 1.0, 7)]
    begin = min(points, key=cost)
    if cost(begin) > (1.0 - _COARSE_REDUCTION) * search.rms(start):
        return None
    steps = np.diag([0.1, -0.03 if lag[0] > 0.05 else 0.03, 0.03])
    return chain(_lowest(cost, begin, steps, 1e-8, 150))


def _cost(search: ChainResidual, chain: Callable[[Array], ChainValues]) -> Callable[[Array], float]:
    """Residual of a chain as a function of numbers from 0 to 1, with a penalty beyond these."""

    def cost(x: Array) -> float:
        outside = float(np.sum(np.maximum(0.0, -x) + np.maximum(0.0, x - 1.0)))
        return search.rms(chain(x)) * (1.0 + outside)

    return cost


def _lowest(
    cost: Callable[[Array], float], begin: Array, steps: Array, tolerance: float, most: int
) -> Array:
    """Minimum of a cost by the simplex method of Nelder and Mead, from a place and its steps."""
    simplex = np.vstack((begin, begin + steps))
    options = {"initial_simplex": simplex, "xatol": 1e-3, "fatol": tolerance, "maxfev": most}
    return np.asarray(minimize(cost, begin, method="Nelder-Mead", options=options).x)
