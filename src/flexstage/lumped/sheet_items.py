"""What a sheet of equations is made of: sections of paragraphs, formulas and tables."""

from dataclasses import dataclass

import sympy as sp


@dataclass(frozen=True, slots=True, kw_only=True)
class Paragraph:
    """A sentence or two."""

    text: str
    """Plain text."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Formula:
    """An equation."""

    left: sp.Basic | str
    """Left side; LaTeX where it is a text."""
    right: sp.Basic | str
    """Right side; LaTeX where it is a text."""
    plain: str = ""
    """Left side in plain text, where `left` is LaTeX that does not read well as such."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Tabular:
    """A table of texts, numbers and expressions."""

    header: tuple[str | sp.Basic, ...]
    """Heads of the columns: texts or expressions."""
    rows: tuple[tuple[str | float | sp.Basic, ...], ...]
    """Cells: texts, numbers or expressions."""


Item = Paragraph | Formula | Tabular


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SheetSection:
    """A section of the sheet."""

    key: str
    """Short name by which a program finds it."""
    title: str
    """Its heading."""
    items: tuple[Item, ...]
    """Paragraphs, formulas and tables in order."""
