"""The linear chain behind a hysteresis that is not known yet."""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from scipy.optimize import minimize, minimize_scalar

from flexstage.base.arrays import Array
from flexstage.hysteresis.drive_model import Start
from flexstage.hysteresis.identification.chain_misfit import ChainMisfit
from flexstage.hysteresis.identification.fit_rows import ChainValues
from flexstage.hysteresis.identification.jump_response import jump_response
from flexstage.hysteresis.identification.measurement import (
    IdentificationData,
    without_history,
)
from flexstage.hysteresis.identification.record_section import RecordSection
from flexstage.hysteresis.identification.resonance_search import Resonance, find_resonance

#: What a drive did before a record is told by a misfit that is smaller by this factor: without, it
#: is taken to have rested.
_TELLS = 0.99

#: Longest delay that is looked for, as a share of the shortest cycle.
_LONGEST_DELAY = 0.08
#: Largest creep that is looked for [1 per decade].
_LARGEST_CREEP = 0.12
#: Creep of piezo stacks [1 per decade], and half of the range that makers state (1 to 2 %: Physik
#: Instrumente, Piezo Tutorial, "Creep"): it counts beside records of one rate, which hide creep.
_USUAL_CREEP, _CREEP_RANGE = 0.015, 0.005
#: Values of creep that are compared on the way from one to the other.
_BETWEEN = 11
#: Records are on one zero where one constant leaves less than this many times what free ones leave.
_ON_ONE_ZERO = 1.5
#: What a drive did before a record is not told where another start leaves less than this factor.
_UNTOLD = 1.25
#: A resonance is looked for where the fastest cycles are slower than it by at most this factor, ...
_FARTHEST_RESONANCE = 60.0
#: ... and it is kept where it takes this share of the misfit away.
_WORTH = 0.02
#: It is followed at all where a coarse look at it takes this share away.
_GLIMPSE = 0.002


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FoundChain:
    """The chain that explains a measurement best, whatever its hysteresis."""

    values: ChainValues
    """The chain."""
    searched: tuple[str, ...]
    """The values that were found, and not given."""
    rms: float
    """Misfit that is left with a coarse dictionary, over the stroke [1]."""
    resonance: Resonance | None = None
    """The resonance, where a part of a record was made to show it, or jumps do."""
    errors: Mapping[str, float] = field(default_factory=dict)
    """Standard errors of the values that were found; infinite where the records do not tell."""
    notes: tuple[str, ...] = ()
    """What a reader should know."""

    @property
    def widths(self) -> Mapping[str, float]:
        """How far each value that was searched for may be off: of creep that no rate tells, any."""
        any_creep = {"creep_per_decade": _LARGEST_CREEP / math.sqrt(12.0)}
        return {
            name: error if math.isfinite(error) else any_creep.get(name, 0.0)
            for name, error in self.errors.items()
            if name in self.searched
        }


def find_chain(
    data: IdentificationData,
    given: ChainValues | None = None,
    *,
    train: tuple[int, int] | None = None,
    resonance: tuple[float, float] | None = None,
) -> FoundChain:
    """Find delay, creep and resonance by projection over a dictionary of hysteresis.

    A small Preisach model stands for any hysteresis. For each chain its best density follows from
    non-negative least squares, and the misfit is a function of the chain alone.

    Parameters
    ----------
    data : IdentificationData
        The measurement.
    given : ChainValues, optional
        A chain that is known; nothing is searched for then.
    train : tuple of int, optional
        First sample to look at, and the one after the last, of every record; all where not given.
    resonance : tuple of float, optional
        Frequency [Hz] and damping ratio of a mode that is known, as from a model of the stage.

    Returns
    -------
    FoundChain
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
    >>> found = find_chain(measurement([Record(channels=(u, y), time=t)], "u", "y"))
    >>> round(found.values.delay, 3)
    0.007
    """
    search = ChainMisfit(data, train)
    longest = max(10.0 * s.u.size * s.dt for s in data.sections)
    start = ChainValues(creep_longest=max(1000.0, longest))
    if given is not None:
        return FoundChain(values=given, searched=(), rms=search.rms(given))
    if resonance is not None:
        start = replace(start, resonance_hz=resonance[0], damping_ratio=resonance[1])
        search.fix_modes(start)
    sections = _looked_at(data, train)
    seen = None if resonance is not None else _seen(sections)
    jumped = _jumped(sections)
    notes = _unexplained(jumped) if seen is None and resonance is None else ()
    if seen is None and resonance is None and jumped is not None and jumped.frequency_hz > 0.0:
        seen = jumped
    if seen is not None:
        start = replace(
            start,
            resonance_hz=seen.frequency_hz,
            damping_ratio=seen.damping_ratio,
            resonance_share=seen.share,
            delay=seen.delay,
        )
        search.fix_modes(start)
        found = _with_delay(search, start, seen.delay_error, data)
        errors = {**found.errors, "resonance_hz": seen.frequency_error_hz}
        return replace(found, resonance=seen, errors=errors)
    found = _by_cycles(search, start, data, modes=resonance is None)
    # where the mode is known and its ringing with it, jumps tell the delay of both
    if jumped is not None and jumped.delay_error < found.errors["delay"]:
        at = replace(start, delay=jumped.delay)
        if found.values.resonance_hz == start.resonance_hz:
            found = _with_delay(search, at, jumped.delay_error, data)
    return replace(found, notes=(*notes, *found.notes))


def find_starts(
    data: IdentificationData, found: FoundChain, *, train: tuple[int, int] | None = None
) -> tuple[tuple[Start, ...], float]:
    """Find what the drive did before each record, which its creep has not forgotten.

    Delay and creep, where they are not known, are searched for with each of what it can have done:
    to rest at the first command, or to have moved for a time since it left the low end of its range
    (none, as long as the longest record, or long). It is taken to have rested unless another start
    leaves less. `train` is the first sample to look at, and the one after the last, of every
    record. The second number is the standard error that this adds to the creep [1]: a start that
    cannot be ruled out would have given another.
    """
    count = len(data.sections)
    best: tuple[Start, ...] = tuple(s.start for s in data.sections)
    if not found.searched and found.values.creep_per_decade == 0.0:
        return best, 0.0
    search = ChainMisfit(data, train)
    chain = replace(found.values, delay=0.0, creep_per_decade=0.0)
    if chain.resonance_hz > 0.0:
        search.fix_modes(chain)
    delay_known = "delay" not in found.searched
    most = _longest_delay(data)
    longest = max(s.u.size * s.dt for s in data.sections)
    every: tuple[Start, ...] = ("rested", 0.0, longest, math.inf)
    seen = []
    for start in every:
        search.begin(best if start == every[0] else (start,) * count)
        if not found.searched or (start == every[0] and len(data.rates_hz) > 1):
            own = found.values
        elif delay_known:
            own = _creep(search, replace(chain, delay=found.values.delay))
        else:
            own = _delay_and_creep(search, chain, most)
        seen.append((search.rms(own), search.rms_of_one_zero(own), own))
    # records that some start puts on one zero are on one
    on_one = any(one <= _ON_ONE_ZERO * rms for rms, one, _ in seen)
    misfit = search.rms_of_one_zero if on_one else search.rms
    left = [one if on_one else rms for rms, one, _ in seen]
    least, values = left[0], seen[0][2]
    for start, rms, (_, _, own) in zip(every[1:], left[1:], seen[1:], strict=True):
        if rms < _TELLS * least:
            best, least, values = (start,) * count, rms, own
    # a start counts where either is nearly as good: zeros may differ by what nobody noted
    least_of = [min(one[k] for one in seen) for k in (0, 1)]
    width = max(
        abs(own.creep_per_decade - values.creep_per_decade)
        for *each, own in seen
        if any(rms <= _UNTOLD * own_least for rms, own_least in zip(each, least_of, strict=True))
    )
    if count > 1 and values.creep_per_decade > 0.0:
        for i in range(count):
            for start in every:
                turned = (*best[:i], start, *best[i + 1 :])
                search.begin(turned)
                rms = misfit(values)
                if rms < _TELLS * least:
                    best, least = turned, rms
    # the farthest of them stands for two standard errors
    return best, 0.5 * width


def _with_delay(
    search: ChainMisfit, start: ChainValues, delay_error: float, data: IdentificationData
) -> FoundChain:
    """The chain where all but creep is known."""
    best = _creep(search, start)
    errors = {"delay": delay_error, **_errors(search, best, ("creep_per_decade",), data)}
    notes = _at_limits(best, math.inf)
    return FoundChain(
        values=best,
        searched=("creep_per_decade",),
        rms=search.rms(best),
        errors=errors,
        notes=notes,
    )


def _by_cycles(
    search: ChainMisfit, start: ChainValues, data: IdentificationData, *, modes: bool
) -> FoundChain:
    """The chain that cycles tell by themselves."""
    most = _longest_delay(data)
    best = _delay_and_creep(search, start, most)
    if len(data.rates_hz) < 2:
        best = _with_usual_creep(search, best, most)
    names: tuple[str, ...] = ("delay", "creep_per_decade")
    rms = search.rms(best)
    rung = _resonance(search, best, data, most) if modes else None
    if rung is not None and search.rms(rung) < (1.0 - _WORTH) * rms:
        best, names, rms = rung, (*names, "resonance_hz"), search.rms(rung)
    errors = _errors(search, best, names, data)
    notes = _at_limits(best, most)
    return FoundChain(values=best, searched=names, rms=rms, errors=errors, notes=notes)


def _with_usual_creep(search: ChainMisfit, best: ChainValues, longest: float) -> ChainValues:
    """Weigh the creep that cycles of one rate seem to show with that of other piezo stacks.

    Hysteresis takes the place of creep there, and a slow drift looks like it, so that the best
    creep is often a multiple of what stretches that were not fitted agree with. From the best to
    the usual creep, the one is taken for which two things are least together: how significantly
    those stretches are worse, by the square of Student's t of the logarithm of the ratio, and how
    unusual it is, by twice the logarithm of the density of Cauchy, whose tails let a drive of
    another kind be one.
    """
    own, usual = best.creep_per_decade, _USUAL_CREEP
    found: Any = minimize_scalar(
        lambda x: search.rms(replace(best, delay=float(x), creep_per_decade=usual)),
        bounds=(0.0, longest),
        method="bounded",
        options={"xatol": 1e-3 * longest},
    )

    def between(share: float) -> ChainValues:
        # along the valley of the misfit: more creep goes with less delay
        return replace(
            best,
            delay=best.delay + share * (float(found.x) - best.delay),
            creep_per_decade=own + share * (usual - own),
        )

    shares = np.linspace(0.0, 1.0, _BETWEEN)
    held = np.array([search.held_out(between(share)) for share in shares])
    if held.shape[1] < 3:
        return best
    # stretches differ in what they leave, their ratios less
    worse = np.log(np.maximum(held, 1e-300) / np.maximum(held[0], 1e-300))
    error = np.std(worse, axis=1, ddof=1) / math.sqrt(held.shape[1])
    t = np.maximum(worse.mean(axis=1), 0.0) / np.maximum(error, 1e-300)
    unusual = (1.0 - shares) * (own - usual) / _CREEP_RANGE
    return between(float(shares[int(np.argmin(t**2 + 2.0 * np.log1p(unusual**2)))]))


def _longest_delay(data: IdentificationData) -> float:
    return _LONGEST_DELAY / max(*data.rates_hz, 1e-9) if data.rates_hz else 0.0


def _errors(
    search: ChainMisfit, best: ChainValues, names: tuple[str, ...], data: IdentificationData
) -> dict[str, float]:
    """Standard errors of what cycles tell, which at one rate they do not."""
    if len(data.rates_hz) < 2:
        return dict.fromkeys(names, math.inf)
    limits = {
        "delay": _longest_delay(data),
        "creep_per_decade": _LARGEST_CREEP,
        "resonance_hz": best.resonance_hz,
    }
    limits = {name: limits[name] for name in names}
    # slow things are left out as stretches, fast ones as cycles that are alike
    errors = search.spread(best, limits, runs=2)
    if "creep_per_decade" in errors:
        slow = search.spread(best, limits, runs=1)["creep_per_decade"]
        errors["creep_per_decade"] = max(errors["creep_per_decade"], slow)
    return errors


def _at_limits(chain: ChainValues, longest: float) -> tuple[str, ...]:
    """Say where the search has ended at the edge of what it looks at."""
    notes = []
    if chain.delay > 0.99 * longest:
        notes.append(
            f"the delay is the longest that is looked for ({1e3 * longest:.3g} ms, "
            f"{100 * _LONGEST_DELAY:g} % of the fastest cycle): check the columns and the sample "
            "rate, or state the delay"
        )
    if chain.creep_per_decade > 0.99 * _LARGEST_CREEP:
        notes.append(
            f"the creep is the largest that is looked for ({100 * _LARGEST_CREEP:g} % per decade): "
            "something else is taken for creep, such as a drift of the output (compare with "
            "--drift), a slow sensor or noise of the input"
        )
    return tuple(notes)


def _unexplained(jumped: Resonance | None) -> tuple[str, ...]:
    if jumped is None or jumped.unexplained_hz == 0.0:
        return ()
    return (
        f"after jumps of the input the output rings at about {jumped.unexplained_hz:.4g} Hz, which "
        "is not the ringing of one mode and is not in the model: name the mode, or record a small "
        "multisine about it",
    )


def _looked_at(
    data: IdentificationData, train: tuple[int, int] | None
) -> tuple[RecordSection, ...]:
    """What was measured of the records, without what is held out."""
    found = []
    for s in data.sections:
        first, stop = train or (0, s.first + s.u.size)
        part = slice(max(first - s.first, 0), max(stop - s.first, 0))
        bare = without_history(s)
        found.append(replace(bare, u=bare.u[part], y=bare.y[part]))
    return tuple(found)


def _seen(sections: tuple[RecordSection, ...]) -> Resonance | None:
    """The best determined of the resonances that parts of records were made to show."""
    found = [r for r in map(find_resonance, sections) if r is not None]
    return min(found, key=lambda r: r.frequency_error_hz / r.frequency_hz, default=None)


def _jumped(sections: tuple[RecordSection, ...]) -> Resonance | None:
    """What jumps show best: a mode before a delay alone."""
    found = [r for r in map(jump_response, sections) if r is not None]
    return min(found, key=lambda r: (r.frequency_hz == 0.0, r.delay_error), default=None)


def _creep(search: ChainMisfit, start: ChainValues) -> ChainValues:
    """Find the creep where all the rest is known."""
    found: Any = minimize_scalar(
        lambda x: search.rms(replace(start, creep_per_decade=float(x))),
        bounds=(0.0, _LARGEST_CREEP),
        method="bounded",
        options={"xatol": 1e-5},
    )
    return replace(start, creep_per_decade=float(found.x))


def _delay_and_creep(search: ChainMisfit, start: ChainValues, longest: float) -> ChainValues:
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
    search: ChainMisfit, start: ChainValues, data: IdentificationData, longest: float
) -> ChainValues | None:
    """Look for a resonance where fast cycles could show it; None where they could not."""
    rates = data.rates_hz
    if len(rates) < 2:
        return None
    fastest = rates[-1]
    # a slow record of few samples says nothing of a resonance, and does not hide it either
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
    rest = [start.delay / longest, start.creep_per_decade / _LARGEST_CREEP]
    points = [np.array([a, *rest]) for a in np.linspace(0.0, 1.0, 7)]
    begin = min(points, key=cost)
    if cost(begin) > (1.0 - _GLIMPSE) * search.rms(start):
        return None
    steps = np.diag([0.1, -0.03 if rest[0] > 0.05 else 0.03, 0.03])
    return chain(_lowest(cost, begin, steps, 1e-8, 150))


def _cost(search: ChainMisfit, chain: Callable[[Array], ChainValues]) -> Callable[[Array], float]:
    """The misfit of a chain of numbers from 0 to 1, which rises beyond these."""

    def cost(x: Array) -> float:
        outside = float(np.sum(np.maximum(0.0, -x) + np.maximum(0.0, x - 1.0)))
        return search.rms(chain(x)) * (1.0 + outside)

    return cost


def _lowest(
    cost: Callable[[Array], float], begin: Array, steps: Array, tolerance: float, most: int
) -> Array:
    """The least cost by the simplex of Nelder and Mead, from a place and those beside it."""
    simplex = np.vstack((begin, begin + steps))
    options = {"initial_simplex": simplex, "xatol": 1e-3, "fatol": tolerance, "maxfev": most}
    return np.asarray(minimize(cost, begin, method="Nelder-Mead", options=options).x)
