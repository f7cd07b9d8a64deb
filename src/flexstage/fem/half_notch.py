"""Half of a notch in space, alone with a block of its body: its tractions, and its stress."""

import math
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from netgen.occ import TopoDS_Shape
from numpy.typing import NDArray

from flexstage.arrays import Array
from flexstage.elasticity import face
from flexstage.elasticity.loaded import COMPONENTS
from flexstage.elasticity.shapes import METRE
from flexstage.fem.condensation import slopes_at
from flexstage.fem.constrained import factorised
from flexstage.fem.geometry import neck_edge, surface_edge
from flexstage.fem.layered_plate import LayeredPlate, PlaneIntegrals
from flexstage.fem.mesh import MeshSettings, face_mesh
from flexstage.fem.neck_rows import edge_means
from flexstage.fem.necks import NeckPoints, surface_points
from flexstage.fem.notch_tractions import motion_rows, neck_motions
from flexstage.fem.substructure import REFERENCE, CutNeck
from flexstage.fem.through_thickness import ThroughThickness
from flexstage.hinges import Profile
from flexstage.stage import Hinge
from flexstage.stage.contour import half_notch

_NAME, _ROOT = "0", "root"
_NEAR = 1e-9  # two points are one [m]

#: Places through half of the thickness where the stress is looked for, in parts of it.
LEVELS = (0.0, 0.25, 0.5, 0.75, 1.0)

# How much finer the half notch alone is meshed than the body that it is a part of, and how fast its
# elements grow: stress is a derivative.
_FINER, _GRADING = 0.6, 0.5


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
    """Components xx, yy, zz, yz, xz, xy for unit forces on the neck, level by level, shape
    (l, m, 6, r)."""
    lengthwise: NDArray[np.bool_]
    """Which of the forces act along the hinge, shape (r,)."""

    def of_half(self, which: int, direction: float) -> Array:
        """Return the stress of either half of a hinge in any direction [rad].

        `which` is 0 for the half on the first body, 1 for that on the second.
        """
        stress = self.stress
        if which:  # mirrored, and so are forces along the hinge
            odd = np.array([(i == 0) != (j == 0) for i, j in COMPONENTS])
            stress = np.where(odd[:, None] != self.lengthwise, -stress, stress)
        c, s = math.cos(direction), math.sin(direction)
        turn = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
        mix = np.zeros((6, 6))
        for a, (i, j) in enumerate(COMPONENTS):
            for b, (k, m) in enumerate(COMPONENTS):
                mix[a, b] = turn[i, k] * turn[j, m]
                if k != m:
                    mix[a, b] += turn[i, m] * turn[j, k]
        return mix @ stress


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
    _, rows, responses = _block(profile, (False, False), through, mesh, poissons_ratio)
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
    beyond: tuple[bool, bool],
    through: ThroughThickness,
    mesh: MeshSettings,
    poissons_ratio: float,
) -> NeckStress:
    """Return the stress of half a notch by unit forces on its neck.

    What its body does to it beyond these is left out (Saint-Venant). `beyond` tells whether the
    body is wider than the root, to the right and to the left of the hinge.
    """
    plate, _, responses = _block(profile, beyond, through, mesh, poissons_ratio)
    passed, _, _, _ = neck_motions(through, mesh.order)
    r = len(passed)
    mix = neck_tractions(profile, through, mesh, poissons_ratio)
    points = surface_points(plate.plane.mesh, (_NAME,))
    return NeckStress(
        place=points.position[:, :2],
        point=points.point,
        stress=surface_stress(plate, points, responses[:, :r] + responses[:, r:] @ mix.T),
        lengthwise=np.array([motion.direction == 0 for motion in passed]),
    )


@lru_cache(maxsize=4)
def _block(
    profile: Profile,
    beyond: tuple[bool, bool],
    through: ThroughThickness,
    mesh: MeshSettings,
    poissons_ratio: float,
) -> tuple[LayeredPlate, Array, Array]:
    """Return half a notch with a block of its body, the motions of its neck, and the responses."""
    fine = replace(mesh, neck_size=_FINER * mesh.neck_size, grading=min(mesh.grading, _GRADING))
    plane, means = _meshed(profile, beyond, through.thickness, fine)
    material = replace(REFERENCE, poissons_ratio=poissons_ratio)
    plate = LayeredPlate(plane, material, through, [("notch", (0.0, 0.0), 0.0)])
    passed, rest, _, _ = neck_motions(through, mesh.order)
    rows = motion_rows(plate, means, (*passed, *rest))
    return plate, rows, factorised(plate.stiffness).solve(np.ascontiguousarray(rows.T))


@lru_cache(maxsize=4)
def _meshed(
    profile: Profile, beyond: tuple[bool, bool], thickness: float, mesh: MeshSettings
) -> tuple[PlaneIntegrals, Array]:
    hinge = Hinge(name=_NAME, bodies=("", " "), at=(0.0, 0.0), direction=0.0, profile=profile)
    shape = _shape(hinge, beyond, mesh.neck_size * profile.neck_thickness)
    meshed = face_mesh(shape, thickness, mesh)
    neck = CutNeck(
        at=(0.0, 0.0), direction=0.0, which=0, profile=profile, contour=(), plane="stress"
    )
    plane = PlaneIntegrals(meshed, order=mesh.order, held=_ROOT)
    return plane, edge_means(meshed, mesh.order, [neck])[0]


def _shape(hinge: Hinge, beyond: tuple[bool, bool], size: float) -> TopoDS_Shape:
    """Return half of a notch with a block of its body, which is held at its far end."""
    profile = hinge.profile
    loop = half_notch(hinge, 0)
    height = profile.root_height
    top = profile.neck_thickness / 2.0 + profile.depth
    low = -profile.neck_thickness / 2.0 if profile.one_sided else -top
    root = -profile.length / 2.0
    far = root - height * (1.0 if any(beyond) else 0.5)
    points, bends = [], []
    for a, b, bulge in loop.segments():
        points.append(a)
        bends.append(bulge)
        if abs(a[0] - root) < _NEAR and abs(b[0] - root) < _NEAR:
            # the root gives way to the block
            right, left = (height if wide else 0.0 for wide in beyond)
            block = [(far, top + left), (far, low - right)]
            block = [(root, top + left)] * bool(left) + block
            block += [(root, low - right)] * bool(right)
            points += block
            bends += [0.0] * len(block)
    shape = face(points, bends)
    shape.name = "notch"
    for edge in shape.edges:
        ends = [edge.start.x / METRE, edge.end.x / METRE]
        if max(map(abs, ends)) < _NEAR:
            edge.name = neck_edge(hinge.name)
        elif max(abs(x - far) for x in ends) < _NEAR:
            edge.name = _ROOT
        elif min(ends) > root - _NEAR and max(ends) > root + _NEAR:
            edge.name = surface_edge(hinge.name)
            edge.maxh = size * METRE
    return shape


def surface_stress(plate: LayeredPlate, points: NeckPoints, basis: Array) -> Array:
    """Return the stress of displacements at the points of the notches, level by level.

    Components xx, yy, zz, yz, xz, xy [Pa], shape (l, m, 6, r).
    """
    r = basis.shape[1]
    through = plate.through
    parts = through.components
    fields = plate.expanded(basis)
    values, slopes = slopes_at(points, plate.plane.mesh, plate.plane.order, fields)
    z = np.array(LEVELS) * through.thickness / 2.0
    functions = through.values_at(z)
    gradient = np.zeros((z.size, len(values), 3, 3, r))  # of displacement i along j
    for i, (d, kind, k) in enumerate(parts):
        value, slope = (f[k][:, None, None] for f in functions[kind])
        gradient[:, :, d, 0] += value * slopes[None, :, i, :, 0]
        gradient[:, :, d, 1] += value * slopes[None, :, i, :, 1]
        gradient[:, :, d, 2] += slope * values[None, :, i]
    gradient = gradient.reshape(-1, 3, 3, r)
    modulus, poisson = plate.material.youngs_modulus, plate.material.poissons_ratio
    shear = modulus / (2.0 * (1.0 + poisson))
    lame = modulus * poisson / ((1.0 + poisson) * (1.0 - 2.0 * poisson))
    volume = lame * np.einsum("miir->mr", gradient)
    found = np.stack(
        [
            (volume if i == j else 0.0) + shear * (gradient[:, i, j] + gradient[:, j, i])
            for i, j in COMPONENTS
        ],
        axis=1,
    )
    return found.reshape(z.size, -1, 6, r)
