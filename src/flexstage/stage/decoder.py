"""Turns the nodes of a stage file into descriptions, as the types of the fields say."""

import math
import typing
from collections.abc import Callable
from dataclasses import dataclass
from typing import Annotated, Any, NoReturn

from flexstage.characteristic import Characteristic
from flexstage.choose import did_you_mean, unknown
from flexstage.errors import FlexstageError, StageError
from flexstage.material import Material, material
from flexstage.quantities import QUANTITIES
from flexstage.stage.field_types import (
    DIMENSION_OF_UNIT,
    FAMILIES,
    check_name,
    field_types,
    is_named,
    optional_part,
    required,
)
from flexstage.stage.outline import LARGEST, SMALLEST, Circle, Loop
from flexstage.stage.yaml_reader import Mapping, Node, Scalar, Sequence
from flexstage.units import DIMENSIONS, Dimension, parse

# More than a drawn curve needs; checks of clearance take tens of seconds beyond it.
_MOST_POINTS = 10_000


@dataclass(slots=True)
class Decoder:
    """Builds descriptions from the nodes of one file."""

    source: str
    """What to call the file in messages."""
    length_unit: str | None = None
    """The unit of lengths that are bare numbers."""
    bounded: bool = False
    """Whether lengths are those of a stage's bodies, which a machine can make. An offset of an
    instrument may be any.
    """

    def refuse(
        self, node: Node, path: str, message: str, error: type[Exception] = StageError
    ) -> NoReturn:
        """Raise the error of a place in the file."""
        where = f", {path}" if path else ""
        raise error(f"{self.source}, line {node.line}{where}: {message}")

    def decode(self, kind: Any, node: Node, path: str) -> Any:
        """Read a value of a type.

        `kind` is the annotation of a field, or a description; `path` of keys is for messages.
        """
        if (inner := optional_part(kind)) is not None:
            if isinstance(node, Scalar) and node.value is None:
                return None
            return self.decode(inner, node, path)
        origin = typing.get_origin(kind)
        if origin is Annotated:
            bare, dimension = typing.get_args(kind)
            if typing.get_origin(bare) is tuple:
                length = len(typing.get_args(bare))
                items = self._items(node, path, length, f"{length} values of {dimension.name}")
                return tuple(
                    self._fitting(dimension, item, f"{path}[{k}]") for k, item in enumerate(items)
                )
            value = self._fitting(dimension, node, path)
            if self.bounded and dimension.name == "length" and 0.0 < abs(value) < SMALLEST:
                self.refuse(
                    node,
                    path,
                    f"{_show(node)} is shorter than {SMALLEST:g} m, no length of a stage",
                )
            return value
        if origin is tuple:
            return self._tuple(typing.get_args(kind), node, path)
        if kind == Loop | Circle:
            return self.decode(Circle if isinstance(node, Mapping) else Loop, node, path)
        special: dict[Any, Callable[[Node, str], Any]] = {
            str: self._text,
            bool: self._bool,
            float: self._float,
            int: self._int,
            Loop: self._loop,
            Material: self._material,
            Characteristic: self._characteristic,
        }
        if kind in special:
            return special[kind](node, path)
        return self.build(kind, self._mapping(node, path), path)

    def build(
        self, kind: type, node: Mapping, path: str, given: dict[str, Any] | None = None
    ) -> Any:
        """Read a description from a mapping.

        `kind` is a dataclass, or a family of them of which ``kind`` names one; the fields `given`
        come from elsewhere.
        """
        values: dict[str, Any] = dict(given or {})
        allowed: list[str] = []
        if kind in FAMILIES:
            kind = self._kind(kind, node, path)
            allowed = ["kind"]
        described = {k: v for k, v in field_types(kind).items() if k not in values}
        self.check_keys(node, path, [*allowed, *described])
        for name, (field, annotation) in described.items():
            here = f"{path}.{name}" if path else name
            if name in node.items:
                values[name] = self.decode(annotation, node.items[name], here)
            elif required(field):
                example = f" ({hint})" if (hint := _hint(annotation)) else ""
                self.refuse(node, path, f"'{name}' is missing{example}")
        try:
            return kind(**values)
        except FlexstageError as error:
            self.refuse(node, path, str(error), type(error))

    def check_keys(self, node: Mapping, path: str, known: list[str]) -> None:
        """Refuse keys that mean nothing.

        The nearest known one is named.
        """
        for key, value in node.items.items():
            if key not in known:
                hint = did_you_mean(key, known, 0.5)
                place = Scalar(node.key_lines.get(key, value.line), key, key)
                self.refuse(
                    place, path, f"unknown key '{key[:60]}' (known: {', '.join(known)}){hint}"
                )

    def _kind(self, family: type, node: Mapping, path: str) -> type:
        members = FAMILIES[family]
        listed = ", ".join(sorted(members))
        if "kind" not in node.items:
            self.refuse(node, path, f"'kind' is missing (one of {listed})")
        name = self._text(node.items["kind"], f"{path}.kind")
        if name not in members:
            sentence = unknown("kind", name, sorted(members), 0.4)
            self.refuse(node.items["kind"], f"{path}.kind", sentence)
        return members[name]

    def _mapping(self, node: Node, path: str) -> Mapping:
        if not isinstance(node, Mapping):
            self.refuse(node, path, f"expected a mapping of names to values, got {_show(node)}")
        return node

    def _items(self, node: Node, path: str, length: int | None, what: str) -> list[Node]:
        if not isinstance(node, Sequence):
            self.refuse(node, path, f"expected a list of {what}, got {_show(node)}")
        if length is not None and len(node.items) != length:
            self.refuse(node, path, f"expected a list of {what}, got {len(node.items)}")
        return node.items

    def _tuple(self, parts: tuple, node: Node, path: str) -> tuple:
        if parts[-1] is not Ellipsis:
            items = self._items(node, path, len(parts), f"{len(parts)} entries")
            return tuple(
                self.decode(part, item, f"{path}[{k}]")
                for k, (part, item) in enumerate(zip(parts, items, strict=True))
            )
        if is_named(parts[0]):
            entries = self._mapping(node, path)
            for key in entries.items:
                check_name(key, lambda message: self.refuse(entries, path, message))
            return tuple(
                self.build(
                    parts[0], self._mapping(item, f"{path}.{key}"), f"{path}.{key}", {"name": key}
                )
                for key, item in entries.items.items()
            )
        return tuple(
            self.decode(parts[0], item, f"{path}[{k}]")
            for k, item in enumerate(self._items(node, path, None, "entries"))
        )

    def _text(self, node: Node, path: str) -> str:
        if not isinstance(node, Scalar) or node.value is None:
            self.refuse(node, path, f"expected a text, got {_show(node)}")
        return node.text

    def _bool(self, node: Node, path: str) -> bool:
        if not isinstance(node, Scalar) or not isinstance(node.value, bool):
            self.refuse(node, path, f"expected true or false, got {_show(node)}")
        return node.value

    def _float(self, node: Node, path: str) -> float:
        value = node.value if isinstance(node, Scalar) else None
        if isinstance(value, bool) or not isinstance(value, (int, float)):
            self.refuse(node, path, f"expected a number without a unit, got {_show(node)}")
        return float(value)

    def _int(self, node: Node, path: str) -> int:
        value = node.value if isinstance(node, Scalar) else None
        if isinstance(value, bool) or not isinstance(value, int):
            self.refuse(node, path, f"expected a whole number, got {_show(node)}")
        return value

    def _quantity(self, dimension: Dimension, node: Node, path: str) -> float:
        if not isinstance(node, Scalar) or node.value is None or isinstance(node.value, bool):
            self.refuse(
                node,
                path,
                f"expected {dimension.noun} such as '10 {dimension.units[0]}', got {_show(node)}",
            )
        unit = self.length_unit if dimension.name == "length" else None
        try:
            value = parse(node.text, dimension.name, bare_unit=unit)
        except FlexstageError as error:
            extra = ""
            if dimension.name == "length" and unit is None and isinstance(node.value, (int, float)):
                extra = ", or put 'length_unit: mm' at the top of the file"
            self.refuse(node, path, f"{error}{extra}", type(error))
        return value

    def _fitting(self, dimension: Dimension, node: Node, path: str) -> float:
        """A quantity of the stage itself, which has an end."""
        value = self._quantity(dimension, node, path)
        if self.bounded and dimension.name == "length" and abs(value) > LARGEST:
            self.refuse(
                node,
                path,
                f"{_show(node)} is longer than {LARGEST:g} m, the most that a stage may be",
            )
        return value

    def _loop(self, node: Node, path: str) -> Loop:
        dimension = DIMENSIONS["length"]
        items = self._items(node, path, None, "points")
        if len(items) > _MOST_POINTS:
            self.refuse(
                node,
                path,
                f"an outline has at most {_MOST_POINTS} points, got {len(items)}: use arcs",
            )

        def point(place: Node, where: str) -> tuple[float, float]:
            x, y = self._items(place, where, 2, "2 coordinates")
            return (
                self._fitting(dimension, x, f"{where}[0]"),
                self._fitting(dimension, y, f"{where}[1]"),
            )

        points = []
        for k, item in enumerate(items):
            where = f"{path}[{k}]"
            if isinstance(item, Mapping):
                self.check_keys(item, where, ["to", "bulge", "through"])
                if "to" not in item.items or len(item.items) != 2:
                    self.refuse(
                        item,
                        where,
                        "an arc is {to: [x, y], bulge: b} or {to: [x, y], through: [x, y]}",
                    )
                points.append(point(item.items["to"], f"{where}.to"))
            else:
                points.append(point(item, where))
        bulges = [0.0] * len(points)
        for k, item in enumerate(items):
            if not isinstance(item, Mapping):
                continue
            # an entry says how its point is reached, a bulge how a point is left
            if "bulge" in item.items:
                bulge = self._float(item.items["bulge"], f"{path}[{k}].bulge")
            else:
                via = point(item.items["through"], f"{path}[{k}].through")
                bulge = _through_to_bulge(points[k - 1], via, points[k])
                if not math.isfinite(bulge):
                    self.refuse(item, f"{path}[{k}]", "no arc runs through these three points")
            bulges[k - 1] = bulge
        try:
            return Loop(tuple(points), tuple(bulges) if any(bulges) else ())
        except FlexstageError as error:
            self.refuse(node, path, str(error), type(error))

    def _material(self, node: Node, path: str) -> Material:
        if isinstance(node, Mapping):
            return self.build(Material, node, path)
        try:
            return material(self._text(node, path))
        except FlexstageError as error:
            if str(error).startswith(self.source):
                raise
            self.refuse(node, path, str(error), type(error))

    def _characteristic(self, node: Node, path: str) -> Characteristic:
        entry = self._mapping(node, path)
        quantity = entry.items.get("quantity")
        name = self._text(quantity, f"{path}.quantity") if quantity else ""
        if quantity is not None and name not in QUANTITIES:
            sentence = unknown("quantity", name, QUANTITIES, 0.5)
            self.refuse(quantity, f"{path}.quantity", sentence)
        unit = QUANTITIES[name].unit if name in QUANTITIES else "1"
        given: dict[str, Any] = {"unit": unit}
        for key in ("value", "uncertainty"):
            value = entry.items.get(key)
            if value is not None and unit != "1":
                given[key] = self._quantity(
                    DIMENSIONS[DIMENSION_OF_UNIT[unit]], value, f"{path}.{key}"
                )
        rest = {k: v for k, v in entry.items.items() if k not in given or k == "unit"}
        return self.build(Characteristic, Mapping(entry.line, rest, entry.key_lines), path, given)


def _through_to_bulge(
    start: tuple[float, float], via: tuple[float, float], end: tuple[float, float]
) -> float:
    """Return the bulge of the arc from start to end through a point; infinite if there is none."""
    ax, ay, bx, by = via[0] - start[0], via[1] - start[1], end[0] - via[0], end[1] - via[1]
    # the direction of travel turns by half of the arc's angle between the two chords
    turn = math.atan2(ax * by - ay * bx, ax * bx + ay * by)
    return math.tan(0.5 * turn) if abs(turn) < math.pi - 1e-9 else math.inf


def _hint(kind: Any) -> str:
    """Say how a value of a type is written."""
    if (inner := optional_part(kind)) is not None:
        return _hint(inner)
    if typing.get_origin(kind) is Annotated:
        bare, dimension = typing.get_args(kind)
        one = f'"10 {dimension.units[0]}"'
        count = len(typing.get_args(bare)) or 1
        return f"{dimension.noun} such as {one}" if count == 1 else f"[{', '.join([one] * count)}]"
    return ""


def _show(node: Node) -> str:
    if isinstance(node, Mapping):
        return "a mapping"
    if isinstance(node, Sequence):
        return f"a list of {len(node.items)}"
    if node.value is None:
        return "nothing"
    return repr(node.text if len(node.text) <= 60 else node.text[:57] + "...")
