"""Estimate of the size of a mesh of a part, and of its cost, before it is meshed."""

import math
from collections import defaultdict
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.distance import cdist

from flexstage.base.arrays import Array
from flexstage.base.errors import ModelError
from flexstage.elasticity.resources import memory_available, memory_needed
from flexstage.elasticity.shapes import METRE
from flexstage.fem.part import Part, PartSurface, part_surface
from flexstage.fem.part_mesh import SMALLEST, PartMesh, first_hits

_PLACES = 1500  # places on the surface at which the size is asked for
_LEAST = 6  # of them on each face
_ON_EDGES = 1500  # places on edges, about, at most
_LARGER = 1.25  # from one size that is tried to the next
_SAME_CORNER = 1e-6  # corners at one place, relative to the size
_BENT = 1e-3  # angle between triangles of a plane, at most [rad]
_GIGA = 1e9


@dataclass(frozen=True, slots=True, kw_only=True)
class _Experience:
    """Numbers of elements of meshes, and their cost.

    Measured on 27 meshes of nine parts (a block, a bar, plates with holes, a tube, a notched bar,
    the joints and the actuator of docs/explanation/ansys-comparison.md), 40 to 24 000 elements;
    times are those of one core of an AMD EPYC.
    """

    by_volume: float = 5.0
    """Tetrahedra for each cube of their size: 4.2 to 5.4 where they are small [1]."""
    by_surface: float = 1.8
    """Tetrahedra for each triangle of the surface of thin parts: 1.4 to 2.2 [1]."""
    triangles: float = 2.25
    """Triangles for each square of their size: 1.7 to 2.7 [1]."""
    few: float = 2.0
    """Elements through a wall below which a part is a shell of one layer of elements [1]."""
    starting: float = 1.5
    """Time before the mesher begins [s]."""
    meshing: float = 4.5e-4
    """Time of the mesher for an element: 2.4e-4 to 7e-4 [s]."""
    search: tuple[float, float] = (2.0e-4, 6.0e-8)
    """Time for the thickness of walls, for a triangle and for a pair of triangles [s]."""
    factorising: float = 17.0
    """Time for a gigabyte, and as its power of 3/2: 12 to 24 [s]."""
    solving: float = 0.23
    """Time for a gigabyte, for each solution [s]."""
    solutions: float = 30.0
    """Solutions for each factorisation [1]."""
    mesh: float = 2.0e3
    """Memory of an element, assumed [byte]."""


_EXPERIENCE = _Experience()


@dataclass(frozen=True, slots=True, kw_only=True)
class PartEstimate:
    """Expected size and cost of a mesh of a part."""

    elements: float
    """Tetrahedra [1]."""
    unknowns: float
    """Degrees of freedom [1]."""
    memory: float
    """Largest memory at one time [byte]."""
    seconds: float
    """CPU time of one core [s]."""
    meshing: float
    """Share of the mesher in it [s]."""
    largest: float
    """Largest element [m]."""

    def words(self) -> str:
        """Return the estimate as text."""
        time = f"{self.seconds:.2g} s"
        if self.seconds > 90.0:
            minutes = self.seconds / 60.0
            time = f"{minutes:.2g} min" if minutes < 90.0 else f"{minutes / 60.0:.3g} h"
        return (
            f"about {_round(self.elements)} elements, {_round(self.unknowns)} unknowns, "
            f"{self.memory / _GIGA:.2g} GB, {time} on one core (0.8 to 2.5 times the actual "
            "values)"
        )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Places:
    """Places on the surface of a part, with the lengths that determine the element size [m]."""

    area: Array
    """Area that each represents [m^2], shape (n,)."""
    wall: Array
    """Thickness of the part behind it, shape (n,)."""
    radius: Array
    """Least radius of curvature there, shape (n,)."""
    face: NDArray[np.intp]
    """Number of its face, shape (n,)."""
    length: Array
    """Length of the edge on which each place on an edge is, shape (e,)."""
    apart: Array
    """Distances of places on the surface from all, those on edges last, shape (n, n + e)."""


def _places(part: Part, surface: PartSurface) -> _Places:
    rng = np.random.default_rng(0)
    vectors = surface.area_vectors
    areas = np.linalg.norm(vectors, axis=1)
    normal = vectors / areas[:, None]
    radius = _radii(surface, normal)
    sampled, weight = [], []
    for k in range(len(part.faces)):
        triangles = np.flatnonzero(surface.face == k)
        if not len(triangles):
            continue
        total_area = areas[triangles].sum()
        count = max(_LEAST, round(_PLACES * total_area / areas.sum()))
        sampled.append(rng.choice(triangles, count, p=areas[triangles] / total_area))
        weight.append(np.full(count, total_area / count))
    which = np.concatenate(sampled)
    # evenly over a triangle (Osada and others 2002)
    r, s = np.sqrt(rng.random(len(which))), rng.random(len(which))
    shares = np.column_stack([1.0 - r, r * (1.0 - s), r * s])
    at = np.einsum("nc,ncx->nx", shares, surface.triangles[which])
    outer = np.array([len(f.bodies) == 1 for f in part.faces])[surface.face]
    reach = math.dist(*part.bounding_box)
    wall = first_hits(surface.triangles[outer], normal[outer], at[:, None], -normal[which], reach)[
        :, 0
    ]
    pieces = np.linalg.norm(surface.lines[:, 1] - surface.lines[:, 0], axis=1)
    # of an edge some places, and its length
    length = np.bincount(surface.edge, weights=pieces)[surface.edge]
    sampled_edges = np.flatnonzero(
        (length > 0.0) & (rng.random(len(pieces)) < _ON_EDGES / len(pieces))
    )
    return _Places(
        area=np.concatenate(weight),
        wall=wall,
        radius=radius[which],
        face=surface.face[which],
        length=np.asarray(length[sampled_edges], dtype=float),
        apart=np.asarray(
            cdist(at, np.concatenate([at, surface.lines[sampled_edges].mean(axis=1)])), dtype=float
        ),
    )


def _radii(surface: PartSurface, normal: Array) -> Array:
    """Return the least radius of curvature at each triangle, by the angles to its neighbours."""
    scale = np.ptp(surface.triangles.reshape(-1, 3), axis=0).max()
    corners = np.round(surface.triangles / (_SAME_CORNER * scale)).astype(np.int64)
    neighbours: dict[object, list[tuple[int, float]]] = defaultdict(list)
    twice = 2.0 * np.linalg.norm(surface.area_vectors, axis=1)
    for t, (three, face) in enumerate(zip(corners.tolist(), surface.face.tolist(), strict=True)):
        for k in range(3):
            p, q = tuple(three[k]), tuple(three[(k + 1) % 3])
            side = np.linalg.norm(surface.triangles[t, k] - surface.triangles[t, (k + 1) % 3])
            if side > 0.0:
                neighbours[face, min(p, q), max(p, q)].append((t, float(twice[t] / side)))
    radius = np.full(len(normal), np.inf)
    for pair in neighbours.values():
        if len(pair) == 2:
            (i, height), (j, other) = pair
            angle = math.acos(min(1.0, max(-1.0, float(normal[i] @ normal[j]))))
            if angle > _BENT:
                radii = 0.5 * (height + other) / angle
                radius[i], radius[j] = min(radius[i], radii), min(radius[j], radii)
    return radius


def _sizes(places: _Places, part: Part, settings: PartMesh) -> Array:
    """Return the size of elements at each place, by the mesher's rules [m]."""
    diagonal = math.dist(*part.bounding_box)
    largest = settings.largest(diagonal)
    size = np.minimum(largest, places.radius / settings.curvature)
    if settings.thin:
        walls = np.maximum(settings.thin * places.wall, SMALLEST * diagonal)
        size = np.minimum(size, np.where(walls < largest, walls, largest))
    names = [part.faces[k].name for k in places.face]
    size = np.minimum(size, [settings.sizes.get(name, largest) for name in names])
    # sizes grow with the distance from where they are small; of an edge they are at most its length
    from_there = np.concatenate([size, np.minimum(places.length, largest)])
    out = (from_there + settings.grading * places.apart).min(axis=1)
    return np.minimum(out, largest)


def _counts(places: _Places, part: Part, settings: PartMesh) -> tuple[float, float, float]:
    """Return cubes and squares of the size of elements in the part and on it, and those in a wall.

    Below a place of size h elements grow by the grading g as far as the middle of the wall w:
    int_0^(w/2) dz / min(h + g z, H)^3 of them stand on each square metre.
    """
    largest = settings.largest(math.dist(*part.bounding_box))
    h, g = _sizes(places, part, settings), settings.grading
    half = 0.5 * np.minimum(places.wall, 6.0 * part.volume / places.area.sum())
    deep = np.minimum(half, (largest - h) / g)
    skin = (1.0 / h**2 - 1.0 / (h + g * deep) ** 2) / (2.0 * g)
    in_skin = float(places.area @ deep)
    share = min(1.0, part.volume / in_skin) if in_skin else 1.0
    bulk = max(0.0, part.volume - in_skin) / largest**3
    across = float(np.median(places.wall / h))
    return share * float(places.area @ skin) + bulk, float((places.area / h**2).sum()), across


def _unknowns(elements: float, triangles: float, order: int) -> float:
    """Return the unknowns of three components: those of corners, edges, faces and interiors."""
    corners = 0.17 * elements + 0.27 * triangles  # measured; the rest is Euler's formula
    faces = 2.0 * elements + 0.5 * triangles
    edges = corners + faces - elements
    p = order - 1
    inner = p * (p - 1) / 2.0 * faces + p * (p - 1) * (p - 2) / 6.0 * elements
    return 3.0 * (corners + p * edges + inner)


def _round(value: float) -> str:
    digits = max(0, math.floor(math.log10(max(value, 1.0))) - 1)
    number = round(value / 10**digits) * 10**digits
    return (
        f"{number:,}".replace(",", "\N{NARROW NO-BREAK SPACE}") if number < 1e7 else f"{number:.1g}"
    )


def estimate_part(part: Part, settings: PartMesh, *, factorisations: int = 1) -> PartEstimate:
    """Estimate a mesh of a part from its surface alone.

    The surface gives the size of elements at some places by the mesher's rules: the largest one,
    the radius of curvature, the wall behind, the length of edges, and growth with the distance from
    where they are small. Counts follow by integration to the middle of the walls.

    `factorisations` is the number of stiffness matrices that are factorised, one after the other.

    Notes
    -----
    Validity: for 20 meshes from 12 000 unknowns on it gave 0.6 to 1.6 of the elements, 0.7 to 1.5
    of the unknowns, and 0.8 to 2.5 of the memory and of the time on the same processor; too much
    for hollow parts. It does not include the repetition of meshes that curving folds.
    """
    return _estimate(_places(part, part_surface(part)), part, settings, factorisations)


def _estimate(places: _Places, part: Part, settings: PartMesh, factorisations: int) -> PartEstimate:
    by_volume, by_surface, across = _counts(places, part, settings)
    triangles = _EXPERIENCE.triangles * by_surface
    elements = max(_EXPERIENCE.by_volume * by_volume, _EXPERIENCE.by_surface * triangles)
    unknowns = _unknowns(elements, triangles, settings.order)
    low, high = part.bounding_box
    solving = memory_needed(
        round(unknowns),
        3,
        settings.order,
        box=[h - b for b, h in zip(low, high, strict=True)],
        layered=across < _EXPERIENCE.few,
    )
    giga = solving / _GIGA
    search = (
        triangles * (_EXPERIENCE.search[0] + _EXPERIENCE.search[1] * triangles)
        if settings.thin
        else 0.0
    )
    meshing = _EXPERIENCE.meshing * elements + search
    once = _EXPERIENCE.factorising * giga**1.5 + _EXPERIENCE.solutions * _EXPERIENCE.solving * giga
    return PartEstimate(
        elements=elements,
        unknowns=unknowns,
        memory=solving + _EXPERIENCE.mesh * elements,
        seconds=_EXPERIENCE.starting + meshing + factorisations * once,
        meshing=meshing,
        largest=settings.largest(math.dist(low, high)),
    )


def require_room(part: Part, settings: PartMesh, expected: PartEstimate) -> None:
    """Refuse a mesh that will not fit in memory, before it is generated.

    The size that would fit is in the message.
    """
    free = memory_available()
    if expected.memory <= free:
        return
    places = _places(part, part_surface(part))
    diagonal = math.dist(*part.bounding_box)
    hint = "no element size is large enough: take a lower order or a part of the geometry"
    size = expected.largest
    while size < 0.25 * diagonal:
        size = min(_LARGER * size, 0.25 * diagonal)
        if _estimate(places, part, replace(settings, size=size), 1).memory <= free:
            hint = f"elements of {float(f'{size * METRE:.2g}'):g} mm would fit"
            break
    raise ModelError(
        f"the mesh of {part.source} will need about {expected.memory / _GIGA:.3g} GB of memory, "
        f"{free / _GIGA:.2g} GB are free: with elements of {expected.largest * METRE:.3g} mm of "
        f"order {settings.order} it has about {_round(expected.unknowns)} unknowns; {hint}"
    )
