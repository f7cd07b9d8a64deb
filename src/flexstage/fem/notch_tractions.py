"""How tractions pass through a neck in space: of the half notch alone, once for each profile."""

from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from netgen.occ import TopoDS_Shape

from flexstage.arrays import Array
from flexstage.elasticity import face
from flexstage.elasticity.shapes import METRE
from flexstage.fem.constrained import factorised
from flexstage.fem.geometry import STRAINED, neck_edge
from flexstage.fem.layered_plate import LayeredPlate, PlaneIntegrals
from flexstage.fem.mesh import MeshSettings, face_mesh
from flexstage.fem.neck_rows import edge_means, neck_weights
from flexstage.fem.substructure import REFERENCE, CutNeck
from flexstage.fem.through_thickness import ThroughThickness
from flexstage.hinges import Profile
from flexstage.stage import Hinge
from flexstage.stage.contour import inner_notch

_ROOT = "root"
_NEAR = 1e-9  # two points are one [m]


@dataclass(frozen=True, slots=True, kw_only=True)
class NeckMotion:
    """A mean over a neck: of one displacement with a function through the thickness."""

    direction: int
    """0 along the hinge, 1 across it, 2 through the plate."""
    function: int
    """Number of the function through the thickness."""
    weight: tuple[float, ...]
    """Weight over the neck by the powers of eta, -1 to 1 across."""


@lru_cache(maxsize=64)
def neck_motions(
    through: ThroughThickness, degree: int
) -> tuple[tuple[NeckMotion, ...], tuple[NeckMotion, ...], int, int]:
    """Return the motions that necks pass on, and those without resultant, each pulled then sheared.

    Pulled are those along the hinge, sheared the others; the numbers say how many of each are
    pulled. The motions that are passed on come in the order of
    `flexstage.fem.plate_condensation.neck_coordinates`.
    """
    beam, normal, shear = (table.tolist() for table in neck_weights(degree))
    mean, parabola, turn = beam
    slope = [-w for w in turn]
    plane, across = through.functions["plane"], through.functions["across"]

    def motions(direction: int, numbers: range, weights: list[list[float]]) -> list[NeckMotion]:
        return [
            NeckMotion(direction=direction, function=k, weight=tuple(w))
            for k in numbers
            for w in weights
        ]

    both, more = range(plane.passed), range(plane.passed, len(plane.values))
    own, others = range(across.passed), range(across.passed, len(across.values))
    pulled = motions(0, both, [mean, turn])
    sheared = motions(1, both, [parabola]) + motions(2, own, [mean, slope])
    pulled_more = motions(0, range(len(plane.values)), normal) + motions(0, more, [mean, turn])
    sheared_more = (
        motions(1, range(len(plane.values)), shear)
        + motions(1, more, [parabola])
        + motions(2, range(len(across.values)), normal)
        + motions(2, others, [mean, slope])
    )
    return (
        (*pulled, *sheared),
        (*pulled_more, *sheared_more),
        len(pulled),
        len(pulled_more),
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
    material = replace(REFERENCE, poissons_ratio=poissons_ratio)
    hinge = Hinge(name="0", bodies=("", " "), at=(0.0, 0.0), direction=0.0, profile=profile)
    shape = _half_notch(hinge, mesh.neck_size * profile.neck_thickness)
    meshed = face_mesh(shape, through.thickness, mesh)
    plane = PlaneIntegrals(meshed, order=mesh.order, held=_ROOT)
    plate = LayeredPlate(plane, material, through, [("notch", (0.0, 0.0), 0.0)])
    neck = CutNeck(
        at=(0.0, 0.0), direction=0.0, which=0, profile=profile, contour=(), plane="stress"
    )
    means = edge_means(meshed, mesh.order, [neck])[0]
    passed, rest, pulled, pulled_more = neck_motions(through, mesh.order)
    rows = motion_rows(plate, means, (*passed, *rest))
    factor = factorised(plate.stiffness)
    flexibility = rows @ factor.solve(np.ascontiguousarray(rows.T))
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


def _half_notch(hinge: Hinge, size: float) -> TopoDS_Shape:
    """Return half of a notch with a block of its body, which is held at its far end."""
    loop = inner_notch(hinge, 0, STRAINED)
    height = hinge.profile.neck_thickness / 2.0 + hinge.profile.depth
    root, far = -hinge.profile.length / 2.0, -hinge.profile.length / 2.0 - height
    low = -hinge.profile.neck_thickness / 2.0 if hinge.profile.one_sided else -height
    bulges = loop.bulges or (0.0,) * len(loop.points)
    # the cut gives way to the block
    cut = next(
        k
        for k, (a, b, _) in enumerate(loop.segments())
        if abs(a[0] - b[0]) < _NEAR and abs(a[0]) > _NEAR
    )
    block = ((root, height), (far, height), (far, low), (root, low))
    points = (*loop.points[: cut + 1], *block, *loop.points[cut + 1 :])
    bends = (*bulges[: cut + 1], 0.0, 0.0, 0.0, 0.0, *bulges[cut + 1 :])
    shape = face(points, bends)
    shape.name = "notch"
    for edge in shape.edges:
        ends = [edge.start.x / METRE, edge.end.x / METRE]
        if max(map(abs, ends)) < _NEAR:
            edge.name = neck_edge(hinge.name)
        elif max(abs(x - far) for x in ends) < _NEAR:
            edge.name = _ROOT
        elif min(ends) > root - _NEAR:
            edge.maxh = size * METRE
    return shape


def motion_rows(
    plate: LayeredPlate,
    means: Array,
    motions: tuple[NeckMotion, ...],
    direction: tuple[float, float] = (1.0, 0.0),
) -> Array:
    """Return motions of a neck as rows of a plate, shape (m, n).

    `means` are those of `flexstage.fem.neck_rows.edge_means`, `direction` is the hinge's.
    """
    c, s = direction
    axes = (((0, c), (1, s)), ((0, -s), (1, c)), ((2, 1.0),))
    field = {(d, k): i for i, (d, _, k) in enumerate(plate.through.components)}
    found = np.zeros((len(motions), len(field), plate.plane.width))
    for row, motion in zip(found, motions, strict=True):
        weights = np.array(motion.weight) @ means / np.sqrt(plate.through.thickness)
        for d, factor in axes[motion.direction]:
            row[field[d, motion.function]] += factor * weights
    return plate.gathered(found)
