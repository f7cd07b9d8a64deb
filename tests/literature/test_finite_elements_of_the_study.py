"""The study's two stages against the finite-element figures that it publishes.

Evidence (The two stages of the study): output, stress, frequency (finite elements of the study):
`plane` 0.3, 1.0, 0.6 %; `solid` 0.2, 0.9, 0.2 %; *fitted* [`solid` *slow*, *evidence*]
"""

import numpy as np
import pytest

from flexstage.fem import plane_model
from flexstage.stage.designs import design
from flexstage.system import MechanicalSystem, analyse
from tests.solved_stages import solved

STAGES = ("vgtu-piezo", "vgtu-mechanical")

# In the plane the notches are in plane strain and the bodies in plane stress: a choice that costs
# up to 1 % against three dimensions; stress at a mid-neck vertex scatters by 1 % with the mesh.
PLANE = {"output_displacement": 0.01, "natural_frequency_hz": 0.01, "max_stress": 0.02}
# The geometry was found by fitting three-dimensional elements to these figures, to 0.15 % in
# displacement and frequency; the rest is what mesh and reading (at the middle of the aperture, not
# the centre of mass of the platform, 4 mm aside) may differ.
SOLID = {"output_displacement": 0.003, "natural_frequency_hz": 0.003, "max_stress": 0.02}


def _compare(name: str, system: MechanicalSystem, allowed: dict[str, float]) -> None:
    stage = design(name)
    found = analyse(stage, system).characteristics
    published = [row for row in stage.published if row.origin == "published-fem"]
    seen = 0
    for row in published:
        if row.quantity in allowed:
            ours = found.value(row.quantity, row.axis)
            assert ours == pytest.approx(row.value, rel=allowed[row.quantity]), row
            seen += 1
    assert seen == 6  # displacement, stress and frequency of two axes


@pytest.mark.parametrize(
    "name", ["vgtu-piezo", pytest.param("vgtu-mechanical", marks=pytest.mark.slow)]
)
def test_in_the_plane(name: str) -> None:
    # of no more modes than are compared
    system = plane_model(design(name), modes=4).system
    _compare(name, system, PLANE)
    # what the frame gives way by is left out as in the study, but can be had
    assert system.settings["supports"] == "rigid"


@pytest.mark.parametrize(
    "name",
    [
        pytest.param("vgtu-piezo", marks=pytest.mark.slow),
        pytest.param("vgtu-mechanical", marks=pytest.mark.evidence),
    ],
)
def test_in_three_dimensions(name: str) -> None:
    system = solved(name, "solid").analysis.system
    _compare(name, system, SOLID)
    omega = np.sqrt(np.diag(system.K))
    out = [c.startswith("out of plane") for c in system.coordinates]
    lowest = omega[out].min() / (2.0 * np.pi)
    # with the inputs locked the lowest mode of the mechanical stage is out of plane, at 801 Hz by
    # an independent calculation with full-thickness prisms; ours is nearer, as two half models are
    # finer through the thickness
    expected = {"vgtu-mechanical": 801.0, "vgtu-piezo": 676.6}[name]
    assert lowest == pytest.approx(expected, rel=0.003)


@pytest.mark.slow
def test_the_frame_gives_way_under_the_drive() -> None:
    stage = design("vgtu-piezo")
    firm, soft = (
        {
            r.axis: r.value
            for r in analyse(stage, m.system).characteristics.select("transmission_ratio")
        }
        for m in (plane_model(stage), plane_model(stage, supports="elastic"))
    )
    # the stack of x reacts on the frame, that of y on the x platform
    assert 0.02 < 1.0 - soft["x"] / firm["x"] < 0.03
    assert soft["y"] == pytest.approx(firm["y"], rel=1e-9)
