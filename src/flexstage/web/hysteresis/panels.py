"""Panels that use the open model: compensation of a motion, and validation on a record."""

import math
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

from nicegui import ui

from flexstage.hysteresis import MODELS
from flexstage.hysteresis.drive_model import DriveModel
from flexstage.hysteresis.requests import CompensateRequest
from flexstage.quantities.units import readable
from flexstage.report.identification import (
    band_in_words,
    command_in_words,
    prediction_in_words,
    predictions_table,
)
from flexstage.web.figures import figure, in_page, picture, save, sentence, show_lines, show_table
from flexstage.web.hysteresis.files_form import FilesForm, show_contents
from flexstage.web.hysteresis.state import HysteresisState
from flexstage.web.hysteresis.work import (
    CompensationResult,
    PredictionSet,
    compensate_motion,
    default_motion,
    predict_files,
    validation_example,
    waveform,
)
from flexstage.web.page import Page, Task, display_text, div, panel, remark
from flexstage.web.request_form import RequestForm

_SHAPES = {"sine": "Sine", "triangle": "Triangle", "file": "From a file"}
_AFTER = {
    "conditioned": "conditioned: cycles over the full range, ending at the low end",
    "rest": "rest: unused",
    "moved": "conditioned, then in the desired motion for",
}
_FILES = {"csv": ".csv", "npz": ".npz", "hdf5": ".h5", "mat": ".mat"}
_NUMBER = "outlined dense stack-label debounce=700"
#: Default duration of an earlier motion of the drive [s].
_DEFAULT_MOVED_FOR = 30.0


class CompensationPanel:
    """The desired motion, and the command for it.

    Parameters
    ----------
    page
        The page.
    state
        State of the view.
    """

    def __init__(self, page: Page, state: HysteresisState) -> None:
        self._page, self._state = page, state
        self._request = RequestForm(page, lambda: state.motion.request, self._ask)
        self._is_outdated = False

    def build(self) -> None:
        """Build the panel."""
        with div("columns with-form"):
            with panel():
                self._no_model = ui.label(
                    "No model yet: identify one from a record, or open a model file."
                ).classes("issue")
                self._form = ui.column().classes("full-width stretched")
            with panel() as self._results:
                self._working = ui.column().classes("full-width")
                self._error = ui.label().classes("issue error").props('role="alert"')
                self._display = ui.column().classes("full-width stretched")
        self._error.visible = False
        self._task = Task(
            self._page, self._state.jobs, "command", self._working, self._take, self._failed,
            self._taken_elsewhere,
        )  # fmt: skip
        self.show()

    def show(self) -> None:
        """Show the fields for the open model, and the command."""
        model = self._state.model
        self._no_model.visible = model is None
        self._form.clear()
        if model is not None:
            drive = model.file.model
            self._state.motion = default_motion(self._state.motion, drive, model.sample_rate_hz)
            with self._form:
                title = MODELS[drive.hysteresis.kind].title
                remark(f"Inverse of {title}, {model.name}.")
                self._fields(drive)
        self._show_error("")
        self._show_command()
        if self._state.compensation is None:
            self.compute()

    # desired motion

    def _fields(self, drive: DriveModel) -> None:
        motion, request = self._state.motion, self._state.motion.request
        unit, factor = self._unit(drive)
        ui.toggle(_SHAPES, value=motion.shape).props("no-caps").on_value_change(
            lambda event: self._reshape(event.value)
        ).props["aria-label"] = "Shape"
        if motion.shape == "file":
            self._file()
        else:
            if drive.validity is not None:
                low, high = drive.validity.output_range
                range_text = display_text(readable(drive.output_unit, low, high, digits=4))
                remark(f"Range of the model: {range_text}.")
            with div("entries"):
                self._number("centre", f"Centre{unit}", factor)
                self._number("amplitude", f"Amplitude ±{unit}", factor)
                self._number("rate_hz", "Frequency [Hz]")
                self._number("sample_rate_hz", "Sample rate [Hz]")
                periods = self._number("periods", "Periods (0: endless repetition)")
                periods.props("min=0 step=1").classes("whole")
        with (
            ui.expansion("Limits and initial state", value=request != CompensateRequest()).classes(
                "folded"
            ),
            div("entries"),
        ):
            self._request.text("voltage", "0:120")
            self._request.text("amplifier", "slew=2000 V/s")
            self._request.number("reference_bandwidth")
            _after_fields(self._state, _AFTER, request.after, partial(self._ask, "after"))

    def _file(self) -> None:
        form = FilesForm(
            self._page,
            self._state.reference,
            self._state.jobs,
            key="reference",
            label="Record of the desired motion",
            example=None,
            changed=self.compute,
            reference=True,
        )
        form.build()
        self._missing = ui.label().classes("issue")
        self._missing.visible = False
        form.begin()
        self._request.tick("relative", "relative to the lowest reading of the drive")

    def _unit(self, drive: DriveModel) -> tuple[str, float]:
        if drive.output_unit == "m":
            unit, factor = self._page.preferences.length_unit()
        elif drive.output_unit == "rad":
            unit, factor = self._page.preferences.angle_unit()
        else:
            unit, factor = drive.output_unit, 1.0
        return (f" [{unit}]" if unit else ""), factor

    def _number(self, name: str, label: str, factor: float = 1.0) -> ui.number:
        value = getattr(self._state.motion, name)
        displayed = None if value is None else float(f"{value * factor:.6g}")
        field = ui.number(label, value=displayed, format="%.6g").props(_NUMBER)

        def changed(event: Any) -> None:
            number = event.value
            if number is not None and rounded(number) == rounded(getattr(self._state.motion, name)):
                return
            self._set(name, None if number is None else number / factor)

        def rounded(number: float | None) -> str:
            return "" if number is None else f"{number:.6g}"

        field.on_value_change(changed)
        return field

    def _ask(self, name: str, value: Any) -> None:
        self._set("request", replace(self._state.motion.request, **{name: value}))

    def _set(self, name: str, value: Any) -> None:
        if name == "periods":
            value = max(0, int(value or 0))
        motion = replace(self._state.motion, **{name: value})
        if motion != self._state.motion:
            self._state.motion = motion
            self.compute()

    def _reshape(self, shape: Any) -> None:
        others = "file" in (shape, self._state.motion.shape)
        self._state.motion = replace(self._state.motion, shape=shape)
        if shape == "file":
            self._state.compensation = None
        if others:  # else a number that was typed just before would be lost with its field
            self.show()
        self.compute()

    # command

    def compute(self) -> None:
        """Compute the command for the desired motion, after a running computation."""
        state = self._state
        self._is_outdated = self._task.running  # cancelling would kill a warm worker process
        self._task.attach()  # another page of this browser can have started it
        if state.model is None or self._is_outdated:
            return
        motion = state.motion
        if motion.shape == "file":
            missing = state.reference.missing(reference=True)
            self._missing.text = "" if missing == state.reference.error else missing
            self._missing.visible = bool(self._missing.text)
            if missing:
                return
            motion = replace(motion, file=state.reference.selection)
        before = state.files_before().get(str(motion.request.after), motion.before)
        motion = replace(motion, before=before)
        self._show_error("")
        self._task.start(
            "computing the command", compensate_motion, state.model.file, motion, "command"
        )
        self._results.visible = True
        self._display.classes(add="stale")

    def _take(self, compensation: CompensationResult) -> None:
        if self._is_outdated:
            self.compute()
            return
        self._state.compensation = compensation
        self._show_error("")
        self._show_command()

    def _taken_elsewhere(self) -> None:
        if self._is_outdated:
            self.compute()
        else:
            self._show_error("")
            self._show_command()

    def _failed(self, message: str) -> None:
        if self._is_outdated:
            self.compute()
        else:
            self._show_error(message)

    def _show_error(self, message: str) -> None:
        self._error.text = display_text(sentence(message))
        self._error.visible = bool(message)
        if message:
            self._results.visible = True
            self._display.classes(add="stale")
        else:
            self._display.classes(remove="stale")

    def _show_command(self) -> None:
        self._display.clear()
        compensation, model = self._state.compensation, self._state.model
        self._results.visible = compensation is not None or self._task.running
        if compensation is None or model is None:
            return
        drive, command = model.file.model, compensation.feedforward
        band = model.file.errors.get("heldout_95")
        with self._display:
            with div("row-of-figures"):
                command_range = float(command.command.min()), float(command.command.max())
                figure("Command", readable(drive.input_unit, *command_range, digits=4))
                figure(
                    "Predicted error",
                    f"{readable(drive.output_unit, command.rms_error)} rms",
                    "model error excluded",
                )
                linear_error = readable(drive.output_unit, compensation.plain_rms)
                figure("Uncorrected, linear command", f"{linear_error} rms")
                if band is not None and drive.validity is not None:
                    low, high = drive.validity.output_range
                    band_text = readable(drive.output_unit, 0.01 * band * (high - low))
                    figure("Expected on the drive, 95 %", f"+-{band_text}", "from held-out errors")
                self._downloads()
            picture(compensation.svg)
            show_lines([sentence(note) for note in compensation.notes], "issue")
            with ui.expansion("Details").classes("folded"):
                show_lines([sentence(line) for line in command_in_words(command, drive)], "small")
                show_lines([sentence(note) for note in model.file.notes], "muted small")

    def _downloads(self) -> None:
        with ui.row().classes("items-center no-wrap downloads"):
            format = ui.select(_FILES, value="csv", label="Format").props(
                "outlined dense options-dense"
            )

            def download() -> None:
                compensation, model = self._state.compensation, self._state.model
                if compensation is not None and model is not None and format.value:
                    with self._page.show_errors():
                        name = f"{Path(model.name).stem}-{compensation.motion.shape}"
                        content = waveform(compensation.feedforward, model.file.model, format.value)
                        save(self._page, f"{name}{_FILES[format.value]}", content)

            ui.button("Download the waveform", icon="download", on_click=download)


_PREDICTION_AFTER = {
    "auto": "auto: estimated from the first samples",
    "rest": "rest at the first command",
    "moved": "motion from the low end of its range for",
}


def _after_fields(
    state: HysteresisState,
    words: dict[str, str],
    after: float | str,
    assign: Callable[[float | str], object],
) -> None:
    """Show the states before a motion: words, a time, or the ends of records."""
    options = words | {file: f"the end of {Path(file).name}" for file in state.files_before()}
    if isinstance(after, str) and after not in options:  # a record that was removed
        after = next(iter(words))
        assign(after)
    word, time = (after, _DEFAULT_MOVED_FOR) if isinstance(after, str) else ("moved", after)
    field = ui.select(options, value=word, label="After")
    field.props("outlined dense options-dense stack-label").classes("whole")
    moved = ui.number("Moved for [s] (empty: infinite)", value=None if time == math.inf else time)
    moved.props(_NUMBER).bind_visibility_from(field, "value", value="moved")

    def changed() -> None:
        moved_for = math.inf if moved.value is None else max(0.0, moved.value)
        assign(moved_for if field.value == "moved" else field.value)

    field.on_value_change(changed)
    moved.on_value_change(changed)


class PredictionPanel:
    """Validation of the open model on an independent record.

    Parameters
    ----------
    page
        The page.
    state
        State of the view.
    """

    def __init__(self, page: Page, state: HysteresisState) -> None:
        self._page, self._state = page, state

    def build(self) -> None:
        """Build the panel."""
        state = self._state
        with div("columns with-form"):
            with panel():
                form = FilesForm(
                    self._page,
                    state.validation,
                    state.jobs,
                    key="other",
                    label="Independent record of the drive: drop it here",
                    example=validation_example,
                    changed=self._record_changed,
                    template=lambda: state.source.selection,
                )
                form.build()
                with div("entries"):
                    _after_fields(
                        state, _PREDICTION_AFTER, state.after, partial(setattr, state, "after")
                    )
                self._missing = ui.label().classes("issue")
                self._go = ui.button("Validate", icon="play_arrow", on_click=self._start)
                self._working = ui.column().classes("full-width")
            with panel() as self._results:
                self._display = ui.column().classes("full-width stretched")
        self._task = Task(
            self._page, state.jobs, "prediction", self._working, self._take, elsewhere=self.show
        )
        self.show()
        form.begin()

    def show(self) -> None:
        """Show the prediction; before it, the preview of the record."""
        self._show_missing()
        self._display.clear()
        prediction, model, preview = (
            self._state.prediction,
            self._state.model,
            self._state.validation.preview,
        )
        self._results.visible = prediction is not None or preview is not None
        if prediction is None or model is None:
            with self._display:
                if preview is not None:
                    show_contents(preview)
            return
        first, drive = prediction.predictions[0], model.file.model
        with self._display:
            with div("row-of-figures"):
                figure("Prediction error", f"{first.as_predicted_rms_percent:.3f} % rms")
                figure("With a free offset", f"{first.free_constant_rms_percent:.3f} % rms")
                figure("Largest error", f"{first.largest_percent:.2f} %")
            picture(prediction.svg)
            show_table(in_page(predictions_table(prediction.predictions)))
            band = model.file.errors.get("heldout_95")
            lines = [line for p in prediction.predictions for line in prediction_in_words(p, drive)]
            lines += [] if band is None else [band_in_words(prediction.predictions, band)]
            show_lines([sentence(line) for line in lines], "small")
            show_lines(
                [sentence(note) for p in prediction.predictions for note in p.notes], "issue"
            )

    def _record_changed(self) -> None:
        self._state.prediction = None
        self.show()

    def _show_missing(self) -> None:
        missing = (
            "No model yet: identify one from a record, or open a model file."
            if self._state.model is None
            else self._state.validation.missing()
        )
        text = missing if missing != self._state.validation.error else ""
        self._missing.text = display_text(text)
        self._missing.visible = bool(text)
        self._go.set_enabled(not missing)

    def _start(self) -> None:
        state = self._state
        if state.model is not None:
            after = state.files_before().get(str(state.after), state.after)
            selection = state.validation.selection
            self._task.start(
                f"predicting {', '.join(selection.names)}", predict_files,
                state.model.file, selection, after, "prediction",
            )  # fmt: skip

    def _take(self, prediction: PredictionSet) -> None:
        self._state.prediction = prediction
        self.show()
