r"""Thin places of a part: the passes between its thick places.

Points along the contours are joined to triangles (B. N. Delaunay 1934). Their circles are the
largest that fit between the contours, their centres the middle line of the part (H. Blum, in
Models for the Perception of Speech and Visual Form, 1967): a graph whose height is the local
thickness. Flooding it from above, in the order of falling thickness, two hills meet at a pass. A
pass is a neck where the lower of the two hills is higher by so much; hills that are hardly higher
than the pass between them are one. That is the persistence of the pass (H. Edelsbrunner,
D. Letscher, A. Zomorodian, Discrete Comput. Geom. 28 (2002) 511), as a ratio.
"""

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from flexstage.base.arrays import Array
from flexstage.stage.drawing.contours import DrawnContour, DrawnPart
from flexstage.stage.drawing.strokes import Pair


@dataclass(frozen=True, slots=True)
class _ReliefRules:
    """Sampling of the contours, and limits of passes."""

    least_ratio: float = 1.25
    """A body is at least this much thicker than a neck that leads to it [1]."""
    arc_step: float = 0.17
    """Turn of an arc between two points [rad]."""
    coarse: int = 6000
    """Points of all contours at first."""
    finest: float = 2e-6
    """Points are never nearer [m]."""
    most: int = 400_000
    """Points in all."""
    dense: float = 2.0
    """Points are nearer along a contour than this part of the thickness there, inverted."""
    flat: float = 1e-7
    """A triangle of less area, in squares of its longest side, is a line."""
    around: float = 3.0
    """Way along the contour, in straight ways, that makes two places opposite."""


_RULES = _ReliefRules()


class Place(NamedTuple):
    """A place on a contour."""

    contour: int
    """Number of the contour."""
    stroke: int
    """Number of its piece."""
    share: float
    """Share of the piece that lies before it."""
    at: Pair
    """The place [m]."""


class Pass(NamedTuple):
    """A thin place between two thick ones."""

    thickness: float
    """Thickness, about [m]."""
    ratio: float
    """Thickness of the thinner of the two thick places, in thicknesses of the pass [1]."""
    sides: tuple[Place, Place]
    """The places on the contours between which it lies."""
    hills: tuple[int, int]
    """Numbers of the two thick places."""


class Relief(NamedTuple):
    """The thick places of a part and the passes between them."""

    passes: tuple[Pass, ...]
    """Passes, from the thickest to the thinnest."""
    heights: dict[int, float]
    """Thickness of each thick place by its number [m]."""


class _Samples(NamedTuple):
    at: Array  # (n, 2)
    contour: Any  # (n,) int
    stroke: Any  # (n,) int
    share: Array  # (n,)
    along: Array  # (n,) way along the contour
    following: Any  # (n,) int, the next point of the contour
    length: Array  # (n,) of its whole contour


def relief(part: DrawnPart) -> Relief:
    """Find the thin places of a part.

    Round holes are excluded: a wall next to a drilled hole is no neck.
    """
    walls = [k for k, c in enumerate(part.contours) if k == 0 or c.circle is None]
    samples = _sampled(part, walls)
    return _passes(samples)


def _sampled(part: DrawnPart, walls: list[int]) -> _Samples:
    total = sum(s.curve.length for k in walls for s in part.contours[k].strokes)
    shares = {
        (k, n): _even(part.contours[k], n, total / _RULES.coarse)
        for k in walls
        for n in range(len(part.contours[k].strokes))
    }
    while True:
        samples, step = _gathered(part, walls, shares)
        refined = _too_coarse(samples, step)
        if not len(refined) or len(samples.at) > _RULES.most:
            return samples
        for i in refined.tolist():
            key = (int(samples.contour[i]), int(samples.stroke[i]))
            here = float(samples.share[i])
            last = samples.following[i]
            same = samples.stroke[last] == key[1] and samples.share[last] > here
            beyond = float(samples.share[last]) if same else 1.0
            shares[key].append(0.5 * (here + beyond))
        shares = {key: sorted(set(cuts)) for key, cuts in shares.items()}


def _even(contour: DrawnContour, n: int, step: float) -> list[float]:
    curve = contour.strokes[n].curve
    count = max(1, int(np.ceil(curve.length / step)))
    if curve.bulge:
        count = max(count, int(np.ceil(4.0 * abs(np.arctan(curve.bulge)) / _RULES.arc_step)))
    return [j / count for j in range(count)]


def _gathered(
    part: DrawnPart, walls: list[int], shares: dict[tuple[int, int], list[float]]
) -> tuple[_Samples, Array]:
    """Place the points; each represents the length up to the next, which is returned too."""
    at, contour, stroke, share, along, following, length = [], [], [], [], [], [], []
    step: list[float] = []
    for k in walls:
        begin, way = len(at), 0.0
        for n, s in enumerate(part.contours[k].strokes):
            cuts = shares[k, n]
            size = s.curve.length
            for j, cut in enumerate(cuts):
                at.append(s.curve.point(cut))
                contour.append(k)
                stroke.append(n)
                share.append(cut)
                along.append(way + cut * size)
                step.append(((cuts[j + 1] if j + 1 < len(cuts) else 1.0) - cut) * size)
            way += size
        count = len(at) - begin
        following += [begin + (j + 1) % count for j in range(count)]
        length += [way] * count
    samples = _Samples(
        np.array(at),
        np.array(contour),
        np.array(stroke),
        np.array(share),
        np.array(along),
        np.array(following),
        np.array(length),
    )
    return samples, np.array(step)


def _too_coarse(samples: _Samples, step: Array) -> Any:
    """Return the points after which the contour needs another, as material is thin there."""
    from scipy.spatial import KDTree

    coarse = np.flatnonzero(step > 2.0 * _RULES.finest)
    middle = 0.5 * (samples.at + samples.at[samples.following])
    tree = KDTree(samples.at)
    neighbours = tree.query_ball_point(middle[coarse], _RULES.dense * step[coarse])
    counts = np.array([len(f) for f in neighbours])
    i = np.repeat(coarse, counts)
    j = (
        np.concatenate([np.array(f, dtype=int) for f in neighbours])
        if len(i)
        else np.array([], int)
    )
    away = samples.at[j] - middle[i]
    straight = np.hypot(*away.T)
    # the material is on the left of the way along a contour
    ahead = samples.at[samples.following[i]] - samples.at[i]
    inside = ahead[:, 0] * away[:, 1] - ahead[:, 1] * away[:, 0] > 0.3 * step[i] * straight
    way = np.abs(samples.along[j] - samples.along[i] - 0.5 * step[i])
    way = np.minimum(way, samples.length[i] - way)
    opposite = (samples.contour[i] != samples.contour[j]) | (way > _RULES.around * straight)
    return np.unique(i[inside & opposite])


def _passes(samples: _Samples) -> Relief:
    from scipy.spatial import Delaunay

    at = samples.at
    # about the middle and in sizes of the part, or rounding bends the circles
    origin, size = at.mean(axis=0), float(np.ptp(at))
    mesh = Delaunay((at - origin) / size)
    triangles = mesh.simplices
    inside = _within(samples, triangles)
    radius = _radii(at, triangles)
    first, second, edge = _shared(mesh, triangles, inside, samples)
    width = _widths(at, triangles, radius, first, second, edge)
    height = 2.0 * radius
    hill = list(range(len(triangles)))
    top: list[float] = height.tolist()

    def root(k: int) -> int:
        while hill[k] != k:
            hill[k] = hill[hill[k]]
            k = hill[k]
        return k

    candidates: list[tuple[float, int, int, int]] = []
    order = np.argsort(-width, kind="stable")
    columns = (order, first[order], second[order], width[order])
    for e, one, other, w in zip(*(column.tolist() for column in columns), strict=True):
        a, b = root(one), root(other)
        if a == b:
            continue
        if top[a] < top[b]:
            a, b = b, a
        if top[b] <= _RULES.least_ratio * w:
            hill[b] = a
        else:
            candidates.append((w, a, b, e))
    passes = []
    for w, one, other, e in candidates:
        a, b = root(one), root(other)
        if a != b:
            i, j = edge[e].tolist()
            sides = (_place(samples, i), _place(samples, j))
            passes.append(Pass(w, min(top[a], top[b]) / w, sides, (a, b)))
    heights = {k: top[k] for p in passes for k in p.hills}
    return Relief(tuple(passes), heights)


def _place(samples: _Samples, i: int) -> Place:
    x, y = samples.at[i].tolist()
    return Place(int(samples.contour[i]), int(samples.stroke[i]), float(samples.share[i]), (x, y))


def _within(samples: _Samples, triangles: Any) -> Any:
    """Return which triangles are material."""
    from shapely import Polygon, contains_xy, prepare

    rings = [samples.at[samples.contour == k] for k in np.unique(samples.contour)]
    # an opening with two points only is as thin as a line
    shape = Polygon(rings[0], [r for r in rings[1:] if len(r) > 2])
    prepare(shape)
    middle = samples.at[triangles].mean(axis=1)
    return contains_xy(shape, middle[:, 0], middle[:, 1])


def _radii(at: Array, triangles: Any) -> Array:
    """Return radii of the circles through the corners of triangles.

    Of three points in a line, which have none, it is half of the way between the outer two.
    """
    a, b, c = (at[triangles[:, k]] for k in range(3))
    ab, ac, bc = b - a, c - a, c - b
    area = 0.5 * np.abs(ab[:, 0] * ac[:, 1] - ab[:, 1] * ac[:, 0])
    sides = np.array([np.hypot(*ab.T), np.hypot(*ac.T), np.hypot(*bc.T)])
    longest = sides.max(axis=0)
    flat = area < _RULES.flat * longest**2
    return np.where(flat, 0.5 * longest, sides.prod(axis=0) / (4.0 * np.where(flat, 1.0, area)))


def _shared(mesh: Any, triangles: Any, inside: Any, samples: _Samples) -> tuple[Any, Any, Any]:
    """Return the pairs of neighbouring triangles of material, and the side between them."""
    firsts, seconds, edges = [], [], []
    for k in range(3):
        other = mesh.neighbors[:, k]
        good = inside & (other >= 0)
        good &= inside[np.where(other >= 0, other, 0)]
        good &= np.arange(len(triangles)) < other
        side = triangles[:, [(k + 1) % 3, (k + 2) % 3]]
        wall = (samples.following[side[:, 0]] == side[:, 1]) | (
            samples.following[side[:, 1]] == side[:, 0]
        )
        good &= ~wall
        firsts.append(np.flatnonzero(good))
        seconds.append(other[good])
        edges.append(side[good])
    return np.concatenate(firsts), np.concatenate(seconds), np.concatenate(edges)


def _widths(at: Array, triangles: Any, radius: Array, first: Any, second: Any, edge: Any) -> Array:
    """Return the width of the narrowest circle on the way between neighbouring triangles.

    Where both circles have their centres on their own sides of the side between them, that is the
    side; else the smaller one of the two.
    """
    p, q = at[edge[:, 0]], at[edge[:, 1]]
    length = np.hypot(*(p - q).T)
    acute = np.ones(len(edge), dtype=bool)
    for t in (first, second):
        corners = triangles[t]
        third = corners.sum(axis=1) - edge.sum(axis=1)
        apex = at[third]
        acute &= np.sum((p - apex) * (q - apex), axis=1) >= 0.0
    return np.where(acute, length, 2.0 * np.minimum(radius[first], radius[second]))
