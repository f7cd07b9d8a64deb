"""`flexstage new`: designs listed and drawn, and stage files that are the designs again."""

import json
from pathlib import Path

import pytest
import yaml

from flexstage.base.errors import StageError, UnitError
from flexstage.cli import main
from flexstage.quantities.units import DIMENSIONS, parse
from flexstage.stage import stage_from_text, stage_to_text
from flexstage.stage.designs import DESIGNS, StageParameter, design, find_stage, parameters_of
from flexstage.stage.designs.parameters import Group, entries_of
from flexstage.stage.designs.registry import PARAMETER_SETS
from flexstage.stage.designs.source import design_text, spelled_out_text
from tests.system.test_stage_file import EXAMPLE


def said(capsys: pytest.CaptureFixture[str], *words: object, status: int = 0) -> str:
    with pytest.raises(SystemExit) as end:
        main([str(word) for word in words])
    assert int(end.value.code or 0) == status
    printed = capsys.readouterr()
    return printed.err if status else printed.out


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.mark.parametrize("name", sorted(DESIGNS))
def test_a_file_to_start_from_is_the_design_again(name: str, tmp_path: Path) -> None:
    for text in (design_text(name), spelled_out_text(name)):
        path = tmp_path / "own.yaml"
        path.write_text(text, encoding="utf-8")
        assert find_stage(path) == design(name)
        assert all(len(line) <= 100 for line in text.splitlines() if "#" in line)
    assert stage_from_text(stage_to_text(design(name), shared=True)) == design(name)


@pytest.mark.parametrize("name", sorted(DESIGNS))
def test_every_dimension_is_in_it_with_what_it_is(name: str) -> None:
    text = design_text(name)
    words = " ".join(text.replace("#", " ").split())
    held = yaml.safe_load(text)["design"]
    for entry in entries_of(PARAMETER_SETS[name].parameters):
        assert entry.description.removesuffix(".") in words
        at = held
        for key in entry.name.split("."):
            at = at[key]
        if isinstance(entry, StageParameter):
            assert at == yaml.safe_load(entry.text)
        else:
            assert isinstance(entry, Group)
            assert isinstance(at, dict)


@pytest.mark.parametrize("name", sorted(DESIGNS))
def test_parameters_of_a_design_set_it_to_what_it_is(name: str) -> None:
    found = parameters_of(name)
    assert len({p.name for p in found}) == len(found) > 5
    assert find_stage(name, {p.name: p.text for p in found}) == design(name)
    for parameter in found:
        assert parameter.description
        if parameter.dimension and isinstance(parameter.value, float):
            assert parse(parameter.text, parameter.dimension) == parameter.value
            assert parameter.dimension in DIMENSIONS


def test_parameters_of_a_file_are_its_own_and_those_of_its_design(tmp_path: Path) -> None:
    own = {p.name: p for p in parameters_of(EXAMPLE)}
    assert (own["t"].value, own["t"].dimension, own["t"].text) == (0.5e-3, "length", "0.5 mm")
    assert own["t"].description == "neck of the four notches"
    assert (own["floor"].value, own["floor"].text) == (44e-3, "= leg_end + 2*R")
    path = tmp_path / "own.yaml"
    path.write_text(
        "flexstage: 1\nparameters: {n: 3, tilt: 2 deg, lift: = tilt/n}\n"
        "design: {name: nested-xy, based_on: vgtu-piezo, x: {lever_neck: 0.47 mm}}\n"
    )
    found = {p.name: p for p in parameters_of(path)}
    assert list(found)[:4] == ["n", "tilt", "lift", "x.lever_arm_input"]
    assert (found["n"].dimension, found["lift"].dimension) == ("", "angle")
    assert found["x.lever_neck"].text == "0.47 mm"
    assert found["y.lever_neck"].text == "0.4 mm"
    with pytest.raises(StageError, match="no built-in design and no file"):
        parameters_of("nowhere.yaml")


def test_another_kind_of_a_part_is_set_with_its_own_parameters() -> None:
    leaf = {"leg.notch.kind": "leaf", "leg.notch.neck_thickness": "0.4 mm",
            "leg.notch.leaf_length": "20 mm", "leg.notch.notch_depth": "2 mm",
            "leg.bar_length": "null"}  # fmt: skip
    made = find_stage("parallelogram", leaf)
    assert {hinge.profile.kind for hinge in made.hinges} == {"leaf"}
    with pytest.raises(StageError, match="did you mean 'leaf_length'"):
        find_stage("parallelogram", {**leaf, "leg.notch.leaf_lenght": "20 mm"})
    with pytest.raises(UnitError, match=r"leg\.notch\.leaf_length: 'deg' is not a unit of length"):
        find_stage("parallelogram", {**leaf, "leg.notch.leaf_length": "20 deg"})


def test_shared_profiles_have_parameters() -> None:
    text = stage_to_text(design("vgtu-piezo"), shared=True)
    held = yaml.safe_load(text)
    profiles = {hinge.profile for hinge in design("vgtu-piezo").hinges}
    assert len(held["profiles"]) == len(profiles) == 4
    assert held["profiles"]["notch_2"]["neck_thickness"] == "= neck_thickness_2"
    thinner = stage_from_text(text, set={"neck_thickness_2": "0.7 mm"})
    changed = {
        hinge.profile.neck_thickness
        for hinge, before in zip(thinner.hinges, design("vgtu-piezo").hinges, strict=True)
        if hinge != before
    }
    assert changed == {0.7e-3}
    alone = yaml.safe_load(stage_to_text(design("parallelogram"), shared=True))
    assert alone["parameters"] == {"neck_thickness": "0.5 mm", "radius": "2 mm"}


def test_it_lists_all_designs(capsys: pytest.CaptureFixture[str]) -> None:
    table = said(capsys, "new")
    assert [name for name in DESIGNS if name not in table] == []
    rows = json.loads(said(capsys, "new", "--json"))["designs"]
    assert [row["design"] for row in rows] == list(DESIGNS)
    piezo = next(row for row in rows if row["design"] == "vgtu-piezo")
    assert (piezo["bodies"], piezo["hinges"], piezo["drives"]) == (21, 32, 2)
    assert piezo["axes"] == ["x", "y"]
    assert all(row["title"] and row["source"] for row in rows)


def test_a_file_that_exists_is_kept(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert said(capsys, "new", "Parallelogram").strip() == "wrote parallelogram.yaml"
    path = here / "parallelogram.yaml"
    path.write_text("mine")
    sentence = said(capsys, "new", "parallelogram", status=2)
    assert "parallelogram.yaml exists: give --force to replace it" in sentence
    assert "own.yaml exists" not in said(capsys, "new", "parallelogram", "--out", "own.yaml")
    assert "own.yaml exists" in said(
        capsys, "new", "parallelogram", "--spelled-out", "--out", "own.yaml", status=2
    )
    assert path.read_text() == "mine"
    said(capsys, "new", "parallelogram", "--force", "--spelled-out")
    assert find_stage(path) == design("parallelogram")
    assert "bodies:" in path.read_text()


def test_what_it_cannot_do_is_refused(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert "did you mean 'parallelogram'?" in said(capsys, "new", "paralelogram", status=2)
    for option in ("--force", "--spelled-out"):
        assert "need a DESIGN: name one" in said(capsys, "new", option, status=2)
    assert not list(here.iterdir())


def test_designs_are_drawn(
    here: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    two = {name: DESIGNS[name] for name in ("parallelogram", "double-parallelogram")}
    monkeypatch.setattr("flexstage.stage.designs.registry.DESIGNS", two)
    found = json.loads(said(capsys, "new", "--folder", "drawn", "--json"))["files"]
    names = ["parallelogram.png", "double-parallelogram.png", "designs.png"]
    assert [Path(file).name for file in found] == names
    assert all((here / file).read_bytes().startswith(b"\x89PNG") for file in found)
    said(capsys, "new", "parallelogram", "--folder", "one")
    assert [file.name for file in (here / "one").iterdir()] == ["parallelogram.png"]
