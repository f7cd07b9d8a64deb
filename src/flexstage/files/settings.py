"""Values that are given from outside in place of those in a file, by names with dots."""

import collections.abc
from collections.abc import Collection

from flexstage.choose import nearest
from flexstage.errors import FlexstageError
from flexstage.files.nodes import Mapping, Node, Scalar, Sequence, node_of, parse_yaml


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
