"""Analyse: run models of the open stage, and compare their results."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

from nicegui import events, ui

from flexstage.base.errors import ModelError
from flexstage.files.names import file_name
from flexstage.files.nodes import read_text
from flexstage.quantities.comparison import MODEL_WORDS, title_of
from flexstage.quantities.quantity import QUANTITIES, number
from flexstage.report.tables import coupling_tables
from flexstage.studies.models import fitting_options
from flexstage.studies.requests import ModelOptions
from flexstage.system.environment import ready_text
from flexstage.web.analyse.bode import Bode
from flexstage.web.analyse.shapes import NOTHING_YET, Shapes
from flexstage.web.analyse.work import (
    AnalyseState,
    ModelResult,
    analyse_variant,
    errors_table,
    figures_tables,
    hinges_table,
    meshes_table,
    modes_table,
    noise_of_variant,
    save_archive,
)
from flexstage.web.design.choice import StageChoice
from flexstage.web.design.state import DesignState, Variant
from flexstage.web.figures import picture, show_lines, show_table
from flexstage.web.jobs import BackgroundJob
from flexstage.web.page import Page, PanelHeading, div, panel, quiet_button, show_job
from flexstage.web.request_form import RequestForm
from flexstage.web.uploads import upload

#: Quantities for a mesh refinement.
_REFINED = ("natural_frequency_hz", "max_stress", "transmission_ratio", "output_stiffness")
_MESHED = ("plane", "solid")


class ModelsPanel:
    """The models of the open stage, their options and progress.

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
        self._builder = RequestForm(page, lambda: self._state.options, self._take)
        self._fields_of: dict[str, Any] = {}
        with ui.row().classes("items-center heading"):
            PanelHeading("Models")
            ui.space()
            ui.button("Analyse", icon="play_arrow", on_click=self._start_selected)
        for model in MODEL_WORDS:
            self._row(model)
        with ui.expansion("Options").classes("options"):
            self._options()

    def _row(self, model: str) -> None:
        with div("model"):
            box = ui.checkbox(title_of(model), value=model in self._state.selected_models).props(
                "dense"
            )
            status = ui.label().classes("small number")
            progress = div("working")
            error_label = ui.label().classes("issue error")
        box.on_value_change(lambda event: self._choose(model, bool(event.value)))
        self._rows[model] = (status, progress, error_label)

    def _options(self) -> None:
        builder = self._builder
        with div("fields"):
            self._fields_of |= {name: builder.choice(name) for name in ("plane", "supports")}
        self._fields_of |= {name: builder.tick(name) for name in ("estimate", "stroke")}
        ui.checkbox("Write fields for ParaView (VTU)").props("dense").bind_value(
            self._state, "fields"
        ).tooltip("models that mesh the whole stage")
        with div("fields"):
            self._accuracy = builder.number("accuracy").props("clearable")
            quantities = {name: QUANTITIES[name].label for name in _REFINED}
            self._fields_of["quantity"] = builder.choice("quantity", quantities)
        for field in (self._accuracy, *self._fields_of.values()):
            field.classes("full-width")

    def _take(self, name: str, value: Any) -> None:
        self._state.options = replace(self._state.options, **{name: value})

    def _choose(self, model: str, is_selected: bool) -> None:
        others = [name for name in self._state.selected_models if name != model]
        self._state.selected_models = [
            m for m in MODEL_WORDS if m in others or (is_selected and m == model)
        ]

    def _start_selected(self) -> None:
        if not self._state.selected_models:
            ui.notify("Choose a model first", type="warning", position="top")
            return
        started = [model for model in self._state.selected_models if self.start(model)]
        if not started:
            ui.notify("These results are available or being computed", position="top")

    def start(self, model: str) -> bool:
        """Start a model of the open stage, unless its result is available or being computed."""
        variant = self._design.now
        key = (variant, model)
        with self._page.show_errors():
            for error in self._builder.errors.values():
                raise error
            options = fitting_options(model, self._state.options)
            fields = self._fields(variant, model) if self._state.fields else None
            # a job that was cancelled just now does not keep the next from being started
            self._state.collect()
            result = self._state.result(variant, model)
            if key in self._state.jobs or (
                result and result.options == options and (fields is None or result.fields == fields)
            ):
                return False
            self._state.errors.pop(key, None)
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
        """Show the state of each model of the open stage."""
        for name, field in self._fields_of.items():
            field.value = getattr(self._state.options, name)
        self._accuracy.value = _percent(self._state.options)
        variant = self._design.now
        for model, (status, progress, error_label) in self._rows.items():
            key = (variant, model)
            job, result = self._state.jobs.get(key), self._state.result(variant, model)
            job_id = job.id if job else ""
            if self._shown_jobs.get(model, "") != job_id:
                self._shown_jobs[model] = job_id
                progress.clear()
                if job is not None:
                    with progress:
                        show_job(self._page, job)
            status.text = f"done in {number(result.seconds, 2)} s" if result else ""
            error_label.text = self._state.errors.get(key, "")
            error_label.visible = bool(error_label.text)


def _percent(options: ModelOptions) -> float | None:
    """Return the accuracy option [%]."""
    return None if options.accuracy is None else float(f"{100.0 * options.accuracy:.12g}")


#: Default accuracy of a mesh refinement [1].
DEFAULT_ACCURACY = 0.005


class Convergence:
    """Mesh convergence and error estimates of the results.

    Parameters
    ----------
    page
        The page.
    start
        Starts a model with the present options.
    """

    def __init__(self, page: Page, start: Callable[[str], bool]) -> None:
        self._page = page
        self._state = page.session.state(AnalyseState)
        self._start = start
        self._place = div("full-width stacked")

    def show(self, results: dict[str, ModelResult]) -> None:
        """Show the refinements and estimates."""
        self._place.clear()
        refined = [result for result in results.values() if result.convergence]
        estimated = [result for result in results.values() if result.options.estimate]
        with self._place:
            for result in refined:
                picture(result.convergence)
                show_table(meshes_table(self._page.preferences, result))
            for result in (*refined, *estimated):
                with ui.expansion(f"Estimated errors, {title_of(result.model)}", value=True):
                    show_table(errors_table(self._page.preferences, result))
            if not refined:
                ui.label(
                    "Refine the mesh of a finite-element model to see the convergence."
                ).classes("muted")
                ui.button(
                    f"Refine {title_of('plane')}",
                    on_click=lambda: self._start_with("plane", accuracy=DEFAULT_ACCURACY),
                ).classes("own-width")
            if not estimated:
                ui.label(
                    "The condensed model estimates its errors by element order and number of modes."
                ).classes("muted")
                quiet_button(
                    "Estimate errors",
                    on_click=lambda: self._start_with("superelement", estimate=True),
                ).props("outline").classes("own-width")

    def _start_with(self, model: str, **options: Any) -> None:
        self._state.options = replace(self._state.options, **options)
        self._start(model)


#: Environment of a stage without an assumed one.
_FLOOR = """environment: 1
name: floor
band: [1 Hz, 5 kHz]
sources:
  floor: {kind: ground, along: x, spectrum: {kind: vc, curve: C, slope_above: -5}}
"""


class NoisePanel:
    """Rms that an environment leaves, by source and loop.

    Parameters
    ----------
    page
        The page.
    """

    def __init__(self, page: Page) -> None:
        self._page = page
        self._state = page.session.state(AnalyseState)
        self._design = page.session.state(DesignState)
        self._variant = self._design.now
        with div("full-width stacked"):
            self._text = ui.textarea("Environment (YAML)", value=self._description())
            self._text.props("rows=10 outlined input-style='font-family: monospace'")
            self._text.classes("full-width").on_value_change(self._write)
            upload(page, "Environment file", (".yaml", ".yml"), self._uploaded, view="analyse")
            with div("fields"):
                loops = ui.input("Loops, such as 50 Hz, tune").props("outlined dense")
                loops.classes("full-width").bind_value(self._state, "loops")
                models = {model: title_of(model) for model in MODEL_WORDS}
                model = ui.select(models, label="Model").props("outlined dense options-dense")
                model.classes("full-width").bind_value(self._state, "noise_model")
            ui.button("Compute noise", icon="play_arrow", on_click=self._start).classes("own-width")
        self._working = ui.element("div")
        self._place = div("full-width stacked")

    def _description(self) -> str:
        """Return the environment of the stage: as written, assumed, or a floor."""
        written = self._state.environments.get(self._variant.name)
        if written is not None:
            return written
        with self._page.show_errors():
            return ready_text(self._variant.stage()) or _FLOOR
        return _FLOOR

    def _write(self, event: events.ValueChangeEventArguments) -> None:
        self._state.environments[self._variant.name] = event.value or ""

    def _uploaded(self, path: Path) -> None:
        self._text.value = read_text(path, "description of an environment", ModelError)

    def _start(self) -> None:
        state, variant = self._state, self._variant
        folder = self._page.panel.folder(f"analyse/{self._page.session.id}")
        job = self._page.panel.jobs.start(
            f"{variant.name}, noise", noise_of_variant, variant,
            self._text.value or "", state.loops, state.noise_model, folder,
            owner=self._page.session.id,
        )  # fmt: skip

        def finish(job: BackgroundJob) -> None:
            if job.state == "done":
                state.noise = {variant: job.result}
                if not self._place.is_deleted:
                    self.show({})

        with self._working:
            show_job(self._page, job, finish)

    def show(self, results: dict[str, ModelResult]) -> None:
        """Show the last result of the stage."""
        del results
        if self._variant != self._design.now:
            self._variant = self._design.now
            self._text.value = self._description()
        self._place.clear()
        result = self._state.noise.get(self._variant)
        if result is None:
            return
        with self._place:
            for rows in result.tables:
                show_table(rows)
            picture(result.picture)
            show_lines(result.notes, "small")


_FAST = "lumped"
#: Parts of the results, and their icons.
_PARTS = {
    "Shapes": "animation",
    "Bode": "ssid_chart",
    "Convergence": "trending_flat",
    "Noise": "graphic_eq",
}


def build(page: Page) -> None:
    """Build the view."""
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
        self._shown_revision: object = None
        self._results: dict[str, ModelResult] | None = None

    def build(self) -> None:
        """Build the view."""
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
                self._build_tabs()
        self._opened()
        ui.timer(0.2, self._look)

    def _build_tabs(self) -> None:
        tabs = ui.tabs().props("dense no-caps align=left inline-label").classes("parts")
        with tabs:
            for name, icon in _PARTS.items():
                ui.tab(name, icon=icon)
        tabs.value = self._state.display.part
        tabs.on_value_change(self._choose_part)
        self._place = div("full-width")
        self._open_part()

    def _choose_part(self, event: events.ValueChangeEventArguments) -> None:
        self._state.display.part = event.value
        self._open_part()

    def _open_part(self) -> None:
        """Build the open tab; charts need a visible place."""
        self._place.clear()
        with self._place:
            self._part = self._build_part(self._state.display.part)
            self._part.show(self._present_results())

    def _build_part(self, part: str) -> Shapes | Bode | Convergence | NoisePanel:
        match part:
            case "Noise":
                return NoisePanel(self._page)
            case "Bode":
                return Bode(self._page)
            case "Convergence":
                return Convergence(self._page, self._models.start)
        return Shapes(self._page)

    def _opened(self) -> None:
        """Follow another stage, and start the fast model."""
        variant = self._design.now
        key = (variant, _FAST)
        if self._state.result(*key) is None and key not in self._state.errors:
            self._models.start(_FAST)
        self._look()

    def _look(self) -> None:
        self._state.collect()
        revision = (self._state.revision, self._design.now, len(self._state.jobs))
        if revision == self._shown_revision:
            return
        self._shown_revision = revision
        self._models.sync()
        self._show()

    def _present_results(self) -> dict[str, ModelResult]:
        results = {model: self._state.result(self._design.now, model) for model in MODEL_WORDS}
        return {model: result for model, result in results.items() if result is not None}

    def _show(self) -> None:
        variant, results = self._design.now, self._present_results()
        self._title.text = f"{variant.name}{' (changed)' if variant.values else ''}"
        self._save.set_enabled(bool(results))
        if results != self._results:
            self._results = results
            self._show_tables(list(results.values()))
            self._part.show(results)

    def _show_tables(self, results: list[ModelResult]) -> None:
        self._tables.clear()
        with self._tables:
            if not results:
                ui.label(NOTHING_YET).classes("muted")
                return
            main, others = figures_tables(self._page.preferences, results)
            if main.rows:
                show_table(main)
            for drives in results[0].analysis.modes:
                with self._fold(f"Natural frequencies, drives {drives}", drives == "removed"):
                    show_table(modes_table(results, drives))
            with self._fold("All other figures"):
                show_table(others)
            self._show_details(results)

    def _show_details(self, results: list[ModelResult]) -> None:
        best = results[-1]  # the most complete model
        if best.analysis.coupling is not None:
            with self._fold(f"All drives together, {title_of(best.model)}"):
                for rows in coupling_tables(best.analysis.coupling):
                    show_table(rows)
        stress = hinges_table(best)
        if stress.rows:
            with self._fold(f"Stress of each hinge, {title_of(best.model)}"):
                show_table(stress)
        with self._fold("Limits of validity"):
            for result in results:
                for text in result.analysis.validity:
                    ui.label(f"{title_of(result.model)}: {text}").classes("small")

    def _fold(self, title: str, is_open: bool = False) -> ui.expansion:
        """Return a foldable section in its last state."""
        folds = self._state.display.folds
        fold = ui.expansion(title, value=folds.get(title, is_open))
        return fold.on_value_change(lambda event: folds.update({title: event.value}))

    def _save_all(self) -> None:
        results = list(self._present_results().values())
        folder = self._page.panel.folder("analyse")
        job = self._page.panel.jobs.start(
            "saving results", save_archive, folder, results, owner=self._page.session.id
        )
        self._save.disable()

        def finish(job: BackgroundJob) -> None:
            self._save.enable()
            if job.state == "done":
                ui.download.file(job.result)

        with self._working:
            show_job(self._page, job, finish)
