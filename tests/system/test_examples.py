"""The examples of the manual run, and print what the theory at their top says."""

import json
import math
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import pytest

from docs.examples import notch_comparison, parallelogram_guide, piezo_stage
from flexstage.stage.designs import design
from flexstage.virtual import as_built
from tests.notebooks import code_cells, run_cell

EXAMPLES = Path(__file__).parents[2] / "docs" / "examples"


def test_parallelogram_guide(capsys: pytest.CaptureFixture[str]) -> None:
    figures = parallelogram_guide.main()
    printed = capsys.readouterr().out
    assert len(printed.splitlines()) == len(figures)
    for name, tolerance in (("stiffness", 1e-3), ("frequency", 1e-3), ("sinking", 3e-3)):
        # the give of the necks along and across is what the theory leaves out
        by_hand, computed = (v for k, v in figures.items() if k.startswith(name))
        assert computed == pytest.approx(by_hand, rel=tolerance)
    # 0.2 mm on legs whose necks are 30 mm apart
    assert figures["sinking by hand [um]"] == pytest.approx(0.2e-3**2 / 0.06 * 1e6, rel=1e-4)
    assert figures["frequency, lumped [Hz]"] == pytest.approx(193.66, abs=0.01)
    assert "193.66" in printed


def test_piezo_stage(capsys: pytest.CaptureFixture[str]) -> None:
    figures = piezo_stage.main()
    printed = capsys.readouterr().out
    share = figures["share of the free stroke [%]"] / 100.0
    assert figures["elongation in place [um]"] == pytest.approx(38.0 * share, rel=1e-9)
    # the y stack in place does not change the ratio: both outputs are shares of each other
    assert figures["output, stack in place [um]"] == pytest.approx(
        share * figures["output, stroke imposed [um]"], rel=1e-9
    )
    assert figures["output, stroke imposed [um]"] == pytest.approx(67.54, abs=0.01)
    # after a ramp of T a mode of frequency f swings on by at most |sin(pi f T)|/(pi f T)
    f = figures["frequency, in place [Hz]"]
    bound = abs(math.sin(math.pi * f * 2e-3)) / (math.pi * f * 2e-3)
    assert figures["overshoot after the ramp [%]"] == pytest.approx(100.0 * bound, rel=0.1)
    assert "910.3" in printed


def test_notch_comparison(capsys: pytest.CaptureFixture[str]) -> None:
    rows = notch_comparison.main()
    assert len(capsys.readouterr().out.splitlines()) == len(rows) + 1
    for beam, wedge, allowed, length in rows.values():
        # spreading stress makes a notch softer, by some per cent
        assert 0.88 < wedge / beam < 0.99
        assert 30.0 < allowed < 120.0
        # between the neck and the length of the notch
        assert 0.4 < length < 4.0
    order = sorted(rows, key=lambda name: rows[name][2])
    assert order == ["parabolic", "circular", "elliptical", "corner-filleted"]
    assert [rows[name][3] for name in order] == sorted(row[3] for row in rows.values())
    assert rows["circular"][1] == pytest.approx(3.890, abs=0.001)


def _first_stage(names: dict[str, Any], printed: str) -> None:
    # platform and two legs that turn about their feet, on four notches 28 mm apart
    legs = 2.0 * 5e-3 * 24e-3 * (0.25 + (5e-3**2 + 24e-3**2) / (12.0 * 28e-3**2))
    upper_notches = 2.0 * (4.5e-3 * 4e-3 - math.pi * 2e-3**2)
    area = 45e-3 * 12e-3 + legs + upper_notches
    mass = 10e-3 * area * names["stage"].material.density
    stiffness = 4.0 * names["notch"].stiffness("rotation") / 28e-3**2
    by_hand = math.sqrt(stiffness / mass) / (2.0 * math.pi)
    assert names["result"].value("natural_frequency_hz", "x") == pytest.approx(by_hand, rel=5e-3)
    assert "0.5 mm: 221.7 Hz, 106.9 MPa" in printed


def _own_records(names: dict[str, Any], printed: str) -> None:
    creep = names["rate"]
    true = names["creep"].rate_per_decade
    assert abs(creep["value"] - true) < 3.0 * creep["standard_error"] < 0.3 * true
    assert names["found"].kind == "preisach"
    assert names["prediction"].as_predicted_rms_percent < 0.1
    # the last one is by the inverse, on the stack that made the records
    assert names["error"].rms < 60e-9
    assert "creep 1.5" in printed


def _bench(names: dict[str, Any], printed: str) -> None:
    truth = as_built(design("vgtu-piezo"), seed=3).axis("x")
    # creep and the cycle of 1 s add a little to what is true of slow ones
    assert names["stroke"] == pytest.approx(truth.stroke, rel=0.05)
    assert names["width"] == pytest.approx(truth.loop_width(), rel=0.1)
    assert "voltage changes by 0.0 V" in printed
    assert "cannot be sent to 90 um" in printed


def _encoder_scale(names: dict[str, Any], printed: str) -> None:
    for found, true in (("found", names["true"]), ("both", names["left"])):
        said = names[found].to_dict()["eccentricity"]
        low, high = said["interval"]
        assert low < math.hypot(*true) < high < low + 30e-9
    # the stage moves 0.4 % too far
    assert math.hypot(*names["left"]) == pytest.approx(0.004 * math.hypot(*names["true"]), rel=0.1)
    assert "order 2:    3." in printed


@pytest.mark.parametrize(
    ("name", "pictures", "check"),
    [
        pytest.param("first_stage", 5, _first_stage, marks=pytest.mark.slow),
        pytest.param("own_records", 3, _own_records, marks=pytest.mark.slow),
        pytest.param("bench", 1, _bench, marks=pytest.mark.slow),
        ("encoder_scale", 2, _encoder_scale),
    ],
)
def test_a_notebook_shows_what_made_its_data(
    name: str,
    pictures: int,
    check: Callable[[dict[str, Any], str], None],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.chdir(tmp_path)
    names: dict[str, Any] = {}
    said = ""
    drawn = 0
    for cell in code_cells(EXAMPLES / f"{name}.ipynb"):
        printed, value = run_cell("".join(cell["source"]), names)
        said += printed
        picture = getattr(value, "_repr_svg_", None) or getattr(value, "_repr_html_", None)
        if picture is not None:
            assert ElementTree.fromstring(picture()).tag
            drawn += 1
    assert drawn == pictures
    check(names, said)


def test_notebooks_are_stored_without_outputs_and_say_where_to_read_on() -> None:
    books = sorted(EXAMPLES.glob("*.ipynb"))
    assert len(books) == 4
    for book in books:
        assert not any(cell["outputs"] or cell["execution_count"] for cell in code_cells(book))
        last = json.loads(book.read_text("utf-8"))["cells"][-1]
        links = re.findall(r"\]\(([^)]+)\)", "".join(last["source"]))
        assert len(links) > 2
        assert [link for link in links if not (EXAMPLES / link).is_file()] == []
