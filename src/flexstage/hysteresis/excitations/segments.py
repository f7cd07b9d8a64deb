"""Content of a record for identification: movements, segments, and their order within limits."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from flexstage.base.errors import ModelError
from flexstage.hysteresis.model import Array

#: A loop has the speed of the major loop, up to this multiple of its rate.
_MOST_OFTEN = 5.0
#: Shortest time over which the speed of a smooth movement rises or falls, over its duration.
_SHORTEST_RAMP = 0.1
#: Fewest samples in a movement: with fewer it would not have the requested shape.
_FEWEST_SAMPLES = 8

#: Default rate of the fastest loops [Hz], and its ratio to that of the slow ones.
_DEFAULT_RATE = 5.0
_DEFAULT_RATIO = 10.0
#: Smallest limit of the slope over the effect of rounding.
_RESOLVED = 10.0

#: Numbers of reversal curves, of which the largest that fits is used.
_LEVELS = (16, 13, 10, 8, 6, 5, 4)
_DEFAULT_LEVELS = 10
#: Fewest before slower rates are raised.
_ENOUGH_LEVELS = 6
#: Smallest ratio of rates for twice as many loops at the fastest one.
_CHEAP = 4.0
#: Smallest ratio of the fastest rate to raised ones.
NEAREST_RATES = 8.0
#: Time at rest before the first movement and after the last one [s].
_AT_REST = 0.25

#: Means of the nested loops and their largest range, as shares of the whole range.
_MIDDLE = (0.49, 0.9)
_LOW = (0.26, 0.46)
_HIGH = (0.73, 0.5)

# Kinds of segments at each rate, in their order.
_MAJOR = "major loops"
_DESCENDING = "descending reversal curves"
_ASCENDING = "ascending reversal curves"
_NESTED = "nested loops about the middle"
_NESTED_LOW = "nested loops about a low mean"
_NESTED_HIGH = "nested loops about a high mean"
HOLD = "step and hold"
RESONANCE = "multisine at the resonance"
_REPEATED = "repeated major loops"
_LOOPS = "all loops"
_SLOW_START = "conditioning at the slowest rate (at the fastest instead)"

#: Omissions if the time is short, the least useful part first: kind, and rates.
_OMISSIONS = (
    (_ASCENDING, "slower"),
    (_DESCENDING, "slower"),
    (_NESTED_HIGH, "slower"),
    (_NESTED_LOW, "slower"),
    (_REPEATED, "all"),
    (_LOOPS, "middle"),
    (_SLOW_START, ""),
    (_NESTED, "slower"),
    (RESONANCE, ""),
    (_NESTED_HIGH, "fastest"),
    (_NESTED_LOW, "fastest"),
    (HOLD, ""),
    (_ASCENDING, "fastest"),
    (_DESCENDING, "fastest"),
)


@dataclass(frozen=True, slots=True, kw_only=True)
class Movement:
    r"""Monotone movements between two voltages, within a limit of the slope.

    A movement by a in the time T is a ``triangle`` (constant speed), a ``sine`` (half a cosine)
    or ``smooth``: the speed rises to its largest value over a time :math:`\beta T` as half a
    cosine does, is constant, and falls as it rose. The largest speed is a/T,
    :math:`\pi a / (2 T)` and :math:`a / ((1 - \beta) T)`.

    A major loop over `span` has the duration 1/rate. Smaller loops have the same speed, and so the
    same slope and current, up to a repetition rate of `highest_frequency_hz` or five times the
    rate.
    """

    shape: str
    """``smooth``, ``sine`` or ``triangle``."""
    span: float
    """Voltage range of a major loop [V]."""
    sample_rate_hz: float
    """Sample rate [Hz]."""
    slope_limit: float = math.inf
    """Largest slope [V/s]; infinite if unlimited."""
    turn_time: float = 0.0
    """Time over which the speed of a smooth movement rises or falls, if the movement is long
    enough [s].
    """
    highest_frequency_hz: float = math.inf
    """Highest repetition rate of a loop [Hz]."""

    def shortest(self, distance: float) -> float:
        """Return the shortest duration of a movement within the limit of the slope.

        Examples
        --------
        >>> smooth = Movement(
        ...     shape="smooth", span=120.0, sample_rate_hz=1e4, slope_limit=1000.0, turn_time=0.01
        ... )
        >>> round(smooth.shortest(90.0), 6), round(smooth.shortest(5.0), 6)
        (0.1, 0.01)
        """
        least = distance / self.slope_limit
        if self.shape == "triangle":
            return least
        if self.shape == "sine":
            return 0.5 * math.pi * least
        # T (1 - beta) rises with T; this is its inverse on its three pieces
        return max(least / (1.0 - _SHORTEST_RAMP), min(2.0 * least, least + self.turn_time))

    def highest_rate(self) -> float:
        """Return the highest rate of a major loop [Hz] that the limits allow."""
        time = max(self.shortest(self.span), _FEWEST_SAMPLES / self.sample_rate_hz)
        return min(0.5 / time, self.highest_frequency_hz)

    def count(self, distance: float, rate_hz: float) -> int:
        """Return the steps of a movement over a distance [V], of major loops of a rate [Hz]."""
        if distance == 0.0:
            return 0
        often = min(_MOST_OFTEN * rate_hz, max(rate_hz, self.highest_frequency_hz))
        time = max(distance / self.span / (2.0 * rate_hz), 0.5 / often, self.shortest(distance))
        # an integer number of steps, so that every turning point is a sample
        return max(math.ceil(time * self.sample_rate_hz * (1.0 - 1e-12)), _FEWEST_SAMPLES)

    def samples(self, start: float, end: float, count: int) -> Array:
        """Return the voltages of a movement after its start, `count` of them."""
        s = np.arange(1, count + 1) / count
        if self.shape == "sine":
            s = 0.5 * (1.0 - np.cos(np.pi * s))
        elif self.shape == "smooth":
            share = self.turn_time * self.sample_rate_hz / count if count else 0.0
            s = _smooth(s, min(max(share, _SHORTEST_RAMP), 0.5))
        values = start + (end - start) * s
        values[-1:] = end
        return values


def _smooth(s: Array, ramp: float) -> Array:
    """Distance at the time s, both as shares, with ramps of speed over the share `ramp`."""
    # by symmetry the second half is the first one backwards
    t = np.minimum(s, 1.0 - s)
    rising = 0.5 * t - ramp / (2.0 * np.pi) * np.sin(np.pi * np.minimum(t, ramp) / ramp)
    way = np.where(t < ramp, rising, t - 0.5 * ramp) / (1.0 - ramp)
    return np.where(s <= 0.5, way, 1.0 - way)


@dataclass(frozen=True, slots=True, kw_only=True)
class ExcitationSegment:
    """Part of a design."""

    name: str
    """Its name."""
    rate_hz: float
    """Rate of a major loop at its speed [Hz]."""
    targets: tuple[float, ...]
    """Voltages to go to, one after the other [V]."""
    waits: tuple[float, ...] = ()
    """Time to wait at each of them [s]; empty for none."""
    multisine: float = 0.0
    """Duration of a multisine at the last of them [s]."""

    def steps(self, start: float, movement: Movement) -> Iterator[tuple[float, int, int]]:
        """Yield each target [V], with the numbers of samples of the movement and of the wait."""
        waits = self.waits or (0.0,) * len(self.targets)
        for target, wait in zip(self.targets, waits, strict=True):
            step_count = movement.count(abs(target - start), self.rate_hz)
            yield target, step_count, round(wait * movement.sample_rate_hz)
            start = target


@dataclass(frozen=True, slots=True, kw_only=True)
class ExcitationDesign:
    """Content of a record."""

    voltage_range: tuple[float, float]
    """Lowest and highest voltage [V]."""
    rest_voltage: float
    """Voltage at which it starts and ends [V]."""
    rates_hz: tuple[float, ...]
    """Rates of the major loops, rising [Hz]."""
    hold: float
    """Time of the step and hold for creep [s]; 0 for none."""
    multisine: float
    """Time of the multisine at the resonance [s]; 0 for none."""
    levels: int = _DEFAULT_LEVELS
    """Number of reversal curves of each family."""
    omissions: int = 0
    """Number of omissions."""

    @property
    def omitted(self) -> tuple[str, ...]:
        """Requested parts that are omitted."""
        requested = {HOLD: self.hold > 0.0, RESONANCE: self.multisine > 0.0}
        several = {"": True, "all": True, "fastest": True}
        several |= {"slower": len(self.rates_hz) > 1, "middle": len(self.rates_hz) > 2}
        words = {
            "": "",
            "all": "",
            "slower": " at the slower rates",
            "middle": " between the rates",
        }
        words["fastest"] = " at the fastest rate"
        return tuple(
            what + words[where]
            for what, where in _OMISSIONS[: self.omissions]
            if several[where] and requested.get(what, True)
        )

    def segments(self) -> tuple[ExcitationSegment, ...]:
        """Return its parts in their order, from and to the rest voltage."""
        low, high = self.voltage_range
        slowest, fastest = self.rates_hz[0], self.rates_hz[-1]
        rest = self.rest_voltage
        segments = [
            ExcitationSegment(
                name="conditioning",
                rate_hz=fastest if self._without(_SLOW_START, "") else slowest,
                targets=(rest, high, low, high, low),
                waits=(_AT_REST, 0.0, 0.0, 0.0, 0.0),
            )
        ]
        for rate in self.rates_hz:
            if fastest > rate > slowest and self._without(_LOOPS, "middle"):
                continue
            where = "fastest" if rate == fastest else "slower"
            segments += self._loops(rate, where)
        if self.hold and not self._without(HOLD, ""):
            up, down = low + 0.83 * (high - low), low + 0.22 * (high - low)
            waits = (self.hold * 2.0 / 3.0, self.hold / 3.0)
            segments.append(
                ExcitationSegment(name=HOLD, rate_hz=fastest, targets=(up, down), waits=waits)
            )
        if self.multisine and not self._without(RESONANCE, ""):
            middle = low + 0.47 * (high - low)
            segments.append(
                ExcitationSegment(
                    name=RESONANCE, rate_hz=fastest, targets=(middle,), multisine=self.multisine
                )
            )
        segments.append(
            ExcitationSegment(
                name="return", rate_hz=fastest, targets=(low, rest), waits=(0.0, _AT_REST)
            )
        )
        return tuple(segments)

    def samples(self, movement: Movement) -> int:
        """Return the number of samples, with the first."""
        count, at = 1, self.rest_voltage
        for segment in self.segments():
            for target, step_count, wait in segment.steps(at, movement):
                count += step_count + wait
                at = target
            # the size of `multisine`
            count += math.ceil(segment.multisine * movement.sample_rate_hz)
        return count

    def _without(self, what: str, where: str) -> bool:
        return (what, where) in _OMISSIONS[: self.omissions]

    def _loops(self, rate: float, where: str) -> Iterator[ExcitationSegment]:
        """Yield the loops of one rate; each kind ends at an end of the range."""
        low, high = self.voltage_range
        repeated = not self._without(_REPEATED, "all")
        # the loops of the fastest rate include those of the slower ones
        times = 2 if where == "fastest" and rate > _CHEAP * self.rates_hz[0] else 1
        n = times * (self.levels + 1) - 1
        inner = [k / (n + 1) for k in range(n, 0, -1)]
        fewer = times * max(self.levels // 2, 3)
        kinds: tuple[tuple[str, list[float]], ...] = (
            (_MAJOR, [1.0, 0.0] * (2 if repeated else 1)),
            (_DESCENDING, [x for level in inner for x in (level, 0.0)]),
            (_NESTED_LOW, [*_nested(_LOW, fewer, first=1.0), 0.0]),
            (_ASCENDING, [1.0] + [x for level in inner for x in (1.0 - level, 1.0)]),
            (_NESTED_HIGH, [1.0, *_nested(_HIGH, fewer, first=-1.0), 1.0]),
            (_NESTED, [1.0, *_nested(_MIDDLE, times * self.levels, first=-1.0), 0.0]),
        )
        for name, turning_points in kinds:
            if not self._without(name, where):
                # both ends of the range are reached exactly
                targets = tuple(
                    high if x == 1.0 else low + x * (high - low) for x in turning_points
                )
                yield ExcitationSegment(name=name, rate_hz=rate, targets=targets)


def _nested(loops: tuple[float, float], count: int, first: float) -> list[float]:
    """Return the turning points of loops of decreasing range, as shares of the full range."""
    mean, largest = loops
    return [
        mean + side * 0.5 * largest * (1.0 - k / count)
        for k in range(count)
        for side in (first, -first)
    ]


def design_within_limits(
    design: ExcitationDesign, movement: Movement, most: int | None, free_up_to: float
) -> ExcitationDesign | None:
    """Return the design with the most content that fits.

    First rates are raised: all of them up to `free_up_to`, or the slower ones up to an eighth of
    the fastest. Then parts are omitted, the least useful first. With `most` None the number of
    samples is unlimited; for requested rates `free_up_to` is 0. None if not even the least content
    fits.
    """
    if most is None:
        return design
    raised = tuple(
        replace(design, rates_hz=rates) for rates in _raised(design.rates_hz, free_up_to)
    )
    candidates = [(p, 0, _ENOUGH_LEVELS) for p in (design, *raised[:-1])]
    candidates += [(raised[-1], omissions, 0) for omissions in range(len(_OMISSIONS) + 1)]
    for base, omissions, least in candidates:
        for levels in (n for n in _LEVELS if n >= least):
            candidate = replace(base, levels=levels, omissions=omissions)
            if candidate.samples(movement) <= most:
                return candidate
    return None


def shortest(design: ExcitationDesign, movement: Movement, free_up_to: float) -> int:
    """Return the number of samples of the least content."""
    rates = _raised(design.rates_hz, free_up_to)[-1]
    least = replace(design, rates_hz=rates, levels=_LEVELS[-1], omissions=len(_OMISSIONS))
    return least.samples(movement)


def _raised(rates: tuple[float, ...], free_up_to: float) -> list[tuple[float, ...]]:
    if free_up_to > rates[-1]:
        factors = [f for f in (1.5, 2.0, 3.0, 5.0, 8.0) if f * rates[-1] < free_up_to]
        return [tuple(f * r for r in rates) for f in (*factors, free_up_to / rates[-1])]
    slowest, fastest = rates[0], rates[-1]
    if fastest <= NEAREST_RATES * slowest:
        return [rates]
    # the ratio of the rates is reduced, in proportion of their logarithms
    exponent = math.log(NEAREST_RATES) / math.log(fastest / slowest)
    return [tuple(fastest * (r / fastest) ** exponent for r in rates)]


def checked_range(voltage_range: tuple[float, float]) -> tuple[float, float]:
    """Return a range of voltages after checking it."""
    low, high = (float(v) for v in voltage_range)
    if not (math.isfinite(low) and math.isfinite(high) and low < high):
        raise ModelError(f"the voltage range must rise and be finite, got {low:g} V to {high:g} V")
    return low, high


def checked_rest(rest: float | None, low: float, high: float) -> float:
    """Return the rest voltage after checking it.

    None is 0 V, or the end of the range next to it.
    """
    if rest is None:
        return min(max(0.0, low), high)
    if not low <= rest <= high:
        raise ModelError(f"the rest voltage must be in {low:g} V to {high:g} V, got {rest!r} V")
    return float(rest)


def safe_slope(slope: float | None, rounding: float) -> float:
    """Return the largest slope of voltages before rounding [V/s]; infinite if unlimited.

    Slope limit [V/s], and the largest effect of rounding of the voltages on the slope [V/s].
    """
    limit = math.inf if slope is None else slope
    if limit <= _RESOLVED * rounding:
        raise ModelError(
            f"a slope of at most {limit:g} V/s is too low to be resolved at this sample rate: "
            "lower the sample rate or raise the limit"
        )
    return limit - rounding


def usable_rates(requested: Sequence[float], movement: Movement) -> tuple[float, ...]:
    """Return the rates of the major loops [Hz], rising; two by default."""
    highest = movement.highest_rate()
    if not requested:
        fastest = min(_DEFAULT_RATE, highest)
        return (fastest / _DEFAULT_RATIO, fastest)
    rates = tuple(sorted({float(r) for r in requested}))
    if rates[-1] > highest * (1.0 + 1e-9):
        raise ModelError(
            f"{movement.shape} loops over {movement.span:g} V at {rates[-1]:g} Hz are too fast: "
            f"{_rate_limit(movement)} allows at most {highest:.4g} Hz"
        )
    return rates


def _rate_limit(movement: Movement) -> str:
    """Name the limit of the rate."""
    highest = movement.highest_rate()
    if highest == movement.highest_frequency_hz:
        return "a tenth of the lowest natural frequency"
    if highest * 2.0 * movement.shortest(movement.span) > 1.0 - 1e-9:
        return "the limit of slope or current"
    return "the sample rate"
