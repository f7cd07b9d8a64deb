"""Explore: what moves what, sweeps, the best stage, and what the workshop makes of it."""

import asyncio
import hashlib

from nicegui import ui

from flexstage.base.errors import FlexstageError
from flexstage.files.names import file_name
from flexstage.files.request import Request
from flexstage.web.design.choice import StageChoice
from flexstage.web.design.state import DesignState, Variant
from flexstage.web.design.work import checked
from flexstage.web.explore.forms import Fields, build_form, what_it_takes
from flexstage.web.explore.results import Results
from flexstage.web.explore.stage_summary import StageSummary, summarise_stage
from flexstage.web.explore.state import KINDS, ExploreState, Run
from flexstage.web.explore.work import define_study, run_exploration
from flexstage.web.figures import picture
from flexstage.web.page import Page, PanelHeading, display_text, div, panel, remark


def build(page: Page) -> None:
    """Make the view."""
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
        self._facts: StageSummary | None = None

    def build(self) -> None:
        """Make the view."""
        with panel("toolbar"):
            StageChoice(self._page, self._opened)
            self._changed_label = ui.label().classes("muted")
            ui.space()
            ui.toggle(KINDS, value=self._state.kind, on_change=self._turn).props("no-caps").classes(
                "explore-kinds"
            )
        with div("columns explore"):
            self._form = panel("asked")
            self._results = panel()
        self._opened()
        if self._state.kind in self._state.runs:
            self._show_results()

    # the form

    def _opened(self) -> None:
        """Fill the form for the stage at hand, once its figures are known."""
        variant = self._design.now
        changed = len(variant.values)
        self._changed_label.text = f"{variant.name}, {changed} changed in Design" if changed else ""
        self._facts = self._state.facts.get(variant)
        if self._state.kind not in self._state.runs:
            self._show_results()
        if self._facts is not None:
            self._show_form(variant)
            return
        self._form.clear()
        with self._form:
            ui.label("Reading the stage …").classes("muted").props('role="status"')
        self._page.begin(self._read(variant))

    async def _read(self, variant: Variant) -> None:
        try:
            facts = await asyncio.to_thread(summarise_stage, variant)
        except FlexstageError as error:
            self._form.clear()
            with self._form:
                ui.label(display_text(str(error))).classes("issue error").props('role="alert"')
            return
        self._state.facts.put(variant, facts)
        if variant == self._design.now:
            self._facts = facts
            self._show_form(variant)

    def _show_form(self, variant: Variant) -> None:
        state, facts = self._state, self._facts
        assert facts is not None
        state.fit(variant, facts)
        self._form.clear()
        with self._form:
            PanelHeading(KINDS[state.kind])
            remark(type(state.form.request).__doc__ or "")
            fields = Fields(facts, self._page, self._changed)
            with div("form"):
                build_form(state.form, fields)
            with div("go"):
                self._takes = ui.label().classes("muted small").props('role="status"')
                self._go = ui.button(f"Run {KINDS[state.kind].casefold()}", on_click=self._start)
                self._go.props("icon=play_arrow")
        self._changed()

    def _turn(self, event: object) -> None:
        self._state.kind = getattr(event, "value", "") or self._state.kind
        if self._facts is not None:
            self._show_form(self._design.now)
        self._show_results()

    def _changed(self) -> None:
        """Say what the form as it is takes, or what it lacks."""
        assert self._facts is not None
        try:
            request = self._state.form.whole(self._facts)
            told, is_possible = what_it_takes(request, self._facts), True
        except FlexstageError as error:
            told, is_possible = display_text(str(error)), False
        self._takes.text = told
        self._takes.classes(
            add="" if is_possible else "issue", remove="issue" if is_possible else ""
        )
        self._go.set_enabled(is_possible)

    # runs

    async def _start(self) -> None:
        with self._page.show_errors():
            await self._started()

    async def _started(self) -> None:
        state, facts, variant = self._state, self._facts, self._design.now
        assert facts is not None
        request = state.form.whole(facts)
        question = await asyncio.to_thread(define_study, facts.template, request)
        before = state.runs.get(state.kind)
        if before is not None:
            before.job.cancel()
            await asyncio.to_thread(before.job.wait, 5.0)
        said = _folder_name(state.kind, facts, request, self._page.session.id)
        folder = self._page.panel.folder(f"explore/{said}")
        job = self._page.panel.jobs.start(
            f"{KINDS[state.kind]} of {variant.name}", run_exploration, folder, facts.template, request,
            f"found-{state.kind}", owner=self._page.session.id,
        )  # fmt: skip
        state.runs[state.kind] = Run(variant, facts, request, folder, job, question)
        self._show_results()

    def _show_results(self) -> None:
        self._results.clear()
        run = self._state.runs.get(self._state.kind)
        with self._results:
            if run is not None:
                Results(self._page, run).build()
                return
            PanelHeading(self._design.now.name)
            ui.label(
                f"Nothing was run yet. Press Run {KINDS[self._state.kind].casefold()}: the form is "
                "filled with what is usual for this stage."
            ).classes("muted")
            drawing = picture("")
        self._page.begin(self._draw(drawing))

    async def _draw(self, drawing: ui.html) -> None:
        """Draw the stage at hand where nothing was found yet."""
        with self._page.show_errors():
            found = await asyncio.to_thread(checked, self._design.now, f"at-hand{drawing.id}")
            if not drawing.is_deleted:
                drawing.content = found.svg


def _folder_name(kind: str, facts: StageSummary, request: Request, owner: str) -> str:
    """Return a name that the same run of a person has again, to go on from what was finished."""
    said = hashlib.sha256(repr((facts.template, request, owner)).encode()).hexdigest()[:8]
    return file_name(f"{kind}-{facts.template.stage().name}-{said}")
