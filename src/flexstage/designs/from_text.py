"""Parameters of a design read from plain data: texts with units, numbers, nested mappings.

Everything is derived from the dataclass that holds the parameters: its fields are the keys, and a
field that is annotated with a dimension takes a text with a unit.
"""

import dataclasses
import math
import types
import typing
from collections.abc import Iterable, Mapping
from functools import cache
from typing import Any, TypeVar

from flexstage.choose import did_you_mean
from flexstage.errors import StageError, UnitError
from flexstage.material import Material, material
from flexstage.units import Dimension, parse

_P = TypeVar("_P")


def parameters_from_text(
    parameters: type[_P], given: Mapping[str, object], *, base: _P | None = None, path: str = ""
) -> _P:
    """Read the parameters of a design.

    A field may be a number, a quantity (``Annotated`` with a dimension: a text with a unit), a pair
    of them, a material (the name of one in the catalogue), another such dataclass (a mapping), or
    one of several that are told apart by ``kind``; and it may be optional. What is not given is
    taken from `base`; `path` is where the mapping stands, for messages.

    Examples
    --------
    >>> from flexstage.designs.parallelogram import ParallelogramParameters
    >>> p = parameters_from_text(ParallelogramParameters, {"leg_spacing": "35 mm"})
    >>> p.leg_spacing
    0.035
    """
    fields = {f.name: f for f in dataclasses.fields(parameters) if f.init}  # type: ignore[arg-type]
    for key in given:
        if key not in fields:
            raise StageError(_unknown("parameter", f"{path}{key}", str(key), fields))
    hints = _hints(parameters)
    values: dict[str, Any] = {}
    for name, field in fields.items():
        default = getattr(base, name) if base is not None else None
        if name in given:
            values[name] = _value(hints[name], given[name], default, f"{path}{name}")
        elif base is not None:
            values[name] = default
        elif field.default is dataclasses.MISSING and field.default_factory is dataclasses.MISSING:
            start = "" if path else ", or name a design to start from in 'based_on'"
            raise StageError(f"the parameter '{path}{name}' is missing: give it{start}")
    return parameters(**values)


@cache
def _hints(parameters: type) -> dict[str, Any]:
    return typing.get_type_hints(parameters, include_extras=True)


def _value(hint: Any, given: object, base: object, path: str) -> Any:
    """Read one value of the type that an annotation asks for."""
    dimension = None
    if typing.get_origin(hint) is typing.Annotated:
        hint, *extras = typing.get_args(hint)
        dimension = next((e for e in extras if isinstance(e, Dimension)), None)
    if typing.get_origin(hint) in {types.UnionType, typing.Union}:
        return _one_of(typing.get_args(hint), given, base, path)
    if typing.get_origin(hint) is tuple:
        members = typing.get_args(hint)
        if not isinstance(given, (list, tuple)) or len(given) != len(members):
            raise StageError(f"the parameter '{path}' must be a list of {len(members)} values")
        return tuple(
            _scalar(member, dimension, item, f"{path}[{i}]")
            for i, (member, item) in enumerate(zip(members, given, strict=True))
        )
    if hint is Material:
        return _material(given, base, path)
    if dataclasses.is_dataclass(hint):
        kind = typing.cast("type", hint)
        return parameters_from_text(
            kind,
            _mapping(given, path),
            base=base if isinstance(base, kind) else None,
            path=f"{path}.",
        )
    return _scalar(hint, dimension, given, path)


def _one_of(members: tuple[Any, ...], given: object, base: object, path: str) -> Any:
    """Read a value of one of several types: None, a quantity, or a dataclass told by its kind."""
    if given is None and type(None) in members:
        return None
    members = tuple(m for m in members if m is not type(None))
    if len(members) == 1:
        return _value(members[0], given, base, path)
    content = dict(_mapping(given, path))
    kinds = {str(getattr(m, "kind", m.__name__)): m for m in members}
    if "kind" in content:
        name = str(content.pop("kind"))
        if name not in kinds:
            raise StageError(_unknown("kind", f"{path}.kind: {name}", name, kinds))
        chosen = kinds[name]
    elif type(base) in members:
        chosen = type(base)
    else:
        raise StageError(f"the parameter '{path}' needs a 'kind', one of {', '.join(kinds)}")
    return _value(chosen, content, base, path)


def _material(given: object, base: object, path: str) -> Material:
    if isinstance(given, str):
        return material(given)
    start = base if isinstance(base, Material) else None
    return parameters_from_text(Material, _mapping(given, path), base=start, path=f"{path}.")


def _scalar(kind: Any, dimension: Dimension | None, given: object, path: str) -> Any:
    if dimension is not None:
        try:
            return parse(given, dimension.name)
        except UnitError as error:
            raise UnitError(f"the parameter '{path}': {error}") from error
    if kind is str and isinstance(given, str):
        return given
    is_number = isinstance(given, (int, float)) and not isinstance(given, bool)
    if kind is float and is_number and math.isfinite(typing.cast("float", given)):
        return float(typing.cast("float", given))
    if kind in {int, bool} and type(given) is kind:
        return given
    nouns = {float: "a number without a unit", str: "a text", int: "a whole number"}
    raise StageError(
        f"the parameter '{path}' must be {nouns.get(kind, 'true or false')}, got {_short(given)}"
    )


def _mapping(given: object, path: str) -> Mapping[str, object]:
    if not isinstance(given, Mapping):
        raise StageError(f"the parameter '{path}' must be a mapping of names, got {_short(given)}")
    return given


def _unknown(noun: str, what: str, name: str, known: Iterable[str]) -> str:
    names = sorted(known)
    hint = did_you_mean(name, names, 0.4)
    return f"unknown {noun} '{what[:100]}' (there are: {', '.join(names)}){hint}"


def _short(value: object) -> str:
    text = repr(value)
    return text if len(text) <= 60 else text[:57] + "..."
