"""Static shapes and modes of a stage, moving, in the colours of their stress or displacement."""

from functools import partial
from typing import Any

from nicegui import ui

from flexstage.comparison import title_of
from flexstage.report.figures.surface import SurfaceState
from flexstage.web.analyse.moving_stage import MovingStage, sent_state
from flexstage.web.analyse.state import AnalyseState
from flexstage.web.analyse.work import Analysed
from flexstage.web.page import Page, quiet_button

_COLOURS = {"stress": "equivalent stress", "displacement": "displacement"}
#: What stands where nothing was found yet.
NOTHING_YET = "It comes when a model has been run."
_RIGID = frozenset({"lumped", "superelement", "superelement-3d"})


class Shapes:
    """The shapes of what was found.

    Parameters
    ----------
    page
        The page.
    """

    def __init__(self, page: Page) -> None:
        self._page = page
        self._shown = page.session.state(AnalyseState).shown
        self._found: dict[str, Analysed] = {}
        self._moving: MovingStage | None = None
        self._place = ui.element("div").classes("shapes")

    def show(self, found: dict[str, Analysed]) -> None:
        """Show what was found, by model."""
        if found == self._found and self._moving is not None:
            return
        self._found = found
        self._build()

    def _build(self) -> None:
        self._place.clear()
        self._moving = None
        if not self._found:
            with self._place:
                ui.label(NOTHING_YET).classes("muted")
            return
        if self._shown.model not in self._found:
            self._shown.model = next(iter(self._found))
        one = self._found[self._shown.model]
        conditions = list(one.surface.modes)
        if self._shown.drives not in conditions:
            self._shown.drives = conditions[0]
        states = self._states(one)
        if self._shown.state not in states:
            self._shown.state = next(iter(states), "")
        with self._place:
            self._choices(one, states)
            if self._shown.state:
                self._moving = MovingStage(one.surface, self._sent(one), space=one.model == "solid")
            self._words = ui.label().classes("small")
            if one.model in _RIGID:
                ui.label(
                    "Bodies are drawn rigid and notches as bent bars; the colour of a notch is its "
                    "largest stress."
                ).classes("muted small")
            ui.label(
                "Drag to move or turn it. Once it was clicked: wheel, arrows, + and −, Home, and "
                "space for play and pause."
            ).classes("muted small")
        self._say(one)

    def _states(self, one: Analysed) -> dict[str, SurfaceState]:
        axes = zip(one.analysis.axes, one.surface.statics, strict=True)
        found = {axis.axis: state for axis, state in axes}
        for k, state in enumerate(one.surface.modes.get(self._shown.drives, ()), start=1):
            found[f"mode {k}"] = state
        return found

    def _choices(self, one: Analysed, states: dict[str, SurfaceState]) -> None:
        with ui.row().classes("items-center choices"):
            models = {model: title_of(model) for model in self._found}
            ui.select(models, value=one.model, label="Model", on_change=self._choose_model).props(
                "dense options-dense outlined"
            )
            conditions = {c: f"drives {c}" for c in one.surface.modes}
            ui.select(
                conditions, value=self._shown.drives, label="Modes", on_change=self._choose_drives
            ).props("dense options-dense outlined")
            self._colour = ui.select(
                _COLOURS, value=self._shown.colour, label="Colour", on_change=self._choose_colour
            ).props("dense options-dense outlined")
        self._buttons: dict[str, ui.button] = {}
        with ui.row().classes("states").props('role=group aria-label="States"'):
            for key, state in states.items():
                button = quiet_button(state.name, on_click=partial(self._choose_state, key))
                self._buttons[key] = button.props("dense")

    def _sent(self, one: Analysed) -> dict[str, object]:
        state = self._states(one)[self._shown.state]
        return sent_state(one.surface, state, self._shown.colour, self._page.preferences)

    def _say(self, one: Analysed) -> None:
        state = self._states(one).get(self._shown.state)
        self._colour.visible = state is not None and state.stress is not None
        self._words.text = state.words if state else "Nothing moves: the stage has no mode."
        for key, button in self._buttons.items():
            pressed = str(key == self._shown.state).lower()
            button.props(f"aria-pressed={pressed}")

    def _again(self) -> None:
        one = self._found[self._shown.model]
        if self._moving is not None:
            self._moving.show(self._sent(one))
        self._say(one)

    def _choose_model(self, event: Any) -> None:
        self._shown.model = event.value
        self._build()

    def _choose_drives(self, event: Any) -> None:
        self._shown.drives = event.value
        self._build()

    def _choose_colour(self, event: Any) -> None:
        self._shown.colour = event.value
        self._again()

    def _choose_state(self, key: str) -> None:
        self._shown.state = key
        self._again()
