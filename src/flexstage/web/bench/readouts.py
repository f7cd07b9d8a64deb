"""Axes at the bench: readings, limits, and controls for motion."""

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

#: Selectable steps, in V and µm.
_STEPS = {"V": (0.1, 1.0, 5.0, 20.0), "m": (0.01, 0.1, 1.0, 10.0)}
_DEFAULT_STEP = {"V": 5.0, "m": 1.0}
#: Last displayed digit [V, m].
_DIGIT = {"V": 0.01, "m": 1e-9}


def shown_number(quantity: Quantity, value: float) -> str:
    """Return a reading with a fixed number of decimals.

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
    """The card of an axis at the bench.

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
        self._closed_loop: bool | None = None
        self._stale = False
        self._build()

    def _build(self) -> None:
        capabilities = self._axis.capabilities
        with panel("axis").props("tabindex=0") as card:
            self._card = card
            card.props["aria-label"] = (
                f"Axis {self._name}: the arrow keys step it while this card has the focus"
            )
            with ui.row().classes("items-center heading"):
                PanelHeading(f"Axis {self._name}")
                self._moving = ui.label().classes("state")
                self._loop = ui.label().classes("state")
                ui.space()
                self._servo = ui.switch("Position control", on_change=self._switch)
                # with both modes, the switch shows the present one
                self._servo.visible = {Capability.CLOSED_LOOP, Capability.OPEN_LOOP} <= capabilities
                self._loop.visible = not self._servo.visible
            limits = self._axis.limits
            self._readouts = div("readouts")
            with self._readouts:
                display = self._page.preferences.displayed
                self._position = _Readout(display(POSITION), limits.position, "position control")
                self._voltage = None
                if Capability.OPEN_LOOP in capabilities:
                    self._voltage = _Readout(display(VOLTAGE), limits.voltage, "voltage")
            self._controls = div("drive")
        for key, sign in (("left", -1), ("right", 1), ("down", -1), ("up", 1)):
            card.on(f"keydown.{key}.self.prevent", self._stepper(sign))

    @property
    def _quantity(self) -> Quantity:
        """Quantity of commands: position in closed loop, else voltage."""
        return self._page.preferences.displayed(POSITION if self._closed_loop else VOLTAGE)

    def show(self, reading: AxisReading | None, *, has_control: bool, stale: bool = False) -> None:
        """Show a reading, pale if `stale`; the controls need `has_control`."""
        if reading is None:
            return
        if self._stale != stale:
            self._stale = stale
            self._readouts.classes(**{"add" if stale else "remove": "stale"})
        self._position.show(reading.position)
        if self._voltage is not None:
            self._voltage.show(reading.voltage)
        self._moving.text = "moving" if reading.moving else "at rest"
        is_on = reading.closed_loop
        self._loop.text = "closed loop" if is_on else "open loop"
        if self._closed_loop != is_on:
            self._closed_loop = is_on
            self._servo.set_value(is_on)
            self._build_controls()
        for element in self._inputs:
            element.set_enabled(has_control)

    def _build_controls(self) -> None:
        self._controls.clear()
        #: Controls that need control of the stage.
        self._inputs: list[DisableableElement] = [self._servo]
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
        default = _DEFAULT_STEP[unit] * relative / quantity.factor
        previous = self._forms.steps.get(key, default)
        remark(f"Step [{quantity.shown_unit}]")
        choice = ui.toggle(steps, value=previous if previous in steps else default)
        choice.props("dense no-caps").props["aria-label"] = f"Step of axis {self._name}"
        choice.on_value_change(lambda e: self._forms.steps.update({key: e.value}))
        self._step = choice
        for icon, sign, direction in (("remove", -1, "down"), ("add", 1, "up")):
            button = ui.button(icon=icon, on_click=self._stepper(sign)).props("dense")
            button.props["aria-label"] = f"Step axis {self._name} {direction}"
            self._inputs.append(button)

    def _build_target(self, quantity: Quantity) -> None:
        target = ui.number(f"Target [{quantity.shown_unit}]").props("dense outlined")

        async def go() -> None:
            if target.value is not None:
                value = float(target.value) / quantity.factor
                await self._send(lambda me: self._bench.go(me, self._name, value))

        target.on("keydown.enter", go)
        self._inputs.append(ui.button("Go", on_click=go))

    def _stepper(self, sign: int) -> Callable[[], Any]:
        async def step() -> None:
            size = sign * float(self._step.value)
            await self._send(lambda me: self._bench.jog(me, self._name, size))

        return step

    async def _switch(self, event: Any) -> None:
        is_on = bool(event.value)
        if is_on != self._closed_loop:
            await self._send(lambda me: self._bench.set_closed_loop(me, self._name, is_on))
            reading = self._bench.readings.get(self._name)
            if reading is not None:
                # the next reading shows the real state of the switch
                self._closed_loop = None

    async def _send(self, command: Callable[[str], "Future[Any]"]) -> None:
        with self._page.show_errors(self._card):
            try:
                await asyncio.wrap_future(command(self._page.session.id))
            except (CancelledError, asyncio.CancelledError):
                ui.notify("stopped before it started", type="warning")


class _Readout:
    """A large number with its unit, and its place between the limits of a mode."""

    def __init__(self, quantity: Quantity, limits: Range | None, mode: str) -> None:
        self._quantity, self._limits = quantity, limits
        with div("readout"):
            remark(quantity.label)
            with div("value"):
                self._number = ui.label("–").classes("big")
                ui.label(quantity.shown_unit).classes("unit")
            if limits is None:
                remark("limits unknown")
                self._mark = None
                return
            with div("range").props("aria-hidden=true"):
                self._mark = div("mark")
            with div("ends muted small"):
                low, high = (shown_number(quantity, end) for end in limits)
                ui.label(low)
                ui.label(f"limits, {mode}")
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
