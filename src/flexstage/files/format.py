"""Kinds of files: name, version key, and types that have their own form.

The fields of the classes are the format: the name of a field is the key, its annotation determines
the form of the value, and a field with a default is optional. Nothing about a field is stated
twice, so that files and classes always agree.
"""

import math
import operator
import types
import typing
from collections.abc import Callable, Mapping
from dataclasses import MISSING, Field, dataclass, field, fields, is_dataclass
from functools import lru_cache, reduce
from typing import Annotated, Any

from flexstage.base.errors import FlexstageError
from flexstage.quantities.units import DIMENSIONS, Dimension

#: Name of the dimension of an SI unit.
DIMENSION_OF_UNIT: dict[str, str] = {d.si: d.name for d in DIMENSIONS.values()}


@dataclass(frozen=True, slots=True, kw_only=True)
class Form:
    """Form of the values of one type, where it does not follow from fields."""

    read: Callable[[Any, Any, str, Any], Any]
    """Reads a value, from decoder, node, path and default."""
    write: Callable[[Any, Any], Any] | None = None
    """Returns plain data, from encoder and value; None where no such file is written."""
    schema: Callable[[Any], dict[str, Any]] | None = None
    """Returns its JSON Schema, from the builder of schemas."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Format:
    """A kind of file."""

    noun: str
    """Name in messages."""
    key: str = ""
    """Key of the version, in the first line; empty for none."""
    begins: str = ""
    """Beginning of a file without such a key."""
    version: int = 1
    """Version of the format, the only one that is read."""
    error: type[FlexstageError]
    """Error of a faulty file."""
    only: bool = False
    """Raise this error only, whatever refuses a value."""
    families: Mapping[Any, Mapping[str, type]] = field(default_factory=dict)
    """Families of classes: members by the word for their kind in the file."""
    forms: Mapping[Any, Form] = field(default_factory=dict)
    """Forms of values by type."""
    bought: Mapping[Any, Callable[[], Mapping[str, Any]]] = field(default_factory=dict)
    """Keys of bought parts by designation, by the type that names one in its key ``as``."""
    length_unit: bool = False
    """The file may have a unit for lengths that are bare numbers."""
    parameters: bool = False
    """The file may define parameters, and use expressions of them."""
    longest: float = math.inf
    """Largest length [m]."""
    shortest: float = 0.0
    """Smallest length, apart from 0 and coordinates [m]."""
    finite: bool = True
    """All numbers are finite."""
    later: bool = False
    """Skip unknown keys: a later version may have written them."""
    exact: bool = False
    """Only programs write it: 7 is not a text, and 7.0 is not a whole number."""
    mend: str = ""
    """Remedy for a faulty file, the end of every message."""

    @property
    def ending(self) -> str:
        """End of every message."""
        return f"; {self.mend}" if self.mend else ""


@lru_cache(maxsize=256)
def field_types(kind: type) -> dict[str, tuple[Field, Any]]:
    """Return the fields of a description with their types."""
    hints = typing.get_type_hints(kind, include_extras=True)
    return {f.name: (f, hints[f.name]) for f in fields(kind) if f.init}


def required(field: Field) -> bool:
    """Return whether a field has no default."""
    return field.default is MISSING and field.default_factory is MISSING


def union_parts(kind: Any) -> tuple[Any, ...]:
    """Return the types of a union ``X | Y``; none for any other type."""
    is_union = typing.get_origin(kind) in (types.UnionType, typing.Union)
    return typing.get_args(kind) if is_union else ()


@lru_cache(maxsize=1024)
def optional_part(kind: Any) -> Any | None:
    """Return X of ``X | None``, X itself a union or not, and None for any other type."""
    parts = union_parts(kind)
    others = [part for part in parts if part is not types.NoneType]
    if not others or len(others) == len(parts):
        return None
    return others[0] if len(others) == 1 else reduce(operator.or_, others)


def dimension_of(kind: Any) -> tuple[Dimension, int] | None:
    """Return the dimension of a field of quantities and their number; 0 for a single one."""
    if typing.get_origin(kind) is not Annotated:
        return None
    bare, *extras = typing.get_args(kind)
    dimension = next((e for e in extras if isinstance(e, Dimension)), None)
    return None if dimension is None else (dimension, len(typing.get_args(bare)))


def members(kind: Any, format: Format) -> Mapping[str, type] | None:
    """Return the classes of a family by the word for their kind; None for any other type."""
    if kind in format.families:
        return format.families[kind]
    parts = union_parts(kind)
    if parts and all(is_dataclass(part) and hasattr(part, "kind") for part in parts):
        return {part.kind: part for part in parts}
    return None


def by_name(kind: Any, format: Format) -> bool:
    """Return whether a file lists objects of a type by name: dataclasses with a name.

    A type with its own form is not listed by name.
    """
    has_name = isinstance(kind, type) and is_dataclass(kind) and "name" in field_types(kind)
    return has_name and kind not in format.forms


def check_name(name: str, refuse: Callable[[str], Any]) -> None:
    """Refuse a name that does not fit into a one-line message."""
    if not name.strip() or len(name) > 80 or not name.isprintable():
        refuse(f"a name must be 1 to 80 printable characters, got {name[:80]!r}")
