"""Encoding: from descriptions to plain data, by the types of the fields, and to readable YAML."""

import re
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
from flexstage.files.nodes import NUMBER
from flexstage.files.ranges import written_as
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


class Number(str):
    """Digits without quotes in a file."""

    __slots__ = ()


def yaml_text(data: Any) -> str:
    """Return plain data as YAML."""
    import yaml

    return yaml.dump(
        _flow(data, 0), Dumper=_dumper(), allow_unicode=True, sort_keys=False, width=100
    )


def flow_text(data: Any) -> str:
    """Return plain data as YAML on one line.

    Examples
    --------
    >>> flow_text(["0 V", "120 V"]), flow_text({"name": "own", "count": Number("3")})
    ('[0 V, 120 V]', '{name: own, count: 3}')
    """
    import yaml

    text = yaml.dump(data, Dumper=_dumper(), allow_unicode=True, sort_keys=False,
                     default_flow_style=True, width=1_000_000)  # fmt: skip
    return text.removesuffix("...\n").strip()


class _Row(list):
    """A list on one line."""


class _Line(dict):
    """A mapping on one line."""


def _flow(value: Any, depth: int) -> Any:
    """Mark lists of scalars and deeply nested values for one line."""
    if isinstance(value, dict):
        inner = {k: _flow(v, depth + 1) for k, v in value.items()}
        return _Line(inner) if depth >= 3 else inner
    if isinstance(value, list):
        rows = [_flow(v, max(depth + 1, 3)) for v in value]
        scalars = all(not isinstance(v, (list, dict)) for v in rows)
        return _Row(rows) if scalars or depth >= 4 else rows
    return value


def plain_dumper() -> type:
    """Return a dumper for ``yaml.dump`` whose output `flexstage.files.nodes` reads back.

    It writes no anchors, and quotes a text that looks like a number.
    """
    import yaml

    class Dumper(yaml.SafeDumper):
        def ignore_aliases(self, data: Any) -> bool:
            return True

    def text(dumper: Any, data: str) -> Any:
        # line ends are folded unless they are escaped in double quotes
        return dumper.represent_scalar(
            "tag:yaml.org,2002:str", data, style=None if data.isprintable() else '"'
        )

    Dumper.add_representer(str, text)
    # in YAML 1.1, which the library writes, 1e5 is a text
    number = re.compile(rf"(?:{NUMBER.pattern})\Z")  # "8 mm" is not a number and needs no quotes
    Dumper.add_implicit_resolver("tag:yaml.org,2002:float", number, list("+-.0123456789"))
    return Dumper


def _dumper() -> type:
    import yaml

    dumper: Any = plain_dumper()

    def number(to: Any, data: Number) -> Any:
        # the tag that the text would get, so that none is written
        tag = to.resolve(yaml.ScalarNode, str(data), (True, False))
        return to.represent_scalar(tag, str(data))

    dumper.add_representer(Number, number)
    dumper.add_representer(
        _Row, lambda d, data: d.represent_sequence("tag:yaml.org,2002:seq", data, flow_style=True)
    )
    dumper.add_representer(
        _Line,
        lambda d, data: d.represent_mapping(
            "tag:yaml.org,2002:map", list(data.items()), flow_style=True
        ),
    )
    return dumper
