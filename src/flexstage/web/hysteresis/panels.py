"""The command in a page: what the drive shall follow, the waveform, what is left, its file."""

import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

from nicegui import ui

from flexstage.hysteresis import MODELS
from flexstage.hysteresis.drive_model import DriveModel, Start
from flexstage.hysteresis.requests import AmplifierLimits, CompensateRequest
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
    Compensation,
    PredictionSet,
    compensated,
    other_example,
    predicted,
    usual_motion,
    waveform,
)
from flexstage.web.page import Page, Task, display_text, div, panel, remark
from flexstage.web.request_form import RequestForm

_SHAPES = {"sine": "Sine", "triangle": "Triangle", "file": "From a file"}
_STARTS = {
    "conditioned": "conditioned: cycles over the whole range, then its low end",
    "rest": "rest: unused",
    "moved": "conditioned, and then moved as wanted for",
}
_FILES = {"csv": ".csv", "npz": ".npz", "hdf5": ".h5", "mat": ".mat"}
_NUMBER = "outlined dense stack-label debounce=700"
#: For how long a drive had moved before, where it had [s].
_MOVED = 30.0


class CompensationPanel:
    """The command for a motion.

    Parameters
    ----------
    page
        The page.
    state
        What is open.
    """

    def __init__(self, page: Page, state: HysteresisState) -> None:
        self._page, self._state = page, state
        self._request = RequestForm(page, lambda: state.motion.asked, self._ask)
        self._due = False

    def build(self) -> None:
        """Make the panel."""
        with div("columns asked"):
            with panel():
                self._none = ui.label(
                    "There is no model yet: identify one from a record, or open its file."
                ).classes("issue")
                self._form = ui.column().classes("full-width told")
            with panel() as self._results:
                self._working = ui.column().classes("full-width")
                self._wrong = ui.label().classes("issue error").props('role="alert"')
                self._shown = ui.column().classes("full-width told")
        self._wrong.visible = False
        self._task = Task(
            self._page, self._state.jobs, "command", self._working, self._take, self._failed,
            self._show_command,
        )  # fmt: skip
        self.show()

    def show(self) -> None:
        """Show the fields for the model that is open, and the command."""
        model = self._state.model
        self._none.visible = model is None
        self._form.clear()
        if model is not None:
            drive = model.file.model
            self._state.motion = usual_motion(self._state.motion, drive, model.sample_rate_hz)
            with self._form:
                title = MODELS[drive.hysteresis.kind].title
                remark(f"By the inverse of {title}, {model.name}.")
                self._fields(drive)
        self._refuse("")
        self._show_command()
        if self._state.compensated is None:
            self.compute()

    # what is wanted

    def _fields(self, drive: DriveModel) -> None:
        motion, asked = self._state.motion, self._state.motion.asked
        unit, factor = self._unit(drive)
        ui.toggle(_SHAPES, value=motion.shape).props("no-caps").on_value_change(
            lambda event: self._reshape(event.value)
        ).props["aria-label"] = "Shape"
        if motion.shape == "file":
            self._file()
        else:
            if drive.validity is not None:
                low, high = drive.validity.output_range
                reach = display_text(readable(drive.output_unit, low, high, digits=4))
                remark(f"The record of the model reaches {reach}.")
            with div("entries"):
                self._number("centre", f"Centre{unit}", factor)
                self._number("amplitude", f"Amplitude ±{unit}", factor)
                self._number("rate_hz", "Frequency [Hz]")
                self._number("sample_rate_hz", "Sample rate [Hz]")
                periods = self._number("periods", "Periods (0: one that repeats without end)")
                periods.props("min=0 step=1").classes("whole")
        volt = f" [{drive.input_unit}]" if drive.input_unit else ""
        slope = f" [{drive.input_unit}/s]" if drive.input_unit else " [1/s]"
        with (
            ui.expansion(
                "Limits, and the state before", value=asked != CompensateRequest()
            ).classes("folded"),
            div("entries"),
        ):
            ends = asked.voltage or (None, None)
            self._limit(f"Lowest command{volt}", ends[0], lambda v: self._bound(drive, 0, v))
            self._limit(f"Highest command{volt}", ends[1], lambda v: self._bound(drive, 1, v))
            self._limit(
                f"Slew{slope}",
                asked.amplifier.slew,
                lambda v: self._ask("amplifier", AmplifierLimits(slew=v)),
            )
            self._request.number("reference_bandwidth")
            state = asked.start if isinstance(asked.start, str) else "moved"
            start = ui.select(_STARTS, value=state, label="Start")
            start.props("outlined dense options-dense stack-label").classes("whole")
            moved_for = _MOVED if isinstance(asked.start, str) else asked.start
            moved = self._limit("Moved for [s]", moved_for, lambda v: self._ask("start", v or 0.0))
            moved.bind_visibility_from(start, "value", value="moved")
            start.on_value_change(
                lambda e: self._ask("start", moved.value or 0.0 if e.value == "moved" else e.value)
            )

    def _file(self) -> None:
        form = FilesForm(
            self._page,
            self._state.reference,
            self._state.jobs,
            key="reference",
            label="Record of the wanted readings",
            example=None,
            changed=self.compute,
            reference=True,
        )
        form.build()
        self._missing = ui.label().classes("issue")
        self._missing.visible = False
        form.begin()
        self._request.tick("relative", "count from the lowest reading of the drive")

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
        shown = None if value is None else float(f"{value * factor:.6g}")
        field = ui.number(label, value=shown, format="%.6g").props(_NUMBER)

        def changed(event: Any) -> None:
            given = event.value
            if given is not None and shown_of(given) == shown_of(getattr(self._state.motion, name)):
                return
            self._set(name, None if given is None else given / factor)

        def shown_of(number: float | None) -> str:
            return "" if number is None else f"{number:.6g}"

        field.on_value_change(changed)
        return field

    def _limit(
        self, label: str, value: float | None, take: Callable[[float | None], None]
    ) -> ui.number:
        """Show a number in the unit of the model, which is nothing where it is emptied."""
        field = ui.number(label, value=value, format="%.6g").props(_NUMBER)

        def changed(event: Any) -> None:
            with self._page.show_errors():
                take(event.value)

        field.on_value_change(changed)
        return field

    def _bound(self, drive: DriveModel, end: int, value: float | None) -> None:
        """Take an end of the voltage; the other is that of the model where it was not given."""
        own = (0.0, 0.0) if drive.validity is None else drive.validity.input_range
        ends = list(self._state.motion.asked.voltage or own)
        ends[end] = own[end] if value is None else value
        self._ask("voltage", None if tuple(ends) == own else tuple(ends))

    def _ask(self, name: str, value: Any) -> None:
        self._set("asked", replace(self._state.motion.asked, **{name: value}))

    def _set(self, name: str, value: Any) -> None:
        if name == "periods":
            value = max(0, int(value or 0))
        motion = replace(self._state.motion, **{name: value})
        if motion != self._state.motion:
            self._state.motion = motion
            self.compute()

    def _reshape(self, shape: Any) -> None:
        self._state.motion = replace(self._state.motion, shape=shape)
        if shape == "file":
            self._state.compensated = None
        self.show()
        self.compute()

    # what comes of it

    def compute(self) -> None:
        """Compute the command for what is wanted, after one that is being computed."""
        state = self._state
        self._due = self._task.running  # to end that would end a process that is warm
        if state.model is None or self._due:
            return
        motion = state.motion
        if motion.shape == "file":
            missing = state.reference.missing(reference=True)
            self._missing.text = "" if missing == state.reference.wrong else missing
            self._missing.visible = bool(self._missing.text)
            if missing:
                return
            motion = replace(motion, file=state.reference.reading)
        self._refuse("")
        self._task.start("the command", compensated, state.model.file, motion, "command")
        self._results.visible = True
        self._shown.classes(add="stale")

    def _take(self, made: Compensation) -> None:
        if self._due:
            self.compute()
            return
        self._state.compensated = made
        self._refuse("")
        self._show_command()

    def _failed(self, why: str) -> None:
        if self._due:
            self.compute()
        else:
            self._refuse(why)

    def _refuse(self, why: str) -> None:
        self._wrong.text = display_text(sentence(why))
        self._wrong.visible = bool(why)
        if why:
            self._results.visible = True
            self._shown.classes(add="stale")
        else:
            self._shown.classes(remove="stale")

    def _show_command(self) -> None:
        self._shown.clear()
        made, model = self._state.compensated, self._state.model
        self._results.visible = made is not None or self._task.running
        if made is None or model is None:
            return
        drive, command = model.file.model, made.made
        band = model.file.errors.get("heldout_95")
        with self._shown:
            with div("row-of-figures"):
                ends = float(command.command.min()), float(command.command.max())
                figure("Command", readable(drive.input_unit, *ends, digits=4))
                figure(
                    "PredictionSet error",
                    f"{readable(drive.output_unit, command.rms_error)} rms",
                    "of the model with itself",
                )
                plain = readable(drive.output_unit, made.plain_rms)
                figure("In proportion, without the model", f"{plain} rms")
                if band is not None and drive.validity is not None:
                    low, high = drive.validity.output_range
                    own = readable(drive.output_unit, 0.01 * band * (high - low))
                    figure("A measured drive, 95 % within", f"+-{own}", "by the held-out errors")
                self._downloads()
            picture(made.svg)
            show_lines([sentence(note) for note in made.notes], "issue")
            with ui.expansion("In words").classes("folded"):
                show_lines([sentence(line) for line in command_in_words(command, drive)], "small")
                show_lines([sentence(note) for note in model.file.notes], "muted small")

    def _downloads(self) -> None:
        with ui.row().classes("items-center no-wrap downloads"):
            format = ui.select(_FILES, value="csv", label="Format").props(
                "outlined dense options-dense"
            )

            def give() -> None:
                made, model = self._state.compensated, self._state.model
                if made is not None and model is not None and format.value:
                    with self._page.show_errors():
                        name = f"{Path(model.name).stem}-{made.motion.shape}"
                        content = waveform(made.made, model.file.model, format.value)
                        save(self._page, f"{name}{_FILES[format.value]}", content)

            ui.button("Download the waveform", icon="download", on_click=give)


_PREDICTION_STARTS = {
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
                    start = ui.select(_PREDICTION_STARTS, value=state.start, label="Start")
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
        self._missing.text = display_text(shown)
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

    def _take(self, found: PredictionSet) -> None:
        self._state.predicted = found
        self.show()
