"""Pictures, interactive charts, tables and figures in the front panel."""

from collections.abc import Iterable
from dataclasses import replace
from typing import Any

from nicegui import ui

from flexstage.files.names import file_name
from flexstage.files.write import write_whole
from flexstage.quantities.table import Table
from flexstage.report.page import table_html
from flexstage.web.page import Page, display_text, div, remark
from flexstage.web.pictures import chart_figure


def picture(svg: str) -> ui.html:
    """Show a figure of the report, drawn by `inline`, in the theme of the page."""
    return ui.html(svg, sanitize=False).classes("picture")


def chart(data: list[dict[str, Any]], layout: dict[str, Any], alt_text: str) -> ui.plotly:
    """Show an interactive chart (Plotly) in the colours of the report.

    Parameters
    ----------
    data
        Traces in the format of Plotly.
    layout
        Layout of Plotly; every axis has a title with the unit.
    alt_text
        Description for screen readers.

    Raises
    ------
    ModelError
        An axis has no title.
    """
    element = ui.plotly(chart_figure(data, layout)).classes("chart")
    element.props["role"], element.props["aria-label"] = "figure", alt_text
    return element


def show_table(table: Table) -> ui.html:
    """Show a table in the format of the report."""
    return ui.html(table_html(table), sanitize=False).classes("tables")


def in_page(source: Table) -> Table:
    """Return a table with its texts typeset for the page."""
    rows = (tuple(replace(c, text=display_text(c.text)) for c in row) for row in source.rows)
    return replace(source, rows=tuple(rows))


def show_lines(lines: Iterable[str], look: str = "") -> None:
    """Show sentences, one per line."""
    for line in lines:
        ui.label(display_text(line)).classes(look)


def figure(label: str, value: str, note: str = "") -> None:
    """Show one figure in large type, with its name and a note."""
    with div("key-figure"):
        remark(label)
        ui.label(display_text(value)).classes("large")
        if note:
            remark(display_text(note))


def save(page: Page, name: str, content: bytes) -> None:
    """Write a file into the folder of the view Hysteresis, and download it."""
    with page.show_errors():
        stem, dot, ending = name.rpartition(".")
        path = page.panel.folder("hysteresis") / f"{file_name(stem)}{dot}{ending}"
        write_whole(path, content)
        ui.download.content(content, path.name)
        ui.notify(f"saved as {path}", type="positive")


def sentence(message: str) -> str:
    """Return a message of the library with a capital letter and a full stop."""
    if not message:
        return ""
    # a file name keeps its case
    is_file_name = "." in message.split(" ", 1)[0]
    return f"{message[:1] if is_file_name else message[:1].upper()}{message[1:]}."
