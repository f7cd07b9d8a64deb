"""Report: write the report of a stage, and show the written reports."""

from dataclasses import dataclass, replace
from typing import Any

from nicegui import ui

from flexstage.quantities.comparison import title_of
from flexstage.report.study import CHAPTERS
from flexstage.studies.models import MODELS
from flexstage.studies.requests import ALL_PARTS, StudyRequest
from flexstage.web.design.choice import StageChoice
from flexstage.web.design.state import DesignState
from flexstage.web.jobs import BackgroundJob
from flexstage.web.page import (
    Page,
    PanelHeading,
    choice,
    div,
    panel,
    quiet_button,
    remark,
    show_job,
)
from flexstage.web.reports import FILES, WrittenReport, write_report, written_reports

_PARTS = {
    "virtual": "simulated measurement",
    "identification": "hysteresis",
    "traditional": "traditional stages",
}
_NAMES = {name: title_of(name) for name in MODELS}
_EMPTY = (
    "Write the report of the stage above. One page compares the models with published values, and "
    "these chapters follow. The report is one self-contained file. It takes a few seconds, "
    "with finite elements of the whole stage a minute, and in 3D several minutes. Cached results "
    "are reused."
)
_SANDBOX = "allow-same-origin allow-scripts allow-modals allow-popups allow-downloads"
_PRINT = "document.querySelector('iframe.report').contentWindow.print()"
# a report follows the theme of the page, not the computer; prints are always light
_FOLLOW_LOOK = """(event) => {
  const report = event.target.contentDocument;
  const rules = [...report.styleSheets].flatMap(sheet => [...sheet.cssRules]);
  const dark = rules.filter(rule => rule.media?.mediaText.includes("prefers-color-scheme"));
  const scheme = report.head.appendChild(report.createElement("style"));
  const follow = () => {
    const isDark = document.body.classList.contains("body--dark");
    dark.forEach(rule => { rule.media.mediaText = isDark ? "screen" : "not all"; });
    scheme.textContent = `@media screen { :root { color-scheme: ${isDark ? "dark" : "light"}; } }`;
  };
  follow();
  new MutationObserver(follow).observe(document.body, {attributeFilter: ["class"]});
}"""


def build(page: Page) -> None:
    """Build the view."""
    ReportView(page).build()


@dataclass
class ReportState:
    """State of the view Report in one browser."""

    request: StudyRequest = StudyRequest(model=("lumped", "superelement"))
    """Request of the next report."""
    open: str = ""
    """Name of the displayed report; empty for the newest."""
    job: BackgroundJob | None = None
    """Job that writes a report."""


class ReportView:
    """The view in one page.

    Parameters
    ----------
    page
        The page.
    """

    def __init__(self, page: Page) -> None:
        self._page = page
        self._state = page.session.state(ReportState)
        self._folder = page.panel.folder("report")

    def build(self) -> None:
        """Build the view."""
        with panel("toolbar"):
            StageChoice(self._page, self._name_stage)
            self._choices()
            self._go = ui.button(on_click=self._write)
            self._working = div("working")
        self._report_area = panel("report")
        self._name_stage()
        self._follow()
        self._show()

    def _choices(self) -> None:
        request = self._state.request
        models = choice(
            _NAMES, list(request.model), "Models", lambda e: self._choose("model", tuple(e.value)),
            multiple=True,
        )  # fmt: skip
        models.props("use-chips")
        with div("parts"):
            for name, label in _PARTS.items():
                box = ui.checkbox(label, value=name in request.parts).props("dense")
                box.on_value_change(
                    lambda e, name=name: self._tick(name, is_selected=bool(e.value))
                )

    def _tick(self, part: str, *, is_selected: bool) -> None:
        present = self._state.request.parts
        parts = [name for name in ALL_PARTS if (is_selected if name == part else name in present)]
        self._choose("parts", tuple(parts) or ("none",))

    def _choose(self, name: str, value: Any) -> None:
        self._state.request = replace(self._state.request, **{name: value})

    def _name_stage(self) -> None:
        now = self._page.session.state(DesignState).now
        self._go.text = f"Write report of {now.name}{' (changed)' if now.values else ''}"

    # writing

    def _write(self) -> None:
        state, page = self._state, self._page
        if not state.request.model:
            ui.notify("Choose a model", type="warning")
            return
        variant = page.session.state(DesignState).now
        state.job = page.panel.jobs.start(
            f"report of {variant.name}", write_report, self._folder, variant, state.request,
            owner=page.session.id,
        )  # fmt: skip
        self._follow()

    def _follow(self) -> None:
        """Show the progress of the report, also after a reload."""
        if (job := self._state.job) is not None:
            self._go.disable()
            with self._working:
                show_job(self._page, job, self._finish)

    def _finish(self, job: BackgroundJob) -> None:
        self._go.enable()
        self._state.job = None
        if job.state == "done":
            self._state.open = job.result.name
            self._show()

    # reading

    def _show(self) -> None:
        reports = {report.name: report for report in written_reports(self._folder)}
        self._report_area.clear()
        with self._report_area:
            if not reports:
                PanelHeading("No report yet")
                ui.label(_EMPTY).classes("words")
                _chapters()
                return
            report = reports.get(self._state.open) or next(iter(reports.values()))
            with ui.row().classes("items-center heading"):
                titles = {name: each.title for name, each in reports.items()}
                choice(titles, report.name, "Written reports", lambda e: self._open(e.value))
                self._file_links(report)
            frame = ui.element("iframe").classes("report")
            frame.on("load", js_handler=_FOLLOW_LOOK)
            # its policy allows its own script; the sandbox confines it to the frame
            frame.props["sandbox"] = _SANDBOX
            frame.props["src"], frame.props["title"] = report.address(), f"Report: {report.title}"

    def _open(self, name: str) -> None:
        self._state.open = name
        self._show()

    def _file_links(self, report: WrittenReport) -> None:
        """Show the links to print, open and download the files of a report."""
        quiet_button("Print", icon="print", on_click=lambda: ui.run_javascript(_PRINT))
        with div("file-links"):
            ui.label("Open in a new tab:")
            for file in report.files:
                if file.endswith(".html"):
                    ui.link(FILES[file], report.address(file), new_tab=True)
        with div("file-links"):
            ui.label("Download:")
            for file in report.files:
                link = ui.link(file, report.address(file))
                link.props["download"] = f"{report.name}-{file}"


def _chapters() -> None:
    with div("chapters"):
        for chapter in CHAPTERS.values():
            with ui.element("div"):
                PanelHeading(chapter.title, 3)
                titles = (title for title, _ in chapter.sections.values() if title)
                remark("; ".join(titles))
