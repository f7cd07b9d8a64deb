"""Analyse: run models of the stage that is open, and look at what they find."""

from nicegui import events, ui

from flexstage.quantities.comparison import MODEL_WORDS, title_of
from flexstage.report.tables import coupling_tables
from flexstage.web.analyse.bode import Bode
from flexstage.web.analyse.convergence import Convergence
from flexstage.web.analyse.models_panel import ModelsPanel
from flexstage.web.analyse.shapes import NOTHING_YET, Shapes
from flexstage.web.analyse.state import AnalyseState
from flexstage.web.analyse.tables import figures_tables, hinges_table, modes_table
from flexstage.web.analyse.work import Analysed, saved
from flexstage.web.design.choice import StageChoice
from flexstage.web.design.state import DesignState
from flexstage.web.figures import show_table
from flexstage.web.jobs import BackgroundJob
from flexstage.web.page import Page, PanelHeading, div, panel, quiet_button, show_job

_QUICK = "lumped"
#: Parts of the results, and their icons.
_PARTS = {"Shapes": "animation", "Bode": "ssid_chart", "Convergence": "trending_flat"}


def build(page: Page) -> None:
    """Make the view."""
    AnalyseView(page).build()


class AnalyseView:
    """The view in one page.

    Parameters
    ----------
    page
        The page.
    """

    def __init__(self, page: Page) -> None:
        self._page = page
        self._state = page.session.state(AnalyseState)
        self._design = page.session.state(DesignState)
        self._seen: object = None
        self._found: dict[str, Analysed] | None = None

    def build(self) -> None:
        """Make the view."""
        with panel("toolbar"):
            StageChoice(self._page, self._opened)
            ui.space()
            self._working = ui.element("div")
            self._save = quiet_button("Save results", icon="download", on_click=self._save_all)
        with div("columns analyse"):
            with div("stacked"):
                with panel():
                    self._models = ModelsPanel(self._page)
                with panel("figures"):
                    self._title = PanelHeading()
                    self._tables = div("full-width stacked")
            with panel("sticky").props("tabindex=0"):
                self._results()
        self._opened()
        ui.timer(0.2, self._look)

    def _results(self) -> None:
        tabs = ui.tabs().props("dense no-caps align=left inline-label").classes("parts")
        with tabs:
            for name, icon in _PARTS.items():
                ui.tab(name, icon=icon)
        tabs.value = self._state.shown.part
        tabs.on_value_change(self._choose_part)
        self._place = div("full-width")
        self._open_part()

    def _choose_part(self, event: events.ValueChangeEventArguments) -> None:
        self._state.shown.part = event.value
        self._open_part()

    def _open_part(self) -> None:
        """Make the part of the results that is open; charts need their place to be seen."""
        self._place.clear()
        with self._place:
            self._part = self._made(self._state.shown.part)
            self._part.show(self._known())

    def _made(self, part: str) -> Shapes | Bode | Convergence:
        match part:
            case "Bode":
                return Bode(self._page)
            case "Convergence":
                return Convergence(self._page, self._models.start)
        return Shapes(self._page)

    def _opened(self) -> None:
        """Follow another stage; what is quick is begun at once."""
        variant = self._design.now
        key = (variant, _QUICK)
        if self._state.found(*key) is None and key not in self._state.failed:
            self._models.start(_QUICK)
        self._look()

    def _look(self) -> None:
        self._state.take()
        now = (self._state.revision, self._design.now, len(self._state.jobs))
        if now == self._seen:
            return
        self._seen = now
        self._models.sync()
        self._show()

    def _known(self) -> dict[str, Analysed]:
        found = {model: self._state.found(self._design.now, model) for model in MODEL_WORDS}
        return {model: one for model, one in found.items() if one is not None}

    def _show(self) -> None:
        variant, found = self._design.now, self._known()
        self._title.text = f"{variant.name}{' (changed)' if variant.values else ''}"
        self._save.set_enabled(bool(found))
        if found != self._found:
            self._found = found
            self._show_tables(list(found.values()))
            self._part.show(found)

    def _show_tables(self, every: list[Analysed]) -> None:
        self._tables.clear()
        with self._tables:
            if not every:
                ui.label(NOTHING_YET).classes("muted")
                return
            first, others = figures_tables(self._page.preferences, every)
            if first.rows:
                show_table(first)
            for drives in every[0].analysis.modes:
                with self._fold(f"Natural frequencies, drives {drives}", drives == "removed"):
                    show_table(modes_table(every, drives))
            with self._fold("All other figures"):
                show_table(others)
            self._show_details(every)

    def _show_details(self, every: list[Analysed]) -> None:
        best = every[-1]  # that leaves the least out
        if best.analysis.coupling is not None:
            with self._fold(f"All drives together, {title_of(best.model)}"):
                for shown in coupling_tables(best.analysis.coupling):
                    show_table(shown)
        stress = hinges_table(best)
        if stress.rows:
            with self._fold(f"Stress of each hinge, {title_of(best.model)}"):
                show_table(stress)
        with self._fold("Where the figures stop being valid"):
            for one in every:
                for words in one.analysis.validity:
                    ui.label(f"{title_of(one.model)}: {words}").classes("small")

    def _fold(self, title: str, is_open: bool = False) -> ui.expansion:
        """Return a part that is folded, or as it was left."""
        folds = self._state.shown.folds
        made = ui.expansion(title, value=folds.get(title, is_open))
        return made.on_value_change(lambda event: folds.update({title: event.value}))

    def _save_all(self) -> None:
        found = list(self._known().values())
        folder = self._page.panel.folder("analyse")
        job = self._page.panel.jobs.start(
            "saving results", saved, folder, found, owner=self._page.session.id
        )
        self._save.disable()

        def over(job: BackgroundJob) -> None:
            self._save.enable()
            if job.state == "done":
                ui.download.file(job.result)

        with self._working:
            show_job(self._page, job, over)
