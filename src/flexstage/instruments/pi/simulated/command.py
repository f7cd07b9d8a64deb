"""Words of the command set: what one takes, how that is read, and how it is answered.

A word is a row of a table. What it takes is written as ``HLP?`` lists it, and read by that text: in
braces what may be repeated, in brackets what may be left out, and each argument by its name.
"""

import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import KW_ONLY, dataclass
from typing import Any, NamedTuple, Protocol

import numpy as np

from flexstage.base.arrays import Array
from flexstage.instruments.pi.simulated.device import Refusal, require
from flexstage.instruments.pi.simulated.gcs_state import ControllerState

#: Lines of an answer; pieces of text that are made after the command, as they are sent; or nothing.
Reply = Sequence[str] | Iterator[str] | None
#: Carries a command out, given the state and what was read of its arguments.
Run = Callable[[ControllerState, Any], Reply]


class Client(Protocol):
    """What a command needs of the session that gives it."""

    #: Number that ``ERR?`` answers next.
    error: int
    #: Command level, 0 or 1.
    level: int


_NUMBER = re.compile(r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d{1,4})?", re.ASCII)
_INTEGER = re.compile(r"[0-9]{1,10}")
_HEXADECIMAL = re.compile(r"0[xX][0-9a-fA-F]{1,8}")
#: Nothing on a stage has a larger number, and sums and products of such are still finite.
LARGEST = 1e30


def number(word: str) -> float:
    """Return a number of 1e30 at most; what stands for none, ``nan`` and ``inf`` are refused.

    Examples
    --------
    >>> number("-1.5e1")
    -15.0
    """
    # no number of a client has more digits, and the time to read one grows with them
    require(len(word) <= 64 and _NUMBER.fullmatch(word), Refusal.BAD_NUMBER)
    value = float(word)
    require(abs(value) <= LARGEST, Refusal.BAD_NUMBER)
    return value


def unsigned(word: str) -> int:
    """Return a whole number from 0."""
    require(_INTEGER.fullmatch(word), Refusal.BAD_NUMBER)
    return int(word)


def unsigned_or_hex(word: str) -> int:
    """Return a whole number from 0 in decimal or hexadecimal digits.

    Examples
    --------
    >>> unsigned_or_hex("0x16000201"), unsigned_or_hex("369099265")
    (369099265, 369099265)
    """
    return int(word, 16) if _HEXADECIMAL.fullmatch(word) else unsigned(word)


def switch(word: str) -> bool:
    """Return what 0 or 1 says."""
    value = unsigned(word)
    require(value <= 1, Refusal.BAD_VALUE)
    return value == 1


def within(value: int, known: range, reason: Refusal = Refusal.BAD_VALUE) -> int:
    """Return a number; refuse one that there is not."""
    require(value in known, reason)
    return value


class Argument(NamedTuple):
    """What stands for an argument in a line."""

    read: Callable[[ControllerState, str], Any]
    """Returns its value, from the state and a word."""
    all: Callable[[ControllerState], Iterable[Any]] = lambda _: ()
    """What is meant where none is named."""
    names: bool = False
    """Whether it names what the words behind it are for: no order names one twice."""


def _named(all_: Callable[[ControllerState], Mapping[str, Any]], unknown: Refusal) -> Argument:
    def read(state: ControllerState, word: str) -> str:
        require(word in all_(state), unknown)
        return word

    return Argument(read, all_, names=True)


def _lowest_voltage(_: ControllerState, word: str) -> float | None:
    return None if word.upper() == "NAN" else number(word)


def _number_as_said(_: ControllerState, word: str) -> str:
    number(word)
    return word


def _integer(known: Callable[[ControllerState], range], reason: Refusal) -> Argument:
    return Argument(lambda state, word: within(unsigned(word), known(state), reason), known)


_CHANNELS = _named(lambda s: s.channels, Refusal.UNKNOWN_CHANNEL)
_AS_SAID = Argument(lambda _, word: word)
_SWITCH = Argument(lambda _, word: switch(word))
_UNSIGNED = Argument(lambda _, word: unsigned(word))
#: Digital outputs, and settings of one: width, axis, kind, lowest and highest position, polarity,
#: offset and others.
_LINES, _SETTINGS = range(1, 4), range(1, 12)
#: Arguments by their names; all others are numbers.
_ARGUMENTS = {
    "AxisID": _named(lambda s: s.axes, Refusal.UNKNOWN),
    "OutputID": _named(lambda s: s.outputs, Refusal.UNKNOWN_CHANNEL),
    "WaveGenID": _named(lambda s: s.generators, Refusal.UNKNOWN),
    "InputID": _CHANNELS._replace(all=lambda s: list(s.channels)[: s.model.inputs]),
    "InterfacePam": _named(lambda s: s.interface, Refusal.UNKNOWN_PARAMETER),
    "RecTableID": _integer(lambda s: range(1, s.recorder.tables + 1), Refusal.UNKNOWN_RECORD_TABLE),
    # 0 is none
    "WaveTableID": _integer(lambda s: range(s.device.wave_tables + 1), Refusal.UNKNOWN_WAVE_TABLE),
    "PointNumber": _integer(lambda s: range(1, s.device.wave_capacity + 1), Refusal.BAD_VALUE),
    "RecTableRate": _integer(lambda _: range(1, 10**10), Refusal.BAD_VALUE),
    "RegisterID": _integer(lambda _: range(1, 2), Refusal.BAD_VALUE),
    "TrigOutID": _integer(lambda _: _LINES, Refusal.BAD_VALUE),
    "CTOPam": _integer(lambda _: _SETTINGS, Refusal.BAD_VALUE),
    "Value": Argument(_number_as_said),
    "LowValue": Argument(_lowest_voltage),
    "StartMode": Argument(lambda _, word: unsigned_or_hex(word)),
    **dict.fromkeys(("State", "ServoState", "Switch"), _SWITCH),
    **dict.fromkeys(("Cycles", "RecOption"), _UNSIGNED),
    **dict.fromkeys(("ItemID", "PamID", "PamValue", "Source"), _AS_SAID),
}
_PLAIN = Argument(lambda _, word: number(word))


@dataclass(frozen=True, slots=True)
class GcsCommand:
    """A command."""

    name: str
    """Its word."""
    arguments: str
    """Its arguments, as it is listed and read."""
    text: str
    """What it does, as it is listed."""
    run: Run
    """Carries it out, given the state and what it takes: nothing for no argument, a list of one
    argument that may be repeated, a dict of pairs of an order, else a list of tuples.
    """
    _: KW_ONLY
    changes: bool = False
    """Whether it moves or changes something, and a client that holds control keeps it from others.
    """
    moves: bool = False
    """Whether it can start a motion; one that was given before a stop is not carried out after."""
    poll: bool = False
    """Whether a client repeats it while it waits for a motion, a waveform or a record."""
    free: bool = False
    """Whether it reads its words itself, since they are of no regular form."""

    def carry_out(self, state: ControllerState, words: Sequence[str]) -> Reply:
        """Read the words behind the name, refuse wrong ones, and do what they say."""
        return self.run(state, words if self.free else self._read(state, words))

    def _read(self, state: ControllerState, words: Sequence[str]) -> Any:
        names = re.findall(r"<(\w+)>", self.arguments)
        if not names:
            require(not words, Refusal.NUMBER_OF_PARAMETERS)
            return None
        arguments = [_ARGUMENTS.get(name, _PLAIN) for name in names]
        optional, repeated = self.arguments.startswith("["), "{" in self.arguments
        rows = groups(words, len(names), optional=optional)
        require(repeated or len(rows) == 1, Refusal.NUMBER_OF_PARAMETERS)
        if len(arguments) == 1:
            read = [arguments[0].read(state, word) for word in words]
            return read or list(arguments[0].all(state))
        if not arguments[0].names or self.name.endswith("?"):
            return [
                tuple(a.read(state, word) for a, word in zip(arguments, row, strict=True))
                for row in rows
            ]
        first, second = arguments
        named = [first.read(state, name) for name, _ in rows]
        require(len(set(named)) == len(named), Refusal.AXIS_TWICE)
        return {name: second.read(state, word) for name, word in rows}


def groups(words: Sequence[str], size: int, *, optional: bool = False) -> list[Sequence[str]]:
    """Return words in groups; refuse a number of them that makes none."""
    require((words or optional) and not len(words) % size, Refusal.NUMBER_OF_PARAMETERS)
    return [words[i : i + size] for i in range(0, len(words), size)]


def question(
    name: str,
    arguments: str,
    text: str,
    value: Callable[[ControllerState, Any], Any],
    *,
    poll: bool = False,
) -> GcsCommand:
    """Return a command that tells something: of all that is named, or of the controller."""

    def run(state: ControllerState, named: Any) -> Reply:
        if named is None:
            return [value_text(value(state, None))]
        return [f"{item}={value_text(value(state, item))}" for item in named]

    return GcsCommand(name, arguments, text, run, poll=poll)


def order(
    name: str,
    arguments: str,
    text: str,
    run: Callable[[ControllerState, Any], None],
    *,
    moves: bool = False,
) -> GcsCommand:
    """Return a command that changes something, and answers nothing."""
    return GcsCommand(name, arguments, text, run, changes=True, moves=moves)


def printed(value: float) -> str:
    """Return a number as a controller prints it.

    Examples
    --------
    >>> printed(12.5)
    '1.250000000e+01'
    """
    return f"{value:.9e}"


def value_text(value: float | int | str) -> str:
    """Return a value as it is sent."""
    if isinstance(value, float):
        return printed(value)
    return str(int(value) if isinstance(value, bool | np.bool_) else value)


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
