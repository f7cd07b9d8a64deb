"""A GCS controller for its clients: bytes in, bytes out; behind a TCP port, any number of them."""

import logging
import os
import re
import selectors
import socket
import threading
import time
from collections import deque
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import Final

from flexstage.instruments.pi.simulated.command import Reply
from flexstage.instruments.pi.simulated.device import Refusal
from flexstage.instruments.pi.simulated.interpreter import Interpreter

_log = logging.getLogger(__name__)

#: Longest line [bytes]; of a longer one nothing is carried out.
LONGEST_LINE: Final = 65536
STOP: Final = 24
_NEWLINE = 10
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
        self.error = 0
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
        at = data.rfind(STOP)
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
        for special in _SPECIAL.finditer(data):
            self._keep(data[first : special.start()])
            first = special.end()
            byte = data[special.start()]
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
        order = self._waiting.popleft()
        stopped = self._stopped > 0
        self._stopped -= stopped
        if isinstance(order, int):
            if order < 0:
                self.error = Refusal.TOO_LONG
                return b""
            return self._answer(self._interpreter.character(self, order))
        self._backlog -= len(order)
        if order.translate(None, _PRINTABLE):
            self.error = Refusal.SYNTAX
            return b""
        return self._answer(self._interpreter.line(self, order.decode("ascii"), stopped=stopped))

    def _answer(self, reply: Reply) -> bytes:
        if reply is None:
            return b""
        if isinstance(reply, Iterator):
            self._pieces = reply
            return b""
        return (" \n".join(reply) + "\n").encode("latin-1")


_READ: Final = 1 << 16
#: Commands of a client that are carried out before it is the turn of the next.
_TURN: Final = 8
#: Clients that may wait to be taken on.
_WAITING: Final = 128
#: Answers that are made before a client has read the last ones, and orders that are taken [bytes].
_ANSWERS, _ORDERS = 1 << 18, 1 << 20
#: A client that is gone raises, and does not end the process by SIGPIPE, also where a library has
#: given that signal back its default.
_QUIETLY = getattr(socket, "MSG_NOSIGNAL", 0)
#: What goes wrong in a simulation that is not foreseen: the client is sent away, the others stay.
_UNFORESEEN = (ArithmeticError, AttributeError, LookupError, RuntimeError, TypeError, ValueError)


@dataclass(slots=True, kw_only=True, eq=False)
class _Connection:
    socket: socket.socket
    session: ServerSession
    answers: bytearray = field(default_factory=bytearray)
    #: When the client last took something, or had nothing to take.
    moved_on: float
    ended: bool = False


def reserve(host: str, port: int) -> socket.socket:
    """Take a port, any free one for 0, and answer nobody there until a server listens at it."""
    host.encode("idna")
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    listener = socket.socket(family, socket.SOCK_STREAM)
    try:
        if os.name == "posix":  # elsewhere it would let two servers share a port
            listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        if family == socket.AF_INET6:  # an address of one kind is not one of the other
            listener.setsockopt(socket.IPPROTO_IPV6, socket.IPV6_V6ONLY, 1)
        listener.bind((host, port))
    except BaseException:
        listener.close()
        raise
    return listener


class GcsServer:
    """Listens for clients of a GCS controller.

    Whoever reaches the host can move the stage; the default is reached from this computer only. A
    port of 0 is any that is free; a listener, a socket of `reserve`, stands for both and is closed
    by the server. A client too many is sent away, and so is one that does not take its answers for
    `patience` [s].

    Notes
    -----
    When a client leaves, or is sent away, nothing stops: an axis comes to its target and holds it,
    a waveform runs to its end (an endless one until somebody stops it), as with a real controller.
    A client that sends faster than it is answered is not read from until it has caught up.
    """

    def __init__(
        self,
        interpreter: Interpreter,
        host: str = "127.0.0.1",
        port: int = 0,
        *,
        listener: socket.socket | None = None,
        clients: int = 200,
        patience: float = 10.0,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._interpreter = interpreter
        self._clients, self._patience, self._clock = clients, patience, clock
        self._listener = reserve(host, port) if listener is None else listener
        self._listener.setblocking(False)
        self._wake, self._waker = socket.socketpair()
        self._selector = selectors.DefaultSelector()
        self._selector.register(self._listener, selectors.EVENT_READ, "listen")
        self._selector.register(self._wake, selectors.EVENT_READ, "wake")
        self._connections: dict[int, _Connection] = {}
        self._closing = threading.Event()
        self._thread: threading.Thread | None = None
        interpreter.reached_at(*self.address)
        self._deaf_until: float | None = None

    @property
    def address(self) -> tuple[str, int]:
        """Address and port at which it listens."""
        name = self._listener.getsockname()
        return str(name[0]), int(name[1])

    @property
    def connected(self) -> int:
        """Number of clients."""
        return len(self._connections)

    def start(self) -> None:
        """Listen, in a thread; and let simulated time pass."""
        if self._thread is None:
            self._listener.listen(_WAITING)
            self._interpreter.pace.start()
            self._thread = threading.Thread(target=self._serve, name="gcs-server", daemon=True)
            self._thread.start()

    def close(self) -> None:
        """Send all clients away and end; calling it again changes nothing."""
        if self._closing.is_set():
            return
        self._closing.set()
        if self._thread is not None:
            self._waker.send(b"\0")
            self._thread.join()
        for connection in list(self._connections.values()):
            self._drop(connection)
        self._selector.close()
        for end in (self._listener, self._wake, self._waker):
            end.close()
        self._interpreter.pace.close()

    def _serve(self) -> None:
        while not self._closing.is_set():
            for key, events in self._selector.select(self._wait()):
                if key.data == "listen":
                    self._accept()
                elif key.data != "wake":
                    self._exchange(key.data, events)
            now = self._clock()
            if self._deaf_until is not None and now >= self._deaf_until:
                self._deaf_until = None
                self._selector.register(self._listener, selectors.EVENT_READ, "listen")
            for connection in list(self._connections.values()):
                self._work(connection, now)

    def _wait(self) -> float | None:
        """Return how long to sleep: not at all where commands wait whose answers have room."""
        connections = self._connections.values()
        if any(c.session.busy and len(c.answers) < _ANSWERS for c in connections):
            return 0.0
        waiting = any(c.answers for c in connections) or self._deaf_until is not None
        return min(1.0, 0.25 * self._patience) if waiting else None

    def _accept(self) -> None:
        try:
            link, _ = self._listener.accept()
        except BlockingIOError:
            return
        except OSError:  # no more sockets to be had: look again when some are given back
            self._selector.unregister(self._listener)
            self._deaf_until = self._clock() + 0.1
            return
        if len(self._connections) >= self._clients:
            link.close()
            return
        link.setblocking(False)
        link.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        # a client whose computer is gone is noticed after some time, and control is free again
        link.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
        for option, value in (("TCP_KEEPIDLE", 10), ("TCP_KEEPINTVL", 5), ("TCP_KEEPCNT", 3)):
            if hasattr(socket, option):
                link.setsockopt(socket.IPPROTO_TCP, getattr(socket, option), value)
        connection = _Connection(
            socket=link, session=ServerSession(self._interpreter), moved_on=self._clock()
        )
        self._connections[link.fileno()] = connection
        self._selector.register(link, selectors.EVENT_READ, connection)

    def _exchange(self, connection: _Connection, events: int) -> None:
        """Read and write what can be read and written."""
        try:
            if events & selectors.EVENT_READ:
                data = connection.socket.recv(_READ)
                if data:
                    connection.session.push(data)
                else:
                    connection.ended = True
            if events & selectors.EVENT_WRITE:
                self._send(connection)
        except BlockingIOError:
            return
        except OSError:
            self._drop(connection)

    def _work(self, connection: _Connection, now: float) -> None:
        """Carry out some of what a client wants, and send what there is to say."""
        if connection.socket.fileno() < 0:
            return
        try:
            if len(connection.answers) < _ANSWERS:
                connection.answers += connection.session.pull(commands=_TURN)
            self._send(connection)
        except BlockingIOError:
            pass
        except OSError:
            self._drop(connection)
            return
        except _UNFORESEEN:
            _log.exception("a client's command broke down; the client is sent away")
            self._drop(connection)
            return
        if not connection.answers:
            connection.moved_on = now
        # a client may say what it wants, close its side, and still read
        over = connection.ended and not connection.session.busy and not connection.answers
        if over or now - connection.moved_on > self._patience:
            self._drop(connection)
        else:
            self._watch(connection)

    def _send(self, connection: _Connection) -> None:
        if connection.answers:
            sent = connection.socket.send(connection.answers[:_READ], _QUIETLY)
            del connection.answers[:sent]
            if sent:
                connection.moved_on = self._clock()

    def _watch(self, connection: _Connection) -> None:
        events = selectors.EVENT_WRITE if connection.answers else 0
        if not connection.ended and connection.session.backlog < _ORDERS:
            events |= selectors.EVENT_READ
        watched = connection.socket in self._selector.get_map()
        if events and watched:
            self._selector.modify(connection.socket, events, connection)
        elif events:
            self._selector.register(connection.socket, events, connection)
        elif watched:
            self._selector.unregister(connection.socket)

    def _drop(self, connection: _Connection) -> None:
        link = connection.socket
        if link.fileno() < 0:
            return
        if link in self._selector.get_map():
            self._selector.unregister(link)
        connection.session.close()
        self._connections.pop(link.fileno(), None)
        link.close()
