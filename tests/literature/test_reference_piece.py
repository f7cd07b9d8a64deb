"""One circular hinge between two blocks, against converged values of other codes.

The values are those on which NGSolve, CalculiX and scikit-fem or Kratos agreed when the piece was
chosen, to 0.02 % in the plane and to 0.05 % in three dimensions; see `tests/peers` for the piece.

Evidence (Finite elements): reference hinge (NGSolve, the same library; CalculiX, others): 0.001 %,
stress 0.01 % in the plane, 0.02 % in space
"""

import numpy as np
import pytest

from flexstage.elasticity import Continuum
from tests.peers import reference_piece as piece

PLANE_STRESS = {
    "compliance": 24.2839e-6,
    "frequencies": (900.898, 21269.3, 30540.9),
    "stress": 30.2336e6,
}
PLANE_STRAIN_COMPLIANCE = 21.640e-6
SOLID = {"compliance": 21.988e-6, "frequencies": (946.76, 8331.5, 9449.0), "stress": 28.20e6}


def _plane(strain: str) -> tuple[Continuum, np.ndarray, float]:
    mesh = piece.plane_mesh(6, neck_size=0.6)
    part = Continuum(
        mesh, piece.MATERIAL, order=6, thickness=piece.THICKNESS, fixed="left", strain=strain
    )
    reading = part.mean("right", (0.0, 1.0))
    u = part.solve(reading)
    return part, u, float(reading @ u)


def test_plane_stress() -> None:
    part, u, compliance = _plane("")
    frequencies = part.modes(3)[0] / (2.0 * np.pi)
    # the agreement of the codes that the values come from
    assert compliance == pytest.approx(PLANE_STRESS["compliance"], rel=2e-4)
    assert frequencies == pytest.approx(PLANE_STRESS["frequencies"], rel=2e-4)
    assert piece.peak_stress(part, u, 33) == pytest.approx(PLANE_STRESS["stress"], rel=2e-4)


def test_plane_strain() -> None:
    compliance = _plane(".*")[2]
    assert compliance == pytest.approx(PLANE_STRAIN_COMPLIANCE, rel=2e-4)


def _solid(
    order: int, *, neck_size: float, size: float, grading: float
) -> tuple[float, np.ndarray, float]:
    """Compliance, frequencies, stress; a thin layer of prisms lies below the face of the plate."""
    mesh = piece.prism_mesh(
        order, neck_size=neck_size, size=size, grading=grading, levels=(0.0, 0.8, 1.0)
    )
    # motion in the plane is symmetric about the middle of the plate, motion out of it the opposite
    inside, outside = (
        Continuum(
            mesh,
            piece.MATERIAL,
            order=order,
            fixed="left",
            fixed_components=dict.fromkeys(components, "middle"),
            copies=2,
        )
        for components in ("z", "xy")
    )
    reading = inside.mean("right", (0.0, 1.0))
    u = inside.solve(reading)
    omega = np.concatenate((inside.modes(1)[0], outside.modes(2)[0]))
    return float(reading @ u), omega / (2.0 * np.pi), piece.peak_stress(inside, u)


def test_solid() -> None:
    compliance, frequencies, stress = _solid(4, neck_size=0.8, size=10e-3, grading=0.9)
    assert compliance == pytest.approx(SOLID["compliance"], rel=1e-3)
    assert frequencies == pytest.approx(SOLID["frequencies"], rel=1e-3)
    # the largest stress lies in the thin layer, and is what such a coarse mesh finds last
    assert stress == pytest.approx(SOLID["stress"], rel=1e-2)


@pytest.mark.slow
def test_solid_on_a_fine_mesh() -> None:
    compliance, frequencies, stress = _solid(5, neck_size=1.0, size=4e-3, grading=0.5)
    # five figures of compliance are given, and four of stress
    assert compliance == pytest.approx(SOLID["compliance"], rel=1e-4)
    assert frequencies == pytest.approx(SOLID["frequencies"], rel=2e-4)
    assert stress == pytest.approx(SOLID["stress"], rel=1e-3)
