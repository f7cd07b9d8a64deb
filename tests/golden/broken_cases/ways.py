"""Ways to break the text of a file, and those that break any file of YAML or JSON.

A way is what it is called, and what it makes of the valid text: ``(old, new)`` replaces the one
place where ``old`` stands, a text or bytes are the whole file, and a function is given the text.
"""

import json
from collections.abc import Callable
from typing import Any

Edit = tuple[str, str] | str | bytes | Callable[[str], str | bytes]
Edits = dict[str, Edit]


def added(line: str) -> Callable[[str], str]:
    """A line more at the end."""
    return lambda text: text + line + "\n"


def cut(share: float) -> Callable[[str], str]:
    """The first part of a file."""
    return lambda text: text[: int(share * len(text))]


def without(line: str) -> tuple[str, str]:
    """A line less."""
    return (line + "\n", "")


def changed(text: str, **values: Any) -> Callable[[str], str]:
    """Change keys of the outermost mapping of a text in JSON."""
    return lambda _: json.dumps({**json.loads(text), **values}, indent=1)


def lacking(text: str, key: str) -> Callable[[str], str]:
    """Leave a key of the outermost mapping of a text in JSON out."""
    return lambda _: json.dumps({k: v for k, v in json.loads(text).items() if k != key}, indent=1)


#: What is wrong with any file of YAML.
ANY_YAML: Edits = {
    "empty": "",
    "comments alone": "# nothing\n# yet\n",
    "nothing between its marks": "---\n...\n",
    "a list": "- 1\n- 2\n",
    "a text": "hello\n",
    "a number": "3.7\n",
    "a file of another kind": "zebra: 1\nlion: 2\n",
    "a list that is not closed": added("more: [1, 2"),
    "a bracket that closes nothing": added("more: [1]]"),
    "a quote that is not closed": added("more: 'one"),
    "a tab at the start of a line": added("more:\n\t- 1"),
    "a colon in a text": added("more: one: two"),
    "the first half": cut(0.5),
    "the first nine tenths": cut(0.9),
    "two documents": lambda text: text + "---\n" + text,
    "a tag of its own": added("more: !secret 5"),
    "a tag of Python": added("more: !!python/object/apply:os.system ['true']"),
    "a tag of YAML": added("more: !!float 5"),
    "an anchor": added("more: &one [1]"),
    "an alias": added("more: *one"),
    "a key that is merged": added("<<: {a: 1}"),
    "a list as a key": added("? [1, 2]\n: 3"),
    "a number as a key": added("7: 3"),
    "the last key given twice": added("more: 1\nmore: 2"),
    "31 lists in each other": added("more: " + "[" * 31 + "]" * 31),
    "100000 values": added("more: [" + "1, " * 100_000 + "]"),
    "more than 1 MB": lambda text: "#" * 1_000_001 + "\n" + text,
    "a number of 61 digits": added("more: " + "7" * 61),
    "a number beyond all": added("more: 1e999"),
    "not a number": added("more: .nan"),
    "infinite": added("more: -.inf"),
    "a letter of Latin-1": lambda text: text.encode() + b"more: \xb5m\n",
    "UTF-16": lambda text: text.encode("utf-16"),
    "a zero": added("more: \0"),
    "a control character": added("more: \x07"),
    "a web page": "<html><body>404</body></html>\n",
    "a drawing": "  0\nSECTION\n",
    "a solid": "ISO-10303-21;\n",
}

#: What is wrong with any text in JSON.
ANY_JSON: Edits = {
    "empty": "",
    "a list": "[1, 2]",
    "a text": '"hello"',
    "a number": "3.7",
    "nothing": "null",
    "an empty mapping": "{}",
    "a file of another kind": '{"zebra": 1, "lion": 2}',
    "no JSON": "hello",
    "the first half": cut(0.5),
    "all but the last bracket": lambda text: text[:-1],
    "more after its end": lambda text: text + " {}",
    "a quote that is not closed": ('"vgtu-piezo"', '"vgtu-piezo'),
    "a comment": lambda text: "// ours\n" + text,
    "100000 lists in each other": "[" * 100_000,
    "a control character": ("vgtu-piezo", "vgtu\x07piezo"),
    "a zero": ("vgtu-piezo", "vgtu\0piezo"),
    "a letter of Latin-1": lambda text: text.encode().replace(b"vgtu-piezo", b"vgtu-\xb5"),
    "UTF-16": lambda text: text.encode("utf-16"),
    "a byte order mark": lambda text: b"\xef\xbb\xbf" + text.encode(),
}
