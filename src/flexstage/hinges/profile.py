"""Base classes of notch profiles: dimensions, shape as a curve, outline for drawing."""

import math
from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from typing import ClassVar, NamedTuple

import numpy as np

from flexstage.base.arrays import Array
from flexstage.base.errors import HingeError
from flexstage.quantities.units import Length

_POINTS, _WEIGHTS = np.polynomial.legendre.leggauss(20)


def _differentiation(nodes: Array) -> Array:
    """Return the matrix from values of a polynomial at its nodes to its derivatives there."""
    apart = nodes[:, None] - nodes[None, :] + np.eye(nodes.size)
    product = np.prod(apart, axis=1)
    matrix = product[:, None] / (product[None, :] * apart)
    np.fill_diagonal(matrix, 0.0)
    np.fill_diagonal(matrix, -np.sum(matrix, axis=1))
    return matrix


_DERIVATIVES = _differentiation(_POINTS)
# panels graded towards the neck, where the compliance of a thin notch is concentrated
_PANELS = np.concatenate(([0.0], 2.0 ** np.arange(-9.0, 1.0)))
# quadrature points and weights along a piece of a contour
_PLACES = (_PANELS[:-1, None] + np.diff(_PANELS)[:, None] * (_POINTS + 1.0) / 2.0).ravel()
_SHARES_OF_PIECE = (np.diff(_PANELS)[:, None] * _WEIGHTS / 2.0).ravel()


class Samples(NamedTuple):
    """Quadrature points along the contour of one half of a notch, from the neck to the root."""

    x: Array
    """Distance from the neck along the hinge [m], shape (n,)."""
    depth: Array
    """Distance of the contour from the neck's surface, across the hinge [m], shape (n,)."""
    angle: Array
    """Slope of the contour against the hinge axis, 0 to pi/2 [rad], shape (n,)."""
    ds: Array
    """Quadrature weight times arc length [m], shape (n,); ``cos(angle) * ds`` integrates over x."""


class Vertex(NamedTuple):
    """A point of the contour, and the curve to the next one."""

    x: float
    """Distance from the neck along the hinge [m]."""
    depth: float
    """Distance from the neck's surface [m]."""
    bulge: float = 0.0
    """Tangent of a quarter of the angle of the arc to the next vertex, positive if it turns left
    [1]; 0 for a straight line.
    """


def increments(values: Array) -> Array:
    """Return the increments of a function along the contour: quadrature weight times derivative.

    The function is given at the points of `Profile.samples` and smooth in each piece; the
    increments are what ``ds`` is for the arc length.
    """
    panels = values.reshape(-1, _POINTS.size)
    return ((panels @ _DERIVATIVES.T) * _WEIGHTS).ravel()


#: A smooth piece of the contour: maps u in [0, 1] to (x, depth, angle, ds/du).
Piece = Callable[[Array], tuple[Array, Array, Array, Array]]


@dataclass(frozen=True, slots=True, kw_only=True)
class Profile(ABC):
    """A notch, symmetric about its neck; cut from both sides, or from one.

    Raises
    ------
    HingeError
        A dimension is not positive and finite.
    """

    kind: ClassVar[str]
    # dimensions that may be 0
    can_be_zero: ClassVar[frozenset[str]] = frozenset()

    neck_thickness: Length
    """Smallest thickness t [m]."""
    one_sided: bool = False
    """True if the notch is cut on one side only (the left one, looking along the hinge), the other
    side being straight.
    """

    def __post_init__(self) -> None:
        for name in self.__dataclass_fields__:
            value = getattr(self, name)
            is_size = isinstance(value, (int, float)) and not isinstance(value, bool)
            if value == 0.0 and name in self.can_be_zero:
                continue
            if is_size and not 0.0 < value < float("inf"):
                raise HingeError(
                    f"{self.kind} notch: {name} must be positive and finite, got {value!r}"
                )
        self._check()

    def _check(self) -> None:  # noqa: B027
        """Refuse impossible combinations of dimensions; a profile overrides it where it has any."""

    @property
    @abstractmethod
    def length(self) -> float:
        """Length of the whole notch along the hinge [m]."""

    @property
    @abstractmethod
    def depth(self) -> float:
        """Depth of the notch at its root, on one side [m]."""

    @property
    @abstractmethod
    def neck_radius(self) -> float:
        """Radius of curvature of the contour where the stress is largest [m]."""

    @abstractmethod
    def pieces(self) -> tuple[Piece, ...]:
        """Return the contour from the neck to the root as smooth pieces."""

    @abstractmethod
    def contour(self) -> tuple[Vertex, ...]:
        """Return the contour from the neck to the root as lines and arcs."""

    @property
    def flat_length(self) -> float:
        """Length of the part about the neck that has constant thickness [m]."""
        return 0.0

    @property
    def step(self) -> float:
        """Height of the sharp step at the root, on one side [m]."""
        return 0.0

    @property
    def sides(self) -> int:
        """Number of sides that are cut."""
        return 1 if self.one_sided else 2

    @property
    def root_height(self) -> float:
        """Height of the notch where it meets the bodies [m]."""
        return self.neck_thickness + self.sides * self.depth

    def samples(self) -> Samples:
        """Return quadrature points along half of the contour.

        Returns
        -------
        Samples
            Gauss points on panels graded towards the neck.
        """
        return _sampled(self)

    def half_area_integrals(self) -> tuple[float, float, float, float]:
        """Integrate 1, x, y and x^2 + y^2 over half of the notch's material.

        Returns
        -------
        tuple of float
            Area [m^2], first moments along and across the hinge [m^3], polar moment about the neck
            [m^4].
        """
        x, depth, angle, ds = self.samples()
        dx = np.cos(angle) * ds
        h = self.neck_thickness + self.sides * depth
        e = 0.5 * depth if self.one_sided else np.zeros_like(depth)
        return (
            float(np.sum(h * dx)),
            float(np.sum(x * h * dx)),
            float(np.sum(e * h * dx)),
            float(np.sum((x**2 * h + e**2 * h + h**3 / 12.0) * dx)),
        )


# compliance, area and loads of the same notch are asked for one after the other
@lru_cache(maxsize=8)
def _sampled(profile: Profile) -> Samples:
    columns = []
    for piece in profile.pieces():
        x, depth, angle, speed = piece(_PLACES)
        columns.append((x, depth, angle, speed * _SHARES_OF_PIECE))
    samples = Samples(*(np.concatenate(c) for c in zip(*columns, strict=True)))
    for values in samples:
        values.setflags(write=False)
    return samples


#: Largest distance of the arcs from the profile that they approximate [m]. Wire cutting is off by a
#: hundred times as much, and the radius at the neck is that of the profile within 1e-4; ten times
#: as much would leave 2e-3 of a sharp one.
ARC_TOLERANCE = 10e-9

_FLAT = 1e-13  # an arc that rises less over its chord is a line [m]
_DEEPEST = 16  # halvings of a piece
_SHARES = np.linspace(0.0, 1.0, 9)

_Node = tuple[float, float, float]  # x, depth [m] and angle [rad]


@dataclass(frozen=True, slots=True, kw_only=True)
class CurvedProfile(Profile):
    """A notch whose contour is neither lines nor arcs, and turns away from the hinge throughout.

    Drawings and finite elements have pairs of arcs with a common tangent in its place (K. M.
    Bolton, Computer-Aided Design 7 (1975) 89), as many as bring them within 10 nm of it.
    """

    def contour(self) -> tuple[Vertex, ...]:
        return _contour(self)


@lru_cache(maxsize=1024)
def _contour(profile: Profile) -> tuple[Vertex, ...]:
    vertices = [v for piece in profile.pieces() for v in _split(piece, 0.0, 1.0, 0)]
    # both ends to the last digit: the halves must meet, and the root its body
    first = Vertex(0.0, 0.0, vertices[0].bulge)
    return (first, *vertices[1:], Vertex(0.5 * profile.length, profile.depth))


def _split(piece: Piece, first: float, last: float, level: int) -> list[Vertex]:
    """Return the starts of the arcs of a part of a piece, halved until they are near enough."""
    x, depth, angle, _ = piece(first + (last - first) * _SHARES)
    a, b = ((float(x[i]), float(depth[i]), float(angle[i])) for i in (0, -1))
    pair = _biarc(a, b)
    if level < _DEEPEST and not _near(pair, x, depth):
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
    before = _bulge((a[0], a[1]), joint, a[2])
    after = -_bulge((b[0], b[1]), joint, b[2] + math.pi)
    if before < 0.0 or after < 0.0:
        # Where nearly all of the turn is at one end, such arcs turn one way and back. There an arc
        # ends on the tangent of the other end, as far from where the tangents meet as its own end.
        turn = b[2] - a[2]
        sine = math.sin(turn)
        longer = ((vx * by - vy * bx) - (ax * vy - ay * vx)) / sine if sine > 0.0 else 0.0
        bend = math.tan(0.25 * turn)
        if longer > 0.0:
            joint, before, after = (a[0] + longer * ax, a[1] + longer * ay), 0.0, bend
        else:
            joint, before, after = (b[0] + longer * bx, b[1] + longer * by), bend, 0.0
    return [
        Vertex(a[0], a[1], _or_line(before, (a[0], a[1]), joint)),
        Vertex(*joint, _or_line(after, joint, (b[0], b[1]))),
        Vertex(b[0], b[1]),
    ]


def _bulge(start: tuple[float, float], end: tuple[float, float], angle: float) -> float:
    """Bulge of the arc that leaves a point in a direction and ends in another."""
    vx, vy = end[0] - start[0], end[1] - start[1]
    c, s = math.cos(angle), math.sin(angle)
    return math.tan(0.5 * math.atan2(c * vy - s * vx, c * vx + s * vy))


def _or_line(bulge: float, start: tuple[float, float], end: tuple[float, float]) -> float:
    return bulge if abs(bulge) * math.dist(start, end) > 2.0 * _FLAT else 0.0


def _near(pair: list[Vertex], x: Array, depth: Array) -> bool:
    """Return whether two arcs follow a curve within the tolerance."""
    start, joint, end = pair
    along = (end.x - start.x, end.depth - start.depth)
    past = (x - joint.x) * along[0] + (depth - joint.depth) * along[1] > 0.0
    off = np.where(past, _off(joint, end, x, depth), _off(start, joint, x, depth))
    # the samples are close, not dense: half of the tolerance is left to what lies between
    return bool(np.max(np.abs(off)) < 0.5 * ARC_TOLERANCE)


def _off(start: Vertex, end: Vertex, x: Array, depth: Array) -> Array:
    """Distance of points from a line or arc, negative to the left of it [m]."""
    chord = math.hypot(end.x - start.x, end.depth - start.depth)
    slope = math.atan2(end.depth - start.depth, end.x - start.x) - 2.0 * math.atan(start.bulge)
    curvature = 4.0 * start.bulge / (1.0 + start.bulge**2) / chord
    c, s = math.cos(slope), math.sin(slope)
    u = c * (x - start.x) + s * (depth - start.depth)
    w = c * (depth - start.depth) - s * (x - start.x)
    # |p - centre| - radius, times curvature over itself: it keeps its digits where the arc is flat
    return (curvature * (u * u + w * w) - 2.0 * w) / (
        np.hypot(curvature * u, 1.0 - curvature * w) + 1.0
    )
