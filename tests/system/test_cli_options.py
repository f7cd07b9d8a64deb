"""An option means one thing in every command."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from flexstage.cli import main
from tests.system.test_cli_json import commands

#: What differs in writing and not in meaning.
ONE_MEANING = {
    "--after": "the state before a record; the words are those that apply",
    "--amplifier": "the amplifier of a stack: its kind, or what it can do",
    "--column": "a column; of a test with its role, and several times",
    "--material": "a material of the catalogue; of a part also by its constants, by solid",
    "--model": "a model of the mechanics; a twin has the two that run in real time",
    "--move": "a move of a stage: carried out, or its distance",
    "--output": "the output, or the outputs where a command takes several",
    "--stage": "a stage, or in a list of runs the name of one",
    "--to": "the format that is written",
}


def printed(capsys: pytest.CaptureFixture[str], *words: object) -> dict[str, Any]:
    with pytest.raises(SystemExit) as end:
        main([str(word) for word in words])
    said = capsys.readouterr()
    assert not end.value.code, said.err
    return json.loads(said.out)


def test_an_option_has_one_meaning() -> None:
    found: dict[str, set[tuple[str | None, bool]]] = {}
    for command in commands().values():
        for p in command.params:
            for name in p.opts if p.param_type_name == "option" else ():
                found.setdefault(name, set()).add((p.metavar, bool(p.is_flag)))
    assert {name for name, kinds in found.items() if len(kinds) > 1} == set(ONE_MEANING)


def test_behind_a_double_dash_no_name_is_replaced(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        main(["records", "--", "--out"])
    assert "'--out'" in capsys.readouterr().err


def test_a_bare_number_has_the_unit_of_the_help(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    angle = np.arange(0.0, 360.0, 5.0)
    error = 3.0 * np.cos(np.radians(angle) - 0.4) + 0.01 * np.sin(np.radians(7.0 * angle))
    file = tmp_path / "r.csv"
    np.savetxt(file, np.column_stack([angle, error]), delimiter=",")
    scale = ("centre", file, "--angle", "0 deg", "--error", "1 arcsec", "--json",
             "--radius", "50 mm", "--kind", "disc")  # fmt: skip

    def move(*words: str) -> tuple[float, float]:
        found = printed(capsys, *scale, *words)["move"]
        return found["x"], found["y"]

    bare = move("--mounting-angle", "30")
    assert bare == pytest.approx(move("--mounting-angle", "0.5235987755982988 rad"), rel=1e-12)
    assert bare != pytest.approx(move(), rel=0.1)


def test_measured_files_are_cut_by_the_same_options(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    rng = np.random.default_rng(5)
    reading = 1e-3 * rng.normal(size=4000)
    reading[:500] += 7.0  # before the stage was left alone
    rows = "\n".join(f"{value:.9f}" for value in reading)
    (tmp_path / "log.csv").write_text(f"a logger's first line\nand its second\n{rows}\n")
    (tmp_path / "cut.csv").write_text("\n".join(rows.splitlines()[500:]) + "\n")
    hold = ("--test", "hold", "--column", "along=0 um", "--sample-rate",
            "1 kHz", "--json")  # fmt: skip
    cut = printed(capsys, "characterise", tmp_path / "cut.csv", *hold)
    log = (tmp_path / "log.csv", "--text", "skip=2", *hold)
    same = printed(capsys, "characterise", *log, "--rows", "500:")
    figures = "characteristics" if "characteristics" in cut else "measured"
    assert cut[figures] == same[figures]
    assert printed(capsys, "characterise", *log)[figures] != cut[figures]


@pytest.mark.usefixtures("undrawn")
def test_several_models_are_printed_each_by_its_name(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    found = printed(
        capsys, "analyse", "parallelogram", "--model", "lumped,superelement", "--json",
        "--folder", tmp_path / "a", "--figure", tmp_path / "bode.png",
    )  # fmt: skip
    assert list(found["models"]) == ["lumped", "superelement"]
    alone = printed(capsys, "analyse", "parallelogram", "--model", "lumped", "--json")
    assert found["models"]["lumped"]["characteristics"] == alone["characteristics"]
    assert sorted(str(p.relative_to(tmp_path)) for p in tmp_path.rglob("*") if p.is_file()) == [
        "a/lumped/analysis.json", "a/lumped/bode-x.svg", "a/superelement/analysis.json",
        "a/superelement/bode-x.svg", "bode-lumped-x.png", "bode-superelement-x.png",
    ]  # fmt: skip
    assert len(found["files"]) == 6


@pytest.mark.slow
def test_all_leaves_out_what_is_impossible(capsys: pytest.CaptureFixture[str]) -> None:
    words = ("analyse", "parallelogram", "--model", "all", "--stroke", "--json")
    found = printed(capsys, *words)
    assert list(found["models"]) == ["plane"]
    assert set(found["skipped_models"]) == {"lumped", "superelement", "superelement-3d", "solid"}
    plane = found["models"]["plane"]
    assert plane["bar_buckling_load"].keys() == {"left-leg", "right-leg"}
    rows = {row["quantity"] for row in plane["characteristics"]}
    assert {"straightness", "buckling_factor"} <= rows
