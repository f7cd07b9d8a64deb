"""Half of a notch, alone with a block of its body: its tractions, and its stress."""

import math
import threading
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import lru_cache, wraps
from typing import ParamSpec, TypeVar

import ngsolve as ng
import numpy as np
from netgen.occ import Glue, TopoDS_Shape
from numpy.typing import NDArray

from flexstage.base.arrays import Array
from flexstage.elasticity import face
from flexstage.elasticity.shapes import METRE
from flexstage.fem.geometry import neck_edge, surface_edge
from flexstage.fem.layered_plate import REFERENCE, LayeredPlate
from flexstage.fem.mesh import MESHER, MeshSettings, face_mesh
from flexstage.fem.necks import (
    CutNeck,
    NeckMotion,
    constraint_matrix,
    edge_means,
    layered_stress,
    neck_mix,
    neck_motions,
    stress_in_direction,
    stress_of_other_half,
    surface_points,
)
from flexstage.fem.plane_integrals import PlaneIntegrals
from flexstage.fem.through_thickness import ThroughThickness
from flexstage.hinges import Profile
from flexstage.hinges.hinge_spring import PlaneState
from flexstage.hinges.profile import CurvedProfile
from flexstage.stage import Hinge
from flexstage.stage.contour import STRAINED, half_notch, inner_notch

_NAME, _BODY, _NOTCH, _CUT, _ROOT = "0", "body", "notch", "cut", "root"
_NEAR = 1e-9  # two points are one [m]

#: Enrichment radius: extent into the body of the functions of a notch, in widths of its mouth.
ENRICHMENT_RADIUS = 0.4
# How much finer the half notch alone is meshed than the body that it is a part of, and how fast its
# elements grow: stress is a derivative.
_FINER, _GRADING = 0.75, 0.5
#: Highest power over a neck of the tractions through it, on elements of a lower order too, of which
#: two lie on the neck: where a radius is as small as the neck stress needs it.
NECK_POWERS = 6
_ALONG = 4  # elements along each piece of the contour at least


_P = ParamSpec("_P")
_T = TypeVar("_T")


def _cached_for_threads(size: int) -> Callable[[Callable[_P, _T]], Callable[_P, _T]]:
    """Keep the last results; of two threads with the same argument, the second waits for it."""

    def of(function: Callable[_P, _T]) -> Callable[_P, _T]:
        cached = lru_cache(maxsize=size)(function)
        locks: dict[object, threading.Lock] = {}

        @wraps(function)
        def locked(*args: _P.args, **kwargs: _P.kwargs) -> _T:
            with locks.setdefault(args, threading.Lock()):
                return cached(*args, **kwargs)

        return locked

    return of


@dataclass(frozen=True, slots=True, kw_only=True)
class NotchBlock:
    """Half of a notch with a block of its body, of the first body of its hinge."""

    profile: Profile
    """The notch."""
    wide: bool
    """True if the body is wider than the root."""
    plane: PlaneState
    """``stress`` or ``strain``, in a plane model."""
    through: ThroughThickness
    """Functions of the displacement through the thickness of the plate."""
    mesh: MeshSettings
    """Mesh settings of the body."""
    poissons_ratio: float
    """Poisson's ratio [1]."""
    powers: int
    """Highest power over the neck of the tractions through it."""
    widest: Profile | None = None
    """Another notch whose root determines the block, if not None."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class NeckStress:
    """Stress on the surface of half a notch, of the first body of its hinge, by forces on it.

    Lengths are along and across the hinge, from the middle of the neck.
    """

    place: Array
    """Places on the surface [m], shape (m, 2), each once for every element that touches it."""
    point: NDArray[np.intp]
    """Number of the point that each place belongs to, shape (m,)."""
    stress: Array
    """Components for unit forces on the neck, level by level, shape (l, m, c, r): the six of
    `flexstage.elasticity.loaded.COMPONENTS`, in a plane xx, yy, zz and xy."""
    lengthwise: NDArray[np.bool_]
    """Forces along the hinge or about its middle, as a mask, shape (r,)."""

    def of_half(self, which: int, direction: float) -> Array:
        """Return the stress of either half of a hinge in any direction [rad].

        `which` is 0 for the half on the first body, 1 for that on the second.
        """
        stress = stress_of_other_half(self.stress, self.lengthwise) if which else self.stress
        return stress_in_direction(stress, direction)


def neck_tractions(half: NotchBlock) -> Array:
    """Return the composition of each motion of a neck, as by `neck_mix`, shape (r, r + e).

    It is that of the half notch in a body as wide as its root, fixed at its far end.
    """
    return _narrow_tractions(replace(half, wide=False, widest=None))


@_cached_for_threads(64)
def _narrow_tractions(half: NotchBlock) -> Array:
    # out of the plane the same half notch gives its stress, by tractions of more powers
    highest = max(half.powers, NECK_POWERS) if half.through.out_of_plane else half.powers
    _, rows, responses = _narrow(replace(half, powers=highest))
    required, every = (
        [_trimmed(motion) for motion in neck_motions(half.through, powers).every]
        for powers in (half.powers, highest)
    )
    selected = [every.index(motion) for motion in required]
    return neck_mix(rows[selected] @ responses[:, selected], half.through, half.powers)


def _trimmed(motion: NeckMotion) -> NeckMotion:
    """Return a motion without superfluous powers."""
    return replace(motion, weight=tuple(np.trim_zeros(motion.weight, "b")))


@_cached_for_threads(128)
def neck_stress(half: NotchBlock) -> NeckStress:
    """Return the stress of half a notch by unit forces on its neck."""
    if half.through.in_space and not half.through.out_of_plane:
        half = replace(half, through=replace(half.through, fine=True))
    return neck_response(half)[1]


def neck_response(half: NotchBlock, like: Profile | None = None) -> tuple[Array, NeckStress]:
    """Return the flexibility of the motions of a neck, shape (r, r), and the stress by forces.

    Half of the notch is fixed at the far end of its block. In space tractions pass through the neck
    as through that of the notch `like`, where one is given.
    """
    through = half.through
    if not through.in_space:
        plate, rows = _block(half)
        responses = _responses(plate, rows)
        mix = neck_mix(rows @ responses, through, half.powers)
        rows, u = mix @ rows, responses @ mix.T
    elif half.wide or half.widest is not None:
        plate, rows = _block(half)
        rows = neck_tractions(replace(half, profile=like or half.profile)) @ rows
        u = _responses(plate, rows)
    else:
        mix = neck_tractions(replace(half, profile=like or half.profile))
        plate, rows, responses = _narrow(half)
        rows, u = mix @ rows, responses @ mix.T
    with MESHER:
        points = surface_points(plate.plane.mesh, (_NAME,))
        stress = layered_stress(plate, points, u)
    return rows @ u, NeckStress(
        place=points.position[:, :2],
        point=points.point,
        stress=stress,
        lengthwise=np.array(
            [m.direction == 0 for m in neck_motions(through, half.powers).transmitted]
        ),
    )


@_cached_for_threads(6)
def _narrow(half: NotchBlock) -> tuple[LayeredPlate, Array, Array]:
    """Return a half notch in a body as wide as its root, with motions of its neck, responses."""
    plate, rows = _block(half)
    return plate, rows, _responses(plate, rows)


def _responses(plate: LayeredPlate, rows: Array) -> Array:
    return plate.factorised().solve(np.ascontiguousarray(rows.T))


def _block(half: NotchBlock) -> tuple[LayeredPlate, Array]:
    """Return half a notch with a block of its body, and the motions of its neck."""
    in_plane = ThroughThickness(thickness=half.through.thickness)
    with MESHER:
        plane, means = _integrals(replace(half, through=in_plane, poissons_ratio=0.0))
    material = replace(REFERENCE, poissons_ratio=half.poissons_ratio)
    reach = half.profile.length / 2.0 + ENRICHMENT_RADIUS * half.profile.root_height
    plate = LayeredPlate(plane, material, half.through, [(_NOTCH, (0.0, 0.0), reach)])
    motions = neck_motions(half.through, half.powers).every
    return plate, constraint_matrix(plate, means, motions)


@lru_cache(maxsize=4)
def _integrals(half: NotchBlock) -> tuple[PlaneIntegrals, Array]:
    meshed, neck = _meshed(half)
    order = half.mesh.order
    strain = _NOTCH if half.plane == "strain" else ""
    plane = PlaneIntegrals(meshed, order=order, fixed=_ROOT, strain=strain)
    return plane, edge_means(meshed, order, [neck], half.powers)[0]


def _meshed(half: NotchBlock) -> tuple[ng.Mesh, CutNeck]:
    mesh, profile = half.mesh, half.profile
    fine = replace(mesh, neck_size=_FINER * mesh.neck_size, grading=min(mesh.grading, _GRADING))
    neck = CutNeck(
        at=(0.0, 0.0), direction=0.0, which=0, profile=profile, contour=(), plane="stress"
    )
    shape = _shape(half, fine.neck_size * profile.neck_thickness)
    return face_mesh(shape, half.through.thickness, fine), neck


def notch_of(profile: Profile) -> Hinge:
    """Return a hinge with a notch, at the origin and along x."""
    return Hinge(name=_NAME, bodies=("", " "), at=(0.0, 0.0), direction=0.0, profile=profile)


def _shape(half: NotchBlock, size: float) -> TopoDS_Shape:
    """Return half of a notch with a block of its body, which is fixed at its far end."""
    hinge, wide, widest = notch_of(half.profile), half.wide, half.widest or half.profile
    # a fillet may be shorter than the neck is thick; arcs for a curve are short by themselves
    along = 1 if isinstance(half.profile, CurvedProfile) else _ALONG
    loop = half_notch(hinge, 0)
    height = widest.root_height
    top = widest.neck_thickness / 2.0 + widest.depth
    low = -widest.neck_thickness / 2.0 if widest.one_sided else -top
    root = -half.profile.length / 2.0
    far = root - height * (1.0 if wide else 0.5)
    points, bends = [], []
    for a, b, bulge in loop.segments():
        points.append(a)
        bends.append(bulge)
        if abs(a[0] - root) < _NEAR and abs(b[0] - root) < _NEAR:
            # the root is free to deform with the block
            left, right = (top + height, low - height) if wide else (top, low)
            corners = [(root, left), (far, left), (far, right), (root, right)]
            block = [c for c in corners if min(math.dist(c, a), math.dist(c, b)) > _NEAR]
            points += block
            bends += [0.0] * len(block)
    shape = face(points, bends)
    shape.name = _BODY
    # as of a stage, see `flexstage.stage.contour.STRAINED`
    inner = inner_notch(hinge, 0, STRAINED)
    notch = face(inner.points, inner.bulges)
    notch.name = _NOTCH
    shape = Glue([shape - notch, notch])
    across = {0.0: neck_edge(hinge.name), STRAINED * root: _CUT, root: "", far: _ROOT}
    for edge in shape.edges:
        ends = [edge.start.x / METRE, edge.end.x / METRE]
        for x, name in across.items():
            if max(abs(end - x) for end in ends) < _NEAR:
                edge.name = name
                break
        else:
            if min(ends) > root - _NEAR:
                edge.name = surface_edge(hinge.name)
                edge.maxh = min(size * METRE, edge.mass / along)
    return shape
