"""A table as the terminal shows it: whole numbers and whole words, in fewer columns if need be."""

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import zip_longest
from typing import TYPE_CHECKING

from rich.cells import cell_len
from rich.text import Text

from flexstage.table import Cell, Column, Table

if TYPE_CHECKING:
    from rich.console import Console, ConsoleOptions

_GAP = 2  # between columns
_HEAD = 3  # lines that a heading may have and the table still be flat
_FAILS = " fails"
_LEADS = ("±", "<", "≥", "≤", "≈")
_NUMBER = re.compile(r"(?:^|[\s(])[-+−]?\d[\d.]*(?:e[-+]?\d+)?$")
_MARK = re.compile(r"\[\d+\]")
_UNIT = re.compile(r"(?:%|°|[A-Za-zµ]{1,4}[²³]?(?:[/·][A-Za-zµ]{1,4}[²³]?)*)[,;.:)]*")


@dataclass(frozen=True, slots=True)
class Printed:
    """A table to be printed by rich, in the first of its forms that has room.

    Where none has, each row is a block of lines. Notes of cells stand below, numbered.
    """

    shown: Table

    def __rich_console__(self, console: "Console", options: "ConsoleOptions") -> Iterator[Text]:
        width = options.max_width
        shown = _numbered(self.shown)
        forms = list(shown.narrower())
        flat = [(form, lines) for form in forms if (lines := _flat(form, width))]
        calm = [(f, lines) for f, lines in flat if len(lines) <= 2 * len(f.rows) + _HEAD]
        form, lines = (*calm, *sorted(flat, key=lambda one: len(one[1])), (forms[-1], None))[0]
        for words, style in ((form.caption, "italic"), ("; ".join(shown.notes), "dim")):
            if style == "dim":
                yield from _blocks(form, width) if lines is None else lines
            yield from (Text(line, style) for line in wrapped(words, width))
        yield Text()


def wrapped(text: str, width: int) -> list[str]:
    """Break a text over lines: between words, and not within a number, its ± and its unit.

    Examples
    --------
    >>> wrapped("a stroke of 63.65 ± 0.07 µm", 15)
    ['a stroke of', '63.65 ± 0.07 µm']
    """
    lines = []
    for line in text.split("\n"):
        made = ""
        for atom in _atoms(line):
            if made and cell_len(made) + 1 + cell_len(atom) > width:
                lines.append(made)
                made = ""
            made += f" {atom}" if made else atom
        lines.append(made)
    return lines if text else []


def _atoms(text: str) -> list[str]:
    atoms: list[str] = []
    for word in text.split():
        before = atoms[-1] if atoms else ""
        of_number = _NUMBER.search(before) and _UNIT.fullmatch(word)
        led = word in _LEADS or before.endswith(_LEADS) or _MARK.fullmatch(before)
        if before and (led or of_number or (before.endswith(" N") and word == "m/rad")):
            atoms[-1] += f" {word}"
        else:
            atoms.append(word)
    return atoms


def _numbered(shown: Table) -> Table:
    """Put a column of numbers in place of the notes of cells, and the notes below the table."""
    notes: dict[str, int] = {}
    marks = []
    for row in shown.rows:
        said = dict.fromkeys(
            note
            for cell in row
            for note in (f"fails: {cell.failing}" if cell.failing else "", cell.note)
            if note
        )
        marks.append(" ".join(f"[{notes.setdefault(note, len(notes) + 1)}]" for note in said))
    if not notes:
        return shown
    return replace(
        shown,
        columns=(*shown.columns, Column("", "words")),
        rows=tuple((*row, Cell(mark)) for row, mark in zip(shown.rows, marks, strict=True)),
        notes=(*(f"[{i}] {note}" for note, i in notes.items()), *shown.notes),
    )


def _cells(form: Table) -> list[list[str]]:
    """What is read of every cell, by columns; digits stay below each other where one fails."""
    out = []
    for cells in zip(*form.rows, strict=True):
        room = " " * len(_FAILS) if any(cell.failing for cell in cells) else ""
        out.append([c.text + (_FAILS if c.failing else room) for c in cells])
    return out


def _flat(form: Table, width: int) -> list[Text]:
    """Return heading and rows of a table with its columns side by side; none where they need more.

    Figures are in one line; words, and headings, are broken where room is short.
    """
    texts = _cells(form) or [[] for _ in form.columns]
    heads = [f"{c.group}\n{c.heading}" if c.group else c.heading for c in form.columns]
    right = [column.kind == "figures" for column in form.columns]
    sizes, most = [], []
    for figures, head, cells in zip(right, heads, texts, strict=True):
        pieces = cells if figures else [atom for text in cells for atom in _atoms(text)]
        sizes.append(max(map(cell_len, (*_atoms(head), *pieces)), default=0))
        lines = "\n".join((head, *cells)).split("\n")
        most.append(max(map(cell_len, lines)))
    gap = _GAP + (sum(most) + (_GAP + 1) * len(most) <= width)
    room = width - sum(sizes) - gap * (len(sizes) - 1) - 1
    if room < 0:
        return []
    # what a row is called stays in a line where it can; then the tightest column grows
    if form.columns[0].kind != "long words" and (more := most[0] - sizes[0]) <= room:
        sizes[0], room = most[0], room - more
    for _ in range(min(room, sum(most) - sum(sizes))):
        tightest = max(range(len(sizes)), key=lambda i: most[i] / max(sizes[i], 1))
        sizes[tightest] += 1
    titles = [wrapped(head, size) for head, size in zip(heads, sizes, strict=True)]
    high = max(map(len, titles))
    # a heading is just above its column, a cell beside the first line of its row
    rows = [([[""] * (high - len(title)) + title for title in titles], ["bold"] * len(sizes))]
    rows.append(([["─" * (sum(sizes) + gap * (len(sizes) - 1))]], [""]))
    for row, words in zip(form.rows, zip(*texts, strict=True), strict=True):
        cells = [
            text.split("\n") if figures else wrapped(text, size)
            for figures, text, size in zip(right, words, sizes, strict=True)
        ]
        rows.append((cells, [_style(cell) for cell in row]))
    return [line for cells, styles in rows for line in _beside(cells, sizes, right, styles, gap)]


def _beside(
    cells: Sequence[list[str]],
    sizes: Sequence[int],
    right: Sequence[bool],
    styles: Sequence[str],
    gap: int,
) -> Iterator[Text]:
    """Set the lines of cells side by side."""
    for texts in zip_longest(*cells, fillvalue=""):
        line = Text(" ")
        for text, size, at_right, style in zip(texts, sizes, right, styles, strict=False):
            space = " " * (size - cell_len(text))
            line.append(space if at_right else "").append(text, style or None)
            line.append(("" if at_right else space) + " " * gap)
        line.rstrip()
        yield line


def _blocks(form: Table, width: int) -> Iterator[Text]:
    """Return each row as its first cell with the others below it, a line for each."""
    heads = [column.title for column in form.columns]
    size = max(map(cell_len, heads[1:]), default=0)
    for row, words in zip(form.rows, zip(*_cells(form), strict=True), strict=True):
        yield Text(f" {words[0]}", "bold")
        for head, text, cell in zip(heads[1:], words[1:], row[1:], strict=True):
            for i, line in enumerate(wrapped(text.strip(), width - size - 5)):
                yield Text(f"   {'' if i else head:<{size}}  ").append(line, _style(cell) or None)


def _style(cell: Cell) -> str:
    return "bold red" if cell.failing else ""
