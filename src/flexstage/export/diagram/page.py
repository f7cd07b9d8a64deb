"""Where the groups of a diagram stand on a page, and the lines between them."""

from dataclasses import dataclass

from flexstage.export.diagram.graph import Block, BlockGroup, Diagram
from flexstage.export.diagram.grid import route
from flexstage.export.diagram.group_layout import GroupLayout, group_layout
from flexstage.export.diagram.placing import Thing, place_groups
from flexstage.export.diagram.shapes import DiagramCell, Net, Pin, Segment


@dataclass(frozen=True, slots=True, kw_only=True)
class PlacedBlock:
    """A block on the page."""

    block: Block
    """The block."""
    x: float
    """Left edge of its cell [px]."""
    y: float
    """Top of its cell [px]."""
    cell: DiagramCell
    """Its size and pins."""
    flipped: bool
    """Whether it is drawn from right to left."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PlacedLabel:
    """Name of a signal on the page."""

    text: str
    """The name."""
    x: float
    """Where it begins, or ends [px]."""
    y: float
    """Height of its base line [px]."""
    end: bool = False
    """Whether it ends there."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Frame:
    """A group on the page."""

    group: BlockGroup
    """The group."""
    x: float
    """Left edge [px]."""
    y: float
    """Top [px]."""
    width: float
    """Width [px]."""
    height: float
    """Height [px]."""
    subtitle: tuple[str, ...]
    """Lines below its title."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PlacedLine:
    """A line from one block to others."""

    source: str
    """The block that it comes from."""
    segments: tuple[Segment, ...]
    """Its segments, level or upright."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PageLayout:
    """A diagram on a page."""

    width: float
    """Width [px]."""
    height: float
    """Height [px]."""
    frames: tuple[Frame, ...]
    """The groups."""
    blocks: tuple[PlacedBlock, ...]
    """The blocks."""
    wires: tuple[PlacedLine, ...]
    """The lines."""
    labels: tuple[PlacedLabel, ...]
    """Names of signals where lines enter and leave groups."""


def layout(diagram: Diagram) -> PageLayout:
    """Place a diagram on a page.

    Groups stand in a grid, near to those that they are joined with; lines between them run in the
    channels between. The same diagram gives the same layout.

    Examples
    --------
    >>> from flexstage.designs import design
    >>> from flexstage.export.diagram.stage_diagram import stage_diagram
    >>> found = layout(stage_diagram(design("parallelogram")))
    >>> len(found.frames), len(found.blocks)
    (6, 34)
    """
    groups = list(diagram.groups)
    if any(not b.group for b in diagram.blocks):
        groups.append(BlockGroup(name="", title="", kind=""))
    filled = {b.group for b in diagram.blocks}
    tiles = {g.name: group_layout(diagram, g) for g in groups if g.name in filled}
    nets = _nets(diagram)
    places = place_groups(
        {n: Thing(kind=t.group.kind, width=t.width, height=t.height) for n, t in tiles.items()},
        [(net.source[0], tuple(g for g, _ in net.targets)) for net in nets.values()],
    )
    cells = {n: _cell(t) for n, t in tiles.items()}
    routed = route(cells, places, nets, apart=True, outer=False)
    by_name = {b.name: b for b in diagram.blocks}
    frames, blocks, labels = [], [], []
    wires: dict[str, list[Segment]] = {n: list(s) for n, s in routed.lines.items()}
    for name, tile in tiles.items():
        x, y = routed.cells[name]
        frames.append(
            Frame(
                group=tile.group, x=x, y=y, width=tile.width, height=tile.height,
                subtitle=tile.subtitle,
            )
        )  # fmt: skip
        for block, (dx, dy) in tile.cells.items():
            blocks.append(
                PlacedBlock(
                    block=by_name[block], x=x + dx, y=y + dy, cell=tile.shapes[block],
                    flipped=block in tile.flipped,
                )
            )  # fmt: skip
        for source, segments in tile.lines.items():
            wires.setdefault(source, []).extend(
                ((x1 + x, y1 + y), (x2 + x, y2 + y)) for (x1, y1), (x2, y2) in segments
            )
        for port in tile.ports:
            right = port.side == "R"
            at = x + (tile.width - 5.0 if right else 5.0)
            labels.append(PlacedLabel(text=port.label, x=at, y=y + port.y - 5.0, end=right))
        labels += [PlacedLabel(text=t, x=x + dx, y=y + dy) for t, dx, dy in tile.names]
    return PageLayout(
        width=routed.size[0],
        height=routed.size[1],
        frames=tuple(frames),
        blocks=tuple(blocks),
        wires=tuple(PlacedLine(source=n, segments=tuple(s)) for n, s in wires.items()),
        labels=tuple(labels),
    )


def _cell(tile: GroupLayout) -> DiagramCell:
    pins = {f"{p.side}:{p.block}": Pin(p.side, p.y) for p in tile.ports}
    return DiagramCell(width=tile.width, height=tile.height, axis=0.0, pins=pins)


def _nets(diagram: Diagram) -> dict[str, Net]:
    of = {b.name: b.group for b in diagram.blocks}
    targets: dict[str, list[str]] = {}
    for line in diagram.lines:
        if of[line.source] != of[line.target]:
            found = targets.setdefault(line.source, [])
            if of[line.target] not in found:
                found.append(of[line.target])
    return {
        s: Net(source=(of[s], f"R:{s}"), targets=tuple((g, f"L:{s}") for g in found))
        for s, found in targets.items()
    }
