"""Bench: connect to a stage, monitor it, move it, and record it."""

import asyncio
from collections.abc import Callable
from typing import Any
from urllib.parse import urlsplit

from nicegui import ui

from flexstage.instruments.connect import DRIVERS
from flexstage.web.bench.outcome import RunList, show_outcome
from flexstage.web.bench.readouts import AxisCard
from flexstage.web.bench.run_forms import PlanForm, RecordForm, RunForm, WaveformForm
from flexstage.web.bench.runs import RunOutcome
from flexstage.web.bench.state import FIRST_ADDRESS, BenchForms, bench_of, bind_field, user_name
from flexstage.web.design.choice import StageChoice
from flexstage.web.design.state import DesignState
from flexstage.web.jobs import BackgroundJob
from flexstage.web.live_chart import LiveChart
from flexstage.web.page import (
    Page,
    PanelHeading,
    choice,
    div,
    panel,
    quiet_button,
    remark,
    show_job,
)

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
