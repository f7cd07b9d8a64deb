"""Words of a command line: numbers, identifiers, pairs; and how numbers are printed."""

import re
from collections.abc import Container, Mapping, Sequence
from typing import TypeVar

from flexstage.instruments.twin import errors_gcs as code
from flexstage.instruments.twin.errors_gcs import GcsError

_NUMBER = re.compile(r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d{1,4})?", re.ASCII)
_WHOLE = re.compile(r"[0-9]{1,10}")
_HEXADECIMAL = re.compile(r"0[xX][0-9a-fA-F]{1,8}")

#: Nothing on a stage has a larger number, and sums and products of such are still finite.
LARGEST = 1e30

T = TypeVar("T")


def number(word: str) -> float:
    """Return a number of 1e30 at most; what stands for none, ``nan`` and ``inf`` are refused.

    Examples
    --------
    >>> number("-1.5e1")
    -15.0
    """
    # no number of a client has more digits, and the time to read one grows with them
    if len(word) > 64 or _NUMBER.fullmatch(word) is None:
        raise GcsError(code.BAD_NUMBER)
    value = float(word)
    if not abs(value) <= LARGEST:
        raise GcsError(code.BAD_NUMBER)
    return value


def unsigned(word: str) -> int:
    """Return a whole number from 0."""
    if _WHOLE.fullmatch(word) is None:
        raise GcsError(code.BAD_NUMBER)
    return int(word)


def unsigned_or_hex(word: str) -> int:
    """Return a whole number from 0 in decimal or hexadecimal digits.

    Examples
    --------
    >>> unsigned_or_hex("0x16000201"), unsigned_or_hex("369099265")
    (369099265, 369099265)
    """
    if _HEXADECIMAL.fullmatch(word) is not None:
        return int(word, 16)
    return unsigned(word)


def switch(word: str) -> bool:
    """Return what 0 or 1 says."""
    value = unsigned(word)
    if value > 1:
        raise GcsError(code.OUT_OF_RANGE)
    return value == 1


def one(words: Sequence[str], known: Container[str], unknown: int = code.UNKNOWN_AXIS) -> str:
    """Return the only word, an identifier."""
    if len(words) != 1:
        raise GcsError(code.NUMBER_OF_PARAMETERS)
    if words[0] not in known:
        raise GcsError(unknown)
    return words[0]


def chosen(words: Sequence[str], known: Mapping[str, T], unknown: int) -> list[tuple[str, T]]:
    """Return what identifiers stand for; everything where there are none."""
    for word in words:
        if word not in known:
            raise GcsError(unknown)
    return [(word, known[word]) for word in (words or known)]


def pairs(words: Sequence[str], known: Container[str], unknown: int) -> list[tuple[str, str]]:
    """Return identifiers, each with the word behind it."""
    if not words or len(words) % 2:
        raise GcsError(code.NUMBER_OF_PARAMETERS)
    names = words[::2]
    for name in names:
        if name not in known:
            raise GcsError(unknown)
    if len(set(names)) < len(names):
        raise GcsError(code.AXIS_TWICE)
    return list(zip(names, words[1::2], strict=True))


def printed(value: float) -> str:
    """Return a number as a controller prints it.

    Examples
    --------
    >>> printed(12.5)
    '1.250000000e+01'
    """
    return f"{value:.9e}"
