"""The view Design without a browser: what is open, what is known of it, and what is refused."""

import asyncio
import math
import time
import zipfile
from collections.abc import Callable
from dataclasses import replace
from io import BytesIO
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from flexstage.base.errors import StageError
from flexstage.report.page import table_html
from flexstage.stage import check
from flexstage.stage.designs import StageTemplate, find_stage
from flexstage.studies.models import analyse_model
from flexstage.web.design.state import FIRST, FIRST_OPEN, DesignState, Variant
from flexstage.web.design.work import (
    characteristics_of,
    draw_with_issues,
    export_to_folder,
    export_variant,
    figures_table,
    recognise_drawing,
    slopes_of,
    stage_file,
    template_of,
)
from flexstage.web.sessions import Preferences
from tests.panel import simulated

GUIDE = StageTemplate.of("parallelogram")
BOTH = ["Safety factor (yield)", "Safety factor (fatigue)"]


def thinner(share: float = 0.9) -> Variant:
    """A guide whose legs have thinner necks."""
    neck = next(p for p in GUIDE.parameters if p.name == "leg.notch.neck_thickness")
    return Variant(GUIDE).changed(neck.name, share * neck.value, neck.value)


async def come(condition: Callable[[], Any], seconds: float = 20.0) -> None:
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end, "it never came"
        await asyncio.sleep(0.02)


def test_a_slider_changes_the_figures_and_undo_takes_it_back(tmp_path: Path) -> None:
    async def look(user: Any, panel: Any) -> None:
        from nicegui import ui

        await user.open("/design")
        (choice,) = (s for s in user.find(ui.select).elements if s.props.get("label") == "Design")
        choice.value = "parallelogram"
        (session,) = panel.access._sessions.values()
        state = session.state(DesignState)
        await come(lambda: state.lumped.get(state.now))
        usual = state.now
        assert usual.name == "parallelogram"
        neck = next(
            s
            for s in user.find(ui.slider).elements
            if s.props["aria-label"].startswith("leg.notch.neck_thickness [")
        )
        neck.value = 0.9 * neck.value
        await come(lambda: state.now != usual and state.lumped.get(state.now))
        before, after = (
            {(r.quantity, r.axis): r.value for r in state.lumped.get(v)} for v in (usual, state.now)
        )
        ratio = after["natural_frequency_hz", "x"] / before["natural_frequency_hz", "x"]
        # the stiffness of circular notches goes with t^2.5, so the frequency with t^1.25
        assert ratio == pytest.approx(0.9**1.25, rel=0.03)
        shown = next(h for h in user.find(ui.html).elements if "live" in h.classes)
        await come(lambda: f"{after['natural_frequency_hz', 'x']:.4g}" in shown.content)
        await come(lambda: state.history.can_undo and state.history.now != usual)
        state.undo()
        assert state.now == usual
        # a reload finds what was open
        state.redo()
        await user.open("/design")
        assert state.now != usual

    simulated(tmp_path, look)


def test_figures_of_both_models_stand_under_their_names() -> None:
    variant = thinner()
    rows, finer = characteristics_of(variant, "lumped"), characteristics_of(variant, "superelement")
    shown = figures_table(Preferences(length="mm"), rows, finer, None)
    names = ["rigid bodies", "finite elements, condensed"]
    assert [c.heading for c in shown.columns] == ["figure", "axis", *names]
    by_name = {row[0].text: row for row in shown.rows}
    stroke = by_name["Output displacement [mm]"]
    own = {r.quantity: r.value for r in finer if r.axis == "x"}
    assert stroke[3].text == f"{1e3 * own['output_displacement']:.4g}".ljust(6, "0")
    assert stroke[2].value != stroke[3].value
    waiting = figures_table(Preferences(), rows, None, rows)
    assert {row[3].text for row in waiting.rows} == {"…"}
    assert {row[5].text for row in waiting.rows} <= {"0.0 %", "–"}


def test_a_figure_that_fails_its_criterion_is_marked() -> None:
    neck = next(p for p in GUIDE.parameters if p.name == "actuator.travel")
    far = Variant(GUIDE).changed(neck.name, 6.0 * neck.value, neck.value)
    for variant, failing in ((Variant(GUIDE), []), (far, BOTH)):
        shown = figures_table(Preferences(), characteristics_of(variant, "lumped"), None, None)
        marked = [row[0].text for row in shown.rows if any(cell.failing for cell in row)]
        assert marked == failing
        assert ("fails: at least 1 is required" in table_html(shown)) is bool(failing)


def test_a_new_page_opens_on_a_guide_whose_six_dimensions_move_its_figures(tmp_path: Path) -> None:
    variant = Variant(StageTemplate.of(FIRST))
    found = slopes_of(variant, characteristics_of(variant, "lumped"))
    moving = np.abs(found.elasticities).max(axis=0) > 1e-3
    names = [v.name for v, moves in zip(found.variables, moving, strict=True) if moves]
    # the travel is that of a screw that is bought
    assert {*names} == {*FIRST_OPEN, "actuator.travel"}
    assert len(FIRST_OPEN) == 6

    async def look(user: Any, panel: Any) -> None:
        from nicegui import ui

        await user.open("/design")
        folded = {e.text: e.value for e in user.find(ui.expansion).elements}
        assert folded == {
            "most effective dimensions": True,
            "other dimensions": False,
            "actuator": False,
        }

    simulated(tmp_path, look)


def test_slopes_are_those_of_the_variant_that_is_shown() -> None:
    variant = thinner()
    found = slopes_of(variant, characteristics_of(variant, "lumped"))
    column = [v.name for v in found.variables].index("leg.notch.neck_thickness")
    row = next(k for k, f in enumerate(found.figures) if f.quantity == "natural_frequency_hz")
    less, more = (
        next(
            r.value
            for r in characteristics_of(thinner(s), "lumped")
            if r.quantity == "natural_frequency_hz"
        )
        for s in (0.9 - 1e-4, 0.9 + 1e-4)
    )
    expected = math.log(more / less) / math.log((0.9 + 1e-4) / (0.9 - 1e-4))
    assert found.elasticities[row, column] == pytest.approx(expected, rel=1e-4)


def test_what_is_wrong_is_marked_on_the_drawing() -> None:
    variant = thinner(0.2)
    found = draw_with_issues(variant, "now")
    assert found.issues == check(variant.stage())
    assert {issue.code for issue in found.issues} >= {"thin-neck"}
    assert "now-issue" in found.svg
    assert "issue" not in draw_with_issues(Variant(GUIDE), "now").svg


def test_a_saved_file_is_the_stage_that_is_shown(tmp_path: Path) -> None:
    variant = thinner()
    path = tmp_path / "mine.yaml"
    path.write_text(stage_file(variant, "mine"), encoding="utf-8")
    assert find_stage(path) == replace(variant.stage(), name="mine")
    again = Variant(template_of(path))
    assert [r.value for r in characteristics_of(again, "lumped")] == [
        r.value for r in characteristics_of(variant, "lumped")
    ]


def test_several_exports_are_one_archive_and_one_file_is_itself() -> None:
    name, content, _ = export_variant(thinner(), ["dxf"])
    assert name.endswith(".dxf")
    assert content.startswith(b"  0\n")
    name, packed, _ = export_variant(thinner(), ["dxf", "csv"])
    assert name == "parallelogram.zip"
    with zipfile.ZipFile(BytesIO(packed)) as archive:
        assert archive.read(next(n for n in archive.namelist() if n.endswith(".dxf"))) == content


def test_an_export_is_kept_whoever_waits_for_it(tmp_path: Path) -> None:
    path, _ = export_to_folder(tmp_path, thinner(), ["csv", "dxf"])
    assert path == tmp_path / "parallelogram.zip"
    assert path.read_bytes().startswith(b"PK")


def test_what_an_export_leaves_out_is_said(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    file = tmp_path / "a.zip"
    file.write_bytes(b"PK")
    done = SimpleNamespace(state="done", result=(file, ["dxf was left out: it has no plate."]))
    monkeypatch.setattr("flexstage.web.views.design.show_job", lambda _, __, over: over(done))

    async def look(user: Any, panel: Any) -> None:
        from nicegui import ui
        from nicegui.testing.user_interaction import UserInteraction

        monkeypatch.setattr(panel.jobs, "start", lambda *_, **__: None)
        await user.open("/design")
        opens = user.find(kind=ui.button, content="Export")
        opens.click()
        await user.should_see("structural diagram")
        (export,) = user.find(kind=ui.button, content="Export").elements - opens.elements
        UserInteraction(user, {export}, None).click()
        await user.should_see("dxf was left out: it has no plate.")

    simulated(tmp_path, look)


def test_a_drawing_becomes_a_stage(tmp_path: Path) -> None:
    from flexstage.stage.drawing.requests import DrawingOptions

    _, content, _ = export_variant(Variant(GUIDE), ["dxf"])
    path = tmp_path / "guide.dxf"
    path.write_bytes(content)
    options = DrawingOptions(thickness=0.011, material="Al 7075-T6")
    drawn, svg, text = recognise_drawing(str(path), options, "found")
    assert len(drawn.necks) == len(Variant(GUIDE).stage().hinges)
    assert 'aria-label="Bodies and necks found in guide.dxf"' in svg
    made = path.with_suffix(".yaml")
    made.write_text(text, encoding="utf-8")
    assert template_of(made).stage().thickness == 0.011


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("flexstage: 1\nname: [", "line 3"),
        ("a: &a [*a]\n", "hostile.yaml"),
        ("\0\0\0", "hostile.yaml"),
        ("!!python/object/apply:os.system ['true']\n", "hostile.yaml"),
    ],
)
def test_a_hostile_stage_file_is_refused_in_a_sentence(
    tmp_path: Path, text: str, told: str
) -> None:
    path = tmp_path / "hostile.yaml"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(StageError, match=told):
        template_of(path)


def test_an_impossible_slider_leaves_a_sentence_and_the_page_alive(tmp_path: Path) -> None:
    async def look(user: Any, panel: Any) -> None:
        from nicegui import ui

        await user.open("/design")
        (session,) = panel.access._sessions.values()
        state = session.state(DesignState)
        state.open(GUIDE)
        await user.open("/design")
        field = next(
            n
            for n in user.find(ui.number).elements
            if "leg.notch.neck_thickness [" in n.props["aria-label"]
        )

        def alerts() -> list[str]:
            # those that are seen
            return [e.text for e in user.find(ui.label).elements if "error" in e.classes]

        field.value = -1.0
        await come(alerts)
        assert "neck" in alerts()[0]
        field.value = 0.5
        await come(lambda: not alerts())

    simulated(tmp_path, look)


def test_a_variant_forgets_what_is_put_back() -> None:
    variant = thinner()
    ((name, _),) = variant.values
    usual = next(p.value for p in GUIDE.parameters if p.name == name)
    assert variant.changed(name, usual, usual) == Variant(GUIDE)
    lumped = {r.quantity: r.value for r in characteristics_of(variant, "lumped") if r.axis == "x"}
    own = analyse_model(variant.stage(), "lumped").characteristics
    assert lumped["transmission_ratio"] == next(
        r.value for r in own if (r.quantity, r.axis) == ("transmission_ratio", "x")
    )
