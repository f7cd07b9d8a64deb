"""JSON Schema of a kind of file, from its classes, for completion and checks in editors."""

import ast
import collections.abc
import functools
import inspect
import math
import textwrap
import threading
import typing
from collections.abc import Callable, Mapping
from typing import Annotated, Any, Literal

from flexstage.files.format import (
    Format,
    by_name,
    dimension_of,
    field_types,
    members,
    optional_part,
    required,
    union_parts,
)
from flexstage.files.parameters import KEY as PARAMETERS
from flexstage.files.ranges import range_of, written_as
from flexstage.files.request import Request, request_fields
from flexstage.quantities.units import DIMENSIONS, Dimension

_NUMBER = r"[+-]?([0-9]+(\.[0-9]*)?|\.[0-9]+)([eE][+-]?[0-9]+)?"
_UNIT = "[A-Za-zµμ°1]"
_EXPRESSION = r"^\s*="
# concurrent parsing confuses the recursion depth (Python 3.11)
_ONE_PARSES = threading.Lock()
_PLAIN: dict[Any, Any] = {
    str: {"type": ["string", "number", "boolean"]},
    bool: {"type": "boolean"},
    float: {"type": "number"},
    int: {"type": "integer"},
    Any: {},
}


def file_schema(format: Format, cls: type) -> dict[str, Any]:
    """Return the JSON Schema (draft 2020-12) of files of a kind, with a class as content."""
    builder = SchemaBuilder(format)
    content = builder.describe(cls, named=True)
    head: dict[str, Any] = {}
    if format.key:
        version = {"const": format.version, "description": "Version of the file format."}
        head[format.key] = version
    if format.length_unit:
        head["length_unit"] = {
            "enum": list(DIMENSIONS["length"].units),
            "description": "Unit of lengths that are written without one.",
        }
    if format.parameters:
        head[PARAMETERS] = _parameters_schema()
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": f"flexstage {format.noun}",
        "description": content["description"],
        "type": "object",
        "properties": {**head, **content["properties"]},
        "additionalProperties": False,
        "required": [*([format.key] if format.key else []), *content["required"]],
        "$defs": dict(sorted(builder.definitions.items())),
    }


def _parameters_schema() -> dict[str, Any]:
    value = {"type": ["string", "number"], "examples": ["0.5 mm", "= 2*R + t"]}
    described = {
        "type": "object",
        "properties": {
            "value": value,
            "description": {"type": "string", "description": "What it is."},
        },
        "additionalProperties": False,
        "required": ["value"],
    }
    return {
        "type": "object",
        "description": "Named numbers and quantities, for expressions such as '= 2*R + t'.",
        "propertyNames": {"pattern": "^[A-Za-z][A-Za-z0-9_]*$"},
        "additionalProperties": {"anyOf": [value, described]},
    }


class SchemaBuilder:
    """Builder of schemas of types, with shared definitions."""

    def __init__(self, format: Format) -> None:
        self.format = format
        self.definitions: dict[str, Any] = {}

    def define(self, name: str, make: Callable[[], dict[str, Any]]) -> dict[str, str]:
        """Return a reference to a shared schema, made on first use."""
        if name not in self.definitions:
            self.definitions[name] = {}
            self.definitions[name] = make()
        return {"$ref": f"#/$defs/{name}"}

    def of(self, kind: Any) -> dict[str, Any]:
        """Return the schema of values of a type."""
        form = self.format.forms.get(kind)
        if form is not None and form.schema is not None:
            make = form.schema
            return self.define(kind.__name__, lambda: make(self))
        if (family := members(kind, self.format)) is not None:
            name = getattr(kind, "__name__", " or ".join(p.__name__ for p in union_parts(kind)))
            return self.define(name, lambda: self.bought(kind, self.family(family)))
        if (inner := optional_part(kind)) is not None:
            return {"anyOf": [self.of(inner), {"type": "null"}]}
        if parts := union_parts(kind):
            return {"anyOf": [self.of(part) for part in parts]}
        if (quantity := dimension_of(kind)) is not None:
            dimension, count = quantity
            one = self.quantity(dimension)
            return self.list_of(one, count) if count else one
        origin = typing.get_origin(kind)
        if origin is Annotated:
            if (spelled := written_as(kind)) is not None and spelled.read is not None:
                return {"type": ["string", "number"]}
            return _in_per_cent(kind, self.of(typing.get_args(kind)[0]) | _bounds(kind))
        if origin is tuple:
            parts = typing.get_args(kind)
            if parts[-1] is not Ellipsis:
                return self.list_of(self.of(parts[0]), len(parts))
            if by_name(parts[0], self.format):
                return {"type": "object", "additionalProperties": self.of(parts[0])}
            return {"type": "array", "items": self.of(parts[0])}
        if origin in (dict, collections.abc.Mapping):
            return {"type": "object", "additionalProperties": self.of(typing.get_args(kind)[1])}
        if origin is Literal:
            return {"enum": list(typing.get_args(kind))}
        if kind in (float, int) and self.format.parameters:
            return {"type": [_PLAIN[kind]["type"], "string"], "pattern": _EXPRESSION}
        if kind in _PLAIN:
            return dict(_PLAIN[kind])
        return self.define(kind.__name__, lambda: self.bought(kind, self.describe(kind)))

    def describe(
        self, cls: type, kind: str | None = None, *, named: bool = False
    ) -> dict[str, Any]:
        """Return the schema of a mapping with the fields of a class.

        `kind` is its word in a family; with `named`, its name is one of the fields.
        """
        texts = field_texts(cls)
        properties: dict[str, Any] = {} if kind is None else {"kind": {"const": kind}}
        needed = [] if kind is None else ["kind"]
        for name, (field, annotation) in field_types(cls).items():
            if name == "name" and by_name(cls, self.format) and not named:
                continue
            properties[name] = dict(self.of(annotation))
            if name in texts:
                properties[name]["description"] = texts[name]
            if required(field):
                needed.append(name)
        return {
            "type": "object",
            "description": (inspect.getdoc(cls) or cls.__name__).splitlines()[0],
            "properties": properties,
            "additionalProperties": False,
            "required": needed,
        }

    def family(self, among: Mapping[str, type]) -> dict[str, Any]:
        """Return the schema of a family, whose member the file names by kind."""
        # a branch for each kind, so that an editor checks keys against this kind
        return {
            "type": "object",
            "required": ["kind"],
            "properties": {"kind": {"enum": list(among)}},
            "allOf": [
                {
                    "if": {"properties": {"kind": {"const": kind}}, "required": ["kind"]},
                    "then": self.describe(cls, kind),
                }
                for kind, cls in among.items()
            ],
        }

    def bought(self, kind: Any, schema: dict[str, Any]) -> dict[str, Any]:
        """Return the schema of a mapping, which may name a bought part in its key ``as``."""
        if kind not in self.format.bought:
            return schema
        parts = self.format.bought[kind]()
        branches = {
            branch["if"]["properties"]["kind"]["const"]: branch["then"]
            for branch in schema.get("allOf", ())
        }
        for word, member in (branches or {"": schema}).items():
            of_kind = {
                name: part.items
                for name, part in parts.items()
                if "kind" not in part.items or part.items["kind"].text == word
            }
            if of_kind:
                keys = {key for part in of_kind.values() for key in part}
                member["properties"] = {"as": _bought(of_kind), **member["properties"]}
                needed = [key for key in member["required"] if key in keys]
                member["required"] = [key for key in member["required"] if key not in keys]
                if needed:
                    member["anyOf"] = [{"required": ["as"]}, {"required": needed}]
        if branches:
            schema["properties"]["as"] = _bought(parts)
            schema["anyOf"] = [{"required": [key]} for key in [*schema.pop("required"), "as"]]
        return schema

    def quantity(self, dimension: Dimension) -> dict[str, Any]:
        """Return the schema of a number with its unit."""
        bare = dimension.name == "length" and self.format.length_unit

        def make() -> dict[str, Any]:
            # a bare length may be quoted, other quantities need a unit
            pattern = rf"^\s*{_NUMBER}\s*{'' if bare else _UNIT}"
            if self.format.parameters:
                pattern = f"{_EXPRESSION}|{pattern}"
            text = {
                "type": "string",
                "pattern": pattern,
                "examples": [f"10 {unit}" for unit in dimension.units],
            }
            return {"anyOf": [text, {"type": "number"}]} if bare else text

        return self.define(f"quantity-{dimension.name}", make)

    @staticmethod
    def list_of(item: dict[str, Any], count: int) -> dict[str, Any]:
        """Return the schema of a list of some length."""
        return {"type": "array", "items": item, "minItems": count, "maxItems": count}


def _bought(parts: Mapping[str, Any]) -> dict[str, Any]:
    return {"enum": sorted(parts), "description": "A bought part, whose keys it has."}


def _in_per_cent(kind: Any, number: dict[str, Any]) -> dict[str, Any]:
    """Return the schema of a number that may be written in per cent where it is a share."""
    bounds = range_of(kind)
    if bounds is None or not bounds[0].is_share or typing.get_args(kind)[0] is not float:
        return number
    return {"anyOf": [number, {"type": "string", "pattern": rf"^\s*{_NUMBER}\s*%\s*$"}]}


def _bounds(kind: Any) -> dict[str, Any]:
    """Return the limits of a number in a schema."""
    entry = range_of(kind)
    if entry is None:
        return {}
    range_ = entry[0]
    bounds: dict[str, Any] = {}
    if math.isfinite(range_.low):
        bounds["exclusiveMinimum" if range_.above else "minimum"] = range_.low
    if math.isfinite(range_.high):
        bounds["exclusiveMaximum" if range_.below else "maximum"] = range_.high
    return bounds


def field_texts(cls: type) -> dict[str, str]:
    """Return the text below each field of a class; its own replace inherited ones."""
    texts: dict[str, str] = {}
    for base in reversed(cls.__mro__):
        if "__annotations__" in vars(base):
            texts |= _own_texts(base)
    return texts


def part_texts(cls: type[Request]) -> str:
    """Return the help of the parts of a request that is one option."""
    texts = field_texts(cls)
    return " ".join(f"{f.name}={f.metavar}: {texts[f.name]}" for f in request_fields(cls).values())


# parses the source of the class
@functools.lru_cache(maxsize=512)
def _own_texts(cls: type) -> dict[str, str]:
    with _ONE_PARSES:
        definition = ast.parse(textwrap.dedent(inspect.getsource(cls))).body[0]
    assert isinstance(definition, ast.ClassDef)
    texts = {}
    for field, text in zip(definition.body, definition.body[1:], strict=False):
        if (
            isinstance(field, ast.AnnAssign)
            and isinstance(field.target, ast.Name)
            and isinstance(text, ast.Expr)
            and isinstance(text.value, ast.Constant)
            and isinstance(text.value.value, str)
        ):
            texts[field.target.id] = " ".join(text.value.value.split())
    return texts
