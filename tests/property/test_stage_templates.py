"""Stages from a template are those that a file with the same values describes."""

from pathlib import Path

import numpy as np
import pytest

from flexstage.base.errors import FlexstageError, StageError
from flexstage.stage.designs import DESIGNS, find_stage
from flexstage.stage.designs.source import StageTemplate, design_text, spelled_out_text
from flexstage.studies.explore.family import Family
from flexstage.studies.explore.variables import every_variable, variables_of

# A design that a file varies, with some of its dimensions only.
_VARIED = "flexstage: 1\ndesign: {name: parallelogram, leg_spacing: 38 mm}\n"
_LINKED = """\
flexstage: 1
parameters:
  wide: {value: 41 mm, description: between the legs}   # kept
  double: = 2*wide
design:
  name: parallelogram
  leg_spacing: = wide
"""


@pytest.fixture
def files(tmp_path: Path) -> dict[str, Path]:
    texts = {
        "design": design_text("three-rrr"),
        "whole": spelled_out_text("bridge"),
        "varied": _VARIED,
        "linked": _LINKED,
    }
    for name, text in texts.items():
        (tmp_path / f"{name}.yaml").write_text(text, encoding="utf-8")
    return {name: tmp_path / f"{name}.yaml" for name in texts}


def _changed(template: StageTemplate) -> dict[str, float]:
    """Two parameters of a template, one a little larger and one a little smaller."""
    variables = every_variable(template)
    chosen = ((variables[0], 1.0137), (variables[-1], 0.9871))
    return {v.name: float(f"{factor * v.usual:.9g}") for v, factor in chosen}


@pytest.mark.parametrize("name", sorted(DESIGNS))
def test_a_design_with_other_values_is_that_of_its_settings(name: str) -> None:
    template = StageTemplate.of(name)
    values = _changed(template)
    variables = {v.name: v for v in every_variable(template)}
    texts = {key: variables[key].text(value) for key, value in values.items()}
    assert template.stage(values) == find_stage(name, texts)
    assert template.stage() == find_stage(name)


@pytest.mark.parametrize("name", ["design", "whole", "varied", "linked"])
def test_a_written_stage_is_the_one_with_these_values(
    name: str, files: dict[str, Path], tmp_path: Path
) -> None:
    template = StageTemplate.of(files[name])
    values = _changed(template)
    written = tmp_path / "best.yaml"
    written.write_text(template.text(values), encoding="utf-8")
    assert find_stage(written) == template.stage(values) != find_stage(files[name])


@pytest.mark.parametrize("name", ["design", "whole"])
def test_a_file_keeps_its_words_but_for_the_values(name: str, files: dict[str, Path]) -> None:
    template = StageTemplate.of(files[name])
    values = _changed(template)
    before = files[name].read_text(encoding="utf-8").splitlines()
    after = template.text(values).splitlines()
    assert len(before) == len(after)
    changed = [(a, b) for a, b in zip(before, after, strict=True) if a != b]
    assert len(changed) == len(values)
    for old, new in changed:
        assert old.partition("#")[2] == new.partition("#")[2]


def test_a_built_in_design_is_written_with_all_of_its_dimensions(tmp_path: Path) -> None:
    template = StageTemplate.of("vgtu-piezo", {"x.leg_neck": "0.61 mm"})
    written = tmp_path / "piezo.yaml"
    written.write_text(template.text({"x.lever_width": 0.0052}), encoding="utf-8")
    found = find_stage(written)
    assert found == find_stage("vgtu-piezo", {"x.leg_neck": "0.61 mm", "x.lever_width": "5.2 mm"})


def test_a_parameter_that_others_follow_is_changed_alone(files: dict[str, Path]) -> None:
    template = StageTemplate.of(files["linked"])
    assert template.text({"wide": 0.042}) == _LINKED.replace("41 mm", "42 mm")
    assert "double" not in {v.name for v in every_variable(template)}


def test_impossible_values_are_refused_in_a_sentence() -> None:
    template = StageTemplate.of("parallelogram")
    with pytest.raises(FlexstageError, match="leg_spacing"):
        template.stage({"leg_spacing": -0.04})
    with pytest.raises(StageError, match="leg_spacing"):
        template.stage({"leg_spacin": 0.04})
    with pytest.raises(FlexstageError, match="leg_spacing"):
        template.text({"leg_spacing": -0.04})


def test_a_drawing_has_no_parameters(tmp_path: Path) -> None:
    with pytest.raises(StageError, match="flexstage import"):
        StageTemplate.of(tmp_path / "part.dxf")


def test_points_of_a_family_are_values_by_name() -> None:
    template = StageTemplate.of("parallelogram")
    family = Family(template=template, variables=variables_of(template, ["leg_*=10 %"]))
    assert family.stage(family.usual) == find_stage("parallelogram")
    assert np.allclose(family.middle, family.usual, rtol=1e-12)
    assert find_stage("parallelogram") != family.stage(family.bounds[:, 1])
