"""Drawings that flexstage exports come back as the stages that they were drawn from."""

import pytest

from flexstage.base.errors import StageError
from flexstage.export.drawing.contours import plate_contours
from flexstage.export.step import step_files
from flexstage.stage import check
from flexstage.stage.designs import DESIGNS, design
from flexstage.stage.drawing.drawn_stage import read_drawing
from flexstage.stage.drawing.requests import DrawingOptions
from flexstage.studies.models import run_model
from flexstage.studies.requests import ModelOptions
from tests.drawing_stages import NOTCHES, guide
from tests.drawn_stages import (
    FIGURES,
    dxf_without_hinges,
    figures,
    require_same,
    with_drives_of,
)


def _is_one_plate(name: str) -> bool:
    try:
        plate_contours(design(name))
    except StageError:
        return False
    return True


#: Designs that are one plate: others are drawn in several pieces, and a drawing is of one.
PLATES = [name for name in DESIGNS if _is_one_plate(name)]


def _told(stage) -> DrawingOptions:
    return DrawingOptions(thickness=stage.thickness, material=stage.material.name)


def _tiered(names, quick: set[str]) -> list:
    """What takes longer runs with the slow evidence."""
    return [n if n in quick else pytest.param(n, marks=pytest.mark.slow) for n in names]


@pytest.mark.parametrize("name", _tiered(PLATES, {"parallelogram", "vgtu-piezo"}))
def test_the_dxf_of_a_design_comes_back(name: str, tmp_path) -> None:
    stage = design(name)
    path = tmp_path / "part.dxf"
    dxf_without_hinges(stage).saveas(path)
    drawn = read_drawing(path, _told(stage))
    names = require_same(drawn.stage, stage)
    held = {names[b.name] for b in drawn.stage.bodies if b.fixed}
    assert held == {b.name for b in stage.bodies if b.fixed}
    assert [issue for issue in check(drawn.stage) if issue.severity == "error"] == []
    again, before = figures(with_drives_of(drawn.stage, stage, names)), figures(stage)
    assert again.keys() == before.keys()
    for key, value in before.items():
        assert again[key] == pytest.approx(value, rel=1e-3), key


@pytest.mark.parametrize("name", _tiered(PLATES, {"parallelogram"}))
def test_the_step_of_a_design_comes_back(name: str, tmp_path) -> None:
    stage = design(name)
    path = tmp_path / "part.step"
    path.write_bytes(next(iter(step_files(stage).values())))
    drawn = read_drawing(path, DrawingOptions(material=stage.material.name))
    assert drawn.stage.thickness == pytest.approx(stage.thickness, rel=1e-9)
    names = require_same(drawn.stage, stage)
    again, before = figures(with_drives_of(drawn.stage, stage, names)), figures(stage)
    for key, value in before.items():
        assert again[key] == pytest.approx(value, rel=1e-3), key


@pytest.mark.parametrize(
    "kind", _tiered(NOTCHES, {"circular-one-sided", "elliptical", "leaf", "v", "as-drawn"})
)
def test_every_notch_comes_back_turned_and_shifted(kind: str, tmp_path) -> None:
    # those that are no lines and arcs are drawn within 10 nm, and come back in round sizes
    stage = guide(NOTCHES[kind])
    path = tmp_path / "part.dxf"
    dxf_without_hinges(stage).saveas(path)
    drawn = read_drawing(path, _told(stage))
    names = require_same(drawn.stage, stage)
    assert {n.certainty for n in drawn.necks} == {"likely" if kind == "as-drawn" else "sure"}
    again = with_drives_of(drawn.stage, stage, names)
    assert [b.fixed for b in again.bodies].count(True) == 1


@pytest.mark.slow
@pytest.mark.parametrize("name", ["parallelogram", "vgtu-piezo"])
def test_elastic_bodies_have_the_same_figures(name: str, tmp_path) -> None:
    """The same by superelements, whose meshes know nothing of names and of the order of corners."""
    stage = design(name)
    path = tmp_path / "part.dxf"
    dxf_without_hinges(stage).saveas(path)
    drawn = read_drawing(path, _told(stage)).stage
    again = with_drives_of(drawn, stage, require_same(drawn, stage))
    found, meant = (
        run_model(s, "superelement", ModelOptions()).analysis.characteristics
        for s in (again, stage)
    )
    before = {(c.quantity, c.axis): c.value for c in meant if c.quantity in FIGURES}
    after = {(c.quantity, c.axis): c.value for c in found if c.quantity in FIGURES}
    assert after.keys() == before.keys()
    for key, value in before.items():
        assert after[key] == pytest.approx(value, rel=1e-3), key
