"""Strips of constant thickness, straight or around corners, as chains of leaves without steps.

The sides of a strip are two parallel straight lines. Where both turn, and the next two lines are as
far apart, the strip continues: what lies between is a small body in the corner. It ends where no
such lines follow, in the edge of a body or as wide as the body. A strip with a free end holds no
body, and is part of the one that it grows from.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from flexstage.hinges import Leaf
from flexstage.stage.curve import Curve
from flexstage.stage.drawing.contours import DrawnContour, DrawnPart
from flexstage.stage.drawing.notch import PARALLEL, NeckFrame, Sides
from flexstage.stage.drawing.profiles import Neck, settled_sides
from flexstage.stage.drawing.strokes import Pair, rounded
from flexstage.stage.drawing.thickness import Pass, Place
from flexstage.stage.outline import Loop


@dataclass(frozen=True, slots=True)
class _StripRules:
    """Limits by which a strip continues, in its thicknesses."""

    shortest: float = 1.0
    """Shortest straight strip between two corners."""
    alone: float = 2.0
    """Shortest strip without corners."""
    corner: float = 40.0
    """Largest distance between the ends of two strips around a corner."""
    pieces: int = 4
    """Most pieces of a side from a strip to the next one."""
    uneven: float = 1.5
    """Ratio of thicknesses below which strips and corners are one strip; thicker ones are bodies.
    """
    bend: float = 0.5
    """Distance of the ends of two strips along the outer side of a corner below which it is a bend.
    """
    round_end: float = 1.01
    """Bulge of an arc below which it closes a strip without a body there; half a circle has 1."""
    cut: float = 0.4
    """Length by which a strip is cut short at a bend, for the body there."""


_RULES = _StripRules()


class _Strip(NamedTuple):
    """A straight strip."""

    sides: Sides
    """Its sides."""
    frame: NeckFrame
    """Its middle, and its direction, which is that of the right side."""
    length: float
    """Length in which both sides face each other [m]."""
    thickness: float
    """Thickness [m]."""
    off: float
    """Largest distance of its sides from parallels [m]."""

    @property
    def key(self) -> frozenset[tuple[int, int]]:
        """Contour and piece of both sides."""
        return frozenset((p.contour, p.stroke) for p in (self.sides.right, self.sides.left))

    def end(self, ahead: bool, across: float = 0.0) -> Pair:
        """Return a point at one end, to the left of its middle line [m]."""
        return self.frame.plane(0.5 * self.length * (1.0 if ahead else -1.0), across)

    def shortened(self, ahead: bool, by: float) -> "_Strip":
        """Return the strip with one end nearer to the other [m]."""
        middle = self.frame.plane(-0.5 * by if ahead else 0.5 * by, 0.0)
        frame = NeckFrame(middle, self.frame.direction)
        return self._replace(frame=frame, length=self.length - by)


def strips_of(part: DrawnPart, thin_place: Pass, limit: float | None) -> list[Neck]:
    """Return the strip at a thin place as leaves, one for each straight part between corners.

    None of them is thicker than `limit` [m]. There are none where the sides are not straight and
    parallel.
    """
    first = _first_strip(settled_sides(part, thin_place), thin_place.thickness)
    if first is None:
        return []
    turned = _strip(first.sides.turned())
    assert turned is not None
    visited = {first.key}
    ahead = list(_following(first, limit, visited))
    behind = [_strip(s.sides.turned()) for s in _following(turned, limit, visited)]
    chain = [*(s for s in reversed(behind) if s is not None), first, *ahead]
    if len(chain) == 1 and first.length < _RULES.alone * first.thickness:
        return []
    for k, (one, other) in enumerate(pairwise(chain)):
        thickness = min(one.thickness, other.thickness)
        if _along_corner(one, other) < _RULES.bend * thickness:
            chain[k] = chain[k].shortened(True, _RULES.cut * thickness)
            chain[k + 1] = other.shortened(False, _RULES.cut * thickness)
    return [_leaf(strip, thin_place) for strip in chain]


def _first_strip(sides: Sides, thickness: float) -> _Strip | None:
    """Return the strip at a thin place, or the one next to the bend that is there."""
    onward = _strip(sides)
    if onward is not None:
        return onward if onward.off <= sides.part.tolerance else None
    # the sides of a bend curve the same way, those of a notch do not
    if sides.stroke(False).curve.bulge * sides.stroke(True).curve.bulge >= 0.0:
        return None
    for trial in (*_pairs_ahead(sides), *(s.turned() for s in _pairs_ahead(sides.turned()))):
        onward = _strip(trial)
        if onward is None or onward.off > sides.part.tolerance:
            continue
        near = math.dist(onward.frame.at, sides.right.at) - 0.5 * onward.length
        if near <= _RULES.corner * thickness and onward.thickness < _RULES.uneven * thickness:
            return onward
    return None


def _leaf(strip: _Strip, thin_place: Pass) -> Neck:
    x, y = (rounded(c, strip.off) for c in strip.frame.at)
    leaf = Leaf(
        neck_thickness=rounded(strip.thickness, strip.off),
        leaf_length=rounded(strip.length, strip.off),
        notch_depth=0.0,
    )
    frame = NeckFrame((x, y), strip.frame.direction)
    return Neck(strip.sides, frame, leaf, strip.off, thin_place)


def _strip(sides: Sides) -> _Strip | None:
    """Return the strip between two pieces; None if they are not parallel sides of one."""
    strokes = sides.stroke(False), sides.stroke(True)
    if any(s.curve.bulge or s.trace for s in strokes):
        return None
    right, left = (s.curve for s in strokes)
    (ax, ay), (bx, by) = right.direction(0.0), left.direction(0.0)
    if abs(ax * by - ay * bx) > PARALLEL or ax * bx + ay * by > 0.0:
        return None
    wa, wb = right.length, left.length
    direction = math.atan2(wa * ay - wb * by, wa * ax - wb * bx)
    frame = NeckFrame(right.start, direction)
    ends = frame.local(np.array([*right[:2], left.end, left.start]))
    low, high = float(max(ends[0, 0], ends[2, 0])), float(min(ends[1, 0], ends[3, 0]))
    if low >= high:
        return None
    # both sides at both ends of the part in which they face each other
    across = [np.interp([low, high], ends[k : k + 2, 0], ends[k : k + 2, 1]) for k in (0, 2)]
    bottom, top = (float(np.mean(a)) for a in across)
    if top <= bottom:
        return None
    off = max(float(np.ptp(a)) for a in across) * 0.5
    middle = frame.plane(0.5 * (low + high), 0.5 * (bottom + top))
    return _Strip(sides, NeckFrame(middle, direction), high - low, top - bottom, off)


def _following(
    strip: _Strip, limit: float | None, visited: set[frozenset[tuple[int, int]]]
) -> Iterator[_Strip]:
    """Yield the strips that follow ahead, around corners."""
    following = _next(strip, limit)
    while following is not None and following.key not in visited:
        visited.add(following.key)
        yield following
        following = _next(following, limit)


def _next(strip: _Strip, limit: float | None) -> _Strip | None:
    """Return the next strip ahead, around the nearest corner."""
    for sides in _pairs_ahead(strip.sides):
        onward = _strip(sides)
        if onward is not None and _continues(strip, onward, limit):
            return onward
    return None


def _pairs_ahead(sides: Sides) -> Iterator[Sides]:
    """Yield pairs of pieces ahead on both sides, the nearest first."""
    steps = range(1, _RULES.pieces + 1)
    for i, j in sorted(((i, j) for i in steps for j in steps), key=sum):
        part = sides.part
        yield Sides(part, _moved(part, sides.right, i), _moved(part, sides.left, -j))


def _moved(part: DrawnPart, place: Place, by: int) -> Place:
    """Return the middle of a piece so many pieces further."""
    strokes = part.contours[place.contour].strokes
    stroke = (place.stroke + by) % len(strokes)
    return Place(place.contour, stroke, 0.5, strokes[stroke].curve.point(0.5))


def _continues(strip: _Strip, onward: _Strip, limit: float | None) -> bool:
    """Return whether a strip continues around a corner as another one."""
    thin, thick = sorted((strip.thickness, onward.thickness))
    turn = math.remainder(onward.frame.direction - strip.frame.direction, 2.0 * math.pi)
    return (
        onward.off <= onward.sides.part.tolerance
        and onward.length >= _RULES.shortest * onward.thickness
        and thick < _RULES.uneven * thin
        and (limit is None or onward.thickness <= 1.05 * limit)
        and abs(turn) > PARALLEL
        and math.dist(strip.end(True), onward.end(False)) <= _RULES.corner * thick
        and not _is_free(onward.sides)
        and _mean_thickness(strip, onward) < _RULES.uneven * thick
    )


def _is_free(sides: Sides) -> bool:
    """Return whether one line, or an arc up to half a circle, closes a strip ahead."""
    contour, stroke = _moved(sides.part, sides.right, 1)[:2]
    if (contour, stroke) != _moved(sides.part, sides.left, -1)[:2]:
        return False
    return sides.part.contours[contour].strokes[stroke].curve.bulge < _RULES.round_end


def _mean_thickness(strip: _Strip, onward: _Strip) -> float:
    """Return area over length of the corner between two strips [m]."""
    half, other = 0.5 * strip.thickness, 0.5 * onward.thickness
    contours, (before, after) = strip.sides.part.contours, (strip.sides, onward.sides)
    right = _path(
        contours[before.right.contour],
        (before.right.stroke, after.right.stroke),
        (strip.end(True, -half), onward.end(False, -other)),
    )
    left = _path(
        contours[before.left.contour],
        (after.left.stroke, before.left.stroke),
        (onward.end(False, other), strip.end(True, half)),
    )
    loop = [*right, Curve(right[-1].end, left[0].start), *left]
    area = Loop(tuple(c.start for c in loop), tuple(c.bulge for c in loop)).integrals().area
    sides = sum(c.length for c in (*right, *left))
    return 2.0 * area / sides if sides > 0.0 else math.inf


def _path(contour: DrawnContour, strokes: tuple[int, int], ends: tuple[Pair, Pair]) -> list[Curve]:
    """Return the way along a contour from a point on one piece to a point on another."""
    first, last = strokes
    curves = [s.curve for s in contour.strokes]
    count = (last - first - 1) % len(curves)
    between = [curves[(first + 1 + k) % len(curves)] for k in range(count)]
    return [
        Curve(ends[0], curves[first].end),
        *between,
        Curve(curves[last].start, ends[1]),
    ]


def _along_corner(one: _Strip, other: _Strip) -> float:
    """Return the distance between the ends of two strips along the outer side of a corner [m]."""
    half, after = 0.5 * one.thickness, 0.5 * other.thickness
    return max(math.dist(one.end(True, s * half), other.end(False, s * after)) for s in (-1, 1))
