"""Centring: measure a scale on a rotary table, make trial moves, move it, and verify."""

import asyncio
import json
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

from nicegui import ui

from flexstage.centring import ARCSEC
from flexstage.centring.requests import MAGNET
from flexstage.files.write import write_whole
from flexstage.quantities.quantity import number, value_and_uncertainty
from flexstage.quantities.table import Table, table
from flexstage.records import FORMATS
from flexstage.web.bench.readouts import shown_number
from flexstage.web.bench.state import bench_of
from flexstage.web.centring.state import CentringState, Source
from flexstage.web.centring.work import (
    CentringResult,
    axes_of,
    evaluate_files,
    gauge_record,
    likely_columns,
    limits_of,
    move_to,
    noise_of,
    simulated_record,
    stage_position,
)
from flexstage.web.figures import figure, picture, show_lines, show_table
from flexstage.web.live_history import POSITION
from flexstage.web.page import (
    Page,
    PanelHeading,
    Task,
    choice,
    display_text,
    div,
    panel,
    quiet_button,
    remark,
    show_error,
)
from flexstage.web.request_form import RequestForm
from flexstage.web.sessions import LENGTHS, Preferences
from flexstage.web.uploads import upload

#: Sources of records, with their labels.
SOURCES: dict[Source, str] = {
    "example": "Example (simulated)",
    "records": "Records of an encoder",
    "gauge": "Readings of a gauge",
}
_UNITS = {"": "unit in the file", "deg": "deg", "rad": "rad", "arcsec": "arcsec", "turn": "turn"}


class ScaleForm:
    """The form of the scale and of the columns of its records.

    Parameters
    ----------
    page
        The page.
    begin
        Called with the source of records to start again.
    changed
        Called when records are to be evaluated again.
    """

    def __init__(
        self, page: Page, begin: Callable[[Source], None], changed: Callable[[], None]
    ) -> None:
        self._state = page.session.state(CentringState)
        self._begin, self._changed = begin, changed
        self._builder = RequestForm(
            page,
            lambda: self._state.request,
            lambda name, value: self._ask(**{name: value}),
            self._state.errors,
        )
        self._area = panel("toolbar")
        self.build()

    def build(self) -> None:
        """Rebuild the form for the present state."""
        state = self._state
        state.errors.clear()  # the new fields show the valid values
        self._builder.errors = state.errors
        self._area.clear()
        with self._area:
            choice(SOURCES, state.source, "Source of records", lambda e: self._begin(e.value))
            if state.request.kind != MAGNET:
                self._builder.number("radius")
            if state.source == "records":
                self._records()
            ui.space()
            quiet_button(
                "Start again", icon="restart_alt", on_click=lambda: self._begin(state.source)
            )

    def _records(self) -> None:
        state, builder = self._state, self._builder
        builder.choice("kind")
        if not state.columns:
            return
        columns = list(state.columns)
        builder.choice("angle", columns)
        builder.choice(state.column_kind, columns)
        box = ui.checkbox(
            "Columns are angle readings of the heads", value=state.column_kind == "reading"
        )
        box.props("dense").on_value_change(lambda e: self._set_column_kind(bool(e.value)))
        builder.choice("unit", _UNITS)
        builder.text("heads")
        builder.choice("head_direction", {"ccw": "counter-clockwise", "cw": "clockwise"})

    def _set_column_kind(self, is_reading: bool) -> None:
        names = self._state.request.names
        self._ask(error=() if is_reading else names, reading=names if is_reading else ())
        self.build()

    def _ask(self, **fields: Any) -> None:
        self._state.ask(**fields)
        if "kind" in fields:
            self.build()
        if self._state.turns:
            self._changed()


_KINDS = {"start": "start", "trial": "trial move", "move": "move"}


def with_uncertainty(value: float, uncertainty: float, factor: float) -> str:
    """Return a value with its standard uncertainty, in the unit of a factor from SI."""
    return display_text(" ± ".join(value_and_uncertainty(factor * value, factor * uncertainty)))


def position_text(at: tuple[float, float], preferences: Preferences) -> str:
    """Return a stage position as text."""
    quantity = preferences.displayed(POSITION)
    parts = (f"{n} {shown_number(quantity, v)}" for n, v in zip("xy", at, strict=True))
    return f"{', '.join(parts)} {quantity.shown_unit}"


def figures(
    turn: dict[str, Any], radius: float | None, preferences: Preferences
) -> list[tuple[str, str, str]]:
    """Return name, value and note of the figures of a turn, the main one first."""
    unit, factor = preferences.length_unit()
    rows: list[tuple[str, str, str]] = []
    if (e := turn.get("eccentricity")) is not None:
        uncertainty = factor * e["uncertainty"]
        low, high = (value_and_uncertainty(factor * end, uncertainty)[0] for end in e["interval"])
        value = f"{with_uncertainty(e['value'], e['uncertainty'], factor)} {unit}"
        rows.append(("Eccentricity", value, f"95 %: {low} to {high} {unit}"))
    if (first := once_per_turn(turn, radius)) is not None:
        rows.append(("Error once per turn", f"{with_uncertainty(*first, 1.0)} arcsec", "amplitude"))
    rows.append(("Residual", residual(turn, preferences), "rms"))
    return rows


def once_per_turn(turn: dict[str, Any], radius: float | None) -> tuple[float, float] | None:
    """Return the amplitude of the once-per-turn error and its standard uncertainty [arcsec].

    For a gauge it is the error of a scale with this radius.
    """
    first = next((h for h in turn["harmonics"] if h["order"] == 1), None)
    if first is None:
        return None
    size = first["amplitude_arcsec"]
    if size is None:
        if radius is None:
            return None
        size = 1e-6 * first["amplitude_um"] / radius / ARCSEC
    amplitude = first["amplitude"]
    return size, first["amplitude_uncertainty"] * (size / amplitude if amplitude else 0.0)


def residual(turn: dict[str, Any], preferences: Preferences) -> str:
    """Return the residual of the harmonics as text."""
    first = turn["harmonics"][0]
    rms, size = turn["residual_rms"], first["amplitude"]
    if first["amplitude_arcsec"] is not None:
        return f"{number(rms * first['amplitude_arcsec'] / size, 3)} arcsec" if size else "–"
    unit, factor = preferences.length_unit()
    return (
        f"{number(rms * factor * 1e-6 * first['amplitude_um'] / size, 3)} {unit}" if size else "–"
    )


def turns_table(state: CentringState, preferences: Preferences) -> Table:
    """Return a table of the measured turns."""
    unit, factor = preferences.length_unit()
    heads = (
        "turn", f"stage x [{unit}]", f"y [{unit}]", f"eccentricity [{unit}]", "direction [°]",
        "once per turn [arcsec]", "residual, rms",
    )  # fmt: skip
    turns = state.result.setups if state.result is not None and state.up_to_date else []
    rows = []
    for i, turn in enumerate(state.turns):
        at = [shown_number(preferences.displayed(POSITION), v) for v in turn.position]
        cells = ["…"] * 4
        if i < len(turns):
            e, first = (
                turns[i].get("eccentricity"),
                once_per_turn(turns[i], state.request.radius),
            )
            cells = [
                "–" if e is None else with_uncertainty(e["value"], e["uncertainty"], factor),
                "–" if e is None else display_text(f"{e['phase_deg']:.1f}"),
                "–" if first is None else with_uncertainty(*first, 1.0),
                residual(turns[i], preferences),
            ]
        rows.append((f"{i + 1} {_KINDS[turn.kind]}", *at, *cells))
    return table("", heads, rows)


_ENDINGS = tuple(suffix for suffixes in FORMATS.values() for suffix in suffixes)
_STEPS = ("Measure", "Trial moves", "Move", "Verify")
_PURPOSES = (
    "Magnitude and direction of the eccentricity.",
    "One known move of each axis gives its direction, sign and gain.",
    "Stage position that cancels the once-per-turn error.",
    "Remaining eccentricity, and whether another move would help.",
)
_INSTRUCTIONS: dict[Source, str] = {
    "records": "Turn the table once or more with the stage at rest, and upload the record of the "
    "angle and the error of each head (reading − true angle).",
    "gauge": "Turn the table once by hand, and read the gauge at the rim at equal angles.",
    "example": "A simulated table turns an eccentric scale with two heads. It needs no hardware.",
}


def build(page: Page) -> None:
    """Build the view."""
    CentringView(page).build()


class CentringView:
    """The view in one page.

    Parameters
    ----------
    page
        The page.
    """

    def __init__(self, page: Page) -> None:
        self._page, self._bench = page, bench_of(page)
        self._state = page.session.state(CentringState)
        if not self._state.turns:
            is_new = not self._state.columns and self._state.source == "records"
            source: Source = "example" if is_new else self._state.source
            self._state.begin(source, stage_position(self._bench))
        if (limits := limits_of(self._bench)) is not None:
            self._state.limits, self._state.noise = limits, noise_of(self._bench)
        self._folder = page.panel.folder(f"centring/{page.session.id}")

    def build(self) -> None:
        """Build the view."""
        self._form = ScaleForm(self._page, self._begin, self._evaluate)
        with div("columns centring"):
            with div("stack"):
                self._steps = div("stack")
            with panel("sticky").props("tabindex=0"):
                self._working = div("full-width")
                self._results = div("stack")
        self._task = Task(
            self._page, self._state.jobs, "fit", self._working, self._take, self._failed
        )
        self._show()

    # input

    def _begin(self, source: Source) -> None:
        self._task.stop()
        self._state.begin(source, stage_position(self._bench))
        self._form.build()
        self._show()

    def _take_record(self, path: Path) -> None:
        self._state.add_turn(path)
        self._evaluate()

    async def _use_file(self, path: Path) -> None:
        path_in_folder = self._new_file(path.suffix)
        write_whole(path_in_folder, path.read_bytes())
        if not self._state.turns:
            self._state.use_columns(await asyncio.to_thread(likely_columns, path_in_folder))
            self._form.build()
        self._take_record(path_in_folder)

    def _use_readings(self) -> None:
        with self._page.show_errors():
            path = self._new_file(".csv")
            gauge_record(self._state.gauge_text, 1.0 / LENGTHS[self._state.gauge_unit], path)
            self._state.gauge_text = ""
            self._take_record(path)

    async def _turn(self) -> None:
        with self._page.show_errors():
            state, path = self._state, self._new_file(".csv")
            displacement = [
                at - first for at, first in zip(state.position, state.origin, strict=True)
            ]
            await asyncio.to_thread(simulated_record, displacement, len(state.turns), path)
            self._take_record(path)

    def _new_file(self, suffix: str) -> Path:
        existing = {path.stem for path in self._folder.iterdir()}
        number = next(k for k in range(1, len(existing) + 2) if f"turn-{k}" not in existing)
        return self._folder / f"turn-{number}{suffix}"

    def _undo_turn(self) -> None:
        self._state.undo_turn()
        self._evaluate()

    def _set_position(self, axis: int, value: float | None) -> None:
        _, factor = self._page.preferences.length_unit()
        if value is not None:
            at = list(self._state.position)
            at[axis] = value / factor
            self._state.position = (at[0], at[1])

    async def _move(self, target: tuple[float, float]) -> None:
        with self._page.show_errors():
            session = self._page.session.id
            self._state.position = await asyncio.to_thread(move_to, self._bench, session, target)
            ui.notify(
                f"the stage is at {position_text(self._state.position, self._page.preferences)}"
            )
            self._show()

    # evaluation

    def _evaluate(self) -> None:
        self._task.stop()
        self._show()
        if self._state.turns:
            with self._page.show_errors():
                for error in self._state.errors.values():
                    raise error
                key = f"centring{self._results.id}"
                self._task.start("evaluation", evaluate_files, self._state.evaluation, key)

    def _take(self, result: CentringResult) -> None:
        self._state.result = result
        target = self._state.target()
        if target is not None and axes_of(self._bench) is None:
            self._state.position = target
        self._show()

    def _failed(self, sentence: str) -> None:
        if sentence:
            show_error(sentence)
        self._show()

    # display

    def _show(self) -> None:
        self._steps.clear()
        with self._steps:
            for number, name in enumerate(_STEPS, start=1):
                self._step(number, name)
        self._results.clear()
        with self._results:
            self._result()

    def _step(self, number: int, name: str) -> None:
        state = self._state
        is_current = number == state.step or (number == 4 and state.step == 3)
        is_done = number < state.step or (number == 4 and state.next_kind == "move" and self._moves)
        with panel("step current" if is_current else "step"):
            with ui.row().classes("items-center heading"):
                PanelHeading(f"{number} {name}")
                if is_done:
                    ui.label("done").classes("state")
            if is_current:
                (self._measure, self._trial, self._towards_centre, self._verify)[number - 1]()
            elif not is_done:
                remark(_PURPOSES[number - 1])

    @property
    def _moves(self) -> int:
        return sum(each.kind == "move" for each in self._state.turns)

    def _measure(self) -> None:
        ui.label(_INSTRUCTIONS[self._state.source])
        self._place_fields()
        self._record_field()

    def _trial(self) -> None:
        state = self._state
        axis = "x" if len(state.turns) == 1 else "y"
        if (target := self._target_or_reason()) is None:
            return
        unit, factor = self._page.preferences.length_unit()
        present = state.turns[-1].position["xy".index(axis)]
        step = factor * (target["xy".index(axis)] - present)
        destination = position_text(target, self._page.preferences)
        ui.label(
            f"Move the stage by {step:+.4g} {unit} in {axis} only, to {destination}. Turn the "
            "table again, and upload the record. It calibrates the axis."
        )
        self._go_button(target)
        self._place_fields()
        self._record_field()
        self._known_direction()

    def _known_direction(self) -> None:
        """Offer the direct move for a known orientation of the stage."""
        result = self._state.result
        move = None if result is None else result.setups[-1].get("move")
        if move is None:
            return
        unit, factor = self._page.preferences.length_unit()
        with ui.expansion("Stage orientation is known").classes("full-width"):
            field = ui.number(
                "Direction of the x axis [°], in the sense of the angle",
                value=round(math.degrees(self._state.request.mounting_angle), 9),
            ).props("dense outlined debounce=800")
            field.on_value_change(lambda e: self._set_orientation(e.value))
            move_text = ", ".join(
                f"{axis} {with_uncertainty(move[axis], move[f'uncertainty_{axis}'], factor)} {unit}"
                for axis in "xy"
            )
            ui.label(f"Move directly from the current position: {move_text}.")

    def _set_orientation(self, degrees: float | None) -> None:
        if degrees is not None:
            self._state.ask(mounting_angle=math.radians(degrees))
            self._evaluate()

    def _towards_centre(self) -> None:
        state, preferences = self._state, self._page.preferences
        if (target := self._target_or_reason()) is None:
            return
        centre = state.result.data["trial"]["centre"] if state.result else {}
        unit, factor = preferences.length_unit()
        for axis, move in zip("xy", centre["move_from_last"], strict=True):
            uncertainty = centre[f"uncertainty_{axis}"]
            step = value_and_uncertainty(factor * move, factor * uncertainty)[0]
            value = f"{with_uncertainty(centre[axis], uncertainty, factor)} {unit}"
            stays = abs(move) <= state.noise["xy".index(axis)]
            note = "no move: below the noise of the sensor" if stays else f"by {step} {unit}"
            figure(f"Stage position {axis}", value, note)
        show_lines(state.result.data["trial"]["notes"] if state.result else (), "muted small")
        self._go_button(target)

    def _verify(self) -> None:
        state = self._state
        if state.up_to_date and state.target() is not None:
            ui.label("Turn the table again after the move, and upload the record.")
            self._place_fields()
            self._record_field()
        if self._moves and state.result is not None and state.up_to_date:
            settings = state.result.setups
            self._show_remaining(settings[0], settings[-1])

    def _show_remaining(self, first: dict[str, Any], last: dict[str, Any]) -> None:
        options = self._state.request.radius, self._page.preferences
        with div("issue good"):
            for (name, value, note), (_, initial, _) in zip(
                figures(last, *options)[:2], figures(first, *options)[:2], strict=True
            ):
                ui.label(f"{name}: {value} ({note}); initially {initial}")

    def _target_or_reason(self) -> tuple[float, float] | None:
        """Return the target of the stage; without one, show the reason."""
        state = self._state
        target = state.target()
        if target is None:
            is_pending = self._task.running or not state.up_to_date
            text = "Evaluating the records …" if is_pending else "These records determine no move."
            ui.label(text).classes("muted")
            if not is_pending and state.result is not None:
                show_lines(state.result.data.get("trial", {}).get("notes", ()), "issue")
                self._place_fields()
                self._record_field()
        return target

    def _go_button(self, target: tuple[float, float]) -> None:
        if axes_of(self._bench) is None:
            remark("Move the stage yourself, or connect it in the view Bench.")
        elif self._bench.control.holds(self._page.session.id):
            ui.button("Move the stage there", on_click=lambda: self._move(target))
        else:
            remark("This browser does not have control of the stage: take it in the view Bench.")

    def _place_fields(self) -> None:
        unit, factor = self._page.preferences.length_unit()
        with ui.row().classes("items-center place"):
            for axis in (0, 1):
                value = float(f"{factor * self._state.position[axis]:.6g}")
                field = ui.number(f"Stage at {'xy'[axis]} [{unit}]", value=value)
                field.props("dense outlined")
                field.on_value_change(lambda e, axis=axis: self._set_position(axis, e.value))

    def _record_field(self) -> None:
        source = self._state.source
        if source == "example":
            ui.button("Turn the simulated table", on_click=self._turn)
        elif source == "records":
            upload(
                self._page,
                "Record of a turn: drop it here",
                _ENDINGS,
                self._use_file,
                view="centring",
            )
        else:
            text = ui.textarea("Readings over one turn, at equal angles").props("outlined autogrow")
            text.classes("full-width").bind_value(self._state, "gauge_text")
            with ui.row().classes("items-center"):
                choice = ui.select(list(LENGTHS), label="Unit").props("dense outlined")
                choice.bind_value(self._state, "gauge_unit")
                ui.button("Use the readings", on_click=self._use_readings)

    def _result(self) -> None:
        state, preferences = self._state, self._page.preferences
        if not state.turns:
            PanelHeading("No turn measured yet")
            ui.label("Start on the left. There are three sources of records:")
            with div("chapters"):
                for source, instruction in _INSTRUCTIONS.items():
                    with ui.element("div"):
                        PanelHeading(SOURCES[source], 3)
                        remark(instruction)
            return
        result = state.result if state.up_to_date else None
        if result is not None:
            with div("row-of-figures"):
                for row in figures(result.setups[-1], state.request.radius, preferences):
                    figure(*row)
            picture(result.svg)
        show_table(turns_table(state, preferences))
        with ui.row().classes("items-center"):
            quiet_button("Undo last turn", icon="undo", on_click=self._undo_turn)
            if result is not None:
                quiet_button("Results (JSON)", icon="download", on_click=self._download)
        if result is not None:
            show_lines(dict.fromkeys(result.data["notes"]), "muted small")

    def _download(self) -> None:
        if self._state.result is not None:
            content = json.dumps(self._state.result.data, indent=1).encode()
            write_whole(self._folder / "centring.json", content)
            ui.download.content(content, "centring.json")
