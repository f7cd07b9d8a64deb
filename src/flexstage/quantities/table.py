"""Tables of results and sections of a report as plain data, independent of the output."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, Literal, Union

from flexstage.base.errors import ModelError
from flexstage.base.lazy import data_frame

if TYPE_CHECKING:
    import pandas


@dataclass(frozen=True, slots=True)
class Column:
    """A column of a table."""

    heading: str
    """Heading with the unit of the values."""
    kind: Literal["figures", "words", "long words", "title"] = "figures"
    """Figures are aligned right, words left; long words may wrap; a title names its row."""
    group: str = ""
    """Common title above the headings of neighbouring columns; may be empty."""
    spare: bool = False
    """True for a column that may be omitted for lack of space."""

    @property
    def title(self) -> str:
        """Group and heading in one line."""
        return " ".join(f"{self.group} {self.heading}".split())


@dataclass(frozen=True, slots=True)
class Cell:
    """A cell of a table."""

    text: str
    """Printed text: a word, or a formatted number."""
    value: float | None = None
    """The number, unrounded and in the unit of the column; None for words."""
    note: str = ""
    """Condition of the value, shown as a tooltip or comment."""
    small: str = ""
    """Second line in small print."""
    mark: Literal["", "ours", "variant"] = ""
    """Emphasis: our best value, or a variant of it."""
    failing: str = ""
    """Limit that the value violates; a word and a colour mark the cell."""
    names: Mapping[str, str | float] = field(default_factory=dict)
    """Machine-readable keys: quantity, axis, origin, value in SI."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Table:
    """A table; `table` builds one from short notation.

    Raises
    ------
    ModelError
        The number of cells in a row differs from the number of columns.
    """

    caption: str
    """Caption or title; may be empty."""
    columns: tuple[Column, ...]
    """The columns."""
    rows: tuple[tuple[Cell, ...], ...]
    """The rows."""
    notes: tuple[str, ...] = ()
    """Remarks below the table."""
    divided: bool = False
    """True if a rule separates rows with different first cells."""

    def __post_init__(self) -> None:
        for row in self.rows:
            if len(row) != len(self.columns):
                raise ModelError(
                    f"a row of the table '{self.caption}' has {len(row)} cells, expected "
                    f"{len(self.columns)}"
                )

    @property
    def groups(self) -> tuple[tuple[str, int], ...]:
        """Group titles with their numbers of columns; empty without groups."""
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
        aligned = (
            [t.rjust(n) if r else t.ljust(n) for t, n, r in zip(line, sizes, right, strict=True)]
            for line in lines
        )
        return "\n".join("  ".join(cells).rstrip() for cells in aligned)

    def to_frame(self) -> "pandas.DataFrame":
        """Return the table as a data frame with unrounded numbers; needs pandas."""
        rows = [[c.text if c.value is None else c.value for c in row] for row in self.rows]
        return data_frame(rows, columns=[column.title for column in self.columns])

    @property
    def divisions(self) -> tuple[bool, ...]:
        """True for each row whose first cell differs from that of the previous row."""
        subjects = [row[0].text if row else "" for row in self.rows]
        before = ["", *subjects[:-1]]
        return tuple(self.divided and s != b for s, b in zip(subjects, before, strict=True))

    def narrower(self) -> Iterator["Table"]:
        """Yield the table, then constant columns in its caption, then no spare columns."""
        yield self
        columns, constants = [], []
        for i, column in enumerate(self.columns):
            texts = [row[i].text for row in self.rows]
            # a number that some rows lack is not constant
            compared = texts if column.kind == "figures" else [text for text in texts if text]
            if i and column.title and len(set(compared)) == 1 < len(compared):
                constants.append(f"{column.title}: {compared[0]}")
            else:
                columns.append(i)
        spare = [i for i in columns if self.columns[i].spare]
        names = dict.fromkeys(self.columns[i].heading for i in spare)
        not_shown = f"not shown: {', '.join(names)}"
        narrowest = sorted({*columns} - {*spare}), (not_shown,) * bool(spare)
        for indices, remarks in ((columns, ()), narrowest):
            parts = (self.caption.removesuffix("."), *constants, *remarks)
            yield replace(
                self,
                caption="; ".join(filter(None, parts)),
                columns=tuple(self.columns[i] for i in indices),
                rows=tuple(tuple(row[i] for i in indices) for row in self.rows),
            )


def table(
    caption: str,
    headings: Iterable[str | Column],
    rows: Iterable[Sequence[str | int | Cell]],
    *,
    notes: Iterable[str] = (),
    divided: bool = False,
) -> Table:
    """Return a table from headings and cells in short notation.

    The first column and those whose headings begin with ``<`` have words, the others figures. A
    preceding ``~`` marks a spare column. Both characters are removed.

    Examples
    --------
    >>> axes = table("Axes.", ("axis", "<drive", "stroke [µm]"), [("x", "PZ 1", "64.6")])
    >>> [column.kind for column in axes.columns]
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


@dataclass(frozen=True, slots=True, kw_only=True)
class Picture:
    """A picture of a result; the type of the result selects the plot."""

    result: Any
    """The result, or a sequence of results."""
    title: str
    """Text alternative for readers who cannot see it."""
    caption: str
    """Caption."""
    view: str = ""
    """Plot, if the type of the result has several; empty for the default."""
    options: Mapping[str, Any] = field(default_factory=dict)
    """Further arguments of the plot."""
    size: Literal["whole", "small", "tiny"] = "whole"
    """Size on the page."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Pictures:
    """Pictures side by side."""

    pictures: tuple[Picture, ...]
    """The pictures; may be empty."""
    columns: Literal[1, 2, 3] = 1
    """Number of columns on a wide page."""


@dataclass(frozen=True, slots=True)
class Bullets:
    """A list of remarks."""

    items: Sequence[str]
    """The remarks."""


@dataclass(frozen=True, slots=True)
class Definitions:
    """A list of terms with definitions."""

    entries: Mapping[str, str]
    """Definitions by term."""


#: Content of a section; a text is a paragraph.
Content = Union[str, Table, Picture, Pictures, Bullets, Definitions, "Section"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Section:
    """A section: paragraphs, tables, pictures and smaller sections in their order."""

    title: str
    """Title; may be empty."""
    content: tuple[Content, ...]
    """Content; a section without content is omitted."""
    notes: tuple[str, ...] = ()
    """Remarks before the content."""
    key: str = ""
    """Target of links; may be empty."""
