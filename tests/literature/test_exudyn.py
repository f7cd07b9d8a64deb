r"""The same mechanism in an independent multibody code.

EXUDYN (J. Gerstmayr, Multibody Syst. Dyn. 2023) is given bodies, neck positions and hinge
stiffness, and derives, assembles and linearises the equations by itself.

Evidence (Stages, tolerances, designs): six frequencies of three stages (EXUDYN, given bodies,
necks, stiffness): $1.1\cdot10^{-11}$; finite rotation of a parallelogram: $10^{-8}$ [*slow*]
"""

import numpy as np
import pytest

from flexstage.lumped import equilibrium, lumped_system, mechanism, nonlinear
from flexstage.stage.designs import design
from flexstage.system import modes
from tests.mechanisms import chain, parallelogram

pytestmark = pytest.mark.slow

pytest.importorskip("exudyn", reason="EXUDYN is not installed: pip install 'flexstage[verify]'")

from benchmarks.exudyn_model import ExudynModel  # noqa: E402  (after the skip)


@pytest.mark.parametrize("name", ["vgtu-piezo", "vgtu-mechanical", "parallelogram"])
def test_frequencies_of_stages(name: str) -> None:
    stage = design(name)
    ours = modes(lumped_system(stage), count=6).frequency_hz
    theirs = ExudynModel(mechanism(stage)).frequencies()[: ours.size]
    # both find eigenvalues of the same mechanism; EXUDYN's tangent is a numerical difference
    assert np.allclose(theirs, ours, rtol=1e-6)


def test_every_frequency_of_a_chain_at_odd_angles() -> None:
    source = chain(5)
    model = nonlinear(source)
    stiffness = model.tangent(np.zeros(model.order))
    root = 1.0 / np.sqrt(model.mass)
    ours = np.sqrt(np.linalg.eigvalsh(stiffness * np.outer(root, root))) / (2.0 * np.pi)
    assert np.allclose(ExudynModel(source).frequencies(), ours, rtol=1e-6)


def test_finite_rotation_of_a_parallelogram() -> None:
    # necks stiff in translation: then it has no effect in which frame a hinge's translation is seen
    # (EXUDYN: that of the first body, here: the mean rotation); 0.9 mm on legs of 21 mm
    source = parallelogram(along=1e10, across=6e9)
    ours = equilibrium(nonlinear(source), {}, forces={"push": 60.0}).q
    theirs = ExudynModel(source, {"push": 60.0}).static(steps=10, tolerance=1e-8)
    assert ours[6] > 0.9e-3
    assert theirs[6] == pytest.approx(ours[6], rel=1e-8)
    # the sideways motion of the platform is of second order, and agrees as well
    assert theirs[7] == pytest.approx(ours[7], rel=1e-8)
    assert ours[7] == pytest.approx(-(ours[6] ** 2) / (2.0 * 0.0213), rel=0.01)
