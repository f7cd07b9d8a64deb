"""The parameters of a file: numbers and quantities by name, and values set in place of them.

They may refer to one another; what is set from outside has names with dots.
"""

import collections.abc
from collections.abc import Collection
from dataclasses import dataclass
from typing import NoReturn, Protocol

from flexstage.base.choose import nearest
from flexstage.base.errors import FlexstageError, UnitError
from flexstage.files.expression import (
    Amount,
    amount_of,
    check_name,
    is_expression,
    parse,
    require_names,
)
from flexstage.files.nodes import Mapping, Node, Scalar, Sequence, node_of, parse_yaml

#: The key under which they stand.
KEY = "parameters"
#: Most parameters of a file.
MOST = 1_000


@dataclass(frozen=True, slots=True, kw_only=True)
class FileParameter:
    """A parameter of a file, or one that is set in its place."""

    amount: Amount
    """Its value."""
    text: str
    """Its value as it is written."""
    description: str
    """What it is, in the words of the file."""
    line: int | None
    """Line of the file on which it stands; None where it is set from outside."""


class ParameterDecoder(Protocol):
    """What the reader of a file does for its parameters."""

    settings: Mapping
    parameters: dict[str, FileParameter]

    def mapping(self, node: Node, path: str) -> Mapping:
        """Refuse what is no mapping."""
        ...

    def check_keys(self, node: Mapping, path: str, known: Collection[str]) -> None:
        """Refuse keys that mean nothing."""
        ...

    def text(self, node: Node, path: str) -> str:
        """Read a text."""
        ...

    def amount(self, node: Scalar, path: str) -> Amount:
        """Evaluate an expression."""
        ...

    def shown(self, node: Node) -> str:
        """Say what stands at a place."""
        ...

    def refuse(
        self, node: Node, path: str, message: str, error: type[FlexstageError] | None = None
    ) -> NoReturn:
        """Raise an error that names the place."""
        ...


def read_parameters(decoder: ParameterDecoder, node: Node) -> None:
    """Read the parameters of a file into its decoder, whose settings stand in place of them."""
    entries = decoder.mapping(node, KEY)
    if len(entries.items) > MOST:
        decoder.refuse(node, KEY, f"a file has at most {MOST} parameters, got {len(entries.items)}")
    values: dict[str, Scalar] = {}
    texts: dict[str, str] = {}
    for name, entry in entries.items.items():
        place = Scalar(entries.key_lines.get(name, entry.line), name, name)
        try:
            check_name(name)
        except UnitError as error:
            decoder.refuse(place, KEY, str(error))
        given, texts[name] = _described(decoder, entry, f"{KEY}.{name}")
        values[name] = _scalar(decoder, decoder.settings.items.pop(name, given), f"{KEY}.{name}")
    for name in _in_order(decoder, values):
        node = values[name]
        decoder.parameters[name] = FileParameter(
            amount=_amount(decoder, node, f"{KEY}.{name}"),
            text=node.text,
            description=texts[name],
            line=node.line,
        )
    decoder.parameters = {name: decoder.parameters[name] for name in values}


def _described(decoder: ParameterDecoder, node: Node, path: str) -> tuple[Node, str]:
    """Return the value of an entry, and what it says of it."""
    if not isinstance(node, Mapping):
        return node, ""
    decoder.check_keys(node, path, ["value", "description"])
    if "value" not in node.items:
        decoder.refuse(node, path, "'value' is missing")
    told = node.items.get("description")
    text = "" if told is None else decoder.text(told, f"{path}.description")
    return node.items["value"], " ".join(text.split())


def _scalar(decoder: ParameterDecoder, node: Node, path: str) -> Scalar:
    if not isinstance(node, Scalar) or node.value is None or isinstance(node.value, bool):
        decoder.refuse(
            node,
            path,
            "a parameter is a number, a quantity such as '0.5 mm', or an expression such as "
            f"'= 2*R', got {decoder.shown(node)}",
        )
    return node


def _in_order(decoder: ParameterDecoder, values: dict[str, Scalar]) -> list[str]:
    """Return the names so that each stands behind those that it needs; refuse circles."""
    needs: dict[str, set[str]] = {}
    for name, node in values.items():
        needs[name] = set()
        if is_expression(node.value):
            try:
                require_names(parse(node.text), values)
            except UnitError as error:
                decoder.refuse(node, f"{KEY}.{name}", str(error), UnitError)
            needs[name] = set(parse(node.text).names)
    ordered: list[str] = []
    waiting = {name: set(needed) for name, needed in needs.items()}
    ready = [name for name, needed in waiting.items() if not needed]
    used_by: dict[str, list[str]] = {}
    for name, needed in needs.items():
        for other in needed:
            used_by.setdefault(other, []).append(name)
    while ready:
        ordered.append(name := ready.pop())
        del waiting[name]
        for other in used_by.get(name, ()):
            waiting[other].discard(name)
            if not waiting[other]:
                ready.append(other)
    if waiting:
        circle = [min(waiting, key=list(values).index)]
        while circle[-1] not in circle[:-1]:
            circle.append(next(n for n in values if n in waiting[circle[-1]]))
        circle = circle[circle.index(circle[-1]) :]
        shown = " needs ".join(f"'{n[:40]}'" for n in circle[:8])
        decoder.refuse(values[circle[0]], f"{KEY}.{circle[0]}", f"a circle: {shown}")
    return ordered


def _amount(decoder: ParameterDecoder, node: Scalar, path: str) -> Amount:
    if is_expression(node.value):
        return decoder.amount(node, path)
    try:
        amount = amount_of(node.text)
        float(amount.value)
    except UnitError as error:
        decoder.refuse(node, path, str(error), UnitError)
    except OverflowError:
        decoder.refuse(node, path, f"{decoder.shown(node)} is too large to be a number")
    return amount


def settings_of(
    values: collections.abc.Mapping[str, object], error: type[FlexstageError]
) -> Mapping:
    """Return values by dotted names as nested nodes without lines; a text is read as YAML.

    Examples
    --------
    >>> made = settings_of({"x.lever_neck": "0.45 mm", "x.count": "3"}, FlexstageError)
    >>> made.items["x"].items["count"].value
    3
    """
    root = Mapping(None)
    for name, value in values.items():
        *groups, last = name.split(".")
        held = root
        for group in groups:
            inner = held.items.setdefault(group, Mapping(None))
            if not isinstance(inner, Mapping):
                raise error(f"{name[:60]!r} is set, and all of {group[:60]!r} as well: leave one")
            held = inner
        if last in held.items:
            raise error(f"{name[:60]!r} is set, and a part of it as well: leave one out")
        if isinstance(value, str):
            source = f"the value of {name[:60]!r}"
            held.items[last] = _without_lines(parse_yaml(value, source, "value", error))
        else:
            held.items[last] = node_of(value)
    return root


def overridden(node: Mapping, settings: Mapping) -> Mapping:
    """Return a mapping in which settings stand in place of what it says."""
    items = dict(node.items)
    for key, value in settings.items.items():
        held = items.get(key)
        match held, value:
            case Mapping(), Mapping():
                items[key] = overridden(held, value)
            case _:
                items[key] = value
    return Mapping(node.line, items, node.key_lines)


def require_known(
    owner: str, name: str, known: Collection[str], error: type[FlexstageError]
) -> None:
    """Refuse the name of a parameter that an owner does not have; the nearest ones are told."""
    if name in known:
        return
    last = name.rpartition(".")[2]
    # the same name in another group, one that goes on, or the nearest of all
    near = [k for k in known if k.rpartition(".")[2] == last]
    near = near or [k for k in known if len(last) > 2 and k.startswith(name)]
    near = near or [k for k in [nearest(name, known, 0.5)] if k is not None]
    if near:
        hint = f"did you mean {' or '.join(repr(k) for k in near[:4])}?"
    else:
        listed = ", ".join(name for name in known if "." not in name)
        hint = f"its parameters are {listed}" if listed else "it has none, under 'parameters'"
    raise error(f"{owner} has no parameter {name[:60]!r}: {hint}")


def _without_lines(node: Node) -> Node:
    match node:
        case Scalar():
            return Scalar(None, node.text, node.value)
        case Sequence():
            return Sequence(None, [_without_lines(item) for item in node.items])
    return Mapping(None, {key: _without_lines(item) for key, item in node.items.items()})
