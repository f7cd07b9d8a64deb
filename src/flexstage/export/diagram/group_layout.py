"""The drawing of one group: its blocks, the lines between them, and ports at its edges."""

from dataclasses import dataclass

from flexstage.export.diagram.graph import Block, BlockGroup, Diagram, SignalLine
from flexstage.export.diagram.grid import route
from flexstage.export.diagram.markup import SMALL, plain
from flexstage.export.diagram.placing import Layered, layered
from flexstage.export.diagram.shapes import DiagramCell, Net, Pin, Routed, Segment, block_cell
from flexstage.export.svg import text_width, wrapped

_PAD = 10.0
_TITLE = 26.0
_SUBTITLE = 14.0
_PORT_APART = 19.0


@dataclass(frozen=True, slots=True, kw_only=True)
class GroupPort:
    """Where a line enters or leaves a group."""

    block: str
    """The block that it comes from."""
    side: str
    """``L`` for one that enters, ``R`` for one that leaves."""
    y: float
    """Height below the top of the group [px]."""
    label: str
    """Name of the signal."""


@dataclass(frozen=True, slots=True, kw_only=True)
class GroupLayout:
    """A group, drawn."""

    group: BlockGroup
    """The group."""
    width: float
    """Its width [px]."""
    height: float
    """Its height [px]."""
    subtitle: tuple[str, ...]
    """Lines below its title: those that it stands for."""
    cells: dict[str, tuple[float, float]]
    """Left top corner of each block [px]."""
    shapes: dict[str, DiagramCell]
    """Cells of the blocks."""
    flipped: set[str]
    """Blocks that are drawn from right to left."""
    lines: dict[str, tuple[Segment, ...]]
    """Segments of each line [px], by the block that it comes from."""
    ports: tuple[GroupPort, ...]
    """Its ports."""
    names: tuple[tuple[str, float, float], ...]
    """Names of signals inside: the name, and where its base line begins [px]."""


def group_layout(diagram: Diagram, group: BlockGroup) -> GroupLayout:
    """Draw one group."""
    blocks = tuple(b for b in diagram.blocks if b.group == group.name)
    own = {b.name for b in blocks}
    inner = tuple(x for x in diagram.lines if x.source in own and x.target in own)
    enter = tuple(x for x in diagram.lines if x.source not in own and x.target in own)
    leave = tuple(x for x in diagram.lines if x.source in own and x.target not in own)
    order = layered(blocks, inner)
    shapes = _shapes(blocks, inner, enter, order)
    cells, places, ports = _with_ports(blocks, order, shapes, enter, leave)
    nets = _nets(inner, enter, leave, ports)
    named = tuple(x for x in inner if places[x.source][1] == places[x.target][1])
    routed = route(cells, places, nets, outer=False, room=_room(named, places))
    return _finished(group, routed, cells, shapes, order, ports, named)


def _shapes(
    blocks: tuple[Block, ...],
    inner: tuple[SignalLine, ...],
    enter: tuple[SignalLine, ...],
    order: Layered,
) -> dict[str, DiagramCell]:
    shapes = {}
    for b in blocks:
        sources = {x.port: x.source for x in inner if x.target == b.name}
        outside = sum(x.target == b.name for x in enter)
        if b.kind != "sum":
            shapes[b.name] = block_cell(b, flipped=b.name in order.flipped)
            continue
        row = order.places[b.name][1]
        level = [p for p, s in sources.items() if order.places[s][1] == row]
        straight = level[0] if level else None
        lower = {p: order.places[s][1] > row for p, s in sources.items()}
        shapes[b.name] = block_cell(b, straight=straight, lower=lower, long=outside > 1)
    return shapes


@dataclass(frozen=True, slots=True, kw_only=True)
class _Stack:
    """Ports that share a row: cell, and for each the pin and the label."""

    name: str
    side: str
    pins: dict[str, str]


def _with_ports(
    blocks: tuple[Block, ...],
    order: Layered,
    shapes: dict[str, DiagramCell],
    enter: tuple[SignalLine, ...],
    leave: tuple[SignalLine, ...],
) -> tuple[dict[str, DiagramCell], dict[str, tuple[int, int]], list[_Stack]]:
    """Add a column of ports on either side."""
    last = 2 + max((c for c, _ in order.places.values()), default=0)
    cells = dict(shapes)
    places = {n: (c + 1, r) for n, (c, r) in order.places.items()}
    stacks = []
    for side, lines, column in (("L", enter, 0), ("R", leave, last)):
        by_row: dict[int, dict[str, SignalLine]] = {}
        seen: set[str] = set()
        for x in lines:
            if x.source in seen:
                continue
            seen.add(x.source)
            row = places[x.target if side == "L" else x.source][1]
            by_row.setdefault(row, {})[x.source] = x
        for row, found in by_row.items():
            name, labels = f"{side}:{row}", _labels(found, lines)
            if side == "L":
                # the unit stands where the line leaves a group; here is no room for it
                labels = {s: _name(label) for s, label in labels.items()}
            cells[name] = _port_cell(found, shapes, side, labels)
            places[name] = (column, row)
            stacks.append(_Stack(name=name, side=side, pins=labels))
    return cells, places, stacks


def _labels(found: dict[str, SignalLine], lines: tuple[SignalLine, ...]) -> dict[str, str]:
    return {s: next((x.signal for x in lines if x.source == s and x.signal), "") for s in found}


def _name(signal: str) -> str:
    """Return the name of a signal without its unit."""
    return signal.partition(" [")[0]


def _room(inner: tuple[SignalLine, ...], places: dict[str, tuple[int, int]]) -> dict[int, float]:
    """Room for names of signals behind the blocks that they come from."""
    room: dict[int, float] = {}
    for x in inner:
        if x.signal and places[x.source][1] == places[x.target][1]:
            channel = places[x.source][0] + 1
            wide = text_width(plain(_name(x.signal)), SMALL) + 2.0
            room[channel] = max(room.get(channel, 0.0), wide)
    return room


def _port_cell(
    found: dict[str, SignalLine], shapes: dict[str, DiagramCell], side: str, labels: dict[str, str]
) -> DiagramCell:
    """Return the cell of the ports of a row, each level with the pin that it leads to."""
    offsets: dict[str, float] = {}
    for source, x in found.items():
        shape = shapes[x.target if side == "L" else x.source]
        pin = shape.pins[f"in{x.port}" if side == "L" else "out"]
        offsets[source] = pin.y - shape.axis
    taken: list[float] = []
    # from the last block on: the line that ends the row goes straight, the others above it
    for source in reversed(found):
        y = offsets[source]
        while any(abs(y - other) < _PORT_APART - 1e-9 for other in taken):
            y -= _PORT_APART
        offsets[source] = y
        taken.append(y)
    top = SMALL + 6.0 - min(taken)
    width = max((text_width(plain(t), SMALL) for t in labels.values()), default=0.0) + 12.0
    other = "R" if side == "L" else "L"
    return DiagramCell(
        width=width,
        height=top + max(taken) + 4.0,
        axis=top,
        pins={source: Pin(other, top + y) for source, y in offsets.items()},
    )


def _nets(
    inner: tuple[SignalLine, ...],
    enter: tuple[SignalLine, ...],
    leave: tuple[SignalLine, ...],
    stacks: list[_Stack],
) -> dict[str, Net]:
    targets: dict[str, list[tuple[str, str]]] = {}
    for x in (*inner, *enter):
        targets.setdefault(x.source, []).append((x.target, f"in{x.port}"))
    starts: dict[str, tuple[str, str]] = {x.source: (x.source, "out") for x in (*inner, *leave)}
    for stack in stacks:
        for source in stack.pins:
            if stack.side == "L":
                starts[source] = (stack.name, source)
            else:
                targets.setdefault(source, []).append((stack.name, source))
    return {s: Net(source=starts[s], targets=tuple(t)) for s, t in targets.items()}


def _finished(
    group: BlockGroup,
    routed: Routed,
    cells: dict[str, DiagramCell],
    shapes: dict[str, DiagramCell],
    order: Layered,
    stacks: list[_Stack],
    named: tuple[SignalLine, ...],
) -> GroupLayout:
    """Put a title over what was routed, and lead the lines of ports to the edges."""
    width = max(routed.size[0], text_width(group.title, 13.0)) + 2.0 * _PAD
    subtitle: tuple[str, ...] = ()
    if group.stands_for:
        names = "also " + ", ".join(group.stands_for)
        subtitle = tuple(wrapped(names, width - 2.0 * _PAD, SMALL))
    top = (_TITLE + _SUBTITLE * len(subtitle)) if group.title else _PAD
    left = 0.5 * (width - routed.size[0])
    lines = {
        n: [((x1 + left, y1 + top), (x2 + left, y2 + top)) for (x1, y1), (x2, y2) in segments]
        for n, segments in routed.lines.items()
    }
    ports = []
    for stack in stacks:
        cell, (x, y) = cells[stack.name], routed.cells[stack.name]
        for source, label in stack.pins.items():
            height = y + cell.pins[source].y + top
            inside = x + left + (cell.width if stack.side == "L" else 0.0)
            edge = 0.0 if stack.side == "L" else width
            lines[source].append(((min(inside, edge), height), (max(inside, edge), height)))
            ports.append(GroupPort(block=source, side=stack.side, y=height, label=label))
    names = []
    for source in dict.fromkeys(x.source for x in named if x.signal):
        (x, y), cell = routed.cells[source], shapes[source]
        signal = next(line.signal for line in named if line.source == source and line.signal)
        names.append(
            (_name(signal), x + left + cell.width + 3.0, y + top + cell.pins["out"].y - 5.0)
        )
    return GroupLayout(
        group=group,
        width=width,
        height=top + routed.size[1] + _PAD,
        subtitle=subtitle,
        cells={n: (x + left, y + top) for n, (x, y) in routed.cells.items() if n in shapes},
        shapes=shapes,
        flipped=order.flipped,
        lines={n: tuple(s) for n, s in lines.items()},
        ports=tuple(ports),
        names=tuple(names),
    )
