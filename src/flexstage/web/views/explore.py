"""Explore: sweep, optimisation, tolerance and sensitivity analysis of a stage."""

import asyncio
import hashlib

from nicegui import ui

from flexstage.base.errors import FlexstageError
from flexstage.files.names import file_name
from flexstage.files.request import Request
from flexstage.web.design.choice import StageChoice
from flexstage.web.design.state import DesignState, Variant
from flexstage.web.design.work import draw_with_issues
from flexstage.web.explore.forms import FormFields, build_form, work_estimate
from flexstage.web.explore.results import Results
from flexstage.web.explore.state import (
    KINDS,
    ExploreRun,
    ExploreState,
    StageSummary,
    summarise_stage,
)
from flexstage.web.explore.work import define_study, run_exploration
from flexstage.web.figures import picture
from flexstage.web.page import Page, PanelHeading, display_text, div, panel, remark


def build(page: Page) -> None:
    """Build the view."""
    ExploreView(page).build()


class ExploreView:
    """The view in one page.

    Parameters
    ----------
    page
        The page.
    """

    def __init__(self, page: Page) -> None:
        self._page = page
        self._design = page.session.state(DesignState)
        self._state = page.session.state(ExploreState)
        self._summary: StageSummary | None = None

    def build(self) -> None:
        """Build the view."""
        with panel("toolbar"):
            StageChoice(self._page, self._opened)
            self._changed_label = ui.label().classes("muted")
            ui.space()
            ui.toggle(KINDS, value=self._state.kind, on_change=self._turn).props("no-caps").classes(
                "explore-kinds"
            )
        with div("columns explore"):
            self._form = panel("form-panel")
            self._results = panel()
        self._opened()
        if self._state.kind in self._state.runs:
            self._show_results()

    # form

    def _opened(self) -> None:
        """Fill the form for the open stage, once its figures are known."""
        variant = self._design.now
        changed = len(variant.values)
        self._changed_label.text = (
            f"{variant.name}, {changed} parameters changed in Design" if changed else ""
        )
        self._summary = self._state.summaries.get(variant)
        if self._state.kind not in self._state.runs:
            self._show_results()
        if self._summary is not None:
            self._show_form(variant)
            return
        self._form.clear()
        with self._form:
            ui.label("Analysing the stage …").classes("muted").props('role="status"')
        self._page.begin(self._read, variant)

    async def _read(self, variant: Variant) -> None:
        try:
            summary = await asyncio.to_thread(summarise_stage, variant)
        except FlexstageError as error:
            self._form.clear()
            with self._form:
                ui.label(display_text(str(error))).classes("issue error").props('role="alert"')
            return
        self._state.summaries.put(variant, summary)
        if variant == self._design.now:
            self._summary = summary
            self._show_form(variant)

    def _show_form(self, variant: Variant) -> None:
        state, summary = self._state, self._summary
        assert summary is not None
        state.open_stage(variant, summary)
        self._form.clear()
        with self._form:
            PanelHeading(KINDS[state.kind])
            remark(type(state.form.request).__doc__ or "")
            fields = FormFields(summary, self._page, self._changed)
            with div("form"):
                build_form(state.form, fields)
            with div("go"):
                self._estimate = ui.label().classes("muted small").props('role="status"')
                self._go = ui.button(f"Run {KINDS[state.kind].casefold()}", on_click=self._start)
                self._go.props("icon=play_arrow")
        self._changed()

    def _turn(self, event: object) -> None:
        self._state.kind = getattr(event, "value", "") or self._state.kind
        if self._summary is not None:
            self._show_form(self._design.now)
        self._show_results()

    def _changed(self) -> None:
        """Show the amount of work of the request, or its missing input."""
        assert self._summary is not None
        try:
            request = self._state.form.complete_request(self._summary)
            text, is_possible = work_estimate(request, self._summary), True
        except FlexstageError as error:
            text, is_possible = display_text(str(error)), False
        self._estimate.text = text
        self._estimate.classes(
            add="" if is_possible else "issue", remove="issue" if is_possible else ""
        )
        self._go.set_enabled(is_possible)

    # runs

    async def _start(self) -> None:
        with self._page.show_errors():
            await self._start_run()

    async def _start_run(self) -> None:
        state, summary, variant = self._state, self._summary, self._design.now
        assert summary is not None
        request = state.form.complete_request(summary)
        definition = await asyncio.to_thread(define_study, summary.template, request)
        previous = state.runs.get(state.kind)
        if previous is not None:
            previous.job.cancel()
            await asyncio.to_thread(previous.job.wait, 5.0)
        name = _folder_name(state.kind, summary, request, self._page.session.id)
        folder = self._page.panel.folder(f"explore/{name}")
        job = self._page.panel.jobs.start(
            f"{KINDS[state.kind]} of {variant.name}", run_exploration,
            folder, summary.template, request, f"run-{state.kind}", owner=self._page.session.id,
        )  # fmt: skip
        state.runs[state.kind] = ExploreRun(variant, summary, request, folder, job, definition)
        self._show_results()

    def _show_results(self) -> None:
        self._results.clear()
        run = self._state.runs.get(self._state.kind)
        with self._results:
            if run is not None:
                Results(self._page, run).build()
                return
            PanelHeading(self._design.now.name)
            kind = KINDS[self._state.kind].casefold()
            ui.label(f"No results yet. Defaults are filled in; press Run {kind}.").classes("muted")
            drawing = picture("")
        self._page.begin(self._draw, drawing)

    async def _draw(self, drawing: ui.html) -> None:
        """Draw the open stage, as there are no results yet."""
        with self._page.show_errors():
            drawing_with_issues = await asyncio.to_thread(
                draw_with_issues, self._design.now, f"open-stage{drawing.id}"
            )
            if not drawing.is_deleted:
                drawing.content = drawing_with_issues.svg


def _folder_name(kind: str, summary: StageSummary, request: Request, owner: str) -> str:
    """Return the same name for the same run of a browser, so that it can be resumed."""
    digest = hashlib.sha256(repr((summary.template, request, owner)).encode()).hexdigest()[:8]
    return file_name(f"{kind}-{summary.template.stage().name}-{digest}")
