"""Cycles of a drive signal: turning points, rates, minor loops, and what is before the first."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from flexstage.base.arrays import Array
from flexstage.hysteresis.compiled import compiled
from flexstage.records.quality import difference_noise


@dataclass(frozen=True, slots=True)
class _Thresholds:
    """What a movement is, a cycle, a wait, a rate, and the memory of what was before."""

    swing: float = 0.02
    """A movement is counted when it is larger than this share of the whole range."""
    noise_swing: float = 8.0
    """A movement is counted when it is larger than this many times the noise of the signal."""
    major: float = 0.9
    """A cycle that moves over this share of the range and more is a major one."""
    steps: int = 8
    """Cycles that take fewer samples to move are jumps from one level to another."""
    wait: float = 10.0
    """A signal waits where it stands still for more than this many times as long as it
    usually does between two movements: the levels of a staircase are no waits.
    """
    few: int = 3
    """Of a record with fewer lower turning points than this, a low end counts as one."""
    low_end: float = 0.05
    """An end is low where it is no higher than this share of the range."""
    other_rate: float = 1.5
    """Two cycles differ in rate when their frequencies differ by more than this factor."""
    rate_cycles: int = 3
    """A rate has so many cycles, as noise may split one in two, or `rate_time` of the time."""
    rate_time: float = 0.1
    """A rate of fewer cycles takes this share of the time of all."""
    regular: float = 0.95
    """A signal is held where this share of its steps are whole numbers of holds apart."""
    held_step: float = 1e-3
    """Steps of a held signal are larger than this share of its range, as those of a
    converter are not.
    """
    end: float = 0.05
    """The memory of what was before a record is wiped out when both ends of the range were
    reached, within this share of the range.
    """
    warm_up: float = 0.4
    """At most this share of a record is given to that."""
    move: float = 0.002
    """A change of the input that is less than this share of its range is no motion."""
    rest: int = 20
    """Samples that are kept of a rest before the motion."""


_THRESHOLDS = _Thresholds()


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Cycles:
    """How a drive signal moves."""

    bounds: NDArray[np.intp]
    """First sample of each whole cycle, and the sample after the last, shape (c + 1,). A cycle
    leads from one lower turning point to the next.
    """
    swing: Array
    """Range that is moved over in each cycle, as a share of the whole range, shape (c,)."""
    frequency_hz: Array
    """Reciprocal of the time that the signal moves in each cycle [Hz], shape (c,)."""
    turning: NDArray[np.intp]
    """Turning points [samples]."""
    range: tuple[float, float]
    """Lowest and highest value."""

    @property
    def rates_hz(self) -> tuple[float, ...]:
        """Rates of cycles over at least half of the range, that differ by more than half [Hz].

        A smaller loop at the same speed repeats more often, and one of the same period is slower:
        another rate is one at which both differ.
        """
        return tuple(sorted(rate for rate, _ in by_rate(self.frequency_hz, self.swing)))

    @property
    def has_minor_loops(self) -> bool:
        """Whether at least three cycles, of different size, stay inside the whole range."""
        minor = self.swing[self.swing < _THRESHOLDS.major]
        return minor.size >= 3 and float(np.ptp(minor)) > 0.1


def _differ(first: float, second: float) -> bool:
    return max(first, second) > _THRESHOLDS.other_rate * min(first, second)


def by_rate(frequency_hz: Array, swing: Array) -> list[tuple[float, NDArray[np.intp]]]:
    """Return the rates of cycles, each with the cycles that belong to it.

    The swing is a share of the whole range. Cycles that repeat, or move, as fast as large ones
    belong to a rate [Hz]; the turns of a transition from one motion to another belong to none.
    """
    speed = frequency_hz * swing
    # large cycles make the rates, the largest first
    order = sorted(np.flatnonzero(swing > 0.5), key=lambda i: (-swing[i].round(1), frequency_hz[i]))
    found: list[tuple[int, list[int]]] = []
    for i in map(int, (*order, *np.flatnonzero(swing <= 0.5))):
        same = (
            own
            for first, own in found
            if not (
                _differ(frequency_hz[i], frequency_hz[first]) and _differ(speed[i], speed[first])
            )
        )
        group = next(same, None)
        if group is not None:
            group.append(i)
        elif swing[i] > 0.5:
            found.append((i, [i]))
    time = [sum(1.0 / frequency_hz[i] for i in own if swing[i] > 0.5) for _, own in found]
    many = [sum(swing[i] > 0.5 for i in own) for _, own in found]
    return [
        (float(frequency_hz[first]), np.sort(own))
        for (first, own), t, n in zip(found, time, many, strict=True)
        if n >= _THRESHOLDS.rate_cycles or t >= _THRESHOLDS.rate_time * sum(time)
    ]


@compiled
def _zigzag(u: Array, threshold: float, out: NDArray[np.intp]) -> int:
    """Write the turning points of movements that are larger than the threshold; return how many."""
    count, low, high, direction = 0, 0, 0, 0
    for k in range(u.size):
        if u[k] > u[high]:
            high = k
        if u[k] < u[low]:
            low = k
        if direction >= 0 and u[high] - u[k] > threshold:
            if direction > 0 or high > 0:
                out[count] = high
                count += 1
            direction, low = -1, k
            high = k
        elif direction <= 0 and u[k] - u[low] > threshold:
            if direction < 0 or low > 0:
                out[count] = low
                count += 1
            direction, high = 1, k
            low = k
    return count


def turning_points(u: Array, threshold: float) -> NDArray[np.intp]:
    """Return the samples where a signal turns, without ends and movements below a threshold.

    Examples
    --------
    >>> turning_points(np.array([0.0, 1.0, 2.0, 1.9, 3.0, 0.5, 0.6, 0.0, 2.0]), 0.5)
    array([4, 7])
    """
    found = np.empty(u.size, dtype=np.intp)
    count = _zigzag(np.ascontiguousarray(u, dtype=np.float64), threshold, found)
    return found[:count].copy()


def cycles(u: Array, dt: float, noise_taken: float = 0.0) -> Cycles:
    """Find the cycles of a drive signal.

    Parameters
    ----------
    u : numpy.ndarray
        The signal, shape (n,).
    dt : float
        Time from one sample to the next [s].
    noise_taken : float
        Standard deviation of noise that was taken out of it, but for some of it.

    Returns
    -------
    Cycles
        Its whole cycles. What comes before the first lower turning point and after the last one
        belongs to no cycle; of a record of one cycle or two, its ends are such points where the
        signal is low there.

    Examples
    --------
    >>> t = np.arange(1000) / 200.0
    >>> found = cycles(60.0 - 60.0 * np.cos(2.0 * np.pi * t), 1.0 / 200.0)
    >>> found.bounds, found.frequency_hz.round(2)
    (array([200, 400, 600, 800]), array([1., 1., 1.]))
    """
    low, high = float(u.min()), float(u.max())
    noise = input_noise(u)
    least = _THRESHOLDS.noise_swing * max(noise, noise_taken)
    turning = turning_points(u, max(_THRESHOLDS.swing * (high - low), least))
    lower = turning[1:] if turning.size and _is_high(u, turning) else turning
    bounds = lower[::2]
    if bounds.size < _THRESHOLDS.few:
        bounds = _with_ends(u, bounds, low + _THRESHOLDS.low_end * (high - low))
    count = max(bounds.size - 1, 0)
    swing, frequency = np.zeros(count), np.zeros(count)
    for i in range(count):
        part = u[bounds[i] : bounds[i + 1] + 1]
        size = float(np.ptp(part))
        swing[i] = size / (high - low)
        frequency[i] = 1.0 / (dt * _moving_time(part, noise))
    return Cycles(
        bounds=bounds, swing=swing, frequency_hz=frequency, turning=turning, range=(low, high)
    )


def input_noise(u: Array) -> float:
    """Return the standard deviation of the noise of a drive signal, at most 1 % of its range."""
    if u.size < 5:
        return 0.0
    # differences of second order see noise, and hardly the movement itself
    noise = difference_noise(u, 2)
    # a command moves by differences of second order as well: noise is what steps at once exceed
    return min(noise, float(np.ptp(u)) / 100.0)


def held_samples(u: Array) -> int:
    """Return for how many samples a signal is held, as a staircase; 1 where it is not.

    Examples
    --------
    >>> held_samples(np.sin(np.arange(400) // 8 * 0.4))
    8
    """
    steps, size = np.abs(np.diff(u)), float(np.ptp(u))
    moved = np.flatnonzero(steps > 1e-9 * size)
    if moved.size < _THRESHOLDS.steps:
        return 1
    if float(np.median(steps[moved])) < _THRESHOLDS.held_step * size:
        return 1
    between = np.diff(moved)
    held = int(np.median(between))
    return held if float(np.mean(between % held == 0)) >= _THRESHOLDS.regular else 1


def _moving_time(part: Array, noise: float) -> float:
    """Number of samples that a cycle moves for, without its waits."""
    steps = np.abs(np.diff(part))
    moving = np.flatnonzero(steps > max(1e-3 * float(steps.max()), 4.0 * noise))
    # a signal that jumps is no faster for it: a step has no rate
    if moving.size < _THRESHOLDS.steps:
        return float(steps.size)
    # the time from one movement to the next: 1 where it moves at every sample, more on a staircase
    between = np.diff(np.concatenate(([-1], moving, [max(moving[-1], steps.size - 1)])))
    usual = max(float(np.median(between)), 1.0)
    return float(np.sum(np.where(between > _THRESHOLDS.wait * usual, usual, between)))


def _with_ends(u: Array, bounds: NDArray[np.intp], at_most: float) -> NDArray[np.intp]:
    """Add the ends of a short record to its lower turning points, where the signal is low there."""
    first = [0] if u[0] <= at_most else []
    last = [u.size - 1] if u[-1] <= at_most else []
    inner = [int(b) for b in bounds if 0 < b < u.size - 1]
    return np.array([*first, *inner, *last], dtype=np.intp)


def _is_high(u: Array, turning: NDArray[np.intp]) -> bool:
    if turning.size == 1:
        return bool(u[turning[0]] > u[0])
    return bool(u[turning[0]] > u[turning[1]])


def first_moving(u: Array) -> int:
    """Return where an input begins to move, less some samples; 0 where it moves from the start."""
    noise = input_noise(u)
    still = np.abs(u - float(np.median(u[: _THRESHOLDS.rest]))) <= max(
        _THRESHOLDS.move * float(np.ptp(u)), 6.0 * noise
    )
    moves = int(np.argmin(still)) if still[0] and not still.all() else 0
    # a slow start is a part of the motion: only a rest that is long beside it is left out
    return max(moves - _THRESHOLDS.rest, 0)


def warm_up(u: Array, moves: Cycles) -> int:
    """Return how many first samples still know what was before the record."""
    # and a whole cycle after it where there are many: other memory fades there
    both = _both_ends(u, moves)
    after = moves.bounds[moves.bounds >= both]
    more = 1 if after.size > 6 else 0
    end = int(after[more]) if after.size else both
    longest = int(_THRESHOLDS.warm_up * u.size)
    if end <= longest:
        return end
    return min(both, longest) if both <= longest else min(int(moves.bounds[0]), longest)


def early_text(parts: Sequence[tuple[Array, Cycles, float, int, float]]) -> str:
    """Say that samples are counted that may know what was before the record.

    Parts: of each record the input, its cycles, the step [s], the first sample that is counted, and
    when the first one is in the record [s]. Empty where both ends of the range were reached before
    in all of them.
    """
    ends, counts = [], []
    for u, moves, dt, counted, begin in parts:
        both = _both_ends(u, moves)
        if both > counted:
            ends.append(f"{begin + both * dt:.3g}")
            counts.append(f"{begin + counted * dt:.3g}")
    if not ends:
        return ""
    return (
        f"the input reaches both ends of its range no sooner than at {' and '.join(ends)} s, and "
        f"errors are counted from {' and '.join(counts)} s on: till then readings depend on what "
        "was before, which is taken to be a cycle over the whole range"
    )


def _both_ends(u: Array, moves: Cycles) -> int:
    """The sample at which an input has reached both ends of its range."""
    low, high = moves.range
    reach = _THRESHOLDS.end * (high - low)
    return max(int(np.argmax(u >= high - reach)), int(np.argmax(u <= low + reach)))
