"""The view Explore without a browser: what it finds is what the command finds, and is picked."""

import asyncio
import json
import shlex
import time
from collections.abc import Callable
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
from flexstage.web.explore import charts, points
from flexstage.web.explore.downloads import same_command
from flexstage.web.explore.facts import StageFacts, facts_of
from flexstage.web.explore.state import (
    ExploreForm,
    ExploreState,
    LimitWords,
    RangeWords,
    usual_forms,
)
from flexstage.web.explore.work import explored
from flexstage.web.preferences import Preferences
from tests.panel import looked_at, simulated
from tests.system.test_panel_browser import undo_to

GUIDE = Variant(StageTemplate.of("parallelogram"))
NECK = "leg.notch.neck_thickness"
UNITS = Preferences()


@pytest.fixture(scope="module")
def facts() -> StageFacts:
    """A guide of which a neck was changed in the view Design."""
    return facts_of(GUIDE.changed(NECK, 0.00047, 0.0005))


def by_the_command(facts: StageFacts, request: ExploreRequest) -> dict[str, Any]:
    """What the command line that the page shows prints as JSON."""
    words = shlex.split(same_command(facts.template, request))[1:]
    found = CliRunner().invoke(app, [*words, "--json", "--quiet", "--workers", "1"])
    if found.exit_code == 2:  # one that shares no work has no workers
        found = CliRunner().invoke(app, [*words, "--json", "--quiet"])
    assert found.exit_code == 0, found.output
    return json.loads(found.stdout)


def found_by_the_page(folder: Path, facts: StageFacts, request: ExploreRequest) -> Any:
    """What the job of the page returns."""
    return explored(folder, facts.template, request, "found").result


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
    for row in form.over:
        row.is_chosen = row.name in names


@pytest.mark.slow
def test_a_sweep_is_that_of_the_command(tmp_path: Path, facts: StageFacts) -> None:
    form = usual_forms(facts)["sweep"]
    form.over = [RangeWords(NECK, count=3), RangeWords("leg_spacing", 0.035, 0.0475, 2)]
    request = form.whole(facts)
    found: Any = explored(tmp_path, facts.template, request, "found")
    assert f"--set '{NECK}=0.47 mm'" in same_command(facts.template, request)
    same(found.result.to_dict(), by_the_command(facts, request))
    assert {"sweep.csv", "sweep.json", "sweep.svg"} <= {path.name for path in found.files}
    assert (tmp_path / "sweep.csv").read_bytes().count(b"\r\n") == 7
    assert not (tmp_path / "unfinished").exists()
    # 30 % to either side of the neck as it was changed
    assert np.ptp(found.result.points[:, 0]) == pytest.approx(0.6 * 0.00047)


@pytest.mark.slow
def test_sensitivities_and_a_lot_are_those_of_the_command(
    tmp_path: Path, facts: StageFacts
) -> None:
    forms = usual_forms(facts)
    request = forms["sensitivity"].whole(facts)
    assert isinstance(request, SensitivityRequest)
    found = found_by_the_page(tmp_path, facts, request)
    same(found.to_dict(), by_the_command(facts, request))
    lot = forms["tolerance"]
    lot.take("samples", 60)
    lot.take("scatter", ("neck_own=3 um",))
    request = lot.whole(facts)
    assert isinstance(request, ToleranceRequest)
    assert tuple(map(str, request.require)) == (
        "safety_factor.x >= 1.5",
        "output_displacement.x >= 180 µm",
    )
    found = found_by_the_page(tmp_path, facts, request)
    same(found.to_dict(), by_the_command(facts, request))


@pytest.mark.slow
def test_an_optimum_is_that_of_the_command(tmp_path: Path, facts: StageFacts) -> None:
    form = usual_forms(facts)["optimise"]
    assert "--over" not in same_command(facts.template, form.whole(facts))
    vary(form, NECK, "leg_spacing")
    form.take("evaluations", 30)
    form.take("without", ("output_wall.x",))
    form.limits = [LimitWords("max_stress.x", "<=", 95e6)]
    request = form.whole(facts)
    steps: list[Any] = []
    with listen(lambda what, done: None, steps.append):
        found = found_by_the_page(tmp_path, facts, request)
    same(found.to_dict(), by_the_command(facts, request))
    # the way that was shown while it ran is that of the result
    way = points.of_steps(found.problem, steps, UNITS)
    assert way is not None
    goal = way.column("natural_frequency.x")
    assert goal is not None
    assert goal.values.tolist() == [step.objective for step in found.trace]
    assert points.of_optimum(found, UNITS).values(1) == pytest.approx(
        dict(zip(found.problem.family.names, found.point, strict=True))
    )


@pytest.mark.slow
def test_a_front_is_that_of_the_command(tmp_path: Path, facts: StageFacts) -> None:
    form = usual_forms(facts)["optimise"]
    form.goals.append(LimitWords("max_stress.x", "minimise"))
    vary(form, NECK, "leg.bar_length")
    form.take("evaluations", 40)
    request = form.whole(facts)
    stages: list[Any] = []
    with listen(lambda what, done: None, stages.append):
        found = found_by_the_page(tmp_path, facts, request)
    same(found.to_dict(), by_the_command(facts, request))
    shown = points.of_front(found, UNITS)
    search = points.SearchedFront(found.problem)
    for number in range(len(stages)):
        search.table(stages[:number], UNITS)
    live = search.table(stages, UNITS)
    assert live is not None
    # the front that filled while it ran is the one that was found
    assert live.labels.count(points.ON_FRONT) == len(found.points)
    assert live.labels[live.ordered("", descending=False)[0]] == points.ON_FRONT
    assert shown.values(found.selected) == dict(
        zip(found.problem.family.names, found.points[found.selected], strict=True)
    )
    for kind in charts.kinds(shown):
        data, layout = charts.draw(shown, kind, shown.columns[1], shown.columns[0], found.selected)
        assert data[-1]["name"] in ("picked", "as described")
        assert layout["xaxis"]["title"]["text"]


def test_forms_say_what_they_lack(facts: StageFacts) -> None:
    forms = usual_forms(facts)
    forms["sweep"].of = []
    with pytest.raises(ModelError, match="choose at least one figure"):
        forms["sweep"].whole(facts)
    forms["optimise"].limits = [LimitWords("max_stress.x", "<=")]
    with pytest.raises(ModelError, match="which value max_stress"):
        forms["optimise"].whole(facts)
    forms["optimise"].limits = []
    vary(forms["optimise"])
    with pytest.raises(ModelError, match="at least one parameter"):
        forms["optimise"].whole(facts)
    lot = forms["tolerance"]
    lot.take("samples", 0)
    with pytest.raises(ModelError, match=r"samples must be .* from 2 .*, got 0"):
        lot.whole(facts)
    lot.take("samples", 60)
    lot.whole(facts)
    bare = replace(facts, variables={}, flexure=frozenset(), template=StageTemplate.of("cartwheel"))
    with pytest.raises(ModelError, match="cartwheel"):
        usual_forms(bare)["sweep"].whole(bare)
    assert facts.frequency == "natural_frequency.x"
    assert facts.neck == NECK


def test_points_of_a_cancelled_sweep_are_those_that_were_computed(facts: StageFacts) -> None:
    form = usual_forms(facts)["sweep"]
    form.over[0].count = 9
    request = form.whole(facts)
    assert isinstance(request, SweepRequest)
    batches: list[Any] = []
    with listen(lambda what, done: None, batches.append):
        whole = ready_sweep(request, facts.template)()
    part = points.of_batches(swept(request, facts.template), batches[:4], UNITS)
    assert part.computed == 4
    assert part.shown.tolist() == [0, 1, 2, 3]
    frequency = part.column("natural_frequency.x")
    assert frequency is not None
    column = [figure.name for figure in whole.figures].index("natural_frequency.x")
    assert frequency.values[:4].tolist() == whole.values[:4, column].tolist()
    falling = part.ordered("natural_frequency.x", descending=True)
    assert falling == [3, 2, 1, 0]
    data, _ = charts.draw(part, charts.CURVE, part.varied[0], frequency, 2)
    assert data[0]["y"][4] is None
    assert data[0]["customdata"][2] == 2
    assert data[-1]["name"] == "picked"


async def come(condition: Callable[[], Any], seconds: float = 30.0) -> None:
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end, "it never came"
        await asyncio.sleep(0.02)


def test_a_point_is_picked_and_opened_in_design(tmp_path: Path) -> None:
    async def look(user: Any, panel: Any) -> None:
        from nicegui import ui

        await user.open("/explore")
        (session,) = panel.access._sessions.values()
        design, state = session.state(DesignState), session.state(ExploreState)
        design.open(GUIDE.template)
        await user.open("/explore")
        await come(lambda: state.facts.get(GUIDE))
        await user.should_see(kind=ui.button, content="Run sweep", retries=50)
        state.forms["sweep"].over[0].count = 5
        user.find(kind=ui.button, content="Run sweep").click()
        await come(lambda: "sweep" in state.runs)
        run = state.runs["sweep"]
        await come(lambda: run.job.is_over)
        assert run.job.state == "done", run.job.error
        same(
            run.job.result.result.to_dict(),
            by_the_command(run.facts, run.request),
        )
        # a reload finds the result
        await user.open("/explore")
        await user.should_see("5 of 5 points")
        await user.should_see(kind=ui.html, content='data-do="pick:4"')
        await user.should_see(f"flexstage sweep parallelogram --over '{NECK}=0.35..0.65 mm/5'")
        run.picked = 1
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
        page.get_by_text("4 figures, the usual ones").wait_for()
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
        page.locator(".picked", has_text="Point 9.").wait_for()
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
        page.get_by_role("button", name="One more goal").click()
        page.get_by_role("button", name="Run optimise").click()
        page.locator(".points table").wait_for()
        page.reload()
        page.locator(".points table").wait_for()
        page.get_by_role("button", name="Cancel").click()
        page.get_by_text("Cancelled: what was found until then is below.").wait_for()
        page.locator(".points tbody button").first.click()
        page.get_by_role("button", name="Open in Design").wait_for()
        page.get_by_role("button", name="parallel coordinates").click()
        page.get_by_text("lowest third").wait_for()
        look.require_sound("explore-front")
