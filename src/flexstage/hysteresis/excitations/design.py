"""Design of the drive record for the identification of a hysteresis model."""

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
    memory_coverage,
    multisine,
)
from flexstage.hysteresis.excitations.segments import (
    NEAREST_RATES,
    ExcitationDesign,
    Movement,
    checked_range,
    checked_rest,
    design_within_limits,
    safe_slope,
    shortest,
    usable_rates,
)
from flexstage.hysteresis.model import Array
from flexstage.hysteresis.requests import ExciteRequest

#: Highest repetition rate of a loop over the lowest natural frequency.
_QUASI_STATIC = 0.1
#: Periods of it over which the speed rises and falls, so that the stage does not ring.
_RAMP_PERIODS = 2.0
#: Band of the multisine over it, its peak as a share of the range, and the smallest useful peak.
_BAND = (0.4, 1.6)
_SHARE = 0.009
_LEAST_SHARE = 1e-4
#: Default samples in a period of its highest tone, and in the fastest loop over the range. Small
#: loops repeat up to five times as often, with a fifth of these samples.
_TONE_SAMPLES = 5
_LOOP_SAMPLES = 200
#: Rates in a decade whose period is a short decimal.
_SHORT_PERIODS = (1.0, 1.25, 1.6, 2.0, 2.5, 4.0, 5.0, 8.0, 10.0)
#: A sample rate without effect on the limits.
_UNLIMITED_HZ = 1e12
#: Smallest coverage without a warning.
_GOOD_COVERAGE = 0.8
_MOST_SAMPLES = 20_000_000
#: Additional decimals of voltages, more than the range has digits: a file represents them exactly.
_DIGITS = 8


def excitation(
    voltage: tuple[float, float] | None = None,
    request: ExciteRequest | None = None,
    **options: Any,
) -> Excitation:
    r"""Design the drive record that identifies hysteresis, lag, creep and the lowest resonance.

    At each rate: major loops, reversal curves from both ends of the range (Mayergoyz 1986, Phys.
    Rev. Lett. 56:1518: they determine the full Preisach density) and nested loops of decreasing
    range about three means. Before them, two slow major loops erase the memory of the stage; after
    them follow a step up and down with hold times for creep, and a small multisine for the
    resonance.

    If the time is too short, the rates are raised: requested rates up to an eighth of the fastest,
    default rates up to the limits. Then parts are omitted, the least useful first, as in
    `Excitation.omitted`.

    Parameters
    ----------
    voltage : tuple of float, optional
        Lowest and highest voltage of the stack [V]; that of the request where not given.
    request : ExciteRequest, optional
        Rates of the loops, time and sample rate, limits, shape, hold and multisine.
    **options
        Fields of `ExciteRequest`, in place of those of `request`.

    Returns
    -------
    Excitation
        The record, its parts, and its demands on the amplifier.

    Raises
    ------
    ModelError
        A number is invalid, the rates exceed the limits of slope, current, samples or bandwidth, or
        not even the least content fits into the time.

    Notes
    -----
    Validity: slope and current are those of the straight lines between the samples; the output of
    a zero-order hold has small steps instead, which the amplifier has to filter. The
    capacitance of a stack is larger at full voltage than in the data sheet's small-signal figure,
    by up to about a factor of two: give the large-signal one. Rates are those of a stage that
    follows quasi-statically.

    Examples
    --------
    >>> record = excitation(
    ...     (0.0, 120.0), sample_rate=2000.0, rates=(0.5, 5.0), amplifier="slew=1500 V/s"
    ... )
    >>> round(record.duration, 1), round(record.largest_slope), round(record.coverage, 2)
    (68.4, 1333, 1.0)
    >>> record = excitation((0.0, 120.0), rates=(0.5, 5.0))
    >>> record.sample_rate_hz, record.sampled_for
    (1000.0, '200 samples in a loop at 5 Hz')
    """
    fields = options if voltage is None else {"voltage": voltage, **options}
    request = request_of(ExciteRequest, request, fields)
    if (ends := request.voltage) is None:
        raise ModelError('--voltage is needed, such as "0:120", without a stack that has a range')
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
        sample_rate_hz=sample_rate_hz or _UNLIMITED_HZ,
        slope_limit=slope_limit(0.0),
        turn_time=_RAMP_PERIODS / frequency if frequency else 0.0,
        highest_frequency_hz=_QUASI_STATIC * frequency if frequency else math.inf,
    )
    if sample_rate_hz is None:
        fastest = usable_rates(request.rates, movement)[-1]
        sample_rate_hz, sampled_for = _default_sample_rate(fastest, tones_at)
    rounding = 1.01 * 0.1**decimals * sample_rate_hz
    movement = replace(movement, sample_rate_hz=sample_rate_hz, slope_limit=slope_limit(rounding))
    warnings: list[str] = []
    tones = _tones(tones_at, movement, request.seed, warnings)
    hold = request.hold_time
    if hold is None:
        hold = 12.0 if duration is None else min(12.0, 0.2 * duration)
    request_design = ExcitationDesign(
        voltage_range=(low, high),
        rest_voltage=rest,
        rates_hz=usable_rates(request.rates, movement),
        hold=hold,
        multisine=tones.size / sample_rate_hz,
    )
    most = None if duration is None else math.floor(duration * sample_rate_hz * (1 + 1e-12)) + 1
    free = 0.0 if request.rates else movement.highest_rate()
    design = design_within_limits(request_design, movement, most, free)
    if design is None:
        shortest_duration = shortest(request_design, movement, free) / sample_rate_hz
        raise ModelError(
            f"major loops at every rate and nested loops need at least {shortest_duration:.3g} s "
            f"within these limits, got a duration of {duration:g} s: increase the duration, the "
            "rates or the limits"
        )
    size = design.samples(movement)
    if size > _MOST_SAMPLES:
        raise ModelError(
            f"the record would have {size} samples, and at most {_MOST_SAMPLES} are allowed: lower "
            "the sample rate, raise the slowest rate, or limit the duration"
        )
    if design.rates_hz != request_design.rates_hz:
        before, after = (
            ", ".join(f"{r:.3g}" for r in p.rates_hz) for p in (request_design, design)
        )
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
        omitted=design.omitted,
        warnings=tuple(warnings),
    )


def _default_sample_rate(fastest: float, natural: float | None) -> tuple[float, str]:
    """Sample rate for the fastest loops and the multisine [Hz], and which of them determines it."""
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
    """Return the multisine at the resonance [V]; empty for none."""
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
            f"no multisine at the resonance: slope and current limit it to {1e3 * peak:.2g} mV, "
            "which is too small"
        )
        return nothing
    return peak * tones


def _run(
    design: ExcitationDesign, movement: Movement, tones: Array, decimals: int
) -> tuple[Array, tuple[ExcitationPart, ...]]:
    """Concatenate the parts."""
    at = design.rest_voltage
    pieces: list[Array] = [np.array([at])]
    parts: list[ExcitationPart] = []
    first = 0
    for segment in design.segments():
        samples: list[Array] = []
        for target, moved, waited in segment.steps(at, movement):
            samples += [movement.samples(at, target, moved), np.full(waited, target)]
            at = target
        if segment.multisine:
            samples.append(at + tones)
        values = _rounded(np.concatenate(samples), decimals, design)
        before = pieces[-1][-1]
        pieces.append(values)
        voltage = np.concatenate(([before], values))
        parts.append(ExcitationPart.of(segment, voltage, first, movement.sample_rate_hz))
        first += values.size
    return np.concatenate(pieces), tuple(parts)


def _rounded(values: Array, decimals: int, design: ExcitationDesign) -> Array:
    rounded = np.round(values, decimals)
    at_rest = rounded == np.round(design.rest_voltage, decimals)
    rounded = np.clip(rounded, *design.voltage_range)
    # the rest voltage is reached exactly, with any number of digits
    rounded[at_rest] = design.rest_voltage
    return rounded


def _coverage(design: ExcitationDesign) -> float:
    # the multisine is no part of the quasi-static loops
    targets = [t for segment in design.segments() for t in segment.targets]
    cells_moved = memory_coverage([design.rest_voltage, *targets])
    cells = cells_moved.shape[0]
    return float(cells_moved.sum()) / (cells * (cells + 1))


def _shortcomings(design: ExcitationDesign, movement: Movement, coverage: float) -> list[str]:
    """Return warnings about quantities that the record does not determine."""
    warnings: list[str] = []
    slowest, fastest = design.rates_hz[0], design.rates_hz[-1]
    if slowest == fastest:
        warnings.append(
            "one rate only: lag, creep and hysteresis cannot be separated; give a second rate, ten "
            "times slower or faster"
        )
    elif fastest < NEAREST_RATES * slowest * (1.0 - 1e-9):
        warnings.append(
            f"the rates are only a factor of {fastest / slowest:.3g} apart: lag and creep are "
            f"poorly separated; at least {NEAREST_RATES:g} is better"
        )
    if coverage < _GOOD_COVERAGE:
        warnings.append(
            f"only {100.0 * coverage:.0f} % of the memory is covered: a model is uncertain in "
            "loops that are not in the record; increase the duration"
        )
    if math.isinf(movement.slope_limit):
        warnings.append(
            "no limit of slope or current is given: those of the amplifier are not checked"
        )
    return warnings
