"""Hysteresis: identify a drive from its record, and make it follow a motion."""

from dataclasses import replace
from typing import Any

from nicegui import ui

from flexstage.base.errors import FlexstageError
from flexstage.files.request import request_fields
from flexstage.hysteresis import MODELS
from flexstage.hysteresis.requests import IdentifyRequest
from flexstage.web.hysteresis.compensation_panel import CompensationPanel
from flexstage.web.hysteresis.example import example_record
from flexstage.web.hysteresis.files_form import FilesForm, show_contents
from flexstage.web.hysteresis.model_panel import ModelPanel
from flexstage.web.hysteresis.prediction_panel import PredictionPanel
from flexstage.web.hysteresis.state import HysteresisState, OpenModel
from flexstage.web.hysteresis.work import Identified, identified
from flexstage.web.page import Page, PanelHeading, Task, div, in_page_words, panel

_STEPS = {
    "record": ("1 Record", "description"),
    "model": ("2 Model", "show_chart"),
    "compensate": ("3 Compensate", "tune"),
    "predict": ("4 Predict", "fact_check"),
}
_PURPOSES = (
    "Drop what was measured of a drive: its command, usually a voltage, and the position that "
    "followed, over time. Text, CSV, MATLAB, HDF5, NumPy, LabVIEW and universal files are "
    "read, TDMS with the extra labview. Without a record of your own take the example, a simulated "
    "piezo stack.",
    "Identify finds hysteresis, creep, delay and resonance in it by four models, or by those that "
    "you choose of nine, and says how far each can be trusted: by its error on cycles that it was "
    "not fitted to.",
    "The inverse of the model makes the command that lets the drive follow a sine, a triangle or a "
    "path of your own: a file for the controller, with what it leaves.",
    "A model proves itself on a record that it was not identified from, at another rate or on "
    "another day.",
)
_ENTRY = "outlined dense stack-label debounce=300"
#: What may be known of a drive, and how it is written.
_KNOWN = {
    "resonance": "808 Hz",
    "damping": "1 %",
    "delay": "5 ms",
    "creep": "1.2 %",
}


def build(page: Page) -> None:
    """Make the view."""
    HysteresisView(page).build()


class HysteresisView:
    """The view in one page.

    Parameters
    ----------
    page
        The page.
    """

    def __init__(self, page: Page) -> None:
        self._page = page
        self._state = page.session.state(HysteresisState)
        self._model = ModelPanel(page, self._state, self._another_model)
        self._compensation = CompensationPanel(page, self._state)
        self._prediction = PredictionPanel(page, self._state)
        self._wrong: set[str] = set()  # fields whose text is no value

    def build(self) -> None:
        """Make the view."""
        with (
            ui.tabs(on_change=self._stepped)
            .classes("steps")
            .props("inline-label no-caps dense align=left") as self._steps
        ):
            for name, (label, icon) in _STEPS.items():
                ui.tab(name, label, icon=icon)
        with ui.tab_panels(self._steps, value=self._state.step, animated=False).classes("step"):
            with ui.tab_panel("record"):
                self._record()
            with ui.tab_panel("model"):
                self._model.build()
            with ui.tab_panel("compensate"):
                self._compensation.build()
            with ui.tab_panel("predict"):
                self._prediction.build()

    def _stepped(self, event: Any) -> None:
        self._state.step = event.value

    def _record(self) -> None:
        state = self._state
        with div("columns asked"):
            with panel():
                form = FilesForm(
                    self._page,
                    state.source,
                    state.jobs,
                    key="record",
                    label="Record of a drive: drop it here",
                    example=example_record,
                    changed=self._looked,
                )
                form.build()
                with ui.column().classes("full-width told") as self._asked:
                    self._search()
                self._missing = ui.label().classes("issue")
                self._go = ui.button("Identify", icon="play_arrow", on_click=self._identify)
                working = ui.column().classes("full-width")
            with panel() as self._shown:
                self._contents = ui.column().classes("full-width told")
        self._task = Task(
            self._page, state.jobs, "model", working, self._take, elsewhere=self._taken
        )
        self._looked()
        form.begin()

    def _search(self) -> None:
        search = self._state.search
        kinds = {kind: model.title for kind, model in MODELS.items()}
        chosen = [kind for kind in search.model if kind != "auto"]
        ui.select(
            kinds, label="Hysteresis model (four are tried where none is chosen)",
            value=chosen, multiple=True, clearable=True,
        ).props("outlined dense options-dense stack-label use-chips").classes("full-width"
        ).on_value_change(
            lambda event: self._set("model", tuple(event.value or ()) or ("auto",))
        )  # fmt: skip
        known = replace(search, model=("auto",)) != IdentifyRequest()
        with ui.expansion("What is known of the drive", value=known).classes("folded"):
            with div("entries"):
                self._field("train", "400:5000")
                for name, example in _KNOWN.items():
                    self._field(name, example)
            ui.checkbox(
                "Drift: fit one of constant speed beside the model", value=search.drift
            ).on_value_change(lambda event: self._set("drift", bool(event.value)))

    def _field(self, name: str, example: str) -> None:
        part = self._state.search.known if name in _KNOWN else self._state.search
        field, value = request_fields(type(part))[name], getattr(part, name)
        shown = "" if value in (None, field.default) else ",".join(field.texts(value))
        entry = ui.input(field.label, value=shown, placeholder=example).props(_ENTRY)

        def take(event: Any) -> None:
            text = (event.value or "").strip()
            try:
                self._set(name, field.read(text) if text else field.default)
            except FlexstageError as error:
                entry.error = in_page_words(str(error))
                self._wrong.add(name)
            else:
                entry.error = None
                self._wrong.discard(name)
            self._looked()

        entry.on_value_change(take)

    def _set(self, name: str, value: Any) -> None:
        search = self._state.search
        if name in _KNOWN:
            name, value = "known", replace(search.known, **{name: value})
        self._state.search = replace(search, **{name: value})

    def _looked(self) -> None:
        """Follow a change of the record: what was read, and what is missing."""
        source = self._state.source
        missing = source.missing()
        shown = "" if missing == source.wrong else missing
        self._missing.text = in_page_words(shown)
        self._missing.visible = bool(shown)
        self._asked.visible = bool(source.reading.files)
        self._go.set_enabled(not missing and not self._wrong)
        self._shown.visible = source.looked is not None or not source.reading.files
        self._contents.clear()
        with self._contents:
            if source.looked is not None:
                show_contents(source.looked)
            elif not source.reading.files:
                _explain()

    def _identify(self) -> None:
        state = self._state
        asked = (state.source.reading, state.search)
        name = f"identifying {', '.join(asked[0].names)}"
        state.asking = asked
        self._task.start(name, identified, *asked, "loop")

    def _take(self, made: Identified) -> None:
        state = self._state
        state.asked, state.tried = state.asking, {made.found.kind: made}
        name = "" if state.asked is None else ", ".join(state.asked[0].names)
        state.take(OpenModel(name, made.file, made.text, made))
        self._another_model()
        self._steps.set_value("model")

    def _taken(self) -> None:
        self._another_model()
        self._steps.set_value(self._state.step)

    def _another_model(self) -> None:
        self._model.show()
        self._compensation.show()
        self._prediction.show()


def _explain() -> None:
    """Say what the view is for, where nothing is open."""
    with div("explained"):
        for (label, icon), text in zip(_STEPS.values(), _PURPOSES, strict=True):
            with div("panel"):
                with ui.row().classes("items-center"):
                    ui.icon(icon).props("aria-hidden=true")
                    PanelHeading(label)
                ui.label(text)
