"""Hysteresis: identify a drive from its record, and make it follow a motion."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

from nicegui import ui

from flexstage.base.errors import FlexstageError
from flexstage.files.request import request_fields
from flexstage.hysteresis import MODELS
from flexstage.hysteresis.requests import IdentifyRequest
from flexstage.quantities.units import readable
from flexstage.report.identification import (
    candidates_table,
    failures,
    identification_in_words,
    parameters_table,
    verdict_in_words,
)
from flexstage.web.figures import figure, in_page, picture, save, sentence, show_lines, show_table
from flexstage.web.hysteresis.files_form import FilesForm, show_contents
from flexstage.web.hysteresis.panels import CompensationPanel, PredictionPanel
from flexstage.web.hysteresis.state import HysteresisState, OpenModel
from flexstage.web.hysteresis.work import IdentifiedModel, example_record, identified, opened
from flexstage.web.page import Page, PanelHeading, Task, display_text, div, panel
from flexstage.web.uploads import upload


class ModelPanel:
    """The model that is open.

    Parameters
    ----------
    page
        The page.
    state
        What is open.
    changed
        Called when another model is shown.
    """

    def __init__(self, page: Page, state: HysteresisState, changed: Callable[[], object]) -> None:
        self._page, self._state, self._changed = page, state, changed

    def build(self) -> None:
        """Make the panel."""
        with div("columns result"):
            with panel():
                self._working = ui.column().classes("full-width")
                self._told = ui.column().classes("full-width told")
                upload(
                    self._page, "Open a model file", (".yaml", ".yml"), self._open,
                    view="hysteresis",
                ).classes("slim")  # fmt: skip
            self._drawn = panel()
        self._task = Task(
            self._page, self._state.jobs, "another", self._working, self._take_another,
            elsewhere=self._changed,
        )  # fmt: skip
        self.show()

    def show(self) -> None:
        """Show the model that is open."""
        self._told.clear()
        self._drawn.clear()
        model = self._state.model
        with self._told:
            if model is None:
                ui.label(
                    "There is no model yet: identify one from a record, or open its file."
                ).classes("issue")
            elif model.identified is None:
                self._tell_file(model)
            else:
                self._tell(model, model.identified)
        self._drawn.visible = model is not None
        with self._drawn:
            if model is not None and model.identified is not None:
                picture(model.identified.svg)
                self._more(model.identified)
            elif model is not None:
                self._warn(model)

    def _tell(self, model: OpenModel, made: IdentifiedModel) -> None:
        found = made.found
        PanelHeading(f"{MODELS[found.kind].title}: {model.name}")
        ui.label(display_text(sentence(verdict_in_words(found)))).classes(
            "issue good" if found.verdict.fits else "issue error"
        )
        unit, stroke = found.model.output_unit, found.stroke
        with div("row-of-figures"):
            if (held := found.heldout_rms_percent) is not None:
                known = readable(unit, 0.01 * held * stroke)
                figure("Held out, as the file predicts", f"{held:.3f} % rms", known)
            if (band := found.heldout_band_percent) is not None:
                known = readable(unit, 0.01 * band * stroke)
                figure("95 % of held-out errors within", f"+-{band:.2f} %", f"+-{known}")
            figure("Stroke", readable(unit or "output", stroke, digits=4))
            figure("Noise", f"{found.noise_percent:.2f} %")
        self._choice()
        ui.button("Download the model", icon="download", on_click=self._download)
        if found.warnings:
            PanelHeading("What the record cannot tell", 3).classes("small-heading")
            show_lines([sentence(w) for w in found.warnings], "issue")

    def _choice(self) -> None:
        first = next(iter(self._state.tried.values())).found
        kinds = {c.kind: MODELS[c.kind].title for c in first.candidates if not c.failed}
        if len(kinds) > 1 and self._state.model is not None:
            shown = self._state.model.file.model.hysteresis.kind
            ui.select(kinds, label="Shown and used", value=shown).props(
                "outlined dense options-dense"
            ).on_value_change(lambda event: self._show_kind(event.value))

    def _more(self, made: IdentifiedModel) -> None:
        found, first = made.found, next(iter(self._state.tried.values())).found
        show_table(in_page(candidates_table(first)))
        show_lines(failures(first), "issue")
        with ui.expansion("Parameters, and how it was fitted").classes("folded"):
            show_lines(identification_in_words(found), "small")
            show_table(in_page(parameters_table(found)))
            show_lines(made.notes, "muted small")

    def _tell_file(self, model: OpenModel) -> None:
        drive, errors = model.file.model, model.file.errors
        PanelHeading(f"{MODELS[drive.hysteresis.kind].title}: {model.name}")
        with div("row-of-figures"):
            if (held := errors.get("heldout_rms")) is not None:
                figure("Held out, as the file predicts", f"{held:.3f} % rms")
            if (band := errors.get("heldout_95")) is not None:
                figure("95 % of held-out errors within", f"+-{band:.2f} %")
            if drive.validity is not None:
                figure("Input", readable(drive.input_unit, *drive.validity.input_range))
                figure("Output", readable(drive.output_unit, *drive.validity.output_range))
        ui.button("Download the model", icon="download", on_click=self._download)

    def _warn(self, model: OpenModel) -> None:
        PanelHeading("What its record could not tell", 3).classes("small-heading")
        said = [sentence(warning) for warning in model.file.warnings]
        show_lines(said or ["Its file says nothing of the kind."], "issue")

    # what a person does

    def _show_kind(self, kind: str) -> None:
        state = self._state
        if state.model is None or kind == state.model.file.model.hysteresis.kind:
            return
        if kind in state.tried:
            self._use(state.tried[kind])
        elif state.asked is not None:
            reading, search = state.asked
            name = f"identifying {MODELS[kind].title}"
            only = replace(search, model=(kind,))
            self._task.start(name, identified, reading, only, f"{kind}-loop")

    def _take_another(self, made: IdentifiedModel) -> None:
        self._state.tried[made.found.kind] = made
        self._use(made)

    def _use(self, made: IdentifiedModel) -> None:
        name = "" if self._state.asked is None else ", ".join(self._state.asked[0].names)
        self._state.take(OpenModel(name, made.file, made.text, made))
        self._changed()

    def _open(self, path: Path) -> None:
        file, text = opened(path)
        self._state.tried, self._state.asked = {}, None
        self._state.take(OpenModel(path.name, file, text))
        self._changed()

    def _download(self) -> None:
        model = self._state.model
        if model is not None:
            save(self._page, f"{Path(model.name).stem}-model.yaml", model.text.encode())


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
                entry.error = display_text(str(error))
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
        self._missing.text = display_text(shown)
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

    def _take(self, made: IdentifiedModel) -> None:
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
