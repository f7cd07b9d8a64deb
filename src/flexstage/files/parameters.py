"""The parameters of a file: named numbers and quantities, which may refer to one another."""

from dataclasses import dataclass
from typing import TYPE_CHECKING

from flexstage.errors import UnitError
from flexstage.files.expression import (
    Amount,
    amount_of,
    check_name,
    is_expression,
    parse,
    require_names,
)
from flexstage.files.nodes import Mapping, Node, Scalar

if TYPE_CHECKING:
    from flexstage.files.decoder import Decoder

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


def read_parameters(decoder: "Decoder", node: Node) -> None:
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


def _described(decoder: "Decoder", node: Node, path: str) -> tuple[Node, str]:
    """Return the value of an entry, and what it says of it."""
    if not isinstance(node, Mapping):
        return node, ""
    decoder.check_keys(node, path, ["value", "description"])
    if "value" not in node.items:
        decoder.refuse(node, path, "'value' is missing")
    told = node.items.get("description")
    text = "" if told is None else decoder.text(told, f"{path}.description")
    return node.items["value"], " ".join(text.split())


def _scalar(decoder: "Decoder", node: Node, path: str) -> Scalar:
    if not isinstance(node, Scalar) or node.value is None or isinstance(node.value, bool):
        decoder.refuse(
            node,
            path,
            "a parameter is a number, a quantity such as '0.5 mm', or an expression such as "
            f"'= 2*R', got {decoder.shown(node)}",
        )
    return node


def _in_order(decoder: "Decoder", values: dict[str, Scalar]) -> list[str]:
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


def _amount(decoder: "Decoder", node: Scalar, path: str) -> Amount:
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
