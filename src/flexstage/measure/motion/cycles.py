"""A motion over a stroke and back cut into cycles, and the spread from one to the next."""

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from flexstage.base.arrays import Array
from flexstage.base.errors import RecordError
from flexstage.hysteresis.identification.cycles import turning_points
from flexstage.quantities.estimate import Estimate
from flexstage.quantities.units import readable
from flexstage.records.quality import difference_noise

#: A run leads from below this share of its range to above one less it; smaller ones are none.
_END_ZONE = 0.1
#: Cycles are over the same range if neighbouring ends differ by at most the first share of the full
#: range, and all ends by at most the second share.
_SAME_END, _AT_END = 0.01, 0.05


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class MotionCycles:
    """Whole cycles of a motion."""

    runs: NDArray[np.intp]
    """First sample and sample after the last of the forward run (0) and the backward run (1) of
    each cycle, shape (c, 2, 2). Forward is where the command rises.
    """
    size: int
    """Number of samples of the record, n."""
    low: float
    """Lower end of the stroke that all runs reach, in the unit of the command."""
    high: float
    """Upper end of the stroke that all runs reach, in the unit of the command."""
    outside: int = 0
    """Samples that belong to no whole cycle."""
    notes: tuple[str, ...] = ()
    """Omitted samples and ranges, with reasons."""

    @property
    def count(self) -> int:
        """Number of whole cycles."""
        return self.runs.shape[0]

    def samples(self, cycle: int, direction: int) -> slice:
        """Return where a run is in the record: direction 0 forward, 1 backward."""
        first, stop = self.runs[cycle, direction]
        return slice(int(first), int(stop))

    def directions(self) -> NDArray[np.intp]:
        """Return 1 for samples on forward runs, -1 on backward runs, 0 in no cycle."""
        directions = np.zeros(self.size, dtype=np.intp)
        for forward, backward in self.runs:
            directions[forward[0] : forward[1]] = 1
            directions[backward[0] : backward[1]] = -1
        return directions


def motion_cycles(command: ArrayLike) -> MotionCycles:
    """Find the whole cycles over the largest range of a triangle, a sine or a staircase.

    A turning point is the highest (lowest) place between two visits of the other end of the range,
    and where the motion rests there, the middle of the rest: noise makes no turning points. A run
    is whole when it begins and ends where other runs over this range do and does not turn back by
    more than 10 % of it on the way. A cycle is a forward and a backward run next to each other; it
    begins with the forward run unless one more cycle can be had the other way round. Two whole
    cycles are needed.

    Validity
    --------
    Cycles whose ends differ by more than 1 % of the range are another group, which is omitted and
    noted; so is a range with too few cycles, down to half of the largest. If the noise of a command
    exceeds 1 % of the range, the beginnings and ends of runs are a few samples off.

    Examples
    --------
    >>> t = np.linspace(0.0, 3.3, 3301)
    >>> found = motion_cycles(30.0 - 30.0 * np.cos(2.0 * np.pi * t))
    >>> found.count, found.runs[1].tolist(), found.outside
    (3, [[1000, 1500], [1500, 2000]], 301)
    """
    return cycles_by_range(command)[0]


def cycles_by_range(
    command: ArrayLike, *, least: int = 2, unit: str = ""
) -> tuple[MotionCycles, ...]:
    """Find whole cycles as `motion_cycles` does, and those over other ranges that have two or more.

    The largest range with `least` cycles comes first, and its notes name all ranges; `unit` is that
    of the command.

    Examples
    --------
    >>> t = np.linspace(0.0, 6.0, 6001)
    >>> size = np.where(t < 3.0, 30.0, 24.0)
    >>> [(g.count, g.high) for g in cycles_by_range(size - size * np.cos(2.0 * np.pi * t))]
    [(3, 60.0), (3, 48.0)]
    """
    x = np.asarray(command, dtype=np.float64)
    if x.ndim != 1 or x.size < 8 or not np.isfinite(x).all():
        raise RecordError(
            "to find cycles, a command needs 8 or more samples, all of them finite, got an array "
            f"of shape {x.shape}"
        )
    low, high = float(x.min()), float(x.max())
    if not high > low:
        raise RecordError(f"the command is constant, {low:g}")
    # what lies within so many times the noise of a turning point rests there
    noise_band = 8.0
    # a clean curve has second differences too: no more than a hundredth of the range is noise
    band = noise_band * min(difference_noise(x, 2), 0.01 * (high - low)) + 1e-9 * (high - low)
    each = [(ends, _cycles_over(x, ends, band)) for ends in _ranges(x, band)]
    size, pairs = next((one for one in each if len(one[1]) >= least), (np.zeros((2, 2)), []))
    # ranges smaller than this share of the whole are not what a record is about
    least_range = 0.5
    if size[1, 1] - size[0, 0] < least_range * (high - low):
        raise RecordError(
            f"{least} whole cycles over the range from {low:g} to {high:g} are needed, got "
            f"{len(each[0][1]) if each else 0}: record more cycles, or choose the column that "
            "commands the motion"
        )
    texts = [
        f"{len(group)} cycle{'s' * (len(group) > 1)} from {readable(unit, e[0, 0], e[1, 1])}"
        for e, group in each
        if group
    ]
    notes = []
    if len(texts) > 1:
        notes.append(
            f"the command has {', '.join(texts)}: those from "
            f"{readable(unit, size[0, 0], size[1, 1])} are evaluated"
        )
    outside = x.size - sum(b - a for pair in pairs for a, b in pair)
    # the last sample of a record ends its last cycle, and belongs to no run
    if outside > 1:
        notes.append(
            f"{outside} of {x.size} samples are outside of full cycles"
            + (" over that range" if notes else "")
            + " and are omitted"
        )
    others = [group for _, group in each if group is not pairs and len(group) > 1]
    return (_motion_cycles(x, pairs, notes), *(_motion_cycles(x, group, ()) for group in others))


def _ranges(x: Array, band: float) -> list[Array]:
    """Return the ranges that are moved over there and back, the largest first.

    Of each the least and the greatest lower end, then those of the upper one, shape (2, 2).
    """
    extent = float(np.ptp(x))
    turns = turning_points(x, max(_END_ZONE * extent, band))
    places = np.concatenate(([0], turns, [x.size - 1]))
    # the ends of a record rest at their level, as turning points do
    level = np.sort(np.stack([x[places[:-1]], x[places[1:]]]), axis=0)
    size = level[1] - level[0]
    step, most = _SAME_END * extent + band, _AT_END * extent + band
    free = size > _END_ZONE * extent
    selected: list[Array] = []
    # so many ranges are looked at: a command of many amplitudes has no cycles
    ranges = 100
    for _ in range(ranges):
        if not free.any():
            break
        largest = int(np.argmax(np.where(free, size, 0.0)))
        mask = np.zeros_like(free)
        mask[largest] = True
        near = free & (np.abs(level - level[:, largest : largest + 1]).max(axis=0) <= most)
        while True:
            ends = np.stack([level[:, mask].min(axis=1), level[:, mask].max(axis=1)], axis=1)
            more = near & np.all(
                (level >= ends[:, :1] - step) & (level <= ends[:, 1:] + step), axis=0
            )
            if np.array_equal(more, mask):
                break
            mask = more
        free &= ~mask
        if mask.sum() > 1:
            selected.append(ends)
    return selected


def _cycles_over(x: Array, ends: Array, band: float) -> list[list[tuple[int, int]]]:
    """Return the cycles over a range whose ends have limits, as `_ranges` gives them."""
    low, high = float(ends[0, 0]), float(ends[1, 1])
    ways = [(a[1], b[0]) for a, b in itertools.pairwise(_turning_points(x, low, high, band))]
    runs = [way if _is_full_run(x, *way, ends, band) else None for way in ways]
    rising = [bool(x[b] > x[a]) for a, b in ways]
    return max((_pairs(runs, rising, first) for first in (True, False)), key=len)


def _motion_cycles(
    x: Array, pairs: list[list[tuple[int, int]]], notes: Sequence[str]
) -> MotionCycles:
    runs = np.array(pairs, dtype=np.intp)
    # the turning point at which a run ends is the first sample of the next
    parts = [x[a : b + 1] for cycle in runs for a, b in cycle]
    return MotionCycles(
        runs=runs,
        size=x.size,
        low=float(max(p.min() for p in parts)),
        high=float(min(p.max() for p in parts)),
        outside=x.size - int((runs[..., 1] - runs[..., 0]).sum()),
        notes=tuple(notes),
    )


def _turning_points(x: Array, low: float, high: float, band: float) -> list[tuple[int, int]]:
    """Return the highest and lowest places in turn: where a run ends and where the next begins.

    Both are the middle of the rest there, unless the motion went away and came back meanwhile.
    """
    zone = _END_ZONE * (high - low)
    state = np.where(x > high - zone, 1, np.where(x < low + zone, -1, 0))
    at = np.flatnonzero(state)
    ends = state[at]
    # samples at one end until the other end is met make one visit
    edges = np.flatnonzero(np.diff(ends)) + 1
    turns = []
    rests = []
    for visit, end in zip(np.split(at, edges), ends[np.concatenate(([0], edges))], strict=True):
        values = end * x[visit]
        resting = visit[values >= values.max() - band]
        first, last = int(resting[0]), int(resting[-1])
        rests.append((first, last))
        away = values.max() - float(np.min(end * x[first : last + 1]))
        # of two samples at rest one belongs to each run
        middle = (first + last + 1) // 2
        turns.append((first, last) if away > zone + band else (middle, middle))
    if len(rests) > 2:
        # half of the rest before the first run belongs to an unrecorded run; likewise at the end
        half = sorted((b - a + 1) // 2 for a, b in rests[1:-1])[(len(rests) - 2) // 2]
        start, stop = max(rests[0][0], rests[0][1] - half), min(rests[-1][1], rests[-1][0] + half)
        turns[0], turns[-1] = (start, start), (stop, stop)
    return turns


def _is_full_run(x: Array, first: int, last: int, ends: Array, band: float) -> bool:
    run = x[first : last + 1] if x[last] > x[first] else -x[first : last + 1]
    back = float(np.max(np.maximum.accumulate(run) - run))
    extent = float(ends[1, 1] - ends[0, 0])
    step = _SAME_END * extent + band
    level = np.sort(x[[first, last]])
    inside = np.all((level >= ends[:, 0] - step) & (level <= ends[:, 1] + step))
    # a run may go back by this share of the range; noise aside, more is a loop inside of it
    setback = 0.1
    return back <= setback * extent + band and bool(inside)


def _pairs(
    runs: list[tuple[int, int] | None], rising: list[bool], forward_first: bool
) -> list[list[tuple[int, int]]]:
    """Pair whole runs that follow one another at once; give the forward run of each pair first."""
    pairs = []
    for i, (first, second) in enumerate(itertools.pairwise(runs)):
        if first and second and first[1] == second[0] and rising[i] == forward_first:
            pairs.append([first, second] if forward_first else [second, first])
    return pairs


def spread_estimate(
    values: ArrayLike, *, unit: str, degrees_of_freedom: int | None = None, note: str = ""
) -> Estimate:
    r"""Return the standard deviation of values that were repeated under the same conditions.

    With n values, (n - 1) s^2 / sigma^2 is distributed as chi-squared with n - 1 degrees of
    freedom, which gives the interval. Where degrees of freedom are given, the values are
    residuals, of any shape.

    Examples
    --------
    >>> s = spread_estimate([3.0, 5.0, 4.0, 8.0], unit="um")
    >>> print(f"{s.value:.2f}, {s.bounds[0]:.2f} to {s.bounds[1]:.2f}")
    2.16, 1.22 to 8.05
    """
    x = np.asarray(values, dtype=np.float64)
    freedom = x.size - 1 if degrees_of_freedom is None else degrees_of_freedom
    if freedom < 1 or not np.isfinite(x).all():
        raise RecordError(
            f"a standard deviation needs two finite values at least, got {x.size} values"
        )
    left = x - x.mean() if degrees_of_freedom is None else x
    s = math.sqrt(float(np.sum(left**2)) / freedom)
    return Estimate.of_deviation(s, freedom, unit, source="repeatability", note=note)
