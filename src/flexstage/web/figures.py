"""Pictures in the front panel: those of the report as they are, and charts that one can touch."""

from base64 import b64encode
from html import escape
from typing import TYPE_CHECKING, Any

from nicegui import ui

from flexstage.report.page import table_html
from flexstage.table import Table
from flexstage.web.pictures import chart_figure, inline

if TYPE_CHECKING:
    from matplotlib.figure import Figure


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
    shown.props["role"], shown.props["aria-label"] = "figure", says
    return shown


def show_table(table: Table) -> ui.html:
    """Show a table as the report has it."""
    return ui.html(table_html(table), sanitize=False).classes("tables")
