"""A GCS controller as seen by its clients: carries out their lines, one at a time."""

from collections.abc import Callable, Mapping, Sequence

from flexstage.errors import ControllerError, FlexstageError
from flexstage.instruments.pi.simulated import errors_gcs as code
from flexstage.instruments.pi.simulated.clock import Pace
from flexstage.instruments.pi.simulated.command import Client, GcsCommand, Reply, nothing
from flexstage.instruments.pi.simulated.commands_identity import (
    IDENTITY,
    STATUS,
    delivered,
    help_lines,
    status_register,
)
from flexstage.instruments.pi.simulated.commands_motion import MOTION, halt, moving_bits
from flexstage.instruments.pi.simulated.commands_recorder import RECORDER
from flexstage.instruments.pi.simulated.commands_setup import SETUP, TRIGGERS
from flexstage.instruments.pi.simulated.commands_waves import WAVES, running_bits
from flexstage.instruments.pi.simulated.controller import VirtualController
from flexstage.instruments.pi.simulated.device import RefusedError
from flexstage.instruments.pi.simulated.errors_gcs import CODES, GcsError
from flexstage.instruments.pi.simulated.gcs_state import OWN, ControllerModel, ControllerState

#: Answer to ``#7``: always ready; a controller that is not says 0xB0.
_READY = "\xb1"
_COMMANDS = (*IDENTITY, *MOTION, *RECORDER, *SETUP, *STATUS, *TRIGGERS, *WAVES)
#: Commands that need an axis with a voltage.
_OF_VOLTAGES = frozenset(
    {"ATZ", "ATZ?", "DCO", "DCO?", "ONL", "ONL?", "SVA", "SVA?", "SVR", "VMA", "VMA?", "VMI",
     "VMI?", "VOL?"}
)  # fmt: skip


class Interpreter:
    """Carries out commands of GCS 2.0 on a simulated controller, for any number of clients.

    All of them may command, as at a real controller, and each has an error number of its own. With
    `hold` one client is in control: the first that gives a command that moves or changes something,
    until its session ends. From the others such commands are refused (error 1005, busy); they may
    read everything, and stop the motion. When the client in control leaves, the stage holds where
    it is (a motion or waveform that runs goes on to its end), and the next one may take control.

    Notes
    -----
    Validity: the commands that ``HLP?`` lists, with positions in um and voltages in V. Error
    numbers are those of the command set; which of them a controller of a given type and firmware
    gives where several fit is not documented by its maker, and may differ. Real controllers keep
    parameters over a reboot where they are told to; this one does not.
    """

    def __init__(
        self,
        device: VirtualController,
        pace: Pace,
        *,
        model: ControllerModel = OWN,
        hold: bool = False,
    ) -> None:
        self._state = ControllerState(device, pace, model)
        self._state.delivered = delivered(self._state)
        self._clients: list[Client] = []
        self._hold = hold
        #: Those that have given a command that moves or changes something, in their order.
        self._commanding: list[Client] = []
        help_command = GcsCommand("HLP?", "", "Get List Of Available Commands", self._help)
        self._macros = Macros(self.line)
        macros = self._macros.commands()
        commands = sorted((help_command, *macros, *_COMMANDS), key=lambda c: c.name)
        # a controller of motors does not know the commands of voltages
        unknown = model.lacks if self._state.outputs else model.lacks | _OF_VOLTAGES
        self._commands: Mapping[str, GcsCommand] = {
            command.name: command for command in commands if command.name not in unknown
        }

    @property
    def commands(self) -> Mapping[str, GcsCommand]:
        """The commands by name."""
        return self._commands

    @property
    def pace(self) -> Pace:
        """How time passes."""
        return self._state.pace

    @property
    def device(self) -> VirtualController:
        """The controller with its stage."""
        return self._state.device

    @property
    def in_control(self) -> Client | None:
        """The session that holds control."""
        return self._commanding[0] if self._hold and self._commanding else None

    def reached_at(self, host: str, port: int) -> None:
        """Take note of where clients reach the controller."""
        self._state.host, self._state.port = host, port

    def join(self, client: Client) -> None:
        """Welcome a client."""
        with self.pace.lock:
            self._clients.append(client)

    def leave(self, client: Client) -> None:
        """Let a client go; if it was in control, another one may be."""
        with self.pace.lock:
            self._clients = [other for other in self._clients if other is not client]
            self._macros.leave(client)
            self._commanding = [other for other in self._commanding if other is not client]

    def stop(self, client: Client) -> None:
        """Stop all axes at once, as ``#24`` does; whoever has given commands is told, too."""
        with self.pace.lock:
            self._attempt(client, lambda: halt(self._state, client))
            self._tell_others(client)

    def character(self, client: Client, byte: int) -> Reply:
        """Carry out a command of one character.

        4: status register; 5: which axes move; 7: ready; 9: which wave generators run.
        """
        if byte == 7:
            return [_READY]
        bits = {4: status_register, 5: moving_bits, 9: running_bits}[byte]
        with self.pace.lock:
            return self._attempt(client, lambda: [bits(self._state)], poll=True)

    def line(self, client: Client, text: str, *, stopped: bool = False) -> Reply:
        """Carry out a line, without its end.

        Where it was given before motion was `stopped`, it starts none. The answer is lines; or
        pieces of its text, to be made one after the other without a lock; or nothing.
        """
        words = text.split(" ")
        if "" in words:
            words = [word for word in words if word]
        if not words:
            return None
        if self._macros.takes(client, words):
            return None
        command = self._commands.get(words[0].upper())
        if command is None:
            client.error = code.UNKNOWN_COMMAND
            return None
        with self.pace.lock:
            return self._attempt(
                client,
                lambda: self._run(client, command, words[1:], stopped),
                poll=command.poll,
                record=command.name != "ERR?",
            )

    def _run(
        self, client: Client, command: GcsCommand, words: Sequence[str], stopped: bool
    ) -> Reply:
        if stopped and command.moves:
            raise GcsError(code.STOPPED)
        if command.changes:
            if self.in_control not in (None, client):
                raise GcsError(code.BUSY)
            if client not in self._commanding:
                self._commanding.append(client)
        stops = self._state.stops
        try:
            return command.run(self._state, client, words)
        finally:
            if self._state.stops > stops:
                self._tell_others(client)

    def _attempt(
        self,
        client: Client,
        action: Callable[[], Reply],
        *,
        poll: bool = False,
        record: bool = False,
    ) -> Reply:
        """Bring the device to now and do something, with errors turned into numbers."""
        try:
            self.pace.before_command(poll)
            if record and self._state.recorder.trigger == 2:
                self._state.recorder.trigger = 0
                self._state.recorder.now()
            return action()
        except GcsError as error:
            client.error = error.code
        except RefusedError as error:
            client.error = CODES[error.reason]
        except ControllerError:
            client.error = code.HARDWARE
        except FlexstageError:
            client.error = code.OUT_OF_RANGE
        return None

    def _tell_others(self, client: Client) -> None:
        for other in self._commanding:
            if other is not client:
                other.error = code.STOPPED

    def _help(self, _: ControllerState, __: Client, words: Sequence[str]) -> Reply:
        nothing(words)
        return help_lines(self._commands.values())


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
                "MAC",
                "<Keyword> [<MacroName> [<Value> ...]]",
                "Call Macro Function: BEG, END, DEL, START",
                self._call,
                changes=True,
                moves=True,
            ),
            GcsCommand("MAC?", "[<MacroName>]", "List Macros", self._list),
            GcsCommand("RMC?", "", "List Running Macros", self._running),
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
