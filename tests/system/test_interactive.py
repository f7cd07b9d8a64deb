"""`import flexstage as fs`: one import, and results that show themselves."""

import json
import re
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType
from xml.etree import ElementTree

import numpy as np
import pytest

import flexstage as fs
from flexstage import report
from flexstage.errors import HingeError, ModelError, StageError
from flexstage.interactive.hinge_result import HingeResult
from flexstage.interactive.stage_analysis import StageAnalysis
from flexstage.interactive.stage_study import StageStudy
from flexstage.short_repr import short_repr
from flexstage.stage import write_stage

LONGEST = 600  # characters of a text on a few lines


@pytest.fixture(scope="module")
def analysed() -> StageAnalysis:
    return fs.analyse("vgtu-piezo", "lumped")


@pytest.fixture(scope="module")
def studied() -> StageStudy:
    return fs.study("vgtu-piezo", ["lumped"])


@pytest.fixture(scope="module")
def notch() -> HingeResult:
    return fs.hinge("elliptical", neck_thickness="0.37 mm", half_length=1.3e-3, notch_depth="2 mm")


def test_the_names_are_listed() -> None:
    wanted = {"read", "design", "draw", "analyse", "study", "hinge", "read_record", "designs"}
    assert wanted <= set(dir(fs))
    with pytest.raises(AttributeError, match="has no attribute 'analyze'"):
        fs.analyze  # type: ignore[attr-defined]  # noqa: B018


def test_a_name_can_be_replaced_by_a_module(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(fs, "draw", json)
    assert fs.draw is json


def test_a_stage_is_read_by_file_or_by_name(tmp_path: Path) -> None:
    stage = fs.design("parallelogram")
    write_stage(stage, tmp_path / "guide.yaml")
    assert fs.read(tmp_path / "guide.yaml") == stage == fs.read("parallelogram")
    with pytest.raises(StageError, match="did you mean 'vgtu-piezo'"):
        fs.read("vgtu-pieso")
    # whatever takes a stage takes its name or file as well
    by_file = fs.analyse(str(tmp_path / "guide.yaml"), "lumped")
    assert by_file.value("max_stress", "x") == fs.analyse(stage, "lumped").value("max_stress", "x")


def test_texts_are_short(analysed: StageAnalysis, studied: StageStudy, notch: HingeResult) -> None:
    analysis = analysed.analysis
    large = [
        analysed, studied, notch, analysis, analysed.run, analysed.system, analysis.stage,
        analysis.characteristics, analysis.axes[0], analysis.axes[0].static,
        analysis.modes["removed"], analysis.responses[0], studied.study, studied.study.comparison,
    ]  # fmt: skip
    for thing in large:
        assert 10 < len(repr(thing)) < LONGEST, type(thing).__name__
    assert "natural frequency: x 326.0, y 538.7 Hz" in repr(analysed)
    assert "hinges=<32>" in repr(analysis.stage)


def test_an_array_is_shown_by_its_size_or_its_one_value() -> None:
    @dataclass
    class Pair:
        many: np.ndarray
        one: np.ndarray

    assert short_repr(Pair(np.zeros((3, 2)), np.array(2.7))) == "Pair(many=<3 × 2>, one=2.7)"


def test_tables_show_the_figures(
    analysed: StageAnalysis, studied: StageStudy, notch: HingeResult
) -> None:
    def cells(table: str) -> list[list[str | None]]:
        return [[cell.text for cell in row] for row in ElementTree.fromstring(table).iter("tr")]

    rows = {row[0]: row[1:] for row in cells(analysed._repr_html_())}
    assert rows["Natural frequency"] == ["326.0", "538.7", "Hz"]
    head, *body = cells(studied._repr_html_())
    found = {(row[0], row[1]): dict(zip(head, row, strict=True)) for row in body}
    assert found["Natural frequency", "x"]["published-analytic"] == "339.0"
    assert found["Natural frequency", "x"]["lumped"] == "326.0"
    by_method = {(row[0], row[1]): float(row[2] or 0) for row in cells(notch._repr_html_())[1:]}
    assert by_method["rotation", "wedge"] == pytest.approx(notch.stiffness(), rel=1e-3)


def test_a_notebook_shows_stages_and_figures(analysed: StageAnalysis) -> None:
    for text in (
        fs.design("parallelogram")._repr_html_(),
        fs.draw("parallelogram")._repr_svg_(),  # type: ignore[attr-defined]
        analysed.plot("stress")._repr_svg_(),  # type: ignore[attr-defined]
    ):
        assert ElementTree.fromstring(text or "").tag.endswith("svg")


def test_plots_are_chosen_by_name_and_axis(
    analysed: StageAnalysis, studied: StageStudy, notch: HingeResult
) -> None:
    assert analysed.plot().axes[0].get_ylabel().startswith("x / force")
    assert analysed.plot("response", "y").axes[0].get_ylabel().startswith("y / force")
    assert studied.plot("shape", "y").axes
    # the contour spans the notch and the roots on both sides
    limits = notch.plot().axes[0].dataLim
    assert (limits.width, limits.height) == pytest.approx((2.6, 4.37))
    with pytest.raises(ModelError, match=r"no plot 'strss'.*did you mean 'stress'"):
        analysed.plot("strss")  # type: ignore[arg-type]
    with pytest.raises(ModelError, match="axis 'z'"):
        analysed.plot("response", "z")


@pytest.mark.parametrize(
    ("make", "columns", "rows"),
    [
        (lambda: fs.analyse("vgtu-piezo", "lumped"), {"quantity", "axis", "value", "unit"}, 24),
        (lambda: fs.hinge(neck_thickness=0.5e-3, radius=1e-3), {"method", "stiffness"}, 20),
    ],
)
def test_a_data_frame_needs_pandas(
    make: Callable[[], StageAnalysis | HingeResult],
    columns: set[str],
    rows: int,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    result = make()
    monkeypatch.setitem(sys.modules, "pandas", None)
    with pytest.raises(ImportError, match="pip install pandas"):
        result.to_frame()
    stand_in = ModuleType("pandas")
    stand_in.DataFrame = dict  # type: ignore[attr-defined]
    monkeypatch.setitem(sys.modules, "pandas", stand_in)
    frame = result.to_frame()
    assert columns <= set(frame)
    assert all(len(column) >= rows for column in frame.values())  # type: ignore[operator]


def test_a_wrong_quantity_or_axis_names_the_right_one(
    analysed: StageAnalysis, studied: StageStudy
) -> None:
    with pytest.raises(ModelError, match="did you mean 'max_stress'"):
        analysed.value("max_stres", "x")
    with pytest.raises(ModelError, match="of axis 'z': it is known of axis x, y"):
        analysed.value("max_stress", "z")
    with pytest.raises(ModelError, match="from 'solid': it comes from published-fem, lumped"):
        studied.characteristics.value("max_stress", "x", "solid")
    with pytest.raises(ModelError, match="no analysis by 'plane': the study ran lumped"):
        studied.analysis("plane")


def test_a_hinge_takes_numbers_and_texts_alike(notch: HingeResult) -> None:
    same = fs.hinge("elliptical", neck_thickness=0.37e-3, half_length="1.3 mm", notch_depth=2e-3)
    assert same.figures == notch.figures
    wide = fs.hinge("elliptical", width="20 mm", neck_thickness=0.37e-3, half_length="1.3 mm",
                    notch_depth=2e-3, plane="strain")  # fmt: skip
    narrow = fs.hinge("elliptical", neck_thickness=0.37e-3, half_length="1.3 mm",
                      notch_depth=2e-3, plane="strain")  # fmt: skip
    # in plane strain a hinge twice as wide is twice as stiff
    assert wide.stiffness() == pytest.approx(2.0 * narrow.stiffness(), rel=1e-9)
    for sizes, message in (
        ({"neck_thickness": 1e-3}, "also needs radius"),
        ({"neck_thickness": 1e-3, "radius": 1e-3, "raduis": 1e-3}, "has no raduis"),
    ):
        with pytest.raises(HingeError, match=message):
            fs.hinge(**sizes)
    with pytest.raises(HingeError, match="did you mean 'wedge'"):
        notch.stiffness(method="wedg")
    with pytest.raises(HingeError, match="quantities are axial, shear and rotation"):
        notch.stiffness("bending")
    with pytest.raises(HingeError, match="must be auto, stress or strain"):
        fs.hinge(neck_thickness=1e-3, radius=1e-3, plane="strein")


@pytest.mark.usefixtures("undrawn")
def test_a_study_hands_out_its_analyses_and_writes_its_report(
    studied: StageStudy, tmp_path: Path
) -> None:
    # with the figures over the stroke that the study adds
    assert studied.analysis("lumped").analysis is studied.study.analyses["lumped"]
    page, results = fs.study("parallelogram", "lumped").write(tmp_path / "report")
    assert "<html" in page.read_text("utf-8")
    assert '"lumped"' in results.read_text("utf-8")


def test_every_figure_is_in_the_manual() -> None:
    page = (Path(__file__).parents[2] / "docs" / "how-to" / "python.md").read_text("utf-8")
    documented = set(re.findall(r"`(draw_\w+)\(", page))
    assert documented == {name for name in report.__all__ if name.startswith("draw_")}
