"""Cells of a grid and the lines between them, as data."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

__all__ = ["Cell", "Net", "Pin", "Point", "Routed", "Segment", "branches"]

Point = tuple[float, float]
Segment = tuple[Point, Point]


@dataclass(frozen=True, slots=True)
class Pin:
    """A pin of a cell.

    Parameters
    ----------
    side : str
        ``L`` or ``R``.
    y : float
        Distance below the top of the cell [px].
    """

    side: str
    y: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Cell:
    """A thing in the grid.

    Parameters
    ----------
    width, height : float
        Its size [px].
    axis : float
        Distance of the line that cells of a row share below its top [px].
    pins : Mapping
        Its pins by name.
    """

    width: float
    height: float
    axis: float
    pins: Mapping[str, Pin]


@dataclass(frozen=True, slots=True, kw_only=True)
class Net:
    """A line from one pin to others.

    Parameters
    ----------
    source : tuple of str
        Cell and pin.
    targets : tuple of tuple of str
        Cells and pins.
    """

    source: tuple[str, str]
    targets: tuple[tuple[str, str], ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class Routed:
    """Where things are.

    Parameters
    ----------
    size : tuple of float
        Width and height [px].
    cells : Mapping
        Left top corner of each cell [px].
    lines : Mapping
        Segments of each net.
    """

    size: Point
    cells: Mapping[str, Point]
    lines: Mapping[str, tuple[Segment, ...]]


def branches(segments: Sequence[Segment]) -> list[Point]:
    """Return the points at which a line branches.

    Parameters
    ----------
    segments : Sequence
        Its segments, level or upright.

    Returns
    -------
    list of tuple of float
        The points.
    """
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
