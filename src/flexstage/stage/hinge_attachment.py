"""Attachment of a hinge to its two bodies: the edge at its root and the width of the body there."""

import math
from functools import lru_cache
from typing import NamedTuple

from flexstage.base.errors import StageError
from flexstage.stage.model import Body, Hinge, Stage
from flexstage.stage.outline import Loop

#: Largest distance of a root from the edge that it should lie on [m].
TOLERANCE = 1e-6

_Pair = tuple[float, float]


class Root(NamedTuple):
    """The straight line on which a notch meets a body."""

    body: str
    """Name of the body."""
    ends: tuple[_Pair, _Pair]
    """The two ends of the root [m], right and left of the hinge's direction."""
    edge: tuple[_Pair, _Pair]
    """The two ends of the edge of the body that holds the root [m], right and left as well."""
    width: float
    """Width of the body behind the root [m]."""


def root_line(hinge: Hinge, which: int) -> tuple[_Pair, _Pair]:
    """Return the ends of the root of a hinge.

    Right and left of the hinge's direction [m]; `which` is 0 for the root on body a, 1 for the one
    on body b.
    """
    profile = hinge.profile
    along = (-0.5, 0.5)[which] * profile.length
    half_neck = 0.5 * profile.neck_thickness
    right = -half_neck if profile.one_sided else -0.5 * profile.root_height
    return hinge.to_plane(along, right), hinge.to_plane(along, half_neck + profile.depth)


def hinge_root(stage: Stage, hinge: Hinge, which: int) -> Root:
    """Find the edge of a body that a hinge grows from."""
    body = stage.body(hinge.bodies[which])
    right, left = root_line(hinge, which)
    for first, second in _straight_edges(body):
        if _contains(first, second, right) and _contains(first, second, left):
            # seen from the neck the edge may run either way
            across = (left[0] - right[0], left[1] - right[1])
            swap = (second[0] - first[0]) * across[0] + (second[1] - first[1]) * across[1] < 0.0
            edge = (second, first) if swap else (first, second)
            middle = (0.5 * (right[0] + left[0]), 0.5 * (right[1] + left[1]))
            width = 2.0 * min(math.dist(middle, edge[0]), math.dist(middle, edge[1]))
            return Root(body.name, (right, left), edge, width)
    x, y = hinge.to_plane((-0.5, 0.5)[which] * hinge.profile.length, 0.0)
    raise StageError(
        f"hinge '{hinge.name}' is not attached to body '{body.name}': its end face, "
        f"{hinge.profile.root_height * 1e3:.6g} mm wide at ({x * 1e3:.6g}, {y * 1e3:.6g}) mm, "
        f"must lie on one straight edge of the body's outline (to {TOLERANCE * 1e6:.0f} um); move "
        "the hinge, correct its direction, or widen the edge"
    )


def root_widths(stage: Stage, hinge: Hinge) -> tuple[float, float]:
    """Return the widths of the two bodies behind the roots of a hinge.

    The width is twice the distance from the middle of the root (which is on the hinge's line for a
    notch cut from both sides) to the nearer end of the edge, so it is never less than the root.

    Parameters
    ----------
    stage : Stage
        The stage.
    hinge : Hinge
        One of its hinges.

    Returns
    -------
    tuple of float
        Width of body a and of body b [m].

    Raises
    ------
    StageError
        A root does not lie on its body.
    """
    return hinge_root(stage, hinge, 0).width, hinge_root(stage, hinge, 1).width


# several hinges grow from a body
@lru_cache(maxsize=1024)
def _straight_edges(body: Body) -> list[tuple[_Pair, _Pair]]:
    """Return the straight edges of the outline and the holes, collinear neighbours joined."""
    loops = [body.outline, *(hole for hole in body.holes if isinstance(hole, Loop))]
    edges: list[tuple[_Pair, _Pair]] = []
    for loop in loops:
        run: list[tuple[_Pair, _Pair]] = []
        for start, end, bulge in loop.segments():
            if bulge or start == end:
                continue
            if run and run[-1][1] == start and _in_line(run[-1], end):
                run[-1] = (run[-1][0], end)
            else:
                run.append((start, end))
        # the first corner of a loop may lie within a straight side
        if len(run) > 1 and run[-1][1] == run[0][0] and _in_line(run[-1], run[0][1]):
            run[0] = (run.pop()[0], run[0][1])
        edges += run
    return edges


def _in_line(edge: tuple[_Pair, _Pair], onward: _Pair) -> bool:
    """Return whether an edge keeps its direction when it is continued to a point."""
    (x0, y0), (x1, y1) = edge
    ax, ay, bx, by = x1 - x0, y1 - y0, onward[0] - x1, onward[1] - y1
    # a corner that is off the chord by less than a nanometre is a rounding, not a corner
    chord = math.hypot(ax + bx, ay + by)
    return ax * bx + ay * by > 0.0 and abs(ax * by - ay * bx) <= 1e-9 * chord


def _contains(first: _Pair, second: _Pair, point: _Pair) -> bool:
    dx, dy = second[0] - first[0], second[1] - first[1]
    length = math.hypot(dx, dy)
    px, py = point[0] - first[0], point[1] - first[1]
    along, across = (px * dx + py * dy) / length, (dx * py - dy * px) / length
    return abs(across) <= TOLERANCE and -TOLERANCE <= along <= length + TOLERANCE
