"""The command `equations`."""

import json
from pathlib import Path
from xml.etree import ElementTree

import pytest

from flexstage.cli import main


def run(capsys: pytest.CaptureFixture[str], *arguments: str) -> tuple[int, str, str]:
    with pytest.raises(SystemExit) as ended:
        main(["equations", *arguments])
    said = capsys.readouterr()
    return int(ended.value.code or 0), said.out, said.err


def test_text_of_a_guide(capsys: pytest.CaptureFixture[str]) -> None:
    status, out, _ = run(capsys, "parallelogram")
    assert status == 0
    assert "Equations of motion of parallelogram" in out
    assert "antisymmetric motion about the mirror" in out
    assert "Transfer functions" in out


def test_latex_goes_to_a_file(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    path = tmp_path / "stage.tex"
    status, _, _ = run(capsys, "vgtu-piezo", "--to", "latex", "--out", str(path), "--axis", "y")
    assert status == 0
    text = path.read_text(encoding="utf-8")
    assert text.startswith(r"\documentclass")
    assert "static condensation" in text


@pytest.mark.slow
def test_json_is_one_object(capsys: pytest.CaptureFixture[str]) -> None:
    status, out, _ = run(capsys, "vgtu-mechanical", "--json", "--reduce", "condense")
    assert status == 0
    data = json.loads(out)
    assert data["order"] == 60
    assert {t["drive"] for t in data["transfer_functions"]} == {"x", "y"}
    # the two lowest poles are the two published modes of the lumped model, to Guyan's per cent
    poles = data["transfer_functions"][0]["poles_hz"]
    assert poles[0] == pytest.approx(527.0, rel=0.02)
    assert poles[1] == pytest.approx(742.0, rel=0.02)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("parallelogram", "--to", "pdf"), "'--to': must be text, latex or svg, got 'pdf'"),
        (("parallelogram", "--axis", "z"), "the axis 'z', which does not exist"),
        (("vgtu-piezo", "--reduce", "symmetry"), "reduce it by condensation"),
        (("no-such-stage",), "no-such-stage"),
    ],
)
def test_bad_input_is_one_sentence(
    capsys: pytest.CaptureFixture[str], arguments: tuple[str, ...], message: str
) -> None:
    status, out, err = run(capsys, *arguments)
    assert status == 2
    assert message in err
    assert not out
    assert err.count("\n") == 1


def test_the_structural_diagram_is_drawn(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    file = tmp_path / "x.svg"
    words = ("parallelogram", "--to", "svg", "--axis", "x")
    status, out, _ = run(capsys, *words, "--out", str(file))
    assert status == 0
    assert str(file) in out.replace("\n", "")
    root = ElementTree.fromstring(file.read_bytes())
    text = " ".join("".join(t.itertext()) for t in root.iter() if t.tag.endswith("}text"))
    assert "axis x" in text
    assert "damper" in text
    status, out, err = run(capsys, *words, "--json")
    assert (status, err) == (0, "")
    assert json.loads(out)["diagram"] == file.read_text(encoding="utf-8")
