"""Cells of a grid and the lines between them, as data."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

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
class Cell:
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
