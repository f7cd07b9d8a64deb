"""Panels of the view Centring: the form of the scale, and figures of the turns."""

from collections.abc import Callable
from typing import Any

from nicegui import ui

from flexstage.centring import ARCSEC
from flexstage.centring.requests import MAGNET
from flexstage.quantities.quantity import number, value_and_uncertainty
from flexstage.quantities.table import Table, table
from flexstage.web.bench.readouts import shown_number
from flexstage.web.centring.state import CentringState, Source
from flexstage.web.live_history import POSITION
from flexstage.web.page import Page, choice, display_text, panel, quiet_button
from flexstage.web.preferences import Preferences
from flexstage.web.request_form import RequestForm

#: Sources of records, with their labels.
SOURCES: dict[Source, str] = {
    "example": "Example (simulated)",
    "records": "Records of an encoder",
    "gauge": "Readings of a gauge",
}
_UNITS = {"": "unit in the file", "deg": "deg", "rad": "rad", "arcsec": "arcsec", "turn": "turn"}


class ScaleForm:
    """The form of the scale and of the columns of its records.

    Parameters
    ----------
    page
        The page.
    begin
        Called with the source of records to start again.
    changed
        Called when records are to be evaluated again.
    """

    def __init__(
        self, page: Page, begin: Callable[[Source], None], changed: Callable[[], None]
    ) -> None:
        self._state = page.session.state(CentringState)
        self._begin, self._changed = begin, changed
        self._builder = RequestForm(
            page,
            lambda: self._state.request,
            lambda name, value: self._ask(**{name: value}),
            self._state.errors,
        )
        self._area = panel("toolbar")
        self.build()

    def build(self) -> None:
        """Rebuild the form for the present state."""
        state = self._state
        state.errors.clear()  # the new fields show the valid values
        self._builder.errors = state.errors
        self._area.clear()
        with self._area:
            choice(SOURCES, state.source, "Source of records", lambda e: self._begin(e.value))
            if state.request.kind != MAGNET:
                self._builder.number("radius")
            if state.source == "records":
                self._records()
            ui.space()
            quiet_button(
                "Start again", icon="restart_alt", on_click=lambda: self._begin(state.source)
            )

    def _records(self) -> None:
        state, builder = self._state, self._builder
        builder.choice("kind")
        if not state.columns:
            return
        columns = list(state.columns)
        builder.choice("angle", columns)
        builder.choice(state.column_kind, columns)
        box = ui.checkbox(
            "Columns are angle readings of the heads", value=state.column_kind == "reading"
        )
        box.props("dense").on_value_change(lambda e: self._set_column_kind(bool(e.value)))
        builder.choice("unit", _UNITS)
        builder.text("heads")
        builder.choice("head_direction", {"ccw": "counter-clockwise", "cw": "clockwise"})

    def _set_column_kind(self, is_reading: bool) -> None:
        names = self._state.request.names
        self._ask(error=() if is_reading else names, reading=names if is_reading else ())
        self.build()

    def _ask(self, **fields: Any) -> None:
        self._state.ask(**fields)
        if "kind" in fields:
            self.build()
        if self._state.turns:
            self._changed()


_KINDS = {"start": "start", "trial": "trial move", "move": "move"}


def with_uncertainty(value: float, uncertainty: float, factor: float) -> str:
    """Return a value with its standard uncertainty, in the unit of a factor from SI."""
    return display_text(" ± ".join(value_and_uncertainty(factor * value, factor * uncertainty)))


def position_text(at: tuple[float, float], preferences: Preferences) -> str:
    """Return a stage position as text."""
    quantity = preferences.displayed(POSITION)
    parts = (f"{n} {shown_number(quantity, v)}" for n, v in zip("xy", at, strict=True))
    return f"{', '.join(parts)} {quantity.shown_unit}"


def figures(
    turn: dict[str, Any], radius: float | None, preferences: Preferences
) -> list[tuple[str, str, str]]:
    """Return name, value and note of the figures of a turn, the main one first."""
    unit, factor = preferences.length_unit()
    rows: list[tuple[str, str, str]] = []
    if (e := turn.get("eccentricity")) is not None:
        uncertainty = factor * e["uncertainty"]
        low, high = (value_and_uncertainty(factor * end, uncertainty)[0] for end in e["interval"])
        value = f"{with_uncertainty(e['value'], e['uncertainty'], factor)} {unit}"
        rows.append(("Eccentricity", value, f"95 %: {low} to {high} {unit}"))
    if (first := once_per_turn(turn, radius)) is not None:
        rows.append(("Error once per turn", f"{with_uncertainty(*first, 1.0)} arcsec", "amplitude"))
    rows.append(("Residual", residual(turn, preferences), "rms"))
    return rows


def once_per_turn(turn: dict[str, Any], radius: float | None) -> tuple[float, float] | None:
    """Return the amplitude of the once-per-turn error and its standard uncertainty [arcsec].

    For a gauge it is the error of a scale with this radius.
    """
    first = next((h for h in turn["harmonics"] if h["order"] == 1), None)
    if first is None:
        return None
    size = first["amplitude_arcsec"]
    if size is None:
        if radius is None:
            return None
        size = 1e-6 * first["amplitude_um"] / radius / ARCSEC
    amplitude = first["amplitude"]
    return size, first["amplitude_uncertainty"] * (size / amplitude if amplitude else 0.0)


def residual(turn: dict[str, Any], preferences: Preferences) -> str:
    """Return the residual of the harmonics as text."""
    first = turn["harmonics"][0]
    rms, size = turn["residual_rms"], first["amplitude"]
    if first["amplitude_arcsec"] is not None:
        return f"{number(rms * first['amplitude_arcsec'] / size, 3)} arcsec" if size else "–"
    unit, factor = preferences.length_unit()
    return (
        f"{number(rms * factor * 1e-6 * first['amplitude_um'] / size, 3)} {unit}" if size else "–"
    )


def turns_table(state: CentringState, preferences: Preferences) -> Table:
    """Return a table of the measured turns."""
    unit, factor = preferences.length_unit()
    heads = (
        "turn", f"stage x [{unit}]", f"y [{unit}]", f"eccentricity [{unit}]", "direction [°]",
        "once per turn [arcsec]", "residual, rms",
    )  # fmt: skip
    turns = state.result.setups if state.result is not None and state.up_to_date else []
    rows = []
    for i, turn in enumerate(state.turns):
        at = [shown_number(preferences.displayed(POSITION), v) for v in turn.position]
        cells = ["…"] * 4
        if i < len(turns):
            e, first = (
                turns[i].get("eccentricity"),
                once_per_turn(turns[i], state.request.radius),
            )
            cells = [
                "–" if e is None else with_uncertainty(e["value"], e["uncertainty"], factor),
                "–" if e is None else display_text(f"{e['phase_deg']:.1f}"),
                "–" if first is None else with_uncertainty(*first, 1.0),
                residual(turns[i], preferences),
            ]
        rows.append((f"{i + 1} {_KINDS[turn.kind]}", *at, *cells))
    return table("", heads, rows)
