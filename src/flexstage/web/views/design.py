"""Design: choose a stage, change its parameters, and see the figures at once."""

import asyncio
import time
from collections.abc import Callable, Sequence
from functools import partial
from html import escape
from typing import Any

import numpy as np
from nicegui import events, ui

from flexstage.base.errors import FlexstageError
from flexstage.export.request import FORMATS
from flexstage.files.names import file_name
from flexstage.files.write import write_whole
from flexstage.quantities.comparison import MODEL_WORDS
from flexstage.report.page import table_html
from flexstage.stage.designs import StageTemplate
from flexstage.studies.explore.sensitivity import Sensitivities
from flexstage.studies.explore.variables import Variable, is_data_sheet
from flexstage.web.design.choice import StageChoice
from flexstage.web.design.state import FIRST, FIRST_OPEN, DesignState, Variant
from flexstage.web.design.work import (
    SLIDER_FIGURES,
    CheckedDrawing,
    characteristics_of,
    draw_with_issues,
    export_to_folder,
    figures_table,
    slopes_of,
    stage_file,
)
from flexstage.web.figures import picture
from flexstage.web.jobs import BackgroundJob
from flexstage.web.page import (
    Page,
    PanelHeading,
    choice,
    div,
    named_dialog,
    panel,
    quiet_button,
    remark,
    show_error,
    show_job,
)

_DIGITS = 5
_WHOLE_STAGE = "whole stage"
_EFFECTIVE, _OTHERS = "most effective dimensions", "other dimensions"
_ORDERS = {"": "stage file"} | {
    name: f"by {name}" for name in dict.fromkeys(SLIDER_FIGURES.values())
}


class _Slider(ui.slider):
    """A slider that moves in the browser without an answer of the server."""

    LOOPBACK = False


class Sliders:
    """The sliders of the open stage.

    Parameters
    ----------
    state
        State of the view.
    on_change
        Called after a change of the variant.
    """

    def __init__(self, state: DesignState, on_change: Callable[[], object]) -> None:
        self._state, self._on_change = state, on_change
        self._rows: dict[str, tuple[Variable, ui.slider, ui.number, ui.html]] = {}
        with ui.row().classes("items-center heading"):
            PanelHeading("Parameters")
            self._axis = ui.toggle([], on_change=self._choose_axis).props("dense no-caps")
            choice(_ORDERS, state.order, "Order", self._choose_order).classes("order")
        names = "".join(f"<span>{name}</span>" for name in dict.fromkeys(SLIDER_FIGURES.values()))
        ui.html(
            "<span>% change of each figure per 1 % change of the parameter</span>"
            f'<div class="slopes">{names}</div>',
            sanitize=False,
        ).classes("slopes-head muted small")
        self._list = div("sliders")

    def build(self) -> None:
        """Rebuild the sliders, for another stage or order."""
        self._list.clear()
        self._rows.clear()
        axes = [axis.name for axis in self._state.now.template.stage().axes]
        if self._state.axis not in axes:
            self._state.axis = axes[0] if axes else ""
        self._axis.set_options(axes, value=self._state.axis or None)
        self._axis.visible = len(axes) > 1
        with self._list:
            self._build_rows()
        self.show_slopes()

    def _build_rows(self) -> None:
        variables = self._state.variables
        if not variables:
            ui.label(
                "No parameter can be changed: the stage file has no named dimensions."
            ).classes("muted")
        slopes_of_variant = self._state.slopes.get(self._state.now)
        if self._state.order and slopes_of_variant is not None:

            def strength(variable: Variable) -> float:
                slopes = _elasticities(slopes_of_variant, variable.name, self._state.axis)
                return abs(slopes[self._state.order] or 0.0)

            for variable in sorted(variables, key=strength, reverse=True):
                self._row(variable, variable.name)
            return
        groups: dict[str, list[Variable]] = {}
        is_first = self._state.now.template.source == FIRST
        for variable in variables:
            group = variable.name.rpartition(".")[0]
            if is_first and not is_data_sheet(group):
                group = _EFFECTIVE if variable.name in FIRST_OPEN else _OTHERS
            groups.setdefault(group, []).append(variable)
        groups = {name: groups[name] for name in sorted(groups, key=lambda n: n != _EFFECTIVE)}
        for index, (group, members) in enumerate(groups.items()):
            if len(groups) == 1:
                for variable in members:
                    self._row(variable, variable.name)
                continue
            # data-sheet values are seldom changed
            is_open = index < 3 and group != _OTHERS and not is_data_sheet(group)
            with ui.expansion(group or _WHOLE_STAGE, value=is_open).classes("group"):
                for variable in members:
                    name = variable.name.removeprefix(f"{group}.")
                    self._row(variable, name.replace(".", " "))

    def _row(self, variable: Variable, label: str) -> None:
        factor = variable.factor
        low, high, value = (
            v * factor for v in (variable.low, variable.high, self._state.value(variable))
        )
        step = (high - low) / 240.0
        heading = variable.heading
        unit = escape(heading.removeprefix(variable.name))
        with div("slider"):
            name = ui.html(
                f'{escape(label.replace("_", " "))}<span class="muted">{unit}</span>',
                sanitize=False,
            )
            name.props["title"] = f"{heading}: {variable.description}"
            slider = _Slider(min=low, max=high, step=step, value=value)
            slider.props["aria-label"] = heading
            field = ui.number(value=_rounded(value), step=step)
            field.props("dense borderless input-class=number debounce=400")
            field.props["aria-label"] = f"Value of {heading}"
            slopes = ui.html("", sanitize=False).classes("slopes number small")
        slider.on_value_change(lambda e: self._set(variable, e.value, slider))
        field.on_value_change(lambda e: self._set(variable, e.value, field))
        self._rows[variable.name] = (variable, slider, field, slopes)

    def _set(self, variable: Variable, displayed: float | None, source: ui.element) -> None:
        if displayed is None:
            return
        present = self._state.value(variable) * variable.factor
        if abs(displayed - present) <= 10.0**-_DIGITS * abs(present):
            return
        nominal = variable.usual
        value = displayed / variable.factor
        value = nominal if abs(value - nominal) <= 1e-9 * abs(nominal) else value
        self._state.show(self._state.now.changed(variable.name, value, nominal))
        _, slider, field, _ = self._rows[variable.name]
        if source is slider:
            field.value = _rounded(displayed)
        else:
            slider.value = displayed
        self.show_slopes()
        self._on_change()

    def sync(self) -> None:
        """Set all sliders to the values of the variant, after an undo."""
        for variable, slider, field, _ in self._rows.values():
            value = self._state.value(variable) * variable.factor
            slider.value, field.value = value, _rounded(value)
        self.show_slopes()

    def show_slopes(self) -> None:
        """Show the sensitivities; while they are unknown, keep those of the last variant."""
        slopes = self._state.slopes.get(self._state.now)
        if slopes is None:
            self._list.classes(add="passed")
            return
        self._list.classes(remove="passed")
        for name, (_, _, _, cells) in self._rows.items():
            cells.content = _cells(slopes, name, self._state.axis)

    def _choose_axis(self, event: events.ValueChangeEventArguments) -> None:
        if event.value and event.value != self._state.axis:
            self._state.axis = event.value
            self.build() if self._state.order else self.show_slopes()

    def _choose_order(self, event: events.ValueChangeEventArguments) -> None:
        self._state.order = event.value
        self.build()


def _rounded(value: float) -> float:
    return float(f"{value:.{_DIGITS}g}")


def _elasticities(slopes: Sensitivities, name: str, axis: str) -> dict[str, float | None]:
    """Return the change of each figure in per cent per 1 % change of a parameter."""
    values: dict[str, float | None] = dict.fromkeys(SLIDER_FIGURES.values())
    column = next((k for k, v in enumerate(slopes.variables) if v.name == name), None)
    for row, figure in enumerate(slopes.figures):
        if figure.axis == axis and column is not None:
            value = float(slopes.elasticities[row, column])
            values[SLIDER_FIGURES[figure.quantity]] = value if np.isfinite(value) else None
    return values


def _cells(slopes: Sensitivities, name: str, axis: str) -> str:
    cells = []
    for value in _elasticities(slopes, name, axis).values():
        # strong sensitivities are highlighted
        mark = ' class="strong"' if value is not None and abs(value) >= 0.3 else ""
        cells.append(f"<span{mark}>{_elasticity(value)}</span>")
    return "".join(cells)


def _elasticity(value: float | None) -> str:
    if value is None:
        return "·"
    return "0" if abs(value) < 0.005 else f"{value:+.2f}".replace("-", "−")


def build(page: Page) -> None:
    """Build the view."""
    DesignView(page).build()


class DesignView:
    """The view in one page.

    Parameters
    ----------
    page
        The page.
    """

    def __init__(self, page: Page) -> None:
        self._page = page
        self._state = page.session.state(DesignState)
        self._follows = self._dirty = self._drawing = False
        self._changed_at = 0.0
        self._drawn_variant: Variant | None = None
        self._drawn_pinned: Variant | None = None
        self._job: tuple[str, Variant, BackgroundJob] | None = None

    def build(self) -> None:
        """Build the view."""
        with panel("toolbar"):
            self._tools()
        with div("columns design"):
            with panel():
                self._sliders = Sliders(self._state, self._moved)
            with panel("sticky").props("tabindex=0"):
                self._results()
        self._sliders.build()
        self._moved()
        ui.timer(0.1, self._look)

    def _tools(self) -> None:
        self._choice = StageChoice(self._page, self._opened)
        ui.space()
        state = self._state
        self._undo, self._redo = (
            quiet_button(icon=icon, on_click=partial(self._turn, turn)).props(
                f'aria-label="{name}"'
            )
            for icon, name, turn in (("undo", "Undo", state.undo), ("redo", "Redo", state.redo))
        )
        quiet_button("Pin for comparison", on_click=lambda: self._pin(state.now))
        ui.button("Save stage file", on_click=lambda: ask_file_name(self._page, self._state.now))
        quiet_button("Export", on_click=lambda: ask_export(self._page, self._state.now)).props(
            "outline"
        )

    def _results(self) -> None:
        with ui.row().classes("items-center heading"):
            self._title = PanelHeading()
            self._activity = ui.label().classes("muted small").props('role="status"')
        self._error = ui.label().classes("issue error").props('role="alert"')
        self._error.visible = False
        with div("drawings"):
            self._picture = picture("")
            self._pinned_picture = picture("")
        self._figures = ui.html("", sanitize=False).classes("tables live")
        with ui.row().classes("items-center heading") as self._pinned_row:
            self._pinned_name = ui.label().classes("small")
            quiet_button("Open pinned", on_click=self._swap).props("dense")
            quiet_button("Unpin", on_click=lambda: self._pin(None)).props("dense")
        self._issues = div("issues").props('aria-live="polite"')
        self._show_pinned()

    # input

    def _moved(self) -> None:
        """Follow a change: the figures at once, drawing and finer model at its end."""
        self._changed_at = time.monotonic()
        self._dirty = True
        if not self._follows:
            self._follows = True
            self._page.begin(self._follow)

    def _opened(self) -> None:
        self._sliders.build()
        self._moved()

    def _turn(self, turn: Callable[[], object]) -> None:
        template = self._state.now.template
        turn()
        self._refresh(template)

    def _refresh(self, previous: StageTemplate) -> None:
        template = self._state.now.template
        if template != previous:
            self._choice.sync()
            self._sliders.build()
        self._sliders.sync()
        self._moved()

    def _pin(self, variant: Variant | None) -> None:
        self._state.pinned = variant
        self._show_pinned()
        self._moved()

    def _swap(self) -> None:
        pinned = self._state.pinned
        if pinned is not None:
            previous, self._state.pinned = self._state.now, self._state.now
            self._state.show(pinned)
            self._state.commit()
            self._show_pinned()
            self._refresh(previous.template)

    # computation

    async def _follow(self) -> None:
        """Show the figures of the newest variant; intermediate variants are skipped."""
        try:
            while self._dirty:
                self._dirty = False
                variant = self._state.now
                try:
                    rows = self._state.lumped.get(variant)
                    if rows is None:
                        rows = await asyncio.to_thread(characteristics_of, variant, "lumped")
                        self._state.lumped.put(variant, rows)
                except FlexstageError as error:
                    self._show_model_error(str(error))
                else:
                    self._show_model_error("")
                    self._show_figures(variant)
        finally:
            self._follows = False

    def _show_model_error(self, sentence: str) -> None:
        self._error.text = sentence
        self._error.visible = bool(sentence)
        if sentence:
            self._figures.classes(add="stale")
        else:
            self._figures.classes(remove="stale")

    def _show_figures(self, variant: Variant) -> None:
        state = self._state
        pinned = state.pinned
        if pinned is not None and state.lumped.get(pinned) is None:
            state.lumped.put(pinned, characteristics_of(pinned, "lumped"))
        table = figures_table(
            self._page.preferences,
            state.lumped.get(variant) or (),
            state.corrected.get(variant),
            state.lumped.get(pinned),
        )
        self._title.text = f"{variant.name}{' (changed)' if variant.values else ''}"
        self._figures.content = (
            table_html(table)
            if table.rows
            else '<p class="muted">No figures: the stage has no axis with a drive and a probe.</p>'
        )

    def _show_pinned(self) -> None:
        pinned = self._state.pinned
        self._pinned_row.visible = self._pinned_picture.visible = pinned is not None
        if pinned is None:
            self._drawn_pinned = None
        else:
            changed = f", {len(pinned.values)} parameters changed" if pinned.values else ""
            self._pinned_name.text = f"Pinned: {pinned.name}{changed}"

    async def _look(self) -> None:
        """Continue after a change: history, drawing, sensitivities, and the finer model."""
        state = self._state
        if not self._page.client.has_socket_connection:
            return  # the page was closed, or is reconnecting
        self._undo.set_enabled(state.history.can_undo)
        self._redo.set_enabled(state.history.can_redo)
        self._take_job()
        idle = time.monotonic() - self._changed_at
        is_complete, is_idle = idle > 0.35, idle > 0.8  # a drag can pause [s]
        variant = state.now
        if not is_complete or self._follows or state.lumped.get(variant) is None:
            return
        state.commit()
        if self._drawing:
            return
        if self._drawn_variant != variant:
            drawing = await self._draw(variant, f"now{self._picture.id}")
            self._drawn_variant = variant
            if drawing is not None and variant == state.now:
                self._show_drawing(drawing)
        elif state.pinned is not None and self._drawn_pinned != state.pinned:
            pinned = state.pinned
            drawing = await self._draw(pinned, f"pinned{self._pinned_picture.id}")
            self._drawn_pinned = pinned
            if drawing is not None:
                self._pinned_picture.content = drawing.svg
        elif is_idle and self._job is None:
            self._start_job(variant)

    async def _draw(self, variant: Variant, key: str) -> CheckedDrawing | None:
        self._drawing = True
        try:
            with self._page.show_errors():
                return await asyncio.to_thread(draw_with_issues, variant, key)
        finally:
            self._drawing = False
        return None

    def _show_drawing(self, drawing: CheckedDrawing) -> None:
        self._picture.content = drawing.svg
        self._issues.clear()
        with self._issues:
            for count, issue in enumerate(drawing.issues, start=1):
                ui.label(f"{count}. {issue.message}").classes(f"issue {issue.severity}")

    def _start_job(self, variant: Variant) -> None:
        state, jobs, owner = self._state, self._page.panel.jobs, self._page.session.id
        rows = state.lumped.get(variant) or ()
        if state.slopes.get(variant) is None and state.variables and rows:
            job = jobs.start("sensitivities", slopes_of, variant, rows, owner=owner)
            self._job = ("slopes", variant, job)
        elif state.corrected.get(variant) is None and rows:
            finer = "superelement"
            job = jobs.start(MODEL_WORDS[finer], characteristics_of, variant, finer, owner=owner)
            self._job = ("corrected", variant, job)
        self._activity.text = f"{self._job[2].name} …" if self._job else ""

    def _take_job(self) -> None:
        if self._job is None or not self._job[2].is_over:
            return
        kind, variant, job = self._job
        self._job, self._activity.text = None, ""
        if job.state == "done":
            cache: Any = self._state.slopes if kind == "slopes" else self._state.corrected
            cache.put(variant, job.result)
        elif kind == "corrected":
            # do not compute it again: the figures of this model remain empty
            self._state.corrected.put(variant, ())
            show_error(f"{job.name}: {job.error}")
        if variant == self._state.now:
            self._sliders.show_slopes()
            self._show_figures(variant)


_DEFAULT_FORMATS = ("dxf", "csv")


def ask_file_name(page: Page, variant: Variant) -> None:
    """Ask for a name, save the stage file of a variant, and download it."""
    name = variant.template.stage().name
    if variant.values:
        name = f"{name}-changed"
    with named_dialog("Save a stage file") as dialog, ui.card().classes("dialog"):
        PanelHeading("Save a stage file")
        field = ui.input("Name of the stage", value=name).classes("full-width")

        def save() -> None:
            with page.show_errors():
                stem = file_name((field.value or name).strip())
                content = stage_file(variant, stem).encode("utf-8")
                path = page.panel.folder("design") / f"{stem}.yaml"
                write_whole(path, content)
                ui.download.content(content, path.name)
                ui.notify(f"saved as {path}", type="positive")
                dialog.close()

        with ui.row():
            ui.button("Save", on_click=save)
            quiet_button("Cancel", on_click=dialog.close)
    dialog.open()


def ask_export(page: Page, variant: Variant) -> None:
    """Ask for formats, and export a variant in a worker process."""
    with named_dialog("Export") as dialog, ui.card().classes("dialog"):
        PanelHeading("Export")
        boxes = {
            name: ui.checkbox(f"{name}: {format.about}", value=name in _DEFAULT_FORMATS).props(
                "dense"
            )
            for name, format in FORMATS.items()
        }
        working = ui.column().classes("full-width")

        def start() -> None:
            formats: Sequence[str] = [name for name, box in boxes.items() if box.value]
            if not formats:
                ui.notify("Choose a format", type="warning")
                return
            go.disable()
            folder, owner = page.panel.folder("design"), page.session.id
            job = page.panel.jobs.start(
                "export", export_to_folder, folder, variant, formats, owner=owner
            )
            with working:
                show_job(page, job, finish)

        def finish(job: BackgroundJob) -> None:
            go.enable()
            if job.state == "done":
                path, remarks = job.result
                ui.download.content(path.read_bytes(), path.name)
                with working:
                    for text in remarks:
                        remark(text)

        with ui.row():
            go = ui.button("Export", on_click=start)
            quiet_button("Close", on_click=dialog.close)
    dialog.open()
