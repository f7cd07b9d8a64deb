"""A table as people read it, said once for the terminal, the report, spreadsheets and papers."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal

from flexstage.errors import ModelError


@dataclass(frozen=True, slots=True)
class Column:
    """A column of a table."""

    heading: str
    """What stands above it, with the unit of its figures."""
    kind: Literal["figures", "words", "long words", "title"] = "figures"
    """Figures stand at the right, words at the left; long words may be broken over lines; a title
    is what a row is called.
    """
    group: str = ""
    """Title above the headings of neighbouring columns that share it; empty for none."""


@dataclass(frozen=True, slots=True)
class Cell:
    """A cell of a table."""

    text: str
    """What is read: a word, or a number as it is shown."""
    value: float | None = None
    """The number, unrounded and in the unit of the column; None for words."""
    note: str = ""
    """Condition that belongs to it, where there is room: a pointer held on it, a comment."""
    small: str = ""
    """What stands below it in small print."""
    mark: Literal["", "ours", "variant"] = ""
    """Whether it is set off: as the best that is known here, or as another choice beside it."""
    failing: str = ""
    """What is required, where the figure fails it; it is marked by a word and by a colour."""
    names: Mapping[str, str | float] = field(default_factory=dict)
    """What a program that reads the table finds it by: quantity, axis, origin, value in SI."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Table:
    """A table; `table` makes one from short notation.

    Raises
    ------
    ModelError
        A row has another number of cells than there are columns.
    """

    caption: str
    """What it shows, in a sentence, or its title; empty where the words before it say so."""
    columns: tuple[Column, ...]
    """Its columns."""
    rows: tuple[tuple[Cell, ...], ...]
    """Its rows."""
    notes: tuple[str, ...] = ()
    """Remarks that stand below it."""
    divided: bool = False
    """Whether rows of one subject, that of their first cell, are set apart from the next."""

    def __post_init__(self) -> None:
        for row in self.rows:
            if len(row) != len(self.columns):
                raise ModelError(
                    f"a row of the table '{self.caption}' has {len(row)} cells, expected "
                    f"{len(self.columns)}"
                )

    @property
    def groups(self) -> tuple[tuple[str, int], ...]:
        """Titles above the headings, and how many columns each stands over; empty for none."""
        out: list[tuple[str, int]] = []
        for column in self.columns:
            if out and column.group and out[-1][0] == column.group:
                out[-1] = (column.group, out[-1][1] + 1)
            else:
                out.append((column.group, 1))
        return tuple(out) if any(title for title, _ in out) else ()

    @property
    def divisions(self) -> tuple[bool, ...]:
        """Whether a row begins another subject than the row before it."""
        subjects = [row[0].text if row else "" for row in self.rows]
        before = ["", *subjects[:-1]]
        return tuple(self.divided and s != b for s, b in zip(subjects, before, strict=True))


def table(
    caption: str,
    headings: Iterable[str | Column],
    rows: Iterable[Sequence[str | int | Cell]],
    *,
    notes: Iterable[str] = (),
    divided: bool = False,
) -> Table:
    """Return a table from headings and cells as they are written.

    A heading is that of a column of words where it is the first or begins with ``<``, which is
    taken off, and that of figures otherwise.

    Examples
    --------
    >>> made = table("Axes.", ("axis", "<drive", "stroke [µm]"), [("x", "PZ 1", "64.6")])
    >>> [column.kind for column in made.columns]
    ['words', 'words', 'figures']
    """
    columns = tuple(h if isinstance(h, Column) else _column(i, h) for i, h in enumerate(headings))
    return Table(
        caption=caption,
        columns=columns,
        rows=tuple(tuple(c if isinstance(c, Cell) else Cell(str(c)) for c in r) for r in rows),
        notes=tuple(notes),
        divided=divided,
    )


def _column(index: int, heading: str) -> Column:
    words = index == 0 or heading.startswith("<")
    return Column(heading.removeprefix("<"), "words" if words else "figures")
