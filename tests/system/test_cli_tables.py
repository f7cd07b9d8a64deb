"""What is printed for people: tables whose names stand beside their text, equal findings once."""

import io
import json
import re
from pathlib import Path

import pytest
from rich.console import Console

from flexstage.characteristic import Characteristic
from flexstage.cli import main
from flexstage.cli.output import on_terminal
from flexstage.comparison import compare
from flexstage.report.page import table_html
from flexstage.report.tables import characteristics_table
from flexstage.studies.results import characteristic_row
from flexstage.table import table

EXAMPLE = Path(__file__).parents[1] / "spelled_out_parallelogram.yaml"


def test_a_name_is_beside_the_first_line_of_its_text() -> None:
    row = ("Thermal drift", "2.75", "drives in place, and a text that has to be broken")
    shown = table("drift", ("quantity", "published\nFEM", "<condition"), [row])
    written = io.StringIO()
    Console(width=48, file=written).print(on_terminal(shown))
    lines = written.getvalue().splitlines()
    first = next(line for line in lines if "Thermal drift" in line)
    assert "2.75" in first
    assert "drives in place" in first
    head = next(line for line in lines if "quantity" in line)
    assert "FEM" in head, "a heading is just above its column"


def checked(capsys: pytest.CaptureFixture[str], path: Path, *words: str) -> tuple[list[str], str]:
    with pytest.raises(SystemExit) as end:
        main(["check", str(path), *words])
    assert end.value.code == 2
    printed = capsys.readouterr()
    return printed.err.splitlines(), printed.out


def test_one_slip_in_every_hinge_is_told_once(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    text = EXAMPLE.read_text(encoding="utf-8")
    path = tmp_path / "wide.yaml"
    path.write_text(text.replace("radius: 1.5}", "radius: 4.5}"), encoding="utf-8")
    lines, _ = checked(capsys, path)
    assert [line.split(maxsplit=2)[:2] for line in lines] == [["error:", "hinge"], ["the", "same"]]
    assert lines[1].startswith(
        "  the same for 7 more: left foot at left leg; left head at left leg"
    )
    _, printed = checked(capsys, path, "--json")
    assert len(json.loads(printed)["findings"]) == 8


def test_what_is_wrong_in_two_ways_is_told_twice(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    text = EXAMPLE.read_text(encoding="utf-8").replace("radius: 1.5}", "radius: 4.5}", 1)
    path = tmp_path / "two.yaml"
    path.write_text(re.sub(r"at: \[81, 53\]", "at: [181, 53]", text), encoding="utf-8")
    lines, _ = checked(capsys, path)
    assert sum(line.startswith("error: hinge") for line in lines) == 1
    assert sum(line.startswith("error: probe") for line in lines) == 1


def test_a_figure_that_fails_its_criterion_is_marked_by_a_word_and_a_colour() -> None:
    rows = [
        Characteristic(quantity="fatigue_safety", axis=a, origin="lumped", value=v, unit="1")
        for a, v in (("x", 0.5132), ("y", 1.31))
    ]
    assert [row.failing for row in rows] == ["at least 1 is required", ""]
    assert characteristic_row(rows[0])["failing"] == "at least 1 is required"
    made = characteristics_table(compare(rows), ("fatigue_safety",), "safety")
    assert made is not None
    low, high = re.findall(r"<td[^>]*data-value.*?</td>", table_html(made), flags=re.DOTALL)
    assert 'class="ours fails"' in low
    assert "<small>fails: at least 1 is required</small>" in low
    assert "fails" not in high
