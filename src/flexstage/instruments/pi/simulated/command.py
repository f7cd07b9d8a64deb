"""Commands of the command set: what one is, its words, and how numbers and arrays are answered."""

import re
from collections.abc import Callable, Container, Iterator, Mapping, Sequence
from dataclasses import KW_ONLY, dataclass
from typing import Protocol, TypeVar

import numpy as np

from flexstage.arrays import Array
from flexstage.instruments.pi.simulated import errors_gcs as code
from flexstage.instruments.pi.simulated.errors_gcs import GcsError
from flexstage.instruments.pi.simulated.gcs_state import ControllerState

#: Lines of an answer; pieces of text that are made after the command, as they are sent; or nothing.
Reply = Sequence[str] | Iterator[str] | None


class Client(Protocol):
    """What a command needs of the session that gives it."""

    #: Number that ``ERR?`` answers next.
    error: int
    #: Command level, 0 or 1.
    level: int


#: Carries a command out, given state, session and words.
Run = Callable[[ControllerState, Client, Sequence[str]], Reply]


@dataclass(frozen=True, slots=True)
class GcsCommand:
    """A command."""

    name: str
    """Its word."""
    arguments: str
    """Its arguments, as it is listed."""
    text: str
    """What it does, as it is listed."""
    run: Run
    """Carries it out, given state, session and words."""
    _: KW_ONLY
    changes: bool = False
    """Whether it moves or changes something, and a client that holds control keeps it from others.
    """
    moves: bool = False
    """Whether it can start a motion; one that was given before a stop is not carried out after."""
    poll: bool = False
    """Whether a client repeats it while it waits for a motion, a waveform or a record."""


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


def nothing(words: Sequence[str]) -> None:
    """Refuse arguments."""
    if words:
        raise GcsError(code.NUMBER_OF_PARAMETERS)


def fact(value: Callable[[ControllerState], str]) -> Run:
    """Return a command without arguments that tells one thing."""

    def run(state: ControllerState, _: Client, words: Sequence[str]) -> Reply:
        nothing(words)
        return [value(state)]

    return run


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


#: Rows of a piece: small enough that a client that reads slowly holds little memory.
_ROWS = 1000


def array_text(
    columns: Sequence[Array], names: Sequence[str], sample_time: float, remark: str
) -> Iterator[str]:
    r"""Return an array in pieces of text, the last of which ends with a line feed and no space.

    Columns are of one length, 1 at least; `sample_time` is from row to row [s].

    Examples
    --------
    >>> text = "".join(array_text([np.array([0.25, 0.5])], ["x"], 1e-4, "twin"))
    >>> text.splitlines()[5], text[-17:]
    ('# SAMPLE_TIME = 0.000100000000 ', '\n5.000000000e-01\n')
    """
    size = len(columns[0])
    heading = [
        f"REM = {remark}",
        "VERSION = 1",
        "TYPE = 1",
        "SEPARATOR = 32",
        f"DIM = {len(columns)}",
        f"SAMPLE_TIME = {sample_time:.12f}",
        f"NDATA = {size}",
        *(f"NAME{j} = {name}" for j, name in enumerate(names)),
        "END_HEADER",
    ]
    yield "".join(f"# {line} \n" for line in heading)
    row = " ".join(["%.9e"] * len(columns))
    for first in range(0, size, _ROWS):
        rows = np.column_stack([column[first : first + _ROWS] for column in columns])
        last = first + _ROWS >= size
        pattern = f"{row} \n" * (len(rows) - last) + (f"{row}\n" if last else "")
        yield pattern % tuple(rows.ravel().tolist())
