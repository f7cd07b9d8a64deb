"""What a kind of file is: what it is called, how it begins, and what stands in it in its own way.

The fields of the classes are the format: a field's name is the key, its annotation says how the
value is written, its default says whether it can be left out. Nothing about a field is stated
twice, so a file cannot drift from the classes.
"""

import math
import types
import typing
from collections.abc import Callable, Mapping
from dataclasses import MISSING, Field, dataclass, field, fields, is_dataclass
from functools import lru_cache
from typing import Annotated, Any

from flexstage.base.errors import FlexstageError
from flexstage.quantities.units import DIMENSIONS, Dimension

#: Name of the dimension that an SI unit belongs to.
DIMENSION_OF_UNIT: dict[str, str] = {d.si: d.name for d in DIMENSIONS.values()}


@dataclass(frozen=True, slots=True, kw_only=True)
class Form:
    """How values of one type are written, where their fields do not say it."""

    read: Callable[[Any, Any, str, Any], Any]
    """Reads a value, from the decoder, the node, its path, and what it is where not given."""
    write: Callable[[Any, Any], Any] | None = None
    """Makes plain data, from the encoder and the value; None where no such file is written."""
    schema: Callable[[Any], dict[str, Any]] | None = None
    """Makes its JSON Schema, from the builder of schemas."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Format:
    """A kind of file."""

    noun: str
    """What it is called in messages."""
    key: str = ""
    """The key of its version, which its first line gives; empty where it has none."""
    begins: str = ""
    """How one begins that has no such key."""
    version: int = 1
    """Version of the format; no other is read."""
    error: type[FlexstageError]
    """What is raised where the file is at fault."""
    only: bool = False
    """Whether no other error is raised, whatever refuses a value."""
    families: Mapping[Any, Mapping[str, type]] = field(default_factory=dict)
    """Members of classes of which a file names the kind, by the word for it."""
    forms: Mapping[Any, Form] = field(default_factory=dict)
    """How values are written, by their type."""
    length_unit: bool = False
    """Whether it may say once the unit of lengths that are bare numbers."""
    parameters: bool = False
    """Whether it may name quantities, and give others as expressions in them."""
    longest: float = math.inf
    """Longest length of what it describes [m]."""
    shortest: float = 0.0
    """Shortest length of it, apart from 0 and from coordinates [m]."""
    finite: bool = True
    """Whether every number in it is finite."""
    later: bool = False
    """Whether keys that are not known are left out: a later version may have written them."""
    exact: bool = False
    """Whether programs alone write it: then 7 is no text, and 7.0 no whole number."""
    mend: str = ""
    """What is to be done about a file at fault; every message ends with it."""

    @property
    def ending(self) -> str:
        """The end of every message."""
        return f"; {self.mend}" if self.mend else ""


@lru_cache(maxsize=256)
def field_types(kind: type) -> dict[str, tuple[Field, Any]]:
    """Return the fields of a description with their types."""
    hints = typing.get_type_hints(kind, include_extras=True)
    return {f.name: (f, hints[f.name]) for f in fields(kind) if f.init}


def required(field: Field) -> bool:
    """Say whether a field must be given."""
    return field.default is MISSING and field.default_factory is MISSING


def union_parts(kind: Any) -> tuple[Any, ...]:
    """Return the types that ``X | Y`` joins; none for any other type."""
    is_union = typing.get_origin(kind) in (types.UnionType, typing.Union)
    return typing.get_args(kind) if is_union else ()


@lru_cache(maxsize=1024)
def optional_part(kind: Any) -> Any | None:
    """Return X of ``X | None``, X itself a union or not, and None for any other type."""
    parts = union_parts(kind)
    rest = [part for part in parts if part is not types.NoneType]
    if not rest or len(rest) == len(parts):
        return None
    return rest[0] if len(rest) == 1 else typing.Union[tuple(rest)]  # noqa: UP007


def dimension_of(kind: Any) -> tuple[Dimension, int] | None:
    """Return the dimension of a field of quantities, with how many it holds; 0 for a bare one."""
    if typing.get_origin(kind) is not Annotated:
        return None
    bare, *extras = typing.get_args(kind)
    dimension = next((e for e in extras if isinstance(e, Dimension)), None)
    return None if dimension is None else (dimension, len(typing.get_args(bare)))


def members(kind: Any, format: Format) -> Mapping[str, type] | None:
    """Return the classes of a family by the word for their kind; None for what is no family."""
    if kind in format.families:
        return format.families[kind]
    parts = union_parts(kind)
    if parts and all(is_dataclass(part) and hasattr(part, "kind") for part in parts):
        return {part.kind: part for part in parts}
    return None


def by_name(kind: Any, format: Format) -> bool:
    """Say whether things of a type are listed by their names: dataclasses with a name.

    One that has a form of its own holds its name.
    """
    has_name = isinstance(kind, type) and is_dataclass(kind) and "name" in field_types(kind)
    return has_name and kind not in format.forms


def check_name(name: str, refuse: Callable[[str], Any]) -> None:
    """Refuse a name that could not stand in a one-line message."""
    if not name.strip() or len(name) > 80 or not name.isprintable():
        refuse(f"a name must be 1 to 80 printable characters, got {name[:80]!r}")
