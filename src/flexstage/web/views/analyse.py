"""Analyse: run models of the stage that is open, and look at what they find."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

from nicegui import events, ui

from flexstage.files.names import file_name
from flexstage.quantities.comparison import MODEL_WORDS, title_of
from flexstage.quantities.quantity import QUANTITIES, number
from flexstage.report.tables import coupling_tables
from flexstage.studies.models import fitting_options
from flexstage.studies.requests import ModelOptions
from flexstage.web.analyse.bode import Bode
from flexstage.web.analyse.shapes import NOTHING_YET, Shapes
from flexstage.web.analyse.state import AnalyseState
from flexstage.web.analyse.work import (
    ModelResult,
    analyse_variant,
    errors_table,
    figures_tables,
    hinges_table,
    meshes_table,
    modes_table,
    saved,
)
from flexstage.web.design.choice import StageChoice
from flexstage.web.design.state import DesignState, Variant
from flexstage.web.figures import picture, show_table
from flexstage.web.jobs import BackgroundJob
from flexstage.web.page import Page, PanelHeading, div, panel, quiet_button, show_job
from flexstage.web.request_form import RequestForm

#: Quantities that a mesh can be refined for, as a model gives them.
_REFINED = ("natural_frequency_hz", "max_stress", "transmission_ratio", "output_stiffness")
_MESHED = ("plane", "solid")


class ModelsPanel:
    """The models of the stage that is open.

    Parameters
    ----------
    page
        The page.
    """

    def __init__(self, page: Page) -> None:
        self._page = page
        self._state = page.session.state(AnalyseState)
        self._design = page.session.state(DesignState)
        self._rows: dict[str, tuple[ui.label, ui.element, ui.label]] = {}
        self._shown_jobs: dict[str, str] = {}
        self._own = RequestForm(page, lambda: self._state.asked, self._take)
        self._fields_of: dict[str, Any] = {}
        with ui.row().classes("items-center heading"):
            PanelHeading("Models")
            ui.space()
            ui.button("Analyse", icon="play_arrow", on_click=self._start_chosen)
        for model in MODEL_WORDS:
            self._row(model)
        with ui.expansion("Options").classes("options"):
            self._options()

    def _row(self, model: str) -> None:
        with div("model"):
            box = ui.checkbox(title_of(model), value=model in self._state.chosen).props("dense")
            status = ui.label().classes("small number")
            working = div("working")
            wrong = ui.label().classes("issue error")
        box.on_value_change(lambda event: self._choose(model, bool(event.value)))
        self._rows[model] = (status, working, wrong)

    def _options(self) -> None:
        own = self._own
        with div("fields"):
            self._fields_of |= {name: own.choice(name) for name in ("plane", "supports")}
        self._fields_of |= {name: own.tick(name) for name in ("estimate", "stroke")}
        ui.checkbox("Write fields for ParaView (VTU)").props("dense").bind_value(
            self._state, "fields"
        ).tooltip("models of the whole")
        with div("fields"):
            self._accuracy = own.number("accuracy").props("clearable")
            quantities = {name: QUANTITIES[name].label for name in _REFINED}
            self._fields_of["quantity"] = own.choice("quantity", quantities)
        for field in (self._accuracy, *self._fields_of.values()):
            field.classes("full-width")

    def _take(self, name: str, value: Any) -> None:
        self._state.asked = replace(self._state.asked, **{name: value})

    def _choose(self, model: str, chosen: bool) -> None:
        others = [name for name in self._state.chosen if name != model]
        self._state.chosen = [m for m in MODEL_WORDS if m in others or (chosen and m == model)]

    def _start_chosen(self) -> None:
        if not self._state.chosen:
            ui.notify("Choose a model first", type="warning", position="top")
            return
        started = [model for model in self._state.chosen if self.start(model)]
        if not started:
            ui.notify("All of this is known already, or on its way", position="top")

    def start(self, model: str) -> bool:
        """Start a model of the stage that is open, unless that is known or on its way."""
        variant = self._design.now
        key = (variant, model)
        with self._page.show_errors():
            for error in self._own.errors.values():
                raise error
            options = fitting_options(model, self._state.asked)
            known = self._state.found(variant, model)
            fields = self._fields(variant, model) if self._state.fields else None
            if key in self._state.jobs or (
                known and known.options == options and (fields is None or known.fields == fields)
            ):
                return False
            self._state.failed.pop(key, None)
            self._state.jobs[key] = self._page.panel.jobs.start(
                f"{variant.name}, {title_of(model)}", analyse_variant,
                variant, model, options, fields, owner=self._page.session.id,
            )  # fmt: skip
            self.sync()
            return True
        return False

    def _fields(self, variant: Variant, model: str) -> Path | None:
        if model not in _MESHED:
            return None
        return self._page.panel.folder("analyse") / file_name(variant.name) / model

    def sync(self) -> None:
        """Show how each model of the stage that is open stands."""
        for name, field in self._fields_of.items():
            field.value = getattr(self._state.asked, name)
        self._accuracy.value = _percent(self._state.asked)
        variant = self._design.now
        for model, (status, working, wrong) in self._rows.items():
            key = (variant, model)
            job, known = self._state.jobs.get(key), self._state.found(variant, model)
            now = job.id if job else ""
            if self._shown_jobs.get(model, "") != now:
                self._shown_jobs[model] = now
                working.clear()
                if job is not None:
                    with working:
                        show_job(self._page, job)
            status.text = f"done in {number(known.seconds, 2)} s" if known else ""
            wrong.text = self._state.failed.get(key, "")
            wrong.visible = bool(wrong.text)


def _percent(asked: ModelOptions) -> float | None:
    """Return the accuracy that is asked for [%]."""
    return None if asked.accuracy is None else float(f"{100.0 * asked.accuracy:.12g}")


#: What the mesh of a model is refined to where it is not said [1].
USUAL_ACCURACY = 0.005


class Convergence:
    """What is known of the errors of what was found.

    Parameters
    ----------
    page
        The page.
    start
        Starts a model with what is asked for now.
    """

    def __init__(self, page: Page, start: Callable[[str], bool]) -> None:
        self._page = page
        self._state = page.session.state(AnalyseState)
        self._start = start
        self._place = div("full-width stacked")

    def show(self, found: dict[str, ModelResult]) -> None:
        """Show what is known."""
        self._place.clear()
        refined = [one for one in found.values() if one.convergence]
        estimated = [one for one in found.values() if one.options.estimate]
        with self._place:
            for one in refined:
                picture(one.convergence)
                show_table(meshes_table(self._page.preferences, one))
            for one in (*refined, *estimated):
                with ui.expansion(f"Estimated errors, {title_of(one.model)}", value=True):
                    show_table(errors_table(self._page.preferences, one))
            if not refined:
                ui.label(
                    "Refine the mesh of a model of finite elements to see how its figures settle."
                ).classes("muted")
                ui.button(
                    f"Refine {title_of('plane')}",
                    on_click=lambda: self._ask("plane", accuracy=USUAL_ACCURACY),
                ).classes("own-width")
            if not estimated:
                ui.label(
                    "Condensed bodies estimate their errors by a lower order and more modes."
                ).classes("muted")
                quiet_button(
                    "Estimate errors", on_click=lambda: self._ask("superelement", estimate=True)
                ).props("outline").classes("own-width")

    def _ask(self, model: str, **asked: Any) -> None:
        self._state.asked = replace(self._state.asked, **asked)
        self._start(model)


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
        self._found: dict[str, ModelResult] | None = None

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

    def _known(self) -> dict[str, ModelResult]:
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

    def _show_tables(self, every: list[ModelResult]) -> None:
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

    def _show_details(self, every: list[ModelResult]) -> None:
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
