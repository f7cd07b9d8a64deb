"""Report: what all models say of a stage, on one page, and the reports that were written."""

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
    "Write one of the stage above: its models beside what was published of it, the result on one "
    "page, and these chapters folded below it. It is one file, which opens and prints without "
    "flexstage. It takes some seconds; with finite elements of the whole a minute, in 3D "
    "several. What was computed before of the same stage is read."
)
_MAY = "allow-same-origin allow-scripts allow-modals allow-popups allow-downloads"
_PRINT = "document.querySelector('iframe.report').contentWindow.print()"
# a report follows the computer, and the page perhaps not; on paper it is light in any case
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
    """Make the view."""
    ReportView(page).build()


@dataclass
class ReportState:
    """What one person has open in the view Report."""

    asked: StudyRequest = StudyRequest(model=("lumped", "superelement"))
    """What the next report holds."""
    open: str = ""
    """Name of the report that is shown; empty for the newest one."""
    job: BackgroundJob | None = None
    """The report that is being written."""


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
        """Make the view."""
        with panel("toolbar"):
            StageChoice(self._page, self._name_stage)
            self._choices()
            self._go = ui.button(on_click=self._write)
            self._working = div("working")
        self._shown = panel("report")
        self._name_stage()
        self._follow()
        self._show()

    def _choices(self) -> None:
        asked = self._state.asked
        models = choice(
            _NAMES, list(asked.model), "Models", lambda e: self._choose("model", tuple(e.value)),
            multiple=True,
        )  # fmt: skip
        models.props("use-chips")
        with div("parts"):
            for name, label in _PARTS.items():
                box = ui.checkbox(label, value=name in asked.parts).props("dense")
                box.on_value_change(lambda e, name=name: self._tick(name, chosen=bool(e.value)))

    def _tick(self, part: str, *, chosen: bool) -> None:
        now = self._state.asked.parts
        parts = [name for name in ALL_PARTS if (chosen if name == part else name in now)]
        self._choose("parts", tuple(parts) or ("none",))

    def _choose(self, name: str, value: Any) -> None:
        self._state.asked = replace(self._state.asked, **{name: value})

    def _name_stage(self) -> None:
        now = self._page.session.state(DesignState).now
        self._go.text = f"Write report of {now.name}{' (changed)' if now.values else ''}"

    # writing

    def _write(self) -> None:
        state, page = self._state, self._page
        if not state.asked.model:
            ui.notify("choose a model", type="warning")
            return
        variant = page.session.state(DesignState).now
        state.job = page.panel.jobs.start(
            f"report of {variant.name}", write_report, self._folder, variant, state.asked,
            owner=page.session.id,
        )  # fmt: skip
        self._follow()

    def _follow(self) -> None:
        """Show the report that is being written, also after a reload."""
        if (job := self._state.job) is not None:
            self._go.disable()
            with self._working:
                show_job(self._page, job, self._over)

    def _over(self, job: BackgroundJob) -> None:
        self._go.enable()
        self._state.job = None
        if job.state == "done":
            self._state.open = job.result.name
            self._show()

    # reading

    def _show(self) -> None:
        reports = {report.name: report for report in written_reports(self._folder)}
        self._shown.clear()
        with self._shown:
            if not reports:
                PanelHeading("No report yet")
                ui.label(_EMPTY).classes("words")
                _chapters()
                return
            report = reports.get(self._state.open) or next(iter(reports.values()))
            with ui.row().classes("items-center heading"):
                titles = {name: each.title for name, each in reports.items()}
                choice(titles, report.name, "Written reports", lambda e: self._open(e.value))
                self._ways(report)
            frame = ui.element("iframe").classes("report")
            frame.on("load", js_handler=_FOLLOW_LOOK)
            # its own script runs, by the policy it is served with; it cannot leave the frame
            frame.props["sandbox"] = _MAY
            frame.props["src"], frame.props["title"] = report.address(), f"Report: {report.title}"

    def _open(self, name: str) -> None:
        self._state.open = name
        self._show()

    def _ways(self, report: WrittenReport) -> None:
        """Offer the files of a report: to print, to read in a tab of their own, to keep."""
        quiet_button("Print", icon="print", on_click=lambda: ui.run_javascript(_PRINT))
        with div("ways"):
            ui.label("Open in a tab:")
            for file in report.files:
                if file.endswith(".html"):
                    ui.link(FILES[file], report.address(file), new_tab=True)
        with div("ways"):
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
