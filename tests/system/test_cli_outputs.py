"""Where results go is looked at before the work, and so is what the work needs."""

import os
from pathlib import Path

import pytest

from flexstage.cli import main

EXAMPLE = Path(__file__).parents[1] / "spelled_out_parallelogram.yaml"
#: A call of every command with an output that would compute long if it began.
WRITING = [
    ["study", "parallelogram", "--folder"],
    ["show", "parallelogram", "--out"],
    ["new", "parallelogram", "--out"],
    ["new", "parallelogram", "--folder"],
    ["analyse", "parallelogram", "--folder"],
    ["equations", "parallelogram", "--out"],
    ["export", "parallelogram", "--to", "step", "--folder"],
    ["excite", "vgtu-piezo", "--out"],
    ["identify", "r.csv", "--input", "0", "--output", "1", "--out"],
    ["identify", "r.csv", "--input", "0", "--output", "1", "--figure"],
    ["predict", "m.yaml", "r.csv", "--input", "0", "--output", "1", "--figure"],
    ["compensate", "m.yaml", "--reference", "r.csv", "--out"],
    ["settle", "vgtu-piezo", "--move", "1 um", "--out"],
    ["settle", "vgtu-piezo", "--move", "1 um", "--figure"],
    ["tune", "--frf", "r.csv", "--figure"],
    ["characterise", "--stage", "parallelogram", "--virtual-seed", "1", "--folder"],
    ["frf", "r.csv", "--input", "0", "--output", "1", "--out"],
    ["frf", "r.csv", "--input", "0", "--output", "1", "--figure"],
    ["uncertainty", "b.yaml", "--figure"],
    ["scale", "t.yaml", "--figure"],
    ["centre", "r.csv", "--error", "1", "--angle", "0", "--figure"],
    ["calibrate", "r.csv", "--folder"],
    ["calibrate", "r.csv", "--figure"],
    ["part", "p.step", "--figure"],
    ["run", "vgtu-piezo", "--instrument", "twin://", "--folder"],
    ["runs", "recover", "r.raw", "--out"],
]


def refused(capsys: pytest.CaptureFixture[str], *words: str) -> tuple[int, str]:
    with pytest.raises(SystemExit) as end:
        main(words)
    printed = capsys.readouterr()
    assert printed.out == ""
    assert printed.err.count("\n") == 1
    return int(end.value.code or 0), printed.err


@pytest.mark.parametrize("words", WRITING, ids=" ".join)
def test_a_place_that_takes_no_file_is_refused_at_once(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    words: list[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    for name in ("r.csv", "m.yaml", "b.yaml", "p.step", "r.raw"):
        Path(name).write_text("never read")
    Path("blocked").write_text("a file, and no folder")
    status, said = refused(capsys, *words, "blocked/in/result.svg")
    assert (status, "'blocked'" in said) == (1, True)
    if os.name == "posix":
        # where even the system's own user makes no file
        status, said = refused(capsys, *words, "/proc/result.svg")
        assert (status, "'/proc': no file can be created there" in said) == (1, True)


@pytest.mark.parametrize("words", [w for w in WRITING if w[-1] == "--figure"] + [WRITING[1]])
def test_a_folder_is_no_file(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    words: list[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("plots.svg").mkdir()
    status, said = refused(capsys, *words, "plots.svg")
    assert (status, "'plots.svg': it is a folder: name a file in it" in said) == (1, True)


@pytest.fixture
def without_range(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A stage whose stack says its stroke and stiffness, and no range of voltage."""
    monkeypatch.chdir(tmp_path)
    import re

    text = EXAMPLE.read_text(encoding="utf-8")
    made = re.sub(r"\n *voltage_range:[^\n]*", "", text)
    assert made != text
    (tmp_path / "plain.yaml").write_text(made, encoding="utf-8")
    return tmp_path / "plain.yaml"


@pytest.mark.parametrize("form", ["fmu", "c", "mat", "simulink", "diagram", "step,c"])
def test_a_stack_without_range_is_refused_before_the_mechanics(
    without_range: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    form: str,
) -> None:
    def computed(*_: object, **__: object) -> None:
        raise AssertionError("the mechanics were computed")

    monkeypatch.setattr("flexstage.studies.run_model", computed)
    monkeypatch.setattr("flexstage.lumped.lumped_system", computed)
    status, said = refused(capsys, "export", str(without_range), "--to", form)
    assert status == 2
    assert "voltage_range: [0 V, 120 V]" in said
    assert "--hysteresis none" in said


def test_without_hysteresis_it_is_written(without_range: Path) -> None:
    words = ["export", str(without_range), "--to", "c", "--model", "lumped"]
    with pytest.raises(SystemExit) as end:
        main([*words, "--hysteresis", "none"])
    assert not end.value.code
    assert list(Path("exported").glob("*.h"))


@pytest.mark.usefixtures("undrawn")
def test_a_study_says_why_there_is_no_hysteresis(
    without_range: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit):
        main(
            [
                "study",
                str(without_range),
                "--model",
                "lumped",
                "--parts",
                "identification,traditional",
            ]
        )
    said = " ".join(capsys.readouterr().out.split())
    assert "hysteresis of axis x skipped" in said
    assert "voltage_range: [0 V, 120 V]" in said
    report = next(Path("out").rglob("report.html")).read_text(encoding="utf-8")
    assert "voltage_range: [0 V, 120 V]" in report.replace("&#x27;", "'")
