"""Interpreter of the commands of the clients of a simulated GCS controller."""

from collections.abc import Callable, Mapping, Sequence

from flexstage.base.errors import ControllerError, FlexstageError
from flexstage.instruments.pi.simulated.clock import Pace
from flexstage.instruments.pi.simulated.command import (
    Client,
    GcsCommand,
    Reply,
    question,
    unsigned,
    within,
)
from flexstage.instruments.pi.simulated.commands_identity import (
    IDENTITY,
    delivered,
    status_register,
)
from flexstage.instruments.pi.simulated.commands_motion import MOTION, halt, moving_bits
from flexstage.instruments.pi.simulated.commands_tables import RECORDER, WAVES, running_bits
from flexstage.instruments.pi.simulated.controller import VirtualController
from flexstage.instruments.pi.simulated.device import Refusal, RefusedError, require
from flexstage.instruments.pi.simulated.gcs_state import GENERIC, ControllerModel, ControllerState

#: Answer to ``#7``: always ready; 0xB0 would mean not ready.
_READY = "\xb1"
#: Single-character commands, as they are listed.
_CHARACTERS = (
    "#4 Request Status Register",
    "#5 Request Motion Status",
    "#7 Request Controller Ready Status",
    "#9 Get Wave Generator Status",
    "#24 Stop All Axes",
)
#: Commands that need an axis with a voltage.
_OF_VOLTAGES = frozenset(
    {"ATZ", "ATZ?", "DCO", "DCO?", "ONL", "ONL?", "SVA", "SVA?", "VMA", "VMA?", "VMI", "VMI?",
     "VOL?"}
)  # fmt: skip


class Interpreter:
    """Interpreter of GCS 2.0 for a simulated controller, with any number of clients.

    All clients may send commands, as with a real controller, and each has its own error number.
    When a client disconnects, a running motion or waveform continues to its end.

    Notes
    -----
    Validity: the commands that ``HLP?`` lists, with positions in um and voltages in V. Error
    numbers are those of the command set. The manufacturer does not document which number a real
    controller reports where several apply. Real controllers can store parameters permanently; this
    one does not.
    """

    def __init__(
        self,
        device: VirtualController,
        pace: Pace,
        *,
        model: ControllerModel = GENERIC,
    ) -> None:
        #: The controller with its stage, and its pace of time.
        self.device, self.pace = device, pace
        self._state = ControllerState(device, pace, model)
        self._state.delivered = delivered(self._state)
        self._clients: list[Client] = []
        #: Clients that have sent a command which moves or changes something, in their order.
        self._commanding: list[Client] = []
        #: Client of the present command; the lock is held.
        self._client: Client
        self._macros = Macros(self.line)
        commands = (*self._of_sessions(), *IDENTITY, *MOTION, *RECORDER, *WAVES)
        # a controller of motors has no commands of voltages
        unknown = model.lacks if self._state.outputs else model.lacks | _OF_VOLTAGES
        #: The commands by name.
        self.commands: Mapping[str, GcsCommand] = {
            command.name: command
            for command in sorted(commands, key=lambda c: c.name)
            if command.name not in unknown
        }

    def reached_at(self, host: str, port: int) -> None:
        """Set the address of the controller."""
        self._state.host, self._state.port = host, port

    def join(self, client: Client) -> None:
        """Add a client."""
        with self.pace.lock:
            self._clients.append(client)

    def leave(self, client: Client) -> None:
        """Remove a client."""
        with self.pace.lock:
            self._clients = [other for other in self._clients if other is not client]
            self._macros.leave(client)
            self._commanding = [other for other in self._commanding if other is not client]

    def stop(self, client: Client) -> None:
        """Stop all axes immediately, as ``#24`` does; other commanding clients get an error."""
        with self.pace.lock:
            self._attempt(client, lambda: halt(self._state))
            self._tell_others(client)

    def character(self, client: Client, byte: int) -> Reply:
        """Carry out a single-character command.

        4: status register; 5: which axes move; 7: ready; 9: which wave generators run.
        """
        if byte == 7:
            return [_READY]
        bits = {4: status_register, 5: moving_bits, 9: running_bits}[byte]
        with self.pace.lock:
            return self._attempt(client, lambda: [bits(self._state)], poll=True)

    def line(self, client: Client, text: str, *, stopped: bool = False) -> Reply:
        """Carry out a line, without its end.

        A line that was sent before motion was `stopped` starts no motion. The answer is lines, or
        pieces of text that are generated without a lock, or nothing.
        """
        words = text.split(" ")
        if "" in words:
            words = [word for word in words if word]
        if not words:
            return None
        if self._macros.takes(client, words):
            return None
        command = self.commands.get(words[0].upper())
        if command is None:
            client.error = Refusal.UNKNOWN_COMMAND
            return None
        with self.pace.lock:
            return self._attempt(
                client,
                lambda: self._run(client, command, words[1:], stopped),
                poll=command.poll,
                error=command.name == "ERR?",
            )

    def _run(
        self, client: Client, command: GcsCommand, words: Sequence[str], stopped: bool
    ) -> Reply:
        require(not (stopped and command.moves), Refusal.STOPPED)
        if command.changes and client not in self._commanding:
            self._commanding.append(client)
        stops = self._state.stops
        self._client = client
        try:
            return command.carry_out(self._state, words)
        finally:
            if self._state.stops > stops:
                self._tell_others(client)

    def _attempt(
        self,
        client: Client,
        action: Callable[[], Reply],
        *,
        poll: bool = False,
        error: bool | None = None,
    ) -> Reply:
        """Advance the device to the present time and act, with errors as numbers.

        For a line, `error` is whether it asks for the error.
        """
        try:
            if error:
                self.pace.before_error()
            else:
                self.pace.before_command(poll)
            if error is False and self._state.recorder.trigger == 2:
                self._state.recorder.trigger = 0
                self._state.recorder.now()
            return action()
        except RefusedError as refused:
            client.error = refused.reason
        except ControllerError:
            client.error = Refusal.HARDWARE
        except FlexstageError:
            client.error = Refusal.BAD_VALUE
        return None

    def _tell_others(self, client: Client) -> None:
        for other in self._commanding:
            if other is not client:
                other.error = Refusal.STOPPED

    def _of_sessions(self) -> tuple[GcsCommand, ...]:
        """Return the commands that use the session of the client, or the list of all commands."""
        return (
            GcsCommand("CCL", "<Level> [<PSWD>]", "Set Command Level", self._set_level, free=True),
            question("CCL?", "", "Get Command Level", lambda *_: self._client.level),
            question("ERR?", "", "Get Error Number", self._read_error),
            GcsCommand("HLP?", "", "Get List Of Available Commands", self._help),
            GcsCommand(
                "MAC",
                "<Keyword> [<MacroName> [<Value> ...]]",
                "Call Macro Function: BEG, END, DEL, START",
                lambda _, words: self._macros.call(self._client, words),
                changes=True,
                moves=True,
                free=True,
            ),
        )

    def _read_error(self, _: ControllerState, __: None) -> int:
        number_of_error, self._client.error = self._client.error, 0
        return number_of_error

    def _set_level(self, _: ControllerState, words: Sequence[str]) -> Reply:
        require(len(words) in (1, 2), Refusal.NUMBER_OF_PARAMETERS)
        level = within(unsigned(words[0]), range(2))
        require(level == 0 or words[1:] == ["advanced"], Refusal.WRONG_PASSWORD)
        self._client.level = level
        return None

    def _help(self, _: ControllerState, __: None) -> Reply:
        commands = self.commands.values()
        listed = [f"{c.name} {c.arguments} {c.text}".replace("  ", " ") for c in commands]
        return ["The following commands are valid:", *_CHARACTERS, *listed, "end of help"]


#: Largest number of characters of all macros, and of a name.
_ROOM, _NAME = 1 << 16, 8
#: Largest nesting depth of macros.
_DEPTH = 5


class Macros:
    """Memory of macros, which are carried out line by line, immediately."""

    def __init__(self, carry_out: Callable[[Client, str], object]) -> None:
        self._carry_out = carry_out
        self._macros: dict[str, list[str]] = {}
        self._depth = 0
        self._recording: tuple[Client, str, list[str]] | None = None

    def takes(self, client: Client, words: Sequence[str]) -> bool:
        """Store a line of a macro that a client is writing; return whether it is one."""
        if self._recording is None or self._recording[0] is not client:
            return False
        if [word.upper() for word in words] == ["MAC", "END"]:
            return False
        line = " ".join(words)
        if self._size() + len(line) > _ROOM:
            client.error = Refusal.NO_ROOM_FOR_MACRO
        else:
            self._recording[2].append(line)
        return True

    def leave(self, client: Client) -> None:
        """Discard the macro that a client was writing."""
        if self._recording is not None and self._recording[0] is client:
            self._recording = None

    def _size(self) -> int:
        writing = [] if self._recording is None else self._recording[2]
        return sum(len(line) + 1 for lines in (*self._macros.values(), writing) for line in lines)

    def call(self, client: Client, words: Sequence[str]) -> Reply:
        """Begin, end, delete or start a macro."""
        require(words, Refusal.NUMBER_OF_PARAMETERS)
        keyword, names = words[0].upper(), words[1:]
        require(keyword in ("BEG", "DEL", "END", "START"), Refusal.UNKNOWN_MACRO_FUNCTION)
        if keyword == "END":
            require(not names, Refusal.NUMBER_OF_PARAMETERS)
            self._end(client)
            return None
        several = keyword == "START"
        require(len(names) == 1 or (several and names), Refusal.NUMBER_OF_PARAMETERS)
        name = names[0].upper()
        if keyword == "BEG":
            require(name.isalnum() and len(name) <= _NAME, Refusal.BAD_MACRO_NAME)
            free = self._recording is None and not self._depth
            require(free, Refusal.MACRO_IS_WRITTEN)
            self._recording = client, name, []
            return None
        require(name in self._macros, Refusal.UNKNOWN_MACRO)
        if several:
            self._start(client, name, names[1:])
        else:
            del self._macros[name]
        return None

    def _end(self, client: Client) -> None:
        if self._recording is None or self._recording[0] is not client:
            raise RefusedError(Refusal.NO_MACRO_IS_WRITTEN)
        self._macros[self._recording[1]] = self._recording[2]
        self._recording = None

    def _start(self, client: Client, name: str, values: Sequence[str]) -> None:
        require(self._depth < _DEPTH, Refusal.MACROS_TOO_DEEP)
        self._depth += 1
        try:
            for line in tuple(self._macros[name]):
                self._carry_out(client, _filled(line, values))
        finally:
            self._depth -= 1


def _filled(line: str, values: Sequence[str]) -> str:
    """Return a line with ``$1``, ``$2``, ... replaced by values."""
    for number in range(len(values), 0, -1):
        line = line.replace(f"${number}", values[number - 1])
    return line
