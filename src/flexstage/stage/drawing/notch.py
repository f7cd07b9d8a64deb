"""The two sides of a neck in its own axes, and the distance of a profile from the drawing."""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from flexstage.base.arrays import Array
from flexstage.hinges import Profile
from flexstage.stage.curve import Curve
from flexstage.stage.drawing.contours import DrawnPart
from flexstage.stage.drawing.strokes import ARCS, DrawnStroke, Pair
from flexstage.stage.drawing.thickness import Place

#: Deepest step of a leaf, in its thicknesses, where the edges of the bodies have room for more.
LEAF_STEP = 4.0
#: Two sides that could be those of a leaf differ by no more in direction (sine).
PARALLEL = 0.02

_CHORD = 2e-6  # points on arcs are so close that chords are off by less [m]
# a contour that continues with such a slope against the hinge gets deeper [rad]
_FLANK = (0.1, 1.3)
_LEVEL = 0.01  # one of less slope runs along the hinge [rad]
_MOST = 4000  # pieces of a contour that one side of a notch may have


class NeckFrame(NamedTuple):
    """The axes of a hinge."""

    at: Pair
    """Centre of the neck [m]."""
    direction: float
    """Direction from body a to body b, from the x axis to the left [rad]."""

    def local(self, points: Array) -> Array:
        """Return points along and across the hinge, shape (n, 2) [m]."""
        c, s = math.cos(self.direction), math.sin(self.direction)
        d = np.asarray(points, dtype=float) - np.array(self.at)
        return np.column_stack([c * d[:, 0] + s * d[:, 1], c * d[:, 1] - s * d[:, 0]])

    def plane(self, along: float, across: float) -> Pair:
        """Return the point of the plane at distances along and across the hinge [m]."""
        c, s = math.cos(self.direction), math.sin(self.direction)
        return self.at[0] + c * along - s * across, self.at[1] + s * along + c * across

    def turned(self) -> "NeckFrame":
        """Return the axes of the same hinge with its bodies exchanged."""
        turn = math.pi if self.direction <= 0.0 else -math.pi
        return NeckFrame(self.at, self.direction + turn)


@dataclass(frozen=True, slots=True)
class Sides:
    """The contours on the right and on the left of a neck."""

    part: DrawnPart
    """The part."""
    right: Place
    """The place on the right; its contour runs from body a to body b."""
    left: Place
    """The place on the left; its contour runs from body b to body a."""

    def turned(self) -> "Sides":
        """Return them seen from the other body."""
        return Sides(self.part, self.left, self.right)

    def walk(self, left: bool, ahead: bool) -> Iterator[DrawnStroke]:
        """Yield the pieces of one side outward from the neck, the one at the neck first, undivided.

        `ahead` is towards body b.
        """
        place = self.left if left else self.right
        strokes = self.part.contours[place.contour].strokes
        count = len(strokes)
        forward = ahead != left
        step = 1 if forward else -1
        for k in range(min(count, _MOST)):
            stroke = strokes[(place.stroke + step * k) % count]
            yield stroke if forward else stroke.reversed()

    def stroke(self, left: bool) -> DrawnStroke:
        """The piece at the neck, in the direction of its contour."""
        place = self.left if left else self.right
        return self.part.contours[place.contour].strokes[place.stroke]


def quarter(frame: NeckFrame, half_neck: float, points: Array, left: bool, ahead: bool) -> Array:
    """Return points of a side as distance from the neck and depth, shape (n, 2) [m]."""
    local = frame.local(points)
    along = local[:, 0] if ahead else -local[:, 0]
    across = local[:, 1] if left else -local[:, 1]
    return np.column_stack([along, across - half_neck])


def quarters(
    sides: Sides, frame: NeckFrame, half_neck: float, reach: float, deep: float
) -> dict[tuple[bool, bool], Array]:
    """Return the drawn contour on each side to each end, as distance from the neck and depth [m].

    Each runs until it is further along the hinge than `reach`, or deeper than `deep`, as points on
    the drawn contour; the key says whether it is on the left, and whether towards body b.
    """
    out = {}
    for left in (False, True):
        for ahead in (False, True):
            quarter_points: list[Array] = []
            for stroke in sides.walk(left, ahead):
                points = np.array(stroke.points(_CHORD))
                quarter_points.append(quarter(frame, half_neck, points, left, ahead))
                if quarter_points[-1][-1, 0] > reach or quarter_points[-1][-1, 1] > deep:
                    break
            out[left, ahead] = np.vstack(quarter_points)
    return out


def distance_from(profile: Profile, sides: Sides, frame: NeckFrame) -> float:
    """Return the largest distance of the drawing from a profile [m]; infinite if it ends short.

    What lies beyond the root of the profile does not count.
    """
    half, neck = 0.5 * profile.length, 0.5 * profile.neck_thickness
    slack = 2.0 * sides.part.tolerance
    worst = 0.0
    if not _lines_follow(profile, sides, frame):
        return math.inf
    quarter_points = quarters(sides, frame, neck, half + slack, profile.depth + slack)
    for (left, _), points in quarter_points.items():
        straight = profile.one_sided and not left
        deep = 0.0 if straight else profile.depth
        x, depth = points.T
        # where it comes to the end of the root, or passes by it: it may come back elsewhere
        arrived = (x >= half - slack) & (depth >= deep - slack)
        gone = (x > half + slack) | ((x > 0.0) & (depth > deep + slack))
        ends = np.flatnonzero(arrived | gone)
        if not len(ends):
            return math.inf
        end = int(ends[0])
        if not arrived[end]:
            # the last piece continues straight beyond the root, which lies on it
            passes = straight and abs(depth[end]) <= slack
            if not (passes or (not straight and profile.step == 0.0 and x[end] >= half - slack)):
                return math.inf
        keep = slice(0, end + 1 if not gone[end] else end)
        within = points[keep][x[keep] >= 0.0]
        off = np.abs(within[:, 1]) if straight else _off_contour(profile, within)
        worst = max(worst, float(np.max(off, initial=0.0)))
    return worst


def _lines_follow(profile: Profile, sides: Sides, frame: NeckFrame) -> bool:
    """Return whether straight lines, as chords of the profile, are near it throughout."""
    half, neck = 0.5 * profile.length, 0.5 * profile.neck_thickness
    slack = sides.part.tolerance
    for left in (True,) if profile.one_sided else (False, True):
        for ahead in (False, True):
            middles = []
            for stroke in sides.walk(left, ahead):
                ends = quarter(frame, neck, np.array(stroke.curve[:2]), left, ahead)
                if not stroke.curve.bulge and not stroke.trace:
                    middles.append(0.5 * (ends[0] + ends[1]))
                if ends[1, 0] > half + slack or ends[1, 1] > profile.depth - slack:
                    break
            if middles:
                at = np.array(middles)
                inside = (at[:, 0] > 0.0) & (at[:, 0] < half - slack) & (at[:, 1] < profile.depth)
                off = _off_contour(profile, at[inside])
                if np.max(off, initial=0.0) > ARCS.chord_error:
                    return False
    return True


def deepens_beyond_root(profile: Profile, sides: Sides, frame: NeckFrame) -> bool:
    """Return whether the drawn contour gets deeper beyond the root, on every side.

    A notch that ends there is only a part of the drawn one.
    """
    half, neck = 0.5 * profile.length, 0.5 * profile.neck_thickness
    end = float(profile.pieces()[-1](np.array([1.0]))[2][0])
    for left in (True,) if profile.one_sided else (False, True):
        for ahead in (False, True):
            slope = _slope_beyond(sides, frame, neck, (half, profile.depth), left, ahead)
            smooth = abs(slope - end) < _FLANK[0] and slope > _LEVEL
            if not (smooth or slope > _FLANK[0]) or slope > _FLANK[1]:
                return False
    return True


def _slope_beyond(
    sides: Sides, frame: NeckFrame, neck: float, root: Pair, left: bool, ahead: bool
) -> float:
    """Return the slope of a side just beyond the end of a root."""
    point = frame.plane(root[0] * (1 if ahead else -1), (neck + root[1]) * (1 if left else -1))
    reached = False
    for stroke in sides.walk(left, ahead):
        curve = stroke.curve
        if reached:
            return slope_at(curve, frame, left, ahead, 0.0)
        if math.dist(curve.end, point) < 2.0 * sides.part.tolerance:
            reached = True
            continue
        share = curve.share(point)
        if share is not None and math.dist(curve.point(share), point) < 2.0 * sides.part.tolerance:
            return slope_at(curve, frame, left, ahead, share)
    return 0.0


@lru_cache(maxsize=512)
def _dense(profile: Profile) -> tuple[Array, Array]:
    """Return points of the contour of one half, and the normals there."""
    points, normals = [], []
    for piece in profile.pieces():
        x, depth, angle, _ = piece(np.linspace(0.0, 1.0, 3000))
        points.append(np.column_stack([x, depth]))
        normals.append(np.column_stack([-np.sin(angle), np.cos(angle)]))
    if profile.step > 0.0:
        depth = np.linspace(profile.depth - profile.step, profile.depth, 200)
        points.append(np.column_stack([np.full_like(depth, 0.5 * profile.length), depth]))
        normals.append(np.tile([1.0, 0.0], (len(depth), 1)))
    return np.vstack(points), np.vstack(normals)


def _off_contour(profile: Profile, points: Array) -> Array:
    from scipy.spatial import KDTree

    if not len(points):
        return np.zeros(0)
    on, normals = _dense(profile)
    away, near = KDTree(on).query(points)
    square = np.abs(np.sum((points - on[near]) * normals[near], axis=1))
    # beyond the ends of the contour the nearest point counts
    ends = np.isin(near, [0, len(on) - 1])
    return np.where(ends, np.minimum(away, np.maximum(square, 0.0)), square)


def slope_at(curve: Curve, frame: NeckFrame, left: bool, ahead: bool, share: float) -> float:
    """Return the slope of a piece against the hinge, in quarters: 0 along it, pi/2 outward."""
    ux, uy = curve.direction(share)
    c, s = math.cos(frame.direction), math.sin(frame.direction)
    along, across = c * ux + s * uy, c * uy - s * ux
    return math.atan2(across if left else -across, along if ahead else -along)
