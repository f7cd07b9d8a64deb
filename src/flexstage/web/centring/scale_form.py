"""The fields of the view Centring that say what the scale is, and how its records are read."""

from collections.abc import Callable
from typing import Any

from nicegui import ui

from flexstage.centring.from_records import MAGNET
from flexstage.centring.geometry import SCALE_KINDS
from flexstage.web.centring.state import CentringState, Source
from flexstage.web.page import Page, choice, panel, quiet_button

#: Where records come from, as the page names it.
SOURCES: dict[Source, str] = {
    "example": "Example (simulated)",
    "records": "Records of an encoder",
    "gauge": "Readings of a gauge",
}
_UNITS = {"": "as the file says", "deg": "deg", "rad": "rad", "arcsec": "arcsec", "turn": "turn"}
_MM = 1e3


class ScaleForm:
    """The fields.

    Parameters
    ----------
    page
        The page.
    begin
        Called with the source of records where one begins anew.
    changed
        Called when records are to be evaluated again.
    """

    def __init__(
        self, page: Page, begin: Callable[[Source], None], changed: Callable[[], None]
    ) -> None:
        self._state = page.session.state(CentringState)
        self._page, self._begin, self._changed = page, begin, changed
        self._area = panel("toolbar")
        self.build()

    def build(self) -> None:
        """Show them as they are now."""
        state = self._state
        self._area.clear()
        with self._area:
            choice(SOURCES, state.source, "Where records come from", lambda e: self._begin(e.value))
            radius = ui.number(
                "Radius of the scale [mm]",
                value=None if state.radius is None else round(_MM * state.radius, 6),
                min=0.01,
            ).props("dense outlined debounce=600")
            radius.on_value_change(lambda e: self._put("radius", e.value and e.value / _MM))
            if state.source == "records":
                self._records()
            ui.space()
            quiet_button(
                "Begin again", icon="restart_alt", on_click=lambda: self._begin(state.source)
            )

    def _records(self) -> None:
        state = self._state
        self._select("Kind", [*SCALE_KINDS, MAGNET], "kind")
        if not state.columns:
            return
        self._select("Angle", list(state.columns), "angle")
        self._select("Error", list(state.columns), "errors", multiple=True)
        self._select("Unit", _UNITS, "unit")
        heads = ui.input("Heads [°]", value=state.heads).props("dense outlined debounce=800")
        heads.on_value_change(lambda e: self._put("heads", e.value))
        for label, name in (
            ("columns are what the heads read", "is_reading"),
            ("heads travel clockwise", "clockwise"),
        ):
            box = ui.checkbox(label, value=getattr(state, name)).props("dense")
            box.on_value_change(lambda e, name=name: self._put(name, bool(e.value)))

    def _select(self, label: str, values: Any, name: str, *, multiple: bool = False) -> None:
        value = getattr(self._state, name)
        shown = list(value) if multiple else value
        choice(
            values, shown, label,
            lambda e: self._put(name, tuple(e.value) if multiple else e.value), multiple=multiple,
        )  # fmt: skip

    def _put(self, name: str, value: Any) -> None:
        setattr(self._state, name, value)
        if self._state.measured:
            self._changed()
