"""Writes the plain data of a description as YAML that is pleasant to read."""

import re
from typing import Any

from flexstage.files.nodes import NUMBER


class Number(str):
    """Digits that stand in a file without quotes."""

    __slots__ = ()


def yaml_text(data: Any) -> str:
    """Write plain data as YAML."""
    import yaml

    return yaml.dump(
        _flow(data, 0), Dumper=_dumper(), allow_unicode=True, sort_keys=False, width=100
    )


def flow_text(data: Any) -> str:
    """Write plain data as YAML on one line.

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
    """A list that is written on one line."""


class _Line(dict):
    """A mapping that is written on one line."""


def _flow(value: Any, depth: int) -> Any:
    """Choose what is written on one line: lists of scalars, and what stands deep."""
    if isinstance(value, dict):
        inner = {k: _flow(v, depth + 1) for k, v in value.items()}
        return _Line(inner) if depth >= 3 else inner
    if isinstance(value, list):
        rows = [_flow(v, max(depth + 1, 3)) for v in value]
        scalars = all(not isinstance(v, (list, dict)) for v in rows)
        return _Row(rows) if scalars or depth >= 4 else rows
    return value


def plain_dumper() -> type:
    """Make what writes plain data so that `flexstage.files.nodes` reads it back.

    For ``yaml.dump``: no part is named and referred to, and a text that is a number to the reader
    stands in quotes.
    """
    import yaml

    class Dumper(yaml.SafeDumper):
        def ignore_aliases(self, data: Any) -> bool:
            return True

    def text(dumper: Any, data: str) -> Any:
        # line ends of any kind are folded unless they stand escaped between double quotes
        return dumper.represent_scalar(
            "tag:yaml.org,2002:str", data, style=None if data.isprintable() else '"'
        )

    Dumper.add_representer(str, text)
    # YAML 1.1, which the library writes, takes 1e5 for a text
    number = re.compile(rf"(?:{NUMBER.pattern})\Z")  # "8 mm" is none, and needs no quotes
    Dumper.add_implicit_resolver("tag:yaml.org,2002:float", number, list("+-.0123456789"))
    return Dumper


def _dumper() -> type:
    import yaml

    dumper: Any = plain_dumper()

    def number(to: Any, data: Number) -> Any:
        # whatever tag the text would be given, so that none is written
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
