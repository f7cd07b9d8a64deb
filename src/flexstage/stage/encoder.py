"""Turns descriptions into the plain data of a stage file, as the types of the fields say."""

import typing
from dataclasses import MISSING, Field
from typing import Annotated, Any

from flexstage.characteristic import Characteristic
from flexstage.material import CATALOGUE, Material
from flexstage.stage.field_types import (
    DIMENSION_OF_UNIT,
    FAMILIES,
    field_types,
    is_named,
    optional_part,
    required,
)
from flexstage.stage.outline import Loop
from flexstage.units import DIMENSIONS, Dimension, to_text


class Number(str):
    """Digits that stand in a file without quotes."""

    __slots__ = ()


def encode(kind: Any, value: Any, length_unit: str | None) -> Any:
    """Return plain data that `Decoder` reads back to the same bits.

    Plain data are texts, booleans, `Number`, lists and dicts.
    """
    if (inner := optional_part(kind)) is not None:
        return None if value is None else encode(inner, value, length_unit)
    origin = typing.get_origin(kind)
    if origin is Annotated:
        bare, dimension = typing.get_args(kind)
        if typing.get_origin(bare) is tuple:
            return [_quantity_text(v, dimension, length_unit) for v in value]
        return _quantity_text(value, dimension, None)
    if origin is tuple:
        parts = typing.get_args(kind)
        if parts[-1] is not Ellipsis:
            return [encode(p, v, length_unit) for p, v in zip(parts, value, strict=True)]
        if is_named(parts[0]):
            return {v.name: _fields(v, length_unit, skip="name") for v in value}
        return [encode(parts[0], v, length_unit) for v in value]
    if kind is float:
        return Number(repr(float(value)))
    if kind in (str, bool, int):
        return value
    if isinstance(value, Loop):
        return _loop(value, length_unit)
    if isinstance(value, Material) and CATALOGUE.get(value.name) == value:
        return value.name
    if isinstance(value, Characteristic):
        return _characteristic(value)
    return _fields(value, length_unit)


def _fields(value: Any, length_unit: str | None, skip: str = "") -> dict[str, Any]:
    out: dict[str, Any] = {}
    if any(isinstance(value, family) for family in FAMILIES):
        out["kind"] = value.kind
    for name, (field, kind) in field_types(type(value)).items():
        held = getattr(value, name)
        if name == skip or (not required(field) and _same(held, _default(field))):
            continue
        out[name] = encode(kind, held, length_unit)
    return out


def _default(field: Field) -> Any:
    return field.default if field.default_factory is MISSING else field.default_factory()


def _same(a: Any, b: Any) -> bool:
    # repr tells 0.0 from -0.0, and 1 from True
    return a == b and repr(a) == repr(b)


def _quantity_text(value: float, dimension: Dimension, length_unit: str | None) -> str:
    text = to_text(value, dimension.name)
    if dimension.name == "length" and length_unit is not None:
        text = to_text(value, dimension.name, length_unit)
        number, _, unit = text.partition(" ")
        if unit == length_unit:
            return Number(number)
    return text


def _loop(loop: Loop, length_unit: str | None) -> list[Any]:
    dimension = DIMENSIONS["length"]
    out: list[Any] = []
    for k, point in enumerate(loop.points):
        pair = [_quantity_text(c, dimension, length_unit) for c in point]
        bulge = loop.bulges[k - 1] if loop.bulges else 0.0
        out.append({"to": pair, "bulge": Number(repr(float(bulge)))} if _curved(bulge) else pair)
    return out


def _curved(bulge: float) -> bool:
    return not _same(bulge, 0.0)


def _characteristic(value: Characteristic) -> dict[str, Any]:
    out = _fields(value, None, skip="unit")
    if value.unit != "1":
        for key in ("value", "uncertainty"):
            if (held := getattr(value, key)) is not None:
                out[key] = to_text(held, DIMENSION_OF_UNIT[value.unit])
    return out
