"""Hysteresis: identify a drive from its record, and compensate its hysteresis."""

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
    interval_in_words,
    parameters_table,
    quality_in_words,
)
from flexstage.web.figures import figure, in_page, picture, save, sentence, show_lines, show_table
from flexstage.web.hysteresis.files_form import FilesForm, show_contents
from flexstage.web.hysteresis.panels import CompensationPanel, PredictionPanel
from flexstage.web.hysteresis.state import HysteresisState, OpenModel
from flexstage.web.hysteresis.work import (
    IdentifiedModel,
    example_record,
    identify_drive,
    open_model_file,
)
from flexstage.web.page import Page, PanelHeading, Task, display_text, div, panel
from flexstage.web.uploads import upload


class ModelPanel:
    """The open model.

    Parameters
    ----------
    page
        The page.
    state
        State of the view.
    changed
        Called after another model was opened.
    """

    def __init__(self, page: Page, state: HysteresisState, changed: Callable[[], object]) -> None:
        self._page, self._state, self._changed = page, state, changed

    def build(self) -> None:
        """Build the panel."""
        with div("columns result"):
            with panel():
                self._working = ui.column().classes("full-width")
                self._summary = ui.column().classes("full-width stretched")
                upload(
                    self._page, "Open a model file", (".yaml", ".yml"), self._open,
                    view="hysteresis",
                ).classes("slim")  # fmt: skip
            self._plots = panel()
        self._task = Task(
            self._page, self._state.jobs, "another", self._working, self._take_another,
            elsewhere=self._changed,
        )  # fmt: skip
        self.show()

    def show(self) -> None:
        """Show the open model."""
        self._summary.clear()
        self._plots.clear()
        model = self._state.model
        with self._summary:
            if model is None:
                ui.label("No model yet: identify one from a record, or open a model file.").classes(
                    "issue"
                )
            elif model.identified is None:
                self._show_file_model(model)
            else:
                self._show_identified(model, model.identified)
        self._plots.visible = model is not None
        with self._plots:
            if model is not None and model.identified is not None:
                picture(model.identified.svg)
                self._show_details(model.identified)
            elif model is not None:
                self._show_warnings(model)

    def _show_identified(self, model: OpenModel, model_result: IdentifiedModel) -> None:
        identification = model_result.identification
        PanelHeading(f"{MODELS[identification.kind].title}: {model.name}")
        ui.label(display_text(sentence(quality_in_words(identification)))).classes(
            "issue good" if identification.quality.fits else "issue error"
        )
        unit, stroke = identification.model.output_unit, identification.stroke
        with div("row-of-figures"):
            if (heldout_rms := identification.heldout_rms_percent) is not None:
                length = readable(unit, 0.01 * heldout_rms * stroke)
                note = f"{length}; {interval_in_words(identification)}"
                figure("Held-out error", f"{heldout_rms:.3f} % rms", note)
            if (band := identification.heldout_band_percent) is not None:
                length = readable(unit, 0.01 * band * stroke)
                figure("Held-out errors, 95 % within", f"+-{band:.2f} %", f"+-{length}")
            figure("Stroke", readable(unit or "output", stroke, digits=4))
            figure("Noise", f"{identification.noise_percent:.2f} %")
        self._model_choice()
        ui.button("Download the model", icon="download", on_click=self._download)
        if identification.warnings:
            PanelHeading("Limits of the record", 3).classes("small-heading")
            show_lines([sentence(w) for w in identification.warnings], "issue")

    def _model_choice(self) -> None:
        best = next(iter(self._state.candidates.values())).identification
        kinds = {c.kind: MODELS[c.kind].title for c in best.candidates if not c.failed}
        if len(kinds) > 1 and self._state.model is not None:
            selected_kind = self._state.model.file.model.hysteresis.kind
            ui.select(kinds, label="Selected model", value=selected_kind).props(
                "outlined dense options-dense"
            ).on_value_change(lambda event: self._show_kind(event.value))

    def _show_details(self, model_result: IdentifiedModel) -> None:
        identification, best = (
            model_result.identification,
            next(iter(self._state.candidates.values())).identification,
        )
        show_table(in_page(candidates_table(best)))
        show_lines(failures(best), "issue")
        with ui.expansion("Parameters and fit").classes("folded"):
            show_lines(identification_in_words(identification), "small")
            show_table(in_page(parameters_table(identification)))
            show_lines(model_result.notes, "muted small")

    def _show_file_model(self, model: OpenModel) -> None:
        drive, errors = model.file.model, model.file.errors
        PanelHeading(f"{MODELS[drive.hysteresis.kind].title}: {model.name}")
        with div("row-of-figures"):
            if (heldout_rms := errors.get("heldout_rms")) is not None:
                figure("Held-out error", f"{heldout_rms:.3f} % rms")
            if (band := errors.get("heldout_95")) is not None:
                figure("Held-out errors, 95 % within", f"+-{band:.2f} %")
            if drive.validity is not None:
                figure("Input", readable(drive.input_unit, *drive.validity.input_range))
                figure("Output", readable(drive.output_unit, *drive.validity.output_range))
        ui.button("Download the model", icon="download", on_click=self._download)

    def _show_warnings(self, model: OpenModel) -> None:
        PanelHeading("Limits of its record", 3).classes("small-heading")
        warnings = [sentence(warning) for warning in model.file.warnings]
        show_lines(warnings or ["The model file lists none."], "issue")

    # input

    def _show_kind(self, kind: str) -> None:
        state = self._state
        if state.model is None or kind == state.model.file.model.hysteresis.kind:
            return
        if kind in state.candidates:
            self._use(state.candidates[kind])
        elif state.identified_from is not None:
            selection, options = state.identified_from
            name = f"identifying {MODELS[kind].title}"
            request = replace(options, model=(kind,))
            self._task.start(name, identify_drive, selection, request, f"{kind}-loop")

    def _take_another(self, model_result: IdentifiedModel) -> None:
        self._state.candidates[model_result.identification.kind] = model_result
        self._use(model_result)

    def _use(self, model_result: IdentifiedModel) -> None:
        name = (
            ""
            if self._state.identified_from is None
            else ", ".join(self._state.identified_from[0].names)
        )
        self._state.open_model(OpenModel(name, model_result.file, model_result.text, model_result))
        self._changed()

    def _open(self, path: Path) -> None:
        file, text = open_model_file(path)
        self._state.candidates, self._state.identified_from = {}, None
        self._state.open_model(OpenModel(path.name, file, text))
        self._changed()

    def _download(self) -> None:
        model = self._state.model
        if model is not None:
            save(self._page, f"{Path(model.name).stem}-model.yaml", model.text.encode())


_STEPS = {
    "record": ("1 Record", "description"),
    "model": ("2 Model", "show_chart"),
    "compensate": ("3 Compensate", "tune"),
    "predict": ("4 Validate", "fact_check"),
}
_PURPOSES = (
    "Drop a record of a drive: its command, usually a voltage, and the measured position, over "
    "time. Accepted formats are text, CSV, MATLAB, HDF5, NumPy, LabVIEW and universal files, and "
    "TDMS with the extra labview. Without a record, load the example of a simulated piezo stack.",
    "Identify hysteresis, creep, delay and resonance. Five models are fitted, or those that you "
    "choose of ten. The error on held-out cycles shows the accuracy of each.",
    "The inverse of the model computes the command for a sine, a triangle or a path from a file. "
    "The result is a file for the controller, with the predicted error.",
    "Validate the model on an independent record, at another rate or on another day.",
)
_ENTRY = "outlined dense stack-label debounce=300"
#: Known properties of a drive, with an example of each.
_KNOWN_FIELDS = {
    "resonance": "808 Hz",
    "damping": "1 %",
    "delay": "5 ms",
    "creep": "1.2 %",
}


def build(page: Page) -> None:
    """Build the view."""
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
        self._model = ModelPanel(page, self._state, self._model_changed)
        self._compensation = CompensationPanel(page, self._state)
        self._prediction = PredictionPanel(page, self._state)
        self._invalid: set[str] = set()  # fields with invalid text

    def build(self) -> None:
        """Build the view."""
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
        with div("columns with-form"):
            with panel():
                form = FilesForm(
                    self._page,
                    state.source,
                    state.jobs,
                    key="record",
                    label="Record of a drive: drop it here",
                    example=example_record,
                    changed=self._update_record,
                )
                form.build()
                with ui.column().classes("full-width stretched") as self._options_area:
                    self._identification_fields()
                self._missing = ui.label().classes("issue")
                self._go = ui.button("Identify", icon="play_arrow", on_click=self._identify)
                working = ui.column().classes("full-width")
            with panel() as self._preview_panel:
                self._contents = ui.column().classes("full-width stretched")
        self._task = Task(
            self._page, state.jobs, "model", working, self._take, elsewhere=self._taken_elsewhere
        )
        self._update_record()
        form.begin()

    def _identification_fields(self) -> None:
        options = self._state.options
        kinds = {kind: model.title for kind, model in MODELS.items()}
        selected = [kind for kind in options.model if kind != "auto"]
        ui.select(
            kinds, label="Hysteresis models (default: five are compared)",
            value=selected, multiple=True, clearable=True,
        ).props("outlined dense options-dense stack-label use-chips").classes("full-width"
        ).on_value_change(
            lambda event: self._set("model", tuple(event.value or ()) or ("auto",))
        )  # fmt: skip
        has_options = replace(options, model=("auto",)) != IdentifyRequest()
        with ui.expansion("Known properties of the drive", value=has_options).classes("folded"):
            with div("entries"):
                self._field("train", "400:5000")
                for name, example in _KNOWN_FIELDS.items():
                    self._field(name, example)
            zero = request_fields(IdentifyRequest)["zero"]
            ui.select(list(zero.words), label=zero.label, value=options.zero).props(
                _ENTRY
            ).on_value_change(lambda event: self._set("zero", event.value))
            periodic = request_fields(IdentifyRequest)["periodic"]
            ui.checkbox(periodic.label, value=options.periodic).on_value_change(
                lambda event: self._set("periodic", event.value)
            )

    def _field(self, name: str, example: str) -> None:
        owner = self._state.options.known if name in _KNOWN_FIELDS else self._state.options
        field, value = request_fields(type(owner))[name], getattr(owner, name)
        content = "" if value in (None, field.default) else ",".join(field.texts(value))
        entry = ui.input(field.label, value=content, placeholder=example).props(_ENTRY)

        def assign(event: Any) -> None:
            text = (event.value or "").strip()
            try:
                self._set(name, field.read(text) if text else field.default)
            except FlexstageError as error:
                entry.error = display_text(str(error))
                self._invalid.add(name)
            else:
                entry.error = None
                self._invalid.discard(name)
            self._update_record()

        entry.on_value_change(assign)

    def _set(self, name: str, value: Any) -> None:
        options = self._state.options
        if name in _KNOWN_FIELDS:
            name, value = "known", replace(options.known, **{name: value})
        self._state.options = replace(options, **{name: value})

    def _update_record(self) -> None:
        """Update after a change of the record: preview and missing input."""
        source = self._state.source
        missing = source.missing()
        text = "" if missing == source.error else missing
        self._missing.text = display_text(text)
        self._missing.visible = bool(text)
        self._options_area.visible = bool(source.selection.files)
        self._go.set_enabled(not missing and not self._invalid)
        self._preview_panel.visible = source.preview is not None or not source.selection.files
        self._contents.clear()
        with self._contents:
            if source.preview is not None:
                show_contents(source.preview)
            elif not source.selection.files:
                _show_purposes()

    def _identify(self) -> None:
        state = self._state
        inputs = (state.source.selection, state.options)
        name = f"identifying {', '.join(inputs[0].names)}"
        state.pending = inputs
        self._task.start(name, identify_drive, *inputs, "loop")

    def _take(self, model_result: IdentifiedModel) -> None:
        state = self._state
        state.identified_from, state.candidates = (
            state.pending,
            {model_result.identification.kind: model_result},
        )
        name = "" if state.identified_from is None else ", ".join(state.identified_from[0].names)
        state.open_model(OpenModel(name, model_result.file, model_result.text, model_result))
        self._model_changed()
        self._steps.set_value("model")

    def _taken_elsewhere(self) -> None:
        self._model_changed()
        self._steps.set_value(self._state.step)

    def _model_changed(self) -> None:
        self._model.show()
        self._compensation.show()
        self._prediction.show()


def _show_purposes() -> None:
    """Show the purpose of each step, while no record is open."""
    with div("explained"):
        for (label, icon), text in zip(_STEPS.values(), _PURPOSES, strict=True):
            with div("panel"):
                with ui.row().classes("items-center"):
                    ui.icon(icon).props("aria-hidden=true")
                    PanelHeading(label)
                ui.label(text)
