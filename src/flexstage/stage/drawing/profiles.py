"""Profiles of necks: by their own lines and arcs first, then by a fit, else as drawn.

A proposed profile is compared with the drawing, and accepted if it is within `DrawnPart.tolerance`
throughout.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, fields, replace
from typing import Any, NamedTuple

import numpy as np

from flexstage.base.errors import HingeError
from flexstage.hinges import AsDrawn, CornerFilleted, Leaf, Profile, RightCircular, VFillet
from flexstage.stage.curve import Curve
from flexstage.stage.drawing.contours import DrawnPart
from flexstage.stage.drawing.free_contour import free_contour
from flexstage.stage.drawing.notch import (
    LEAF_STEP,
    PARALLEL,
    NeckFrame,
    Sides,
    deepens_beyond_root,
    distance_from,
    slope_at,
)
from flexstage.stage.drawing.smooth_fit import smooth_fits
from flexstage.stage.drawing.strokes import SAME, DrawnStroke, Pair, rounded
from flexstage.stage.drawing.thickness import Pass, Place
from flexstage.stage.outline import arc


@dataclass(frozen=True, slots=True)
class _PieceRules:
    """Limits for a notch of lines and arcs, and the rounding of its dimensions."""

    tangent: float = 2e-3
    """A corner that turns less is none [rad]."""
    as_near: float = 1.3
    """Factor by which rounding may increase the distance from the drawing [1]."""
    nothing: float = 1e-12
    """Distance from the drawing below which nothing is rounded [m]."""
    exact: float = 10e-9
    """Distance from the drawing below which no other profile is tried [m]."""
    digits: tuple[int, ...] = (6, 7, 8, 9)
    """Decimals of a length in metres that are tried for a dimension."""
    share: float = 0.45
    """Part of an edge between two leaves for the step of each."""


_RULES = _PieceRules()

_ENDS = ((False, False), (False, True), (True, False), (True, True))  # left, ahead


class Neck(NamedTuple):
    """A neck with its profile."""

    sides: Sides
    """The contours on both sides; its direction is that of the contour on the right."""
    frame: NeckFrame
    """Centre and direction."""
    profile: Profile
    """Profile."""
    off: float
    """Largest distance of the drawn contour from the profile [m]."""
    thin_place: Pass
    """Thin place."""


def neck_of(part: DrawnPart, thin_place: Pass) -> Neck | None:
    """Return the neck at a thin place; None where it matches no hinge profile."""
    sides = settled_sides(part, thin_place)
    for proposed in (_by_pieces, smooth_fits, free_contour):
        best: Neck | None = None
        for turned, frame, profile in proposed(sides):
            off = distance_from(profile, turned, frame)
            if off > part.tolerance or (best is not None and off >= 0.5 * best.off):
                continue
            if profile.kind == AsDrawn.kind or not deepens_beyond_root(profile, turned, frame):
                best = Neck(turned, frame, profile, off, thin_place)
                if off < _RULES.exact:
                    break
        if best is not None:
            return _rounded(best)
    return None


def settled_sides(part: DrawnPart, thin_place: Pass) -> Sides:
    """Return the sides of a thin place, by the pieces of its contours that run along it."""
    first, second = thin_place.sides
    return Sides(part, _settled(part, first, second.at), _settled(part, second, first.at))


def _rounded(neck: Neck) -> Neck:
    """Return a neck with the roundest position and dimensions within the tolerance."""
    if neck.off < _RULES.nothing:
        return neck
    room = _RULES.as_near * neck.off
    x, y = (rounded(c, neck.off) for c in neck.frame.at)
    degrees = math.degrees(neck.frame.direction)
    lean = math.radians(abs(degrees - round(degrees))) * neck.profile.length
    direction = math.radians(round(degrees)) if lean < neck.off else neck.frame.direction
    for frame in (NeckFrame((x, y), direction), NeckFrame((x, y), neck.frame.direction)):
        off = distance_from(neck.profile, neck.sides, frame)
        if off <= room:
            neck = neck._replace(frame=frame, off=off)
            break
    if neck.profile.kind == AsDrawn.kind:
        return neck
    sizes: dict[str, Any] = {f.name: getattr(neck.profile, f.name) for f in fields(neck.profile)}
    for digits in _RULES.digits:
        round_sizes: dict[str, Any] = {
            # an exponent, a pure number, is of the order of a length in millimetres
            name: round(v, digits - 4 * (name == "exponent")) if isinstance(v, float) else v
            for name, v in sizes.items()
        }
        try:
            profile = type(neck.profile)(**round_sizes)
        except HingeError:
            continue
        off = distance_from(profile, neck.sides, neck.frame)
        # a straight flank is as near however long it is: where it ends counts as well
        ends = max(
            abs(profile.length - neck.profile.length), abs(profile.depth - neck.profile.depth)
        )
        if off <= room and ends <= max(room, SAME):
            return neck._replace(profile=profile, off=off)
    return neck


def parted(necks: Sequence[Neck]) -> list[Neck]:
    """Return necks, with adjacent leaves that share the edge between them."""
    claims: dict[tuple[int, int], list[int]] = {}
    for n, neck in enumerate(necks):
        for key in _step_strokes(neck):
            claims.setdefault(key, []).append(n)
    out = list(necks)
    for (contour, stroke), neighbours in claims.items():
        if len(neighbours) > 1:
            curve = out[neighbours[0]].sides.part.contours[contour].strokes[stroke].curve
            for n in neighbours:
                leaf = out[n].profile
                assert isinstance(leaf, Leaf)
                depth = min(leaf.notch_depth, rounded(_RULES.share * curve.length))
                out[n] = out[n]._replace(profile=replace(leaf, notch_depth=depth))
    return out


def _step_strokes(neck: Neck) -> Iterator[tuple[int, int]]:
    """Yield contour and piece of the edges at the ends of a leaf."""
    if not isinstance(neck.profile, Leaf):
        return
    for left, ahead in _ENDS:
        if neck.profile.one_sided and not left:
            continue
        place = neck.sides.left if left else neck.sides.right
        count = len(neck.sides.part.contours[place.contour].strokes)
        yield place.contour, (place.stroke + (1 if ahead != left else -1)) % count


def _settled(part: DrawnPart, place: Place, other: Pair) -> Place:
    """Choose between the two pieces that meet at a place: the one more square to the neck."""
    strokes = part.contours[place.contour].strokes
    count = len(strokes)
    near = [place.stroke]
    size = strokes[place.stroke].curve.length
    slack = 0.3 * math.dist(place.at, other)
    if place.share * size < slack:
        near.append((place.stroke - 1) % count)
    if (1.0 - place.share) * size < slack:
        near.append((place.stroke + 1) % count)

    def lean(k: int) -> float:
        curve = strokes[k].curve
        here = curve.share(place.at)
        if here is None:
            ends = (math.dist(place.at, curve.start), math.dist(place.at, curve.end))
            here = 0.0 if ends[0] < ends[1] else 1.0
        ux, uy = curve.direction(here)
        dx, dy = other[0] - place.at[0], other[1] - place.at[1]
        return round(abs(ux * dx + uy * dy) / math.hypot(dx, dy), 2)

    # of smooth continuations the straight one, on which a leaf is flat
    best = min(near, key=lambda k: (lean(k), bool(strokes[k].curve.bulge)))
    return place._replace(stroke=best)


Proposal = tuple[Sides, NeckFrame, Profile]


def _by_pieces(sides: Sides) -> Iterator[Proposal]:
    """Propose profiles of lines and arcs by the pieces at the neck and those that follow."""
    right, left = sides.stroke(False).curve, sides.stroke(True).curve
    try:
        if right.bulge < 0.0 and left.bulge < 0.0:
            yield from _two_arcs(sides, right, left)
        elif right.bulge == 0.0 and left.bulge < 0.0:
            yield from _arc_and_line(sides, right, left)
        elif right.bulge < 0.0 and left.bulge == 0.0:
            yield from _arc_and_line(sides.turned(), left, right)
        elif not right.bulge and not left.bulge:
            yield from _two_lines(sides, right, left)
    except HingeError:
        return  # dimensions that no notch of this kind has


def _two_arcs(sides: Sides, right: Curve, left: Curve) -> Iterator[Proposal]:
    (cr, rr, _, _), (cl, rl, _, _) = arc(*right), arc(*left)
    if abs(rr - rl) > sides.part.tolerance:
        return
    apart = math.dist(cr, cl)
    radius, neck = 0.5 * (rr + rl), apart - rr - rl
    if neck <= 0.0:
        return
    across = ((cl[0] - cr[0]) / apart, (cl[1] - cr[1]) / apart)
    at = (0.5 * (cr[0] + cl[0]), 0.5 * (cr[1] + cl[1]))
    frame = NeckFrame(at, math.atan2(-across[0], across[1]))
    yield from _round(sides, frame, radius, neck, False, _ENDS)


def _arc_and_line(sides: Sides, line: Curve, bow: Curve) -> Iterator[Proposal]:
    """The notch is on the left, cut into it by an arc; the line is on the right."""
    centre, radius, _, _ = arc(*bow)
    ux, uy = line.direction(0.0)
    away = (centre[0] - line.start[0]) * -uy + (centre[1] - line.start[1]) * ux
    neck = away - radius
    if neck <= 0.0:
        return
    at = (centre[0] + uy * (away - 0.5 * neck), centre[1] - ux * (away - 0.5 * neck))
    frame = NeckFrame(at, math.atan2(uy, ux))
    yield from _round(sides, frame, radius, neck, True, _ENDS[2:])


def _round(
    sides: Sides,
    frame: NeckFrame,
    radius: float,
    neck: float,
    one_sided: bool,
    ends: tuple[tuple[bool, bool], ...],
) -> Iterator[Proposal]:
    """Propose half circles, or arcs that run out into flanks."""
    turns, flanks, leans = [], [], []
    for left, ahead in ends:
        walked = list(_first(sides, left, ahead, 2))
        slope = slope_at(walked[0].curve, frame, left, ahead, 1.0)
        # a slope beyond upright reads as one that comes back
        turns.append(slope if slope >= 0.0 else slope + 2.0 * math.pi)
        following = walked[1].curve if len(walked) > 1 else None
        straight = following is not None and not following.bulge
        lean = slope_at(following, frame, left, ahead, 0.0) if straight and following else 0.0
        tangent = straight and abs(lean - turns[-1]) < max(_RULES.tangent, 0.1 * turns[-1])
        flanks.append(following.length if tangent and following else 0.0)
        leans.append(lean)
    common = {"neck_thickness": rounded(neck), "one_sided": one_sided}
    if min(turns) >= 0.5 * math.pi - sides.part.tolerance / radius:
        yield sides, frame, RightCircular(radius=rounded(radius), **common)
        return
    shallow = min(turns)
    if min(flanks) > 0.0:
        shallow = sum(leans) / len(leans)
    bow = radius * (1.0 - math.cos(shallow))
    depth = bow + min(flanks) * math.sin(shallow)
    if shallow > 0.05:
        yield (
            sides,
            frame,
            VFillet(
                half_opening_angle=rounded(0.5 * math.pi - shallow),
                fillet_radius=rounded(radius),
                notch_depth=rounded(depth) if min(flanks) > 0.0 else depth * (1.0 + 1e-9),
                **common,
            ),
        )


class _End(NamedTuple):
    """One end of the flat part of a side."""

    x: float  # where it ends, from the place of the pass, towards its end of the hinge [m]
    kind: str  # "fillet", "step" or "other"
    size: float  # radius of the fillet, or height of the step [m]


def _two_lines(sides: Sides, right: Curve, left: Curve) -> Iterator[Proposal]:
    (ax, ay), (bx, by) = right.direction(0.0), left.direction(0.0)
    if abs(ax * by - ay * bx) > PARALLEL or ax * bx + ay * by > 0.0:
        return
    # the mean direction, the longer side counting more
    wa, wb = right.length, left.length
    direction = math.atan2(wa * ay - wb * by, wa * ax - wb * bx)
    c, s = math.cos(direction), math.sin(direction)
    origin = sides.right.at
    ends = {}
    for side, ahead in _ENDS:
        ends[side, ahead] = _flat_end(sides, NeckFrame(origin, direction), side, ahead)
    x = {ahead: min(ends[False, ahead].x, ends[True, ahead].x) for ahead in (False, True)}
    centre = 0.5 * (x[True] - x[False])
    flat = x[True] + x[False]
    if flat <= 0.0:
        return

    def across(curve: Curve) -> float:
        middle = curve.point(0.5)
        tilt = (middle[0] - origin[0]) * c + (middle[1] - origin[1]) * s - centre
        off = (middle[1] - origin[1]) * c - (middle[0] - origin[0]) * s
        ux, uy = curve.direction(0.0)
        return off - tilt * (uy * c - ux * s) / (ux * c + uy * s)

    low, high = across(right), across(left)
    neck = high - low
    if neck <= 0.0:
        return
    middle = 0.5 * (low + high)
    frame = NeckFrame(NeckFrame(origin, direction).plane(centre, middle), direction)
    deep = {
        key: end.kind != "other" and end.x < x[key[1]] + 2.0 * sides.part.tolerance
        for key, end in ends.items()
    }
    if all(deep.values()):
        yield from _flat(sides, frame, neck, flat, list(ends.values()), False)
    elif deep[True, False] and deep[True, True] and not (deep[False, False] or deep[False, True]):
        cut = [ends[True, False], ends[True, True]]
        yield from _flat(sides, frame, neck, flat, cut, True)
    elif deep[False, False] and deep[False, True] and not (deep[True, False] or deep[True, True]):
        cut = [ends[False, False], ends[False, True]]
        yield from _flat(sides.turned(), frame.turned(), neck, flat, cut, True)


def _flat(
    sides: Sides, frame: NeckFrame, neck: float, flat: float, ends: list[_End], one_sided: bool
) -> Iterator[Proposal]:
    kinds = {end.kind for end in ends}
    sizes = [end.size for end in ends]
    common = {"neck_thickness": rounded(neck), "one_sided": one_sided}
    if kinds == {"fillet"}:
        radius = sum(sizes) / len(sizes)
        length = rounded(flat + 2.0 * radius)
        fillet = min(rounded(radius), 0.5 * length)
        yield sides, frame, CornerFilleted(notch_length=length, fillet_radius=fillet, **common)
    elif kinds == {"step"}:
        # a leaf between wide bodies: as deep as the shortest edge, or so deep that more makes no
        # difference
        depth = min(*sizes, LEAF_STEP * neck)
        yield sides, frame, Leaf(leaf_length=rounded(flat), notch_depth=rounded(depth), **common)


def _flat_end(sides: Sides, frame: NeckFrame, left: bool, ahead: bool) -> _End:
    """Return the end of the flat part of a side, and the piece after it."""
    walked = list(_first(sides, left, ahead, 2))
    end = walked[0].curve.end
    x = float(frame.local(np.array([end]))[0, 0]) * (1.0 if ahead else -1.0)
    if len(walked) < 2:
        return _End(x, "other", 0.0)
    following = walked[1].curve
    start = slope_at(following, frame, left, ahead, 0.0)
    if following.bulge:
        stop = slope_at(following, frame, left, ahead, 1.0)
        upright = stop if stop > 0.0 else stop + 2.0 * math.pi
        radius = abs(following.radius)
        smooth = abs(start) < max(_RULES.tangent, math.sqrt(2.0 * sides.part.tolerance / radius))
        round_enough = upright >= 0.5 * math.pi - max(sides.part.tolerance / radius, 1e-6)
        turns_out = slope_at(following, frame, left, ahead, 0.5) > 0.0
        if smooth and turns_out and round_enough:
            # the centre of the fillet says where it begins, to the last digit
            centre = arc(*following)[0]
            x = float(frame.local(np.array([centre]))[0, 0]) * (1.0 if ahead else -1.0)
            return _End(x, "fillet", radius)
        return _End(x, "other", 0.0)
    if abs(start - 0.5 * math.pi) * following.length < 2.0 * sides.part.tolerance:
        return _End(x, "step", following.length)
    return _End(x, "other", 0.0)


def _first(sides: Sides, left: bool, ahead: bool, count: int) -> Iterator[DrawnStroke]:
    for k, stroke in enumerate(sides.walk(left, ahead)):
        if k == count:
            return
        yield stroke
