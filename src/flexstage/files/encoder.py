"""Encoding: from descriptions to the plain data of a file, by the types of the fields."""

import typing
from dataclasses import MISSING, Field, dataclass
from typing import Annotated, Any, Literal

from flexstage.files.format import (
    Format,
    by_name,
    dimension_of,
    field_types,
    optional_part,
    required,
)
from flexstage.files.ranges import written_as
from flexstage.files.yaml_text import Number, yaml_text
from flexstage.quantities.units import Dimension, to_text


@dataclass(frozen=True, slots=True)
class Encoder:
    """Encoder of plain data, which a `Decoder` of the same format reads back to the same bits.

    Plain data are texts, booleans, `Number`, lists and dicts.
    """

    format: Format
    """Kind of file."""
    length_unit: str | None = None
    """Unit in which lengths of outlines and points are bare numbers."""

    def encode(self, kind: Any, value: Any) -> Any:
        """Return plain data of a value of a type."""
        form = self.format.forms.get(type(value))
        if form is not None and form.write is not None:
            return form.write(self, value)
        if (inner := optional_part(kind)) is not None:
            return None if value is None else self.encode(inner, value)
        if (quantity := dimension_of(kind)) is not None:
            dimension, count = quantity
            if count:
                return [self.coordinate(v, dimension) for v in value]
            return to_text(value, dimension.name)
        origin = typing.get_origin(kind)
        if origin is Annotated:
            if (written := written_as(kind)) is not None and written.read is not None:
                return written.write(value)
            return self.encode(typing.get_args(kind)[0], value)
        if origin is tuple:
            parts = typing.get_args(kind)
            if parts[-1] is not Ellipsis:
                return [self.encode(p, v) for p, v in zip(parts, value, strict=True)]
            if by_name(parts[0], self.format):
                return {v.name: self.fields(v, skip="name") for v in value}
            return [self.encode(parts[0], v) for v in value]
        if origin is dict:
            return {k: self.encode(typing.get_args(kind)[1], v) for k, v in value.items()}
        if kind is float:
            return Number(repr(float(value)))
        if kind is int:
            return Number(repr(int(value)))
        if kind in (str, bool, Any) or origin is Literal:
            return value
        return self.fields(value)

    def fields(self, value: Any, skip: str = "") -> dict[str, Any]:
        """Return plain data of a description without fields that have their default."""
        out: dict[str, Any] = {}
        if any(type(value) in family.values() for family in self.format.families.values()):
            out["kind"] = value.kind
        for name, (field, kind) in field_types(type(value)).items():
            current = getattr(value, name)
            if name == skip or (not required(field) and same(current, _default(field))):
                continue
            out[name] = self.encode(kind, current)
        return out

    def coordinate(self, value: float, dimension: Dimension) -> str:
        """Return a coordinate as text, without a unit where it has that of the file."""
        if dimension.name == "length" and self.length_unit is not None:
            text = to_text(value, dimension.name, self.length_unit)
            number, _, unit = text.partition(" ")
            return Number(number) if unit == self.length_unit else text
        return to_text(value, dimension.name)

    def text(self, value: Any) -> str:
        """Return the text of the file of a description."""
        return yaml_text(self.document(value))

    def document(self, value: Any) -> dict[str, Any]:
        """Return the plain data of the file of a description."""
        data: dict[str, Any] = {self.format.key: Number(self.format.version)}
        if self.length_unit is not None:
            data["length_unit"] = self.length_unit
        return {**data, **self.encode(type(value), value)}


def _default(field: Field) -> Any:
    return field.default if field.default_factory is MISSING else field.default_factory()


def same(a: Any, b: Any) -> bool:
    """Return whether two values have the same text."""
    # repr distinguishes 0.0 from -0.0, and 1 from True
    return a == b and repr(a) == repr(b)
