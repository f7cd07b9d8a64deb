"""Bench: connect to a stage, see what it does at every moment, move it, and record it."""

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
from flexstage.web.bench.state import FIRST_ADDRESS, BenchForms, bench_of, kept, person
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

_AFTER = {False: "everything stays as it is", True: "drives go to their safe voltages"}


class ConnectionBar:
    """What is connected, with what ends or begins it, and who drives.

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
        """Show it as it is now."""
        self._area.clear()
        with self._area:
            if self._bench.connected:
                self._area.classes(add="toolbar", remove="connect")
                self._connected()
            else:
                self._area.classes(add="connect", remove="toolbar")
                self._form()

    # to connect

    def _form(self) -> None:
        forms = self._forms
        PanelHeading("Connect to a stage")
        self._said = remark(
            "Connecting moves nothing. The twin needs nothing of your own: connect, and try it."
        )
        kinds = {scheme: driver.form for scheme, driver in DRIVERS.items()}
        scheme = urlsplit(forms.address).scheme
        kind = choice(
            {"twin": "The twin: a simulated stage"}
            | {s: f"{s}: as {form}" for s, form in kinds.items() if s != "twin"},
            scheme if scheme in kinds else None,
            "Instrument",
        )
        address = kept(ui.input("Address"), forms, "address").props("dense outlined")
        kind.on_value_change(
            lambda e: address.set_value(FIRST_ADDRESS if e.value == "twin" else kinds[e.value])
        )
        StageChoice(self._page, lambda: None)
        kept(ui.input("Your name"), forms, "operator").props("dense outlined")
        kept(choice(_AFTER, None, "When disconnected"), forms, "leads_to_safe")
        self._go = ui.button("Connect", on_click=self._connect)
        if self._connecting:
            self._wait()

    def _wait(self) -> None:
        self._go.disable()
        self._said.text = "connecting …"

    async def _connect(self) -> None:
        forms, bench, page = self._forms, self._bench, self._page
        self._connecting = True
        self._wait()

        def work() -> None:
            bench.connect(
                page.session.id,
                person(page),
                forms.address,
                page.session.state(DesignState).now.stage(),
                leads_to_safe=forms.leads_to_safe,
            )

        with page.show_errors(self._area):
            try:
                await asyncio.to_thread(work)
            finally:
                self._connecting = False
                self.build()

    # connected

    def _connected(self) -> None:
        bench, device = self._bench, self._bench.device
        if device is None or bench.stage is None:
            return
        identity = device.identity
        words = (identity.vendor, identity.model, identity.serial_number)
        with ui.element("div"):
            ui.label(" ".join(w for w in words if w)).classes("instrument")
            kind = "simulated: nothing of it is a measurement" if identity.simulated else "real"
            remark(f"{bench.stage.name} at {bench.address}, {kind}")
        ui.space()
        self._control()

    def _control(self) -> None:
        bench, control, me = self._bench, self._bench.control, self._page.session.id
        if control.holds(me):
            said = "You drive the stage"
            if control.asker:
                said = f"{control.asker} asks for control"
            ui.label(said).classes("control own").props('role="status"')
            if control.asker:
                ui.button("Hand over", on_click=lambda: self._do(control.give, me))
                quiet_button("Keep it", on_click=lambda: self._do(control.keep, me))
            else:
                quiet_button("Release control", on_click=lambda: self._do(control.release, me))
            if bench.device is not None and not bench.device.identity.simulated:
                clear = ui.checkbox("Its way is clear: it may move", value=bench.cleared)
                clear.on_value_change(lambda e: self._do(bench.clear, me, bool(e.value)))
            quiet_button("Disconnect", on_click=self._disconnect)
            return
        name = control.name or "nobody"
        gone = ", whose browser is gone" if control.name and control.free else ""
        ui.label(f"{name} drives{gone}: you see everything and drive nothing").classes("control")
        if control.free:
            ui.button(
                "Take control", on_click=lambda: self._do(control.take, me, person(self._page))
            )
        elif control.asks(me):
            remark("you asked for control")
        else:
            ui.button(
                "Ask for control", on_click=lambda: self._do(control.ask, me, person(self._page))
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
    """Make the view."""
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
        self._shown: Any = None
        self._form: Any = None
        self._job: BackgroundJob | None = None

    def build(self) -> None:
        """Make the view."""
        with div("stack") as self._whole:
            self._bar = ConnectionBar(self._page)
            self._trouble = ui.label().classes("issue error").props('role="alert"')
            self._area = div("columns bench")
        self._look()
        ui.timer(0.1, self._look)

    def _look(self) -> None:
        """Follow the bench: its link, its control, its readings, its runs."""
        bench, me = self._bench, self._page.session.id
        if self._page.client.has_socket_connection:
            bench.control.seen(me)
        control = bench.control
        present = (bench.history, control.name, control.asker, control.holds(me), control.free)
        if present != self._shown:
            before, self._shown = self._shown, present
            self._bar.build()
            if before is None or before[0] is not bench.history:
                self._anew()
        again = "The link is lost, and opened again when the instrument answers: "
        self._trouble.text = f"{again if bench.lost else ''}{bench.trouble}"
        self._trouble.visible = bool(bench.trouble)
        for name, card in self._cards.items():
            card.show(bench.readings.get(name), drives=control.holds(me), stale=bench.lost)
        if self._form is not None:
            self._form.look()
        self._follow_job()

    def _anew(self) -> None:
        """Show the stage that is connected now, or what there is to do where none is."""
        bench = self._bench
        self._area.clear()
        self._cards.clear()
        self._form = self._job = None
        if bench.device is None or bench.history is None:
            self._whole.classes(add="apart")
            with self._area, panel():
                PanelHeading("Runs")
                self._form = RunList(self._page, bench, self._show)
                self._form.build()
            with self._area:
                self._make_result()
            return
        self._whole.classes(remove="apart")
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
                        alt_text="Position and voltage of every axis as they are read",
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
        self._doing = div("full-width doing")
        self._fields = div("run-form")
        tabs.value = self._forms.tab

    def _open(self, event: Any) -> None:
        self._forms.tab = event.value
        self._fields.clear()
        with self._fields, self._page.show_errors():
            self._form = _TABS[event.value][1](self._page, self._bench, self._show)
            self._form.build()

    def _follow_job(self) -> None:
        """Show the run that goes on to everybody, and what it gave when it has ended."""
        job = self._bench.job
        if job is self._job or job is None or not self._cards:
            return
        self._job = job
        if job.is_over:
            self._ended(job)
            return
        self._doing.clear()
        with self._doing:
            show_job(self._page, job)
            self._page.watch(job, self._ended)

    def _ended(self, job: BackgroundJob) -> None:
        if job.state == "done":
            self._show(job.result)
            return
        self._result.clear()
        self._result.visible = True
        with self._result:
            PanelHeading(f"{job.name}: stopped" if job.state == "cancelled" else job.name)
            ui.label(
                job.error or "The stage was stopped; what was recorded until then is kept: see Runs"
            ).classes("issue" if job.state == "cancelled" else "issue error")
