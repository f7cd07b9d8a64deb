"""Every built-in design by three models, against each other and against the table of the manual.

Evidence (Stages, tolerances, designs): built-in designs (three models):
[Designs](../explanation/designs.md), *consistency* [elements *slow*]
"""

import pytest

from flexstage.lumped import lumped_system
from flexstage.stage.designs import DESIGNS, design
from tests.designs_by_models import computed, printed, row, said

TABLE = printed()


def test_every_design_is_in_the_manual() -> None:
    axes = {(name, axis.name) for name in DESIGNS for axis in design(name).axes}
    missing = sorted(axes - set(TABLE))
    assert not missing, f"python -m tests.designs_by_models {' '.join({m[0] for m in missing})}"
    assert set(TABLE) == axes


@pytest.mark.parametrize("name", sorted(DESIGNS))
def test_rigid_bodies_give_the_figures_of_the_manual(name: str) -> None:
    stage = design(name)
    for axis, found in zip(stage.axes, said(stage, lumped_system(stage)), strict=True):
        shown = [values[0] for values in TABLE[name, axis.name].values]
        assert found == pytest.approx(shown, rel=6e-4), axis.name  # four digits


@pytest.mark.slow
@pytest.mark.parametrize("name", sorted(DESIGNS))
def test_three_models_of_a_design(name: str) -> None:
    for figures in computed(name):
        shown = TABLE[name, figures.axis].values
        for values, old, tolerance in zip(figures.values, shown, (1e-3, 1e-3, 0.02), strict=True):
            # another version of the mesher makes another mesh
            assert values == pytest.approx(old, rel=tolerance), row(figures)
        (f, f_super, f_plane), (ratio, r_super, r_plane), (stress, s_super, s_plane) = (
            figures.values
        )
        # the same equations: bodies with a few modes of their own, and the scatter of two meshes
        assert f_super == pytest.approx(f_plane, rel=2e-3)
        assert r_super == pytest.approx(r_plane, rel=1e-3)
        assert s_super == pytest.approx(s_plane, rel=0.02)
        # rigid bodies on springs; the manual says what makes the difference
        assert 0.0 < f / f_plane - 1.0 < 0.04
        assert -0.003 < abs(ratio / r_plane) - 1.0 < 0.13
        assert stress == pytest.approx(s_plane, rel=0.12)
