"""Macros of a controller: lines that are kept under a name, and carried out by it."""

from collections.abc import Callable, Sequence

from flexstage.instruments.twin import errors_gcs as code
from flexstage.instruments.twin.command import Client, GcsCommand, Reply
from flexstage.instruments.twin.commands_identity import nothing
from flexstage.instruments.twin.errors_gcs import GcsError
from flexstage.instruments.twin.gcs_state import ControllerState

#: Most characters of all macros, and longest name.
_ROOM, _NAME = 1 << 16, 8
#: How deep macros may start each other.
_DEPTH = 5


class Macros:
    """Keeps macros, and carries them out line by line, at once."""

    def __init__(self, carry_out: Callable[[Client, str], object]) -> None:
        self._carry_out = carry_out
        self._kept: dict[str, list[str]] = {}
        self._depth = 0
        self._recording: tuple[Client, str, list[str]] | None = None

    def takes(self, client: Client, words: Sequence[str]) -> bool:
        """Keep a line that belongs to a macro which a client writes."""
        if self._recording is None or self._recording[0] is not client:
            return False
        if [word.upper() for word in words] == ["MAC", "END"]:
            return False
        line = " ".join(words)
        if self._size() + len(line) > _ROOM:
            client.error = code.NO_ROOM_FOR_MACRO
        else:
            self._recording[2].append(line)
        return True

    def leave(self, client: Client) -> None:
        """Forget what a client was writing."""
        if self._recording is not None and self._recording[0] is client:
            self._recording = None

    def commands(self) -> tuple[GcsCommand, ...]:
        """Return the commands of macros."""
        return (
            GcsCommand(
                name="MAC",
                arguments="<Keyword> [<MacroName> [<Value> ...]]",
                text="Call Macro Function: BEG, END, DEL, START",
                run=self._call,
                changes=True,
                moves=True,
            ),
            GcsCommand(name="MAC?", arguments="[<MacroName>]", text="List Macros", run=self._list),
            GcsCommand(name="RMC?", arguments="", text="List Running Macros", run=self._running),
        )

    def _size(self) -> int:
        writing = [] if self._recording is None else self._recording[2]
        return sum(len(line) + 1 for lines in (*self._kept.values(), writing) for line in lines)

    def _call(self, _: ControllerState, client: Client, words: Sequence[str]) -> Reply:
        if not words:
            raise GcsError(code.NUMBER_OF_PARAMETERS)
        keyword, names = words[0].upper(), words[1:]
        if keyword == "END":
            self._end(client, names)
            return None
        if keyword not in ("BEG", "DEL", "START"):
            raise GcsError(code.UNKNOWN_MACRO_FUNCTION)
        if not names or (keyword != "START" and len(names) > 1):
            raise GcsError(code.NUMBER_OF_PARAMETERS)
        name = names[0].upper()
        if keyword == "BEG":
            self._begin(client, name)
        elif name not in self._kept:
            raise GcsError(code.UNKNOWN_MACRO)
        elif keyword == "DEL":
            del self._kept[name]
        else:
            self._start(client, name, names[1:])
        return None

    def _begin(self, client: Client, name: str) -> None:
        if not (name.isalnum() and len(name) <= _NAME):
            raise GcsError(code.BAD_MACRO_NAME)
        if self._recording is not None or self._depth:
            raise GcsError(code.MACRO_IS_WRITTEN)
        self._recording = client, name, []

    def _end(self, client: Client, names: Sequence[str]) -> None:
        if names:
            raise GcsError(code.NUMBER_OF_PARAMETERS)
        if self._recording is None or self._recording[0] is not client:
            raise GcsError(code.NO_MACRO_IS_WRITTEN)
        self._kept[self._recording[1]] = self._recording[2]
        self._recording = None

    def _start(self, client: Client, name: str, values: Sequence[str]) -> None:
        if self._depth >= _DEPTH:
            raise GcsError(code.MACROS_TOO_DEEP)
        self._depth += 1
        try:
            for line in tuple(self._kept[name]):
                self._carry_out(client, _filled(line, values))
        finally:
            self._depth -= 1

    def _list(self, _: ControllerState, __: Client, words: Sequence[str]) -> Reply:
        if len(words) > 1:
            raise GcsError(code.NUMBER_OF_PARAMETERS)
        if words and words[0].upper() not in self._kept:
            raise GcsError(code.UNKNOWN_MACRO)
        return (self._kept[words[0].upper()] if words else sorted(self._kept)) or [""]

    def _running(self, _: ControllerState, __: Client, words: Sequence[str]) -> Reply:
        """Name none: a macro has ended before the next line is heard."""
        nothing(words)
        return [""]


def _filled(line: str, values: Sequence[str]) -> str:
    """Return a line with ``$1``, ``$2``, ... replaced by values."""
    for number in range(len(values), 0, -1):
        line = line.replace(f"${number}", values[number - 1])
    return line
