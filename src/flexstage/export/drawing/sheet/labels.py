"""Labels beside the things that they name, where nothing else is written and few lines run."""

import math
from collections.abc import Iterable, Sequence
from typing import Any, NamedTuple

from flexstage.export.drawing.sheet.canvas import THIN, Box, Canvas, text_width

Pair = tuple[float, float]

_DISTANCES = (
    1.5,
    2.5,
    4.0,
    6.0,
    8.5,
    11.5,
    15.0,
    20.0,
    27.0,
    36.0,
)  # of a label from its thing [mm]
_DIRECTIONS = 24
_LINE = 4.0  # how much nearer a label without a line through it may be further away for it [mm]
_GAP = 0.5  # between labels [mm]


class Label(NamedTuple):
    """A word at a thing."""

    at: Pair
    """The thing [mm]."""
    text: str
    """The word."""
    colour: str = "#000"
    """Its colour."""
    radius: float = 0.0
    """Size of the thing, which the label keeps off [mm]."""


class Surroundings:
    """What labels avoid: each other, what is written already, and, where they can, lines."""

    def __init__(self, lines: Sequence[Any], area: Box, taken: Iterable[Box]) -> None:
        from shapely import STRtree

        self.tree = STRtree(list(lines))
        self.area = area
        # what is written elsewhere cannot be in the way
        self.taken = [t for t in taken if t.meets(area, _GAP)]
        self.leaders: list[Any] = []

    def cost(self, box: Box, leader: Any) -> float | None:
        """Return how bad a place is, as a distance [mm]; None where a label must not stand.

        The leader is the line from the label to its thing, or None.
        """
        from shapely import box as rectangle

        a = self.area
        if not (a.left <= box.left and box.right <= a.right):
            return None
        if not (a.top <= box.top and box.bottom <= a.bottom):
            return None
        if any(box.meets(t, _GAP) for t in self.taken):
            return None
        own = rectangle(*box)
        if any(own.intersects(other) for other in self.leaders):
            return None
        cost = _LINE * len(self.tree.query(own, predicate="dwithin", distance=_GAP))
        if leader is not None:
            if any(leader.intersects(rectangle(*t)) for t in self.taken):
                return None
            cost += 3.0 * sum(leader.crosses(other) for other in self.leaders)
        return cost


def place_labels(
    canvas: Canvas, labels: Iterable[Label], around: Surroundings, size: float
) -> None:
    """Write labels, each near its thing, none over another word; surroundings learn of them."""
    from shapely import LineString

    for label in labels:
        best: tuple[float, Pair, Box, Any] | None = None
        for distance in _DISTANCES:
            if best is not None and distance > best[0]:
                break  # nothing further away can be better
            for k in range(_DIRECTIONS):
                place = _place(canvas, label, size, label.radius + distance, k)
                start, box = place
                tip = _nearest(box, label.at)
                leader = LineString([label.at, tip]) if distance > 2.0 else None
                cost = around.cost(box, leader)
                if cost is not None and (best is None or distance + cost < best[0]):
                    best = (distance + cost, start, box, leader)
        if best is None:
            # a crowd: it goes over what is drawn rather than be left out
            start, box = _place(canvas, label, size, label.radius + 1.5, 3)
            best = (0.0, start, box, None)
        _, start, box, leader = best
        canvas.text(start, label.text, size, colour=label.colour)
        around.taken.append(box)
        if leader is not None:
            canvas.line(label.at, _nearest(box, label.at), 0.6 * THIN, colour=label.colour)
            around.leaders.append(leader)


def _place(canvas: Canvas, label: Label, size: float, distance: float, k: int) -> tuple[Pair, Box]:
    """Return the start of the text and its box for one direction and distance."""
    # begin to the upper right, where a reader looks first
    angle = 2.0 * math.pi * (k + 3) / _DIRECTIONS
    c, s = math.cos(angle), -math.sin(angle)
    x, y = label.at[0] + distance * c, label.at[1] + distance * s
    # the box touches the point with its near side
    width, height = text_width(label.text, size), size
    left = x + 0.5 * (c - 1.0) * width
    baseline = y + 0.5 * (s + 1.0) * height - 0.1 * size
    start = (left, baseline)
    return start, canvas.text_box(start, label.text, size)


def _nearest(box: Box, p: Pair) -> Pair:
    return min(max(p[0], box.left), box.right), min(max(p[1], box.top), box.bottom)
