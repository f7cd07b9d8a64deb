"""What a run at the bench gave, and what earlier ones have left."""

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
    earlier,
    interrupted_runs,
    loop_figures,
    recovered,
    run_plan_file,
)
from flexstage.web.figures import chart, show_table
from flexstage.web.live_history import POSITION, VOLTAGE
from flexstage.web.page import Page, PanelHeading, choice, div, quiet_button, remark
from flexstage.web.preferences import Preferences

if TYPE_CHECKING:
    from flexstage.instruments.catalogue.entries import RunEntry


def show_outcome(page: Page, outcome: RunOutcome) -> None:
    """Show what a run gave: the loop or the record, figures of a plan, and its files."""
    with ui.row().classes("items-center heading"):
        PanelHeading(run_name(outcome.folder))
        ui.space()
        file, what = outcome.file, "report" if outcome.plan is not None else "record"
        quiet_button(
            f"Download the {what}",
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
            ui.label(_loop_words(outcome.record, outcome.loop))
        with div("outcome"):
            if outcome.loop is not None:
                _loop(page.preferences, outcome.record, outcome.loop)
            # the voltage that was read lies upon the one that was commanded
            hidden = "command" if outcome.loop and outcome.loop[0] != "command" else ""
            _over_time(page.preferences, outcome.record, hidden)
    for note in outcome.notes:
        remark(note)
    remark(f"It lies in {outcome.folder}")


def _shown(preferences: Preferences, unit: str) -> Quantity:
    return preferences.shown(VOLTAGE if unit == "V" else POSITION)


def _titled(text: str) -> dict[str, Any]:
    return {"title": {"text": text}}


def _thin(values: Array) -> Array:
    return values[:: max(1, -(-values.size // 4000))]  # more points are not seen


def _loop_words(record: Record, loop: tuple[str, str]) -> str:
    found = loop_figures(record, loop)
    if found is None:
        return "No whole cycle, of which a loop could be told"
    figures, count = found
    stroke = float(np.ptp(record.channel(loop[1]).values))
    said = (
        f"Loop over {'what was wanted' if loop[0] == REFERENCE else 'the command'}: "
        f"{value_text(figures.loop_width, 'length', 3)} wide, "
        f"{100.0 * figures.loop_width / stroke:.2g} % of the stroke, over {count} whole "
        f"cycle{'s' if count > 1 else ''}"
    )
    if np.isfinite(figures.rms):
        rms, most = (value_text(v, "length", 3) for v in (figures.rms, figures.largest))
        said += f"; away from what was wanted by {rms} rms, {most} at most"
    return said


def _loop(preferences: Preferences, record: Record, loop: tuple[str, str]) -> None:
    x, y = (record.channel(name) for name in loop)
    over, along = (_shown(preferences, c.unit) for c in (x, y))
    trace = {
        "x": (_thin(x.values) * over.factor).tolist(),
        "y": (_thin(y.values) * along.factor).tolist(),
        "mode": "lines",
        "name": y.name,
    }
    name = f"Wanted {over.label.lower()}" if x.name == REFERENCE else over.label
    layout = {
        "xaxis": _titled(f"{name} [{over.shown_unit}]"),
        "yaxis": _titled(f"{along.label} of {y.name} [{along.shown_unit}]"),
        "showlegend": False,
    }
    chart([trace], layout, f"The recorded loop: {along.label} of {y.name} over {name}")


def _over_time(preferences: Preferences, record: Record, hidden: str) -> None:
    """Show columns over time, lengths above and voltages below."""
    traces: list[dict[str, Any]] = []
    layout: dict[str, Any] = {
        "xaxis": _titled("Time [s]"),
        "legend": {"orientation": "h", "yref": "container", "y": 1.0, "yanchor": "top"},
        "margin": {"l": 64, "r": 16, "t": 58, "b": 48},
    }
    units = list(dict.fromkeys(c.unit for c in record.channels))
    t = _thin(np.asarray(record.time)).tolist()
    for k, unit in enumerate(units):
        quantity, number = _shown(preferences, unit), "" if k == 0 else str(k + 1)
        high = 1.0 - k / len(units)
        layout[f"yaxis{number}"] = {
            **_titled(f"{quantity.label} [{quantity.shown_unit}]"),
            "domain": [high - 1.0 / len(units) + (0.06 if k + 1 < len(units) else 0.0), high],
        }
        for channel in record.channels:
            if channel.unit == unit and channel.name != hidden:
                y = (_thin(channel.values) * quantity.factor).tolist()
                traces.append(
                    {"x": t, "y": y, "mode": "lines", "name": channel.name, "yaxis": f"y{number}"}
                )
    layout["xaxis"]["anchor"] = f"y{'' if len(units) == 1 else len(units)}"
    chart(traces, layout, "What was recorded, over time")


class RunList(RunForm):
    """The runs of the catalogue, and what interrupted ones have left."""

    def build(self) -> None:
        """Make the list; it is read when it is shown."""
        self._left = div("full-width issues")
        self._where = ui.label().classes("small")
        with ui.row().classes("items-center full-width"):
            self._choice = choice({}, None, "Open a run", self._open).classes("run-choice")
            quiet_button("Look again", on_click=self.read)
        self._list = div("full-width")
        ui.timer(0.0, self.read, once=True)

    async def read(self) -> None:
        """Read both."""
        left = await asyncio.to_thread(interrupted_runs, self._page.panel.folder("bench"))
        self._left.clear()
        with self._left:
            # what goes on looks like what was interrupted
            for each in () if self._bench.busy else left:
                self._row(each)
        self._list.clear()
        try:
            found, where = await asyncio.to_thread(_listed)
        except FlexstageError as error:
            found, self._where.text = [], str(error)
        else:
            self._where.text = f"{'The latest runs' if found else 'No run yet'} in {where}"
        self._entries = {entry.identifier: entry for entry in found}
        self._choice.set_options({key: _name(entry) for key, entry in self._entries.items()})
        self._choice.visible = bool(found)
        if found:
            with self._list:
                show_table(runs_table(found, ""))

    def _row(self, left: InterruptedRun) -> None:
        with ui.row().classes("issue items-center"):
            name = left.path.name if left.plan else left.path.parent.parent.name
            ui.label(f"{name}: interrupted, {left.about}")
            ui.space()
            if left.plan is None:
                quiet_button("Recover", on_click=lambda: self._recover(left.path)).props("dense")
            else:
                quiet_button("Go on", on_click=lambda: self._resume(left)).props("dense")

    async def _open(self, event: Any) -> None:
        entry = self._entries.get(event.value)
        if entry is not None:
            with self._page.show_errors():
                self._show(await asyncio.to_thread(earlier, entry))

    async def _recover(self, stream: Path) -> None:
        with self._page.show_errors():
            target = await asyncio.to_thread(recovered, stream)
            ui.notify(f"recovered as {target}", type="positive")
        await self.read()

    def _resume(self, left: InterruptedRun) -> None:
        with self._page.show_errors():
            given = (self._about(), str(left.plan), left.path, None, self._bench.locked)
            self._run(f"plan {left.path.name}", run_plan_file, *given, moves=True)


def _name(entry: "RunEntry") -> str:
    return f"{shown_time(entry.started)}, {run_name(Path(entry.folder))} {entry.step}".rstrip()


def run_name(folder: Path) -> str:
    """Return what a run is called: its folder without the time before it."""
    return re.sub(r"^\d{8}T\d{6}Z-", "", folder.name)


def _listed() -> "tuple[list[RunEntry], str]":
    from flexstage.instruments.catalogue.catalogue import Catalogue

    with Catalogue.open(None, make=False) as opened:
        return list(opened.runs(limit=20)), opened.address
