"""The fields of the view Centring that say what the scale is, and how its records are read."""

from collections.abc import Callable
from typing import Any

from nicegui import ui

from flexstage.centring.requests import MAGNET
from flexstage.web.centring.state import CentringState, Source
from flexstage.web.page import Page, choice, panel, quiet_button
from flexstage.web.request_form import RequestForm

#: Where records come from, as the page names it.
SOURCES: dict[Source, str] = {
    "example": "Example (simulated)",
    "records": "Records of an encoder",
    "gauge": "Readings of a gauge",
}
_UNITS = {"": "as the file says", "deg": "deg", "rad": "rad", "arcsec": "arcsec", "turn": "turn"}


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
        self._begin, self._changed = begin, changed
        self._own = RequestForm(
            page,
            lambda: self._state.request,
            lambda name, value: self._ask(**{name: value}),
            self._state.wrong,
        )
        self._area = panel("toolbar")
        self.build()

    def build(self) -> None:
        """Show them as they are now."""
        state = self._state
        state.wrong.clear()  # the fields are made anew from what was taken
        self._own.wrong = state.wrong
        self._area.clear()
        with self._area:
            choice(SOURCES, state.source, "Where records come from", lambda e: self._begin(e.value))
            if state.request.kind != MAGNET:
                self._own.number("radius")
            if state.source == "records":
                self._records()
            ui.space()
            quiet_button(
                "Begin again", icon="restart_alt", on_click=lambda: self._begin(state.source)
            )

    def _records(self) -> None:
        state, own = self._state, self._own
        own.choice("kind")
        if not state.columns:
            return
        columns = list(state.columns)
        own.choice("angle", columns)
        own.choice(state.named, columns)
        box = ui.checkbox("columns are what the heads read", value=state.named == "reading")
        box.props("dense").on_value_change(lambda e: self._turn(bool(e.value)))
        own.choice("unit", _UNITS)
        own.text("heads")
        own.choice("head_direction", {"ccw": "counter-clockwise", "cw": "clockwise"})

    def _turn(self, is_reading: bool) -> None:
        names = self._state.request.names
        self._ask(error=() if is_reading else names, reading=names if is_reading else ())
        self.build()

    def _ask(self, **changed: Any) -> None:
        self._state.ask(**changed)
        if "kind" in changed:
            self.build()
        if self._state.measured:
            self._changed()
