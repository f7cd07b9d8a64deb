"""A model on another record in a page."""

import math
from typing import Any

from nicegui import ui

from flexstage.hysteresis.chain.creep import Start
from flexstage.report.identification import (
    band_in_words,
    prediction_in_words,
    predictions_table,
)
from flexstage.web.figures import figure, in_page, picture, sentence, show_lines, show_table
from flexstage.web.hysteresis.example import other_example
from flexstage.web.hysteresis.files_form import FilesForm, show_contents
from flexstage.web.hysteresis.state import HysteresisState
from flexstage.web.hysteresis.work import Predicted, predicted
from flexstage.web.page import Page, Task, div, in_page_words, panel

_STARTS = {
    "auto": "auto: found from the first samples",
    "rested": "rested at the first command",
    "moved": "moved since the low end of its range for",
}


class PredictionPanel:
    """The model that is open on another record.

    Parameters
    ----------
    page
        The page.
    state
        What is open.
    """

    def __init__(self, page: Page, state: HysteresisState) -> None:
        self._page, self._state = page, state

    def build(self) -> None:
        """Make the panel."""
        state = self._state
        with div("columns asked"):
            with panel():
                form = FilesForm(
                    self._page,
                    state.other,
                    state.jobs,
                    key="other",
                    label="Another record of the drive: drop it here",
                    example=other_example,
                    changed=self._other_record,
                    like=lambda: state.source.reading,
                )
                form.build()
                with div("entries"):
                    start = ui.select(_STARTS, value=state.start, label="Start")
                    start.props("outlined dense options-dense stack-label").classes("whole")
                    start.bind_value(state, "start")
                    moved = ui.number("Moved for [s] (inf where empty)", value=state.moved_for)
                    moved.props("outlined dense stack-label")
                    moved.on_value_change(self._set_moved)
                    moved.bind_visibility_from(start, "value", value="moved")
                self._missing = ui.label().classes("issue")
                self._go = ui.button("Predict", icon="play_arrow", on_click=self._start)
                self._working = ui.column().classes("full-width")
            with panel() as self._results:
                self._shown = ui.column().classes("full-width told")
        self._task = Task(
            self._page, state.jobs, "prediction", self._working, self._take, elsewhere=self.show
        )
        self.show()
        form.begin()

    def show(self) -> None:
        """Show what the model predicts, or the record until it does."""
        self._say_missing()
        self._shown.clear()
        found, model, looked = self._state.predicted, self._state.model, self._state.other.looked
        self._results.visible = found is not None or looked is not None
        if found is None or model is None:
            with self._shown:
                if looked is not None:
                    show_contents(looked)
            return
        first, drive = found.found[0], model.file.model
        with self._shown:
            with div("row-of-figures"):
                figure("As predicted", f"{first.as_predicted_rms_percent:.3f} % rms")
                figure("With a free constant", f"{first.free_constant_rms_percent:.3f} % rms")
                figure("Largest", f"{first.largest_percent:.2f} %")
            picture(found.svg)
            show_table(in_page(predictions_table(found.found)))
            band = model.file.errors.get("heldout_95")
            lines = [line for p in found.found for line in prediction_in_words(p, drive)]
            lines += [] if band is None else [band_in_words(found.found, band)]
            show_lines([sentence(line) for line in lines], "small")
            show_lines([sentence(note) for p in found.found for note in p.notes], "issue")

    def _other_record(self) -> None:
        self._state.predicted = None
        self.show()

    def _say_missing(self) -> None:
        missing = (
            "There is no model yet: identify one from a record, or open its file."
            if self._state.model is None
            else self._state.other.missing()
        )
        shown = missing if missing != self._state.other.wrong else ""
        self._missing.text = in_page_words(shown)
        self._missing.visible = bool(shown)
        self._go.set_enabled(not missing)

    def _set_moved(self, event: Any) -> None:
        self._state.moved_for = math.inf if event.value is None else max(0.0, event.value)

    def _start(self) -> None:
        state = self._state
        if state.model is not None:
            known: dict[str, Start | None] = {"auto": None, "rested": "rested"}
            start = known.get(state.start, state.moved_for)
            reading = state.other.reading
            self._task.start(
                f"predicting {', '.join(reading.names)}", predicted, state.model.file, reading,
                start, "prediction",
            )  # fmt: skip

    def _take(self, found: Predicted) -> None:
        self._state.predicted = found
        self.show()
