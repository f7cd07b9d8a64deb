"""A table as people read it, said once for the terminal, the report, spreadsheets and papers."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Literal

from flexstage.base.errors import ModelError
from flexstage.base.lazy import data_frame

if TYPE_CHECKING:
    import pandas


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
    spare: bool = False
    """Whether it may be left out where there is no room."""

    @property
    def title(self) -> str:
        """Its whole heading in one line."""
        return " ".join(f"{self.group} {self.heading}".split())


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

    def __str__(self) -> str:
        lines = [[c.heading for c in self.columns], *([cell.text for cell in r] for r in self.rows)]
        sizes = [max(map(len, column)) for column in zip(*lines, strict=True)]
        right = [column.kind == "figures" for column in self.columns]
        made = (
            [t.rjust(n) if r else t.ljust(n) for t, n, r in zip(line, sizes, right, strict=True)]
            for line in lines
        )
        return "\n".join("  ".join(cells).rstrip() for cells in made)

    def to_frame(self) -> "pandas.DataFrame":
        """Return it as a data frame, numbers unrounded where it has them; needs pandas."""
        rows = [[c.text if c.value is None else c.value for c in row] for row in self.rows]
        return data_frame(rows, columns=[column.title for column in self.columns])

    @property
    def divisions(self) -> tuple[bool, ...]:
        """Whether a row begins another subject than the row before it."""
        subjects = [row[0].text if row else "" for row in self.rows]
        before = ["", *subjects[:-1]]
        return tuple(self.divided and s != b for s, b in zip(subjects, before, strict=True))

    def narrower(self) -> Iterator["Table"]:
        """Yield it whole; with what is alike in all rows said once; without what can be spared."""
        yield self
        kept, said = [], []
        for i, column in enumerate(self.columns):
            texts = [row[i].text for row in self.rows]
            # a figure that some rows lack is not said of all
            told = texts if column.kind == "figures" else [text for text in texts if text]
            if i and column.title and len(set(told)) == 1 < len(told):
                said.append(f"{column.title}: {told[0]}")
            else:
                kept.append(i)
        spare = [i for i in kept if self.columns[i].spare]
        names = dict.fromkeys(self.columns[i].heading for i in spare)
        not_shown = f"not shown: {', '.join(names)}"
        for left, more in ((kept, ()), (sorted({*kept} - {*spare}), (not_shown,) * bool(spare))):
            yield replace(
                self,
                caption="; ".join(filter(None, (self.caption.removesuffix("."), *said, *more))),
                columns=tuple(self.columns[i] for i in left),
                rows=tuple(tuple(row[i] for i in left) for row in self.rows),
            )


def table(
    caption: str,
    headings: Iterable[str | Column],
    rows: Iterable[Sequence[str | int | Cell]],
    *,
    notes: Iterable[str] = (),
    divided: bool = False,
) -> Table:
    """Return a table from headings and cells as they are written.

    A heading is that of a column of words where it is the first or begins with ``<``, and that of
    figures otherwise; before that, ``~`` says that the column can be spared. Both are taken off.

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
    spare, heading = heading.startswith("~"), heading.removeprefix("~")
    words = index == 0 or heading.startswith("<")
    return Column(heading.removeprefix("<"), "words" if words else "figures", spare=spare)
