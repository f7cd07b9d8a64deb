"""`flexstage import`, and drawings in place of stage files."""

import json
from dataclasses import replace
from pathlib import Path

import ezdxf
import pytest

from flexstage.base.errors import StageError
from flexstage.cli import main
from flexstage.export.drawing.dxf import dxf_files
from flexstage.stage.designs import design, find_stage
from flexstage.stage.drawing.requests import DrawingOptions
from tests.drawn_stages import figures

SCREW = "screw, pitch=0.25 mm, smallest_step=0.5 um, travel=0.2 mm"
TOLD = ("--thickness", "8 mm", "--material", "Al 7075-T6")
DRIVEN = ("--drive", f"x: -28.25,40 -> -26.25,40; {SCREW}", "--probe", "x: 0,40 at 0 deg")


def run(*words: str) -> int:
    with pytest.raises(SystemExit) as end:
        main(words)
    return int(end.value.code or 0)


@pytest.fixture
def drawing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> str:
    monkeypatch.chdir(tmp_path)
    (content,) = dxf_files(design("parallelogram")).values()
    Path("part.dxf").write_bytes(content)
    return "part.dxf"


def test_a_drawing_becomes_a_stage_file_with_the_same_figures(
    drawing: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run("import", drawing, *TOLD, *DRIVEN, "--figure", "found.png") == 0
    said = capsys.readouterr().out
    assert "4 necks" in said
    assert "wrote part.yaml" in said
    assert Path("found.png").read_bytes().startswith(b"\x89PNG")
    found, meant = figures(find_stage("part.yaml")), figures(design("parallelogram"))
    assert found.keys() == meant.keys()
    for key, value in meant.items():
        assert found[key] == pytest.approx(value, rel=1e-9), key
    # the patch of the force is the only thing that nobody has said
    made, before = find_stage("part.yaml").drives[0], design("parallelogram").drives[0]
    for name in ("direction", "pitch", "travel", "smallest_step"):
        assert getattr(made, name) == pytest.approx(getattr(before, name), abs=1e-12)
    for point, meant_point in zip(made.at, before.at, strict=True):
        assert point == pytest.approx(meant_point, abs=1e-12)


def test_what_the_drawing_does_not_say_is_marked(
    drawing: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run("import", drawing, "--json", "--out", "stage.yaml") == 0
    said = json.loads(capsys.readouterr().out)
    assert said["blanks"] == ["thickness", "material", "drives", "probes"]
    assert said["ignored"]["text"] == 12
    neck = said["necks"][0]
    assert (neck["profile"], neck["certainty"]) == ("circular", "sure")
    assert neck["neck_thickness"] == pytest.approx(0.5e-3)
    text = Path("stage.yaml").read_text("utf-8")
    assert text.count("# FILL IN") == 4
    with pytest.raises(StageError, match=r"line .*thickness"):
        find_stage("stage.yaml")
    filled = text.replace("thickness:  #", "thickness: 8 mm  #")
    Path("stage.yaml").write_text(filled.replace("material:  #", "material: Al 7075-T6  #"))
    assert len(find_stage("stage.yaml", {"neck_thickness": "0.45 mm"}).hinges) == 4


def test_commands_take_a_drawing_as_a_stage(
    drawing: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run("check", drawing, *TOLD, *DRIVEN) == 0
    assert "1 drive, 1 probe" in capsys.readouterr().out
    assert run("analyse", drawing, *TOLD, *DRIVEN, "--model", "lumped", "--json") == 0
    json.loads(capsys.readouterr().out)


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("check", "part.dxf"), "does not give the thickness of the plate: give --thickness"),
        (("check", "part.dxf", "--thickness", "8 mm"), "does not give the material"),
        (("check", "part.dxf", *TOLD, "--set", "t=1 mm"), "'t'"),
        (("check", "parallelogram", *TOLD), "options of a drawing apply to drawings only"),
        (("import", "part.dxf", "--contours", "layers=OUTLIN"), "did you mean 'OUTLINE'?"),
        (("import", "part.dxf", "--drive", "x: 1,2"), '--drive is "x: 12,4 -> 30,4; piezo'),
        (("import", "part.dxf", "--drive", "x: 0,20 -> 0,40"), "drive 'x' reacts on a body at"),
        (
            ("import", "part.dxf", "--probe", "x: 90,0 at 0 deg"),
            "there is none: the nearest is",
        ),
        (("import", "part.dxf", "--fixed", "frame"), "--fixed is a point on the fixed body"),
        (("import", "part.dxf", "--body", "frame: rigid"), "--body is a point on the body"),
        (("import", "part.dxf", "--body", "0,40"), 'then a material or "rigid" or both'),
        (("import", "part.dxf", "--body", "0,40: gold"), "no material 'gold'"),
        (("import", "part.dxf", "--body", "900,0: rigid"), "--body names a body at"),
        (
            ("import", "part.dxf", "--body", "0,40: rigid", "--body", "1,41: Invar 36"),
            "'1,41: Invar 36' names a body twice",
        ),
        (
            ("import", "part.dxf", "--contours", "neck_limit=0.1 mm"),
            "0.1 mm: its thinnest place is",
        ),
        (("import", "part.dwg"), "a drawing ends in .dxf, .step, .stp"),
    ],
)
def test_a_mistake_is_one_sentence(
    words: tuple[str, ...], said: str, drawing: str, capsys: pytest.CaptureFixture[str]
) -> None:
    before = set(Path().iterdir())
    assert run(*words) == 2
    err = capsys.readouterr().err
    assert said in err
    assert err.count("\n") == 1
    assert set(Path().iterdir()) == before


def test_a_drive_with_a_figure_too_many_is_refused(
    drawing: str, capsys: pytest.CaptureFixture[str]
) -> None:
    wrong = f"x: -28.25,40 -> -26.25,40; {SCREW}, strok=3 um"
    assert run("import", drawing, "--drive", wrong) == 2
    assert "strok" in capsys.readouterr().err


def test_arrows_on_layers_are_drives_and_probes(tmp_path: Path) -> None:
    document = ezdxf.filemanagement.new("R2010")
    document.header["$INSUNITS"] = 4
    space = document.modelspace()
    (content,) = dxf_files(design("parallelogram")).values()
    path = tmp_path / "part.dxf"
    path.write_bytes(content)
    document = ezdxf.filemanagement.readfile(path)
    space = document.modelspace()
    for layer in ("DRIVES", "PROBES"):
        document.layers.add(layer)
    # from its tip, which two short lines mark
    tip, tail = (-26.25, 40.0), (-28.25, 40.0)
    on = {"layer": "DRIVES"}
    space.add_line(tip, tail, dxfattribs=on)
    for side in (0.2, -0.2):
        space.add_line(tip, (tip[0] - 0.3, tip[1] + side), dxfattribs=on)
    space.add_text("push", height=1.0, dxfattribs={**on, "insert": (-30.0, 41.0)})
    space.add_line((3.0, 40.0), (3.0, 45.0), dxfattribs={"layer": "PROBES"})
    document.saveas(path)
    stage = find_stage(path, drawing=DrawingOptions(thickness=8e-3, material="Al 7075-T6"))
    (drive,), (probe,) = stage.drives, stage.probes
    assert (drive.name, drive.kind, drive.reacts, drive.direction) == ("push", "force", "base", 0.0)
    assert drive.at == (pytest.approx((-26.25e-3, 40e-3)), pytest.approx((-28.25e-3, 40e-3)))
    assert (probe.name, probe.at) == ("y", pytest.approx((3e-3, 40e-3)))
    assert probe.direction == pytest.approx(1.5707963267948966, abs=1e-12)
    assert drive.pushes == probe.body


def test_the_body_that_is_held_may_be_said(drawing: str) -> None:
    told = DrawingOptions(thickness=8e-3, material="Al 7075-T6", fixed=("0,40",))
    (held,) = (b for b in find_stage(drawing, drawing=told).bodies if b.fixed)
    assert max(y for _, y in held.outline.points) == pytest.approx(46e-3)


def test_bodies_may_be_rigid_or_of_another_material(drawing: str) -> None:
    told = DrawingOptions(
        thickness=8e-3, material="Al 7075-T6", body=("0,40: stainless steel 304, rigid",)
    )
    stage = find_stage(drawing, drawing=told)
    (steel,) = stage.other_bodies
    assert max(y for _, y in steel.outline.points) == pytest.approx(46e-3)
    assert stage.material_of(steel).name == "Stainless steel 304"
    assert steel.rigid
    told = replace(told, body=("0,40: rigid",))
    (rigid,) = find_stage(drawing, drawing=told).other_bodies
    assert (rigid.name, rigid.material, rigid.rigid) == (steel.name, None, True)


def test_import_says_which_bodies_are_others(
    drawing: str, capsys: pytest.CaptureFixture[str]
) -> None:
    told = ("--body", "0,40: Invar 36, rigid")
    assert run("import", drawing, *TOLD, *told, "--json") == 0
    bodies = json.loads(capsys.readouterr().out)["bodies"]
    assert {(b["material"], b["rigid"]) for b in bodies} == {("Invar 36", True), (None, False)}


def test_a_solid_that_is_no_plate_is_refused(tmp_path: Path) -> None:
    from netgen.occ import Box, Cylinder, Z

    path = tmp_path / "part.step"
    (Box((0, 0, 0), (30, 20, 5)) + Cylinder((10, 10, 5), Z, r=3, h=2)).WriteStep(str(path))
    with pytest.raises(StageError, match="is not a plate of constant thickness"):
        find_stage(path, drawing=DrawingOptions(material="Al 7075-T6"))


def test_a_stage_file_that_was_filled_in_is_not_replaced(
    drawing: str, capsys: pytest.CaptureFixture[str]
) -> None:
    Path("part.yaml").write_text("mine", encoding="utf-8")
    assert run("import", drawing) == 2
    assert "--force" in capsys.readouterr().err
    assert Path("part.yaml").read_text("utf-8") == "mine"
    assert run("import", drawing, "--force") == 0
    assert Path("part.yaml").read_text("utf-8") != "mine"
