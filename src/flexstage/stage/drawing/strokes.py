"""Contours as few exact pieces: polylines and splines that approximate arcs become arcs."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from flexstage.base.arrays import Array
from flexstage.stage.curve import Curve
from flexstage.stage.outline import arc

Pair = tuple[float, float]

#: Points, circles or corners closer than this are one [m].
SAME = 1e-9


@dataclass(frozen=True, slots=True)
class ArcRules:
    """Limits by which the corners of a polyline are those of an arc."""

    tolerance: float = 0.2e-6
    """Largest distance of the corners from the arc [m]."""
    tighter: tuple[float, ...] = (2e-9, 20e-9)
    """Tighter ones, tried first, so that an arc does not reach into a smooth continuation [m]."""
    chord_error: float = 25e-6
    """Largest distance of the arc from the chords [m]."""
    sharpest: float = math.radians(50.0)
    """Largest turn between two chords [rad]."""
    fewest: int = 3
    """Fewest chords."""
    uneven: float = math.log(6.0)
    """Logarithm of the ratio by which neighbouring chords differ at most."""
    round_corners: int = 12
    """Fewest corners of a polygon that approximates a circle."""
    curved: float = 50.0
    """Least rise of the arc above its chord, in tolerances."""
    round: float = 1.9 * math.pi
    """Largest turn of one arc [rad]."""


ARCS = ArcRules()


class DrawnStroke(NamedTuple):
    """A piece of a contour, a straight line or an arc, with the material on its left."""

    curve: Curve
    """The line or the arc."""
    trace: tuple[Pair, ...] = ()
    """The corners of the polyline or spline that it replaces [m]; none where it was drawn so.
    """

    def reversed(self) -> "DrawnStroke":
        """Return it run through the other way."""
        c = self.curve
        return DrawnStroke(Curve(c.end, c.start, -c.bulge), self.trace[::-1])

    def points(self, chord: float) -> list[Pair]:
        """Return points on the drawn contour, the ends among them.

        Of an arc that was drawn as one they are so close that chords are off by at most `chord`.
        """
        if self.trace:
            return list(self.trace)
        c = self.curve
        if not c.bulge:
            return [c.start, c.end]
        sweep = 4.0 * abs(math.atan(c.bulge))
        step = 2.0 * math.acos(max(1.0 - chord / abs(c.radius), 0.5))
        count = max(8, math.ceil(sweep / step))
        return [c.point(k / count) for k in range(count + 1)]


def rounded(value: float, room: float = 0.0) -> float:
    """Return a round length, to a tenth of a micrometre or more, that is within some room [m].

    Where none is, it is rounded to a tenth of a picometre, which takes the noise of units off.

    Examples
    --------
    >>> rounded(6.9999916237e-3, 0.02e-6), rounded(1.9999999999999998e-3)
    (0.007, 0.002)
    """
    value = float(value)
    for digits in range(4, 8):
        if abs(round(value, digits) - value) <= room:
            return round(value, digits) + 0.0
    return round(value, 13) + 0.0


def tidy(loop: Sequence[Curve], rounding: float = 0.0) -> list[DrawnStroke]:
    """Return a closed contour as few pieces; coordinates may be off by a rounding [m]."""
    tolerance = max(ARCS.tolerance, 2.0 * rounding)
    corners = np.array([c.start for c in loop])
    if len(corners) >= ARCS.round_corners and not any(c.bulge for c in loop):
        _, radius, off = circle_of(corners)
        half = 0.5 * max(c.length for c in loop)
        if off <= tolerance and _chord_error(radius, half) <= ARCS.chord_error:
            return _as_arcs(np.vstack([corners, corners[:1]]))
    strokes = [DrawnStroke(c) for c in loop if math.dist(c.start, c.end) > 0.0]
    # begin at the longest straight line, or at an arc: no polyline that stands for an arc is cut
    lengths = [math.inf if s.curve.bulge else s.curve.length for s in strokes]
    first = lengths.index(max(lengths))
    strokes = strokes[first:] + strokes[:first]
    pieces: list[DrawnStroke] = []
    run: list[Pair] = []
    for stroke in strokes:
        if stroke.curve.bulge:
            pieces += _refined(run, tolerance)
            run = []
            pieces.append(stroke)
        else:
            run = run or [stroke.curve.start]
            run.append(stroke.curve.end)
    pieces += _refined(run, tolerance)
    return _merged(pieces, tolerance, max(SAME, 4.0 * rounding))


def circle_of(points: Array) -> tuple[Pair, float, float]:
    """Return centre and radius of the circle nearest to points, and their largest distance from it.

    Least squares of the algebraic distance (I. Kasa, IEEE Trans. Instrum. Meas. 25 (1976) 8), then
    two Gauss-Newton steps of the true distance.
    """
    (x0, y0), scale = points[0], float(np.max(np.ptp(points, axis=0)))
    u, v = (points[:, 0] - x0) / scale, (points[:, 1] - y0) / scale
    rows = np.array([u, v, np.ones_like(u)])
    solution = _solved(rows, 0.5 * (u * u + v * v))
    if solution is None:
        return (float(x0), float(y0)), math.inf, math.inf
    cx, cy = solution[0], solution[1]
    radius = math.sqrt(max(2.0 * solution[2] + cx * cx + cy * cy, 0.0))
    distance = np.hypot(u - cx, v - cy)
    for _ in range(2):
        if not radius or float(np.min(distance)) <= 0.0:
            break
        rows[0], rows[1] = (u - cx) / distance, (v - cy) / distance
        step = _solved(rows, distance - radius)
        if step is None:
            break
        cx, cy, radius = cx + step[0], cy + step[1], radius + step[2]
        distance = np.hypot(u - cx, v - cy)
    off = float(np.max(np.abs(distance - radius)))
    return (float(x0 + scale * cx), float(y0 + scale * cy)), radius * scale, off * scale


def _solved(rows: Array, right: Array) -> tuple[float, float, float] | None:
    """Solve a small least-squares problem, the better the points are spread; None for a line."""
    q, r = np.linalg.qr(rows.T)
    if abs(r[2, 2]) < 1e-14 or abs(r[1, 1]) < 1e-14:
        return None
    d0, d1, d2 = (q.T @ right).tolist()
    c = d2 / r[2, 2]
    b = (d1 - r[1, 2] * c) / r[1, 1]
    return float((d0 - r[0, 1] * b - r[0, 2] * c) / r[0, 0]), float(b), float(c)


def _refined(run: list[Pair], tolerance: float) -> list[DrawnStroke]:
    """Return the lines and arcs that a polyline approximates."""
    out: list[DrawnStroke] = []
    i, last = 0, len(run) - 1
    points = np.array(run)
    while i < last:
        j = _arc_end(points, i, tolerance) if last - i >= ARCS.fewest else i
        if j > i:
            out += _as_arcs(points[i : j + 1])
            i = j
        else:
            out.append(DrawnStroke(Curve(run[i], run[i + 1])))
            i += 1
    return out


def _arc_end(points: Array, i: int, loosest: float) -> int:
    """Return the last corner of the arc that begins at a corner; that corner where none does."""
    steps = np.diff(points[i:], axis=0)
    # no chord of an arc is much longer than its neighbour, and all turn to the same side
    lengths = np.hypot(*steps.T)
    turns = np.arctan2(
        steps[:-1, 0] * steps[1:, 1] - steps[:-1, 1] * steps[1:, 0],
        np.sum(steps[:-1] * steps[1:], axis=1),
    )
    good = (np.abs(turns) < ARCS.sharpest) & (turns * turns[0] > 0.0)
    good &= np.abs(np.log(lengths[1:] / lengths[:-1])) < ARCS.uneven
    most = int(np.argmin(good)) if not np.all(good) else len(good)
    if most + 1 < ARCS.fewest or turns[0] == 0.0:
        return i
    end, reached = i + most + 1, i
    for tolerance in (*ARCS.tighter, loosest):
        j = _reach(points, i, end, tolerance)
        if j - i < ARCS.fewest:
            continue
        _, radius, _ = circle_of(points[i : j + 1])
        half = 0.5 * float(np.max(lengths[: j - i]))
        if _chord_error(radius, half) > ARCS.chord_error:
            continue
        if _rise(points[i : j + 1]) > ARCS.curved * tolerance:
            return j
        reached = j
    # no arc, but a curve that one stands for as well as its chords do
    return reached


def _chord_error(radius: float, half: float) -> float:
    """Distance of a chord, of which half the length is given, from its arc [m]."""
    return math.inf if half >= radius else radius - math.sqrt(radius**2 - half**2)


def _reach(points: Array, i: int, end: int, tolerance: float) -> int:
    """Return the last corner up to which all lie on one circle."""

    def fits(j: int) -> bool:
        return circle_of(points[i : j + 1])[2] <= tolerance

    good, step = i + ARCS.fewest, ARCS.fewest
    if good > end or not fits(good):
        return i
    while good < end:
        trial = min(good + step, end)
        if fits(trial):
            good, step = trial, 2 * step
        elif step > 1:
            step = max(1, min(step, trial - good) // 2)
            bad = trial
            while bad - good > 1:
                middle = (good + bad) // 2
                good, bad = (middle, bad) if fits(middle) else (good, middle)
            break
        else:
            break
    return good


def _rise(points: Array) -> float:
    """Largest distance of points from the chord of the first and the last, or from the first."""
    chord = points[-1] - points[0]
    away = points - points[0]
    length = float(np.hypot(*chord))
    spread = float(np.max(np.hypot(*away.T)))
    if length < 0.1 * spread:
        return spread
    return float(np.max(np.abs(away @ np.array([-chord[1], chord[0]]) / length)))


def _as_arcs(points: Array) -> list[DrawnStroke]:
    """Return the arc on which points lie, or two where it is nearly or wholly round."""
    centre, _, _ = circle_of(points)
    away = points - np.array(centre)
    angles = np.unwrap(np.arctan2(away[:, 1], away[:, 0]))
    trace = tuple((x, y) for x, y in points.tolist())
    last = len(points) - 1
    ends = [0, last // 2, last] if abs(angles[-1] - angles[0]) > ARCS.round else [0, last]
    arcs = []
    for a, b in pairwise(ends):
        bulge = math.tan(0.25 * float(angles[b] - angles[a]))
        arcs.append(DrawnStroke(Curve(trace[a], trace[b], bulge), trace[a : b + 1]))
    return arcs


def _merged(strokes: list[DrawnStroke], tolerance: float, straight: float) -> list[DrawnStroke]:
    """Join collinear lines, and arcs on the same circle."""
    out: list[DrawnStroke] = []
    for stroke in strokes:
        joined = _join(out[-1], stroke, tolerance, straight) if out else None
        if joined is None:
            out.append(stroke)
        else:
            out[-1] = joined
    while len(out) > 2 and (joined := _join(out[-1], out[0], tolerance, straight)) is not None:
        out = [joined, *out[1:-1]]
    return out


def _join(a: DrawnStroke, b: DrawnStroke, tolerance: float, straight: float) -> DrawnStroke | None:
    """Return two pieces as one, where they form one."""
    start, end = a.curve.start, b.curve.end
    if a.trace or b.trace:
        return _join_traces(a, b, tolerance)
    if not a.curve.bulge and not b.curve.bulge:
        length = math.dist(start, end)
        (ux, uy), (vx, vy) = a.curve.direction(0.0), b.curve.direction(0.0)
        off = abs(ux * vy - uy * vx) * min(a.curve.length, b.curve.length)
        if length > 0.0 and off < straight and ux * vx + uy * vy > 0.0:
            return DrawnStroke(Curve(start, end))
        return None
    if a.curve.bulge * b.curve.bulge <= 0.0:
        return None
    first, second = arc(*a.curve), arc(*b.curve)
    sweep = first[3] + second[3]
    near = math.dist(first[0], second[0]) < SAME and abs(first[1] - second[1]) < SAME
    if not near or abs(sweep) > ARCS.round:
        return None
    return DrawnStroke(Curve(start, end, math.tan(0.25 * sweep)))


def _join_traces(a: DrawnStroke, b: DrawnStroke, tolerance: float) -> DrawnStroke | None:
    """Return two parts of a polyline as one arc, where all their corners lie on one circle."""
    if a.curve.bulge * b.curve.bulge < 0.0 or any(s.curve.bulge and not s.trace for s in (a, b)):
        return None
    corners = [*(a.trace or a.curve[:2]), *(b.trace or b.curve[:2])[1:]]
    points = np.array(corners)
    (x, y), radius, off = circle_of(points)
    half = 0.5 * float(np.max(np.hypot(*np.diff(points, axis=0).T)))
    if off > tolerance or _chord_error(radius, half) > ARCS.chord_error:
        return None
    angles = np.unwrap(np.arctan2(points[:, 1] - y, points[:, 0] - x))
    turns = np.diff(angles)
    sweep = float(angles[-1] - angles[0])
    same = bool(np.all(turns * sweep > 0.0)) and sweep * (a.curve.bulge + b.curve.bulge) > 0.0
    if not same or abs(sweep) > ARCS.round:
        return None
    return DrawnStroke(Curve(corners[0], corners[-1], math.tan(0.25 * sweep)), tuple(corners))
