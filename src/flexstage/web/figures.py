"""Pictures in the front panel: those of the report as they are, and charts that one can touch."""

import threading
from base64 import b64encode
from collections.abc import Callable
from html import escape
from typing import TYPE_CHECKING, Any

from nicegui import ui

from flexstage.errors import ModelError
from flexstage.report.figures.style import CYCLE, inline_svg
from flexstage.report.page import table_html
from flexstage.table import Table

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


def picture(figure: "Figure", says: str) -> ui.html:
    """Show a figure of the report, which follows the look of the page; `says` is read aloud."""
    shown = ui.html("", sanitize=False).classes("picture")
    shown.content = inline(lambda: figure, f"picture{shown.id}", says)
    return shown


def image(svg: str, says: str) -> ui.html:
    """Show a drawing that is a file of its own (SVG), apart from the page."""
    data = b64encode(svg.encode()).decode()
    return ui.html(
        f'<img class="drawing" alt="{escape(says)}" src="data:image/svg+xml;base64,{data}">',
        sanitize=False,
    ).classes("picture")


def chart(data: list[dict[str, Any]], layout: dict[str, Any], says: str) -> ui.plotly:
    """Show a chart with cursors (Plotly), in the colours of the page and of the report.

    Parameters
    ----------
    data
        Traces, as Plotly has them.
    layout
        Its layout; every axis has a title, with the unit.
    says
        What it shows, for those who do not see it.

    Raises
    ------
    ModelError
        An axis has no title.
    """
    shown = ui.plotly(chart_figure(data, layout)).classes("chart")
    shown.props["role"], shown.props["aria-label"] = "img", says
    return shown


def chart_figure(data: list[dict[str, Any]], layout: dict[str, Any]) -> dict[str, Any]:
    """Return a chart as Plotly takes it, for `ui.plotly.update_figure`."""
    axes = {name for name in layout if name.startswith(_AXES)} | set(_AXES)
    for name in sorted(axes):
        title = layout.get(name, {}).get("title")
        if not (title.get("text") if isinstance(title, dict) else title):
            raise ModelError(f"the {name} of a chart has no title: every axis says what it shows")
    usual = {
        "margin": {"l": 64, "r": 16, "t": 24, "b": 48},
        "paper_bgcolor": "rgba(0,0,0,0)",
        "plot_bgcolor": "rgba(0,0,0,0)",
        "colorway": list(CYCLE),
        "font": {"family": "inherit", "size": 13},
        "legend": {"orientation": "h", "y": 1.02, "yanchor": "bottom"},
        "hovermode": "closest",
        "uirevision": "kept",
    }
    config = {"responsive": True, "displaylogo": False, "modeBarButtonsToRemove": ["toImage"]}
    return {"data": data, "layout": usual | layout, "config": config}


def show_table(table: Table) -> ui.html:
    """Show a table as the report has it."""
    return ui.html(table_html(table), sanitize=False).classes("tables")
