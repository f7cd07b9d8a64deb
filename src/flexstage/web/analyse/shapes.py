"""Animated static shapes and modes of a stage, coloured by stress or displacement."""

from base64 import b64encode
from functools import cache, partial
from typing import Any

import numpy as np
from nicegui import ui
from nicegui.element import Element

from flexstage.base.arrays import Array, Integers
from flexstage.quantities.comparison import title_of
from flexstage.quantities.quantity import number
from flexstage.report.figures.body_motion import MODE_AMPLITUDE, exaggeration
from flexstage.report.figures.hinges import STRESS_CLEAR, STRESS_COLOURS
from flexstage.report.figures.surface import StageSurface, SurfaceState
from flexstage.web.analyse.work import AnalyseState, ModelResult
from flexstage.web.page import Page, choice, div, quiet_button, remark
from flexstage.web.sessions import Preferences

_MM = 1e3
_TICKS = 4
# Colours of displacement, and the part of the scale over which they fade in.
_MOTION = ("viridis", 0.15)


class MovingStage(Element, component="moving_stage.js"):
    """Animation of a stage in one of its states; the `caption` of the state is read aloud.

    Parameters
    ----------
    surface
        Surface of the stage.
    state
        Data of the initial state, by `state_data`.
    in_3d
        Begin with the 3D view.
    """

    def __init__(self, surface: StageSurface, state: dict[str, Any], *, in_3d: bool) -> None:
        super().__init__()
        self._props["geometry"] = surface_data(surface) | {"space": in_3d}
        self._props["state"] = state

    def show(self, state: dict[str, Any]) -> None:
        """Show another state."""
        self.run_method("show", state)


def surface_data(surface: StageSurface) -> dict[str, Any]:
    """Return a surface in the format of the script [mm]."""
    return {
        "points": _packed(surface.points * _MM, "<f4"),
        "triangles": _packed(surface.triangles, "<u4"),
        "edges": _packed(surface.edges, "<u4"),
        "flat": surface.flat,
    }


def state_data(
    surface: StageSurface, state: SurfaceState, colour: str, preferences: Preferences
) -> dict[str, Any]:
    """Return a state in the format of the script, coloured by ``stress`` or ``displacement``.

    Displacement and colour of a corner are four 16-bit numbers relative to the largest.
    """
    largest = state.largest
    is_mode = state.stress is None
    factor = 0.0 if is_mode else exaggeration(surface.size, largest)
    amplitude = MODE_AMPLITUDE * surface.size if is_mode else factor * largest
    direction = state.displacement / (largest or 1.0)
    share, scale_top = np.linalg.norm(direction, axis=1), 1.0
    title, colours = "displacement / largest [1]", _colours(*_MOTION)
    if state.stress is not None and colour == "stress" and state.limit > 0.0:
        share, scale_top = state.stress / state.limit, state.limit * 1e-6
        title, colours = "equivalent stress [MPa]", _colours(STRESS_COLOURS, STRESS_CLEAR)
    elif not is_mode:
        unit, factor_from_m = preferences.length_unit()
        scale_top, title = largest * factor_from_m, f"displacement [{unit}]"
    values = np.column_stack((direction, np.where(np.isnan(share), -1.0, share)))
    ticks = [(k / _TICKS, _tick(scale_top * k / _TICKS)) for k in range(_TICKS + 1)]
    return {
        "values": _packed(np.rint(np.clip(values, -1.0, 1.0) * np.iinfo(np.int16).max), "<i2"),
        "reach": amplitude * _MM if largest > 0.0 else 0.0,
        "factor": factor,
        "swings": is_mode,
        "bar": {"title": title, "ticks": ticks, "colours": colours},
        "caption": f"{state.name}: {state.words}; colours: {title}, up to {_tick(scale_top)}",
    }


def _tick(value: float) -> str:
    return number(value, 3) if value else "0"


def _packed(values: Array | Integers, kind: str) -> str:
    return b64encode(np.ascontiguousarray(values, dtype=kind).tobytes()).decode()


@cache
def _colours(name: str, clear: float) -> list[str]:
    """Return colours from low to high; they fade in over a part of the scale at the low end."""
    from matplotlib import colormaps
    from matplotlib.colors import to_hex

    positions = np.linspace(0.0, 1.0, 33)
    shades = colormaps[name](positions)
    shades[:, 3] = np.clip(positions / clear, 0.0, 1.0)
    return [to_hex(shade, keep_alpha=True) for shade in shades]


_COLOURS = {"stress": "equivalent stress", "displacement": "displacement"}
#: Text without results.
NOTHING_YET = "Run a model to see this."
_RIGID = frozenset({"lumped", "superelement", "superelement-3d"})


class Shapes:
    """The shapes in the results.

    Parameters
    ----------
    page
        The page.
    """

    def __init__(self, page: Page) -> None:
        self._page = page
        self._display = page.session.state(AnalyseState).display
        self._results: dict[str, ModelResult] = {}
        self._moving: MovingStage | None = None
        self._place = div("shapes")

    def show(self, results: dict[str, ModelResult]) -> None:
        """Show the results, by model."""
        if results == self._results and self._moving is not None:
            return
        self._results = results
        self._build()

    def _build(self) -> None:
        self._place.clear()
        self._moving = None
        if not self._results:
            with self._place:
                ui.label(NOTHING_YET).classes("muted")
            return
        if self._display.model not in self._results:
            self._display.model = next(iter(self._results))
        result = self._results[self._display.model]
        conditions = list(result.surface.modes)
        if self._display.drives not in conditions:
            self._display.drives = conditions[0]
        states = self._states(result)
        if self._display.state not in states:
            self._display.state = next(iter(states), "")
        with self._place:
            self._choices(result, states)
            if self._display.state:
                self._moving = MovingStage(
                    result.surface, self._state_data(result), in_3d=result.model == "solid"
                )
            self._description = ui.label().classes("small")
            if result.model in _RIGID:
                remark(
                    "Bodies are drawn rigid, and notches as bent bars. The colour of a notch "
                    "shows its largest stress."
                )
            remark(
                "Drag to move or rotate. After a click: wheel, arrows, + and −, Home, and the "
                "space bar for play and pause."
            )
        self._update_text(result)

    def _states(self, result: ModelResult) -> dict[str, SurfaceState]:
        axes = zip(result.analysis.axes, result.surface.statics, strict=True)
        states = {axis.axis: state for axis, state in axes}
        for k, state in enumerate(result.surface.modes.get(self._display.drives, ()), start=1):
            states[f"mode {k}"] = state
        return states

    def _choices(self, result: ModelResult, states: dict[str, SurfaceState]) -> None:
        with ui.row().classes("items-center choices"):
            models = {model: title_of(model) for model in self._results}
            choice(models, result.model, "Model", partial(self._choose, "model"))
            conditions = {c: f"drives {c}" for c in result.surface.modes}
            choice(conditions, self._display.drives, "Modes", partial(self._choose, "drives"))
            self._colour = choice(
                _COLOURS, self._display.colour, "Colour", partial(self._choose, "colour")
            )
        self._buttons: dict[str, ui.button] = {}
        with ui.row().classes("states").props('role=group aria-label="States"'):
            for key, state in states.items():
                button = quiet_button(state.name, on_click=partial(self._choose_state, key))
                self._buttons[key] = button.props("dense")

    def _state_data(self, result: ModelResult) -> dict[str, object]:
        state = self._states(result)[self._display.state]
        return state_data(result.surface, state, self._display.colour, self._page.preferences)

    def _update_text(self, result: ModelResult) -> None:
        state = self._states(result).get(self._display.state)
        self._colour.visible = state is not None and state.stress is not None
        self._description.text = state.words if state else "The stage has no mode."
        for key, button in self._buttons.items():
            is_pressed = str(key == self._display.state).lower()
            button.props(f"aria-pressed={is_pressed}")

    def _update(self) -> None:
        result = self._results[self._display.model]
        if self._moving is not None:
            self._moving.show(self._state_data(result))
        self._update_text(result)

    def _choose(self, name: str, event: Any) -> None:
        setattr(self._display, name, event.value)
        self._update() if name == "colour" else self._build()

    def _choose_state(self, key: str) -> None:
        self._display.state = key
        self._update()
