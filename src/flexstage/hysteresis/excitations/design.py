"""The drive record that a hysteresis model is identified from: the design of the experiment."""

import math
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from flexstage.base.errors import ModelError
from flexstage.files.request import request_of
from flexstage.hysteresis.excitations.excitation import (
    Excitation,
    ExcitationPart,
    Movement,
    memory_coverage,
    multisine,
)
from flexstage.hysteresis.excitations.segments import (
    NEAREST_RATES,
    ExcitationDesign,
    ExcitationSegment,
    checked_range,
    checked_rest,
    fitted,
    safe_slope,
    shortest,
    usable_rates,
)
from flexstage.hysteresis.model import Array
from flexstage.hysteresis.requests import ExciteRequest

#: No loop repeats more often than this part of the lowest natural frequency.
_QUASI_STATIC = 0.1
#: The speed rises and falls over this many periods of it: the stage does not ring.
_RAMP_PERIODS = 2.0
#: Band of the multisine about it, its peak as a share of the range, and the least that is of use.
_BAND = (0.4, 1.6)
_SHARE = 0.009
_LEAST_SHARE = 1e-4
#: Samples in a period of its highest tone, and in the fastest loop over the range, where nobody
#: gives a rate. Small loops are run up to five times as often: they have a fifth of those.
_TONE_SAMPLES = 5
_LOOP_SAMPLES = 200
#: Rates in a decade whose period is a short decimal.
_SHORT_PERIODS = (1.0, 1.25, 1.6, 2.0, 2.5, 4.0, 5.0, 8.0, 10.0)
#: A sample rate that bounds nothing.
_NO_BOUND_HZ = 1e12
#: Less than this is worth a warning.
_GOOD_COVERAGE = 0.8
_MOST_SAMPLES = 20_000_000
#: Voltages have this many decimals more than the range has digits: a file holds them exactly.
_DIGITS = 8


def excitation(
    voltage: tuple[float, float] | None = None,
    request: ExciteRequest | None = None,
    **asked: Any,
) -> Excitation:
    r"""Design the drive record that identifies hysteresis, lag, creep and the lowest resonance.

    At each rate: major loops, reversal curves from both ends of the range (Mayergoyz 1986, Phys.
    Rev. Lett. 56:1518: they hold the whole Preisach density) and nested loops of falling range
    about three means. Before them, two slow major loops wipe out what the stage remembers; after
    them come a step up and down with waits for creep, and a small multisine for the resonance.

    Where the time is too short, the rates are raised: those that were asked for up to an eighth of
    the fastest, others up to what the limits allow. Then parts are left out, the least useful
    first; `Excitation.left_out` names them.

    Parameters
    ----------
    voltage : tuple of float, optional
        Lowest and highest voltage of the stack [V]; that of the request where not given.
    request : ExciteRequest, optional
        Rates of the loops, time and sample rate, limits, shape, hold and multisine.
    **asked
        Fields of `ExciteRequest`, in place of those of `request`.

    Returns
    -------
    Excitation
        The record, its parts, and what it asks of the amplifier.

    Raises
    ------
    ModelError
        A number is impossible, the rates need more slope, current, samples or bandwidth than there
        is, or not even the least content fits into the time.

    Notes
    -----
    Validity: slope and current are those of the straight lines between the samples; a converter
    that holds each sample makes small steps instead, which its amplifier has to filter. The
    capacitance of a stack is larger at full voltage than in the data sheet's small-signal figure,
    by up to about a factor of two: give the large-signal one. Rates are those of a stage that
    follows quasi-statically.

    Examples
    --------
    >>> made = excitation(
    ...     (0.0, 120.0), sample_rate=2000.0, rates=(0.5, 5.0), amplifier="slew=1500 V/s"
    ... )
    >>> round(made.duration, 1), round(made.largest_slope), round(made.coverage, 2)
    (68.4, 1333, 1.0)
    >>> made = excitation((0.0, 120.0), rates=(0.5, 5.0))
    >>> made.sample_rate_hz, made.sampled_for
    (1000.0, '200 samples in a loop at 5 Hz')
    """
    given = asked if voltage is None else {"voltage": voltage, **asked}
    request = request_of(ExciteRequest, request, given)
    if (ends := request.voltage) is None:
        raise ModelError('--voltage is needed, such as "0:120": no stack gives a range')
    low, high = checked_range(ends)
    rest = checked_rest(request.rest, low, high)
    duration, sample_rate_hz, sampled_for = request.duration, request.sample_rate, ""
    frequency, tones_at = request.frequency, request.frequency if request.multisine else None
    request.amplifier.require_load()
    slope_limit = partial(safe_slope, request.amplifier.largest_rate)
    decimals = _DIGITS - math.floor(math.log10(high - low))
    movement = Movement(
        shape=request.shape,
        span=high - low,
        sample_rate_hz=sample_rate_hz or _NO_BOUND_HZ,
        slope_limit=slope_limit(0.0),
        turn_time=_RAMP_PERIODS / frequency if frequency else 0.0,
        highest_frequency_hz=_QUASI_STATIC * frequency if frequency else math.inf,
    )
    if sample_rate_hz is None:
        fastest = usable_rates(request.rates, movement)[-1]
        sample_rate_hz, sampled_for = _needed(fastest, tones_at)
    rounding = 1.01 * 0.1**decimals * sample_rate_hz
    movement = replace(movement, sample_rate_hz=sample_rate_hz, slope_limit=slope_limit(rounding))
    warnings: list[str] = []
    tones = _tones(tones_at, movement, request.seed, warnings)
    hold = request.hold_time
    if hold is None:
        hold = 12.0 if duration is None else min(12.0, 0.2 * duration)
    wanted = ExcitationDesign(
        voltage_range=(low, high),
        rest_voltage=rest,
        rates_hz=usable_rates(request.rates, movement),
        hold=hold,
        multisine=tones.size / sample_rate_hz,
    )
    most = None if duration is None else math.floor(duration * sample_rate_hz * (1 + 1e-12)) + 1
    free = 0.0 if request.rates else movement.highest_rate()
    design = fitted(wanted, movement, most, free)
    if design is None:
        least = shortest(wanted, movement, free) / sample_rate_hz
        raise ModelError(
            f"major loops at every rate and nested loops take at least {least:.3g} s within these "
            f"limits, got a duration of {duration:g} s: give it more time, or raise the rates or "
            "the limits"
        )
    size = design.samples(movement)
    if size > _MOST_SAMPLES:
        raise ModelError(
            f"the record would have {size} samples, and at most {_MOST_SAMPLES} are allowed: lower "
            "the sample rate, raise the slowest rate, or limit the duration"
        )
    if design.rates_hz != wanted.rates_hz:
        before, after = (", ".join(f"{r:.3g}" for r in p.rates_hz) for p in (wanted, design))
        warnings.append(f"the rates were raised from {before} Hz to {after} Hz to fit the time")
    values, parts = _run(design, movement, tones, decimals)
    slopes = np.abs(np.diff(values)) * sample_rate_hz
    capacitance = request.amplifier.capacitance
    coverage = _coverage(design)
    warnings += _shortcomings(design, movement, coverage)
    return Excitation(
        request=request,
        time=np.arange(values.size) / sample_rate_hz,
        voltage=values,
        parts=parts,
        shape=request.shape,
        sample_rate_hz=float(sample_rate_hz),
        sampled_for=sampled_for,
        rates_hz=design.rates_hz,
        rest_voltage=rest,
        largest_slope=float(slopes.max()),
        largest_current=None if capacitance is None else capacitance * float(slopes.max()),
        rms_current=None
        if capacitance is None
        else capacitance * float(np.sqrt(np.mean(slopes**2))),
        coverage=coverage,
        left_out=design.left_out,
        warnings=tuple(warnings),
    )


def _needed(fastest: float, natural: float | None) -> tuple[float, str]:
    """The sample rate that fastest loops and multisine need [Hz], and for which of them it is."""
    loops = _LOOP_SAMPLES * fastest
    least, words = loops, f"{_LOOP_SAMPLES} samples in a loop at {fastest:.4g} Hz"
    if natural is not None and _TONE_SAMPLES * _BAND[1] * natural > loops:
        least = _TONE_SAMPLES * _BAND[1] * natural
        words = f"{_TONE_SAMPLES} samples in a period of {_BAND[1] * natural:.4g} Hz, the highest "
        words += "tone of the multisine at the resonance"
    decade = 10.0 ** math.floor(math.log10(least))
    rate = next(step * decade for step in _SHORT_PERIODS if step * decade >= least * (1.0 - 1e-9))
    return rate, words


def _tones(natural: float | None, movement: Movement, seed: int, warnings: list[str]) -> Array:
    """Return the multisine at the resonance [V]; empty where there is none."""
    nothing = np.empty(0)
    if natural is None:
        return nothing
    band = (_BAND[0] * natural, _BAND[1] * natural)
    if _TONE_SAMPLES * band[1] > movement.sample_rate_hz:
        warnings.append(
            f"no multisine at the resonance: up to {band[1]:.4g} Hz it needs a sample rate of at "
            f"least {_TONE_SAMPLES * band[1]:.4g} Hz"
        )
        return nothing
    # long enough to resolve a damping ratio of a quarter of a percent
    tones = multisine(band, min(max(400.0 / natural, 1.0), 20.0), movement.sample_rate_hz, seed)
    steepest = float(np.abs(np.diff(tones, prepend=0.0)).max()) * movement.sample_rate_hz
    peak = min(_SHARE * movement.span, movement.slope_limit / steepest)
    if peak < _LEAST_SHARE * movement.span:
        warnings.append(
            f"no multisine at the resonance: slope and current allow {1e3 * peak:.2g} mV, which "
            "is too small to be seen"
        )
        return nothing
    return peak * tones


def _run(
    design: ExcitationDesign, movement: Movement, tones: Array, decimals: int
) -> tuple[Array, tuple[ExcitationPart, ...]]:
    """Put the parts one after the other."""
    at = design.rest_voltage
    pieces: list[Array] = [np.array([at])]
    parts: list[ExcitationPart] = []
    first = 0
    for segment in design.segments():
        own: list[Array] = []
        for target, moved, waited in segment.steps(at, movement):
            own += [movement.samples(at, target, moved), np.full(waited, target)]
            at = target
        if segment.multisine:
            own.append(at + tones)
        values = _rounded(np.concatenate(own), decimals, design)
        before = pieces[-1][-1]
        pieces.append(values)
        parts.append(_part(segment, np.concatenate(([before], values)), first, movement))
        first += values.size
    return np.concatenate(pieces), tuple(parts)


def _rounded(values: Array, decimals: int, design: ExcitationDesign) -> Array:
    rounded = np.round(values, decimals)
    at_rest = rounded == np.round(design.rest_voltage, decimals)
    rounded = np.clip(rounded, *design.voltage_range)
    # the rest voltage itself is met, however many digits it has
    rounded[at_rest] = design.rest_voltage
    return rounded


def _part(
    segment: ExcitationSegment, voltage: Array, first: int, movement: Movement
) -> ExcitationPart:
    """Describe a part from its samples, with the one before it."""
    steps = np.diff(voltage)
    moving = np.sign(steps[steps != 0.0])
    rate = movement.sample_rate_hz
    return ExcitationPart(
        name=segment.name,
        first=first + 1,
        last=first + voltage.size,
        start=first / rate,
        duration=steps.size / rate,
        rate_hz=segment.rate_hz,
        voltage_range=(float(voltage.min()), float(voltage.max())),
        turning_points=int(np.count_nonzero(np.diff(moving))),
        largest_slope=float(np.abs(steps).max()) * rate,
    )


def _coverage(design: ExcitationDesign) -> float:
    # the multisine is no part of the quasi-static loops
    targets = [t for segment in design.segments() for t in segment.targets]
    seen = memory_coverage([design.rest_voltage, *targets])
    cells = seen.shape[0]
    return float(seen.sum()) / (cells * (cells + 1))


def _shortcomings(design: ExcitationDesign, movement: Movement, coverage: float) -> list[str]:
    """Say what the record cannot tell."""
    found: list[str] = []
    slowest, fastest = design.rates_hz[0], design.rates_hz[-1]
    if slowest == fastest:
        found.append(
            "one rate only: lag, creep and hysteresis cannot be separated; give a second one, ten "
            "times slower or faster"
        )
    elif fastest < NEAREST_RATES * slowest * (1.0 - 1e-9):
        found.append(
            f"the rates are only a factor of {fastest / slowest:.3g} apart: lag and creep are "
            f"poorly separated; at least {NEAREST_RATES:g} is better"
        )
    if coverage < _GOOD_COVERAGE:
        found.append(
            f"only {100.0 * coverage:.0f} % of the memory is covered: a model is uncertain in "
            "loops that are not in the record; give it more time"
        )
    if math.isinf(movement.slope_limit):
        found.append("no limit of slope or current was given: the amplifier's are not checked")
    return found
