"""What the panels of the view Hysteresis show alike, and how they give files to the browser."""

from collections.abc import Iterable
from dataclasses import replace

from nicegui import ui

from flexstage.files.names import file_name
from flexstage.files.write import write_whole
from flexstage.table import Table
from flexstage.web.page import Page, in_page_words


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
    with ui.element("div").classes("key-figure"):
        ui.label(name).classes("muted small")
        ui.label(in_page_words(value)).classes("large")
        if note:
            ui.label(in_page_words(note)).classes("muted small")


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
