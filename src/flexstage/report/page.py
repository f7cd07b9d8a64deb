"""The frame of every report: one HTML file with numbered figures, tables and signs in one style."""

import itertools
import re
from collections.abc import Iterable
from html import escape
from importlib.resources import files
from string import Template
from typing import TYPE_CHECKING

from flexstage.report.figures.style import css_variables, inline_svg

if TYPE_CHECKING:
    from matplotlib.figure import Figure

#: A hyphen that is a minus sign: before a digit, and after nothing that it could belong to.
_HYPHEN_MINUS = re.compile(r"(?<![\w\])−–-])-(?=\.?\d)")


def page_html(
    *,
    title: str,
    heading: str,
    lead: str,
    version: str,
    links: Iterable[tuple[str, str]],
    body: str,
    notes: str = "",
    symbols: str = "",
) -> str:
    """Fill the template, number its figures and tables, and write every minus as U+2212.

    Body and notes are HTML, title, heading and lead plain text. `links` are id and title of what
    the navigation names, `symbols` SVG that others refer to.
    """
    page = Template(files("flexstage.report").joinpath("template.html").read_text("utf-8"))
    return page.substitute(
        version=escape(version),
        title=escape(title),
        light=css_variables(),
        heading=escape(heading),
        lead=escape(lead),
        notes=_typeset(notes),
        navigation="".join(f'<a href="#{key}">{name}</a>' for key, name in links)
        + ('<button type="button" id="unfold">Unfold all</button>' if "<details>" in body else ""),
        symbols=symbols,
        sections=_typeset(_numbered(_numbered(body, "figcaption", "Figure"), "caption", "Table")),
    )


def figure(svg: str, caption: str, *, kind: str = "") -> str:
    """Return a figure with its caption of HTML, which `page_html` numbers."""
    return f'<figure class="{kind or "whole"}">{svg}<figcaption>{caption}</figcaption></figure>'


def drawn(plot: "Figure", key: str, title: str, caption: str, *, kind: str = "") -> str:
    """Return a plot as a figure; the key is unique in the page, the title for who cannot see it."""
    return figure(inline_svg(plot, key, title), caption, kind=kind)


def row_of(figures: Iterable[str], *, columns: int = 1) -> str:
    """Return figures side by side, 1 to 3 in a row; empty where there is none."""
    shown = "".join(figures)
    kind = {1: "", 2: " two", 3: " three"}[columns]
    return f'<div class="plots{kind}">{shown}</div>' if shown else ""


def captioned(table: str, caption: str) -> str:
    """Give HTML with one table in it a caption, which `page_html` numbers."""
    return table.replace("<table>", f"<table><caption>{caption}</caption>", 1)


def table_html(heads: Iterable[str], lines: Iterable[str], *, groups: str = "") -> str:
    """Write a table that may be scrolled where the window is narrow.

    Heads and groups, a row above them, are ``<th>``; lines are the ``<tr>``.
    """
    above = f'<tr class="groups">{groups}</tr>' if groups else ""
    return (
        f'<div class="scroll"><table><thead>{above}<tr>{"".join(heads)}</tr></thead>'
        f"<tbody>{''.join(lines)}</tbody></table></div>"
    )


def cells(values: Iterable[object]) -> str:
    """Write the cells of a row, as HTML."""
    return "".join(f"<td>{value}</td>" for value in values)


def bullets(notes: Iterable[str]) -> str:
    """Write notes as a list; empty where there are none."""
    items = "".join(f"<li>{escape(note)}</li>" for note in notes)
    return f"<ul>{items}</ul>" if items else ""


def definitions(entries: Iterable[tuple[str, str]]) -> str:
    """Write what things are called and what they are; empty where there are none."""
    rows = "".join(f"<dt>{escape(k)}</dt><dd>{escape(v)}</dd>" for k, v in entries)
    return f"<dl>{rows}</dl>" if rows else ""


def folded(key: str, title: str, finding: str, content: str) -> str:
    """Return a chapter that is folded behind its title and its finding, one line of HTML."""
    return (
        f'<section id="{key}" class="chapter"><details><summary><h2>{title}</h2>'
        f"<p>{finding}</p></summary>{content}</details></section>"
    )


def _numbered(text: str, tag: str, word: str) -> str:
    count = itertools.count(1)
    return re.sub(f"<{tag}>", lambda _: f"<{tag}><b>{word} {next(count)}.</b> ", text)


def _typeset(text: str) -> str:
    """Write hyphens that are minus signs as such, in words and not in tags."""
    return re.sub(r">[^<]+", lambda words: _HYPHEN_MINUS.sub("−", words[0]), text)
