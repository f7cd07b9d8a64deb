"""The command line: what it prints, its exit status, and what it leaves behind."""

import io
import json
import platform
import sys
from pathlib import Path

import numpy as np
import pytest

import flexstage
from flexstage.base.errors import ConvergenceError
from flexstage.cli import main
from flexstage.quantities.characteristic import ORIGINS
from flexstage.quantities.quantity import QUANTITIES

#: For a study without its experiments on the simulated stage, nor traditional stages beside it.
BRIEFLY = ("--parts", "none")


def run(*words: str) -> int:
    with pytest.raises(SystemExit) as end:
        main(words)
    return int(end.value.code or 0)


@pytest.fixture(autouse=True)
def elsewhere(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Run in an empty directory, so that what is left behind is seen."""
    monkeypatch.chdir(tmp_path)
    return tmp_path


def left_behind(directory: Path) -> list[str]:
    return sorted(str(p.relative_to(directory)) for p in directory.rglob("*") if p.is_file())


@pytest.mark.usefixtures("undrawn")
def test_study_prints_a_table_and_writes_a_report(
    elsewhere: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run("study", "vgtu-piezo", "--model", "lumped", *BRIEFLY) == 0
    out = capsys.readouterr().out
    for text in (
        # units may stand in the next line
        "Natural frequency",
        "[Hz]",
        "Largest stress",
        "[MPa]",
        "reconstruction",
        "fitted to",
        "to measured",
    ):
        assert text in out
    assert "Claim of" not in out
    assert left_behind(elsewhere) == ["out/vgtu-piezo/report.html", "out/vgtu-piezo/results.json"]


def test_a_file_by_a_name_that_is_nearly_right_is_suggested(
    elsewhere: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (elsewhere / "stages").mkdir()
    for folder in ("", "stages/"):
        (elsewhere / folder / "guide.yaml").write_text("flexstage: 1\n")
        assert run("check", f"{folder}guide.yml") == 2
        assert f"did you mean '{folder}guide.yaml'?" in capsys.readouterr().err
    assert run("check", "vgtu-pieso") == 2
    assert "did you mean 'vgtu-piezo'?" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (b"stage:\n\tname: x\n", "line 2: this is not YAML: a tab is used for indentation"),
        (b"stage: 1\n\tname: x\n", "line 2: this is not YAML: a tab is used for indentation"),
        (b"\x89PNG\r\n\x1a\n\0\0\0\rIHDR", "is a picture or another binary file, expected a stage"),
        (
            b"flexstage: 1\ndesign: {name: parallelogram, thickness: 0,5}\n",
            "the decimal sign of a number must be a point",
        ),
        (b"flexstage: 1\ndesign:\n  name: parallelogram\n  thickness: 0,5 mm\n", "must be a point"),
        (None, "is called 'stack.yaml': the designs are "),
    ],
)
def test_a_file_that_cannot_be_meant_is_told_why(
    elsewhere: Path, capsys: pytest.CaptureFixture[str], text: bytes | None, said: str
) -> None:
    (elsewhere / "tab.yaml").write_text("")
    if text is not None:
        (elsewhere / "stack.yaml").write_bytes(text)
    assert run("check", "stack.yaml") == 2
    err = capsys.readouterr().err
    assert said in err
    assert err.count("\n") == 1


def test_help_is_a_word_too_and_hinges_say_how_a_profile_is_named(
    capsys: pytest.CaptureFixture[str],
) -> None:
    for words in ((), ("frf",)):
        assert run(*words, "--help") == 0
        wanted = capsys.readouterr().out
        assert run("help", *words) == 0
        assert capsys.readouterr().out == wanted
    assert run("hinges", "circular") == 2
    assert "name the profile by --profile" in capsys.readouterr().err
    assert run("hinges", "--profile", "v", "--depth", "1 mm") == 2  # as --profile v is
    assert "--half-angle" in capsys.readouterr().err


@pytest.mark.parametrize("model", ["superelement", "plane", "lumped"])
@pytest.mark.parametrize(
    ("change", "said"),
    [
        (("thinnest", "1 nm"), "notch of hinge 'left-lower' are too extreme to compute"),
        (("mass", "1e30 kg"), "body 'platform' has 1e+30 kg and 'left-leg' 0.00275 kg, too"),
        (("length_unit", "nm"), "hinge 'left-lower' is not attached to body 'base'"),
    ],
)
def test_what_no_model_computes_is_refused_before_any(
    elsewhere: Path, capsys: pytest.CaptureFixture[str], change: tuple[str, str], said: str,
    model: str,
) -> None:  # fmt: skip
    run("new", "parallelogram", "--spelled-out", "--out", "full.yaml")
    text = (elsewhere / "full.yaml").read_text()
    kind, value = change
    if kind == "mass":
        load = f"  platform:\n    extra_masses:\n    - {{mass: {value}, at: [0, 40]}}\n"
        text = text.replace("  platform:\n", load, 1)
    elif kind == "thinnest":
        text = text.replace("neck_thickness: 0.5 mm", f"neck_thickness: {value}")
    else:
        text = text.replace("length_unit: mm", f"length_unit: {value}")
    (elsewhere / "full.yaml").write_text(text)
    capsys.readouterr()
    assert run("analyse", "full.yaml", "--model", model, "-q") == 2
    assert said in capsys.readouterr().err


@pytest.mark.parametrize(
    ("begins", "what"),
    [
        ("  0\r\nSECTION\r\n  2\r\nHEADER\r\n", "a DXF drawing"),
        ("ISO-10303-21;\nHEADER;\n", "a STEP file"),
        ('<?xml version="1.0"?>\n<a/>', "XML or a web page"),
    ],
)
def test_a_file_of_another_kind_is_called_by_its_name(
    elsewhere: Path, capsys: pytest.CaptureFixture[str], begins: str, what: str
) -> None:
    (elsewhere / "part.yaml").write_text(begins)
    assert run("check", "part.yaml") == 2
    assert f"part.yaml is {what}, expected a YAML file" in capsys.readouterr().err


def test_help_has_a_short_option(capsys: pytest.CaptureFixture[str]) -> None:
    for words in (("-h",), ("check", "-h"), ("runs", "-h"), ("runs", "show", "-h")):
        assert run(*words) == 0
        short = capsys.readouterr().out
        assert run(*words[:-1], "--help") == 0
        assert capsys.readouterr().out == short
        assert "-h, --help" in short


@pytest.mark.usefixtures("undrawn")
def test_study_json_is_one_object(elsewhere: Path, capsys: pytest.CaptureFixture[str]) -> None:
    words = ("study", "parallelogram", "--model", "lumped,superelement", "--folder", "d", "--json")
    assert run(*words, "-q", *BRIEFLY) == 0
    captured = capsys.readouterr()
    rows = json.loads(captured.out)["characteristics"]
    assert captured.err == ""
    for row in rows:
        assert list(row) == ["quantity", "axis", "origin", "value", "unit", "uncertainty", "note",
                             "failing", "kind", "fitted_to"]  # fmt: skip
        assert row["origin"] in ORIGINS
        assert row["axis"] in ("x", "y", "xy", "stage")
        assert row["unit"] == QUANTITIES[row["quantity"]].unit
        assert isinstance(row["value"], float)
    written = json.loads((elsewhere / "d" / "results.json").read_text(encoding="utf-8"))
    assert written["characteristics"] == rows


def test_plane_stress_is_softer(capsys: pytest.CaptureFixture[str]) -> None:
    found = {}
    for plane in ("strain", "stress"):
        words = ("--model", "lumped", "--plane", plane, "--json")
        assert run("analyse", "vgtu-piezo", *words) == 0
        result = json.loads(capsys.readouterr().out)
        found[plane] = result["modes"]["removed"][0]["natural_frequency_hz"]
    assert found["stress"] < 0.96 * found["strain"]


def test_analyse_labels_the_condition_of_the_drives(capsys: pytest.CaptureFixture[str]) -> None:
    assert run("analyse", "vgtu-piezo", "--model", "lumped") == 0
    out = capsys.readouterr().out
    for text in ("drives removed", "drives in place", "drives locked", "free displacement", "xlko"):
        assert text in out


@pytest.mark.slow
@pytest.mark.usefixtures("undrawn")
def test_every_model_of_a_stage_side_by_side(
    elsewhere: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A small stage goes through those that a study has where none is chosen."""
    assert run("study", "parallelogram", "--folder", "d") == 0
    out = capsys.readouterr().out
    results = json.loads((elsewhere / "d" / "results.json").read_text("utf-8"))
    assert list(results["models"]) == ["lumped", "superelement", "plane", "superelement-3d"]
    assert results["skipped_models"] == {}
    found = {
        row["origin"]: row["value"]
        for row in results["characteristics"]
        if row["quantity"] == "natural_frequency_hz"
    }
    assert found["superelement"] == pytest.approx(found["plane"], rel=2e-3)
    assert found["plane"] == pytest.approx(found["superelement-3d"], rel=0.02)
    assert "superelement" in out
    assert results["models"]["plane"]["refinement"]["estimate"] <= 1e-3
    assert list(results["models"]["plane"]["strokes"]) == ["x"]


@pytest.mark.slow
@pytest.mark.usefixtures("undrawn")
def test_solid_elements_are_there_to_compare_with(
    elsewhere: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """They are the check of condensed bodies in space, and head the tables where asked for."""
    words = ("parallelogram", "--model", "lumped,superelement-3d,solid", "--folder", "d")
    assert run("study", *words, *BRIEFLY) == 0
    assert "solid" in capsys.readouterr().out
    results = json.loads((elsewhere / "d" / "results.json").read_text("utf-8"))
    found = {(r["quantity"], r["origin"]): r["value"] for r in results["characteristics"]}
    for quantity in ("natural_frequency_hz", "out_of_plane_frequency_hz", "input_stiffness"):
        condensed, whole = (found[quantity, model] for model in ("superelement-3d", "solid"))
        assert condensed == pytest.approx(whole, rel=1e-3)
    page = (elsewhere / "d" / "report.html").read_text("utf-8")
    assert "model solid" in page
    assert "middle plane" in page


@pytest.mark.slow
def test_analyse_refines_to_an_accuracy(capsys: pytest.CaptureFixture[str]) -> None:
    words = ("--model", "plane", "--accuracy", "0.05%", "--json", "--quiet")
    assert run("analyse", "parallelogram", *words) == 0
    captured = capsys.readouterr()
    assert captured.err == ""
    found = json.loads(captured.out)
    assert found["refinement"]["estimate"] <= 5e-4
    rows = {row["quantity"]: row for row in found["characteristics"]}
    assert (
        rows["natural_frequency_hz"]["uncertainty"] < 5e-4 * rows["natural_frequency_hz"]["value"]
    )
    assert rows["max_stress"]["uncertainty"] > 0.0


@pytest.mark.usefixtures("undrawn")
def test_analyse_writes_bode_data(elsewhere: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run("analyse", "parallelogram", "--folder", "a") == 0
    capsys.readouterr()
    assert left_behind(elsewhere) == ["a/analysis.json", "a/bode-x.svg"]
    responses = json.loads((elsewhere / "a" / "analysis.json").read_text("utf-8"))["responses"]
    assert [r["drives"] for r in responses] == ["removed", "in place"]
    removed = responses[0]
    assert len(removed["frequency_hz"]) == len(removed["real"]) == len(removed["imaginary"])


@pytest.mark.usefixtures("undrawn")
def test_analyse_writes_files_for_paraview(elsewhere: Path) -> None:
    words = ("--model", "plane", "--folder", "a", "--vtu")
    assert run("analyse", "parallelogram", *words) == 0
    written = left_behind(elsewhere)
    assert {"a/analysis.json", "a/vtu/static-x.vtu", "a/vtu/mode-01.vtu"} <= set(written)
    assert not any(name.endswith(".part") for name in written)


@pytest.mark.parametrize("name", ["s.pdf", "deep/er/S.SVG"])
def test_show_writes_a_drawing(elsewhere: Path, name: str) -> None:
    assert run("show", "parallelogram", "--out", name) == 0
    assert (elsewhere / name).stat().st_size > 5000
    assert left_behind(elsewhere) == [name]


@pytest.mark.usefixtures("undrawn")
def test_show_names_its_file_after_the_stage(elsewhere: Path) -> None:
    assert run("show", "vgtu-piezo") == 0
    assert left_behind(elsewhere) == ["vgtu-piezo.svg"]


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["study"], "STAGE"),
        (["study", "nothing.yaml"], "vgtu-mechanical"),
        (["study", "vgtu-piez"], "did you mean 'vgtu-piezo'"),
        (
            ["study", "vgtu-piezo", "--model", "lumped,solids"],
            "did you mean 'solid'",
        ),
        (["study", "vgtu-piezo", "--model", "magic"], "got 'magic'"),
        (["study", "vgtu-piezo", "--model", ","], "must name at least one of lumped"),
        (["study", "vgtu-piezo", "--plane", "flat"], "auto, stress or strain"),
        (["study", "vgtu-piezo", "--nonsense"], "--nonsense"),
        (["study", "."], "directory"),
        (["analyse", "vgtu-piezo", "--model", "superelements"], "did you mean 'superelement'"),
        (["analyse", "vgtu-piezo", "--model", "lumped", "--accuracy", "1%"], "plane or solid only"),
        (
            ["analyse", "vgtu-piezo", "--model", "plane", "--accuracy", "2"],
            'write "2 %"',
        ),
        (["analyse", "vgtu-piezo", "--model", "plane", "--accuracy", "fine"], "expected a share"),
        (["analyse", "vgtu-piezo", "--model", "solid", "--plane", "strain"], "no plane state"),
        (["analyse", "vgtu-piezo", "--model", "solid", "--stroke"], "choose plane"),
        (["analyse", "vgtu-piezo", "--model", "lumped", "--supports", "elastic"], "are rigid"),
        (["analyse", "vgtu-piezo", "--vtu", "--folder", "a"], "plane or solid"),
        (["analyse", "vgtu-piezo", "--supports", "soft"], "must be rigid or elastic"),
        (["show", "vgtu-piezo", "--out", "stage.gif"], ".svg, .png, .pdf"),
        (["show", "vgtu-piezo", "--out", "stage"], ".svg, .png, .pdf"),
        (["draw", "vgtu-piezo"], "draw"),
        (["check", ""], "called ''"),
        (["check", "x" * 5000], "no file is called"),
        (["study", "parallelogram", "--folder", ""], "an empty text"),
        (["--nonsense"], "--nonsense"),
    ],
    ids=lambda value: " ".join(value) if isinstance(value, list) else "",
)
def test_bad_input_is_one_sentence_and_status_2(
    elsewhere: Path, capsys: pytest.CaptureFixture[str], words: list[str], said: str
) -> None:
    assert run(*words) == 2
    captured = capsys.readouterr()
    assert captured.out == ""
    assert captured.err.count("\n") == 1
    assert captured.err.startswith("flexstage: ")
    assert said in captured.err
    assert left_behind(elsewhere) == []


def test_a_stage_without_axes_says_what_is_missing(
    elsewhere: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    corners = "{outline: [[0, 0], [30, 0], [30, 20], [0, 20]]}"
    (elsewhere / "plate.yaml").write_text(
        "flexstage: 1\nlength_unit: mm\nname: plate\nthickness: 8 mm\nmaterial: Invar 36\n"
        f"bodies:\n  plate: {corners}\n"
    )
    assert run("analyse", "plate.yaml", "--model", "lumped") == 0
    out = " ".join(capsys.readouterr().out.split())
    assert "The stage has no axis" in out
    # one body that nothing holds has three motions in the plane
    assert "3 of these modes, at 0 Hz" in out
    assert run("study", "plate.yaml") == 0
    out = " ".join(capsys.readouterr().out.split())
    assert "the stage has no axes" in out
    # finite elements need something that holds the stage, and say so
    assert "plane model skipped: no body of stage 'plate' is fixed" in out
    assert "superelement-3d model skipped: body 'plate' has no hinge" in out
    assert run("analyse", "plate.yaml", "--model", "plane") == 2
    assert "set 'fixed: true' on the body" in capsys.readouterr().err


def test_a_long_name_still_makes_a_directory(elsewhere: Path) -> None:
    text = (Path(__file__).parents[2] / "examples" / "parallelogram.yaml").read_text()
    name = "µ" * 80
    (elsewhere / "long.yaml").write_text(text.replace("parallelogram-example", name), "utf-8")
    assert run("show", "long.yaml") == 0


@pytest.mark.parametrize("command", [["study"], ["analyse"], ["show"]])
def test_a_place_that_cannot_be_written_is_status_1(
    elsewhere: Path, capsys: pytest.CaptureFixture[str], command: list[str]
) -> None:
    (elsewhere / "file").write_text("in the way")
    target = "file/stage.svg" if command == ["show"] else "file/out"
    # said before the minutes that a study can take
    option = "--out" if command == ["show"] else "--folder"
    assert run(command[0], "parallelogram", option, target, *command[1:]) == 1
    captured = capsys.readouterr()
    assert captured.out == ""
    assert captured.err.count("\n") == 1
    assert "file" in captured.err
    assert left_behind(elsewhere) == ["file"]


@pytest.mark.parametrize(
    ("error", "status"),
    [
        (ConvergenceError("the iteration ended\nafter 20 steps"), 1),
        (KeyboardInterrupt(), 130),
        (PermissionError(13, "Permission denied", "x.yaml"), 1),
    ],
    ids=["no convergence", "interrupt", "permission"],
)
def test_work_that_fails_leaves_nothing(
    elsewhere: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
    error: BaseException,
    status: int,
) -> None:
    def fail(*_: object, **__: object) -> None:
        raise error

    # the last thing before the files are written
    monkeypatch.setattr("flexstage.report.study.report_pages", fail)
    assert run("study", "parallelogram", "--model", "lumped", *BRIEFLY) == status
    captured = capsys.readouterr()
    assert captured.out == ""
    assert captured.err.count("\n") == 1
    assert left_behind(elsewhere) == []


def test_a_character_of_code_0_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    assert run("show", "parallelogram", "--figure", "a\0.svg") == 2
    captured = capsys.readouterr()
    assert captured.out == ""
    assert captured.err.count("\n") == 1
    assert "NUL character" in captured.err


def test_version_and_help(capsys: pytest.CaptureFixture[str]) -> None:
    assert run("--version") == 0
    assert capsys.readouterr().out == f"flexstage {flexstage.__version__}\n"
    assert run("--version", "--verbose") == 0
    lines = capsys.readouterr().out.splitlines()
    assert f"Python {platform.python_version()}, {platform.platform()}" in lines
    assert f"numpy {np.__version__}" in lines
    assert not any(line.startswith("pytest") for line in lines)
    assert run("--verbose") == 2
    assert "--verbose needs --version" in capsys.readouterr().err
    for words in ([], ["--help"]):
        assert run(*words) == 0
        out = capsys.readouterr().out
        for command in ("study", "show", "check", "analyse", "equations", "hinges"):
            assert f"  {command} " in out


def test_output_goes_where_letters_are_few(monkeypatch: pytest.MonkeyPatch) -> None:
    """A stream that knows ASCII alone gets question marks and no traceback."""
    said = io.BytesIO()
    monkeypatch.setattr("sys.stdout", io.TextIOWrapper(said, encoding="ascii"))
    assert run("analyse", "parallelogram", "--model", "lumped") == 0
    sys.stdout.flush()
    assert b"?m" in said.getvalue()
