"""`flexstage export` as a user calls it: every format, its files, and what is refused."""

import hashlib
import json
import zipfile
from dataclasses import replace
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest
from scipy.io import loadmat

from flexstage.cli import main
from flexstage.export.request import FORMATS
from flexstage.hysteresis import BoucWen, DriveModel, ModelFile, model_text
from flexstage.quantities.characteristic import Characteristics
from flexstage.stage.designs import design
from flexstage.stage.file import write_stage

#: What each format must at least hold: a suffix, and bytes that such a file begins with or holds.
_HOLDS = {
    "diagram": (".svg", b"<svg"),
    "simulink": (".m", b"add_block"),
    "fmu": (".fmu", b"PK"),
    "mat": (".mat", b"MATLAB 5.0"),
    "c": (".h", b"step"),
    "step": (".step", b"ISO-10303-21"),
    "dxf": (".dxf", b"LWPOLYLINE"),
    "drawing": (".svg", b"<svg"),
    "vtu": (".vtu", b"UnstructuredGrid"),
    "uff": (".uff", b"    -1"),
    "csv": (".csv", b"quantity"),
    "reduced": (".op4", b"KAAX"),
}


def _run(*words: str) -> int:
    with pytest.raises(SystemExit) as ended:
        main(["export", *words])
    return int(ended.value.code or 0)


def test_every_format_is_looked_for() -> None:
    assert set(_HOLDS) == set(FORMATS)


@pytest.mark.parametrize("name", FORMATS)
def test_the_writer_of_a_format_exists(name: str) -> None:
    module, _, function = f"flexstage.export.{FORMATS[name].writer}".rpartition(".")
    assert callable(getattr(import_module(module), function))


@pytest.mark.parametrize(
    "name",
    [
        pytest.param(name, marks=pytest.mark.slow if name == "reduced" else ())
        for name in sorted(_HOLDS)
    ],
)
def test_a_format_is_written(name: str, tmp_path: Path, capsys) -> None:
    out = tmp_path / "out"
    # by finite elements in space, whatever the model
    stage = "parallelogram" if name == "reduced" else "vgtu-piezo"
    words = [stage, "--to", name, "--model", "lumped", "--folder", str(out), "--json"]
    assert _run(*words, "--source-only", "--bandwidth", "2 kHz", "--creep", "1.5%") == 0
    said = json.loads(capsys.readouterr().out)
    suffix, inside = _HOLDS[name]
    found = [Path(file["path"]) for file in said["files"]]
    assert found
    assert {p.parent for p in found} == {out}
    assert any(p.suffix == suffix and inside in p.read_bytes() for p in found)
    for file in said["files"]:
        content = Path(file["path"]).read_bytes()
        assert len(content) == file["bytes"] > 0
        assert hashlib.sha256(content).hexdigest() == file["sha256"]
    assert {p.name for p in out.iterdir()} == {p.name for p in found}


def test_several_formats_get_a_folder_each(tmp_path: Path, capsys) -> None:
    assert _run("parallelogram", "--to", "step, csv,step", "--folder", str(tmp_path)) == 0
    assert sorted(p.name for p in tmp_path.iterdir()) == ["csv", "step"]
    assert "parallelogram.step" in capsys.readouterr().out.replace("\n", "")


@pytest.mark.slow
@pytest.mark.parametrize("stage", ["vgtu-mechanical", "parallelogram"])
def test_a_screw_stage_is_handed_on_too(stage: str, tmp_path: Path) -> None:
    words = ["--to", "mat,c,fmu,simulink,diagram", "--source-only", "--folder", str(tmp_path)]
    assert _run(stage, *words) == 0
    assert {p.name for p in tmp_path.iterdir()} == {"mat", "c", "fmu", "simulink", "diagram"}


def test_both_versions_of_fmi_are_written_or_one(tmp_path: Path) -> None:
    words = ["--to", "fmu", "--source-only", "--folder", str(tmp_path)]
    assert _run("parallelogram", *words, "--fmi", "3.0") == 0
    (only,) = tmp_path.iterdir()
    with zipfile.ZipFile(only) as archive:
        assert b'fmiVersion="3.0"' in archive.read("modelDescription.xml")
    assert _run("parallelogram", *words) == 0
    assert len(list(tmp_path.iterdir())) == 2


def test_the_model_of_a_measured_drive_is_taken(tmp_path: Path, capsys) -> None:
    drive = DriveModel(
        hysteresis=BoucWen(gain=0.6, hysteresis_gain=0.21, beta=0.04, gamma=0.02), output_unit="um"
    )
    file = tmp_path / "x.yaml"
    file.write_text(model_text(ModelFile(model=drive)), encoding="utf-8")
    words = ["vgtu-piezo", "--to", "mat", "--model", "lumped", "--json"]
    made = []
    for i, extra in enumerate((["--hysteresis", f"x={file}"], ["--hysteresis", "none"])):
        assert _run(*words, "--folder", str(tmp_path / str(i)), *extra) == 0
        said = json.loads(capsys.readouterr().out)
        made.append(said["notes"])
    assert any(note.startswith("Of identified drives") for note in made[0])
    assert any(note.startswith("Stacks without hysteresis: y.") for note in made[0])
    assert any(note.startswith("Stacks without hysteresis: x, y.") for note in made[1])
    first, second = (loadmat(next((tmp_path / str(i)).glob("*.mat"))) for i in (0, 1))
    assert np.array_equal(first["M"], second["M"])


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["vgtu-piezo", "--to", "dwg"], "'--to': must be one or more of diagram"),
        (["vgtu-piezo", "--to", "c", "--precision", "half"], "double or single"),
        (["vgtu-piezo", "--to", "fmu", "--fmi", "1.0"], "2.0, 3.0 or both"),
        (["vgtu-piezo", "--to", "c", "--time-step", "-1 ms"], "'--time-step': must be from 1e-12"),
        (["vgtu-piezo", "--to", "c", "--time-step", "3 mm"], "not a unit of time"),
        (["vgtu-piezo", "--to", "c", "--hysteresis", "big"], "--hysteresis must be usual, none"),
        (["vgtu-piezo", "--to", "c", "--hysteresis", "x=missing.yaml"], "no file missing.yaml"),
        (["vgtu-piezo", "--to", "c", "--current", "0.1 A", "--model", "lumped"], "bandwidth"),
        (["vgtu-piezo", "--to", "dxf", "--kerf", "9 mm"], "wire"),
        (["vgtu-piezo", "--to", "mat", "--model", "rigid"], "rigid"),
        (["nowhere", "--to", "step"], "nowhere"),
    ],
)
def test_bad_input_is_refused_in_a_sentence(words, said, tmp_path: Path, capsys) -> None:
    out = tmp_path / "out"
    assert _run(*words, "--folder", str(out)) == 2
    captured = capsys.readouterr()
    assert said in captured.err
    assert captured.err.count("\n") == 1
    assert captured.out == ""
    assert not out.exists()


def test_all_leaves_out_what_the_stage_does_not_allow(tmp_path: Path, capsys) -> None:
    bare = replace(design("parallelogram"), drives=(), axes=(), published=Characteristics(()))
    file = tmp_path / "bare.yaml"
    write_stage(bare, file)
    out = tmp_path / "out"
    words = [str(file), "--to", "all", "--folder", str(out), "--model", "lumped", "--source-only"]
    assert _run(*words, "--json") == 0
    notes = json.loads(capsys.readouterr().out)["notes"]
    left = {note.split(" was skipped: ")[0] for note in notes if " was skipped: " in note}
    written = {p.name for p in out.iterdir()}
    assert left | written == {name for name, format in FORMATS.items() if format.in_all}
    assert left & written == set()
    assert {"fmu", "simulink", "c", "mat"} <= left
    assert {"step", "dxf", "drawing"} <= written
    # asked for by name it is refused
    assert _run(str(file), "--to", "step,fmu", "--folder", str(tmp_path / "two")) == 2
    assert not (tmp_path / "two").exists()


def test_notes_of_rigid_bodies_are_told_from_those_of_the_chosen_model(
    tmp_path: Path, capsys
) -> None:
    assert _run("parallelogram", "--to", "mat,diagram", "--folder", str(tmp_path), "--json") == 0
    notes = json.loads(capsys.readouterr().out)["notes"]
    assert any(note.startswith("Diagram and Simulink: Lumped model") for note in notes)
    assert not any(note.startswith("Lumped model") for note in notes)
