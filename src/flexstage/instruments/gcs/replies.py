r"""Reading what a GCS controller answers: where a reply ends, what its lines and arrays say.

Each line of a reply but the last ends with a space and a line feed, the last with a line feed
alone. An array is a heading of keys, then rows of numbers.
"""

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from flexstage.errors import ControllerError

_KEY = re.compile(r"#\s*([A-Z_]+[0-9]*)\s*=\s*(.*)")
# "nan" in the ways in which firmware prints it
_NO_NUMBER = re.compile(r"[+-]?(?:nan(?:\([^)]*\))?|\d*\.?#(?:QNAN|IND|SNAN)\w*)", re.IGNORECASE)
_INFINITE = re.compile(r"([+-]?)(?:inf(?:inity)?|\d*\.?#INF\w*)", re.IGNORECASE)
_NUMBER = re.compile(r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d{1,4})?", re.ASCII)
_SHOWN = 60


def take_lines(buffer: bytearray) -> list[str]:
    r"""Take the whole lines away from the beginning of what has come, without their line feeds.

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

    Here and below, `what` is the question, for sentences.

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
    """Read lines of the form ``name=value``, in any order; return the values in that of the names.

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


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class GcsArray:
    """Columns of numbers."""

    columns: NDArray[np.float64]
    """The numbers, shape (columns, rows)."""
    sample_time: float | None = None
    """Time from row to row [s]; None where the heading does not say."""


def parse_array(lines: Sequence[str], width: int, rows: int, what: str) -> GcsArray:
    """Read an array of as many rows and columns (`width`) as `what` asked for.

    Numbers are ``nan`` where a sensor gave that.

    Examples
    --------
    >>> text = "# DIM = 2|# SAMPLE_TIME = 0.002|# NDATA = 1|# END_HEADER|0.5 -1.25"
    >>> array = parse_array(text.split("|"), 2, 1, "DRR?")
    >>> array.columns.tolist(), array.sample_time
    ([[0.5], [-1.25]], 0.002)
    """
    keys: dict[str, str] = {}
    body = 0
    while body < len(lines) and lines[body].startswith("#"):
        found = _KEY.match(lines[body].strip())
        if found:
            keys[found[1]] = found[2].strip()
        body += 1
    interval = number(keys["SAMPLE_TIME"], what) if "SAMPLE_TIME" in keys else None
    values = _columns(lines[body:], keys.get("SEPARATOR", "32"), what)
    if values.shape != (rows, width):
        raise ControllerError(
            f"'{what}' asked for {rows} rows of {width} columns, and {values.shape[0]} rows of "
            f"{values.shape[1]} came: the answer was cut, or is that to something else"
        )
    return GcsArray(columns=np.ascontiguousarray(values.T), sample_time=interval)


def _columns(lines: Sequence[str], separator: str, what: str) -> NDArray[np.float64]:
    divided = {"32": None, "9": "\t", "44": ",", "59": ";"}
    if separator not in divided:
        raise ControllerError(
            f"the columns of the answer to '{what}' are divided by character {excerpt(separator)}, "
            "and space, tab, comma or semicolon is known"
        )
    words = [line.split(divided[separator]) for line in lines]
    if len({len(row) for row in words}) > 1:
        raise ControllerError(
            f"the rows of the answer to '{what}' differ in length: the answer was cut"
        )
    try:
        # "1_000" and digits of other scripts are numbers to Python
        plain = not any("_" in line or not line.isascii() for line in lines)
        rows = [[float(word) if plain else number(word, what) for word in row] for row in words]
    except ValueError:
        rows = [[number(word, what) for word in row] for row in words]
    return np.array(rows, dtype=np.float64).reshape(len(rows), len(rows[0]) if rows else 0)


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
