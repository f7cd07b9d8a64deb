"""The examples of the manual run, and print what the theory at their top says."""

import math
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import pytest

from docs.examples import notch_comparison, parallelogram_guide, piezo_stage
from tests.notebooks import code_cells, run_cell

NOTEBOOK = Path(__file__).parents[2] / "docs" / "examples" / "first_stage.ipynb"


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


@pytest.mark.slow
def test_the_notebook_shows_what_it_prints(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    names: dict[str, Any] = {}
    pictures = 0
    for cell in code_cells(NOTEBOOK):
        printed, value = run_cell("".join(cell["source"]), names)
        shown = {"stream": printed, "execute_result": repr(value)}
        for output in cell["outputs"]:
            stored = output.get("text") or output["data"]["text/plain"]
            assert "".join(stored) == shown[output["output_type"]]
        picture = getattr(value, "_repr_svg_", None) or getattr(value, "_repr_html_", None)
        if picture is not None:
            assert ElementTree.fromstring(picture()).tag
            pictures += 1
    assert pictures == 5
