"""Cycles of a drive signal: turning points, rates, minor loops, warm-up; one record with them."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from flexstage.base.arrays import Array
from flexstage.hysteresis.chain.creep import Start
from flexstage.hysteresis.compiled import compiled
from flexstage.records.quality import difference_noise


@dataclass(frozen=True, slots=True)
class _Thresholds:
    """Limits of movements, cycles, waits, rates and warm-up."""

    swing: float = 0.02
    """Smallest movement, as a share of the full range."""
    noise_swing: float = 8.0
    """Smallest movement, over the noise of the signal."""
    major: float = 0.9
    """Smallest swing of a major cycle, as a share of the range."""
    steps: int = 8
    """Fewest samples of motion in a cycle; with fewer it is a jump between levels."""
    wait: float = 10.0
    """Shortest wait, over the usual time between two movements: the levels of a staircase are
    no waits.
    """
    few: int = 3
    """In a record with fewer lower turning points, a low end counts as one."""
    low_end: float = 0.05
    """Highest low end, as a share of the range."""
    other_rate: float = 1.5
    """Smallest ratio of two different rates."""
    rate_cycles: int = 3
    """Fewest cycles of a rate, as noise may split one in two, unless it has `rate_time`."""
    rate_time: float = 0.1
    """Smallest share of the total time of a rate of fewer cycles."""
    regular: float = 0.95
    """Smallest share of the steps of a held signal at multiples of its hold."""
    held_step: float = 1e-3
    """Smallest step of a held signal, as a share of its range; those of a converter are smaller."""
    end: float = 0.05
    """The memory of earlier motion is erased when both ends of the range were reached, within
    this share of the range.
    """
    warm_up: float = 0.4
    """Largest share of the warm-up in a record."""
    move: float = 0.002
    """Smallest motion of the input, as a share of its range."""
    rest: int = 20
    """Samples of an initial dwell that are kept."""


_THRESHOLDS = _Thresholds()
#: Turning points of decreasing loops: as many as the plays of a fine model.
_LOOPS = 40
#: Motion before a record, unless the record shows another one.
USUAL_MEMORY = "cycles over the full range that ended at its low end"


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Cycles:
    """Cycles of a drive signal."""

    bounds: NDArray[np.intp]
    """First sample of each whole cycle, and the sample after the last, shape (c + 1,). A cycle
    leads from one lower turning point to the next.
    """
    swing: Array
    """Range of each cycle, as a share of the full range, shape (c,)."""
    frequency_hz: Array
    """Reciprocal of the time of motion in each cycle [Hz], shape (c,)."""
    turning: NDArray[np.intp]
    """Turning points [samples]."""
    range: tuple[float, float]
    """Lowest and highest value."""

    @property
    def rates_hz(self) -> tuple[float, ...]:
        """Rates of cycles over at least half of the range that differ by more than half [Hz].

        A smaller loop at the same speed has a shorter period, and one of the same period a lower
        speed: at another rate both differ.
        """
        return tuple(sorted(rate for rate, _ in by_rate(self.frequency_hz, self.swing)))

    @property
    def has_minor_loops(self) -> bool:
        """True if at least three cycles, of different size, are inside the full range."""
        minor = self.swing[self.swing < _THRESHOLDS.major]
        return minor.size >= 3 and float(np.ptp(minor)) > 0.1


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RecordSection:
    """One record's input and output."""

    u: Array
    """Input, shape (n,)."""
    y: Array
    """Output, with the sign that rises with the input, shape (n,)."""
    dt: float
    """Time from one sample to the next [s]."""
    cycles: Cycles
    """Cycles of the input."""
    warm_up: int
    """Number of first samples that depend on motion before the record."""
    nuisance: Array
    """Columns that are fitted with every model and belong to none: the offset, shape (n, 1)."""
    noise: float
    """Estimated standard deviation of the noise of the output, in its unit."""
    input_noise: float = 0.0
    """That of the noise removed from the input, in its unit; 0 for a command."""
    first: int = 0
    """First sample of the record in use, after an initial dwell."""
    begin: float = 0.0
    """Its time in the record [s]."""
    memory: str = USUAL_MEMORY
    """Motion before the record that set the memory of the hysteresis, one of `memories`."""
    history: int = 0
    """Number of first samples that represent that motion, and were not measured."""
    start: Start = "rested"
    """Motion of the drive before the record, for its creep; if periodic, the section is one period,
    from its low end back to a copy of the same sample.
    """
    measured: NDArray[np.bool_] | None = None
    """True for measured samples of the output, shape (n,); others are interpolated. None if all
    were measured.
    """
    straight: NDArray[np.bool_] | None = None
    """True for means that represent their samples, shape (n,); all if None."""

    @property
    def periodic(self) -> bool:
        """True for one period of a steady motion."""
        return self.start == "periodic"

    @property
    def both_ends(self) -> int:
        """Sample at which the input has reached both ends of its range: no memory is left then."""
        if self.periodic:
            return 0
        return self.history + _both_ends(self.u[self.history :], self.cycles)


def possible_starts(sections: Sequence[RecordSection]) -> tuple[Start, ...]:
    """Return motions of a drive before records, for its creep.

    Rest at the first command, or motion for a time since the low end of the range: zero, as long as
    the longest record, or very long.
    """
    return "rested", 0.0, max(s.u.size * s.dt for s in sections), math.inf


def with_start(sections: Sequence[RecordSection], start: Start) -> tuple[RecordSection, ...]:
    """Return sections with a motion before each; one period has its own."""
    return tuple(s if s.periodic else replace(s, start=start) for s in sections)


def memories(ends: tuple[float, float], first: float) -> dict[str, Array]:
    """Return inputs before a record that set the memory of a hysteresis, by their description.

    `ends` is the range of the input, and `first` the first command of the record. A wider range is
    one from zero, or of three times the size where the drive is used on both sides of zero. After
    loops of decreasing size all plays have the same output, as after depolarisation, at zero.
    """
    low, high = ends
    size = high - low
    bottom = min(low, 0.0) if low > -_THRESHOLDS.end * size else low - size
    top = max(high, 0.0) if high < _THRESHOLDS.end * size else high + size
    loops = size * np.linspace(1.0, 0.0, _LOOPS) * (-1.0) ** np.arange(_LOOPS)
    return {
        USUAL_MEMORY: np.array([high, low]),
        "cycles over the full range that ended at its high end": np.array([low, high]),
        "none since depolarisation at zero input": np.zeros(1),
        "cycles over a wider range that ended at its low end": np.array([top, bottom]),
        "cycles over a wider range that ended at its high end": np.array([bottom, top]),
        "decreasing cycles about the first command": first + loops,
        "decreasing cycles about the middle of the range": 0.5 * (low + high) + loops,
    }


def _differ(first: float, second: float) -> bool:
    return max(first, second) > _THRESHOLDS.other_rate * min(first, second)


def by_rate(frequency_hz: Array, swing: Array) -> list[tuple[float, NDArray[np.intp]]]:
    """Return the rates of cycles, each with the cycles that belong to it.

    The swing is a share of the full range. Cycles with the frequency or the speed of large ones
    belong to their rate [Hz]; turns in a transition between two motions belong to none.
    """
    speed = frequency_hz * swing
    # large cycles define the rates, the largest first
    order = sorted(np.flatnonzero(swing > 0.5), key=lambda i: (-swing[i].round(1), frequency_hz[i]))
    groups: list[tuple[int, list[int]]] = []
    for i in map(int, (*order, *np.flatnonzero(swing <= 0.5))):
        same = (
            members
            for first, members in groups
            if not (
                _differ(frequency_hz[i], frequency_hz[first]) and _differ(speed[i], speed[first])
            )
        )
        group = next(same, None)
        if group is not None:
            group.append(i)
        elif swing[i] > 0.5:
            groups.append((i, [i]))
    time = [sum(1.0 / frequency_hz[i] for i in members if swing[i] > 0.5) for _, members in groups]
    many = [sum(swing[i] > 0.5 for i in members) for _, members in groups]
    return [
        (float(frequency_hz[first]), np.sort(members))
        for (first, members), t, n in zip(groups, time, many, strict=True)
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
    indices = np.empty(u.size, dtype=np.intp)
    count = _zigzag(np.ascontiguousarray(u, dtype=np.float64), threshold, indices)
    return indices[:count].copy()


def cycles(u: Array, dt: float, noise_taken: float = 0.0, *, period: bool = False) -> Cycles:
    """Find the cycles of a drive signal.

    Parameters
    ----------
    u : numpy.ndarray
        The signal, shape (n,).
    dt : float
        Time from one sample to the next [s].
    noise_taken : float
        Standard deviation of the noise that was mostly removed from it.
    period : bool
        True for one period, from its low end back to it, which is a turning point.

    Returns
    -------
    Cycles
        Its complete cycles. Samples before the first lower turning point and after the last one
        belong to no cycle; in a record of one or two cycles, low ends are such points.

    Examples
    --------
    >>> t = np.arange(1000) / 200.0
    >>> moves = cycles(60.0 - 60.0 * np.cos(2.0 * np.pi * t), 1.0 / 200.0)
    >>> moves.bounds, moves.frequency_hz.round(2)
    (array([200, 400, 600, 800]), array([1., 1., 1.]))
    """
    low, high = float(u.min()), float(u.max())
    noise = input_noise(u)
    least = _THRESHOLDS.noise_swing * max(noise, noise_taken)
    turning = turning_points(u, max(_THRESHOLDS.swing * (high - low), least))
    lower = turning[1:] if turning.size and _is_high(u, turning) else turning
    bounds = lower[::2]
    if period or bounds.size < _THRESHOLDS.few:
        bounds = _with_ends(u, bounds, low + _THRESHOLDS.low_end * (high - low))
    count = max(bounds.size - 1, 0)
    swing, frequency = np.zeros(count), np.zeros(count)
    for i in range(count):
        part = u[bounds[i] : bounds[i + 1] + 1]
        size = float(np.ptp(part))
        swing[i] = size / (high - low)
        frequency[i] = 1.0 / (dt * _moving_time(part, noise))
    if period:
        turning = np.append(0, turning)
    return Cycles(
        bounds=bounds, swing=swing, frequency_hz=frequency, turning=turning, range=(low, high)
    )


def input_noise(u: Array) -> float:
    """Return the standard deviation of the noise of a drive signal, at most 1 % of its range."""
    if u.size < 5:
        return 0.0
    # second differences contain the noise, and hardly the movement
    noise = difference_noise(u, 2)
    # smooth motion has second differences as well, hence the upper limit
    return min(noise, float(np.ptp(u)) / 100.0)


def held_samples(u: Array) -> int:
    """Return the number of samples for which a staircase is constant; 1 for other signals.

    Examples
    --------
    >>> held_samples(np.sin(np.arange(400) // 8 * 0.4))
    8
    """
    steps, size = np.abs(np.diff(u)), float(np.ptp(u))
    changes = np.flatnonzero(steps > 1e-9 * size)
    if changes.size < _THRESHOLDS.steps:
        return 1
    if float(np.median(steps[changes])) < _THRESHOLDS.held_step * size:
        return 1
    between = np.diff(changes)
    hold = int(np.median(between))
    return hold if float(np.mean(between % hold == 0)) >= _THRESHOLDS.regular else 1


def _moving_time(part: Array, noise: float) -> float:
    """Number of samples that a cycle moves for, without its waits."""
    steps = np.abs(np.diff(part))
    moving = np.flatnonzero(steps > max(1e-3 * float(steps.max()), 4.0 * noise))
    # a step has no rate: a signal that jumps is not faster
    if moving.size < _THRESHOLDS.steps:
        return float(steps.size)
    # time between two movements: 1 for motion at every sample, more for a staircase
    between = np.diff(np.concatenate(([-1], moving, [max(moving[-1], steps.size - 1)])))
    usual = max(float(np.median(between)), 1.0)
    return float(np.sum(np.where(between > _THRESHOLDS.wait * usual, usual, between)))


def _with_ends(u: Array, bounds: NDArray[np.intp], at_most: float) -> NDArray[np.intp]:
    """Add low ends of a short record to its lower turning points."""
    first = [0] if u[0] <= at_most else []
    last = [u.size - 1] if u[-1] <= at_most else []
    inner = [int(b) for b in bounds if 0 < b < u.size - 1]
    return np.array([*first, *inner, *last], dtype=np.intp)


def _is_high(u: Array, turning: NDArray[np.intp]) -> bool:
    if turning.size == 1:
        return bool(u[turning[0]] > u[0])
    return bool(u[turning[0]] > u[turning[1]])


def first_moving(u: Array) -> int:
    """Return the first sample of motion, less a few samples; 0 if it moves from the start."""
    noise = input_noise(u)
    still = np.abs(u - float(np.median(u[: _THRESHOLDS.rest]))) <= max(
        _THRESHOLDS.move * float(np.ptp(u)), 6.0 * noise
    )
    moves = int(np.argmin(still)) if still[0] and not still.all() else 0
    # a slow start is a part of the motion: only a dwell longer than that is omitted
    return max(moves - _THRESHOLDS.rest, 0)


def warm_up(u: Array, moves: Cycles) -> int:
    """Return the number of first samples that depend on motion before the record."""
    # with many cycles, a complete cycle more: other memory fades there
    both = _both_ends(u, moves)
    after = moves.bounds[moves.bounds >= both]
    more = 1 if after.size > 6 else 0
    end = int(after[more]) if after.size else both
    longest = int(_THRESHOLDS.warm_up * u.size)
    if end <= longest:
        return end
    return min(both, longest) if both <= longest else min(int(moves.bounds[0]), longest)


def unknown_history_warning(sections: Sequence[RecordSection]) -> str:
    """Return the warning that counted samples depend on motion before the record.

    Empty if both ends of the range were reached before these in all records.
    """
    late = [s for s in sections if s.both_ends > s.warm_up]
    if not late:
        return ""
    times = [[s.begin + (at - s.history) * s.dt for at in (s.both_ends, s.warm_up)] for s in late]
    ends, counts = (" and ".join(f"{t:.3g}" for t in each) for each in zip(*times, strict=True))
    return (
        f"the input reaches both ends of its range only at {ends} s, but errors are counted from "
        f"{counts} s on: until then readings depend on earlier motion; assumed: "
        f"{' and '.join(dict.fromkeys(s.memory for s in late))}"
    )


def _both_ends(u: Array, moves: Cycles) -> int:
    """Return the sample at which an input has reached both ends of its range."""
    low, high = moves.range
    reach = _THRESHOLDS.end * (high - low)
    return max(int(np.argmax(u >= high - reach)), int(np.argmax(u <= low + reach)))
