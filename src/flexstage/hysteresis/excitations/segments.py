"""What a record for identification holds within its limits, in which order, what is left out."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

from flexstage.base.errors import ModelError
from flexstage.hysteresis.excitations.excitation import Movement

#: Rate of the fastest loops where nobody asks for one [Hz], and how many times slower others are.
_USUAL_RATE = 5.0
_USUAL_RATIO = 10.0
#: A limit of the slope must be this many times what is lost by rounding.
_RESOLVED = 10.0

#: Numbers of reversal curves, of which the largest that fits is taken.
_LEVELS = (16, 13, 10, 8, 6, 5, 4)
_USUAL_LEVELS = 10
#: Fewer are taken only when slower rates have been raised.
_ENOUGH_LEVELS = 6
#: The loops of the fastest rate are twice as many where it is so many times as fast.
_CHEAP = 4.0
#: Rates are raised no nearer to the fastest one than this.
NEAREST_RATES = 8.0
#: Time at rest before the first movement and after the last one [s].
_AT_REST = 0.25

#: Means of the nested loops and their largest range, as shares of the whole range.
_MIDDLE = (0.49, 0.9)
_LOW = (0.26, 0.46)
_HIGH = (0.73, 0.5)

# Kinds of segments at each rate, in the order in which they are run.
_MAJOR = "major loops"
_FALLING = "reversal curves down"
_RISING = "reversal curves up"
_NESTED = "nested loops about the middle"
_NESTED_LOW = "nested loops about a low mean"
_NESTED_HIGH = "nested loops about a high mean"
HOLD = "step and hold"
RESONANCE = "multisine at the resonance"
_REPEATED = "repeated major loops"
_LOOPS = "all loops"
_SLOW_START = "conditioning at the slowest rate, which is at the fastest instead"

#: What is left out where time is short, the least useful first: what, and at which rates.
_LEFT_OUT = (
    (_RISING, "slower"),
    (_FALLING, "slower"),
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
    (_RISING, "fastest"),
    (_FALLING, "fastest"),
)


@dataclass(frozen=True, slots=True, kw_only=True)
class ExcitationSegment:
    """One part of a design."""

    name: str
    """What it is."""
    rate_hz: float
    """Rate at which it moves [Hz]."""
    targets: tuple[float, ...]
    """Voltages to go to, one after the other [V]."""
    waits: tuple[float, ...] = ()
    """Time to wait at each of them [s]; empty for none."""
    multisine: float = 0.0
    """Duration of a multisine at the last of them [s]."""

    def steps(self, start: float, movement: Movement) -> Iterator[tuple[float, int, int]]:
        """Give each target [V] with the samples of the movement there and of the wait."""
        waits = self.waits or (0.0,) * len(self.targets)
        for target, wait in zip(self.targets, waits, strict=True):
            moved = movement.count(abs(target - start), self.rate_hz)
            yield target, moved, round(wait * movement.sample_rate_hz)
            start = target


@dataclass(frozen=True, slots=True, kw_only=True)
class ExcitationDesign:
    """What is asked of a record."""

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
    levels: int = _USUAL_LEVELS
    """Number of reversal curves of each family."""
    dropped: int = 0
    """How much is left out."""

    @property
    def left_out(self) -> tuple[str, ...]:
        """What is left out of what was asked."""
        asked = {HOLD: self.hold > 0.0, RESONANCE: self.multisine > 0.0}
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
            for what, where in _LEFT_OUT[: self.dropped]
            if several[where] and asked.get(what, True)
        )

    def segments(self) -> tuple[ExcitationSegment, ...]:
        """Return its parts in the order in which they are run, from and to the rest voltage."""
        low, high = self.voltage_range
        slowest, fastest = self.rates_hz[0], self.rates_hz[-1]
        rest = self.rest_voltage
        made = [
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
            made += self._loops(rate, where)
        if self.hold and not self._without(HOLD, ""):
            up, down = low + 0.83 * (high - low), low + 0.22 * (high - low)
            waits = (self.hold * 2.0 / 3.0, self.hold / 3.0)
            made.append(
                ExcitationSegment(name=HOLD, rate_hz=fastest, targets=(up, down), waits=waits)
            )
        if self.multisine and not self._without(RESONANCE, ""):
            middle = low + 0.47 * (high - low)
            made.append(
                ExcitationSegment(
                    name=RESONANCE, rate_hz=fastest, targets=(middle,), multisine=self.multisine
                )
            )
        made.append(
            ExcitationSegment(
                name="return", rate_hz=fastest, targets=(low, rest), waits=(0.0, _AT_REST)
            )
        )
        return tuple(made)

    def samples(self, movement: Movement) -> int:
        """Return how many samples it takes, with the first."""
        count, at = 1, self.rest_voltage
        for segment in self.segments():
            for target, moved, waited in segment.steps(at, movement):
                count += moved + waited
                at = target
            # as many as `multisine` makes
            count += math.ceil(segment.multisine * movement.sample_rate_hz)
        return count

    def _without(self, what: str, where: str) -> bool:
        return (what, where) in _LEFT_OUT[: self.dropped]

    def _loops(self, rate: float, where: str) -> Iterator[ExcitationSegment]:
        """Give the loops of one rate; each kind starts anywhere and ends at an end of the range."""
        low, high = self.voltage_range
        repeated = not self._without(_REPEATED, "all")
        # every loop of the slower rates is among those of the fastest
        times = 2 if where == "fastest" and rate > _CHEAP * self.rates_hz[0] else 1
        n = times * (self.levels + 1) - 1
        inner = [k / (n + 1) for k in range(n, 0, -1)]
        fewer = times * max(self.levels // 2, 3)
        kinds: tuple[tuple[str, list[float]], ...] = (
            (_MAJOR, [1.0, 0.0] * (2 if repeated else 1)),
            (_FALLING, [x for level in inner for x in (level, 0.0)]),
            (_NESTED_LOW, [*_nested(_LOW, fewer, first=1.0), 0.0]),
            (_RISING, [1.0] + [x for level in inner for x in (1.0 - level, 1.0)]),
            (_NESTED_HIGH, [1.0, *_nested(_HIGH, fewer, first=-1.0), 1.0]),
            (_NESTED, [1.0, *_nested(_MIDDLE, times * self.levels, first=-1.0), 0.0]),
        )
        for name, way in kinds:
            if not self._without(name, where):
                # both ends of the range are met exactly
                targets = tuple(high if x == 1.0 else low + x * (high - low) for x in way)
                yield ExcitationSegment(name=name, rate_hz=rate, targets=targets)


def _nested(loops: tuple[float, float], count: int, first: float) -> list[float]:
    """Return the turning points of loops of falling range about a mean, as shares of the range."""
    mean, largest = loops
    return [
        mean + side * 0.5 * largest * (1.0 - k / count)
        for k in range(count)
        for side in (first, -first)
    ]


def fitted(
    design: ExcitationDesign, movement: Movement, most: int | None, free_up_to: float
) -> ExcitationDesign | None:
    """Return the richest record that fits.

    First rates are raised: all of them up to `free_up_to`, or the slower ones up to an eighth of
    the fastest. Then content is left out, in the order of its worth. With `most` None there is no
    limit of samples; rates that were asked for have `free_up_to` 0. None where not even the least
    record fits.
    """
    if most is None:
        return design
    raised = tuple(
        replace(design, rates_hz=rates) for rates in _raised(design.rates_hz, free_up_to)
    )
    tries = [(p, 0, _ENOUGH_LEVELS) for p in (design, *raised[:-1])]
    tries += [(raised[-1], dropped, 0) for dropped in range(len(_LEFT_OUT) + 1)]
    for base, dropped, least in tries:
        for levels in (n for n in _LEVELS if n >= least):
            found = replace(base, levels=levels, dropped=dropped)
            if found.samples(movement) <= most:
                return found
    return None


def shortest(design: ExcitationDesign, movement: Movement, free_up_to: float) -> int:
    """Return how many samples the least record takes."""
    rates = _raised(design.rates_hz, free_up_to)[-1]
    least = replace(design, rates_hz=rates, levels=_LEVELS[-1], dropped=len(_LEFT_OUT))
    return least.samples(movement)


def _raised(rates: tuple[float, ...], free_up_to: float) -> list[tuple[float, ...]]:
    if free_up_to > rates[-1]:
        factors = [f for f in (1.5, 2.0, 3.0, 5.0, 8.0) if f * rates[-1] < free_up_to]
        return [tuple(f * r for r in rates) for f in (*factors, free_up_to / rates[-1])]
    slowest, fastest = rates[0], rates[-1]
    if fastest <= NEAREST_RATES * slowest:
        return [rates]
    # the ends of the row of rates are moved together, and those between keep their share
    exponent = math.log(NEAREST_RATES) / math.log(fastest / slowest)
    return [tuple(fastest * (r / fastest) ** exponent for r in rates)]


def checked_range(given: tuple[float, float]) -> tuple[float, float]:
    """Return a range of voltages after checking it."""
    low, high = (float(v) for v in given)
    if not (math.isfinite(low) and math.isfinite(high) and low < high):
        raise ModelError(f"the voltage range must rise and be finite, got {low:g} V to {high:g} V")
    return low, high


def checked_rest(rest: float | None, low: float, high: float) -> float:
    """Return the voltage at rest.

    None asks for 0 V, or the end of the range next to it.
    """
    if rest is None:
        return min(max(0.0, low), high)
    if not low <= rest <= high:
        raise ModelError(f"the rest voltage must be in {low:g} V to {high:g} V, got {rest!r} V")
    return float(rest)


def safe_slope(slope: float | None, rounding: float) -> float:
    """Return the slope that voltages before rounding may have.

    Slope limit [V/s], and what rounding of the voltages may add to the slope [V/s]; infinite where
    there is no limit.
    """
    limit = math.inf if slope is None else slope
    if limit <= _RESOLVED * rounding:
        raise ModelError(
            f"a slope of at most {limit:g} V/s is too low to be resolved at this sample rate: "
            "lower the sample rate or raise the limit"
        )
    return limit - rounding


def usable_rates(given: Sequence[float], movement: Movement) -> tuple[float, ...]:
    """Return the rates of the major loops [Hz], rising; two usual ones where none are asked."""
    highest = movement.highest_rate()
    if not given:
        fastest = min(_USUAL_RATE, highest)
        return (fastest / _USUAL_RATIO, fastest)
    rates = tuple(sorted({float(r) for r in given}))
    if rates[-1] > highest * (1.0 + 1e-9):
        raise ModelError(
            f"{movement.shape} loops over {movement.span:g} V at {rates[-1]:g} Hz are too fast: "
            f"{_why(movement)} allows at most {highest:.4g} Hz"
        )
    return rates


def _why(movement: Movement) -> str:
    """Name what bounds the rate."""
    highest = movement.highest_rate()
    if highest == movement.highest_frequency_hz:
        return "a tenth of the lowest natural frequency"
    if highest * 2.0 * movement.shortest(movement.span) > 1.0 - 1e-9:
        return "the limit of slope or current"
    return "the sample rate"
