"""The model in a page: what it is worth, the models beside it, its loop and residual, its file."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

from nicegui import ui

from flexstage.hysteresis import MODELS
from flexstage.quantities.units import readable
from flexstage.report.identification import (
    candidates_table,
    failures,
    identification_in_words,
    parameters_table,
    quality_in_words,
)
from flexstage.web.figures import figure, in_page, picture, save, sentence, show_lines, show_table
from flexstage.web.hysteresis.state import HysteresisState, OpenModel
from flexstage.web.hysteresis.work import Identified, identified, opened
from flexstage.web.page import Page, PanelHeading, Task, div, in_page_words, panel
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

    def _tell(self, model: OpenModel, made: Identified) -> None:
        found = made.found
        PanelHeading(f"{MODELS[found.kind].title}: {model.name}")
        ui.label(in_page_words(sentence(quality_in_words(found)))).classes(
            "issue good" if found.quality.fits else "issue error"
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

    def _more(self, made: Identified) -> None:
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

    def _take_another(self, made: Identified) -> None:
        self._state.tried[made.found.kind] = made
        self._use(made)

    def _use(self, made: Identified) -> None:
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
