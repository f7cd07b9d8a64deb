"""Sections of a report as plain data: text, tables and pictures, independent of the output."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal, Union

from flexstage.quantities.table import Table


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
