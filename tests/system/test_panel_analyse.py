"""The view Analyse without a browser: its figures are the command's, its pictures the model's."""

import asyncio
import base64
import itertools
import json
import zipfile
from collections import Counter
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from flexstage.base.errors import ModelError
from flexstage.report.figures.surface import outer_faces, sharp_edges
from flexstage.stage.designs import StageTemplate
from flexstage.studies.models import MODELS, fitting_options, run_model
from flexstage.studies.requests import ModelOptions
from flexstage.web.analyse.bode import reading, readings_table
from flexstage.web.analyse.shapes import state_data, surface_data
from flexstage.web.analyse.work import (
    AnalyseState,
    ModelResult,
    analyse_variant,
    figures_tables,
    hinges_table,
    modes_table,
    noise_of_variant,
    save_archive,
)
from flexstage.web.bench.instrument import real_time_address
from flexstage.web.design.state import DesignState, Variant
from flexstage.web.jobs import BackgroundJob
from flexstage.web.sessions import Preferences
from flexstage.web.views.analyse import errors_table, meshes_table
from tests.panel import come, looked_at, simulated

GUIDE = Variant(StageTemplate.of("parallelogram"))


@pytest.fixture(scope="module")
def lumped() -> ModelResult:
    return analyse_variant(GUIDE, "lumped", ModelOptions())


def unpacked(text: str, kind: str, columns: int) -> np.ndarray:
    return np.frombuffer(base64.b64decode(text), dtype=kind).reshape(-1, columns)


def test_results_are_those_of_the_command(
    lumped: ModelResult, capsys: pytest.CaptureFixture[str]
) -> None:
    from flexstage.cli import main

    with pytest.raises(SystemExit) as ended:
        main(["analyse", "parallelogram", "--model", "lumped", "--json"])
    assert not ended.value.code
    printed = json.loads(capsys.readouterr().out)
    own = json.loads(json.dumps(dict(lumped.results)))
    # the day on which each was computed
    del printed["files"], printed["provenance"], own["provenance"]
    assert own == printed
    first, others = figures_tables(Preferences(), [lumped])
    values = [row[2].value for row in (*first.rows, *others.rows)]
    assert sorted(values) == sorted(row["value"] for row in printed["characteristics"])
    for condition, rows in printed["modes"].items():
        shown = modes_table([lumped], condition)
        assert [row[1].value for row in shown.rows] == [
            row["natural_frequency_hz"] for row in rows[:6]
        ]


def test_models_and_errors_stand_side_by_side(lumped: ModelResult) -> None:
    rows = [
        replace(
            row, origin="superelement", value=1.1 * row.value, uncertainty=0.02 * abs(row.value)
        )
        for row in lumped.analysis.characteristics
    ]
    analysis = replace(
        lumped.analysis,
        characteristics=type(lumped.analysis.characteristics)(rows),
        system=replace(lumped.analysis.system, model="superelement"),
    )
    both = [lumped, replace(lumped, analysis=analysis)]
    first, _ = figures_tables(Preferences(length="mm"), both)
    headings = [column.heading for column in first.columns]
    assert headings == [
        "figure",
        "axis",
        "rigid bodies",
        "finite elements, condensed",
        "difference",
    ]
    stroke = next(row for row in first.rows if row[0].text == "Output displacement [mm]")
    assert [cell.text for cell in stroke] == [
        "Output displacement [mm]", "x", "0.2000", "0.2200 ± 0.004", "+10.0 %"
    ]  # fmt: skip
    errors = errors_table(Preferences(), both[1])
    frequency = next(row for row in errors.rows if row[0].text == "Natural frequency [Hz]")
    # 2 % of what is 10 % more
    assert frequency[4].text == "1.8 %"
    assert not errors_table(Preferences(), lumped).rows


def test_meshes_stand_with_what_they_gave(lumped: ModelResult) -> None:
    steps = [
        {
            "order": order, "neck_size": 1.2, "unknowns": 5000 * order, "seconds": 0.5,
            "values": [{"quantity": "max_stress", "axis": "x", "value": 1e8 + order}],
        }
        for order in (3, 4)
    ]  # fmt: skip
    refinement = {"quantity": "max_stress", "accuracy": 0.01, "estimate": 0.001, "steps": steps}
    shown = meshes_table(
        Preferences(), replace(lumped, results=dict(lumped.results, refinement=refinement))
    )
    assert [column.heading for column in shown.columns][-1] == "Largest stress [MPa], x"
    assert [row[2].text for row in shown.rows] == ["15000", "20000"]
    assert {row[4].text for row in shown.rows} == {"100.0"}


@pytest.mark.parametrize("model", MODELS)
def test_a_model_is_asked_for_what_it_takes(model: str) -> None:
    asked = {"plane": "strain", "supports": "elastic", "estimate": True, "accuracy": 0.01}
    asked["stroke"] = True
    fitting = fitting_options(model, ModelOptions(**asked))  # type: ignore[arg-type]
    for name, value in asked.items():
        if getattr(fitting, name) != value:
            with pytest.raises(ModelError):
                run_model(GUIDE.stage(), model, ModelOptions(**{name: value}))  # type: ignore[arg-type]


def test_the_surface_is_closed_and_moves_as_the_stage_does(lumped: ModelResult) -> None:
    surface = lumped.surface
    _, same = np.unique(np.rint(surface.points / 1e-9), axis=0, return_inverse=True)
    corners = same.reshape(-1)[surface.triangles]
    edges = Counter(tuple(sorted((int(t[i]), int(t[i - 1])))) for t in corners for i in range(3))
    # parts meet at seams, each with a closed surface of its own
    assert not [edge for edge, count in edges.items() if count % 2]
    (state,) = surface.statics
    # the platform moves by what the probe reads, and no corner much further
    assert state.largest == pytest.approx(200e-6, rel=0.01)
    assert state.limit == lumped.analysis.characteristics.value("max_stress", "x")
    assert np.nanmax(state.stress) == state.limit
    assert [len(states) for states in surface.modes.values()] == [6, 6, 6]


def test_faces_and_edges_of_a_box() -> None:
    box = np.array([[x, y, z] for z in (0, 1) for x, y in ((0, 0), (1, 0), (1, 1), (0, 1))], float)
    faces = outer_faces(np.array([[0, 1, 2, 4, 5, 6], [0, 2, 3, 4, 6, 7]]))
    assert faces.shape == (12, 3)
    # of 18 edges six are diagonals of faces
    assert sharp_edges(box, faces).shape == (12, 2)


@pytest.mark.parametrize("colour", ["stress", "displacement"])
def test_the_page_gets_what_was_found(lumped: ModelResult, colour: str) -> None:
    surface, state = lumped.surface, lumped.surface.statics[0]
    sent, given = surface_data(surface), state_data(surface, state, colour, Preferences())
    assert unpacked(sent["points"], "<f4", 3) == pytest.approx(1e3 * surface.points, abs=1e-4)
    assert (unpacked(sent["triangles"], "<u4", 3) == surface.triangles).all()
    values = unpacked(given["values"], "<i2", 4) / 32767
    moved = values[:, :3] * given["reach"] / given["factor"] * 1e-3
    assert moved == pytest.approx(state.displacement, abs=1e-4 * state.largest)
    top = float(given["bar"]["ticks"][-1][1])
    if colour == "stress":
        assert given["bar"]["title"] == "equivalent stress [MPa]"
        assert top == pytest.approx(state.limit * 1e-6, rel=1e-2)
        assert ((values[:, 3] < 0.0) == np.isnan(state.stress)).all()
    else:
        assert given["bar"]["title"] == "displacement [µm]"
        assert top == pytest.approx(state.largest * 1e6, rel=1e-2)
        size = np.linalg.norm(state.displacement, axis=1)
        assert values[:, 3] == pytest.approx(size / state.largest, abs=1e-4)


def test_cursors_read_the_response(lumped: ModelResult) -> None:
    own = next(r for r in lumped.analysis.responses if r.drives == "in place")
    every = [r for r in lumped.responses if (r.drive, r.probe) == (own.drive, own.probe)]
    (response,) = [r for r in every if r.drives == "in place"]
    assert (response.value == own.value).all()
    at = [float(own.frequency_hz[k]) for k in (10, 300)]
    size, phase = reading(response, at[1])
    assert size == pytest.approx(abs(own.value[300]), rel=1e-9)
    assert np.exp(1j * np.radians(phase)) == pytest.approx(own.value[300] / abs(own.value[300]))
    shown = readings_table([("lumped", response)], at)
    texts = [cell.text for cell in shown.rows[1]]
    assert texts[0] == "lumped: magnitude [µm/µm]"
    ratio = abs(own.value[300]) / abs(own.value[10])
    assert texts[3].startswith(f"× {ratio:.4g}"[:5])


@pytest.mark.usefixtures("undrawn")
def test_results_are_saved_by_model(lumped: ModelResult, tmp_path: Path) -> None:
    path = save_archive(tmp_path, [lumped])
    with zipfile.ZipFile(path) as archive:
        assert archive.namelist() == ["lumped/analysis.json", "lumped/bode-x.svg"]
        assert json.loads(archive.read("lumped/analysis.json")) == dict(lumped.results)
    assert [c.heading for c in hinges_table(lumped).columns][1].endswith("x [MPa]")


def test_models_are_run_in_the_page_and_found_again(tmp_path: Path) -> None:
    async def look(user: Any, panel: Any) -> None:
        from nicegui import ui

        started: list[str] = []
        work = panel.jobs.start

        def start(name: str, function: Any, *arguments: Any, owner: str = "") -> Any:
            started.append(name)
            return work(name, function, *arguments, owner=owner)

        panel.jobs.start = start
        await user.open("/design")
        (session,) = panel.access._sessions.values()
        session.state(DesignState).open(GUIDE.template)
        state = session.state(AnalyseState)
        await user.open("/analyse")
        # the quick model is run at once, of the stage that Design has open
        await come(lambda: state.result(GUIDE, "lumped"))
        await user.should_see("193.7")
        await user.open("/analyse")
        await user.should_see("193.7")
        states = [b for b in user.find(kind=ui.button).elements if "aria-pressed" in b.props]
        pressed = [b.text for b in states if b.props["aria-pressed"] == "true"]
        assert len(pressed) == 1 < len(states)
        # what was chosen is shown again
        state.display.state = "mode 2"
        await user.open("/analyse")
        await user.should_see("193.7")
        assert state.display.state == "mode 2"
        # the page of Design is still open, and does its own
        own = [name for name in started if name.startswith("parallelogram, ")]
        assert own == ["parallelogram, rigid bodies"]
        # what fails says why, and the others go on
        state.selected_models, state.options = (
            ["plane"],
            ModelOptions(accuracy=0.01, quantity="magic"),
        )
        user.find(kind=ui.button, content="Analyse").click()
        await come(lambda: state.errors)
        await user.should_see("unknown quantity")
        await user.should_see("193.7")
        # an accuracy that is none is refused, and nothing runs with the one before
        state.errors.clear()
        before = [name for name in started if "of the whole" in name]  # Design has jobs of its own
        (accuracy,) = (e for e in user.find(ui.number).elements if e.label == "Accuracy [%]")
        accuracy.value = 150.0
        await user.should_see("accuracy must be between 0 and 1, got 1.5")
        user.find(kind=ui.button, content="Analyse").click()
        await asyncio.sleep(0.3)
        assert state.options.accuracy == 0.01
        assert [name for name in started if "of the whole" in name] == before
        # a job that was cancelled a moment ago does not keep the next from being started
        accuracy.value = 1.0
        state.options = ModelOptions(accuracy=0.01, quantity="magic")
        cancelled = BackgroundJob("cancelled")
        cancelled._end("cancelled")
        state.jobs[GUIDE, "plane"] = cancelled
        user.find(kind=ui.button, content="Analyse").click()
        await come(lambda: state.errors)

    simulated(tmp_path, look)


FLOOR = """\
environment: 1
name: floor
band: [1 Hz, 5 kHz]
sources:
  floor: {kind: ground, along: x, spectrum: {kind: vc, curve: C, slope_above: -5}}
static: {creep: 0.02}
"""


def test_noise_is_that_of_the_command(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    from flexstage.cli import main

    variant = Variant(StageTemplate.of("vgtu-piezo"))
    found = noise_of_variant(variant, FLOOR, "20 Hz, 50 Hz", "lumped", tmp_path)
    (tmp_path / "floor.yaml").write_text(FLOOR)
    words = ["budget", "vgtu-piezo", "--environment", str(tmp_path / "floor.yaml"), "--quiet"]
    monkeypatch.setenv("COLUMNS", "200")
    with pytest.raises(SystemExit):
        main([*words, "--loop", "20 Hz", "--loop", "50 Hz"])
    printed = [line.split() for line in capsys.readouterr().out.splitlines()]
    assert [t.caption for t in found.tables] == ["x: rms in nm", "x: standard uncertainty in um"]
    for rows in found.tables:
        for row in rows.rows:
            assert " ".join(cell.text for cell in row).split() in printed
    assert "<svg" in found.picture
    with pytest.raises(ModelError, match="a loop is a crossover such as '100 Hz', or tune, got"):
        noise_of_variant(variant, FLOOR, "/etc/passwd", "lumped", tmp_path)
    (tmp_path / "secret.csv").write_text("1, 1\n5000, 1\n")
    read = f"{{kind: file, path: {tmp_path}/secret.csv, density_unit: nm/rtHz, sided: one}}"
    named = FLOOR.replace("{kind: vc, curve: C, slope_above: -5}", read)
    with pytest.raises(ModelError, match=r"no file is read here, got .*: give its densities as"):
        noise_of_variant(variant, named, "", "lumped", tmp_path)
    for scheme, option in itertools.product(("twin", "TWIN"), ("environment", "table")):
        with pytest.raises(ModelError, match=f"reads no {option} that an address names"):
            real_time_address(f"{scheme}://vgtu-piezo?{option}={tmp_path}/secret.csv")


def test_noise_is_computed_in_the_page(tmp_path: Path) -> None:
    async def look(user: Any, panel: Any) -> None:
        from nicegui import ui

        await user.open("/design")
        (session,) = panel.access._sessions.values()
        session.state(DesignState).open(StageTemplate.of("vgtu-piezo"))
        state = session.state(AnalyseState)
        state.display.part = "Noise"
        await user.open("/analyse")
        (text,) = user.find(ui.textarea).elements
        # the laboratory that the report assumes
        assert "converter x (16 bits)" in text.value
        text.value = FLOOR.replace("curve: C", "curve: H")
        user.find(kind=ui.button, content="Compute noise").click()
        await come(lambda: any("got 'H'" in label.text for label in user.find(ui.label).elements))
        text.value = FLOOR
        user.find(kind=ui.button, content="Compute noise").click()
        await come(lambda: state.noise)
        await user.should_see("linear, stationary and independent sources")

    simulated(tmp_path, look)


LEVER = """\
flexstage: 1
name: lever
length_unit: mm
thickness: 8 mm
material: Al 7075-T6
bodies:
  base:
    fixed: true
    outline: [[0, 0], [40, 0], [40, 16], [14, 16], [14, 6], [0, 6]]
    mounting_holes:
      - {centre: [34, 3], radius: 1.6}
  arm:
    outline: [[3, 9], [9, 9], [9, 40], [3, 40]]
hinges:
  pivot:
    bodies: [base, arm]
    at: [6, 7.5]
    direction: 90 deg
    profile: {kind: circular, neck_thickness: 0.6, radius: 1.5}
drives:
  push: {kind: screw, pushes: arm, reacts: base, at: [[9, 12], [14, 12]], direction: 180 deg,
    pitch: 0.25 mm, smallest_step: 0.5 um, travel: 0.05 mm, patch_half_width: 1 mm}
probes:
  tip: {body: arm, at: [9, 38], direction: 180 deg}
axes:
  x: {drive: push, probe: tip}
"""


@pytest.mark.slow
def test_a_stage_is_analysed_in_the_page(tmp_path: Path) -> None:
    (tmp_path / "lever.yaml").write_text(LEVER, encoding="utf-8")
    with looked_at(tmp_path) as look:
        page = look.page
        page.emulate_media(reduced_motion="no-preference")
        page.get_by_role("link", name="Analyse").click()
        page.get_by_role("heading", name="Models").wait_for()
        page.locator("input[type=file]").set_input_files(tmp_path / "lever.yaml")
        page.get_by_role("heading", name="lever.yaml", exact=True).wait_for()
        # the quick model is there by itself; finite elements are asked for, with a finer mesh
        page.locator("canvas[aria-label*='reads 3']").wait_for()
        # it moves by itself, unless one wants to see as little of that as possible
        page.get_by_role("button", name="Pause").click()
        page.emulate_media(reduced_motion="reduce")
        page.get_by_text("Options").click()
        page.get_by_label("Accuracy [%]").fill("2")
        for model in ("finite elements, condensed", "finite elements in 3D of the whole"):
            page.get_by_role("checkbox", name=model, exact=True).click()
        page.get_by_role("button", name="Analyse", exact=True).click()
        solid = page.locator(".model", has_text="finite elements in 3D of the whole")
        solid.get_by_role("button", name="Cancel").click()
        solid.locator(".job").wait_for(state="detached")
        page.get_by_role("button", name="Analyse", exact=True).click()
        solid.locator(".job").wait_for()
        # a reload finds what is being computed
        page.reload()
        solid.get_by_text("done in").wait_for()
        page.get_by_role("combobox", name="Model").click()
        page.get_by_role("option", name="finite elements in 3D of the whole", exact=True).click()
        page.get_by_text("Bodies are drawn rigid").wait_for(state="hidden")
        page.locator("canvas[aria-label*='equivalent stress [MPa]']").wait_for()
        page.get_by_role("button", name="Play").wait_for()
        still = drawn(page)
        assert still == drawn(page)
        page.get_by_role("slider", name="Amplitude").fill("3")
        moved = drawn(page)
        assert moved != still
        page.locator("canvas").press("ArrowRight")
        assert drawn(page) != moved
        look.require_sound("analyse-shapes")
        page.get_by_role("group", name="States").get_by_role("button").nth(1).click()
        page.locator("canvas[aria-label*='mode 1, drives removed']").wait_for()
        page.get_by_role("tab", name="Bode").click()
        # an upright line has no width, which the browser takes for not to be seen
        page.locator(".js-plotly-plot .shapelayer path").nth(1).wait_for(state="attached")
        page.get_by_label("Cursor B [Hz]").fill("500")
        cells = page.locator(".bode tbody tr").first.locator("td")
        cells.nth(2).get_by_text("500.00").wait_for()
        before = cells.nth(1).inner_text()
        dragged(page, 0, -60.0)
        page.wait_for_function(
            "before => document.querySelectorAll('.bode tbody tr td')[1].innerText !== before",
            arg=before,
        )
        assert float(cells.nth(1).inner_text()) < float(before)
        look.require_sound("analyse-bode")
        page.get_by_role("tab", name="Noise").click()
        page.get_by_role("button", name="Compute noise").click()
        page.locator("svg[aria-label*='cumulative amplitude by source']").wait_for()
        look.require_sound("analyse-noise")
        page.get_by_role("tab", name="Convergence").click()
        page.locator("svg[aria-label='Convergence of the solid model']").wait_for()
        look.shot("analyse-convergence")
        assert look.overflow() <= 0
        assert not look.grave_faults()
        with page.expect_download() as waiting:
            page.get_by_role("button", name="Save results").click()
        assert waiting.value.suggested_filename == "lever-analysis.zip"
        assert not look.complaints


def drawn(page: Any) -> str:
    """Return a fingerprint of what the canvas shows."""
    page.wait_for_timeout(300)
    return page.locator("canvas").screenshot().hex()


def dragged(page: Any, cursor: int, by: float) -> None:
    """Drag a cursor of the Bode diagram sideways [px]."""
    x, y = page.evaluate(
        """k => {
        const box = document.querySelectorAll(".shapelayer path")[k].getBoundingClientRect();
        return [box.x + box.width / 2, box.y + 0.3 * box.height] }""",
        cursor,
    )
    page.mouse.move(x, y)
    page.mouse.down()
    page.mouse.move(x + by / 2, y, steps=4)
    page.mouse.move(x + by, y, steps=4)
    page.mouse.up()
