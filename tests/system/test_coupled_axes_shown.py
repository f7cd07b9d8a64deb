"""A stage whose drives move its axes together, through the command line and the report."""

import json
from pathlib import Path

import numpy as np
import pytest

from flexstage.cli import main
from flexstage.lumped import lumped_system
from flexstage.report.study import study_section
from flexstage.stage import stage_to_text
from flexstage.stage.designs import design
from flexstage.studies import run_study
from flexstage.system import analyse, coupled_axes
from tests.parallel_stage import three_legs


@pytest.fixture
def legs(tmp_path: Path) -> str:
    path = tmp_path / "legs.yaml"
    path.write_text(stage_to_text(three_legs()), encoding="utf-8")
    return str(path)


def test_the_command_prints_and_writes_them(
    legs: str,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    # nine diagrams of frequency responses, which say nothing of coupled axes
    monkeypatch.setattr("flexstage.report.result_files.bode_files", lambda *_: {})
    with pytest.raises(SystemExit) as end:
        main(["analyse", legs, "--model", "lumped", "--folder", str(tmp_path / "out")])
    assert not end.value.code
    shown = capsys.readouterr().out
    for words in ("Jacobian", "Decoupling", "Workspace", "µrad/µm", "motion of theta"):
        assert words in shown
    picture = (tmp_path / "out" / "workspace.svg").read_text("utf-8")
    assert "any rotation" in picture
    found = json.loads((tmp_path / "out" / "analysis.json").read_text("utf-8"))["coupling"]
    J, W = np.array(found["jacobian"]), np.array(found["decoupling"])
    assert pytest.approx(np.eye(3), abs=1e-9) == J @ W
    assert found["axes"] == ["x", "y", "theta"]
    assert found["units"] == ["m", "m", "rad"]
    # the outline is that of the area, by the sum of its corners
    x, y = np.array(found["workspace"]["outline"]).T
    area = 0.5 * (x @ np.roll(y, -1) - y @ np.roll(x, -1))
    assert area == pytest.approx(found["workspace"]["area"], rel=1e-6)


def test_the_report_shows_them() -> None:
    study = run_study(three_legs(), model=("lumped",))
    section = study_section(study, "coupling")
    assert [type(part).__name__ for part in section.content] == ["str", *["Table"] * 3, "Picture"]
    # axes that one drive moves each have no such section
    assert not study_section(run_study(design("vgtu-piezo"), model=("lumped",)), "coupling").content


@pytest.mark.parametrize("name", ["vgtu-piezo", "vgtu-mechanical"])
def test_axes_in_series_keep_their_figures(name: str) -> None:
    """Of a stage that is not coupled, J is diagonal with the ratios that drives have alone."""
    stage = design(name)
    found = analyse(stage, lumped_system(stage))
    assert found.coupling is not None
    assert not found.coupling.coupled
    for k, axis in enumerate("xy"):
        ratio = found.characteristics.value("transmission_ratio", axis)
        assert found.coupling.jacobian[k, k] == pytest.approx(ratio, rel=1e-9)
    area = np.prod([found.characteristics.value("output_displacement", a) for a in "xy"])
    assert found.characteristics.value("workspace_area", "xy") == pytest.approx(area, rel=1e-9)


def test_a_length_that_is_given_scales_rotations() -> None:
    """Condition number and isotropy change with it; J, strokes and workspace do not."""
    stage = three_legs()
    system = lumped_system(stage)
    one, other = (coupled_axes(stage, system, length=length) for length in (None, 90e-3))
    assert one.length == pytest.approx(33.2e-3, rel=1e-3)
    assert one.condition_number != pytest.approx(other.condition_number, rel=0.1)
    assert (one.jacobian == other.jacobian).all()
    assert one.workspace.volume == other.workspace.volume
