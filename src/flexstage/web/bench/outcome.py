"""Results of a run at the bench, and the list of earlier and interrupted runs."""

import asyncio
import re
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from nicegui import ui

from flexstage.base.arrays import Array
from flexstage.base.errors import FlexstageError
from flexstage.quantities.quantity import Quantity
from flexstage.records import Record
from flexstage.report.run import figures_table, runs_table, shown_time
from flexstage.report.tables import value_text
from flexstage.web.bench.run_forms import RunForm
from flexstage.web.bench.runs import (
    REFERENCE,
    InterruptedRun,
    RunOutcome,
    interrupted_runs,
    loop_figures,
    open_run,
    recover_stream,
    run_plan_file,
)
from flexstage.web.figures import chart, show_table
from flexstage.web.live_history import POSITION, VOLTAGE
from flexstage.web.page import Page, PanelHeading, choice, div, quiet_button, remark
from flexstage.web.preferences import Preferences

if TYPE_CHECKING:
    from flexstage.instruments.catalogue.entries import RunEntry


def show_outcome(page: Page, outcome: RunOutcome) -> None:
    """Show the results of a run: loop or record, figures of a plan, and files."""
    with ui.row().classes("items-center heading"):
        PanelHeading(run_name(outcome.folder))
        ui.space()
        file, kind = outcome.file, "report" if outcome.plan is not None else "record"
        quiet_button(
            f"Download the {kind}",
            on_click=lambda: ui.download.content(file.read_bytes(), file.name),
        )
    if outcome.plan is not None:
        if outcome.plan.figures:
            show_table(figures_table(outcome.plan))
        for step in outcome.plan.steps:
            if step.line:
                ui.label(step.line).classes("small")
    if outcome.record is not None:
        if outcome.loop is not None:
            ui.label(_loop_text(outcome.record, outcome.loop))
        with div("outcome"):
            if outcome.loop is not None:
                _loop(page.preferences, outcome.record, outcome.loop)
            # the measured voltage covers the command
            hidden = "command" if outcome.loop and outcome.loop[0] != "command" else ""
            _over_time(page.preferences, outcome.record, hidden)
    for note in outcome.notes:
        remark(note)
    remark(f"Folder: {outcome.folder}")


def _display_quantity(preferences: Preferences, unit: str) -> Quantity:
    return preferences.displayed(VOLTAGE if unit == "V" else POSITION)


def _axis(text: str) -> dict[str, Any]:
    return {"title": {"text": text}}


def _thin(values: Array) -> Array:
    return values[:: max(1, -(-values.size // 4000))]  # more points are not visible


def _loop_text(record: Record, loop: tuple[str, str]) -> str:
    result = loop_figures(record, loop)
    if result is None:
        return "No complete cycle, so there is no loop width"
    figures, count = result
    stroke = float(np.ptp(record.channel(loop[1]).values))
    text = (
        f"Loop over {'the reference' if loop[0] == REFERENCE else 'the command'}: "
        f"{value_text(figures.loop_width, 'length', 3)} wide, "
        f"{100.0 * figures.loop_width / stroke:.2g} % of the stroke, {count} complete "
        f"cycle{'s' if count > 1 else ''}"
    )
    if np.isfinite(figures.rms):
        rms, largest = (value_text(v, "length", 3) for v in (figures.rms, figures.largest))
        text += f"; tracking error {rms} rms, {largest} at most"
    return text


def _loop(preferences: Preferences, record: Record, loop: tuple[str, str]) -> None:
    x, y = (record.channel(name) for name in loop)
    over, along = (_display_quantity(preferences, c.unit) for c in (x, y))
    trace = {
        "x": (_thin(x.values) * over.factor).tolist(),
        "y": (_thin(y.values) * along.factor).tolist(),
        "mode": "lines",
        "name": y.name,
    }
    name = f"Reference {over.label.lower()}" if x.name == REFERENCE else over.label
    layout = {
        "xaxis": _axis(f"{name} [{over.shown_unit}]"),
        "yaxis": _axis(f"{along.label} of {y.name} [{along.shown_unit}]"),
        "showlegend": False,
    }
    chart([trace], layout, f"The recorded loop: {along.label} of {y.name} over {name}")


def _over_time(preferences: Preferences, record: Record, hidden: str) -> None:
    """Show the columns over time, lengths above voltages."""
    traces: list[dict[str, Any]] = []
    layout: dict[str, Any] = {
        "xaxis": _axis("Time [s]"),
        "legend": {"orientation": "h", "yref": "container", "y": 1.0, "yanchor": "top"},
        "margin": {"l": 64, "r": 16, "t": 58, "b": 48},
    }
    units = list(dict.fromkeys(c.unit for c in record.channels))
    t = _thin(np.asarray(record.time)).tolist()
    for k, unit in enumerate(units):
        quantity, number = _display_quantity(preferences, unit), "" if k == 0 else str(k + 1)
        high = 1.0 - k / len(units)
        layout[f"yaxis{number}"] = {
            **_axis(f"{quantity.label} [{quantity.shown_unit}]"),
            "domain": [high - 1.0 / len(units) + (0.06 if k + 1 < len(units) else 0.0), high],
        }
        for channel in record.channels:
            if channel.unit == unit and channel.name != hidden:
                y = (_thin(channel.values) * quantity.factor).tolist()
                traces.append(
                    {"x": t, "y": y, "mode": "lines", "name": channel.name, "yaxis": f"y{number}"}
                )
    layout["xaxis"]["anchor"] = f"y{'' if len(units) == 1 else len(units)}"
    chart(traces, layout, "The record over time")


class RunList(RunForm):
    """The runs of the catalogue, and interrupted runs."""

    def build(self) -> None:
        """Build the list; it is read when the tab is opened."""
        self._interrupted = div("full-width issues")
        self._catalogue_label = ui.label().classes("small")
        with ui.row().classes("items-center full-width"):
            self._choice = choice({}, None, "Open a run", self._open).classes("run-choice")
            quiet_button("Refresh", on_click=self.read)
        self._list = div("full-width")
        ui.timer(0.0, self.read, once=True)

    async def read(self) -> None:
        """Read the catalogue and the interrupted runs."""
        interrupted = await asyncio.to_thread(interrupted_runs, self._page.panel.folder("bench"))
        self._interrupted.clear()
        with self._interrupted:
            # a run in progress looks like an interrupted one
            for run in () if self._bench.busy else interrupted:
                self._row(run)
        self._list.clear()
        try:
            entries, address = await asyncio.to_thread(_latest_runs)
        except FlexstageError as error:
            entries, self._catalogue_label.text = [], str(error)
        else:
            self._catalogue_label.text = (
                f"{'The latest runs' if entries else 'No run yet'} in {address}"
            )
        self._entries = {entry.identifier: entry for entry in entries}
        self._choice.set_options({key: _name(entry) for key, entry in self._entries.items()})
        self._choice.visible = bool(entries)
        if entries:
            with self._list:
                show_table(runs_table(entries, ""))

    def _row(self, run: InterruptedRun) -> None:
        with ui.row().classes("issue items-center"):
            name = run.path.name if run.plan else run.path.parent.parent.name
            ui.label(f"{name}: interrupted, {run.about}")
            ui.space()
            if run.plan is None:
                quiet_button("Recover", on_click=lambda: self._recover(run.path)).props("dense")
            else:
                quiet_button("Resume", on_click=lambda: self._resume(run)).props("dense")

    async def _open(self, event: Any) -> None:
        entry = self._entries.get(event.value)
        if entry is not None:
            with self._page.show_errors():
                self._show(await asyncio.to_thread(open_run, entry))

    async def _recover(self, stream: Path) -> None:
        with self._page.show_errors():
            target = await asyncio.to_thread(recover_stream, stream)
            ui.notify(f"recovered as {target}", type="positive")
        await self.read()

    def _resume(self, run: InterruptedRun) -> None:
        with self._page.show_errors():
            arguments = (self._about(), str(run.plan), run.path, None, self._bench.lock_name)
            self._run(f"plan {run.path.name}", run_plan_file, *arguments, moves=True)


def _name(entry: "RunEntry") -> str:
    return f"{shown_time(entry.started)}, {run_name(Path(entry.folder))} {entry.step}".rstrip()


def run_name(folder: Path) -> str:
    """Return the name of a run: its folder without the time."""
    return re.sub(r"^\d{8}T\d{6}Z-", "", folder.name)


def _latest_runs() -> "tuple[list[RunEntry], str]":
    from flexstage.instruments.catalogue.catalogue import Catalogue

    with Catalogue.open(None, make=False) as catalogue:
        return list(catalogue.runs(limit=20)), catalogue.address
