"""Pictures in the front panel: those of the report as they are, and charts that one can touch."""

from collections.abc import Iterable
from dataclasses import replace
from typing import Any

from nicegui import ui

from flexstage.files.names import file_name
from flexstage.files.write import write_whole
from flexstage.quantities.table import Table
from flexstage.report.page import table_html
from flexstage.web.page import Page, div, in_page_words, remark
from flexstage.web.pictures import chart_figure


def picture(svg: str) -> ui.html:
    """Show a figure of the report, made by `inline`: it follows the look of the page."""
    return ui.html(svg, sanitize=False).classes("picture")


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


def in_page(shown: Table) -> Table:
    """Return a table with its words as the page says them."""
    rows = (tuple(replace(c, text=in_page_words(c.text)) for c in row) for row in shown.rows)
    return replace(shown, rows=tuple(rows))


def show_lines(lines: Iterable[str], look: str = "") -> None:
    """Show sentences, one below the other."""
    for line in lines:
        ui.label(in_page_words(line)).classes(look)


def figure(name: str, value: str, note: str = "") -> None:
    """Show one figure in large type."""
    with div("key-figure"):
        remark(name)
        ui.label(in_page_words(value)).classes("large")
        if note:
            remark(in_page_words(note))


def save(page: Page, name: str, content: bytes) -> None:
    """Write a file into the folder of the view, and give it to the browser."""
    with page.sentences():
        stem, dot, ending = name.rpartition(".")
        path = page.panel.folder("hysteresis") / f"{file_name(stem)}{dot}{ending}"
        write_whole(path, content)
        ui.download.content(content, path.name)
        ui.notify(f"saved as {path}", type="positive")


def sentence(words: str) -> str:
    """Return words of the library as a sentence."""
    if not words:
        return ""
    # the name of a file stays as it is
    is_name = "." in words.split(" ", 1)[0]
    return f"{words[:1] if is_name else words[:1].upper()}{words[1:]}."
