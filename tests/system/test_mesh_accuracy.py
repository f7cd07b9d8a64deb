"""Refinement to an accuracy: what it promises, and what it refuses.

Evidence (Finite elements): mesh error estimate (order 8): error within it, *consistency*
"""

import functools
import math

import pytest

from flexstage.base import progress
from flexstage.base.errors import ConvergenceError, ModelError
from flexstage.fem import REFINEMENT_MESHES, MeshSettings, plane_model, refine
from flexstage.fem.whole_stage import RefinementStep, estimate
from flexstage.stage.designs import design
from flexstage.system import analyse
from tests.meshed_stages import plane

STAGE = design("parallelogram")
QUANTITY = "natural_frequency_hz"


@functools.cache
def converged() -> float:
    """The natural frequency of a mesh that is finer than any of the refinement [Hz]."""
    best = plane_model(STAGE, MeshSettings(order=8, neck_size=0.3))
    return analyse(STAGE, best.system).characteristics.value(QUANTITY, "x")


@pytest.mark.slow
@pytest.mark.parametrize("accuracy", [3e-3, 2e-4])
def test_the_error_is_within_the_estimate_and_the_estimate_within_what_was_asked(
    accuracy: float,
) -> None:
    # both refinements go through the same coarse meshes
    found = refine(plane, REFINEMENT_MESHES["plane"], accuracy=accuracy)
    true = converged()
    row = next(r for r in found.analysis.characteristics if r.quantity == QUANTITY)
    assert abs(row.value / true - 1.0) <= found.estimate <= accuracy
    assert row.uncertainty == pytest.approx(found.estimate * row.value, rel=1e-9)
    assert len(found.steps) >= 2
    assert [s.unknowns for s in found.steps] == sorted(s.unknowns for s in found.steps)
    assert any("Mesh refined until natural_frequency_hz" in v for v in found.analysis.validity)


def _steps(*values: float) -> list[RefinementStep]:
    key = (QUANTITY, "x")
    return [
        RefinementStep(settings=MeshSettings(), unknowns=1, seconds=0.0, values={key: v})
        for v in values
    ]


def test_the_estimate_sums_what_is_still_to_come() -> None:
    # errors 8, 2, 0.5: a rate of 1/4, so that a third of the last change is left
    assert estimate(_steps(108.0, 102.0, 100.5), QUANTITY) == pytest.approx(0.5 / 100.5)
    # one change, or changes that do not shrink: the last change itself
    assert estimate(_steps(103.0, 100.0), QUANTITY) == pytest.approx(0.03)
    assert estimate(_steps(101.0, 103.0, 100.0), QUANTITY) == pytest.approx(0.03)
    # a lucky step is not trusted
    lucky = estimate(_steps(150.0, 101.0, 100.999), QUANTITY)
    assert lucky == pytest.approx(0.001 * 0.15 / 0.85 / 100.999, rel=1e-6)
    assert math.isinf(estimate(_steps(100.0), QUANTITY))


def test_what_cannot_be_reached_is_said() -> None:
    def build(s: MeshSettings):
        return plane_model(STAGE, s)

    meshes = [MeshSettings(order=1, neck_size=2.0), MeshSettings(order=2, neck_size=2.0)]
    with pytest.raises(ConvergenceError, match="leaves natural_frequency_hz uncertain by"):
        refine(build, meshes, accuracy=1e-6)
    with pytest.raises(ModelError, match="must lie between 0 and 1"):
        refine(build, meshes, accuracy=0.0)
    with pytest.raises(ModelError, match="unknown quantity 'frequency'"):
        refine(build, meshes, accuracy=0.1, quantity="frequency")
    with pytest.raises(ModelError, match="gives no hysteresis_loop_width"):
        refine(build, meshes, accuracy=0.1, quantity="hysteresis_loop_width")
    with pytest.raises(ModelError, match="order of a mesh must be 1 to 8, got 9"):
        MeshSettings(order=9)


def test_progress_never_goes_back() -> None:
    told: list[tuple[str, float]] = []
    with progress.listen(lambda what, done: told.append((what, done))):
        refine(lambda s: plane_model(STAGE, s), REFINEMENT_MESHES["plane"], accuracy=5e-3)
    done = [share for _, share in told]
    assert done == sorted(done)
    assert 0.0 <= done[0] <= done[-1] <= 1.0
    assert {"mesh", "assembly", "factorisation", "modes", "stress"} <= {what for what, _ in told}
