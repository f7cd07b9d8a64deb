"""What a sheet of equations is made of: sections of paragraphs, formulas and tables."""

from dataclasses import dataclass

import sympy as sp

__all__ = ["Formula", "Item", "Paragraph", "Section", "Tabular"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Paragraph:
    """A sentence or two.

    Parameters
    ----------
    text : str
        Plain text.
    """

    text: str


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Formula:
    """An equation.

    Parameters
    ----------
    left : sympy.Basic or str
        Left side; LaTeX where it is a text.
    right : sympy.Basic or str
        Right side; LaTeX where it is a text.
    plain : str
        Left side in plain text, where `left` is LaTeX that does not read well as such.
    """

    left: sp.Basic | str
    right: sp.Basic | str
    plain: str = ""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Tabular:
    """A table of texts, numbers and expressions.

    Parameters
    ----------
    header : tuple
        Heads of the columns: texts or expressions.
    rows : tuple of tuple
        Cells: texts, numbers or expressions.
    """

    header: tuple[str | sp.Basic, ...]
    rows: tuple[tuple[str | float | sp.Basic, ...], ...]


Item = Paragraph | Formula | Tabular


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Section:
    """A section of the sheet.

    Parameters
    ----------
    key : str
        Short name by which a program finds it.
    title : str
        Its heading.
    items : tuple
        Paragraphs, formulas and tables in order.
    """

    key: str
    title: str
    items: tuple[Item, ...]
