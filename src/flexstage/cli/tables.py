"""Layout of tables on a terminal: unbroken numbers and words, in fewer columns if need be."""

import re
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from rich import box
from rich.cells import cell_len
from rich.table import Table as Grid
from rich.text import Text

from flexstage.quantities.table import Cell, Column, Table

if TYPE_CHECKING:
    from rich.console import Console, ConsoleOptions, RenderableType

_SIGNS = ("±", "<", "≥", "≤", "≈")
_AFTER_SIGN = re.compile(r".*[±<≥≤≈]|\[\d+\]")
_NUMBER = re.compile(r"(?:.*[\s(])?[-+−]?\d[\d.]*(?:e[-+]?\d+)?")
_UNIT = re.compile(r"(?:%|°|(?:[A-Za-zµ]{1,4}|arcsec)[²³]?(?:[/·][A-Za-zµ]{1,4}[²³]?)*)[,;.:)]*")


@dataclass(frozen=True, slots=True)
class TableLayout:
    """A table for rich, in the widest of its forms that fits.

    If none fits, each row is a block of lines. Notes of cells are numbered below the table.
    """

    table: Table

    def __rich_console__(
        self, console: "Console", options: "ConsoleOptions"
    ) -> "Iterator[RenderableType]":
        width = options.max_width
        forms = list(_numbered(self.table).narrower())
        candidates = [(form, *layout) for form in forms if (layout := _flat(form, width))]
        flat = [
            candidate for candidate in candidates if candidate[1] <= 2 * len(candidate[0].rows) + 3
        ]
        fewest = sorted(candidates, key=lambda candidate: candidate[1])
        form, _, grid = (*flat, *fewest, (forms[-1], 0, None))[0]
        yield from _lines(form.caption, width, "italic")
        yield from _blocks(form, width) if grid is None else (grid,)
        yield from _lines("; ".join(form.notes), width, "dim")
        yield Text()


def _lines(text: str, width: int, style: str) -> Iterator[Text]:
    """Yield a text in lines; an unbreakable word, such as a path, stays on one line."""
    for line in wrapped(text, width):
        yield Text(line, style, no_wrap=True, overflow="ignore")


def wrapped(text: str, width: int) -> list[str]:
    """Wrap a text between words, but not within a number, its ± and its unit."""
    lines = []
    for line in text.split("\n") if text else ():
        lines.append("")
        for atom in _atoms(line):
            if lines[-1] and cell_len(lines[-1]) + 1 + cell_len(atom) > width:
                lines.append("")
            lines[-1] += f" {atom}" if lines[-1] else atom
    return lines


def _atoms(text: str) -> list[str]:
    atoms: list[str] = []
    for word in text.split():
        before = atoms[-1] if atoms else ""
        of_number = _NUMBER.fullmatch(before) and _UNIT.fullmatch(word)
        after_sign = word in _SIGNS or (_AFTER_SIGN.fullmatch(before) and word[0] != "[")
        if before and (after_sign or of_number or (before.endswith("N") and word == "m/rad")):
            atoms[-1] += f" {word}"
        else:
            atoms.append(word)
    return atoms


def _numbered(table: Table) -> Table:
    """Replace the notes of cells by a column of numbers, with the notes below the table."""
    notes: dict[str, int] = {}
    rows = []
    for row in table.rows:
        cell_notes = [t for c in row for t in (c.failing and f"fails: {c.failing}", c.note) if t]
        marks = (
            f"[{notes.setdefault(note, len(notes) + 1)}]" for note in dict.fromkeys(cell_notes)
        )
        rows.append((*row, Cell(" ".join(marks))))
    if not notes:
        return table
    below = (*(f"[{i}] {note}" for note, i in notes.items()), *table.notes)
    columns = (*table.columns, Column("", "words"))
    return replace(table, columns=columns, rows=tuple(rows), notes=below)


def _cells(cells: Iterable[Cell]) -> list[str]:
    """Return the texts of cells, padded so that their digits are aligned."""
    both = [(c.text, f" {c.small}" * bool(c.small) + " fails" * bool(c.failing)) for c in cells]
    longest = max((len(tail) for _, tail in both), default=0)
    return [text + tail.ljust(longest) for text, tail in both]


def _flat(form: Table, width: int) -> tuple[int, Grid] | None:
    """Return the number of lines of columns side by side, and their grid; None if too wide.

    Numbers stay on one line; words and headings are wrapped if need be.
    """
    texts = [_cells(row[i] for row in form.rows) for i in range(len(form.columns))]
    heads = [f"{c.group}\n{c.heading}" if c.group else c.heading for c in form.columns]
    heads = [head.replace("\u00ad", "") for head in heads]  # a terminal would show it
    right = [column.kind == "figures" for column in form.columns]
    sizes, most = [], []
    for figures, head, cells in zip(right, heads, texts, strict=True):
        pieces = cells if figures else [atom for text in cells for atom in _atoms(text)]
        sizes.append(max(map(cell_len, (*_atoms(head), *pieces)), default=0))
        most.append(max(map(cell_len, "\n".join((head, *cells)).split("\n"))))
    gap = 3 if sum(most) + 3 * len(most) <= width else 2
    room = width - sum(sizes) - gap * (len(sizes) - 1)
    if room < 0:
        return None
    # the name of a row stays on one line if possible; then the tightest column grows
    if form.columns[0].kind != "long words" and (extra := most[0] - sizes[0]) <= room:
        sizes[0], room = most[0], room - extra
    for _ in range(min(room, sum(most) - sum(sizes))):
        sizes[max(range(len(sizes)), key=lambda i: most[i] / max(sizes[i], 1))] += 1
    titles = [wrapped(head, size) for head, size in zip(heads, sizes, strict=True)]
    deepest = max(map(len, titles))
    grid = Grid(box=box.SIMPLE_HEAD, padding=(0, gap - 1, 0, 0), show_edge=False, pad_edge=False)
    broken = []
    for figures, title, text, size in zip(right, titles, texts, sizes, strict=True):
        # numbers are right-aligned, headings bottom-aligned, cells top-aligned
        cells = [[""] * (deepest - len(title)) + title]
        cells += [[t] if figures else wrapped(t, size) for t in text]
        at = size if figures else 0
        head, *below = ("\n".join(" " * (at - cell_len(t)) + t for t in c) for c in cells)
        grid.add_column(Text(head), width=size, no_wrap=True)
        broken.append(below)
    rows = list(zip(*broken, strict=True))
    for row, words in zip(form.rows, rows, strict=True):
        grid.add_row(*map(Text, words, ("bold red" * bool(cell.failing) for cell in row)))
    return sum(max(text.count("\n") + 1 for text in words) for words in rows), grid


def _blocks(form: Table, width: int) -> Iterator[Text]:
    """Yield each row as its first cell, with the others below it, a line for each."""
    heads = [column.title for column in form.columns]
    size = max(map(cell_len, heads[1:]), default=0)
    for first, *others in form.rows:
        yield Text(first.text, "bold")
        for head, cell in zip(heads[1:], others, strict=True):
            for i, line in enumerate(wrapped(_cells([cell])[0], width - size - 4)):
                yield Text(
                    f"  {'' if i else head:<{size}}  {line}", "bold red" * bool(cell.failing)
                )
