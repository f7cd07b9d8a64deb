"""Columns and rows of the groups of a diagram on a page."""

import math
from collections import deque
from collections.abc import Iterable, Mapping
from dataclasses import dataclass

#: Width over height that the drawing should have; values and notes stand below it.
_ASPECT = 2.2
# Room for lines between groups [px].
_BETWEEN = 90.0
_SWEEPS = 40
_LEAST_COLUMNS = 3
# What a column away from its edge costs a drive or a probe, in widths of a column.
_PULL = 1.2

Place = tuple[int, int]


@dataclass(frozen=True, slots=True, kw_only=True)
class Thing:
    """A group to be placed."""

    kind: str
    """What it is: drives are drawn to the left, probes to the right."""
    width: float
    """Its width [px]."""
    height: float
    """Its height [px]."""


def place_groups(
    things: Mapping[str, Thing], nets: Iterable[tuple[str, tuple[str, ...]]]
) -> dict[str, Place]:
    """Return column and row of each group, so that lines between them are short.

    A line is the group that it comes from, and those that it leads to. Groups begin in the order of
    their distance from the first drive, and change places, two at a time, as long as that shortens
    the lines. The same groups give the same places.
    """
    lines = [(s, tuple(t for t in targets if t != s)) for s, targets in nets]
    lines = [(s, t) for s, t in lines if t]
    order = _by_distance(things, lines)
    width = sum(t.width for t in things.values()) / len(things) + _BETWEEN
    height = sum(t.height for t in things.values()) / len(things) + _BETWEEN
    columns = round(math.sqrt(_ASPECT * len(things) * height / width))
    columns = max(min(_LEAST_COLUMNS, len(things)), columns)
    rows = -(-len(things) // columns)
    columns = -(-len(things) // rows)
    starts = (
        {name: (k // rows, k % rows) for k, name in enumerate(order)},
        {name: (k % columns, k // columns) for k, name in enumerate(order)},
        {name: _snake(k, columns) for k, name in enumerate(order)},
    )
    searches = [_Search(things, lines, (columns, rows), (width, height), s) for s in starts]
    return min((search.settled() for search in searches), key=lambda found: found[0])[1]


def _snake(k: int, columns: int) -> Place:
    row, column = divmod(k, columns)
    return (columns - 1 - column if row % 2 else column, row)


def _by_distance(
    things: Mapping[str, Thing], lines: list[tuple[str, tuple[str, ...]]]
) -> list[str]:
    near: dict[str, list[str]] = {n: [] for n in things}
    for source, targets in lines:
        for target in targets:
            near[source].append(target)
            near[target].append(source)
    found: dict[str, None] = {}
    for start in sorted(things, key=lambda n: things[n].kind != "drive"):
        if start in found:
            continue
        found[start] = None
        queue = deque([start])
        while queue:
            for other in near[queue.popleft()]:
                if other not in found:
                    found[other] = None
                    queue.append(other)
    return list(found)


class _Search:
    """Exchanges of two places, as long as one helps."""

    def __init__(
        self,
        things: Mapping[str, Thing],
        lines: list[tuple[str, tuple[str, ...]]],
        grid: Place,
        size: tuple[float, float],
        start: dict[str, Place],
    ) -> None:
        self.kinds = {n: t.kind for n, t in things.items()}
        self.lines, self.grid, self.size = lines, grid, size
        self.place = dict(start)
        self.of: dict[str, list[int]] = {n: [] for n in things}
        for k, (source, targets) in enumerate(lines):
            for name in dict.fromkeys((source, *targets)):
                self.of[name].append(k)

    def settled(self) -> tuple[float, dict[str, Place]]:
        columns, rows = self.grid
        spots = [(c, r) for c in range(columns) for r in range(rows)]
        for _ in range(_SWEEPS):
            better = False
            for i, a in enumerate(spots):
                for b in spots[i + 1 :]:
                    better |= self._exchange(a, b)
            if not better:
                break
        total = sum(self._length(k) for k in range(len(self.lines)))
        return total + sum(self._pull(n) for n in self.place), self.place

    def _exchange(self, a: Place, b: Place) -> bool:
        at = {place: name for name, place in self.place.items() if place in (a, b)}
        names = list(at.values())
        if not names:
            return False
        touched = sorted({k for n in names for k in self.of[n]})
        before = self._cost(touched, names)
        for place, name in at.items():
            self.place[name] = b if place == a else a
        if self._cost(touched, names) < before - 1e-6:
            return True
        for place, name in at.items():
            self.place[name] = place
        return False

    def _cost(self, touched: list[int], names: list[str]) -> float:
        return sum(self._length(k) for k in touched) + sum(self._pull(n) for n in names)

    def _pull(self, name: str) -> float:
        c = self.place[name][0]
        away = {"drive": c, "probe": self.grid[0] - 1 - c}.get(self.kinds[name], 0)
        return _PULL * self.size[0] * away

    def _length(self, k: int) -> float:
        source, targets = self.lines[k]
        c, r = self.place[source]
        ends = [self.place[t] for t in targets]
        channels = [c + 1, *(e[0] for e in ends)]
        rows = [r, *(e[1] for e in ends)]
        wide, high = self.size
        bend = 0.5 * high if max(channels) > min(channels) else 0.0
        return wide * (max(channels) - min(channels)) + bend + high * (max(rows) - min(rows))
