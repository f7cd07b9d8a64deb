"""The axes at the bench: what each reads, how far it may go, and the buttons that move it."""

import asyncio
import math
from collections.abc import Callable
from concurrent.futures import CancelledError, Future
from typing import Any

from nicegui import ui
from nicegui.elements.mixins.disableable_element import DisableableElement

from flexstage.instruments.protocol import Capability
from flexstage.quantities.quantity import Quantity
from flexstage.stage.limits import Range
from flexstage.web.bench.instrument import AxisReading
from flexstage.web.bench.link import BenchLink
from flexstage.web.bench.state import BenchForms
from flexstage.web.live_history import POSITION, VOLTAGE
from flexstage.web.page import Page, PanelHeading, div, panel, remark

#: Steps that are offered, in the usual unit of the quantity.
_STEPS = {"V": (0.1, 1.0, 5.0, 20.0), "m": (0.01, 0.1, 1.0, 10.0)}
_USUAL = {"V": 5.0, "m": 1.0}
#: Last digit that is shown [V, m].
_DIGIT = {"V": 0.01, "m": 1e-9}


def shown_number(quantity: Quantity, value: float) -> str:
    """Return a reading with as many decimals as its last digit has, whatever its size.

    Examples
    --------
    >>> shown_number(POSITION, 12.3456e-6), shown_number(VOLTAGE, -0.001)
    ('12.346', '0.00')
    """
    if not math.isfinite(value):
        return "–"
    decimals = max(0, round(-math.log10(_DIGIT[quantity.unit] * quantity.factor)))
    text = f"{value * quantity.factor:.{decimals}f}"
    text = text.removeprefix("-") if not float(text) else text
    return text.replace("-", "−")


class AxisCard:
    """One axis.

    Parameters
    ----------
    page
        The page.
    bench
        The bench.
    name
        The axis.
    """

    def __init__(self, page: Page, bench: BenchLink, name: str) -> None:
        self._page, self._bench, self._name = page, bench, name
        self._forms = page.session.state(BenchForms)
        device = bench.device
        assert device is not None
        self._axis = device.axes[name]
        self._closed: bool | None = None
        self._stale = False
        self._build()

    def _build(self) -> None:
        can = self._axis.capabilities
        with panel("axis").props("tabindex=0") as card:
            self._card = card
            card.props["aria-label"] = (
                f"Axis {self._name}: the arrow keys step it while this has the focus"
            )
            with ui.row().classes("items-center heading"):
                PanelHeading(f"Axis {self._name}")
                self._moving = ui.label().classes("state")
                self._loop = ui.label().classes("state")
                ui.space()
                self._servo = ui.switch("Position control", on_change=self._switched)
                # where there is a choice, its switch says which one is made
                self._servo.visible = {Capability.CLOSED_LOOP, Capability.OPEN_LOOP} <= can
                self._loop.visible = not self._servo.visible
            limits = self._axis.limits
            self._shown = div("readouts")
            with self._shown:
                shown = self._page.preferences.shown
                self._position = _Readout(shown(POSITION), limits.position, "position control")
                self._voltage = None
                if Capability.OPEN_LOOP in can:
                    self._voltage = _Readout(shown(VOLTAGE), limits.voltage, "voltage")
            self._controls = div("drive")
        for key, sign in (("left", -1), ("right", 1), ("down", -1), ("up", 1)):
            card.on(f"keydown.{key}.self.prevent", self._stepper(sign))

    @property
    def _quantity(self) -> Quantity:
        """What it is moved in: positions under control, else voltages."""
        return self._page.preferences.shown(POSITION if self._closed else VOLTAGE)

    def show(self, reading: AxisReading | None, *, drives: bool, stale: bool = False) -> None:
        """Show a reading, pale where it is `stale`; the buttons are alive for who drives."""
        if reading is None:
            return
        if self._stale != stale:
            self._stale = stale
            self._shown.classes(**{"add" if stale else "remove": "stale"})
        self._position.show(reading.position)
        if self._voltage is not None:
            self._voltage.show(reading.voltage)
        self._moving.text = "moves" if reading.moving else "at rest"
        on = reading.closed_loop
        self._loop.text = "closed loop" if on else "open loop"
        if self._closed != on:
            self._closed = on
            self._servo.set_value(on)
            self._build_controls()
        for element in self._driven:
            element.set_enabled(drives)

    def _build_controls(self) -> None:
        self._controls.clear()
        #: What is alive for who drives.
        self._driven: list[DisableableElement] = [self._servo]
        with self._controls:
            with div("together"):
                self._build_step(self._quantity)
            with div("together to"):
                self._build_target(self._quantity)

    def _build_step(self, quantity: Quantity) -> None:
        unit = quantity.unit
        relative = quantity.factor / {"V": 1.0, "m": 1e6}[unit]
        steps = {s * relative / quantity.factor: f"{s * relative:g}" for s in _STEPS[unit]}
        key = f"{self._name} {unit}"
        usual = _USUAL[unit] * relative / quantity.factor
        before = self._forms.steps.get(key, usual)
        remark(f"Step, {quantity.shown_unit}")
        choice = ui.toggle(steps, value=before if before in steps else usual)
        choice.props("dense no-caps").props["aria-label"] = f"Step of axis {self._name}"
        choice.on_value_change(lambda e: self._forms.steps.update({key: e.value}))
        self._step = choice
        for icon, sign, word in (("remove", -1, "down"), ("add", 1, "up")):
            button = ui.button(icon=icon, on_click=self._stepper(sign)).props("dense")
            button.props["aria-label"] = f"Step axis {self._name} {word}"
            self._driven.append(button)

    def _build_target(self, quantity: Quantity) -> None:
        target = ui.number(f"Go to, {quantity.shown_unit}").props("dense outlined")

        async def go() -> None:
            if target.value is not None:
                value = float(target.value) / quantity.factor
                await self._told(lambda me: self._bench.go(me, self._name, value))

        target.on("keydown.enter", go)
        self._driven.append(ui.button("Go", on_click=go))

    def _stepper(self, sign: int) -> Callable[[], Any]:
        async def step() -> None:
            size = sign * float(self._step.value)
            await self._told(lambda me: self._bench.jog(me, self._name, size))

        return step

    async def _switched(self, event: Any) -> None:
        on = bool(event.value)
        if on != self._closed:
            await self._told(lambda me: self._bench.set_closed_loop(me, self._name, on))
            reading = self._bench.readings.get(self._name)
            if reading is not None:
                # what was refused is not shown as done; what was done is read a little later
                self._closed = None

    async def _told(self, command: Callable[[str], "Future[Any]"]) -> None:
        with self._page.show_errors(self._card):
            try:
                await asyncio.wrap_future(command(self._page.session.id))
            except (CancelledError, asyncio.CancelledError):
                ui.notify("stopped before it began", type="warning")


class _Readout:
    """A large number with its unit, and where it is between its limits, those `of` something."""

    def __init__(self, quantity: Quantity, limits: Range | None, of: str) -> None:
        self._quantity, self._limits = quantity, limits
        with div("readout"):
            remark(quantity.label)
            with div("value"):
                self._number = ui.label("–").classes("big")
                ui.label(quantity.shown_unit).classes("unit")
            if limits is None:
                remark("no limits are known")
                self._mark = None
                return
            with div("range").props("aria-hidden=true"):
                self._mark = div("mark")
            with div("ends muted small"):
                low, high = (shown_number(quantity, end) for end in limits)
                ui.label(low)
                ui.label(f"limits, {of}")
                ui.label(high)

    def show(self, value: float) -> None:
        """Show a value."""
        text = shown_number(self._quantity, value)
        if text == self._number.text:
            return
        self._number.text = text
        if self._mark is not None and self._limits is not None and math.isfinite(value):
            low, high = self._limits
            share = 100.0 * min(max((value - low) / (high - low), 0.0), 1.0)
            self._mark.style(f"left: {share:.1f}%")
