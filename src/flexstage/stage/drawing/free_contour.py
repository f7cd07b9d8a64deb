"""The contour of a neck as drawn, where no formula fits it."""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from flexstage.base.arrays import Array
from flexstage.base.errors import HingeError
from flexstage.hinges import AsDrawn, Profile
from flexstage.stage.curve import Curve
from flexstage.stage.drawing.notch import (
    LEAF_STEP,
    PARALLEL,
    NeckFrame,
    Sides,
    quarter,
    slope_at,
)
from flexstage.stage.drawing.smooth_fit import chains_of, nearest_frame
from flexstage.stage.drawing.strokes import DrawnStroke, rounded
from flexstage.stage.outline import arc


@dataclass(frozen=True, slots=True)
class _FreeRules:
    """Limits by which a contour counts as that of a notch."""

    back: float = 0.15
    """A side comes back where its slope is below level, or beyond upright, by more [rad]."""
    level: float = 2e-3
    """A side that rises less runs along the hinge [rad]."""
    chord: float = 1e-9
    """Largest distance of chords between points on arcs from these [m]."""
    compared: tuple[float, ...] = (0.1, 0.25, 0.5, 0.75, 0.95)
    """Depths at which the sides are compared, relative to the depth of all of them."""
    least_depth: float = 0.1
    """A notch is at least so deep, in thicknesses of its neck."""
    most: int = 400
    """Most pieces of one side."""


_RULES = _FreeRules()


def free_contour(sides: Sides) -> Iterator[tuple[Sides, NeckFrame, Profile]]:
    """Propose the contour itself if both halves are equal, and both sides or one straight."""
    straight = [
        not sides.stroke(left).curve.bulge and not sides.stroke(left).trace
        for left in (False, True)
    ]
    trials: list[tuple[Sides, bool]] = [(sides, False)]
    if straight[0]:
        trials.append((sides, True))
    if straight[1]:
        trials.append((sides.turned(), True))
    for turned, one_sided in trials:
        frame = _first_frame(turned)
        if frame is None:
            continue
        runs = {
            (left, ahead): _run(turned, frame, left, ahead)
            for left in ((True,) if one_sided else (False, True))
            for ahead in (False, True)
        }
        if any(len(run) == 0 for run in runs.values()):
            continue
        placed = _settled(turned, frame, runs, one_sided)
        if placed is None:
            continue
        try:
            profile = _profile(*placed, runs, one_sided)
        except HingeError:
            continue
        if profile is not None:
            yield turned, placed[0], profile


def _first_frame(sides: Sides) -> NeckFrame | None:
    """Return the axes by the pieces at the neck, or else by the nearest points."""
    right, left = sides.stroke(False).curve, sides.stroke(True).curve
    (ax, ay), (bx, by) = right.direction(0.5), left.direction(0.5)
    if not right.bulge and not left.bulge:
        if abs(ax * by - ay * bx) < PARALLEL:
            wa, wb = right.length, left.length
            frame = NeckFrame(right.start, math.atan2(wa * ay - wb * by, wa * ax - wb * bx))
            ends = frame.local(np.array([*right[:2], *left[:2]]))
            low = max(min(ends[0, 0], ends[1, 0]), min(ends[2, 0], ends[3, 0]))
            high = min(max(ends[0, 0], ends[1, 0]), max(ends[2, 0], ends[3, 0]))
            x, y = 0.5 * float(low + high), 0.5 * float(np.mean(ends[2:, 1]) + np.mean(ends[:2, 1]))
            return NeckFrame(frame.plane(x, y), frame.direction)
    elif right.bulge < 0.0 and left.bulge < 0.0:
        cr, cl = arc(*right)[0], arc(*left)[0]
        p, q = _towards(right, cl), _towards(left, cr)
        at = (0.5 * (p[0] + q[0]), 0.5 * (p[1] + q[1]))
        return NeckFrame(at, math.atan2(-(cl[0] - cr[0]), cl[1] - cr[1]))
    elif not right.bulge and left.bulge < 0.0:
        return NeckFrame(sides.right.at, math.atan2(ay, ax))
    nearest = nearest_frame(chains_of(sides))
    return None if nearest is None else nearest[0]


def _towards(curve: Curve, point: tuple[float, float]) -> tuple[float, float]:
    (x, y), radius, _, _ = arc(*curve)
    apart = math.dist((x, y), point)
    return (x + radius * (point[0] - x) / apart, y + radius * (point[1] - y) / apart)


def _run(sides: Sides, frame: NeckFrame, left: bool, ahead: bool) -> list[DrawnStroke]:
    """Return the pieces of a side outward, as long as they lead away and get deeper."""
    run: list[DrawnStroke] = []
    for k, stroke in enumerate(sides.walk(left, ahead)):
        slopes = [slope_at(stroke.curve, frame, left, ahead, s) for s in (0.0, 1.0)]
        back, upright = -_RULES.back, 0.5 * math.pi + _RULES.back
        if len(run) > _RULES.most or (k and not all(back < s < upright for s in slopes)):
            break
        run.append(stroke)
    return run


def _settled(
    sides: Sides,
    frame: NeckFrame,
    runs: dict[tuple[bool, bool], list[DrawnStroke]],
    one_sided: bool,
) -> tuple[NeckFrame, float] | None:
    """Return the axes of best symmetry of both halves and both sides, and the thickness."""
    from scipy.optimize import least_squares

    points = {
        key: np.array([p for s in run for p in s.points(_RULES.chord)]) for key, run in runs.items()
    }
    line = sides.stroke(False).curve
    size = max(math.dist(sides.right.at, sides.left.at), 1e-9)

    def moved(q: Any) -> NeckFrame:
        x, y = size * float(q[0]), size * float(q[1]) if len(q) > 2 else 0.0
        turn = float(q[-1]) if len(q) > 1 else 0.0
        return NeckFrame(frame.plane(x, y), frame.direction + turn)

    def heights(trial: NeckFrame) -> tuple[float, float]:
        """Return the heights at which the two sides are nearest to each other, across the hinge."""
        low = float(np.min(_across(points, trial, True)))
        if one_sided:
            high = float(trial.local(np.array([line.point(0.5)]))[0, 1])
        else:
            high = float(np.max(_across(points, trial, False)))
        return low, high

    def residual(q: Any) -> Array:
        trial = moved(q)
        low, high = heights(trial)
        half = 0.5 * (low - high)
        centre = 0.5 * (low + high)
        reached = {}
        for key, p in points.items():
            at = quarter(trial, 0.0, p, *key)
            depth = at[:, 1] - half - (centre if key[0] else -centre)
            keep = at[:, 0] > 0.0
            reached[key] = (at[keep, 0], np.maximum.accumulate(np.maximum(depth[keep], 0.0)))
        deepest = min(float(np.max(d, initial=0.0)) for _, d in reached.values())
        levels = deepest * np.array(_RULES.compared)
        rows = [np.interp(levels, d, x) if len(d) else levels for x, d in reached.values()]
        return ((np.array(rows[1:]) - rows[0]) / size).ravel()

    start = [0.0] if one_sided else [0.0, 0.0]
    fit = least_squares(residual, start, diff_step=1e-5, max_nfev=60, xtol=1e-12)
    placed = moved(fit.x)
    low, high = heights(placed)
    at = placed.plane(0.0, 0.5 * (low + high))
    return (NeckFrame(at, placed.direction), low - high) if low > high else None


def _across(points: dict[tuple[bool, bool], Array], frame: NeckFrame, left: bool) -> Array:
    return np.concatenate([frame.local(p)[:, 1] for (side, _), p in points.items() if side is left])


def _profile(
    frame: NeckFrame,
    neck: float,
    runs: dict[tuple[bool, bool], list[DrawnStroke]],
    one_sided: bool,
) -> Profile | None:
    """Return the contour of one quarter, as far as all quarters agree."""
    half = 0.5 * neck
    corners = {key: _corners(frame, half, run, key) for key, run in runs.items()}
    if any(len(c) < 2 for c in corners.values()):
        return None
    reach = min(c[-1][0] for c in corners.values())
    # the shortest one is the reference: the others are longer
    key = min(corners, key=lambda k: (corners[k][-1][0] > reach + 1e-6, corners[k][-1][1]))
    shortest = corners[key]
    (x0, d0, _), (x1, d1, bulge) = shortest[-2:]
    if not bulge and x1 - x0 < _RULES.level * (d1 - d0):
        # an edge of the body, or of a leaf between sharp corners
        if d0 > _RULES.least_depth * neck:
            shortest = shortest[:-1]
        else:
            shortest[-1] = (x1, d0 + min(d1 - d0, LEAF_STEP * neck), 0.0)
    if shortest[-1][1] < _RULES.least_depth * neck:
        return None
    return AsDrawn(
        neck_thickness=rounded(neck),
        one_sided=one_sided,
        distances=tuple(rounded(x) for x, _, _ in shortest[1:]),
        depths=tuple(rounded(max(d, 0.0)) for _, d, _ in shortest[1:]),
        bulges=tuple(round(b, 12) + 0.0 for _, _, b in shortest[1:]),
    )


def _corners(
    frame: NeckFrame, half: float, run: list[DrawnStroke], key: tuple[bool, bool]
) -> list[tuple[float, float, float]]:
    """Return distance and depth of the corners of a quarter, and the bulge before each."""
    left, ahead = key
    out = [(0.0, 0.0, 0.0)]
    # seen from the neck outward, a side on the right to body b, or on the left to a, is mirrored
    mirrored = 1.0 if left == ahead else -1.0
    for stroke in run:
        curve = _from_neck(stroke.curve, frame, left, ahead)
        if curve is None:
            continue
        first, last = (slope_at(curve, frame, left, ahead, s) for s in (0.0, 1.0))
        level = _RULES.level
        if min(first, last) < -level or max(first, last) > 0.5 * math.pi + level:
            break
        x, depth = quarter(frame, half, np.array([curve.end]), left, ahead)[0].tolist()
        along = abs(first) < level and abs(last) < level
        if along and depth > _RULES.least_depth * half:
            break  # the side of a bar that the notch is cut into
        if x - out[-1][0] > 1e-9 or depth - out[-1][1] > 1e-9:
            out.append((x, depth, mirrored * curve.bulge))
    return out


def _from_neck(curve: Curve, frame: NeckFrame, left: bool, ahead: bool) -> Curve | None:
    """Return the part of a piece that lies ahead of the neck."""
    c, s = math.cos(frame.direction), math.sin(frame.direction)

    def along(share: float) -> float:
        x, y = curve.point(share)
        value = (x - frame.at[0]) * c + (y - frame.at[1]) * s
        return value if ahead else -value

    if along(0.0) >= -1e-9:
        return curve
    if along(1.0) <= 1e-9:
        return None
    low, high = 0.0, 1.0
    for _ in range(60):
        middle = 0.5 * (low + high)
        low, high = (low, middle) if along(middle) > 0.0 else (middle, high)
    return curve.part(high, 1.0)
