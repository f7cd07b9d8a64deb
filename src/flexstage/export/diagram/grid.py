"""Lines between cells of a grid that run in the channels between its columns and rows.

Cells have pins at their left and right. A line leaves a pin into the channel beside its column,
runs up or down in a track of its own, and, where its target is in another column, along a channel
between two rows. So lines cross one another, but never a cell, and never lie on one another.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field

from flexstage.export.diagram.shapes import DiagramCell, Net, Point, Routed, Segment

#: Distance between tracks [px].
PITCH = 9.0
#: Pins nearer than this count as one height [px].
SAME = 3.5


#: Distance between the outer tracks of a channel and cells [px].
MARGIN = 14.0


@dataclass(slots=True)
class ChannelRun:
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


def route(
    cells: Mapping[str, DiagramCell],
    places: Mapping[str, tuple[int, int]],
    nets: Mapping[str, Net],
    *,
    apart: bool = False,
    outer: bool = True,
    room: Mapping[int, float] | None = None,
) -> Routed:
    """Place cells in a grid, at column and row, and lead lines between them.

    With `apart` cells are lowered a little where pins on both sides of a channel are of one height;
    without it two lines that change places between such pins lie on each other for a short way.
    `outer` leaves room left of the first column and right of the last one; `room` leaves some for
    words at the left of channels, by the column at their right [px].
    """
    grid = _Grid(cells, places, nets, apart=apart, outer=outer, room=room or {})
    return grid.routed()


class _Grid:
    def __init__(
        self,
        cells: Mapping[str, DiagramCell],
        places: Mapping[str, tuple[int, int]],
        nets: Mapping[str, Net],
        *,
        apart: bool,
        outer: bool,
        room: Mapping[int, float],
    ) -> None:
        self.cells, self.places, self.nets = cells, places, nets
        self.apart, self.outer, self.room = apart, outer, room
        self.columns = 1 + max(c for c, _ in places.values())
        self.rows = 1 + max(r for _, r in places.values())
        self.taken = {place: name for name, place in places.items()}

    # where pins are, in channels and rows

    def channel(self, end: tuple[str, str]) -> int:
        name, pin = end
        return self.places[name][0] + (self.cells[name].pins[pin].side == "R")

    def row(self, end: tuple[str, str]) -> int:
        return self.places[end[0]][1]

    def about(self, end: tuple[str, str]) -> float:
        """Height of a pin in rows."""
        cell = self.cells[end[0]]
        return self.row(end) + 0.5 + 1e-3 * (cell.pins[end[1]].y - cell.axis)

    def sees(self, source: tuple[str, str], target: tuple[str, str]) -> bool:
        """Whether nothing stands in the row between two pins, the source left of the target."""
        row, first, last = self.row(source), self.channel(source), self.channel(target)
        return (
            row == self.row(target)
            and first < last
            and self.cells[source[0]].pins[source[1]].side == "R"
            and self.cells[target[0]].pins[target[1]].side == "L"
            and not any((c, row) in self.taken for c in range(first, last))
        )

    def routed(self) -> Routed:
        buses = self._buses()
        tracks, loads = self._bus_tracks(buses)
        tops, bus_y, height = self._heights(loads)
        y = self._cell_heights(tops)
        runs = self._runs(buses, tracks, bus_y, y)
        ranks, counts = self._vertical_tracks(runs)
        lefts, widths, track_x, width = self._widths(counts)
        at = {}
        for name, (c, _) in self.places.items():
            at[name] = (lefts[c] + 0.5 * (widths[c] - self.cells[name].width), y[name])
        lines = {
            name: self._segments(name, runs, ranks, track_x, at, buses, tracks, bus_y)
            for name in self.nets
        }
        return Routed(size=(width, height), cells=at, lines=lines)

    # channels between rows

    def _buses(self) -> dict[str, int | None]:
        """Choose the channel between rows of each net that needs one."""
        load = [0] * (self.rows + 1)
        chosen: dict[str, int | None] = {}
        for name, net in self.nets.items():
            far = self._far(net)
            if not far:
                chosen[name] = None
                continue
            heights = [self.about(net.source), *(self.about(t) for t in far)]
            best = min(
                range(self.rows + 1),
                key=lambda h: (
                    round(sum(abs(h - a) for a in heights) + 0.02 * load[h], 6), load[h], h,
                ),
            )  # fmt: skip
            load[best] += 1
            chosen[name] = best
        return chosen

    def _far(self, net: Net) -> list[tuple[str, str]]:
        """Targets that are reached along a channel between rows."""
        own = self.channel(net.source)
        return [t for t in net.targets if self.channel(t) != own and not self.sees(net.source, t)]

    def _bus_tracks(self, buses: dict[str, int | None]) -> tuple[dict[str, int], list[int]]:
        """Give each net a track of its channel between rows."""
        tracks: dict[str, int] = {}
        used: list[list[list[tuple[int, int]]]] = [[] for _ in range(self.rows + 1)]
        spans = []
        for name, h in buses.items():
            if h is None:
                continue
            net = self.nets[name]
            ends = [self.channel(net.source), *(self.channel(t) for t in self._far(net))]
            spans.append((max(ends) - min(ends), min(ends), max(ends), name, h))
        # short ones first: they stay near the cells that they join
        for _, low, high, name, h in sorted(spans):
            for k, track in enumerate(used[h]):
                if all(high < a or low > b for a, b in track):
                    track.append((low, high))
                    tracks[name] = k
                    break
            else:
                tracks[name] = len(used[h])
                used[h].append([(low, high)])
        return tracks, [len(t) for t in used]

    def _heights(self, loads: list[int]) -> tuple[list[float], list[float], float]:
        """Return the axis of each row, the first track of each channel, and the height."""
        above = [0.0] * self.rows
        below = [0.0] * self.rows
        for name, (_, r) in self.places.items():
            cell = self.cells[name]
            above[r] = max(above[r], cell.axis)
            below[r] = max(below[r], cell.height - cell.axis)
        slack = 36.0 if self.apart else 0.0
        axes, buses, y = [], [], 0.0
        for h in range(self.rows + 1):
            edge = h in (0, self.rows) and loads[h] == 0
            room = 0.0 if edge else MARGIN + PITCH * max(loads[h] - 1, 0) + MARGIN
            buses.append(y + MARGIN)
            y += room
            if h < self.rows:
                axes.append(y + above[h])
                y += above[h] + below[h] + slack
        return axes, buses, y

    def _cell_heights(self, axes: list[float]) -> dict[str, float]:
        y = {n: axes[r] - self.cells[n].axis for n, (_, r) in self.places.items()}
        if not self.apart:
            return y
        taken: dict[int, list[float]] = {}
        for name in sorted(self.places, key=lambda n: self.places[n]):
            cell, (c, _) = self.cells[name], self.places[name]
            down = y[name]
            for step in range(18):
                down = y[name] + 2.0 * step
                near = [
                    abs(down + pin.y - other) < SAME
                    for pin in cell.pins.values()
                    for other in taken.get(c + (pin.side == "R"), [])
                ]
                if not any(near):
                    break
            y[name] = down
            for pin in cell.pins.values():
                taken.setdefault(c + (pin.side == "R"), []).append(down + pin.y)
        return y

    # channels between columns

    def _runs(
        self,
        buses: dict[str, int | None],
        tracks: dict[str, int],
        bus_y: list[float],
        y: dict[str, float],
    ) -> dict[tuple[str, int], ChannelRun]:
        """Collect what every net needs in every channel between columns."""
        runs: dict[tuple[str, int], ChannelRun] = {}

        def height(end: tuple[str, str]) -> float:
            return y[end[0]] + self.cells[end[0]].pins[end[1]].y

        def stub(name: str, end: tuple[str, str]) -> ChannelRun:
            run = runs.setdefault((name, self.channel(end)), ChannelRun())
            # a pin at the right of its cell is at the left of the channel
            right = self.cells[end[0]].pins[end[1]].side == "R"
            (run.left if right else run.right).append(height(end))
            return run

        for name, net in self.nets.items():
            own = stub(name, net.source)
            far = self._far(net)
            for target in net.targets:
                run = stub(name, target)
                if target in far or self.channel(target) == self.channel(net.source):
                    continue
                # it comes straight along the row
                run.left.append(height(net.source))
            bus = buses[name]
            if bus is not None:
                at = bus_y[bus] + PITCH * tracks[name]
                own.bus.append(at)
                for target in far:
                    runs[(name, self.channel(target))].bus.append(at)
        return runs

    def _vertical_tracks(
        self, runs: dict[tuple[str, int], ChannelRun]
    ) -> tuple[dict[tuple[str, int], int], list[int]]:
        ranks: dict[tuple[str, int], int] = {}
        counts = []
        for v in range(self.columns + 1):
            here = {n: run for (n, c), run in runs.items() if c == v and not run.straight}
            found = tracks_of(here)
            ranks |= {(n, v): k for n, k in found.items()}
            counts.append(1 + max(found.values(), default=-1))
        return ranks, counts

    def _widths(self, counts: list[int]) -> tuple[list[float], list[float], list[float], float]:
        """Return left and width of each column, the first track of each channel, and the width."""
        widths = [0.0] * self.columns
        for name, (c, _) in self.places.items():
            widths[c] = max(widths[c], self.cells[name].width)
        x, lefts, tracks = 0.0, [], []
        for v in range(self.columns + 1):
            edge = v in (0, self.columns) and counts[v] == 0
            room = 0.0 if edge and not self.outer else 2.0 * MARGIN + PITCH * max(counts[v] - 1, 0)
            x += self.room.get(v, 0.0)
            tracks.append(x + MARGIN)
            x += room
            if v < self.columns:
                lefts.append(x)
                x += widths[v]
        return lefts, widths, tracks, x

    def _segments(
        self,
        name: str,
        runs: dict[tuple[str, int], ChannelRun],
        ranks: dict[tuple[str, int], int],
        track_x: list[float],
        at: dict[str, Point],
        buses: dict[str, int | None],
        tracks: dict[str, int],
        bus_y: list[float],
    ) -> tuple[Segment, ...]:
        net = self.nets[name]
        own = self.channel(net.source)

        def pin(end: tuple[str, str]) -> Point:
            cell, (x, y) = self.cells[end[0]], at[end[0]]
            found = cell.pins[end[1]]
            return (x + (cell.width if found.side == "R" else 0.0), y + found.y)

        def across(v: int) -> float | None:
            rank = ranks.get((name, v))
            return None if rank is None else track_x[v] + PITCH * rank

        out: list[Segment] = []

        def level(y: float, a: float, b: float) -> None:
            if abs(a - b) > 1e-9:
                out.append(((min(a, b), y), (max(a, b), y)))

        start = pin(net.source)
        used = {v for n, v in runs if n == name}
        for v in sorted(used):
            x = across(v)
            if x is not None:
                run = runs[(name, v)]
                out.append(((x, run.low), (x, run.high)))
        x_own = across(own)
        if x_own is not None:
            level(start[1], start[0], x_own)
        far = self._far(net)
        for target in net.targets:
            end = pin(target)
            v = self.channel(target)
            x = across(v)
            straight = target not in far and v != own
            if x is None:
                # nothing to climb in this channel: the line goes on from the source
                level(end[1], start[0] if v == own or straight else end[0], end[0])
                continue
            level(end[1], x, end[0])
            if straight:
                level(start[1], start[0], x)
        bus = buses[name]
        if bus is not None:
            height = bus_y[bus] + PITCH * tracks[name]
            xs = [x for v in {own, *(self.channel(t) for t in far)} if (x := across(v)) is not None]
            if xs:
                level(height, min(xs), max(xs))
        return tuple(out)


def tracks_of(runs: Mapping[str, ChannelRun]) -> dict[str, int]:
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
