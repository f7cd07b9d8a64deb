"""The JSON Schema of stage files, derived from the classes; editors complete and check with it.

``python -m flexstage.stage.schema`` writes it to ``stage.schema.json`` beside this file.
"""

import inspect
import json
import re
import typing
from pathlib import Path
from typing import Annotated, Any

from flexstage.characteristic import ORIGINS, Characteristic
from flexstage.field_texts import field_texts
from flexstage.material import CATALOGUE, Material
from flexstage.quantities import QUANTITIES
from flexstage.stage.field_types import FAMILIES, field_types, is_named, optional_part, required
from flexstage.stage.model import Stage
from flexstage.stage.outline import Circle, Loop
from flexstage.units import DIMENSIONS, Dimension

#: The schema that is shipped with the package.
SCHEMA_PATH = Path(__file__).with_name("stage.schema.json")

_NUMBER = r"[+-]?([0-9]+(\.[0-9]*)?|\.[0-9]+)([eE][+-]?[0-9]+)?"


def stage_schema() -> dict[str, Any]:
    """Return the JSON Schema (draft 2020-12) of stage files."""
    builder = _Builder()
    stage = builder.describe(Stage)
    needed = stage.pop("required")
    properties = {
        "flexstage": {"const": 1, "description": "Version of the file format."},
        "length_unit": {
            "enum": list(DIMENSIONS["length"].units),
            "description": "Unit of lengths that are written without one.",
        },
        "design": {
            "type": "object",
            "description": "A parametric design by name, with its parameters.",
            "properties": {"name": {"type": "string"}},
            "required": ["name"],
        },
        **stage["properties"],
    }
    only = {"flexstage", "length_unit", "design"}
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": "flexstage stage file",
        "description": stage["description"],
        "type": "object",
        "properties": properties,
        "additionalProperties": False,
        "required": ["flexstage"],
        "if": {"required": ["design"]},
        "then": {"propertyNames": {"enum": sorted(only)}},
        "else": {"required": needed},
        "$defs": dict(sorted(builder.definitions.items())),
    }


def schema_text() -> str:
    """Return the schema as the text of its file."""
    return json.dumps(stage_schema(), indent=2, ensure_ascii=False) + "\n"


class _Builder:
    def __init__(self) -> None:
        self.definitions: dict[str, Any] = {}

    def define(self, name: str, make: Any) -> dict[str, str]:
        if name not in self.definitions:
            self.definitions[name] = {}
            self.definitions[name] = make()
        return {"$ref": f"#/$defs/{name}"}

    def of(self, kind: Any) -> dict[str, Any]:
        if (inner := optional_part(kind)) is not None:
            return {"anyOf": [self.of(inner), {"type": "null"}]}
        origin = typing.get_origin(kind)
        if origin is Annotated:
            bare, dimension = typing.get_args(kind)
            one = self.quantity(dimension)
            if typing.get_origin(bare) is tuple:
                return _list_of(one, len(typing.get_args(bare)))
            return one
        if origin is tuple:
            parts = typing.get_args(kind)
            if parts[-1] is not Ellipsis:
                return _list_of(self.of(parts[0]), len(parts))
            if is_named(parts[0]):
                return {"type": "object", "additionalProperties": self.of(parts[0])}
            return {"type": "array", "items": self.of(parts[0])}
        if kind == Loop | Circle:
            return {"anyOf": [self.of(Loop), self.of(Circle)]}
        plain = {str: ["string", "number", "boolean"], bool: "boolean", float: "number"}
        if kind in plain:
            return {"type": plain[kind]}
        special = {Loop: self.loop, Material: self.material, Characteristic: self.characteristic}
        name = kind.__name__
        if kind in special:
            return self.define(name, special[kind])
        if kind in FAMILIES:
            return self.define(name, lambda: self.family(kind))
        return self.define(name, lambda: self.describe(kind))

    def describe(self, cls: type, kind: str | None = None) -> dict[str, Any]:
        """Return the schema of a mapping that holds the fields of a class."""
        texts = field_texts(cls)
        properties: dict[str, Any] = {} if kind is None else {"kind": {"const": kind}}
        needed = [] if kind is None else ["kind"]
        for name, (field, annotation) in field_types(cls).items():
            if name == "name" and is_named(cls) and cls not in (Stage, Material):
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

    def family(self, family: type) -> dict[str, Any]:
        members = FAMILIES[family]
        # one branch for each kind, so that a wrong key is told against its own kind
        return {
            "type": "object",
            "required": ["kind"],
            "properties": {"kind": {"enum": list(members)}},
            "allOf": [
                {
                    "if": {"properties": {"kind": {"const": kind}}, "required": ["kind"]},
                    "then": self.describe(cls, kind),
                }
                for kind, cls in members.items()
            ],
        }

    def quantity(self, dimension: Dimension) -> dict[str, Any]:
        def make() -> dict[str, Any]:
            text = {
                "type": "string",
                # a bare length may come in quotes, other quantities need their unit
                "pattern": rf"^\s*{_NUMBER}\s*{'' if dimension.name == 'length' else _UNIT}",
                "examples": [f"10 {unit}" for unit in dimension.units],
            }
            if dimension.name == "length":
                return {"anyOf": [text, {"type": "number"}]}
            return text

        return self.define(f"quantity-{dimension.name}", make)

    def loop(self) -> dict[str, Any]:
        point = _list_of(self.quantity(DIMENSIONS["length"]), 2)
        arc = {
            "type": "object",
            "properties": {
                "to": {**point, "description": "Where the arc ends."},
                "bulge": {
                    "type": "number",
                    "description": "Tangent of a quarter of its angle, positive if it turns left.",
                },
                "through": {**point, "description": "A point on the arc."},
            },
            "additionalProperties": False,
            "required": ["to"],
            "minProperties": 2,
            "maxProperties": 2,
        }
        return {"type": "array", "items": {"anyOf": [point, arc]}, "minItems": 2}

    def material(self) -> dict[str, Any]:
        # the catalogue does not mind upper and lower case
        pattern = (
            "|".join(
                "".join(f"[{c.upper()}{c.lower()}]" if c.isalpha() else re.escape(c) for c in name)
                for name in CATALOGUE
            )
            .replace(r"\ ", " ")
            .replace(r"\-", "-")
            .replace(r"\<", "<")
            .replace(r"\>", ">")
        )
        return {
            "anyOf": [
                {"enum": list(CATALOGUE)},
                {"type": "string", "pattern": f"^({pattern})$"},
                self.describe(Material),
            ]
        }

    def characteristic(self) -> dict[str, Any]:
        out = self.describe(Characteristic)
        del out["properties"]["unit"]
        out["required"] = [name for name in out["required"] if name != "unit"]
        out["properties"]["quantity"] = {"enum": list(QUANTITIES)}
        out["properties"]["origin"] = {"enum": list(ORIGINS)}
        for name in ("value", "uncertainty"):
            text = {"type": ["string", "number"], "description": "With its unit, if it has one."}
            out["properties"][name] = text
        return out


_UNIT = "[A-Za-zµμ°1]"


def _list_of(item: dict[str, Any], count: int) -> dict[str, Any]:
    return {"type": "array", "items": item, "minItems": count, "maxItems": count}


if __name__ == "__main__":
    SCHEMA_PATH.write_text(schema_text(), encoding="utf-8")
