r"""Reading what a GCS controller answers: where a reply ends, and what its lines say.

Each line of a reply but the last ends with a space and a line feed, the last with a line feed
alone.
"""

import math
import re
from collections.abc import Sequence

from flexstage.errors import ControllerError

# "nan" in the ways in which firmware prints it
_NO_NUMBER = re.compile(r"[+-]?(?:nan(?:\([^)]*\))?|\d*\.?#(?:QNAN|IND|SNAN)\w*)", re.IGNORECASE)
_INFINITE = re.compile(r"([+-]?)(?:inf(?:inity)?|\d*\.?#INF\w*)", re.IGNORECASE)
_NUMBER = re.compile(r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d{1,4})?", re.ASCII)
_SHOWN = 60


def take_lines(buffer: bytearray) -> list[str]:
    r"""Take the whole lines from the beginning of what has come.

    Examples
    --------
    >>> came = bytearray(b"1=0.5 \n2=0.25\n3=")
    >>> take_lines(came), bytes(came)
    (['1=0.5 ', '2=0.25'], b'3=')
    """
    end = buffer.rfind(b"\n") + 1
    lines = bytes(buffer[:end]).decode("latin-1").split("\n")[:-1]
    del buffer[:end]
    return [line.rstrip("\r") for line in lines]


def number(text: str, what: str) -> float:
    """Read a number; what stands for none, such as ``nan``, is returned as such.

    Examples
    --------
    >>> number(" 1.25e1", "POS?"), number("-1.#IND", "POS?")
    (12.5, nan)
    """
    word = text.strip()
    if len(word) <= _SHOWN and _NUMBER.fullmatch(word):
        return float(word)
    if _NO_NUMBER.fullmatch(word):
        return math.nan
    infinite = _INFINITE.fullmatch(word)
    if infinite:
        return -math.inf if infinite[1] == "-" else math.inf
    raise ControllerError(f"the answer to '{what}' should be a number, got {excerpt(text)}")


def whole_number(text: str, what: str) -> int:
    """Read a whole number, decimal or with ``0x`` before it.

    Examples
    --------
    >>> whole_number("0x10", "#5"), whole_number("8.0", "RTR?")
    (16, 8)
    """
    word = text.strip()
    if re.fullmatch(r"0[xX][0-9a-fA-F]{1,16}", word):
        return int(word, 16)
    if re.fullmatch(r"[+-]?\d{1,15}(?:\.0*)?", word, re.ASCII):
        return int(float(word))
    raise ControllerError(f"the answer to '{what}' should be a whole number, got {excerpt(text)}")


def assignments(lines: Sequence[str], names: Sequence[str], what: str) -> list[str]:
    """Read lines of the form ``name=value``, one for each name, in any order.

    Examples
    --------
    >>> assignments(["1=0.5 ", "2=0.25"], ["2", "1"], "POS?")
    ['0.25', '0.5']
    """
    found: dict[str, str] = {}
    for line in lines:
        name, equals, value = line.rpartition("=")
        if not equals or name.strip() in found:
            raise ControllerError(_not_an_answer(lines, names, what))
        found[name.strip()] = value.strip()
    if set(found) != set(names):
        raise ControllerError(_not_an_answer(lines, names, what))
    return [found[name] for name in names]


def excerpt(text: str) -> str:
    """Return a text as it can be shown, cut where it is long.

    Examples
    --------
    >>> excerpt("a" * 70)[-8:]
    "aaaa'..."
    """
    return ascii(text[:_SHOWN]) + ("..." if len(text) > _SHOWN else "")


def _not_an_answer(lines: Sequence[str], names: Sequence[str], what: str) -> str:
    return (
        f"the answer to '{what}' should have one value for each of {', '.join(names)}, got "
        f"{excerpt(' | '.join(lines))}: something else may be talking on this link"
    )
