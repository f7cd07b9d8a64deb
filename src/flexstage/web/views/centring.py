"""Centring: measure a scale on a turning table, move it on trial, move it, and verify."""

import asyncio
import json
import math
from pathlib import Path
from typing import Any

from nicegui import ui

from flexstage.files.write import write_whole
from flexstage.quantities.quantity import beside
from flexstage.records import FORMATS
from flexstage.web.bench.state import bench_of
from flexstage.web.centring.findings import figures, pair, place, rows_of
from flexstage.web.centring.scale_form import SOURCES, ScaleForm
from flexstage.web.centring.stage_moves import axes_of, limits_of, move_to, noise_of, place_of
from flexstage.web.centring.state import CentringState, Source
from flexstage.web.centring.work import (
    CentreFound,
    evaluated,
    gauge_record,
    likely_columns,
    simulated_record,
)
from flexstage.web.figures import figure, picture, show_lines, show_table
from flexstage.web.page import Page, PanelHeading, Task, complain, div, panel, quiet_button, remark
from flexstage.web.preferences import LENGTHS
from flexstage.web.uploads import upload

_ENDINGS = tuple(suffix for suffixes in FORMATS.values() for suffix in suffixes)
_STEPS = ("Measure", "Trial moves", "Move", "Verify")
_PURPOSES = (
    "How far the centre of the scale is from the axis, and in which direction.",
    "Each axis is moved once by a known way: that tells its direction, sign and gain.",
    "Where the stage has to stand for the error of order 1 to vanish.",
    "What is left, and whether a further move would help.",
)
_HOW: dict[Source, str] = {
    "records": "Turn the table once or more with the stage at rest, and give the record: its angle "
    "and the error of each head (angle read minus true angle).",
    "gauge": "Turn the table once by hand, and read the gauge on the rim at even angles.",
    "example": "A simulated table turns a scale that is not centred, with two heads. It needs "
    "nothing of your own.",
}


def build(page: Page) -> None:
    """Make the view."""
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
        if not self._state.measured:
            first = not self._state.columns and self._state.source == "records"
            source: Source = "example" if first else self._state.source
            self._state.begin(source, place_of(self._bench))
        if (limits := limits_of(self._bench)) is not None:
            self._state.limits, self._state.noise = limits, noise_of(self._bench)
        self._folder = page.panel.folder(f"centring/{page.session.id}")

    def build(self) -> None:
        """Make the view."""
        self._form = ScaleForm(self._page, self._begin, self._evaluate)
        with div("columns centring"):
            with div("stack"):
                self._steps = div("stack")
            with panel("sticky").props("tabindex=0"):
                self._working = div("full-width")
                self._shown = div("stack")
        self._task = Task(
            self._page, self._state.jobs, "fit", self._working, self._take, self._failed
        )
        self._show()

    # what a person does

    def _begin(self, source: Source) -> None:
        self._task.stop()
        self._state.begin(source, place_of(self._bench))
        self._form.build()
        self._show()

    def _take_record(self, path: Path) -> None:
        self._state.take(path)
        self._evaluate()

    async def _given(self, path: Path) -> None:
        kept = self._new_file(path.suffix)
        write_whole(kept, path.read_bytes())
        if not self._state.measured:
            self._state.look(await asyncio.to_thread(likely_columns, kept))
            self._form.build()
        self._take_record(kept)

    def _typed(self) -> None:
        with self._page.sentences():
            path = self._new_file(".csv")
            gauge_record(self._state.gauge_text, 1.0 / LENGTHS[self._state.gauge_unit], path)
            self._state.gauge_text = ""
            self._take_record(path)

    async def _turn(self) -> None:
        with self._page.sentences():
            state, path = self._state, self._new_file(".csv")
            by = [at - first for at, first in zip(state.at, state.origin, strict=True)]
            await asyncio.to_thread(simulated_record, by, len(state.measured), path)
            self._take_record(path)

    def _new_file(self, suffix: str) -> Path:
        taken = {path.stem for path in self._folder.iterdir()}
        number = next(k for k in range(1, len(taken) + 2) if f"turn-{k}" not in taken)
        return self._folder / f"turn-{number}{suffix}"

    def _take_back(self) -> None:
        self._state.take_back()
        self._evaluate()

    def _stand(self, axis: int, value: float | None) -> None:
        _, factor = self._page.preferences.length_unit()
        if value is not None:
            at = list(self._state.at)
            at[axis] = value / factor
            self._state.at = (at[0], at[1])

    async def _move(self, target: tuple[float, float]) -> None:
        with self._page.sentences():
            me = self._page.session.id
            self._state.at = await asyncio.to_thread(move_to, self._bench, me, target)
            ui.notify(f"the stage stands at {place(self._state.at, self._page.preferences)}")
            self._show()

    # what follows

    def _evaluate(self) -> None:
        self._task.stop()
        self._show()
        if self._state.measured:
            with self._page.sentences():
                for error in self._state.wrong.values():
                    raise error
                key = f"centring{self._shown.id}"
                self._task.start("evaluation", evaluated, self._state.asked, key)

    def _take(self, found: CentreFound) -> None:
        self._state.found = found
        target = self._state.target()
        if target is not None and axes_of(self._bench) is None:
            self._state.at = target
        self._show()

    def _failed(self, sentence: str) -> None:
        if sentence:
            complain(sentence)
        self._show()

    # what is shown

    def _show(self) -> None:
        self._steps.clear()
        with self._steps:
            for number, name in enumerate(_STEPS, start=1):
                self._step(number, name)
        self._shown.clear()
        with self._shown:
            self._result()

    def _step(self, number: int, name: str) -> None:
        state = self._state
        is_current = number == state.step or (number == 4 and state.step == 3)
        done = number < state.step or (number == 4 and state.next_kind == "move" and self._moves)
        with panel("step current" if is_current else "step"):
            with ui.row().classes("items-center heading"):
                PanelHeading(f"{number} {name}")
                if done:
                    ui.label("done").classes("state")
            if is_current:
                (self._measure, self._trial, self._towards_centre, self._verify)[number - 1]()
            elif not done:
                remark(_PURPOSES[number - 1])

    @property
    def _moves(self) -> int:
        return sum(each.kind == "move" for each in self._state.measured)

    def _measure(self) -> None:
        ui.label(_HOW[self._state.source])
        self._place_fields()
        self._record_field()

    def _trial(self) -> None:
        state = self._state
        axis = "x" if len(state.measured) == 1 else "y"
        if (target := self._told_target()) is None:
            return
        unit, factor = self._page.preferences.length_unit()
        before = state.measured[-1].at["xy".index(axis)]
        by = factor * (target["xy".index(axis)] - before)
        there = place(target, self._page.preferences)
        ui.label(
            f"Move the stage by {by:+.4g} {unit} in {axis} alone, to {there}, turn the table "
            "again, and give the record. It tells how the axis moves the scale."
        )
        self._go_button(target)
        self._place_fields()
        self._record_field()
        self._known_direction()

    def _known_direction(self) -> None:
        """Offer the move that follows at once where the direction of the stage is known."""
        found = self._state.found
        move = None if found is None else found.setups[-1].get("move")
        if move is None:
            return
        unit, factor = self._page.preferences.length_unit()
        with ui.expansion("You know how the stage lies on the table").classes("full-width"):
            field = ui.number(
                "Direction of its x axis [°], as the angle counts",
                value=round(math.degrees(self._state.request.mounting_angle), 9),
            ).props("dense outlined debounce=800")
            field.on_value_change(lambda e: self._mounted(e.value))
            by = ", ".join(
                f"{axis} {pair(move[axis], move[f'uncertainty_{axis}'], factor)} {unit}"
                for axis in "xy"
            )
            ui.label(f"Then move it at once from where it stands: {by}.")

    def _mounted(self, degrees: float | None) -> None:
        if degrees is not None:
            self._state.ask(mounting_angle=math.radians(degrees))
            self._evaluate()

    def _towards_centre(self) -> None:
        state, preferences = self._state, self._page.preferences
        if (target := self._told_target()) is None:
            return
        centre = state.found.result["trial"]["centre"] if state.found else {}
        unit, factor = preferences.length_unit()
        for axis, by in zip("xy", centre["move_from_last"], strict=True):
            unsure = centre[f"uncertainty_{axis}"]
            step = beside(factor * by, factor * unsure)[0]
            value = f"{pair(centre[axis], unsure, factor)} {unit}"
            stays = abs(by) <= state.noise["xy".index(axis)]
            told = "stays: less than the noise of its sensor" if stays else f"by {step} {unit}"
            figure(f"Stage to {axis}", value, told)
        show_lines(state.found.result["trial"]["notes"] if state.found else (), "muted small")
        self._go_button(target)

    def _verify(self) -> None:
        state = self._state
        if state.up_to_date and state.target() is not None:
            ui.label("Turn the table again after the move, and give the record.")
            self._place_fields()
            self._record_field()
        if self._moves and state.found is not None and state.up_to_date:
            found = state.found.setups
            self._left(found[0], found[-1])

    def _left(self, first: dict[str, Any], last: dict[str, Any]) -> None:
        given = self._state.request.radius, self._page.preferences
        with div("issue good"):
            for (name, value, told), (_, before, _) in zip(
                figures(last, *given)[:2], figures(first, *given)[:2], strict=True
            ):
                ui.label(f"{name}: {value} left ({told}); it was {before}")

    def _told_target(self) -> tuple[float, float] | None:
        """Where the stage shall go; what is missing is said where it is not known."""
        state = self._state
        target = state.target()
        if target is None:
            waiting = self._task.running or not state.up_to_date
            words = (
                "The records are evaluated …" if waiting else "No move follows from these records."
            )
            ui.label(words).classes("muted")
            if not waiting and state.found is not None:
                show_lines(state.found.result.get("trial", {}).get("notes", ()), "issue")
                self._place_fields()
                self._record_field()
        return target

    def _go_button(self, target: tuple[float, float]) -> None:
        if axes_of(self._bench) is None:
            remark("No stage is connected: move it yourself, or connect it in the view Bench.")
        elif self._bench.control.holds(self._page.session.id):
            ui.button("Move the stage there", on_click=lambda: self._move(target))
        else:
            remark(
                "Another browser drives the stage, or nobody does: take control in the view Bench."
            )

    def _place_fields(self) -> None:
        unit, factor = self._page.preferences.length_unit()
        with ui.row().classes("items-center place"):
            for axis in (0, 1):
                value = float(f"{factor * self._state.at[axis]:.6g}")
                field = ui.number(f"Stage at {'xy'[axis]} [{unit}]", value=value)
                field.props("dense outlined")
                field.on_value_change(lambda e, axis=axis: self._stand(axis, e.value))

    def _record_field(self) -> None:
        source = self._state.source
        if source == "example":
            ui.button("Turn the simulated table", on_click=self._turn)
        elif source == "records":
            upload(
                self._page, "Record of a turn: drop it here", _ENDINGS, self._given, view="centring"
            )
        else:
            text = ui.textarea("Readings over one turn, at even angles").props("outlined autogrow")
            text.classes("full-width").bind_value(self._state, "gauge_text")
            with ui.row().classes("items-center"):
                choice = ui.select(list(LENGTHS), label="Unit").props("dense outlined")
                choice.bind_value(self._state, "gauge_unit")
                ui.button("Take the readings", on_click=self._typed)

    def _result(self) -> None:
        state, preferences = self._state, self._page.preferences
        if not state.measured:
            PanelHeading("Nothing is measured yet")
            ui.label("Begin on the left. Records may come from three places:")
            with div("chapters"):
                for source, how in _HOW.items():
                    with ui.element("div"):
                        PanelHeading(SOURCES[source], 3)
                        remark(how)
            return
        found = state.found if state.up_to_date else None
        if found is not None:
            with div("row-of-figures"):
                for shown in figures(found.setups[-1], state.request.radius, preferences):
                    figure(*shown)
            picture(found.svg)
        show_table(rows_of(state, preferences))
        with ui.row().classes("items-center"):
            quiet_button("Take the last one back", icon="undo", on_click=self._take_back)
            if found is not None:
                quiet_button("Results (JSON)", icon="download", on_click=self._give)
        if found is not None:
            show_lines(dict.fromkeys(found.result["notes"]), "muted small")

    def _give(self) -> None:
        if self._state.found is not None:
            content = json.dumps(self._state.found.result, indent=1).encode()
            write_whole(self._folder / "centring.json", content)
            ui.download.content(content, "centring.json")
