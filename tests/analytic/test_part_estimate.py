"""What a mesh is expected to be, beside what it becomes; and the triangles that tell it.

Evidence (Finite elements): mesh size estimate: 0.7 to 1.4, shell 1.8
"""

import math
from dataclasses import replace

import ngsolve as ng
import numpy as np
import pytest
from netgen import occ

from flexstage.fem import part_mesh
from flexstage.fem.part import Part, part_surface
from flexstage.fem.part_estimate import estimate_part
from flexstage.fem.part_mesh import PartMesh, first_hits


def block() -> Part:
    return Part.from_shape(occ.Box((0, 0, 0), (30.0, 20.0, 25.0)))


def notched() -> Part:
    shape = (
        occ.Box((0, 0, 0), (40, 12, 10))
        - occ.Cylinder((20, -4, -1), occ.Z, 5, 20)
        - occ.Cylinder((20, 16.5, -1), occ.Z, 5.5, 20)
    )
    return Part.from_shape(shape.solids[0])


def tube() -> Part:
    shape = occ.Cylinder((0, 0, 0), occ.Z, 8.0, 11.0) - occ.Cylinder((0, 0, -1), occ.Z, 7.1, 13.0)
    return Part.from_shape(shape.solids[0])


@pytest.mark.parametrize(
    ("part", "mesh", "most"),
    [
        pytest.param(block(), PartMesh(order=2, size=3e-3), 1.4, marks=pytest.mark.slow),
        (notched(), PartMesh(order=3, size=2.5e-3), 1.4),
        # a shell has the fewest elements for its surface
        pytest.param(tube(), PartMesh(order=2), 1.8, marks=pytest.mark.slow),
    ],
)
def test_a_mesh_is_about_what_was_expected(part: Part, mesh: PartMesh, most: float) -> None:
    import ngsolve as ng

    expected = estimate_part(part, mesh)
    made = part.mesh(mesh)
    assert 0.7 < expected.elements / made.ne < most
    assert 0.7 < expected.unknowns / ng.VectorH1(made, order=mesh.order).ndof < most


def test_what_is_expected_grows_as_it_must() -> None:
    part = block()
    once = estimate_part(part, PartMesh(size=1e-3))
    finer = estimate_part(part, PartMesh(size=0.5e-3))
    assert finer.elements == pytest.approx(8.0 * once.elements, rel=0.05)
    # nested dissection: memory as n^(4/3)
    assert finer.memory > 14.0 * once.memory
    assert estimate_part(part, PartMesh(size=1e-3), factorisations=3).seconds > 2.5 * once.seconds
    higher = estimate_part(part, PartMesh(order=4, size=1e-3))
    assert higher.elements == once.elements
    assert 2.0 < higher.unknowns / once.unknowns < 2.6  # (4/3)^3 = 2.4 for many elements


def test_thin_walls_and_round_faces_are_expected_to_need_more() -> None:
    part = notched()
    plain = estimate_part(part, PartMesh(thin=0.0)).elements
    assert estimate_part(part, PartMesh(thin=0.5)).elements > 2.0 * plain
    assert estimate_part(part, PartMesh(thin=0.0, curvature=4.0)).elements > 3.0 * plain
    (top,) = part.select("z", "max")
    assert estimate_part(part, PartMesh(thin=0.0, sizes={top: 0.5e-3})).elements > 3.0 * plain


def test_the_surface_is_closed_and_looks_outwards() -> None:
    for part in (block(), notched(), tube()):
        surface = part_surface(part)
        vectors = surface.area_vectors
        size = math.dist(*part.bounding_box)
        assert abs(vectors.sum(axis=0)).max() < 1e-5 * size**2
        volume = np.einsum("tx,tx->", surface.triangles.mean(axis=1), vectors) / 3.0
        assert volume == pytest.approx(part.volume, rel=0.02)
        areas = np.bincount(surface.face, weights=np.linalg.norm(vectors, axis=1))
        assert areas == pytest.approx([f.area for f in part.faces], rel=0.02)


def test_rays_go_to_the_first_triangle_that_looks_back() -> None:
    """Two tilted triangles over each other, of planes in closed form, and one that looks away."""
    plane = np.array([[0.0, 0.0], [4.0, 0.3], [0.7, 5.0]])
    layers = [2.0 + 0.11 * plane @ (1.0, -0.6), 3.0 + 0.07 * plane @ (-0.5, 1.0)]
    triangles = np.array([np.column_stack((plane, z)) for z in layers])
    normal = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    normal /= np.linalg.norm(normal, axis=1)[:, None]
    at = np.array([[0.9, 0.8], [1.9, 1.3], [0.9, 3.1], [3.9, 4.8]])  # the last one is outside
    starts = np.column_stack((at, np.zeros(4)))[None]
    up = np.array([[0.0, 0.0, 1.0]])
    expected = 2.0 + 0.11 * at @ (1.0, -0.6)
    found = first_hits(triangles, normal, starts, up, 9.0)[0]
    assert found[:3] == pytest.approx(expected[:3], rel=1e-12)
    assert found[3] == np.inf
    # the lower one turned over is looked through; beyond the limit there is nothing
    turned = first_hits(triangles, normal * [[-1.0], [1.0]], starts, up, 9.0)[0]
    assert turned[:3] == pytest.approx((3.0 + 0.07 * at @ (-0.5, 1.0))[:3], rel=1e-12)
    assert np.all(first_hits(triangles, normal, starts, up, 1.5) == np.inf)


def test_elements_that_were_folded_keep_their_corners(monkeypatch: pytest.MonkeyPatch) -> None:
    """A tube of too few elements: curving folds some, and it is as high and wide as before."""
    monkeypatch.setattr(part_mesh, "_LIMITS", replace(part_mesh._LIMITS, straightened=1.0))
    shape = occ.Cylinder((0, 0, 0), occ.Z, 10, 5) - occ.Cylinder((0, 0, 0), occ.Z, 9.5, 5)
    made = occ.OCCGeometry(shape).GenerateMesh(
        maxh=6.0, curvaturesafety=0.5, grading=0.9, parallel_meshing=False
    )
    mesh = ng.Mesh(made)
    mesh.Curve(2)
    rule = ng.IntegrationRule(ng.ET.TET, 4)
    assert len(part_mesh._folded(mesh, rule))
    assert part_mesh.straighten_folded(mesh, 2)
    assert not len(part_mesh._folded(mesh, rule))
    places = ng.CoefficientFunction((ng.x, ng.y, ng.z))(mesh.MapToAllElements(rule, ng.VOL))
    assert np.hypot(places[:, 0], places[:, 1]).max() < 10.0
    assert 0.0 < places[:, 2].min() < places[:, 2].max() < 5.0
