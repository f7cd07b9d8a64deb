"""The view Explore without a browser: what it finds is what the command finds, and is picked."""

import json
import shlex
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

from flexstage.base.errors import ModelError
from flexstage.base.progress import listen
from flexstage.cli import app
from flexstage.stage.designs import StageTemplate
from flexstage.studies.explore.prepare import ready_sweep, swept
from flexstage.studies.explore.requests import (
    ExploreRequest,
    SensitivityRequest,
    SweepRequest,
    ToleranceRequest,
)
from flexstage.web.design.state import DesignState, Variant
from flexstage.web.explore import charts, samples_table
from flexstage.web.explore.results import equivalent_command
from flexstage.web.explore.state import (
    ExploreForm,
    ExploreState,
    RangeInput,
    RequirementInput,
    StageSummary,
    default_forms,
    summarise_stage,
)
from flexstage.web.explore.work import run_exploration
from flexstage.web.sessions import Preferences
from tests.panel import come, looked_at, simulated
from tests.system.test_panel_browser import undo_to

GUIDE = Variant(StageTemplate.of("parallelogram"))
NECK = "leg.notch.neck_thickness"
UNITS = Preferences()


@pytest.fixture(scope="module")
def facts() -> StageSummary:
    """A guide of which a neck was changed in the view Design."""
    return summarise_stage(GUIDE.changed(NECK, 0.00047, 0.0005))


def by_the_command(facts: StageSummary, request: ExploreRequest) -> dict[str, Any]:
    """What the command line that the page shows prints as JSON."""
    words = shlex.split(equivalent_command(facts.template, request))[1:]
    found = CliRunner().invoke(app, [*words, "--json", "--quiet", "--workers", "1"])
    if found.exit_code == 2:  # one that shares no work has no workers
        found = CliRunner().invoke(app, [*words, "--json", "--quiet"])
    assert found.exit_code == 0, found.output
    return json.loads(found.stdout)


def found_by_the_page(folder: Path, facts: StageSummary, request: ExploreRequest) -> Any:
    """What the job of the page returns."""
    return run_exploration(folder, facts.template, request, "found").result


def same(found: Any, expected: dict[str, Any]) -> None:
    """Require that two results differ in times and files alone."""
    said = json.loads(json.dumps(found))
    for result in (said, expected):
        for each in (result, result.get("optimum", {})):
            each.pop("files", None)
            each.pop("seconds", None)
            each.get("provenance", {}).pop("created", None)
    assert said == expected


def vary(form: ExploreForm, *names: str) -> None:
    """Choose which parameters may change."""
    for row in form.ranges:
        row.is_varied = row.name in names


@pytest.mark.slow
def test_a_sweep_is_that_of_the_command(tmp_path: Path, facts: StageSummary) -> None:
    form = default_forms(facts)["sweep"]
    form.ranges = [RangeInput(NECK, count=3), RangeInput("leg_spacing", 0.035, 0.0475, 2)]
    request = form.complete_request(facts)
    found: Any = run_exploration(tmp_path, facts.template, request, "found")
    assert f"--set '{NECK}=0.47 mm'" in equivalent_command(facts.template, request)
    same(found.result.to_dict(), by_the_command(facts, request))
    assert {"sweep.csv", "sweep.json", "sweep.svg"} <= {path.name for path in found.files}
    assert (tmp_path / "sweep.csv").read_bytes().count(b"\r\n") == 7
    assert not (tmp_path / "unfinished").exists()
    # 30 % to either side of the neck as it was changed
    assert np.ptp(found.result.points[:, 0]) == pytest.approx(0.6 * 0.00047)


@pytest.mark.slow
def test_sensitivities_and_a_lot_are_those_of_the_command(
    tmp_path: Path, facts: StageSummary
) -> None:
    forms = default_forms(facts)
    request = forms["sensitivity"].complete_request(facts)
    assert isinstance(request, SensitivityRequest)
    found = found_by_the_page(tmp_path, facts, request)
    same(found.to_dict(), by_the_command(facts, request))
    lot = forms["tolerance"]
    lot.assign("samples", 60)
    lot.assign("scatter", ("neck_own=3 um",))
    request = lot.complete_request(facts)
    assert isinstance(request, ToleranceRequest)
    assert tuple(map(str, request.require)) == (
        "safety_factor.x >= 1.5",
        "output_displacement.x >= 180 µm",
    )
    found = found_by_the_page(tmp_path, facts, request)
    same(found.to_dict(), by_the_command(facts, request))


@pytest.mark.slow
def test_an_optimum_is_that_of_the_command(tmp_path: Path, facts: StageSummary) -> None:
    form = default_forms(facts)["optimise"]
    assert "--over" not in equivalent_command(facts.template, form.complete_request(facts))
    vary(form, NECK, "leg_spacing")
    form.assign("evaluations", 30)
    form.assign("without", ("output_wall.x",))
    form.requirements = [RequirementInput("max_stress.x", "<=", 95e6)]
    request = form.complete_request(facts)
    steps: list[Any] = []
    with listen(lambda what, done: None, steps.append):
        found = found_by_the_page(tmp_path, facts, request)
    same(found.to_dict(), by_the_command(facts, request))
    # the way that was shown while it ran is that of the result
    way = samples_table.of_steps(found.problem, steps, UNITS)
    assert way is not None
    goal = way.column("natural_frequency.x")
    assert goal is not None
    assert goal.values.tolist() == [step.objective for step in found.history]
    assert samples_table.of_optimum(found, UNITS).values(1) == pytest.approx(
        dict(zip(found.problem.family.names, found.point, strict=True))
    )


@pytest.mark.slow
def test_a_front_is_that_of_the_command(tmp_path: Path, facts: StageSummary) -> None:
    form = default_forms(facts)["optimise"]
    form.goals.append(RequirementInput("max_stress.x", "minimise"))
    vary(form, NECK, "leg.bar_length")
    form.assign("evaluations", 40)
    request = form.complete_request(facts)
    stages: list[Any] = []
    with listen(lambda what, done: None, stages.append):
        found = found_by_the_page(tmp_path, facts, request)
    same(found.to_dict(), by_the_command(facts, request))
    shown = samples_table.of_front(found, UNITS)
    search = samples_table.SearchedFront(found.problem)
    for number in range(len(stages)):
        search.table(stages[:number], UNITS)
    live = search.table(stages, UNITS)
    assert live is not None
    # the front that filled while it ran is the one that was found
    assert live.labels.count(samples_table.ON_FRONT) == len(found.points)
    assert live.labels[live.ordered("", descending=False)[0]] == samples_table.ON_FRONT
    assert shown.values(found.selected) == dict(
        zip(found.problem.family.names, found.points[found.selected], strict=True)
    )
    for kind in charts.kinds(shown):
        data, layout = charts.draw(shown, kind, shown.columns[1], shown.columns[0], found.selected)
        assert data[-1]["name"] in ("selected", "nominal")
        assert layout["xaxis"]["title"]["text"]


def test_forms_say_what_they_lack(facts: StageSummary) -> None:
    forms = default_forms(facts)
    forms["sweep"].figures = []
    with pytest.raises(ModelError, match="choose at least one figure"):
        forms["sweep"].complete_request(facts)
    forms["optimise"].requirements = [RequirementInput("max_stress.x", "<=")]
    with pytest.raises(ModelError, match=r"max_stress\.x needs a value"):
        forms["optimise"].complete_request(facts)
    forms["optimise"].requirements = []
    vary(forms["optimise"])
    with pytest.raises(ModelError, match="at least one parameter"):
        forms["optimise"].complete_request(facts)
    lot = forms["tolerance"]
    lot.assign("samples", 0)
    with pytest.raises(ModelError, match=r"samples must be .* from 2 .*, got 0"):
        lot.complete_request(facts)
    lot.assign("samples", 60)
    lot.complete_request(facts)
    bare = replace(facts, variables={}, flexure=frozenset(), template=StageTemplate.of("cartwheel"))
    with pytest.raises(ModelError, match="cartwheel"):
        default_forms(bare)["sweep"].complete_request(bare)
    assert facts.frequency == "natural_frequency.x"
    assert facts.neck == NECK


def test_points_of_a_cancelled_sweep_are_those_that_were_computed(facts: StageSummary) -> None:
    form = default_forms(facts)["sweep"]
    form.ranges[0].count = 9
    request = form.complete_request(facts)
    assert isinstance(request, SweepRequest)
    batches: list[Any] = []
    with listen(lambda what, done: None, batches.append):
        whole = ready_sweep(request, facts.template)()
    part = samples_table.of_batches(swept(request, facts.template), batches[:4], UNITS)
    assert part.computed == 4
    assert part.computed_rows.tolist() == [0, 1, 2, 3]
    frequency = part.column("natural_frequency.x")
    assert frequency is not None
    column = [figure.name for figure in whole.figures].index("natural_frequency.x")
    assert frequency.values[:4].tolist() == whole.values[:4, column].tolist()
    falling = part.ordered("natural_frequency.x", descending=True)
    assert falling == [3, 2, 1, 0]
    data, _ = charts.draw(part, charts.CURVE, part.varied[0], frequency, 2)
    assert data[0]["y"][4] is None
    assert data[0]["customdata"][2] == 2
    assert data[-1]["name"] == "selected"


def test_a_point_is_picked_and_opened_in_design(tmp_path: Path) -> None:
    async def look(user: Any, panel: Any) -> None:
        from nicegui import ui

        await user.open("/explore")
        (session,) = panel.access._sessions.values()
        design, state = session.state(DesignState), session.state(ExploreState)
        design.open(GUIDE.template)
        await user.open("/explore")
        await come(lambda: state.summaries.get(GUIDE))
        await user.should_see(kind=ui.button, content="Run sweep", retries=50)
        state.forms["sweep"].ranges[0].count = 5
        user.find(kind=ui.button, content="Run sweep").click()
        await come(lambda: "sweep" in state.runs)
        run = state.runs["sweep"]
        await come(lambda: run.job.is_over)
        assert run.job.state == "done", run.job.error
        same(
            run.job.result.result.to_dict(),
            by_the_command(run.summary, run.request),
        )
        # a reload finds the result
        await user.open("/explore")
        await user.should_see("5 of 5 points")
        await user.should_see(kind=ui.html, content='data-do="select:4"')
        await user.should_see(f"flexstage sweep parallelogram --over '{NECK}=0.35..0.65 mm/5'")
        run.selected_row = 1
        await user.open("/explore")
        user.find("Open in Design").click()
        await come(lambda: design.now != GUIDE)
        assert dict(design.now.values) == {NECK: pytest.approx(0.000425)}
        design.undo()
        assert design.now == GUIDE

    simulated(tmp_path, look)


@pytest.mark.slow
def test_stages_are_explored_in_the_page(tmp_path: Path) -> None:
    with looked_at(tmp_path) as look:
        page = look.page
        page.get_by_role("link", name="Explore").click()
        page.get_by_role("button", name="Run sweep").wait_for()
        page.get_by_role("combobox", name="Design").fill("parallelogram")
        page.get_by_role("option", name="parallelogram", exact=True).click()
        page.get_by_text("4 figures (default)").wait_for()
        page.get_by_role("button", name="Run sweep").click()
        page.get_by_role("button", name="sweep.csv").wait_for()
        page.get_by_text("25 of 25 points").wait_for()
        # by the keyboard: the highest frequency first, and it is picked
        heading = page.get_by_role("button", name="Natural frequency x")
        for _ in range(2):
            heading.press("Enter")
            page.locator("th[aria-sort=ascending], th[aria-sort=descending]").first.wait_for()
        page.locator("th[aria-sort=descending]").wait_for()
        page.locator(".points tbody button").first.press("Enter")
        page.get_by_text("Point 25. leg.notch.neck thickness [mm]: 0.6500").wait_for()
        # by a click on the curve
        marks = page.locator(".points").locator("xpath=..").locator(".scatterlayer .point")
        marks.nth(8).click(force=True)
        page.locator(".selected-sample", has_text="Point 9.").wait_for()
        with page.expect_download() as waiting:
            page.get_by_role("button", name="sweep.csv").click()
        assert waiting.value.suggested_filename == "sweep.csv"
        look.require_sound("explore-sweep")
        page.get_by_role("button", name="Open in Design").click()
        page.get_by_role("heading", name="parallelogram (changed)").wait_for()
        assert page.get_by_label("Value of leg.notch.neck_thickness").input_value() == "0.45"
        undo_to(page, "parallelogram")
        # back, the points are still there; a search is cancelled after a reload, and kept
        page.get_by_role("link", name="Explore").click()
        page.get_by_text("25 of 25 points").wait_for()
        page.get_by_role("button", name="Optimise", exact=True).click()
        page.get_by_role("button", name="Add goal").click()
        page.get_by_role("button", name="Run optimise").click()
        page.locator(".points table").wait_for()
        page.reload()
        page.locator(".points table").wait_for()
        page.get_by_role("button", name="Cancel").click()
        page.get_by_text("Cancelled. The designs so far are below.").wait_for()
        page.locator(".points tbody button").first.click()
        page.get_by_role("button", name="Open in Design").wait_for()
        page.get_by_role("button", name="parallel coordinates").click()
        page.get_by_text("lowest third").wait_for()
        look.require_sound("explore-front")
