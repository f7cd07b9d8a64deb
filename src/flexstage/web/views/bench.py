"""Bench: connect to a stage, monitor it, move it, and record it."""

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
from flexstage.web.sessions import Preferences

if TYPE_CHECKING:
    from flexstage.instruments.catalogue.entries import RunEntry
from collections.abc import Callable
from urllib.parse import urlsplit

from flexstage.instruments.connect import DRIVERS
from flexstage.web.bench.readouts import AxisCard
from flexstage.web.bench.run_forms import PlanForm, RecordForm, WaveformForm
from flexstage.web.bench.state import FIRST_ADDRESS, BenchForms, bench_of, bind_field, user_name
from flexstage.web.design.choice import StageChoice
from flexstage.web.design.state import DesignState
from flexstage.web.jobs import BackgroundJob
from flexstage.web.live_chart import LiveChart
from flexstage.web.page import (
    panel,
    show_job,
)


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


_ON_DISCONNECT = {
    False: "leave the drives as they are",
    True: "ramp the drives to their safe voltages",
}


class ConnectionBar:
    """The connected instrument, connecting and disconnecting, and control.

    Parameters
    ----------
    page
        The page.
    """

    def __init__(self, page: Page) -> None:
        self._page, self._bench = page, bench_of(page)
        self._forms = page.session.state(BenchForms)
        self._connecting = False
        self._area = panel("bench-bar")

    def build(self) -> None:
        """Show the present state."""
        self._area.clear()
        with self._area:
            if self._bench.connected:
                self._area.classes(add="toolbar", remove="connect")
                self._show_connected()
            else:
                self._area.classes(add="connect", remove="toolbar")
                self._form()

    # not connected

    def _form(self) -> None:
        forms = self._forms
        PanelHeading("Connect to a stage")
        self._status = remark("Connecting moves no axis. The simulated stage needs no hardware.")
        forms_by_scheme = {scheme: driver.form for scheme, driver in DRIVERS.items()}
        scheme = urlsplit(forms.address).scheme
        kind = choice(
            {"twin": "Simulated stage (twin)"}
            | {s: f"{s}, for example {form}" for s, form in forms_by_scheme.items() if s != "twin"},
            scheme if scheme in forms_by_scheme else None,
            "Instrument",
        )
        address = bind_field(ui.input("Address"), forms, "address").props("dense outlined")
        kind.on_value_change(
            lambda e: address.set_value(
                FIRST_ADDRESS if e.value == "twin" else forms_by_scheme[e.value]
            )
        )
        StageChoice(self._page, lambda: None)
        bind_field(ui.input("Your name"), forms, "operator").props("dense outlined")
        bind_field(choice(_ON_DISCONNECT, None, "When disconnected"), forms, "ramps_to_safe")
        self._go = ui.button("Connect", on_click=self._connect)
        if self._connecting:
            self._wait()

    def _wait(self) -> None:
        self._go.disable()
        self._status.text = "connecting …"

    async def _connect(self) -> None:
        forms, bench, page = self._forms, self._bench, self._page
        self._connecting = True
        self._wait()

        def connect() -> None:
            bench.connect(
                page.session.id,
                user_name(page),
                forms.address,
                page.session.state(DesignState).now.stage(),
                ramps_to_safe=forms.ramps_to_safe,
            )

        with page.show_errors(self._area):
            try:
                await asyncio.to_thread(connect)
            finally:
                self._connecting = False
                self.build()

    # connected

    def _show_connected(self) -> None:
        bench, device = self._bench, self._bench.device
        if device is None or bench.stage is None:
            return
        identity = device.identity
        parts = (identity.vendor, identity.model, identity.serial_number)
        with ui.element("div"):
            ui.label(" ".join(w for w in parts if w)).classes("instrument")
            status = "Simulated – not measured data" if identity.simulated else "real instrument"
            remark(f"{bench.stage.name} at {bench.address}, {status}")
        ui.space()
        self._control()

    def _control(self) -> None:
        bench, control, session = self._bench, self._bench.control, self._page.session.id
        if control.holds(session):
            text = "You have control of the stage"
            if control.requester:
                text = f"{control.requester} asks for control"
            ui.label(text).classes("control own").props('role="status"')
            if control.requester:
                ui.button("Grant control", on_click=lambda: self._do(control.give, session))
                quiet_button("Keep control", on_click=lambda: self._do(control.keep, session))
            else:
                quiet_button("Release control", on_click=lambda: self._do(control.release, session))
            if bench.device is not None and not bench.device.identity.simulated:
                checkbox = ui.checkbox(
                    "The way of the stage is clear: it may move", value=bench.path_clear
                )
                checkbox.on_value_change(lambda e: self._do(bench.clear, session, bool(e.value)))
            quiet_button("Disconnect", on_click=self._disconnect)
            return
        name = control.name or "No browser"
        suffix = " (browser closed)" if control.name and control.free else ""
        ui.label(f"{name}{suffix} has control: you can only watch").classes("control")
        if control.free:
            ui.button(
                "Take control",
                on_click=lambda: self._do(control.take, session, user_name(self._page)),
            )
        elif control.asks(session):
            remark("You have asked for control")
        else:
            ui.button(
                "Ask for control",
                on_click=lambda: self._do(control.ask, session, user_name(self._page)),
            )

    def _do(self, function: Callable[..., object], *arguments: object) -> None:
        with self._page.show_errors(self._area):
            try:
                function(*arguments)
            finally:
                self.build()

    async def _disconnect(self) -> None:
        with self._page.show_errors(self._area):
            try:
                await asyncio.to_thread(self._bench.disconnect, self._page.session.id)
            finally:
                self.build()


_TABS: dict[str, tuple[str, type[RunForm]]] = {
    "Waveform": ("show_chart", WaveformForm),
    "Record": ("fiber_manual_record", RecordForm),
    "Plan": ("checklist", PlanForm),
    "Runs": ("history", RunList),
}


def build(page: Page) -> None:
    """Build the view."""
    BenchView(page).build()


class BenchView:
    """The view in one page.

    Parameters
    ----------
    page
        The page.
    """

    def __init__(self, page: Page) -> None:
        self._page, self._bench = page, bench_of(page)
        self._forms = page.session.state(BenchForms)
        self._cards: dict[str, AxisCard] = {}
        self._last_state: Any = None
        self._form: Any = None
        self._job: BackgroundJob | None = None

    def build(self) -> None:
        """Build the view."""
        with div("stack") as self._page_area:
            self._bar = ConnectionBar(self._page)
            self._fault = ui.label().classes("issue error").props('role="alert"')
            self._area = div("columns bench")
        self._look()
        ui.timer(0.1, self._look)

    def _look(self) -> None:
        """Update the view: connection, control, readings and runs."""
        bench, session = self._bench, self._page.session.id
        if self._page.client.has_socket_connection:
            bench.control.keep_alive(session)
        control = bench.control
        state = (
            bench.history,
            control.name,
            control.requester,
            control.holds(session),
            control.free,
        )
        if state != self._last_state:
            previous, self._last_state = self._last_state, state
            self._bar.build()
            if previous is None or previous[0] is not bench.history:
                self._rebuild()
        reconnecting = "The connection is lost; flexstage reconnects when the instrument answers: "
        self._fault.text = f"{reconnecting if bench.is_lost else ''}{bench.fault}"
        self._fault.visible = bool(bench.fault)
        for name, card in self._cards.items():
            card.show(
                bench.readings.get(name), has_control=control.holds(session), stale=bench.is_lost
            )
        if self._form is not None:
            self._form.look()
        self._follow_job()

    def _rebuild(self) -> None:
        """Show the connected stage; without one, the list of runs."""
        bench = self._bench
        self._area.clear()
        self._cards.clear()
        self._form = self._job = None
        if bench.device is None or bench.history is None:
            self._page_area.classes(add="apart")
            with self._area, panel():
                PanelHeading("Runs")
                self._form = RunList(self._page, bench, self._show)
                self._form.build()
            with self._area:
                self._make_result()
            return
        self._page_area.classes(remove="apart")
        with self._area:
            with div("stack"):
                self._cards |= {a: AxisCard(self._page, bench, a) for a in bench.device.axes}
                with panel():
                    self._runs()
            with div("stack"):
                with panel():
                    LiveChart(
                        self._page,
                        bench.history,
                        alt_text="Live position and voltage of every axis",
                    )
                self._make_result()

    def _make_result(self) -> None:
        self._result = panel().props('aria-live="polite"')
        self._result.visible = False

    def _show(self, outcome: RunOutcome) -> None:
        self._result.clear()
        self._result.visible = True
        with self._result:
            show_outcome(self._page, outcome)

    def _runs(self) -> None:
        with ui.tabs(on_change=self._open).props("dense no-caps align=left") as tabs:
            for name, (icon, _) in _TABS.items():
                ui.tab(name, icon=icon)
        self._progress = div("full-width doing")
        self._fields = div("run-form")
        tabs.value = self._forms.tab

    def _open(self, event: Any) -> None:
        self._forms.tab = event.value
        self._fields.clear()
        with self._fields, self._page.show_errors():
            self._form = _TABS[event.value][1](self._page, self._bench, self._show)
            self._form.build()

    def _follow_job(self) -> None:
        """Show the present run in every browser, and its results at the end."""
        job = self._bench.job
        if job is self._job or job is None or not self._cards:
            return
        self._job = job
        if job.is_over:
            self._show_end(job)
            return
        self._progress.clear()
        with self._progress:
            show_job(self._page, job)
            self._page.watch(job, self._show_end)

    def _show_end(self, job: BackgroundJob) -> None:
        if job.state == "done":
            self._show(job.result)
            return
        self._result.clear()
        self._result.visible = True
        with self._result:
            PanelHeading(f"{job.name}: stopped" if job.state == "cancelled" else job.name)
            ui.label(
                job.error or "The stage was stopped. The data so far are saved: see Runs"
            ).classes("issue" if job.state == "cancelled" else "issue error")
