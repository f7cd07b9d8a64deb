"""Readable YAML of the plain data of a description."""

import re
from typing import Any

from flexstage.files.nodes import NUMBER


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
