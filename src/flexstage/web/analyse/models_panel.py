"""Which models are run and what is asked of them, and how far each has come."""

from dataclasses import replace
from pathlib import Path
from typing import Any

from nicegui import ui

from flexstage.files.names import file_name
from flexstage.quantities.comparison import MODEL_WORDS, title_of
from flexstage.quantities.quantity import QUANTITIES, number
from flexstage.studies.models import fitting_options
from flexstage.studies.requests import ModelOptions
from flexstage.web.analyse.state import AnalyseState
from flexstage.web.analyse.work import analysed
from flexstage.web.design.state import DesignState, Variant
from flexstage.web.page import Page, PanelHeading, div, show_job
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
        with self._page.sentences():
            for error in self._own.wrong.values():
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
                f"{variant.name}, {title_of(model)}", analysed, variant, model, options, fields,
                owner=self._page.session.id,
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
