"""Commands of the command set: their arguments, and the form of their answers.

A command is a row of a table. Its arguments are written as ``HLP?`` lists them, and parsed by this
text: braces for repeated arguments, brackets for optional ones, and each argument by its name.
"""

import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import KW_ONLY, dataclass
from typing import Any, NamedTuple, Protocol

import numpy as np

from flexstage.base.arrays import Array
from flexstage.instruments.pi.simulated.device import Refusal, require
from flexstage.instruments.pi.simulated.gcs_state import ControllerState

#: Lines of an answer; pieces of text that are generated as they are sent; or nothing.
Reply = Sequence[str] | Iterator[str] | None
#: Function of a command, of the state and the parsed arguments.
Run = Callable[[ControllerState, Any], Reply]


class Client(Protocol):
    """The part of a session that commands use."""

    #: Next answer to ``ERR?``.
    error: int
    #: Command level, 0 or 1.
    level: int


_NUMBER = re.compile(r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d{1,4})?", re.ASCII)
_INTEGER = re.compile(r"[0-9]{1,10}")
_HEXADECIMAL = re.compile(r"0[xX][0-9a-fA-F]{1,8}")
#: Largest accepted number; sums and products of such numbers are finite.
LARGEST = 1e30


def number(word: str) -> float:
    """Return a number of at most 1e30; ``nan`` and ``inf`` are refused.

    Examples
    --------
    >>> number("-1.5e1")
    -15.0
    """
    # longer numbers are refused, since the time to parse them grows with the length
    require(len(word) <= 64 and _NUMBER.fullmatch(word), Refusal.BAD_NUMBER)
    value = float(word)
    require(abs(value) <= LARGEST, Refusal.BAD_NUMBER)
    return value


def unsigned(word: str) -> int:
    """Return an integer from 0."""
    require(_INTEGER.fullmatch(word), Refusal.BAD_NUMBER)
    return int(word)


def unsigned_or_hex(word: str) -> int:
    """Return an integer from 0 in decimal or hexadecimal digits.

    Examples
    --------
    >>> unsigned_or_hex("0x16000201"), unsigned_or_hex("369099265")
    (369099265, 369099265)
    """
    return int(word, 16) if _HEXADECIMAL.fullmatch(word) else unsigned(word)


def switch(word: str) -> bool:
    """Return the value of a switch, 0 or 1."""
    value = unsigned(word)
    require(value <= 1, Refusal.BAD_VALUE)
    return value == 1


def within(value: int, known: range, reason: Refusal = Refusal.BAD_VALUE) -> int:
    """Return a number; refuse it outside its range."""
    require(value in known, reason)
    return value


class Argument(NamedTuple):
    """An argument of a command."""

    read: Callable[[ControllerState, str], Any]
    """Parser of its value, of the state and a word."""
    all: Callable[[ControllerState], Iterable[Any]] = lambda _: ()
    """Default values."""
    names: bool = False
    """Whether it identifies the item of the following words; orders must not repeat it."""


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
    "WaveTableID": _integer(lambda s: range(s.device.tables.count + 1), Refusal.UNKNOWN_WAVE_TABLE),
    "PointNumber": _integer(lambda s: range(1, s.device.tables.capacity + 1), Refusal.BAD_VALUE),
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
    """Its name."""
    arguments: str
    """Its arguments, as they are listed and parsed."""
    text: str
    """Its description in the list."""
    run: Run
    """Its function, of the state and the arguments: None for no argument, a list for one repeated
    argument, a dict for the pairs of an order, else a list of tuples.
    """
    _: KW_ONLY
    changes: bool = False
    """Whether it moves or changes something, which a client with exclusive control reserves."""
    moves: bool = False
    """Whether it can start a motion; after a stop, an earlier one is not carried out."""
    poll: bool = False
    """Whether clients repeat it while they wait for a motion, a waveform or a record."""
    free: bool = False
    """Whether it parses its words itself, since they have no regular form."""

    def carry_out(self, state: ControllerState, words: Sequence[str]) -> Reply:
        """Parse the arguments, refuse wrong ones, and run the command."""
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
    """Return words in groups; refuse an incomplete group."""
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
    """Return a question, about named items or about the controller."""

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
    """Return an order, a command that changes something without an answer."""
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
    """Return a value as text of an answer."""
    if isinstance(value, float):
        return printed(value)
    return str(int(value) if isinstance(value, bool | np.bool_) else value)


#: Rows of a piece: small, so that slow clients occupy little memory.
_ROWS = 1000


def array_text(
    columns: Sequence[Array], names: Sequence[str], sample_time: float, remark: str
) -> Iterator[str]:
    r"""Return an array in pieces of text, the last of which ends with a line feed and no space.

    Columns have the same length, at least 1; `sample_time` is the interval between rows [s].

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
