"""Columns and rows of the blocks of a group."""

from dataclasses import dataclass

from flexstage.export.diagram.graph import Block, SignalLine


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
    back = _backward(names, after)
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


def _backward(names: list[str], after: dict[str, list[str]]) -> set[tuple[str, str]]:
    """Lines that close a loop, in a walk along the lines from the first block on."""
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


def _columns(forward: dict[str, list[str]]) -> dict[str, int]:
    """Column of each block: as far left as its sources allow, then near to what it feeds."""
    column = dict.fromkeys(forward, 0)
    for _ in forward:
        for name, targets in forward.items():
            for target in targets:
                column[target] = max(column[target], column[name] + 1)
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
