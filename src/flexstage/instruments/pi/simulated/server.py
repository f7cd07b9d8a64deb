"""Server of a simulated GCS controller: sessions of bytes, and a TCP port for many clients."""

import logging
import os
import re
import selectors
import socket
import threading
import time
from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Final

from flexstage.instruments.pi.simulated.command import Reply
from flexstage.instruments.pi.simulated.device import Refusal
from flexstage.instruments.pi.simulated.interpreter import Interpreter

_log = logging.getLogger(__name__)

#: Longest line [bytes]; longer ones are not carried out.
LONGEST_LINE: Final = 65536
STOP: Final = 24
_NEWLINE = 10
#: Single-character commands, and the end of a line.
_SPECIAL = re.compile(rb"[\x04\x05\x07\x09\n]")
#: Characters below 32; those that are not commands are dropped before the start of a line.
_CONTROL = bytes(range(32))
_PRINTABLE = bytes(range(32, 127))


class ServerSession:
    r"""Session of a client.

    Lines end with LF, or CR and LF. The characters 4, 5, 7, 9 and 24 are commands at any position;
    other control characters are dropped before a line, and make a line invalid. Character 24 stops
    all axes before anything else that arrived with it: earlier commands that are not carried out
    yet start no motion (error 10), and an incomplete line is dropped.

    Examples
    --------
    A session without sockets: ``session.feed(b"SVO? 1\n")`` returns ``b"1=0\n"``.
    """

    def __init__(self, interpreter: Interpreter) -> None:
        self._interpreter = interpreter
        self._part = bytearray()
        self._dropping = False
        #: Pending commands, lines or characters, oldest first.
        self._waiting: deque[bytes | int] = deque()
        self._backlog = 0
        self._stopped = 0
        self._pieces: Iterator[str] | None = None
        self.error = 0
        self.level = 0
        interpreter.join(self)

    @property
    def busy(self) -> bool:
        """Whether commands or answers are pending."""
        return bool(self._waiting) or self._pieces is not None

    @property
    def backlog(self) -> int:
        """Size of the pending commands [bytes]; each command counts 64 more."""
        return self._backlog + 64 * len(self._waiting)

    def feed(self, data: bytes) -> bytes:
        """Accept bytes, and return the complete answers."""
        self.push(data)
        answer = bytearray()
        while self.busy:
            answer += self.pull()
        return bytes(answer)

    def stop(self) -> None:
        """Stop all axes; pending commands start no motion.

        Any thread may call this at any time.
        """
        self._stopped = len(self._waiting)
        self._interpreter.stop(self)

    def push(self, data: bytes) -> None:
        """Accept bytes; a character 24 among them acts immediately."""
        at = data.rfind(STOP)
        if at >= 0:
            self.stop()
            for piece in data[:at].split(b"\x18"):
                self._take(piece)
                self._part.clear()
                self._dropping = False
            self._stopped = len(self._waiting)
        self._take(data[at + 1 :])

    def pull(self, commands: int = 1000) -> bytes:
        """Carry out pending commands, and return the answers.

        At most `commands` commands, and no further one after 64 KiB of answers.
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
            if len(answer) >= _READ:
                break
        return bytes(answer)

    def close(self) -> None:
        """End the session without motion; another client may take control."""
        self._waiting.clear()
        self._backlog = 0
        self._pieces = None
        self._interpreter.leave(self)

    def _take(self, data: bytes) -> None:
        """Split bytes into lines and characters."""
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
#: Number of commands of a client before the next client is served.
_TURN: Final = 8
#: Length of the queue of new connections.
_WAITING: Final = 128
#: Largest sizes of unread answers and of pending commands of a client [bytes].
_ANSWERS, _ORDERS = 1 << 18, 1 << 20
#: A lost client raises an error instead of ending the process by SIGPIPE, even where a library has
#: restored the default of that signal.
_QUIETLY = getattr(socket, "MSG_NOSIGNAL", 0)
#: Unexpected errors of a simulation: only this client is disconnected.
_UNFORESEEN = (ArithmeticError, AttributeError, LookupError, RuntimeError, TypeError, ValueError)


@dataclass(slots=True, kw_only=True, eq=False)
class _Connection:
    socket: socket.socket
    session: ServerSession
    answers: bytearray = field(default_factory=bytearray)
    #: Time at which the client last read answers, or had none to read.
    moved_on: float
    ended: bool = False


def reserve(host: str, port: int) -> socket.socket:
    """Reserve a port, any free one for 0; connections are accepted once a server listens."""
    host.encode("idna")
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    listener = socket.socket(family, socket.SOCK_STREAM)
    try:
        if os.name == "posix":  # elsewhere two servers could share a port
            listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        if family == socket.AF_INET6:  # an IPv6 address does not accept IPv4
            listener.setsockopt(socket.IPPROTO_IPV6, socket.IPV6_V6ONLY, 1)
        listener.bind((host, port))
    except BaseException:
        listener.close()
        raise
    return listener


class GcsServer:
    """TCP server of a GCS controller.

    Every program that can reach the host can move the stage; the default host is reachable from
    this computer only. Port 0 is any free port; a listener, a socket of `reserve`, replaces both
    and is closed by the server. The server disconnects excess clients, and clients that do not read
    their answers for `patience` [s].

    Notes
    -----
    Disconnecting a client stops nothing: an axis moves to its target and holds it, and a waveform
    runs to its end (an endless one until it is stopped), as with a real controller. The server does
    not read from a client with too many pending commands.
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
    ) -> None:
        self._interpreter = interpreter
        self._clients, self._patience = clients, patience
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
        """Disconnect all clients and end; repeated calls have no effect."""
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
            now = time.monotonic()
            if self._deaf_until is not None and now >= self._deaf_until:
                self._deaf_until = None
                self._selector.register(self._listener, selectors.EVENT_READ, "listen")
            for connection in list(self._connections.values()):
                self._work(connection, now)

    def _wait(self) -> float | None:
        """Return the time to sleep: 0 where commands are pending and can be answered."""
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
        except OSError:  # no more sockets available: try again later
            self._selector.unregister(self._listener)
            self._deaf_until = time.monotonic() + 0.1
            return
        if len(self._connections) >= self._clients:
            link.close()
            return
        link.setblocking(False)
        link.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        # detects a client whose computer has disappeared, so that control becomes free again
        link.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
        for option, value in (("TCP_KEEPIDLE", 10), ("TCP_KEEPINTVL", 5), ("TCP_KEEPCNT", 3)):
            if hasattr(socket, option):
                link.setsockopt(socket.IPPROTO_TCP, getattr(socket, option), value)
        connection = _Connection(
            socket=link, session=ServerSession(self._interpreter), moved_on=time.monotonic()
        )
        self._connections[link.fileno()] = connection
        self._selector.register(link, selectors.EVENT_READ, connection)

    def _exchange(self, connection: _Connection, events: int) -> None:
        """Read and write the available data."""
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
        """Carry out commands of a client, and send answers."""
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
            _log.exception("a client's command failed unexpectedly; the client is disconnected")
            self._drop(connection)
            return
        if not connection.answers:
            connection.moved_on = now
        # a client may close its sending side and still read
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
                connection.moved_on = time.monotonic()

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
