"""Parameters of a file: numbers and quantities by name, and settings that replace them.

Parameters may refer to one another; settings have names with dots.
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

#: Key of the parameters in a file.
KEY = "parameters"
#: Largest number of parameters of a file.
MOST = 1_000


@dataclass(frozen=True, slots=True, kw_only=True)
class FileParameter:
    """A parameter of a file, or a setting that replaces it."""

    amount: Amount
    """Value."""
    text: str
    """Text of the value."""
    description: str
    """Description in the file."""
    line: int | None
    """Line in the file; None for a setting."""


class ParameterDecoder(Protocol):
    """Methods of a decoder that parameters need."""

    settings: Mapping
    parameters: dict[str, FileParameter]

    def mapping(self, node: Node, path: str) -> Mapping:
        """Return a mapping; refuse any other node."""
        ...

    def check_keys(self, node: Mapping, path: str, known: Collection[str]) -> None:
        """Refuse unknown keys."""
        ...

    def text(self, node: Node, path: str) -> str:
        """Return a text."""
        ...

    def amount(self, node: Scalar, path: str) -> Amount:
        """Return the value of an expression."""
        ...

    def describe(self, node: Node) -> str:
        """Return a node in words."""
        ...

    def refuse(
        self, node: Node, path: str, message: str, error: type[FlexstageError] | None = None
    ) -> NoReturn:
        """Raise an error with the place in the file."""
        ...


def read_parameters(decoder: ParameterDecoder, node: Node) -> None:
    """Read the parameters of a file into its decoder, whose settings replace them."""
    entries = decoder.mapping(node, KEY)
    if len(entries.items) > MOST:
        decoder.refuse(
            node, KEY, f"a file may have at most {MOST} parameters, got {len(entries.items)}"
        )
    values: dict[str, Scalar] = {}
    texts: dict[str, str] = {}
    for name, entry in entries.items.items():
        place = Scalar(entries.key_lines.get(name, entry.line), name, name)
        try:
            check_name(name)
        except UnitError as error:
            decoder.refuse(place, KEY, str(error))
        value_node, texts[name] = _described(decoder, entry, f"{KEY}.{name}")
        values[name] = _scalar(
            decoder, decoder.settings.items.pop(name, value_node), f"{KEY}.{name}"
        )
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
    """Return value and description of an entry."""
    if not isinstance(node, Mapping):
        return node, ""
    decoder.check_keys(node, path, ["value", "description"])
    if "value" not in node.items:
        decoder.refuse(node, path, "'value' is missing")
    description = node.items.get("description")
    text = "" if description is None else decoder.text(description, f"{path}.description")
    return node.items["value"], " ".join(text.split())


def _scalar(decoder: ParameterDecoder, node: Node, path: str) -> Scalar:
    if not isinstance(node, Scalar) or node.value is None or isinstance(node.value, bool):
        decoder.refuse(
            node,
            path,
            "a parameter must be a number, a quantity such as '0.5 mm', or an expression such as "
            f"'= 2*R', got {decoder.describe(node)}",
        )
    return node


def _in_order(decoder: ParameterDecoder, values: dict[str, Scalar]) -> list[str]:
    """Return the names in order of evaluation; refuse circular references."""
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
        cycle = [min(waiting, key=list(values).index)]
        while cycle[-1] not in cycle[:-1]:
            cycle.append(next(n for n in values if n in waiting[cycle[-1]]))
        cycle = cycle[cycle.index(cycle[-1]) :]
        chain = " needs ".join(f"'{n[:40]}'" for n in cycle[:8])
        decoder.refuse(values[cycle[0]], f"{KEY}.{cycle[0]}", f"circular reference: {chain}")
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
        decoder.refuse(node, path, f"{decoder.describe(node)} is too large to be a number")
    return amount


def settings_of(
    values: collections.abc.Mapping[str, object], error: type[FlexstageError]
) -> Mapping:
    """Return values by dotted names as nested nodes without lines; a text is parsed as YAML.

    Examples
    --------
    >>> root = settings_of({"x.lever_neck": "0.45 mm", "x.count": "3"}, FlexstageError)
    >>> root.items["x"].items["count"].value
    3
    """
    root = Mapping(None)
    for name, value in values.items():
        *groups, last = name.split(".")
        group_node = root
        for group in groups:
            inner = group_node.items.setdefault(group, Mapping(None))
            if not isinstance(inner, Mapping):
                raise error(f"{name[:60]!r} and all of {group[:60]!r} are set: set one of them")
            group_node = inner
        if last in group_node.items:
            raise error(f"{name[:60]!r} and a part of it are set: set one of them")
        if isinstance(value, str):
            source = f"the value of {name[:60]!r}"
            group_node.items[last] = _without_lines(parse_yaml(value, source, "value", error))
        else:
            group_node.items[last] = node_of(value)
    return root


def overridden(node: Mapping, settings: Mapping) -> Mapping:
    """Return a mapping with its values replaced by settings."""
    items = dict(node.items)
    for key, value in settings.items.items():
        current = items.get(key)
        match current, value:
            case Mapping(), Mapping():
                items[key] = overridden(current, value)
            case _:
                items[key] = value
    return Mapping(node.line, items, node.key_lines)


def require_known(
    owner: str, name: str, known: Collection[str], error: type[FlexstageError]
) -> None:
    """Refuse the name of a parameter that an owner does not have, with the nearest ones."""
    if name in known:
        return
    last = name.rpartition(".")[2]
    # the same name in another group, a longer name, or the nearest name
    candidates = [k for k in known if k.rpartition(".")[2] == last]
    candidates = candidates or [k for k in known if len(last) > 2 and k.startswith(name)]
    candidates = candidates or [k for k in [nearest(name, known, 0.5)] if k is not None]
    if candidates:
        hint = f"did you mean {' or '.join(repr(k) for k in candidates[:4])}?"
    else:
        listed = ", ".join(name for name in known if "." not in name)
        hint = f"its parameters are {listed}" if listed else "it has none under 'parameters'"
    raise error(f"{owner} has no parameter {name[:60]!r}: {hint}")


def _without_lines(node: Node) -> Node:
    match node:
        case Scalar():
            return Scalar(None, node.text, node.value)
        case Sequence():
            return Sequence(None, [_without_lines(item) for item in node.items])
    return Mapping(None, {key: _without_lines(item) for key, item in node.items.items()})
