"""The fields of the view Centring that say what the scale is, and how its records are read."""

import math
from collections.abc import Callable
from typing import Any

from nicegui import ui

from flexstage.centring.requests import MAGNET, CentreRequest
from flexstage.files.request import request_fields
from flexstage.files.schema import field_texts
from flexstage.web.centring.state import CentringState, Source
from flexstage.web.page import Page, choice, in_page_words, panel, quiet_button

#: Where records come from, as the page names it.
SOURCES: dict[Source, str] = {
    "example": "Example (simulated)",
    "records": "Records of an encoder",
    "gauge": "Readings of a gauge",
}
_FIELDS, _TEXTS = request_fields(CentreRequest), field_texts(CentreRequest)
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
            if state.request.kind != MAGNET:
                radius = state.request.radius
                field = ui.number(
                    f"{_FIELDS['radius'].label} [mm]",
                    value=None if radius is None else round(_MM * radius, 6),
                    min=0.01,
                ).props("dense outlined debounce=600")
                field.tooltip(_told("radius"))
                field.on_value_change(lambda e: self._ask(radius=e.value and e.value / _MM))
            if state.source == "records":
                self._records()
            ui.space()
            quiet_button(
                "Begin again", icon="restart_alt", on_click=lambda: self._begin(state.source)
            )

    def _records(self) -> None:
        state = self._state
        self._select("kind", list(_FIELDS["kind"].words))
        if not state.columns:
            return
        self._select("angle", list(state.columns))
        columns = choice(
            list(state.columns), list(state.request.names), "Heads read, or their error",
            lambda e: self._ask(**{state.named: tuple(e.value)}), multiple=True,
        )  # fmt: skip
        columns.tooltip(_told(state.named))
        box = ui.checkbox(
            f"{_FIELDS['reading'].label}, not error", value=state.named == "reading"
        ).props("dense")
        box.tooltip(_told("reading"))
        box.on_value_change(lambda e: self._turn(bool(e.value)))
        self._select("unit", _UNITS)
        heads = ui.input(
            f"{_FIELDS['heads'].label} [°]",
            value=",".join(f"{math.degrees(head):.9g}" for head in state.request.heads),
        ).props("dense outlined debounce=800")
        heads.tooltip(_told("heads")).on_value_change(lambda e: self._stand(e.value or ""))
        self._select("head_direction", {"ccw": "counter-clockwise", "cw": "clockwise"})

    def _select(self, name: str, values: Any) -> None:
        """Show a field of the request that is one of some."""
        value = getattr(self._state.request, name)
        shown = choice(
            values, "" if value is None else value, _FIELDS[name].label,
            lambda e: self._ask(**{name: e.value or None}),
        )  # fmt: skip
        shown.tooltip(_told(name))

    def _turn(self, is_reading: bool) -> None:
        names = self._state.request.names
        self._ask(error=() if is_reading else names, reading=names if is_reading else ())

    def _stand(self, text: str) -> None:
        with self._page.sentences():
            self._ask(heads=_FIELDS["heads"].read(text))

    def _ask(self, **changed: Any) -> None:
        if changed.get("kind") == MAGNET:
            changed["radius"] = None  # it has none
        with self._page.sentences():
            self._state.ask(**changed)
            if "kind" in changed:
                self.build()
            if self._state.measured:
                self._changed()


def _told(name: str) -> str:
    """Return what a field is, as the help of the command says it."""
    return in_page_words(_TEXTS[name])
