"""A section of a report as plain data: whoever made a result says what is shown of it."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal, Union

from flexstage.quantities.table import Table


@dataclass(frozen=True, slots=True, kw_only=True)
class Picture:
    """A result that is drawn, by its type."""

    result: Any
    """The result, or a sequence of them where the drawing is of several."""
    title: str
    """What it shows, for who cannot see it."""
    caption: str
    """What stands below it, in sentences."""
    view: str = ""
    """Which of the drawings of its type; empty for the usual one."""
    options: Mapping[str, Any] = field(default_factory=dict)
    """What the drawing is told beside the result."""
    size: Literal["whole", "small", "tiny"] = "whole"
    """How much of the page it takes."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Pictures:
    """Pictures side by side."""

    shown: tuple[Picture, ...]
    """What is drawn; nothing where it is empty."""
    columns: Literal[1, 2, 3] = 1
    """How many stand beside each other where the page is wide enough."""


@dataclass(frozen=True, slots=True)
class Bullets:
    """Remarks, as a list."""

    items: Sequence[str]
    """One a line."""


@dataclass(frozen=True, slots=True)
class Definitions:
    """What things are called, and what they are."""

    entries: Mapping[str, str]
    """What it is, by name."""


#: What a section consists of; text is a paragraph.
Content = Union[str, Table, Picture, Pictures, Bullets, Definitions, "Section"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Section:
    """A section: paragraphs, tables, pictures and smaller sections in their order."""

    title: str
    """Its title; empty for none."""
    content: tuple[Content, ...]
    """What it consists of; a section without any is left out."""
    notes: tuple[str, ...] = ()
    """Remarks that are set off before it."""
    key: str = ""
    """What a link names it by; empty where none does."""
