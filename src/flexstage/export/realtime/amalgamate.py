"""One file from several headers of C, with names of its own."""

import re
from collections.abc import Mapping

import numpy as np

_OWN = re.compile(r'^\s*#\s*include\s+"([^"]+)".*\n', re.MULTILINE)
_NUMBERS = re.compile(r"static const fs_real \w+(?:\[\w+\])+ = \{.*?\};", re.DOTALL)
_NUMBER = re.compile(r"(?<![\w.])-?\d+\.?\d*(?:e[+-]?\d+)?(?![\w.])")
_SYSTEM = re.compile(r"^\s*#\s*include\s+<([^>]+)>.*\n", re.MULTILINE)


def amalgamated(sources: Mapping[str, bytes]) -> str:
    """Return headers, each after those that it includes, as one text, system headers first."""
    parts: list[str] = []
    system: dict[str, None] = {}
    done: set[str] = set()
    for name, content in sources.items():
        text = content.decode("utf-8")
        for needed in _OWN.findall(text):
            if needed not in done:
                raise ValueError(f"{name} includes {needed}, which does not stand before it")
        system.update(dict.fromkeys(_SYSTEM.findall(text)))
        done.add(name)
        parts.append(_SYSTEM.sub("", _OWN.sub("", text)).strip("\n"))
    head = "".join(f"#include <{name}>\n" for name in system)
    return head + "\n" + re.sub(r"\n{3,}", "\n\n", "\n\n".join(parts)) + "\n"


def prefixed(text: str, prefix: str) -> str:
    """Return C with the names of the core, fs_... and FS_..., under a prefix of its own.

    Macros take it in capitals, so that two with other prefixes stand in one program.

    Examples
    --------
    >>> prefixed("fs_real x = FS_R(1.0);", "xy")
    'xy_real x = XY_R(1.0);'
    """
    text = re.sub(r"\bfs_(?=\w)", f"{prefix}_", text)
    return re.sub(r"\bFS_(?=\w)", f"{prefix.upper()}_", text)


def in_single(text: str) -> str:
    """Return C with the numbers of its constant arrays in the fewest digits of single precision.

    What is below the smallest normal number is zero.

    Examples
    --------
    >>> in_single("static const fs_real a[2] = {0.12345678901234, 1e-50};")
    'static const fs_real a[2] = {0.12345679f, 0.0f};'
    """
    return _NUMBERS.sub(lambda block: _after_sizes(block[0]), text)


def _after_sizes(block: str) -> str:
    head, numbers = block.split("=", 1)
    return f"{head}={_NUMBER.sub(lambda n: _single(n[0]), numbers)}"


def _single(number: str) -> str:
    value = np.float32(float(number))
    if abs(value) < np.finfo(np.float32).tiny:
        return "0.0f"
    text = str(value)
    return f"{text}f" if "." in text or "e" in text else f"{text}.0f"
