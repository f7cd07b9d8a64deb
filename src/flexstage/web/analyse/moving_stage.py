"""The moving picture of a stage in a page: what it is sent, and its element."""

from base64 import b64encode
from functools import cache
from typing import Any

import numpy as np
from nicegui.element import Element

from flexstage.arrays import Array, Integers
from flexstage.quantities import number
from flexstage.report.figures.body_motion import SHOWN_OF_MODES, exaggeration
from flexstage.report.figures.neck_stress import STRESS_CLEAR, STRESS_COLOURS
from flexstage.report.figures.surface import StageSurface, SurfaceState
from flexstage.web.preferences import Preferences

_MM = 1e3
_STEPS = 32767  # of a number in two bytes, with a sign
_TICKS, _SHADES = 4, 33
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
        "values": _packed(np.rint(np.clip(values, -1.0, 1.0) * _STEPS), "<i2"),
        "reach": reach * _MM if largest > 0.0 else 0.0,
        "factor": factor,
        "swings": swings,
        "bar": {"title": title, "ticks": ticks, "colours": colours},
        "says": f"{state.name}: {state.words}; colours: {title}, up to {_tick(top)}",
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

    at = np.linspace(0.0, 1.0, _SHADES)
    shades = colormaps[name](at)
    shades[:, 3] = np.clip(at / clear, 0.0, 1.0)
    return [to_hex(shade, keep_alpha=True) for shade in shades]
