"""Columns and rows: of the blocks of a group, and of the groups of a diagram on a page."""

import math
from collections import deque
from collections.abc import Iterable, Mapping
from dataclasses import dataclass

from flexstage.export.diagram.graph import Block, SignalLine

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
class Layered:
    """Where blocks stand among each other."""

    places: dict[str, tuple[int, int]]
    """Column and row of each block."""
    flipped: set[str]
    """Those that are drawn from right to left."""


def layered(blocks: tuple[Block, ...], lines: tuple[SignalLine, ...]) -> Layered:
    """Put blocks into columns along their lines, and beside each other into rows."""
    names = [b.name for b in blocks]
    after: dict[str, list[str]] = {n: [] for n in names}
    for line in lines:
        if line.target not in after[line.source]:
            after[line.source].append(line.target)
    back = backward_lines(names, after)
    by_name = {b.name: b for b in blocks}
    # a gain from which a line leads back is a feedback: it is drawn below, from right to left
    flipped = {s for s, _ in back if by_name[s].kind == "gain"}
    forward = {
        n: [t for t in after[n] if (n, t) not in back and t not in flipped]
        for n in names
        if n not in flipped
    }
    column = _columns(forward)
    feeds: dict[str, list[str]] = {n: [] for n in names}
    for source, targets in forward.items():
        for target in targets:
            feeds[target].append(source)
    fed = {line.target for line in lines}
    places = _rows(forward, feeds, column, fed)
    used = set(places.values())
    floor = 1 + max((r for _, r in places.values()), default=-1)
    for name in (n for n in names if n in flipped):
        source = next(line.source for line in lines if line.target == name)
        c = places[source][0] if source in places else 0
        row = floor if floor > 1 else 1
        while (c, row) in used or any(r == row for n, (_, r) in places.items() if n in flipped):
            row += 1
        places[name] = (c, row)
        used.add((c, row))
    return Layered(places=places, flipped=flipped)


def backward_lines(names: Iterable[str], after: Mapping[str, list[str]]) -> set[tuple[str, str]]:
    """Return the lines that close a loop, in a walk along the lines from the first block on."""
    done: set[str] = set()
    back: set[tuple[str, str]] = set()
    for start in names:
        if start in done:
            continue
        path = [(start, iter(after[start]))]
        on_path = {start}
        while path:
            name, rest = path[-1]
            step = next(rest, None)
            if step is None:
                path.pop()
                on_path.discard(name)
                done.add(name)
            elif step in on_path:
                back.add((name, step))
            elif step not in done:
                path.append((step, iter(after[step])))
                on_path.add(step)
    return back


def longest_ways(forward: Mapping[str, list[str]]) -> dict[str, int]:
    """Return how many lines lie before each block, on the longest way; lines form no loop."""
    found = dict.fromkeys(forward, 0)
    changed = True
    while changed:
        changed = False
        for name, targets in forward.items():
            for target in targets:
                if found[target] <= found[name]:
                    found[target] = found[name] + 1
                    changed = True
    return found


def _columns(forward: dict[str, list[str]]) -> dict[str, int]:
    """Column of each block: as far left as its sources allow, then near to what it feeds."""
    column = longest_ways(forward)
    for _ in forward:
        for name, targets in forward.items():
            if targets:
                column[name] = max(column[name], min(column[t] for t in targets) - 1)
    return column


def _rows(
    forward: dict[str, list[str]],
    feeds: dict[str, list[str]],
    column: dict[str, int],
    fed: set[str],
) -> dict[str, tuple[int, int]]:
    """Row of each block: that of its first source, or one that is free up to the left edge."""
    places: dict[str, tuple[int, int]] = {}
    taken: set[tuple[int, int]] = set()
    order = sorted(forward, key=lambda n: column[n])
    first_rows = 0
    for name in order:
        c = column[name]
        wished = [places[s][1] for s in feeds[name] if s in places]
        row = wished[0] if wished else first_rows
        if name in fed:
            while (c, row) in taken:
                row += 1
        else:
            row = 0 if not places else row
            while any((k, row) in taken for k in range(c + 1)):
                row += 1
        places[name] = (c, row)
        taken.add((c, row))
    return places


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
