"""Which first samples of a record still know what was before it."""

from collections.abc import Sequence

import numpy as np

from flexstage.arrays import Array
from flexstage.hysteresis.identification.cycles import (
    Cycles,
    input_noise,
)

#: The memory of what was before a record is wiped out when both ends of the range were reached,
#: within this share of the range.
_END = 0.05
#: At most this share of a record is given to that.
_LONGEST_WARM_UP = 0.4
#: A change of the input that is less than this share of its range is no motion; ...
_SMALLEST_MOVE = 0.002
#: ... samples that are kept of a rest before it.
_REST = 20


def first_moving(u: Array) -> int:
    """Return where an input begins to move, less some samples; 0 where it moves from the start."""
    noise = input_noise(u)
    still = np.abs(u - float(np.median(u[:_REST]))) <= max(
        _SMALLEST_MOVE * float(np.ptp(u)), 6.0 * noise
    )
    moves = int(np.argmin(still)) if still[0] and not still.all() else 0
    # a slow start is a part of the motion: only a rest that is long beside it is left out
    return max(moves - _REST, 0)


def warm_up(u: Array, moves: Cycles) -> int:
    """Return how many first samples still know what was before the record."""
    # and a whole cycle after it where there are many: other memory fades there
    both = _both_ends(u, moves)
    after = moves.bounds[moves.bounds >= both]
    more = 1 if after.size > 6 else 0
    end = int(after[more]) if after.size else both
    longest = int(_LONGEST_WARM_UP * u.size)
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
    reach = _END * (high - low)
    return max(int(np.argmax(u >= high - reach)), int(np.argmax(u <= low + reach)))
