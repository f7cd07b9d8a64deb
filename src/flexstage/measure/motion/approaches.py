"""Approaches to targets, of rows of a table or rests of a staircase: to which, from which side."""

import itertools
import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from flexstage.base.arrays import Array, Integers
from flexstage.base.errors import RecordError
from flexstage.records.quality import difference_noise

#: Forms of a cycle over targets, and what each of them is.
CYCLES: Mapping[str, str] = {
    "auto": "rests of several samples, or else as standard",
    "standard": "a row for each approach: series up and down that turn round at or beyond the ends",
    "step": "a row for each approach: each target from both sides in turn, then the next one",
}
#: Targets that were reached from one side less often than this share of the usual do not count.
_SELDOM = 0.5
_COLUMN = "name the column of the direction of each approach"
#: Steps larger than so many times the noise, and than this share of the range, lead to a new level.
_STEP_OVER_NOISE = 8.0
_STEP_SHARE = 1e-4


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Approaches:
    """Readings of the targets that were reached from both sides, as often as is usual."""

    upward: Array
    """Readings after an approach from below, shape (m, n): one column for each run, as many as
    every such target has.
    """
    downward: Array
    """Readings after an approach from above, shape (m, n)."""
    targets: Integers
    """Numbers of these targets among the levels, shape (m,)."""
    counts: Integers
    """How often each level was reached from below and from above, shape (2, levels)."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Visits:
    """Visits of targets, in the order in which they were made."""

    target: Integers
    """Number of the level of each, counted from the lowest, shape (d,)."""
    direction: Integers
    """1 where it was reached from below, -1 from above, 0 where that is not known, shape (d,)."""
    levels: Array
    """The positions of the targets, rising, shape (m,)."""

    def sort(self, values: ArrayLike) -> Approaches:
        """Sort readings by target and by the side that it was reached from."""
        y = np.asarray(values, dtype=np.float64)
        sides = [
            [y[(self.target == i) & (self.direction == way)] for i in range(self.levels.size)]
            for way in (1, -1)
        ]
        counts = np.array([[v.size for v in side] for side in sides], dtype=np.intp)
        fewer = counts.min(axis=0)
        # one that was come to once, where the record begins, must not cost the others their runs
        usual = float(np.median(fewer[fewer > 0])) if fewer.any() else 0.0
        both = np.flatnonzero(fewer > _SELDOM * usual)
        if both.size < 2:
            raise RecordError(
                f"{both.size} of {self.levels.size} positions were reached from both sides, and "
                "positioning needs two at least, reached both from below and from above: record "
                f"them rising and falling, {_COLUMN}, or use cycle=step where each target was "
                "reached from both sides in turn"
            )
        runs = int(counts[:, both].min())
        up, down = (np.array([side[i][:runs] for i in both]) for side in sides)
        return Approaches(upward=up, downward=down, targets=both, counts=counts)


def visits(
    position: ArrayLike, *, cycle: str = "standard", side: ArrayLike | None = None, unit: str = "m"
) -> Visits:
    """Find from which side targets were reached, of which a table has a row for each approach.

    A target other than the one before is reached from that one. The same one again means that the
    stage turned round beyond it in between, and comes from the other side: in a standard cycle
    where a series ends and the next one begins, in a step cycle everywhere. The first row of a
    table with such repetitions belongs to the series that it begins; without them it is a start,
    reached from an unknown side. `cycle` is one of `CYCLES`. With `side`, positive where a row was
    reached from below and negative from above, neither the form nor the order of the rows matters.
    The unit of positions, m or rad, is that of messages.

    Validity
    --------
    Rows in the order in which the stage moved. A table that is sorted otherwise and still looks
    like a cycle (two targets, both directions of each in succession) is taken for one: then give
    `side`.

    Examples
    --------
    >>> found = visits([10.0, 20.0, 30.0, 30.0, 20.0, 10.0])
    >>> found.target.tolist(), found.direction.tolist()
    ([0, 1, 2, 2, 1, 0], [1, 1, 1, -1, -1, -1])
    """
    x = np.asarray(position, dtype=np.float64)
    # targets closer than this share of their range are one
    same_target = 1e-6
    levels, target = group_levels(x, same_target * float(np.ptp(x)))
    if levels.size < 2:
        raise RecordError("positioning needs at least two targets, got one: record more targets")
    if side is not None:
        direction = np.sign(np.asarray(side, dtype=np.float64)).astype(np.intp)
    elif cycle == "step":
        direction = _steps(levels, target, unit)
    elif cycle == "standard":
        direction = _series(levels, target, unit)
    else:
        raise RecordError(f"the cycle must be standard or step, got '{cycle}'")
    return Visits(target=target, direction=direction, levels=levels)


def group_levels(values: Array, tolerance: float) -> tuple[Array, Integers]:
    """Return the levels that values are at, rising, and the number of the level of each.

    Values closer to their neighbour than the tolerance belong to one level.
    """
    order = np.argsort(values, kind="stable")
    group = np.concatenate(([0], np.cumsum(np.diff(values[order]) > tolerance)))
    number = np.empty(values.size, dtype=np.intp)
    number[order] = group
    levels = np.array([values[number == i].mean() for i in range(int(group[-1]) + 1)])
    return levels, number


def _series(levels: Array, target: Integers, unit: str) -> Integers:
    """Directions of series up and down."""
    step = np.sign(np.diff(target)).astype(np.intp)
    direction = np.concatenate(([0], step))
    again = np.flatnonzero(step == 0)
    for i in again:
        before = direction[i]
        after = step[i + 1] if i + 1 < step.size else -before
        # between two moves one way the stage has not turned round, nor in a third row
        if (i and step[i - 1] == 0) or after in (0, before):
            raise RecordError(
                f"target {targets_text(levels[target[i]], unit)} stands in rows {i + 1} and "
                f"{i + 2}, where no series of a standard cycle turns round: {_COLUMN}, or use "
                "cycle=step where each target was reached from both sides in turn"
            )
        direction[i], direction[i + 1] = -after, after
    if again.size and direction[0] == 0:
        direction[0] = step[0]
    _require_no_restart(levels, target, unit)
    return direction


def _steps(levels: Array, target: Integers, unit: str) -> Integers:
    """Directions of approaches to each target in turn."""
    step = np.sign(np.diff(target)).astype(np.intp)
    direction = np.zeros(target.size, dtype=np.intp)
    direction[0] = step[np.flatnonzero(step)[0]]
    for i, way in enumerate(step, start=1):
        direction[i] = way or -direction[i - 1]
    _require_no_restart(levels, target, unit)
    return direction


def _require_no_restart(levels: Array, target: Integers, unit: str) -> None:
    """Refuse series that begin again at the other end: from which side, no row says."""
    way = np.abs(np.diff(target))
    at_end = way == levels.size - 1
    if levels.size > 2 and at_end.any() and way[~at_end].max(initial=0) <= 1:
        i = int(np.flatnonzero(at_end)[0])
        first, last = (targets_text(levels[target[k]], unit) for k in (i + 1, i))
        raise RecordError(
            f"row {i + 2} begins again at target {first} after {last}, and does not say from which "
            f"side it was reached: {_COLUMN}"
        )


def targets_text(targets: ArrayLike, unit: str) -> str:
    """Write targets in um, or those of a rotary axis in deg."""
    factor, name = (1e6, "um") if unit == "m" else (180.0 / math.pi, "deg")
    return f"{', '.join(f'{factor * t:.9g}' for t in np.atleast_1d(targets))} {name}"


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Dwells(Visits):
    """Rests of a staircase, in the order of time."""

    start: NDArray[np.intp]
    """First sample of each rest, shape (d,)."""
    stop: NDArray[np.intp]
    """The sample after the last of each rest, shape (d,)."""

    def settled(self, size: int, settling: float = 0.3) -> NDArray[np.bool_]:
        """Say which of so many samples are in a rest, past the share at its beginning that settles.

        Shape (size,).
        """
        mask = np.zeros(size, dtype=np.bool_)
        for first, stop in zip(self._begin(settling), self.stop, strict=True):
            mask[first:stop] = True
        return mask

    def means(self, values: ArrayLike, settling: float = 0.3) -> Array:
        """Return the mean of a reading over each rest."""
        y = np.asarray(values, dtype=np.float64)
        pairs = zip(self._begin(settling), self.stop, strict=True)
        return np.array([y[a:b].mean() for a, b in pairs])

    def approaches(self, values: ArrayLike, settling: float = 0.3) -> Approaches:
        """Sort the means over the rests by target and by the side that it was reached from."""
        return self.sort(self.means(values, settling))

    def _begin(self, settling: float) -> NDArray[np.intp]:
        if not 0.0 <= settling < 1.0:
            raise RecordError(
                f"the share of a rest to leave out must be 0 or more and below 1, got {settling!r}"
            )
        return self.start + np.floor(settling * (self.stop - self.start)).astype(np.intp)


def staircase_dwells(command: ArrayLike, *, side: ArrayLike | None = None) -> Dwells | None:
    """Find the rests of a staircase.

    None where the command is no staircase, as it moves in more than half of the samples. `side`,
    positive from below and negative from above, is found from the command where not given.

    Validity
    --------
    Steps of 8 times the noise of the command and more; smaller ones are not seen. That a stage
    turned round beyond a level and came back is seen where the command is beyond it for two samples
    or more, or where `side` says it.

    Examples
    --------
    >>> found = staircase_dwells(np.repeat([0.0, 1.0, 2.5, 1.0, 0.0], 20))
    >>> found.target.tolist(), found.direction.tolist()
    ([0, 1, 2, 1, 0], [0, 1, 1, -1, -1])
    """
    x = np.asarray(command, dtype=np.float64)
    if x.ndim != 1 or x.size < 8 or not np.isfinite(x).all():
        raise RecordError(
            "to find rests, a command needs 8 or more samples, all of them finite, got an array of "
            f"shape {x.shape}"
        )
    extent = float(np.ptp(x))
    step = max(_STEP_OVER_NOISE * difference_noise(x, 2), _STEP_SHARE * extent)
    parted = np.abs(np.diff(x)) > step
    if side is not None:
        parted |= np.diff(np.sign(np.asarray(side, dtype=np.float64))) != 0.0
    edges = np.concatenate(([0], np.flatnonzero(parted) + 1, [x.size]))
    # a rest may spread so much wider than its largest step, as noise does over many samples
    spread = 2.0
    rests = [
        (a, b)
        for a, b in itertools.pairwise(edges)
        if b - a >= 3 and np.ptp(x[a:b]) <= spread * step
    ]
    if len(rests) < 2 or sum(b - a for a, b in rests) < 0.5 * x.size:
        return None
    means = np.array([x[a:b].mean() for a, b in rests])
    # levels closer than this share of the range, beyond noise, are one
    same_level = 1e-3
    levels, target = group_levels(means, max(step, same_level * extent))
    if levels.size < 2:
        return None
    bounds = np.array(rests, dtype=np.intp)
    if side is None:
        direction = _directions(x, bounds, target, means)
    else:
        direction = np.sign(np.asarray(side, dtype=np.float64)[bounds[:, 0]]).astype(np.intp)
    return Dwells(
        start=bounds[:, 0], stop=bounds[:, 1], target=target, direction=direction, levels=levels
    )


def _directions(
    x: Array, bounds: NDArray[np.intp], target: NDArray[np.intp], means: Array
) -> NDArray[np.intp]:
    """From which side rests were reached."""
    steps = np.sign(np.diff(target)).astype(np.intp)
    direction = np.concatenate(([0], steps))
    starts, before = bounds[:, 0], np.concatenate(([0], bounds[:-1, 1]))
    for i in np.flatnonzero(direction == 0):
        # a rest that continues at the same level has the direction of the one before, unless the
        # command went beyond in between and turned back; a single sample may be a spike
        direction[i] = direction[i - 1] if i else 0
        between = np.sign(x[before[i] : starts[i]] - means[i])
        following = steps[i:][steps[i:] != 0]
        beyond = int(between[0]) if between.size > 1 and np.ptp(between) == 0.0 else 0
        if beyond and direction[i] != -beyond and following[:1].tolist() in ([], [-beyond]):
            direction[i] = -beyond
    return direction
