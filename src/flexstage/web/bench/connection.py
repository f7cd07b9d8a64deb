"""The top of the bench: what is connected, and who drives it."""

import asyncio
from collections.abc import Callable
from urllib.parse import urlsplit

from nicegui import ui

from flexstage.instruments.connect import DRIVERS
from flexstage.web.bench.state import FIRST_ADDRESS, BenchForms, bench_of, kept, person
from flexstage.web.design.choice import StageChoice
from flexstage.web.design.state import DesignState
from flexstage.web.page import Page, PanelHeading, choice, panel, quiet_button, remark

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

        with page.sentences(self._area):
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
        with self._page.sentences(self._area):
            try:
                function(*arguments)
            finally:
                self.build()

    async def _disconnect(self) -> None:
        with self._page.sentences(self._area):
            try:
                await asyncio.to_thread(self._bench.disconnect, self._page.session.id)
            finally:
                self.build()
