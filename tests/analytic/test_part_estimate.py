"""What a mesh is expected to be, beside what it becomes; and the triangles that tell it."""

import math

import numpy as np
import pytest
from netgen import occ

from flexstage.fem.part import Part
from flexstage.fem.part_estimate import estimate_part, part_surface
from flexstage.fem.part_mesh import PartMesh


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
