"""Decoding: from the nodes of a file to descriptions, by the types of the fields."""

import collections.abc
import math
import typing
from collections.abc import Callable, Collection
from dataclasses import dataclass, field
from fractions import Fraction
from pathlib import Path
from typing import Annotated, Any, Literal, NoReturn

from flexstage.base.choose import did_you_mean, unknown
from flexstage.base.errors import FlexstageError, UnitError
from flexstage.files.expression import (
    Amount,
    dimension_named,
    evaluate,
    is_expression,
    powers_of,
    require_names,
)
from flexstage.files.expression import parse as parse_expression
from flexstage.files.format import (
    Format,
    by_name,
    check_name,
    dimension_of,
    field_types,
    members,
    optional_part,
    required,
)
from flexstage.files.nodes import (
    Mapping,
    Node,
    Scalar,
    Sequence,
    parse_json,
    parse_yaml,
    plain,
    read_text,
)
from flexstage.files.parameters import KEY as PARAMETERS
from flexstage.files.parameters import FileParameter, read_parameters
from flexstage.files.ranges import fault_of, range_of, written_as
from flexstage.quantities.units import DIMENSIONS, Dimension, parse, readable
from flexstage.quantities.units.text import point_hint

#: Nouns for the entries of a list.
_ENTRIES = {str: "texts", float: "numbers", int: "whole numbers"}


@dataclass(slots=True)
class Decoder:
    """Builds descriptions from the nodes of one file."""

    source: str
    """Name of the file in messages."""
    format: Format
    """The kind of file."""
    length_unit: str | None = None
    """Unit of lengths that are bare numbers."""
    settings: Mapping = field(default_factory=lambda: Mapping(None))
    """Values that replace those of the file; each is removed when it has been used."""
    parameters: dict[str, FileParameter] = field(default_factory=dict)
    """Parameters of the file, for its expressions."""

    def refuse(
        self,
        node: Node,
        path: str,
        message: str,
        error: type[Exception] | None = None,
        *,
        ending: str | None = None,
    ) -> NoReturn:
        """Raise an error at a place in the file, with an ending instead of that of the format."""
        line = "" if node.line is None else f", line {node.line}"
        where = f", {path}" if path else ""
        end = self.format.ending if ending is None else ending
        kind = self.format.error if error is None or self.format.only else error
        raise kind(f"{self.source}{line}{where}: {message}{end}")

    def refuse_again(self, node: Node, path: str, error: FlexstageError) -> NoReturn:
        """Raise the error of a description again, with its place in the file."""
        if str(error).startswith((f"{self.source}, ", f"{self.source}: ")):
            raise error
        self.refuse(node, path, str(error), type(error))

    def decode(self, kind: Any, node: Node, path: str, base: Any = None) -> Any:
        """Return the value of a type from a node.

        `kind` is the annotation of a field, or a description; `path` of keys is for messages. A
        field that is missing in a mapping has its value in `base`, where there is one.
        """
        if kind in self.format.forms:
            return self.format.forms[kind].read(self, node, path, base)
        if (family := members(kind, self.format)) is not None:
            entry = self.mapping(node, path)
            if "as" in entry.items and kind in self.format.bought:
                # a bought part replaces all of the part that it stands for
                entry, base = self._bought(kind, entry, path), None
            return self._member(family, entry, path, base)
        if (inner := optional_part(kind)) is not None:
            if isinstance(node, Scalar) and node.value is None:
                return None
            return self.decode(inner, node, path, base)
        origin = typing.get_origin(kind)
        if origin is Annotated:
            return self._annotated(kind, node, path, base)
        if origin is tuple:
            return self._tuple(typing.get_args(kind), node, path)
        if origin in (dict, collections.abc.Mapping):
            value = typing.get_args(kind)[1]
            items = self.mapping(node, path).items
            return {key: self.decode(value, item, f"{path}.{key}") for key, item in items.items()}
        if origin is Literal:
            return self.choice(typing.get_args(kind), node, path)
        if kind is Any:
            return plain(node)
        scalars: dict[Any, Callable[[Node, str], Any]] = {
            str: self.text,
            bool: self._bool,
            float: self.number,
            int: self._int,
        }
        if kind in scalars:
            return scalars[kind](node, path)
        return self.build(kind, self.mapping(node, path), path, base=base)

    def _annotated(self, kind: Any, node: Node, path: str, base: Any) -> Any:
        bare, quantity, bounds = typing.get_args(kind)[0], dimension_of(kind), range_of(kind)
        if (written := written_as(kind)) is not None and written.read is not None:
            value = self._spelled(written.read, node, path)
            if fault := fault_of(kind, value):
                self.refuse(
                    node, path, f"expected a value that is {fault}, got {self.describe(node)}"
                )
            return value
        if quantity is not None:
            value = self._quantities(*quantity, node, path)
        elif bare is int and bounds is not None:
            value = self._int(node, path, expected := bounds[0].text(integer=True))
            if not bounds[0].holds(value):
                self.refuse(node, path, f"expected {expected}, got {self.describe(node)}")
        elif bare is float and bounds and bounds[0].is_share and _percent(node) is not None:
            value = _percent(node)
        else:
            value = self.decode(bare, node, path, base)
        if fault := fault_of(kind, value):
            noun, unit = (
                ("a number", "") if quantity is None else (quantity[0].noun, quantity[0].si)
            )
            expected = f"{noun} {fault} {unit}".rstrip() if bounds is not None else fault
            self.refuse(node, path, f"expected {expected}, got {self.describe(node)}")
        return value

    def _spelled(self, read: Callable[[str], Any], node: Node, path: str) -> Any:
        """Return a value whose type has its own text form."""
        text = self.text(node, path)
        try:
            return read(text)
        except FlexstageError as error:
            self.refuse(node, path, str(error), type(error))

    def build(
        self,
        kind: type,
        node: Mapping,
        path: str,
        fixed: collections.abc.Mapping[str, Any] | None = None,
        *,
        base: Any = None,
        also: Collection[str] = (),
    ) -> Any:
        """Return a description from a mapping.

        The fields `fixed` are not read; missing fields have their value in `base`; the keys `also`
        are read elsewhere.
        """
        values: dict[str, Any] = dict(fixed or {})
        types = field_types(kind)
        described = {k: v for k, v in types.items() if k not in values}
        read_here = [k for k in types if k in described or k in also]
        self.check_keys(node, path, [*(k for k in also if k not in types), *read_here])
        for name, (declared, annotation) in described.items():
            default = getattr(base, name) if isinstance(base, kind) else None
            if name in node.items:
                values[name] = self.decode(annotation, node.items[name], _join(path, name), default)
            elif isinstance(base, kind):
                values[name] = default
            elif required(declared):
                example = f" ({hint})" if (hint := _hint(annotation)) else ""
                self.refuse(node, path, f"'{name}' is missing{example}")
        try:
            return kind(**values)
        except FlexstageError as error:
            self.refuse_again(node, path, type(error)(f"{error}{self._expressions(node, error)}"))

    def _expressions(self, node: Mapping, error: FlexstageError) -> str:
        """Return the expressions to which an error of a description refers."""
        expressions = {key: item for key, item in node.items.items() if self._is_expression(item)}
        relevant = [(key, item) for key, item in expressions.items() if key in str(error)]
        texts = [f"{key} is {self.describe(item)}" for key, item in relevant[:3]]
        return f"; {', '.join(texts)}" if texts else ""

    def check_keys(self, node: Mapping, path: str, known: Collection[str]) -> None:
        """Refuse unknown keys, with the nearest known one."""
        for key, value in node.items.items():
            if key not in known and not self.format.later:
                hint = did_you_mean(key, known, 0.5)
                # {thickness: 0,5 mm} has two entries
                if key[:1].isdigit() and isinstance(value, Scalar) and value.value is None:
                    hint = "; the decimal sign of a number must be a point"
                place = Scalar(node.key_lines.get(key, value.line), key, key)
                self.refuse(
                    place, path, f"unknown key '{key[:60]}' (known: {', '.join(known)}){hint}"
                )

    def member(
        self, family: collections.abc.Mapping[str, type], node: Mapping, path: str, key: str
    ) -> type:
        """Return the class by the kind that a mapping names."""
        if key not in node.items:
            self.refuse(node, path, f"'{key}' is missing (one of {', '.join(sorted(family))})")
        place, words = node.items[key], sorted(family)
        if not isinstance(place, Scalar):
            sentence = f"expected one of {', '.join(words)}, got {show(place)}"
            self.refuse(place, _join(path, key), sentence)
        name = place.text
        if name not in family:
            self.refuse(place, _join(path, key), unknown(key, name, words, 0.4))
        return family[name]

    def _member(
        self, family: collections.abc.Mapping[str, type], entry: Mapping, path: str, base: Any
    ) -> Any:
        base_kind = (
            None if type(base) not in family.values() or "kind" in entry.items else type(base)
        )
        kind = base_kind or self.member(family, entry, path, "kind")
        return self.build(kind, entry, path, base=base, also=["kind"])

    def _bought(self, kind: Any, entry: Mapping, path: str) -> Mapping:
        """Return a mapping with those keys of the bought part it names that it does not have."""
        if "as" not in entry.items or kind not in self.format.bought:
            return entry
        parts = self.format.bought[kind]()
        place, where = entry.items["as"], f"{path}.as"
        name = self.text(place, where)
        if name not in parts:
            self.refuse(place, where, unknown("bought part", name, sorted(parts), 0.4))
        part, keys = parts[name].items, {k: v for k, v in entry.items.items() if k != "as"}
        if "kind" in keys and show(keys["kind"]) != show(part["kind"]):
            kinds = f"is of kind {show(part['kind'])}, not {show(keys['kind'])}: remove the key"
            self.refuse(keys["kind"], f"{path}.kind", f"the bought part '{name}' {kinds}")
        return Mapping(entry.line, {**part, **keys}, entry.key_lines)

    def mapping(self, node: Node, path: str) -> Mapping:
        """Return a mapping; refuse any other node."""
        if not isinstance(node, Mapping):
            self.refuse(node, path, f"expected a mapping of names to values, got {show(node)}")
        return node

    def items(self, node: Node, path: str, length: int | None, what: str) -> list[Node]:
        """Return the entries of a list, which must have the length if one is given."""
        if not isinstance(node, Sequence):
            self.refuse(node, path, f"expected a list of {what}, got {show(node)}")
        if length is not None and len(node.items) != length:
            self.refuse(node, path, f"expected a list of {what}, got {len(node.items)}")
        return node.items

    def _tuple(self, parts: tuple, node: Node, path: str) -> tuple:
        if parts[-1] is not Ellipsis:
            items = self.items(node, path, len(parts), f"{len(parts)} entries")
            return tuple(
                self.decode(part, item, f"{path}[{k}]")
                for k, (part, item) in enumerate(zip(parts, items, strict=True))
            )
        if by_name(parts[0], self.format):
            entries = self.mapping(node, path)
            for key in entries.items:
                check_name(key, lambda message: self.refuse(entries, path, message))
            return tuple(
                self._named(parts[0], key, item, f"{path}.{key}")
                for key, item in entries.items.items()
            )
        what = _ENTRIES.get(parts[0], "entries")
        return tuple(
            self.decode(parts[0], item, f"{path}[{k}]")
            for k, item in enumerate(self.items(node, path, None, what))
        )

    def _named(self, kind: Any, name: str, node: Node, path: str) -> Any:
        entry = self._bought(kind, self.mapping(node, path), path)
        family = members(kind, self.format)
        if family is None:
            return self.build(kind, entry, path, {"name": name})
        kind = self.member(family, entry, path, "kind")
        return self.build(kind, entry, path, {"name": name}, also=["kind"])

    def choice(self, among: Collection[str], node: Node, path: str) -> str:
        """Return one of the words of a choice."""
        word = node.text if isinstance(node, Scalar) else ""
        if word not in among:
            hint = did_you_mean(word, among, 0.5)
            listed = ", ".join(among)
            self.refuse(node, path, f"expected one of {listed}, got {show(node)}{hint}")
        return word

    def text(self, node: Node, path: str) -> str:
        """Return a text; a number counts as text, as it is written, unless the format is exact."""
        value = node.value if isinstance(node, Scalar) else None
        if value is None or (self.format.exact and not isinstance(value, str)):
            self.refuse(node, path, f"expected a text, got {show(node)}")
        return typing.cast("Scalar", node).text

    def _bool(self, node: Node, path: str) -> bool:
        if not isinstance(node, Scalar) or not isinstance(node.value, bool):
            self.refuse(node, path, f"expected true or false, got {show(node)}")
        return node.value

    def describe(self, node: Node) -> str:
        """Return a node in words; an expression with its value and the lines of its names."""
        text = show(node)
        if not isinstance(node, Scalar) or not self._is_expression(node):
            return text
        amount = self.amount(node, "")
        name = dimension_named(amount.powers)
        unit = DIMENSIONS[name].si if name else ""
        value = f", which is {readable(unit, float(amount.value), digits=6)}"
        return text + (value if name is not None else f", {amount.noun}") + self._origins(node)

    def _is_expression(self, node: Node) -> bool:
        return self.format.parameters and isinstance(node, Scalar) and is_expression(node.value)

    def amount(self, node: Scalar, path: str) -> Amount:
        """Return the value of an expression."""
        try:
            parsed = parse_expression(node.text)
            require_names(parsed, self.parameters)
            return evaluate(parsed, {name: self.parameters[name].amount for name in parsed.names})
        except UnitError as error:
            self.refuse(node, path, f"{error}{self._origins(node)}", UnitError)

    def _origins(self, node: Scalar) -> str:
        """Return the lines of the parameters of an expression, in words."""
        try:
            names = sorted(parse_expression(node.text).names & self.parameters.keys())
        except UnitError:
            return ""
        lines = {name: self.parameters[name].line for name in names}
        texts = [
            f"{n} is {'set' if line is None else f'on line {line}'}" for n, line in lines.items()
        ]
        return f" ({', '.join(texts)})" if texts else ""

    def _value(self, node: Node, path: str, dimension: str, what: str) -> Fraction | None:
        """Return the value of an expression [SI], which must be `what`; None for any other node."""
        if not isinstance(node, Scalar) or not self._is_expression(node):
            return None
        amount = self.amount(node, path)
        if amount.powers != powers_of(dimension):
            message = f"expected {what}, got {show(node)}, which is {amount.noun}"
            self.refuse(node, path, f"{message}{self._origins(node)}", UnitError)
        return amount.value

    def number(self, node: Node, path: str) -> float:
        """Return a number without a unit."""
        if (amount := self._value(node, path, "", "a number without a unit")) is not None:
            return float(amount)
        value = node.value if isinstance(node, Scalar) else None
        if isinstance(value, bool) or not isinstance(value, (int, float)):
            self.refuse(node, path, f"expected a number without a unit, got {show(node)}")
        try:
            number = float(value)
        except OverflowError:
            self.refuse(node, path, f"{show(node)} is too large to be a number")
        if self.format.finite and not math.isfinite(number):
            self.refuse(node, path, f"expected a number without a unit, got {show(node)}")
        return number

    def _int(self, node: Node, path: str, what: str = "a whole number") -> int:
        if (amount := self._value(node, path, "", what)) is not None:
            if amount.denominator != 1:
                self.refuse(node, path, f"expected {what}, got {self.describe(node)}")
            return int(amount)
        value = node.value if isinstance(node, Scalar) else None
        # 3.0 and 1e3 are whole numbers too
        integral = isinstance(value, int) or (
            isinstance(value, float) and value.is_integer() and not self.format.exact
        )
        if isinstance(value, bool) or not integral:
            self.refuse(node, path, f"expected {what}, got {show(node)}")
        return int(typing.cast("float", value))

    def quantity(self, dimension: Dimension, node: Node, path: str) -> float:
        """Return a quantity in its SI unit."""
        amount = self._value(node, path, dimension.name, f"{dimension.noun}")
        if amount is not None:
            return float(amount)
        if not isinstance(node, Scalar) or node.value is None or isinstance(node.value, bool):
            self.refuse(
                node,
                path,
                f"expected {dimension.noun} such as '10 {dimension.units[0]}', got {show(node)}",
            )
        is_length = dimension.name == "length"
        unit = self.length_unit if is_length else None
        try:
            value = parse(node.text, dimension.name, bare_unit=unit)
        except FlexstageError as error:
            unit_missing = self.format.length_unit and is_length and unit is None
            # a value that is set from outside has no line
            bare = unit_missing and isinstance(node.value, (int, float)) and node.line is not None
            extra = ", or put 'length_unit: mm' at the top of the file" if bare else ""
            self.refuse(node, path, f"{error}{extra}", type(error))
        return value

    def own_quantity(
        self, dimension: Dimension, node: Node, path: str, *, coordinate: bool = True
    ) -> float:
        """Return a quantity of the described object, whose lengths have limits."""
        value = self.quantity(dimension, node, path)
        noun, longest, shortest = self.format.noun, self.format.longest, self.format.shortest
        if dimension.name == "length" and abs(value) > longest:
            message = f"{self.describe(node)} is longer than {longest:g} m, the limit in a {noun}"
            self.refuse(node, path, message)
        if dimension.name == "length" and not coordinate and 0.0 < abs(value) < shortest:
            message = f"{self.describe(node)} is shorter than {shortest:g} m, the limit in a {noun}"
            self.refuse(node, path, message)
        return value

    def _quantities(self, dimension: Dimension, count: int, node: Node, path: str) -> Any:
        if not count:
            return self.own_quantity(dimension, node, path, coordinate=False)
        items = self.items(node, path, count, f"{count} values of {dimension.name}")
        return tuple(
            self.own_quantity(dimension, item, f"{path}[{k}]") for k, item in enumerate(items)
        )

    def head(self, root: Node) -> Mapping:
        """Check the version key of a file; return the mapping without it."""
        key, version = self.format.key, self.format.version
        begins = f"a {self.format.noun} begins with '{self.format.begins or f'{key}: {version}'}'"
        if not isinstance(root, Mapping):
            self.refuse(root, "", f"{begins}, got {show(root)}")
        if not key:
            return root
        if key not in root.items:
            self.refuse(root, "", f"{begins}, which is missing")
        node = root.items[key]
        version_read = node.value if isinstance(node, Scalar) else None
        if isinstance(version_read, bool) or not isinstance(version_read, (int, float)):
            self.refuse(
                node, key, f"expected a number, version {version} of the format, got {show(node)}"
            )
        if version_read != version:
            message = (
                f"version {self.number(node, key):g} is not known: this flexstage reads version"
            )
            ending = "; use a newer flexstage" if version_read > version else None
            self.refuse(node, key, f"{message} {version}", ending=ending)
        rest = {k: v for k, v in root.items.items() if k != key}
        if self.format.length_unit and "length_unit" in rest:
            units = DIMENSIONS["length"].units
            self.length_unit = self.choice(units, rest.pop("length_unit"), "length_unit")
        if self.format.parameters and PARAMETERS in rest:
            read_parameters(self, rest.pop(PARAMETERS))
        return Mapping(root.line, rest, root.key_lines)


def read_file(path: Path, format: Format) -> tuple[Decoder, Mapping]:
    """Return the decoder of a YAML file and its content after the version key."""
    return read(read_text(path, format.noun, format.error), str(path), format)


def read(
    text: str, source: str, format: Format, settings: Mapping | None = None
) -> tuple[Decoder, Mapping]:
    """Return the decoder of a YAML text and its content, like `read_file`.

    `source` is its name in messages. `settings` replace its parameters; those of other names remain
    in the decoder.
    """
    decoder = Decoder(source, format, settings=settings or Mapping(None))
    root = parse_yaml(text, source, format.noun, format.error, finite=format.finite)
    return decoder, decoder.head(root)


def read_json(kind: Any, text: str | bytes, source: str, format: Format) -> Any:
    """Return a description of a type from JSON of a program."""
    decoder = Decoder(source, format)
    root = parse_json(text, source, format)
    return decoder.decode(kind, decoder.head(root) if format.key else root, "")


def show(node: Node) -> str:
    """Return a node in words."""
    if isinstance(node, Mapping):
        return "a mapping"
    if isinstance(node, Sequence):
        return f"a list of {len(node.items)}"
    if node.value is None:
        return "nothing"
    text = node.text if len(node.text) <= 60 else node.text[:57] + "..."
    # in data from a program 7 is not '7'
    if node.line is None and not isinstance(node.value, str):
        return text
    return repr(text) + point_hint(text)


def _percent(node: Node) -> float | None:
    """Return the share of a text in per cent; None for any other node."""
    text = node.text.strip() if isinstance(node, Scalar) else ""
    try:
        return float(text[:-1]) / 100.0 if text.endswith("%") else None
    except ValueError:
        return None


def _join(path: str, name: str) -> str:
    return f"{path}.{name}" if path else name


def _hint(kind: Any) -> str:
    """Return an example of a value of a type."""
    if (inner := optional_part(kind)) is not None:
        return _hint(inner) or "null for none"
    if (quantity := dimension_of(kind)) is not None:
        dimension, count = quantity
        one = f'"10 {dimension.units[0]}"'
        return f"[{', '.join([one] * count)}]" if count else f"{dimension.noun} such as {one}"
    return ""
