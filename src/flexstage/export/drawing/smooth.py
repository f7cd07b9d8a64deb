"""Notches that are neither lines nor arcs, as arcs that go on into one another."""

import dataclasses
import math
from dataclasses import dataclass
from functools import lru_cache
from typing import ClassVar

import numpy as np

from flexstage.hinges import Profile
from flexstage.hinges.profile import Piece, Vertex
from flexstage.stage import Stage
from flexstage.stage.outline import arc

#: Largest distance of the arcs from the profile that they stand for [m].
ARC_TOLERANCE = 10e-9

_FLAT = 1e-13  # an arc that rises less over its chord is a line [m]
_DEEPEST = 16  # halvings of a piece
_SHARES = np.linspace(0.0, 1.0, 9)

_Node = tuple[float, float, float]  # x, depth [m] and angle [rad]


@dataclass(frozen=True, slots=True, kw_only=True)
class _InArcs(Profile):
    """A profile whose outline is made of arcs; all else is the profile's own."""

    kind: ClassVar[str] = "arcs"

    original: Profile
    """The profile."""

    @property
    def length(self) -> float:
        return self.original.length

    @property
    def depth(self) -> float:
        return self.original.depth

    @property
    def neck_radius(self) -> float:
        return self.original.neck_radius

    def pieces(self) -> tuple[Piece, ...]:
        return self.original.pieces()

    def contour(self) -> tuple[Vertex, ...]:
        return _arcs(self.original)


def smooth_notches(stage: Stage) -> Stage:
    """Return a stage for `plate_contours` whose notches are drawn with lines and arcs only.

    Elliptical, parabolic, hyperbolic and power notches are described elsewhere by chords, whose
    corners a wire would blunt. Here they become pairs of arcs with a common tangent (K. M. Bolton,
    Computer-Aided Design 7 (1975) 89), as many as bring them within 10 nm of the profile.

    Examples
    --------
    >>> from dataclasses import replace
    >>> from flexstage.designs import design
    >>> from flexstage.hinges import Elliptical
    >>> stage = design("parallelogram")
    >>> notch = Elliptical(neck_thickness=0.5e-3, half_length=2e-3, notch_depth=1e-3)
    >>> stage = replace(stage, hinges=(replace(stage.hinges[0], profile=notch),))
    >>> len(notch.contour()), len(smooth_notches(stage).hinges[0].profile.contour())
    (65, 53)
    """
    return dataclasses.replace(
        stage,
        hinges=tuple(
            dataclasses.replace(h, profile=profile_in_arcs(h.profile)) for h in stage.hinges
        ),
    )


def profile_in_arcs(profile: Profile) -> Profile:
    """Return a profile that draws itself with lines and arcs only, the same where it does."""
    if not is_chords(profile):
        return profile
    return _InArcs(
        neck_thickness=profile.neck_thickness, one_sided=profile.one_sided, original=profile
    )


def is_chords(profile: Profile) -> bool:
    """Tell whether the outline of a profile only comes near to it."""
    contour = profile.contour()
    return len(contour) > 8 and not any(v.bulge for v in contour)


@lru_cache(maxsize=256)
def _arcs(profile: Profile) -> tuple[Vertex, ...]:
    vertices: list[Vertex] = []
    end: _Node | None = None
    for piece in profile.pieces():
        vertices += _split(piece, 0.0, 1.0, 0)
        end = _nodes(piece, np.array([1.0]))[0]
    assert end is not None
    # the ends are those of the chords to the last digit: the root must meet its body
    last = profile.contour()[-1]
    return (Vertex(0.0, 0.0, vertices[0].bulge), *vertices[1:], Vertex(last.x, last.depth))


def _nodes(piece: Piece, u: np.ndarray) -> list[_Node]:
    x, depth, angle, _ = piece(u)
    return [(float(a), float(b), float(c)) for a, b, c in zip(x, depth, angle, strict=True)]


def _split(piece: Piece, first: float, last: float, level: int) -> list[Vertex]:
    """Return the starts of the arcs of a part of a piece, halved until they are near enough."""
    nodes = _nodes(piece, first + (last - first) * _SHARES)
    pair = _biarc(nodes[0], nodes[-1])
    if level < _DEEPEST and not _near(pair, nodes):
        middle = 0.5 * (first + last)
        return _split(piece, first, middle, level + 1) + _split(piece, middle, last, level + 1)
    return pair[:2]


def _biarc(a: _Node, b: _Node) -> list[Vertex]:
    """Return start, joint and end of two arcs between two points with given slopes."""
    vx, vy = b[0] - a[0], b[1] - a[1]
    (ax, ay), (bx, by) = ((math.cos(n[2]), math.sin(n[2])) for n in (a, b))
    tx, ty = ax + bx, ay + by
    # legs of equal length from both ends: 2 (1 - Ta.Tb) d^2 + 2 V.T d - V.V = 0, with the root
    # written so that it keeps its digits where the slopes are equal
    p = 4.0 * math.sin(0.5 * (b[2] - a[2])) ** 2
    q = vx * tx + vy * ty
    square = vx * vx + vy * vy
    d = square / (q + math.sqrt(q * q + p * square))
    joint = (0.5 * (a[0] + b[0] + d * (ax - bx)), 0.5 * (a[1] + b[1] + d * (ay - by)))
    return [
        Vertex(a[0], a[1], _bulge(a, joint, a[2])),
        Vertex(*joint, -_bulge((b[0], b[1]), joint, b[2] + math.pi)),
        Vertex(b[0], b[1]),
    ]


def _bulge(start: tuple[float, ...], end: tuple[float, float], angle: float) -> float:
    """Bulge of the arc that leaves a point in a direction and ends in another."""
    vx, vy = end[0] - start[0], end[1] - start[1]
    c, s = math.cos(angle), math.sin(angle)
    half = math.atan2(c * vy - s * vx, c * vx + s * vy)
    bulge = math.tan(0.5 * half)
    return bulge if abs(bulge) * math.hypot(vx, vy) > 2.0 * _FLAT else 0.0


def _near(pair: list[Vertex], nodes: list[_Node]) -> bool:
    """Tell whether two arcs follow a curve within the tolerance."""
    start, joint, end = pair
    along = (end.x - start.x, end.depth - start.depth)
    worst = 0.0
    for x, depth, _ in nodes:
        past = (x - joint.x) * along[0] + (depth - joint.depth) * along[1] > 0.0
        a, b = (joint, end) if past else (start, joint)
        if a.bulge:
            centre, radius, _, _ = arc((a.x, a.depth), (b.x, b.depth), a.bulge)
            off = abs(math.hypot(x - centre[0], depth - centre[1]) - radius)
        else:
            chord = math.hypot(b.x - a.x, b.depth - a.depth)
            off = abs((x - a.x) * (b.depth - a.depth) - (depth - a.depth) * (b.x - a.x)) / chord
        worst = max(worst, off)
    # the samples are close, not dense: half of the tolerance is left to what lies between
    return worst < 0.5 * ARC_TOLERANCE
