"""What a drive record may ask of stack and amplifier."""

import math
from collections.abc import Sequence

from flexstage.errors import ModelError
from flexstage.hysteresis.excitations.shapes import Movement

#: Rate of the fastest loops where nobody asks for one [Hz], and how many times slower others are.
_USUAL_RATE = 5.0
_USUAL_RATIO = 10.0
#: A limit of the slope must be this many times what is lost by rounding.
_RESOLVED = 10.0


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


def require_positive(given: dict[str, tuple[float | None, str]]) -> None:
    """Refuse numbers that are not positive and finite; None passes."""
    for name, (value, unit) in given.items():
        if value is not None and not 0.0 < value < math.inf:
            raise ModelError(f"the {name} must be positive and finite, got {value!r} {unit}")


def safe_slope(
    slope: float | None, current: float | None, capacitance: float | None, rounding: float
) -> float:
    """Return the slope that voltages before rounding may have.

    Slope limit [V/s], current limit [A], capacitance [F], and what rounding of the voltages may add
    to the slope [V/s]; infinite where there is no limit.
    """
    if current is not None and capacitance is None:
        raise ModelError("a limit of the current needs the capacitance of the stack: give both")
    limit = math.inf if slope is None else slope
    if current is not None and capacitance is not None:
        limit = min(limit, current / capacitance)
    if limit <= _RESOLVED * rounding:
        raise ModelError(
            f"a slope of at most {limit:g} V/s is too low to be resolved at this sample rate: "
            "lower the sample rate or raise the limit"
        )
    return limit - rounding


def usable_rates(given: Sequence[float] | None, movement: Movement) -> tuple[float, ...]:
    """Return the rates of the major loops [Hz], rising; two usual ones where none are asked."""
    highest = movement.highest_rate()
    if given is None:
        fastest = min(_USUAL_RATE, highest)
        return (fastest / _USUAL_RATIO, fastest)
    rates = tuple(sorted({float(r) for r in given}))
    if not rates or not all(0.0 < r < math.inf for r in rates):
        raise ModelError(f"the rates must be positive and finite, got {list(given)} Hz")
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
