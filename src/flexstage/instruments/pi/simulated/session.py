"""A conversation of one client with the controller: bytes in, bytes out."""

import re
import threading
from collections import deque
from collections.abc import Iterator
from typing import Final

from flexstage.errors import NotConnectedError
from flexstage.instruments.pi.simulated import errors_gcs as code
from flexstage.instruments.pi.simulated.command import Reply
from flexstage.instruments.pi.simulated.interpreter import Interpreter

#: Longest line [bytes]; of a longer one nothing is carried out.
LONGEST_LINE: Final = 65536
_STOP, _NEWLINE = 24, 10
#: Characters that are commands wherever they stand, and the end of a line.
_SPECIAL = re.compile(rb"[\x04\x05\x07\x09\n]")
#: Characters below 32; those that are no commands are dropped where no line has begun.
_CONTROL = bytes(range(32))
_PRINTABLE = bytes(range(32, 127))


class ServerSession:
    r"""A client.

    Lines end with LF, or CR and LF. The characters 4, 5, 7, 9 and 24 are commands by themselves,
    wherever they stand; other control characters before a line are dropped, within it they spoil
    it. Character 24 stops all axes before anything else that came with it: what
    was given earlier and not yet carried out starts no motion any more (error 10), and a line that
    was begun is dropped.

    Examples
    --------
    A conversation without sockets: ``session.feed(b"SVO? 1\n")`` returns ``b"1=0\n"``.
    """

    def __init__(self, interpreter: Interpreter) -> None:
        self._interpreter = interpreter
        self._part = bytearray()
        self._dropping = False
        #: What was given and is still to be carried out: a line or a character, oldest first.
        self._waiting: deque[bytes | int] = deque()
        self._backlog = 0
        self._stopped = 0
        self._pieces: Iterator[str] | None = None
        self.error = code.NO_ERROR
        self.level = 0
        interpreter.join(self)

    @property
    def busy(self) -> bool:
        """Whether something is to be carried out, or to be sent."""
        return bool(self._waiting) or self._pieces is not None

    @property
    def backlog(self) -> int:
        """Measure of what is to be carried out [bytes]; each line and character counts 64 more."""
        return self._backlog + 64 * len(self._waiting)

    def feed(self, data: bytes) -> bytes:
        """Take bytes, and return all that is to be said to them."""
        self.push(data)
        answer = bytearray()
        while self.busy:
            answer += self.pull()
        return bytes(answer)

    def stop(self) -> None:
        """Stop all axes; what was given and not yet carried out starts no motion any more.

        Any thread may call this, whatever others do with the session.
        """
        self._stopped = len(self._waiting)
        self._interpreter.stop(self)

    def push(self, data: bytes) -> None:
        """Take bytes; a character 24 among them acts at once."""
        at = data.rfind(_STOP)
        if at >= 0:
            self.stop()
            for piece in data[:at].split(b"\x18"):
                self._take(piece)
                self._part.clear()
                self._dropping = False
            self._stopped = len(self._waiting)
        self._take(data[at + 1 :])

    def pull(self, commands: int = 1000, size: int = 1 << 16) -> bytes:
        """Carry out some of what was given, and return what is to be sent.

        At most so many commands, and no further one where `size` bytes are to be sent already.
        """
        answer = bytearray()
        for _ in range(commands):
            if self._pieces is not None:
                piece = next(self._pieces, None)
                if piece is None:
                    self._pieces = None
                else:
                    answer += piece.encode("latin-1")
            elif self._waiting:
                answer += self._next()
            else:
                break
            if len(answer) >= size:
                break
        return bytes(answer)

    def close(self) -> None:
        """End the conversation; nothing moves by it, and another client may take control."""
        self._waiting.clear()
        self._backlog = 0
        self._pieces = None
        self._interpreter.leave(self)

    def _take(self, data: bytes) -> None:
        """Cut bytes into lines and characters."""
        first = 0
        for found in _SPECIAL.finditer(data):
            self._keep(data[first : found.start()])
            first = found.end()
            byte = data[found.start()]
            if byte == _NEWLINE:
                self._end_line()
            else:
                self._waiting.append(byte)
        self._keep(data[first:])

    def _keep(self, data: bytes) -> None:
        if not self._part:
            data = data.lstrip(_CONTROL)
        if self._dropping or not data:
            return
        self._part += data
        if len(self._part) > LONGEST_LINE:
            self._part.clear()
            self._dropping = True

    def _end_line(self) -> None:
        if self._dropping:
            self._waiting.append(-1)
        else:
            line = bytes(self._part[:-1] if self._part.endswith(b"\r") else self._part)
            if line:
                self._waiting.append(line)
                self._backlog += len(line)
        self._part.clear()
        self._dropping = False

    def _next(self) -> bytes:
        given = self._waiting.popleft()
        stopped = self._stopped > 0
        self._stopped -= stopped
        if isinstance(given, int):
            if given < 0:
                self.error = code.TOO_LONG
                return b""
            return self._answer(self._interpreter.character(self, given))
        self._backlog -= len(given)
        if given.translate(None, _PRINTABLE):
            self.error = code.SYNTAX
            return b""
        return self._answer(self._interpreter.line(self, given.decode("ascii"), stopped=stopped))

    def _answer(self, reply: Reply) -> bytes:
        if reply is None:
            return b""
        if isinstance(reply, Iterator):
            self._pieces = reply
            return b""
        return (" \n".join(reply) + "\n").encode("latin-1")


class Loopback:
    """Takes what a client sends, and has the answer ready at once.

    Any thread may send; a stop (character 24) does not wait for what another thread does. With
    `ends_time` the clock of the controller ends with the conversation.
    """

    def __init__(self, interpreter: Interpreter, *, ends_time: bool = False) -> None:
        self._interpreter, self._ends_time = interpreter, ends_time
        self._session = ServerSession(interpreter)
        self._answers = bytearray()
        self._lock = threading.Lock()
        self._closed = False

    @property
    def name(self) -> str:
        """Where it leads."""
        return self._interpreter.device.identity.model

    def send(self, data: bytes) -> None:
        """Send bytes; they are carried out before this returns."""
        self._open()
        if _STOP in data:
            self._session.stop()
        with self._lock:
            self._answers += self._session.feed(data)

    def receive(self, timeout: float = 0.0) -> bytes:
        """Return what the controller has said; nothing is waited for, since it is said already."""
        self._open()
        with self._lock:
            said, self._answers = bytes(self._answers), bytearray()
        return said

    def another(self) -> "Loopback":
        """Open a second conversation with the same controller."""
        return Loopback(self._interpreter)

    def close(self) -> None:
        """End the conversation; calling it again changes nothing."""
        if not self._closed:
            self._closed = True
            self._session.close()
            if self._ends_time:
                self._interpreter.pace.close()

    def _open(self) -> None:
        if self._closed:
            raise NotConnectedError("the conversation with the simulated controller was closed")
