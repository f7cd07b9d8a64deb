"""Tracks of lines in a channel between two columns."""

from collections.abc import Mapping
from dataclasses import dataclass, field

#: Distance between tracks [px].
PITCH = 9.0
#: Pins nearer than this count as one height [px].
SAME = 3.5


@dataclass(slots=True)
class Run:
    """What a net needs in one channel between columns."""

    left: list[float] = field(default_factory=list)
    """Heights at which it comes from the left [px]."""
    right: list[float] = field(default_factory=list)
    """Heights at which it goes to the right [px]."""
    bus: list[float] = field(default_factory=list)
    """Heights at which it joins a channel between rows [px]."""

    @property
    def heights(self) -> list[float]:
        """All of these heights [px]."""
        return self.left + self.right + self.bus

    @property
    def low(self) -> float:
        """The highest of them on the page [px]."""
        return min(self.heights)

    @property
    def high(self) -> float:
        """The lowest of them on the page [px]."""
        return max(self.heights)

    @property
    def straight(self) -> bool:
        """Whether the line goes straight across the channel."""
        return self.high - self.low < 1e-6


def tracks_of(runs: Mapping[str, Run]) -> dict[str, int]:
    """Give each run of a channel a track, from left to right.

    Where a line comes from the left at the height at which another goes to the right, the first
    must turn before the second.
    """
    before: dict[str, set[str]] = {n: set() for n in runs}
    for a, first in runs.items():
        for b, second in runs.items():
            if a != b and any(abs(p - q) < SAME for p in first.left for q in second.right):
                before[b].add(a)
    found: dict[str, int] = {}
    track = 0
    while len(found) < len(runs):
        waiting = [n for n in runs if n not in found]
        ready = [n for n in waiting if before[n] <= found.keys()]
        if not ready:
            # two lines wait for each other: the drawing cannot keep them apart
            ready = waiting[:1]
        end = float("-inf")
        placed = []
        for n in sorted(ready, key=lambda n: (runs[n].low, runs[n].high, n)):
            if runs[n].low > end + PITCH - 1.0:
                placed.append(n)
                end = runs[n].high
        for n in placed:
            found[n] = track
        track += 1
    return found
