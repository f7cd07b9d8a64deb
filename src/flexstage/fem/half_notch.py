"""Half of a notch in space, alone with a block of its body: its tractions, and its stress."""

import math
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import NamedTuple

import ngsolve as ng
import numpy as np
from netgen.occ import Glue, TopoDS_Shape
from numpy.typing import NDArray

from flexstage.arrays import Array
from flexstage.elasticity import Continuum, face
from flexstage.elasticity.loaded import COMPONENTS
from flexstage.elasticity.shapes import METRE
from flexstage.fem.constrained import PlanePart, factorised
from flexstage.fem.geometry import STRAINED, neck_edge, surface_edge
from flexstage.fem.layered_plate import LayeredPlate, PlaneIntegrals
from flexstage.fem.mesh import MESHER, MeshSettings, face_mesh
from flexstage.fem.neck_rows import edge_means, neck_rows, shaped
from flexstage.fem.necks import surface_points
from flexstage.fem.notch_tractions import motion_rows, neck_motions
from flexstage.fem.substructure import REFERENCE, CutNeck, Substructure
from flexstage.fem.surface_stress import layered_stress, surface_stress
from flexstage.fem.through_thickness import ThroughThickness
from flexstage.hinges import Profile
from flexstage.hinges.arcs import CurvedProfile
from flexstage.hinges.hinge_spring import PlaneState
from flexstage.stage import Hinge
from flexstage.stage.contour import half_notch, inner_notch
from flexstage.stage.hinge_attachment import hinge_root

_NAME, _BODY, _NOTCH, _CUT, _ROOT = "0", "body", "notch", "cut", "root"
_IN_PLANE = ((0, 0), (1, 1), (2, 2), (0, 1))  # components of stress in a plane
_NEAR = 1e-9  # two points are one [m]

#: How far from the mouth of a notch its functions reach into its body, in widths of the mouth.
REACH = 0.4
# How much finer the half notch alone is meshed than the body that it is a part of, and how fast its
# elements grow: stress is a derivative.
_FINER, _GRADING = 0.75, 0.5
_ALONG = 4  # elements along each piece of the contour at least


# A body is wider than a root by this much of the root's height, or as good as not.
_WIDER = 0.5


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
    """Which of the forces act along the hinge or turn about its middle, shape (r,)."""

    def of_half(self, which: int, direction: float) -> Array:
        """Return the stress of either half of a hinge in any direction [rad].

        `which` is 0 for the half on the first body, 1 for that on the second.
        """
        components = COMPONENTS if self.stress.shape[2] == 6 else _IN_PLANE
        stress = self.stress
        if which:  # mirrored, and so are forces along the hinge
            odd = np.array([(i == 0) != (j == 0) for i, j in components])
            stress = np.where(odd[:, None] != self.lengthwise, -stress, stress)
        c, s = math.cos(direction), math.sin(direction)
        turn = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
        mix = np.array(
            [
                [
                    turn[i, k] * turn[j, m] + (turn[i, m] * turn[j, k] if k != m else 0.0)
                    for k, m in components
                ]
                for i, j in components
            ]
        )
        return mix @ stress


class StressOfNecks(NamedTuple):
    """Stress of all half notches of a body, as `flexstage.fem.condensation.Condensed` has it."""

    stress: Array
    neck: NDArray[np.int64]
    point: NDArray[np.int64]
    seam: NDArray[np.int64]


def stress_of_necks(part: Substructure) -> StressOfNecks:
    """Return the stress of the half notches of a body by unit forces on them.

    What a body does to a notch beyond these forces is left out (Saint-Venant).
    """
    stage = part.stage()
    stresses, owner, points, seams, used = [], [], [], [], 0
    for i, (neck, hinge) in enumerate(zip(part.necks, stage.hinges, strict=True)):
        root = hinge_root(stage, hinge, neck.which)
        wide = any(
            math.dist(end, corner) > _WIDER * neck.profile.root_height
            for end, corner in zip(root.ends, root.edge, strict=True)
        )
        material = (part.mesh, part.poissons_ratio)
        if part.through is None:
            half = plane_stress(neck.profile, wide, neck.plane, part.thickness, *material)
        else:
            half = neck_stress(neck.profile, wide, part.through, *material)
        stress = half.of_half(neck.which, neck.direction)
        levels, places, components, _ = stress.shape
        level, count = np.arange(levels)[:, None], int(half.point.max()) + 1
        # the ends of the neck, where the other half begins
        ends = np.sign(half.place[:, 1]) * (np.abs(half.place[:, 0]) < _NEAR)
        stresses.append(stress.reshape(levels * places, components, -1))
        owner.append(np.full(levels * places, i))
        points.append((used + half.point + count * level).ravel())
        seams.append((ends * (level + 1)).ravel())
        used += count * levels
    nothing = np.zeros(0, dtype=np.int64)
    return StressOfNecks(
        np.concatenate(stresses) if stresses else np.zeros((0, len(_IN_PLANE), 0)),
        *(np.concatenate((nothing, *found)).astype(np.int64) for found in (owner, points, seams)),
    )


@lru_cache(maxsize=64)
def neck_tractions(
    profile: Profile, through: ThroughThickness, mesh: MeshSettings, poissons_ratio: float
) -> Array:
    r"""Return the part of tractions without resultant in each traction that a neck passes on.

    The neck stays plane about a notch that is the same on both sides: a pull or a moment leaves it
    plane, a shear force moves all of it alike. Of the flexibility F of the half notch with a block
    of its body, held at its far end, it is :math:`\lambda_e = -F_{ee}^{-1} F_{er}\lambda_r`, for
    pulled and sheared motions by themselves; shape (r, e).
    """
    _, rows, responses = _narrow(profile, through, mesh, poissons_ratio)
    flexibility = rows @ responses
    passed, rest, pulled, pulled_more = neck_motions(through, mesh.order)
    found = np.zeros((len(passed), len(rest)))
    r, e = len(passed), len(rest)
    for mine, others in (
        (np.arange(pulled), np.arange(pulled_more)),
        (np.arange(pulled, r), np.arange(pulled_more, e)),
    ):
        inner = flexibility[np.ix_(r + others, r + others)]
        right = flexibility[np.ix_(r + others, mine)]
        found[np.ix_(mine, others)] = -np.linalg.lstsq(inner, right, rcond=1e-10)[0].T
    return found


@lru_cache(maxsize=128)
def neck_stress(
    profile: Profile,
    wide: bool,
    through: ThroughThickness,
    mesh: MeshSettings,
    poissons_ratio: float,
) -> NeckStress:
    """Return the stress of half a notch by unit forces on its neck.

    `wide` tells whether the body is wider than the root.
    """
    fine = replace(through, fine=not through.out_of_plane)
    mix = neck_tractions(profile, fine, mesh, poissons_ratio)
    mix = np.hstack((np.eye(len(mix)), mix))
    if wide:
        plate, rows = _block(profile, True, fine, mesh, poissons_ratio)
        u = factorised(plate.stiffness).solve(np.ascontiguousarray((mix @ rows).T))
    else:
        plate, _, responses = _narrow(profile, fine, mesh, poissons_ratio)
        u = responses @ mix.T
    with MESHER:
        points = surface_points(plate.plane.mesh, (_NAME,))
        stress = layered_stress(plate, points, u)
    return NeckStress(
        place=points.position[:, :2],
        point=points.point,
        stress=stress,
        lengthwise=np.array([m.direction == 0 for m in neck_motions(through, mesh.order)[0]]),
    )


@lru_cache(maxsize=128)
def plane_stress(
    profile: Profile,
    wide: bool,
    plane: PlaneState,
    thickness: float,
    mesh: MeshSettings,
    poissons_ratio: float,
) -> NeckStress:
    """Return the stress of half a notch in a plane by unit forces on its neck, as `neck_stress`."""
    meshed, neck = _meshed(profile, wide, thickness, mesh)
    continuum = Continuum(
        meshed,
        replace(REFERENCE, poissons_ratio=poissons_ratio),
        order=mesh.order,
        thickness=thickness,
        strain=_NOTCH if plane == "strain" else "",
        held=_ROOT,
    )
    beam, normal, shear = neck_rows(neck, edge_means(meshed, mesh.order, [neck])[0])
    rows = np.concatenate((beam, normal, shear))
    part = PlanePart(continuum)
    responses = np.zeros((part.size, len(rows)))
    responses[part.free] = factorised(part.stiffness).solve(rows.T[part.free])
    _, responses = shaped(rows, responses, [(len(normal), len(shear))])
    points = surface_points(meshed, (_NAME,))
    return NeckStress(
        place=points.position[:, :2],
        point=points.point,
        stress=surface_stress(continuum, points, responses)[None],
        lengthwise=np.array([True, False, True]),
    )


@lru_cache(maxsize=4)
def _narrow(
    profile: Profile, through: ThroughThickness, mesh: MeshSettings, poissons_ratio: float
) -> tuple[LayeredPlate, Array, Array]:
    """Return the half notch in a body as wide as its root, with motions of its neck, responses."""
    plate, rows = _block(profile, False, through, mesh, poissons_ratio)
    return plate, rows, factorised(plate.stiffness).solve(np.ascontiguousarray(rows.T))


def _block(
    profile: Profile,
    wide: bool,
    through: ThroughThickness,
    mesh: MeshSettings,
    poissons_ratio: float,
) -> tuple[LayeredPlate, Array]:
    """Return half a notch with a block of its body, and the motions of its neck."""
    with MESHER:
        plane, means = _integrals(profile, wide, through.thickness, mesh)
    material = replace(REFERENCE, poissons_ratio=poissons_ratio)
    reach = profile.length / 2.0 + REACH * profile.root_height
    plate = LayeredPlate(plane, material, through, [(_NOTCH, (0.0, 0.0), reach)])
    passed, rest, _, _ = neck_motions(through, mesh.order)
    return plate, motion_rows(plate, means, (*passed, *rest))


@lru_cache(maxsize=4)
def _integrals(
    profile: Profile, wide: bool, thickness: float, mesh: MeshSettings
) -> tuple[PlaneIntegrals, Array]:
    meshed, neck = _meshed(profile, wide, thickness, mesh)
    plane = PlaneIntegrals(meshed, order=mesh.order, held=_ROOT)
    return plane, edge_means(meshed, mesh.order, [neck])[0]


def _meshed(
    profile: Profile, wide: bool, thickness: float, mesh: MeshSettings
) -> tuple[ng.Mesh, CutNeck]:
    fine = replace(mesh, neck_size=_FINER * mesh.neck_size, grading=min(mesh.grading, _GRADING))
    hinge = Hinge(name=_NAME, bodies=("", " "), at=(0.0, 0.0), direction=0.0, profile=profile)
    shape = _shape(hinge, wide, fine.neck_size * profile.neck_thickness)
    neck = CutNeck(
        at=(0.0, 0.0), direction=0.0, which=0, profile=profile, contour=(), plane="stress"
    )
    return face_mesh(shape, thickness, fine), neck


def _shape(hinge: Hinge, wide: bool, size: float) -> TopoDS_Shape:
    """Return half of a notch with a block of its body, which is held at its far end."""
    profile = hinge.profile
    # a fillet may be shorter than the neck is thick; arcs for a curve are short by themselves
    along = 1 if isinstance(profile, CurvedProfile) else _ALONG
    loop = half_notch(hinge, 0)
    height = profile.root_height
    top = profile.neck_thickness / 2.0 + profile.depth
    low = -profile.neck_thickness / 2.0 if profile.one_sided else -top
    root = -profile.length / 2.0
    far = root - height * (1.0 if wide else 0.5)
    points, bends = [], []
    for a, b, bulge in loop.segments():
        points.append(a)
        bends.append(bulge)
        if abs(a[0] - root) < _NEAR and abs(b[0] - root) < _NEAR:
            # the root gives way to the block
            block = [(far, top), (far, low)]
            if wide:
                left, right = top + height, low - height
                block = [(root, left), (far, left), (far, right), (root, right)]
            points += block
            bends += [0.0] * len(block)
    shape = face(points, bends)
    shape.name = _BODY
    # as of a stage, see `flexstage.fem.geometry.STRAINED`
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
