"""Pictures for a page, drawn without NiceGUI, so that worker processes can draw them."""

import threading
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from flexstage.base.errors import ModelError
from flexstage.report.figures.style import CYCLE, inline_svg

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_AXES = ("xaxis", "yaxis")
_DRAWING_LOCK = threading.RLock()


def inline(draw: "Callable[[], Figure]", key: str, alt_text: str) -> str:
    """Return a figure of the report as SVG for a page; its ids begin with `key`.

    Any thread may call it. Matplotlib has global settings, so one figure is drawn at a time.
    """
    with _DRAWING_LOCK:
        return inline_svg(draw(), key, alt_text)


def chart_figure(data: list[dict[str, Any]], layout: dict[str, Any]) -> dict[str, Any]:
    """Return a chart in the format of Plotly, for `ui.plotly.update_figure`."""
    axes = {name for name in layout if name.startswith(_AXES)} | set(_AXES)
    for name in sorted(axes):
        title = layout.get(name, {}).get("title")
        # Plotly ignores a title that is a plain string
        if not (isinstance(title, dict) and title.get("text")):
            raise ModelError(
                f"the {name} of a chart has no title: every axis needs one, as "
                '{"title": {"text": ...}}'
            )
    defaults = {
        "margin": {"l": 64, "r": 16, "t": 24, "b": 48},
        "paper_bgcolor": "rgba(0,0,0,0)",
        "plot_bgcolor": "rgba(0,0,0,0)",
        "colorway": list(CYCLE),
        "font": {"family": "inherit", "size": 13},
        "legend": {"orientation": "h", "y": 1.02, "yanchor": "bottom"},
        "hovermode": "closest",
        "modebar": {"bgcolor": "rgba(0,0,0,0)"},
        "uirevision": "kept",
    }
    config = {"responsive": True, "displaylogo": False, "modeBarButtonsToRemove": ["toImage"]}
    return {"data": data, "layout": defaults | layout, "config": config}
