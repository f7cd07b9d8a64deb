"""Nodes of YAML and JSON with their lines, read safely.

Only the events of the YAML parser are used: no object is built from a tag, no alias is followed,
and limits are checked while the text is read, so that a hostile file is refused early. Scalars
follow the core schema of YAML 1.2: only true and false are booleans, and 12:30 is text.
"""

import collections.abc
import json
import math
import re
import stat
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NoReturn

from flexstage.base.errors import FlexstageError
from flexstage.files.format import Format

#: Largest file that is read [bytes].
MAX_BYTES = 1_000_000
#: Largest number of values in a file.
MAX_NODES = 100_000
#: Deepest nesting of lists and mappings.
MAX_DEPTH = 30

#: Numbers without quotes.
NUMBER = re.compile(r"[-+]?(?:\.[0-9]+|[0-9]+(?:\.[0-9]*)?)(?:[eE][-+]?[0-9]+)?")
_NOT_FINITE = re.compile(r"[-+]?\.(?:inf|Inf|INF)|\.(?:nan|NaN|NAN)")
_MAX_DIGITS = 60

#: Beginnings of other kinds of files, and their names.
_OTHERS = {
    r"\s*0\s*\r?\n\s*SECTION\b": "a DXF drawing",
    r"ISO-10303-21;": "a STEP file",
    r"\s*<[?!A-Za-z]": "XML or a web page",
}


@dataclass(slots=True)
class Scalar:
    """A single value."""

    line: int | None
    """Line in the file, from 1; None without a file."""
    text: str
    """Text of the value, with quotes and escapes resolved."""
    value: str | float | int | bool | None
    """Value by the core schema."""


@dataclass(slots=True)
class Sequence:
    """A list."""

    line: int | None
    """First line in the file, from 1; None without a file."""
    items: "list[Node]" = field(default_factory=list)
    """Entries."""


@dataclass(slots=True)
class Mapping:
    """A mapping of names to values."""

    line: int | None
    """First line in the file, from 1; None without a file."""
    items: "dict[str, Node]" = field(default_factory=dict)
    """Entries in order."""
    key_lines: dict[str, int] = field(default_factory=dict)
    """Line of each key."""


Node = Scalar | Sequence | Mapping


def read_text(path: Path, kind: str, error: type[FlexstageError]) -> str:
    """Return the text of a small file, whose kind is for messages.

    A file that is not regular, too large or not UTF-8 is refused.
    """

    def refuse(sentence: str) -> NoReturn:
        raise error(sentence) from None

    try:
        # checked before opening: a named pipe would block
        status = path.stat()
        if stat.S_ISDIR(status.st_mode):
            refuse(f"{path} is a directory, expected a {kind}")
        if not stat.S_ISREG(status.st_mode):
            refuse(f"{path} is not a regular file, expected a {kind}")
        with path.open("rb") as stream:
            data = stream.read(MAX_BYTES + 1)
    except FileNotFoundError:
        refuse(f"there is no file {path}: give the path of a {kind}")
    except FlexstageError:
        raise
    except (OSError, ValueError) as fault:
        reason = getattr(fault, "strerror", None) or str(fault)
        refuse(f"the file {path} cannot be read: {reason}")
    if len(data) > MAX_BYTES:
        refuse(_too_large(path, kind))
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError as fault:
        line = data.count(b"\n", 0, fault.start) + 1
        if b"\0" in data and data[:2] not in (b"\xff\xfe", b"\xfe\xff"):
            refuse(
                f"{path} is a picture or another binary file, expected a {kind}: give the text "
                "file that it belongs to"
            )
        refuse(f"{path}, line {line}: the file is not UTF-8 text; save it in that encoding")


def _too_large(source: object, kind: str) -> str:
    return f"{source} is larger than {MAX_BYTES // 1_000_000} MB, the limit of a {kind}"


def parse_yaml(
    text: str,
    source: str,
    kind: str,
    error: type[FlexstageError],
    *,
    finite: bool = True,
) -> Node:
    """Return the root of the only YAML document of a text.

    `source` is its name in messages, `kind` the expected kind of file. Aliases, anchors, tags,
    repeated keys, a second document, sizes above the limits, and, with `finite`, numbers that are
    not finite are refused.
    """
    import yaml

    def refuse(sentence: str) -> NoReturn:
        raise error(sentence) from None

    if len(text) > MAX_BYTES:
        refuse(_too_large(source, kind))
    for pattern, what in _OTHERS.items():
        if re.match(pattern, text):
            refuse(f"{source} is {what}, expected a YAML file")
    loader = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
    try:
        return _Builder(source, kind, error, finite).document(yaml.parse(text, Loader=loader))
    except yaml.MarkedYAMLError as fault:
        mark = fault.problem_mark or fault.context_mark
        line = f", line {mark.line + 1}" if mark else ""
        lines = text.split("\n")[mark.line :] if mark else []
        tab = mark and lines and lines[0][mark.column :].startswith("\t")
        problem = "a tab is used for indentation: use spaces" if tab else fault.problem
        refuse(f"{source}{line}: this is not YAML: {problem}")
    except yaml.YAMLError as fault:
        reason = getattr(fault, "reason", None) or "it cannot be parsed"
        refuse(f"{source}: this is not YAML: {reason}")
    except UnicodeEncodeError:
        refuse(f"{source}: this is not YAML: it contains an incomplete character")


def parse_json(text: str | bytes, source: str, format: Format) -> Node:
    """Return the root of JSON from a program; its nodes have no lines.

    Repeated keys are refused, since one of them would be lost.
    """

    def refuse(place: str, message: str) -> NoReturn:
        raise format.error(f"{source}{place}: {message}{format.ending}") from None

    def unique_keys(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
        data = dict(pairs)
        if len(data) < len(pairs):
            keys = [key for key, _ in pairs]
            repeated = next(key for key in keys if keys.count(key) > 1)
            refuse("", f"the key '{repeated[:60]}' is given twice in the {format.noun}")
        return data

    not_json = f"this is not the JSON of a {format.noun}"
    try:
        decoded = text.decode("utf-8-sig") if isinstance(text, bytes) else text
        return node_of(json.loads(decoded, object_pairs_hook=unique_keys))
    except FlexstageError:
        raise
    except json.JSONDecodeError as fault:
        refuse(
            f", line {fault.lineno}, column {fault.colno}",
            f"{not_json}: {fault.msg.removesuffix(' at')}",
        )
    except UnicodeDecodeError as fault:
        line = fault.object.count(b"\n", 0, fault.start) + 1
        refuse(f", line {line}", f"{not_json}: it is not UTF-8 text")
    except RecursionError:
        refuse("", f"{not_json}: it is nested too deep")
    except ValueError:  # a number with thousands of digits
        refuse("", f"{not_json}: a number has too many digits")


def node_of(data: Any) -> Node:
    """Return plain data as nodes without lines."""
    if isinstance(data, MappingData):
        return data.node
    if isinstance(data, collections.abc.Mapping):
        return Mapping(None, {str(key): node_of(value) for key, value in data.items()})
    if isinstance(data, (list, tuple)):
        return Sequence(None, [node_of(value) for value in data])
    if data is None or isinstance(data, (str, bool, int, float)):
        text = str(data).lower() if isinstance(data, bool) else str(data)
        return Scalar(None, "" if data is None else text, data)
    if hasattr(data, "tolist"):  # of NumPy
        return node_of(data.tolist())
    return Scalar(None, repr(data), repr(data))


def plain(node: Node) -> Any:
    """Return nodes as plain data."""
    if isinstance(node, Mapping):
        return {key: plain(value) for key, value in node.items.items()}
    if isinstance(node, Sequence):
        return [plain(value) for value in node.items]
    return node.value


class MappingData(dict[str, object]):
    """Plain data of a mapping in a file, with its node and decoder."""

    def __init__(self, node: Mapping, decoder: Any) -> None:
        super().__init__(plain(node))
        self.node = node
        self.decoder = decoder


class _Builder:
    """Builder of nodes from the events of the parser, with a stack instead of recursion."""

    def __init__(self, source: str, kind: str, error: type[FlexstageError], finite: bool) -> None:
        self.source = source
        self.kind = kind
        self.error = error
        self.finite = finite
        self.count = 0

    def document(self, events: Iterator[Any]) -> Node:
        import yaml

        root: Node | None = None
        stack: list[Sequence | Mapping] = []
        keys: list[tuple[str, int] | None] = []
        documents = 0
        for event in events:
            line = event.start_mark.line + 1
            if isinstance(event, yaml.DocumentStartEvent):
                documents += 1
                if documents > 1:
                    self.refuse(line, f"a second document begins; a {self.kind} has only one")
            elif isinstance(event, (yaml.SequenceEndEvent, yaml.MappingEndEvent)):
                stack.pop()
                keys.pop()
            elif isinstance(event, yaml.AliasEvent):
                self.refuse(
                    line, f"aliases such as '*{event.anchor}' are not used in a {self.kind}"
                )
            elif isinstance(event, yaml.NodeEvent):
                if stack and isinstance(stack[-1], Mapping) and keys[-1] is None:
                    keys[-1] = self.key(event, line, stack[-1])
                    continue
                node = self.node(event, line)
                if not stack:
                    root = node
                elif isinstance(parent := stack[-1], Sequence):
                    parent.items.append(node)
                else:
                    key, key_line = keys[-1] or ("", line)
                    parent.items[key] = node
                    parent.key_lines[key] = key_line
                    keys[-1] = None
                if not isinstance(node, Scalar):
                    if len(stack) >= MAX_DEPTH:
                        self.refuse(
                            line, f"lists and mappings are nested more than {MAX_DEPTH} deep"
                        )
                    stack.append(node)
                    keys.append(None)
        if root is None:
            self.refuse(1, f"the file is empty, expected a {self.kind}")
        return root

    def admit(self, event: Any, line: int) -> None:
        self.count += 1
        if self.count > MAX_NODES:
            self.refuse(line, f"the file has more than {MAX_NODES} values")
        if event.anchor is not None:
            self.refuse(line, f"anchors such as '&{event.anchor}' are not used in a {self.kind}")
        if event.tag is not None:
            self.refuse(line, f"tags such as '{event.tag[:60]}' are not used in a {self.kind}")

    def key(self, event: Any, line: int, parent: Mapping) -> tuple[str, int]:
        self.admit(event, line)
        key = getattr(event, "value", None)
        if not isinstance(key, str):
            self.refuse(line, "a key must be a plain text, got a list or a mapping")
        if key in parent.items:
            first = parent.key_lines[key]
            self.refuse(line, f"the key '{key[:60]}' is given twice, first on line {first}")
        return key, line

    def node(self, event: Any, line: int) -> Node:
        import yaml

        self.admit(event, line)
        if isinstance(event, yaml.SequenceStartEvent):
            return Sequence(line)
        if isinstance(event, yaml.MappingStartEvent):
            return Mapping(line)
        # the first of the pair is true for a scalar without quotes
        return Scalar(
            line, event.value, self.resolve(event.value, line) if event.implicit[0] else event.value
        )

    def resolve(self, text: str, line: int) -> str | float | int | bool | None:
        if text in ("", "~", "null", "Null", "NULL"):
            return None
        if text in ("true", "True", "TRUE"):
            return True
        if text in ("false", "False", "FALSE"):
            return False
        if _NOT_FINITE.fullmatch(text):
            if self.finite:
                self.refuse(line, f"'{text}' is not a finite number")
            return float(text.replace(".", ""))
        if NUMBER.fullmatch(text):
            if len(text) > _MAX_DIGITS:
                self.refuse(line, f"a number has more than {_MAX_DIGITS} digits")
            if text.lstrip("+-").isdigit():
                return int(text)
            number = float(text)
            if not math.isfinite(number):
                self.refuse(line, f"'{text}' is too large to be a number")
            return number
        return text

    def refuse(self, line: int, message: str) -> NoReturn:
        raise self.error(f"{self.source}, line {line}: {message}")
