"""Cells of a drawing and the lines between them: sizes of blocks, and where lines meet them."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from flexstage.export.diagram.graph import Block
from flexstage.export.diagram.markup import BASE, SMALL, plain
from flexstage.export.svg import text_width

Point = tuple[float, float]
Segment = tuple[Point, Point]


@dataclass(frozen=True, slots=True)
class Pin:
    """A pin of a cell."""

    side: str
    """``L`` or ``R``."""
    y: float
    """Distance below the top of the cell [px]."""


@dataclass(frozen=True, slots=True, kw_only=True)
class DiagramCell:
    """A thing in the grid."""

    width: float
    """Its width [px]."""
    height: float
    """Its height [px]."""
    axis: float
    """Distance of the line that cells of a row share below its top [px]."""
    pins: Mapping[str, Pin]
    """Its pins by name."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Net:
    """A line from one pin to others."""

    source: tuple[str, str]
    """Cell and pin."""
    targets: tuple[tuple[str, str], ...]
    """Cells and pins."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Routed:
    """Where things are."""

    size: Point
    """Width and height [px]."""
    cells: Mapping[str, Point]
    """Left top corner of each cell [px]."""
    lines: Mapping[str, tuple[Segment, ...]]
    """Segments of each net."""


def branches(segments: Sequence[Segment]) -> list[Point]:
    """Return the points at which a line branches."""
    points = sorted({p for s in segments for p in s})
    out = []
    for x, y in points:
        ways = set()
        for (x1, y1), (x2, y2) in segments:
            if y1 == y2 == y and x1 <= x <= x2:
                ways |= ({"left"} if x1 < x else set()) | ({"right"} if x < x2 else set())
            if x1 == x2 == x and y1 <= y <= y2:
                ways |= ({"up"} if y1 < y else set()) | ({"down"} if y < y2 else set())
        if len(ways) > 2:
            out.append((x, y))
    return out


SUM_RADIUS = 15.0
# Distance of the inputs of a long sum, and of the outer ones from its ends.
_APART = 19.0
_END = 16.0
# Offsets of the inputs of a round sum: the straight one, and the other below or above.
_ROUND = (0.0, 10.5)
_CAPTION = 15.0


def round_sum(block: Block) -> bool:
    """Return whether a sum is drawn as a circle: one with few inputs is."""
    return len(block.signs) <= len(_ROUND)


def shape_width(block: Block) -> float:
    """Return the width of what is drawn for a block, without its caption [px]."""
    label = text_width(plain(block.label), BASE)
    match block.kind:
        case "sum":
            return 2.0 * SUM_RADIUS
        case "integrator":
            return 34.0
        case "input" | "output":
            return label + 20.0
        case "gain":
            if block.role in ("spring", "damper"):
                return label + 46.0
            return label + (34.0 if block.width == 1 and _scalar(block) else 22.0)
        case _:
            return 56.0


def _scalar(block: Block) -> bool:
    return block.matrix is not None and block.matrix.shape == (1, 1)


def block_cell(
    block: Block,
    *,
    flipped: bool = False,
    straight: int | None = None,
    lower: Mapping[int, bool] | None = None,
    long: bool = False,
) -> DiagramCell:
    """Return the cell of a block, with pins ``out``, ``in0``, ``in1`` and so on.

    A flipped one is drawn from right to left. Of a sum, the input `straight` lies on its axis (the
    first of a round one and the middle of a long one where not given); `lower` says which inputs
    of a round one come from below, and `long` draws one of few inputs long all the same.
    """
    into, out = ("R", "L") if flipped else ("L", "R")
    width = shape_width(block)
    if block.kind == "sum":
        if long or not round_sum(block):
            height = _APART * (len(block.signs) - 1) + 2.0 * _END
            pins = {f"in{k}": Pin(into, _END + _APART * k) for k in range(len(block.signs))}
            axis = 0.5 * height if straight is None else pins[f"in{straight}"].y
            pins["out"] = Pin(out, axis)
            return DiagramCell(width=width, height=height, axis=axis, pins=pins)
        pins = {"out": Pin(out, SUM_RADIUS)}
        for k in range(len(block.signs)):
            offset = _ROUND[k != (straight or 0)]
            if not (lower or {}).get(k, True):
                offset = -offset
            pins[f"in{k}"] = Pin(into, SUM_RADIUS + offset)
        return DiagramCell(width=width, height=2.0 * SUM_RADIUS, axis=SUM_RADIUS, pins=pins)
    height, caption = {
        "integrator": (36.0, 0.0),
        "input": (26.0, 0.0),
        "output": (26.0, 0.0),
        "gain": (34.0, 0.0),
    }.get(block.kind, (42.0, _CAPTION))
    if caption:
        width = max(width, text_width(plain(block.label), SMALL))
    pins = {"out": Pin(out, 0.5 * height), "in0": Pin(into, 0.5 * height)}
    return DiagramCell(width=width, height=height + caption, axis=0.5 * height, pins=pins)
