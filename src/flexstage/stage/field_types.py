"""What the types of the fields of a description say about how a file writes them.

The format of a stage file is the constructors': a field's name is the key, its annotation says how
the value is written, its default says whether it can be left out. Nothing about a field is stated
twice, so the file cannot drift from the classes.
"""

import types
import typing
from collections.abc import Callable
from dataclasses import MISSING, Field, fields, is_dataclass
from functools import lru_cache
from typing import Any

from flexstage.hinges import Profile
from flexstage.hinges.registry import PROFILES
from flexstage.stage.drive import DRIVES, Drive
from flexstage.units import DIMENSIONS

#: Classes of which a file names the kind.
FAMILIES: dict[type, dict[str, type]] = {
    Drive: dict(DRIVES),
    Profile: dict(PROFILES),
}
#: Name of the dimension that a unit of a characteristic belongs to.
DIMENSION_OF_UNIT: dict[str, str] = {d.si: d.name for d in DIMENSIONS.values()}


@lru_cache(maxsize=64)
def field_types(kind: type) -> dict[str, tuple[Field, Any]]:
    """Return the fields of a description with their types."""
    hints = typing.get_type_hints(kind, include_extras=True)
    return {f.name: (f, hints[f.name]) for f in fields(kind) if f.init}


def required(field: Field) -> bool:
    """Say whether a field must be given."""
    return field.default is MISSING and field.default_factory is MISSING


def optional_part(kind: Any) -> Any | None:
    """Return X of ``X | None``, and None for any other type."""
    if typing.get_origin(kind) in (types.UnionType, typing.Union):
        rest = [a for a in typing.get_args(kind) if a is not types.NoneType]
        if len(rest) == 1 and len(rest) < len(typing.get_args(kind)):
            return rest[0]
    return None


def is_named(kind: Any) -> bool:
    """Say whether things of a type are listed by their names.

    They are dataclasses with a name, of which a stage has several.
    """
    return isinstance(kind, type) and is_dataclass(kind) and "name" in field_types(kind)


def check_name(name: str, refuse: Callable[[str], Any]) -> None:
    """Refuse a name that could not stand in a one-line message."""
    if not name.strip() or len(name) > 80 or not name.isprintable():
        refuse(f"a name must be 1 to 80 printable characters, got {name[:80]!r}")
