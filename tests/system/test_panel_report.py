"""The view Report: what it writes is what `flexstage study` writes, and what it serves is that."""

import json
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from flexstage.cli import main
from flexstage.stage.designs import StageTemplate
from flexstage.studies import results_json, run_study
from flexstage.studies.requests import StudyRequest
from flexstage.web.design.state import DesignState, Variant
from flexstage.web.reports import (
    FILES,
    WrittenReport,
    new_folder,
    write_report,
    written_reports,
)
from flexstage.web.views.report import ReportState
from tests.panel import OUT, come, looked_at, simulated

LITTLE = StudyRequest.of_models("lumped")
GUIDE = Variant(StageTemplate.of("parallelogram"))


@pytest.mark.usefixtures("undrawn")
def test_a_report_holds_what_the_study_found(tmp_path: Path) -> None:
    report = write_report(tmp_path, GUIDE, LITTLE, cache=False)
    assert report.files == ["report.html", "results.json"]
    own = json.loads((report.folder / "results.json").read_text())
    found = run_study(GUIDE.stage(), model=["lumped"]).to_dict()
    assert own["characteristics"] == json.loads(results_json(found))["characteristics"]
    assert "<h1>parallelogram" in (report.folder / "report.html").read_text()


@pytest.mark.slow
def test_a_report_is_that_of_the_command(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    variant = GUIDE.changed("leg_spacing", 0.061, 0.05)
    report = write_report(tmp_path, variant, replace(LITTLE, parts=("virtual",)))
    assert report.name.startswith("parallelogram-changed_")
    assert report.files == list(FILES)
    options = "--model lumped --parts virtual --quiet --json --set leg_spacing=61mm --folder"
    with pytest.raises(SystemExit) as end:
        main(["study", "parallelogram", *options.split(), str(tmp_path / "out")])
    assert not end.value.code
    assert capsys.readouterr().out
    results = [
        re.sub(r'"created": ".*?"', "", (folder / "results.json").read_text())
        for folder in (tmp_path / "out", report.folder)
    ]
    assert results[0] == results[1]


def test_reports_are_listed_the_newest_first_and_each_has_a_folder(tmp_path: Path) -> None:
    (tmp_path / "half").mkdir()
    for name in ("guide_20260102-030405", "guide_20260102-030406"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "report.html").write_text("x")
    names = [report.name for report in written_reports(tmp_path)]
    assert names == ["guide_20260102-030406", "guide_20260102-030405"]
    assert written_reports(tmp_path)[0].title.startswith("guide, ")
    first = new_folder(tmp_path, "guide")
    first.mkdir()
    second = new_folder(tmp_path, "guide")
    assert second != first
    assert not second.exists()


def test_only_the_files_of_reports_are_served(tmp_path: Path) -> None:
    async def look(user: Any, panel: Any) -> None:
        folder = panel.folder("report") / "guide_20260102-030405"
        folder.mkdir()
        (folder / "report.html").write_text("<h1>a report</h1>")
        (folder / "notes.txt").write_text("none of a report")
        (panel.options.folder / "password.txt").write_text("secret")
        report = WrittenReport(folder)
        found = await user.http_client.get(report.address())
        assert (found.status_code, found.text) == (200, "<h1>a report</h1>")
        of_panel, of_report = sorted(
            found.headers.get_list("content-security-policy"), key=lambda p: "'none'; script" in p
        )
        assert "frame-ancestors 'self'" in of_panel
        assert "script-src 'sha256-" in of_report
        assert "unsafe-eval" not in of_report
        for other in ("notes.txt", "results.json", "..%2F..%2Fpassword.txt", "%2e%2e"):
            refused = await user.http_client.get(report.address(other))
            assert refused.status_code in {400, 404}, other
        user.http_client.cookies.clear()
        assert (await user.http_client.get(report.address())).status_code == 401

    simulated(tmp_path, look)


def test_a_report_that_is_being_written_is_found_after_a_reload_and_can_be_cancelled(
    tmp_path: Path,
) -> None:
    async def look(user: Any, panel: Any) -> None:
        await user.open("/report")
        await user.should_see("No report yet")
        (session,) = panel.access._sessions.values()
        session.state(DesignState).open(GUIDE.template)
        await user.open("/report")
        user.find("Write report of parallelogram").click()
        state = session.state(ReportState)
        job = state.job
        assert job is not None
        await user.open("/report")
        await user.should_see("report of parallelogram")
        user.find("Cancel").click()
        await come(lambda: state.job is None)
        assert job.state == "cancelled"
        assert not written_reports(panel.folder("report"))

    simulated(tmp_path, look)


@pytest.mark.slow
def test_a_report_is_written_read_printed_and_kept_in_the_page(tmp_path: Path) -> None:
    with looked_at(tmp_path) as look:
        page = look.page
        page.get_by_role("link", name="Report").click()
        page.get_by_text("No report yet").wait_for()
        look.require_sound("report-none")
        for part in ("hysteresis", "traditional stages"):
            page.get_by_role("checkbox", name=part).click()
        page.get_by_role("button", name="Write report of vgtu-piezo").click()
        frame = page.frame_locator("iframe.report")
        frame.get_by_role("heading", name="vgtu-piezo").first.wait_for()
        assert frame.locator("#summary table").is_visible()
        assert not frame.locator("#statics table").first.is_visible()
        look.require_sound("report")
        # the look that was chosen holds for the report as well
        page.emulate_media(color_scheme="light")
        ground = frame.locator("body").evaluate("body => getComputedStyle(body).backgroundColor")
        page.get_by_role("button", name="Units and theme").click()
        page.get_by_role("combobox", name="Theme").click()
        page.get_by_role("option", name="dark").click()
        page.keyboard.press("Escape")
        page.wait_for_selector("body.body--dark")
        page.wait_for_timeout(300)
        dark = frame.locator("body").evaluate("body => getComputedStyle(body).backgroundColor")
        assert dark != ground
        with page.expect_download() as waiting:
            page.get_by_role("link", name="report.html").click()
        assert waiting.value.suggested_filename.endswith("-report.html")
        page.reload()
        frame.get_by_role("heading", name="vgtu-piezo").first.wait_for()
        with page.context.expect_page() as waiting:
            page.get_by_role("link", name="Report", exact=True).last.click()
        printed = waiting.value
        printed.wait_for_load_state()
        # nothing is folded on paper, nor dark, nor wider than it
        printed.emulate_media(color_scheme="dark", media="print")
        assert printed.locator("#statics table").first.is_visible()
        assert printed.evaluate("getComputedStyle(document.body).backgroundColor") == ground
        (OUT / "report.pdf").write_bytes(printed.pdf(prefer_css_page_size=True))
        assert not look.complaints
