"""Static shapes and modes of a stage, moving, in the colours of their stress or displacement."""

from base64 import b64encode
from functools import cache, partial
from typing import Any

import numpy as np
from nicegui import ui
from nicegui.element import Element

from flexstage.base.arrays import Array, Integers
from flexstage.quantities.comparison import title_of
from flexstage.quantities.quantity import number
from flexstage.report.figures.body_motion import SHOWN_OF_MODES, exaggeration
from flexstage.report.figures.hinges import STRESS_CLEAR, STRESS_COLOURS
from flexstage.report.figures.surface import StageSurface, SurfaceState
from flexstage.web.analyse.state import AnalyseState
from flexstage.web.analyse.work import ModelResult
from flexstage.web.page import Page, choice, div, quiet_button, remark
from flexstage.web.preferences import Preferences

_MM = 1e3
_TICKS = 4
# Colours of displacement, and over which part of their scale they set in.
_MOTION = ("viridis", 0.15)


class MovingStage(Element, component="moving_stage.js"):
    """A stage that moves in one of its states; `says` of the state is read aloud.

    Parameters
    ----------
    surface
        Its surface.
    state
        What is sent of the state that is shown first, by `sent_state`.
    space
        Whether it is seen in space at first.
    """

    def __init__(self, surface: StageSurface, state: dict[str, Any], *, space: bool) -> None:
        super().__init__()
        self._props["geometry"] = sent_surface(surface) | {"space": space}
        self._props["state"] = state

    def show(self, state: dict[str, Any]) -> None:
        """Show another state."""
        self.run_method("show", state)


def sent_surface(surface: StageSurface) -> dict[str, Any]:
    """Return a surface as the page takes it [mm]."""
    return {
        "points": _packed(surface.points * _MM, "<f4"),
        "triangles": _packed(surface.triangles, "<u4"),
        "edges": _packed(surface.edges, "<u4"),
        "flat": surface.flat,
    }


def sent_state(
    surface: StageSurface, state: SurfaceState, colour: str, preferences: Preferences
) -> dict[str, Any]:
    """Return a state as the page takes it, coloured by ``stress`` or ``displacement``.

    Displacement and colour of a corner are four numbers of two bytes, as parts of the largest.
    """
    largest = state.largest
    swings = state.stress is None
    factor = 0.0 if swings else exaggeration(surface.size, largest)
    reach = SHOWN_OF_MODES * surface.size if swings else factor * largest
    direction = state.displacement / (largest or 1.0)
    share, top = np.linalg.norm(direction, axis=1), 1.0
    title, colours = "displacement / largest [1]", _colours(*_MOTION)
    if state.stress is not None and colour == "stress" and state.limit > 0.0:
        share, top = state.stress / state.limit, state.limit * 1e-6
        title, colours = "equivalent stress [MPa]", _colours(STRESS_COLOURS, STRESS_CLEAR)
    elif not swings:
        unit, per_metre = preferences.length_unit()
        top, title = largest * per_metre, f"displacement [{unit}]"
    values = np.column_stack((direction, np.where(np.isnan(share), -1.0, share)))
    ticks = [(k / _TICKS, _tick(top * k / _TICKS)) for k in range(_TICKS + 1)]
    return {
        "values": _packed(np.rint(np.clip(values, -1.0, 1.0) * np.iinfo(np.int16).max), "<i2"),
        "reach": reach * _MM if largest > 0.0 else 0.0,
        "factor": factor,
        "swings": swings,
        "bar": {"title": title, "ticks": ticks, "colours": colours},
        "caption": f"{state.name}: {state.words}; colours: {title}, up to {_tick(top)}",
    }


def _tick(value: float) -> str:
    return number(value, 3) if value else "0"


def _packed(values: Array | Integers, kind: str) -> str:
    return b64encode(np.ascontiguousarray(values, dtype=kind).tobytes()).decode()


@cache
def _colours(name: str, clear: float) -> list[str]:
    """Return colours from low to high; at the low end they set in over a part of the scale."""
    from matplotlib import colormaps
    from matplotlib.colors import to_hex

    at = np.linspace(0.0, 1.0, 33)
    shades = colormaps[name](at)
    shades[:, 3] = np.clip(at / clear, 0.0, 1.0)
    return [to_hex(shade, keep_alpha=True) for shade in shades]


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
        self._found: dict[str, ModelResult] = {}
        self._moving: MovingStage | None = None
        self._place = div("shapes")

    def show(self, found: dict[str, ModelResult]) -> None:
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
                remark(
                    "Bodies are drawn rigid and notches as bent bars; the colour of a notch is its "
                    "largest stress."
                )
            remark(
                "Drag to move or turn it. Once it was clicked: wheel, arrows, + and −, Home, and "
                "space for play and pause."
            )
        self._say(one)

    def _states(self, one: ModelResult) -> dict[str, SurfaceState]:
        axes = zip(one.analysis.axes, one.surface.statics, strict=True)
        found = {axis.axis: state for axis, state in axes}
        for k, state in enumerate(one.surface.modes.get(self._shown.drives, ()), start=1):
            found[f"mode {k}"] = state
        return found

    def _choices(self, one: ModelResult, states: dict[str, SurfaceState]) -> None:
        with ui.row().classes("items-center choices"):
            models = {model: title_of(model) for model in self._found}
            choice(models, one.model, "Model", partial(self._choose, "model"))
            conditions = {c: f"drives {c}" for c in one.surface.modes}
            choice(conditions, self._shown.drives, "Modes", partial(self._choose, "drives"))
            self._colour = choice(
                _COLOURS, self._shown.colour, "Colour", partial(self._choose, "colour")
            )
        self._buttons: dict[str, ui.button] = {}
        with ui.row().classes("states").props('role=group aria-label="States"'):
            for key, state in states.items():
                button = quiet_button(state.name, on_click=partial(self._choose_state, key))
                self._buttons[key] = button.props("dense")

    def _sent(self, one: ModelResult) -> dict[str, object]:
        state = self._states(one)[self._shown.state]
        return sent_state(one.surface, state, self._shown.colour, self._page.preferences)

    def _say(self, one: ModelResult) -> None:
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

    def _choose(self, name: str, event: Any) -> None:
        setattr(self._shown, name, event.value)
        self._again() if name == "colour" else self._build()

    def _choose_state(self, key: str) -> None:
        self._shown.state = key
        self._again()
