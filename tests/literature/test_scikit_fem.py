"""The circular hinge in scikit-fem: quadratic triangles, another assembly, another solver."""

import pytest

from tests.peers import reference_piece as piece
from tests.peers import scikit_fem
from tests.peers.grids import triangles


@pytest.mark.parametrize("plane_strain", [False, True])
def test_circular_hinge(plane_strain: bool) -> None:
    grid = triangles(piece.plane_mesh(5, neck_size=0.15, size=1e-3))
    theirs = scikit_fem.solve(
        grid,
        piece.MATERIAL,
        thickness=piece.THICKNESS,
        plane_strain=plane_strain,
        held=lambda x: piece.on_left(x.T),
        loaded=lambda x: piece.on_right(x.T),
    )
    ours = piece.by_flexstage(
        5, neck_size=0.8, size=4e-3, grading=0.5, strain=".*" * plane_strain, modes=3
    )
    # quadratic triangles of this size lack 0.07 % of the compliance
    assert theirs.compliance == pytest.approx(ours.compliance, rel=1e-3)
    assert theirs.frequencies == pytest.approx(ours.frequencies, rel=1e-3)
    assert theirs.peak_stress == pytest.approx(ours.stress, rel=5e-3)
