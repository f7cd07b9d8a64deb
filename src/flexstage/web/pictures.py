"""Pictures for a page, made without it: also in a process that knows of no page."""

import threading
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from flexstage.base.errors import ModelError
from flexstage.report.figures.style import CYCLE, inline_svg

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_AXES = ("xaxis", "yaxis")
_ONE_DRAWS = threading.RLock()


def inline(draw: "Callable[[], Figure]", key: str, says: str) -> str:
    """Return a figure of the report as SVG for a page; its ids begin with `key`.

    To be called in threads: what draws has settings that all threads share, so one draws at a time.
    """
    with _ONE_DRAWS:
        return inline_svg(draw(), key, says)


def chart_figure(data: list[dict[str, Any]], layout: dict[str, Any]) -> dict[str, Any]:
    """Return a chart as Plotly takes it, for `ui.plotly.update_figure`."""
    axes = {name for name in layout if name.startswith(_AXES)} | set(_AXES)
    for name in sorted(axes):
        title = layout.get(name, {}).get("title")
        # Plotly passes over a title that is a mere text
        if not (isinstance(title, dict) and title.get("text")):
            raise ModelError(
                f"the {name} of a chart has no title: every axis says what it shows, as "
                '{"title": {"text": ...}}'
            )
    usual = {
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
    return {"data": data, "layout": usual | layout, "config": config}
