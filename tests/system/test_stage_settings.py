"""`--set`: parameters of a stage from outside, on every command that takes one."""

import json
from pathlib import Path

import pytest

from flexstage.base.errors import StageError, UnitError
from flexstage.cli import main
from flexstage.stage.designs import build, find_stage
from tests.system.test_cli_json import commands

FILE = """\
flexstage: 1
design:
  name: nested-xy
  based_on: vgtu-piezo
  x:
    lever_neck: 0.47 mm
    lever_arm_input: 9.5 mm
"""


def said(capsys: pytest.CaptureFixture[str], *words: object) -> tuple[str, str]:
    with pytest.raises(SystemExit):
        main([str(word) for word in words])
    printed = capsys.readouterr()
    return printed.out, printed.err


def test_every_command_that_takes_a_stage_sets_its_parameters() -> None:
    takers = {
        name
        for name, command in commands().items()
        for p in command.params
        if (p.metavar or "").strip("[]") == "STAGE"
    }
    assert {"check", "show", "analyse", "study", "excite", "characterise", "run"} <= takers
    for name in takers:
        options = {word for p in commands()[name].params for word in p.opts}
        assert "--set" in options, name


def test_a_parameter_of_a_design_is_set(capsys: pytest.CaptureFixture[str]) -> None:
    base = find_stage("vgtu-piezo")
    made = find_stage("vgtu-piezo", {"x.lever_neck": "0.45 mm", "mounting_hole_station": "0.3"})
    given = {"x": {"lever_neck": "0.45 mm"}, "mounting_hole_station": 0.3}
    assert made == build("vgtu-piezo", given) != base
    assert made.name == "vgtu-piezo-variation"
    words = ("analyse", "parallelogram", "--model", "lumped", "--json")
    plain, _ = said(capsys, *words)
    neck = "leg.notch.neck_thickness=0.4 mm"
    thin, _ = said(capsys, *words, "--set", neck, "--set", "thickness = 7 mm")
    first, second = (
        min(
            row["value"]
            for row in json.loads(text)["characteristics"]
            if row["quantity"] == "natural_frequency_hz"
        )
        for text in (plain, thin)
    )
    assert second < 0.9 * first


def test_those_of_a_file_stand_behind_what_is_set(tmp_path: Path) -> None:
    path = tmp_path / "own.yaml"
    path.write_text(FILE)
    set_ = find_stage(path, {"x.lever_neck": "0.45 mm", "y.lever_neck": "0.52 mm"})
    as_written = FILE.replace("0.47", "0.45") + "  y: {lever_neck: 0.52 mm}\n"
    (tmp_path / "written.yaml").write_text(as_written)
    assert set_ == find_stage(tmp_path / "written.yaml") != find_stage(path)
    assert find_stage(path, {}) == find_stage(path)


@pytest.mark.parametrize(
    ("settings", "error", "sentence"),
    [
        ({"lever_neck": "1 mm"}, StageError, "did you mean 'x.lever_neck' or 'y.lever_neck'?"),
        ({"x.lever_nek": "1 mm"}, StageError, "did you mean 'x.lever_neck'?"),
        ({"colour": "blue"}, StageError, "its parameters are x, y, platform_length"),
        ({"x.lever_neck": "3 deg"}, UnitError, "'deg' is not a unit of length"),
        ({"x": "3", "x.lever_neck": "3 mm"}, StageError, "and all of 'x' are set: set one of them"),
        ({"x.lever_neck": "[3 mm"}, StageError, "the value of 'x.lever_neck', line"),
        ({"x.lever_neck": "&a 3 mm"}, StageError, "anchors such as '&a'"),
    ],
)
def test_what_cannot_be_set_is_refused(
    settings: dict[str, str], error: type[Exception], sentence: str
) -> None:
    with pytest.raises(error, match="x") as refused:
        find_stage("vgtu-piezo", settings)
    assert sentence in str(refused.value)


def test_words_that_set_nothing_are_refused(capsys: pytest.CaptureFixture[str]) -> None:
    check = ("check", "parallelogram")
    for words, sentence in (
        ((*check, "--set", "neck_thickness"), "--set is the name of a parameter and its value"),
        ((*check, "--set", "thickness=1 mm", "--set", "thickness=2 mm"), "'thickness' twice"),
        (("excite", "--voltage", "0:9", "--set", "a=1"), "--set needs a STAGE"),
    ):
        assert sentence in said(capsys, *words)[1]


def test_the_name_of_a_design_is_no_parameter(tmp_path: Path) -> None:
    path = tmp_path / "own.yaml"
    path.write_text(FILE)
    with pytest.raises(StageError, match="'based_on' of a design is not a parameter"):
        find_stage(path, {"based_on": "vgtu-mechanical"})
