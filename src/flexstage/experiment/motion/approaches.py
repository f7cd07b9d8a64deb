"""Approaches to targets: to which, from which side, and which of them belong together."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from flexstage.arrays import Array, Integers
from flexstage.errors import RecordError

#: Forms of a cycle over targets, and what each of them is.
CYCLES: Mapping[str, str] = {
    "auto": "rests of several samples, or else as standard",
    "standard": "a row for each approach: series up and down that turn round at or beyond the ends",
    "step": "a row for each approach: each target from both sides in turn, then the next one",
}
#: Targets closer than this share of their range are one.
_SAME_TARGET = 1e-6
#: Targets that were reached from one side less often than this share of the usual do not count.
_SELDOM = 0.5
_COLUMN = "name the column of the direction of each approach"


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
    position: ArrayLike, *, cycle: str = "standard", side: ArrayLike | None = None
) -> Visits:
    """Find from which side targets were reached, of which a table has a row for each approach.

    A target other than the one before is reached from that one. The same one again means that the
    stage turned round beyond it in between, and comes from the other side: in a standard cycle
    where a series ends and the next one begins, in a step cycle everywhere. The first row of a
    table with such repetitions belongs to the series that it begins; without them it is a start,
    reached from an unknown side. `cycle` is one of `CYCLES`. With `side`, positive where a row was
    reached from below and negative from above, neither the form nor the order of the rows matters.

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
    levels, target = group_levels(x, _SAME_TARGET * float(np.ptp(x)))
    if levels.size < 2:
        raise RecordError("there must be two targets at least, got one: record more of them")
    if side is not None:
        direction = np.sign(np.asarray(side, dtype=np.float64)).astype(np.intp)
    elif cycle == "step":
        direction = _steps(levels, target)
    elif cycle == "standard":
        direction = _series(levels, target)
    else:
        raise RecordError(f"a cycle is standard or step, got '{cycle}'")
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


def _series(levels: Array, target: Integers) -> Integers:
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
                f"target {_micrometres(levels, target[i])} stands in rows {i + 1} and {i + 2}, "
                f"where no series of a standard cycle turns round: {_COLUMN}, or use cycle=step "
                "where each target was reached from both sides in turn"
            )
        direction[i], direction[i + 1] = -after, after
    if again.size and direction[0] == 0:
        direction[0] = step[0]
    _require_no_restart(levels, target)
    return direction


def _steps(levels: Array, target: Integers) -> Integers:
    """Directions of approaches to each target in turn."""
    step = np.sign(np.diff(target)).astype(np.intp)
    direction = np.zeros(target.size, dtype=np.intp)
    direction[0] = step[np.flatnonzero(step)[0]]
    for i, way in enumerate(step, start=1):
        direction[i] = way or -direction[i - 1]
    _require_no_restart(levels, target)
    return direction


def _require_no_restart(levels: Array, target: Integers) -> None:
    """Refuse series that begin again at the other end: from which side, no row says."""
    way = np.abs(np.diff(target))
    whole = way == levels.size - 1
    if levels.size > 2 and whole.any() and way[~whole].max(initial=0) <= 1:
        i = int(np.flatnonzero(whole)[0])
        first, last = (_micrometres(levels, target[k]) for k in (i + 1, i))
        raise RecordError(
            f"row {i + 2} begins again at target {first} after {last}, and does not say from which "
            f"side it was reached: {_COLUMN}"
        )


def _micrometres(levels: Array, number: int) -> str:
    return f"{1e6 * levels[number]:.9g} um"
