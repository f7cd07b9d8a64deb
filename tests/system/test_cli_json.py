"""`--json`: one object on standard output from every command, of a result and of a refusal."""

import json
from pathlib import Path
from typing import Any

import pytest
import typer

from flexstage.cli import app, main

#: A call of each command that is refused: a file that is not there, or too little.
REFUSED = {
    "new": ["nowhere"],
    "import": ["nowhere.dxf"],
    "study": ["nowhere.yaml"],
    "show": ["nowhere.yaml"],
    "check": ["nowhere.yaml"],
    "analyse": ["nowhere.yaml"],
    "budget": ["nowhere.yaml", "--environment", "nowhere.yaml"],
    "sensitivity": ["nowhere.yaml"],
    "optimise": ["parallelogram"],
    "reconstruct": ["parallelogram"],
    "sweep": ["parallelogram"],
    "tolerance": ["nowhere.yaml"],
    "equations": ["nowhere.yaml"],
    "export": ["nowhere.yaml", "--to", "step"],
    "hinges": ["--profile", "round"],
    "part": ["nowhere.step"],
    "records": ["nowhere.csv"],
    "excite": ["nowhere.yaml"],
    "identify": ["nowhere.csv", "--input", "0", "--output", "1"],
    "predict": ["nowhere.yaml", "nowhere.csv", "--input", "0", "--output", "1"],
    "compensate": ["nowhere.yaml", "--reference", "nowhere.csv"],
    "settle": ["nowhere.yaml", "--move", "1 um"],
    "tune": ["--frf", "nowhere.csv"],
    "characterise": ["nowhere.yaml"],
    "frf": ["nowhere.csv", "--input", "0", "--output", "1"],
    "uncertainty": ["nowhere.yaml"],
    "scale": ["nowhere.yaml"],
    "centre": ["nowhere.csv", "--error", "1", "--angle", "0"],
    "calibrate": ["nowhere.csv"],
    "run": ["nowhere.yaml"],
    "twin": ["nowhere.yaml"],
    "serve": ["--address", "0.0.0.0:8321"],
    "runs": ["--since", "yesteryear"],
    "runs show": ["0", "--catalogue", "folder/none.db"],
    "runs add": ["nowhere"],
    "runs recover": ["nowhere.raw"],
    "runs calibrations": ["--at", "yesteryear"],
}


def commands() -> dict[str, Any]:
    """Every command of the program, by its words."""

    def within(words: str, group: Any) -> dict[str, Any]:
        found: dict[str, Any] = {}
        for name, command in getattr(group, "commands", {}).items():
            path = f"{words} {name}".strip()
            found |= {path: command} | within(path, command)
        return found

    return within("", typer.main.get_command(app))


def refused(capsys: pytest.CaptureFixture[str], *words: str) -> tuple[dict[str, Any], str, int]:
    """The object on standard output, the sentence on the other one, and the exit status."""
    with pytest.raises(SystemExit) as end:
        main(words)
    printed = capsys.readouterr()
    return json.loads(printed.out)["error"], printed.err, int(end.value.code or 0)


@pytest.fixture(autouse=True)
def elsewhere(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


def test_every_command_takes_it() -> None:
    assert {
        name for name, c in commands().items() if any("--json" in p.opts for p in c.params)
    } == set(REFUSED)
    assert set(commands()) == set(REFUSED)


@pytest.mark.parametrize("command", sorted(REFUSED))
def test_a_refusal_is_an_object_as_well(capsys: pytest.CaptureFixture[str], command: str) -> None:
    error, sentence, status = refused(capsys, *command.split(), *REFUSED[command], "--json")
    assert sentence == f"flexstage: {error['message']}\n"
    assert error["status"] == status in (1, 2)
    assert error["kind"].isidentifier()


@pytest.mark.parametrize(
    ("words", "kind"),
    [
        (["analyse", "parallelogram", "--mdel", "plane", "--json"], "UsageError"),
        (["analysse", "parallelogram", "--json"], "UsageError"),
        (["analyse", "--json"], "UsageError"),
        (["analyse", "parallelogram", "--model", "liquid", "--json"], "UsageError"),
        (["analyse", "parallelogram", "--model", "lumped", "--stroke", "--json"], "ModelError"),
    ],
)
def test_so_is_a_command_line_that_is_wrong(
    capsys: pytest.CaptureFixture[str], words: list[str], kind: str
) -> None:
    error, _, status = refused(capsys, *words)
    assert (error["kind"], status) == (kind, 2)


def test_without_it_a_refusal_prints_nothing_there(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        main(["check", "nowhere.yaml"])
    assert capsys.readouterr().out == ""


def test_behind_a_double_dash_it_is_the_name_of_a_file(
    capsys: pytest.CaptureFixture[str],
) -> None:
    with pytest.raises(SystemExit):
        main(["check", "--", "--json"])
    assert capsys.readouterr().out == ""


def test_a_drawing_says_where_it_is(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        main(["show", "parallelogram", "--out", "p.svg", "--json"])
    assert json.loads(capsys.readouterr().out) == {"stage": "parallelogram", "files": ["p.svg"]}
    assert Path("p.svg").read_bytes().startswith(b"<?xml")


@pytest.mark.parametrize(
    ("form", "begins"),
    [("svg", "<svg"), pytest.param("latex", "\\documentclass", marks=pytest.mark.slow)],
)
def test_equations_in_a_file_are_printed_as_an_object_beside_it(
    capsys: pytest.CaptureFixture[str], form: str, begins: str
) -> None:
    words = ("equations", "parallelogram", "--to", form, "--out", "file", "--json")
    with pytest.raises(SystemExit) as end:
        main(words)
    assert not end.value.code
    assert json.loads(capsys.readouterr().out)["files"] == ["file"]
    assert begins in Path("file").read_text(encoding="utf-8")[:200]
