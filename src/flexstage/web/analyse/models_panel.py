"""Which models are run and what is asked of them, and how far each has come."""

from dataclasses import replace
from pathlib import Path
from typing import Any

from nicegui import ui

from flexstage.comparison import MODEL_WORDS, title_of
from flexstage.errors import FlexstageError
from flexstage.files.names import file_name
from flexstage.files.request import request_fields
from flexstage.files.schema import field_texts
from flexstage.quantities import QUANTITIES, number
from flexstage.studies.models import fitting_options
from flexstage.studies.requests import ModelOptions
from flexstage.web.analyse.state import AnalyseState
from flexstage.web.analyse.work import analysed
from flexstage.web.design.state import DesignState, Variant
from flexstage.web.page import Page, PanelHeading, div, in_page_words, show_job

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
        self._asked: dict[str, Any] = {}
        # why fields do not have the value that stands in the form
        self._wrong: dict[str, FlexstageError] = {}
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
        known, asked = request_fields(ModelOptions), self._state.asked
        texts = {name: in_page_words(text) for name, text in field_texts(ModelOptions).items()}

        def choice(name: str, words: Any) -> None:
            box = ui.select(words, label=known[name].label, value=getattr(asked, name))
            box.classes("full-width").props("dense").tooltip(texts[name])
            box.on_value_change(lambda event: self._ask(**{name: event.value}))
            self._asked[name] = box

        with div("fields"):
            choice("plane", list(known["plane"].words))
            choice("supports", list(known["supports"].words))
        for name in ("estimate", "stroke"):
            box = ui.checkbox(known[name].label, value=getattr(asked, name)).props("dense")
            box.tooltip(texts[name])
            box.on_value_change(lambda event, name=name: self._ask(**{name: bool(event.value)}))
            self._asked[name] = box
        ui.checkbox("Write fields for ParaView (VTU)").props("dense").bind_value(
            self._state, "fields"
        ).tooltip("models of the whole")
        with div("fields"):
            share = ui.number(f"{known['accuracy'].label} [%]", value=_percent(asked), format="%g")
            share.classes("full-width").props("dense clearable debounce=600")
            share.tooltip(texts["accuracy"])
            share.on_value_change(
                lambda event: self._ask(
                    accuracy=None if event.value is None else event.value / 100.0
                )
            )
            self._share = share
            choice("quantity", {name: QUANTITIES[name].label for name in _REFINED})

    def _ask(self, **asked: Any) -> None:
        (name,) = asked
        self._wrong.pop(name, None)
        with self._page.sentences():
            try:
                self._state.asked = replace(self._state.asked, **asked)
            except FlexstageError as error:
                self._wrong[name] = error
                raise

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
            for error in self._wrong.values():
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
        for name, field in self._asked.items():
            field.value = getattr(self._state.asked, name)
        self._share.value = _percent(self._state.asked)
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
