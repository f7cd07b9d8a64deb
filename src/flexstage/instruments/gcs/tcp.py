"""A link over the network, or to a server on the same computer."""

import contextlib
import math
import select
import socket

from flexstage.errors import NotConnectedError
from flexstage.instruments.gcs.transport import NoAnswerError, Transport

#: The port at which PI's controllers listen.
DEFAULT_PORT = 50000
#: Most bytes that are read at once.
_PIECE = 65536
#: A link that is gone raises, and does not end the process by SIGPIPE, also where a library (Gmsh
#: does) has given that signal back its default.
_QUIETLY = getattr(socket, "MSG_NOSIGNAL", 0)


class TcpLink(Transport):
    """A TCP connection to a controller.

    `timeout` is the longest time for connecting, and for handing a command to the network [s].
    """

    def __init__(self, host: str, port: int = DEFAULT_PORT, *, timeout: float = 5.0) -> None:
        self._host, self._port, self._timeout = host, port, timeout
        try:
            made = socket.create_connection((host, port), timeout=timeout)
        except (OSError, OverflowError, UnicodeError) as error:
            raise NotConnectedError(
                f"cannot connect to {host} port {port}: {_reason(error)}; is the controller (or "
                "'flexstage twin') switched on, and is the address right?"
            ) from error
        made.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        made.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
        self._socket: socket.socket | None = made

    @property
    def name(self) -> str:
        return f"{self._host}:{self._port}"

    def send(self, data: bytes) -> None:
        link = self._open()
        try:
            link.sendall(data, _QUIETLY)
        except OSError as error:
            raise self._lost(error) from error

    def receive(self, timeout: float) -> bytes:
        link = self._open()
        try:
            # the time-out of the socket is that of sending, which another thread may be doing
            if not _readable(link, timeout):
                raise NoAnswerError(f"nothing came from {self.name} in {timeout:g} s")
            data = link.recv(_PIECE)
        except NoAnswerError:
            raise
        except (OSError, ValueError) as error:
            raise self._lost(error) from error
        if not data:
            raise NotConnectedError(f"{self.name} has closed the link: connect again")
        return data

    def another(self) -> "TcpLink":
        """Open a second connection to the same controller."""
        return TcpLink(self._host, self._port, timeout=self._timeout)

    def close(self) -> None:
        link, self._socket = self._socket, None
        if link is not None:
            with contextlib.suppress(OSError):  # it may be gone already
                link.shutdown(socket.SHUT_RDWR)
            link.close()

    def _open(self) -> socket.socket:
        link = self._socket
        if link is None:
            raise NotConnectedError(f"the link to {self.name} is closed: connect again")
        return link

    def _lost(self, error: Exception) -> NotConnectedError:
        return NotConnectedError(f"the link to {self.name} is lost ({_reason(error)})")


def _readable(link: socket.socket, timeout: float) -> bool:
    if hasattr(select, "poll"):
        # select() fails for files beyond number 1023
        waiting = select.poll()
        waiting.register(link, select.POLLIN)
        return bool(waiting.poll(math.ceil(max(timeout, 0.0) * 1e3)))
    return bool(select.select([link], [], [], max(timeout, 0.0))[0])


def _reason(error: Exception) -> str:
    return getattr(error, "strerror", None) or str(error) or type(error).__name__
