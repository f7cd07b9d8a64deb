"""Transports of bytes to a controller and back: memory, network, serial port, or a user object."""

import contextlib
import math
import select
import socket
import time
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, Protocol, cast, runtime_checkable

from flexstage.base.errors import ControllerError, ModelError, NotConnectedError
from flexstage.base.lazy import require_extra

if TYPE_CHECKING:
    import serial


class NoAnswerError(ControllerError, TimeoutError):
    """An instrument did not answer in time; the link itself may be intact."""


@runtime_checkable
class Transport(Protocol):
    """Transport of bytes, in order.

    One thread receives at a time; `send` may be called while another thread receives.
    """

    name: str
    """Name of the remote end, for messages."""

    def send(self, data: bytes) -> None:
        """Send all bytes; `NotConnectedError` on a lost link."""
        ...

    def receive(self, timeout: float) -> bytes:
        """Return the received bytes, at least one, within a time [s].

        `NoAnswerError` if none arrived in time, `NotConnectedError` on a lost link.
        """
        ...

    def close(self) -> None:
        """Disconnect; repeated calls have no effect."""
        ...


@runtime_checkable
class OpensAnother(Protocol):
    """A transport that can open a second link to the same controller."""

    def another(self) -> Transport:
        """Open a second link; `NotConnectedError` where this is not possible."""
        ...


class InProcessSession(Protocol):
    """A session with a simulated controller in the same process, which answers immediately."""

    def send(self, data: bytes) -> None:
        """Accept bytes from the client."""
        ...

    def receive(self, timeout: float) -> bytes:
        """Return bytes for the client; empty or a timeout where there are none."""
        ...


class InProcess(Transport):
    r"""A link in memory, to a simulated controller.

    Examples
    --------
    >>> class Echo:
    ...     def send(self, data): self.data = data
    ...     def receive(self, timeout): return self.data
    >>> link = InProcess(Echo())
    >>> link.send(b"POS? 1\n")
    >>> link.receive(1.0)
    b'POS? 1\n'
    """

    def __init__(self, session: InProcessSession, *, name: str = "simulated controller") -> None:
        self._session: InProcessSession | None = session
        self._first = session
        self.name = name

    def send(self, data: bytes) -> None:
        self._open().send(data)

    def receive(self, timeout: float) -> bytes:
        try:
            data = self._open().receive(timeout)
        except TimeoutError:
            data = b""
        if not data:
            # the session answers while it accepts the question
            raise NoAnswerError(f"no data from {self.name}")
        return data

    def another(self) -> "InProcess":
        """Open a second session with the same controller."""
        another = getattr(self._first, "another", None)
        if not callable(another):
            raise NotConnectedError(f"a second session with {self.name} is not possible")
        return InProcess(cast("InProcessSession", another()), name=self.name)

    def close(self) -> None:
        session, self._session = self._session, None
        close = getattr(session, "close", None)
        if callable(close):
            close()

    def _open(self) -> InProcessSession:
        session = self._session
        if session is None:
            raise NotConnectedError(f"the link to {self.name} is closed: connect again")
        return session


#: The port at which PI's controllers listen.
DEFAULT_PORT = 50000
#: Largest number of bytes that are read at once.
_PIECE = 65536
#: A lost link raises an error instead of ending the process by SIGPIPE, even where a library such
#: as Gmsh has restored the default of that signal.
_QUIETLY = getattr(socket, "MSG_NOSIGNAL", 0)


class TcpLink(Transport):
    """A TCP connection to a controller.

    `timeout` is the longest time for connecting, and for sending a command [s].
    """

    def __init__(self, host: str, port: int = DEFAULT_PORT, *, timeout: float = 5.0) -> None:
        self._host, self._port, self._timeout = host, port, timeout
        self.name = f"{host}:{port}"
        try:
            link = socket.create_connection((host, port), timeout=timeout)
        except (OSError, OverflowError, UnicodeError) as error:
            raise NotConnectedError(
                f"cannot connect to {host} port {port}: {_reason(error)}; check that the "
                "controller (or 'flexstage twin') is switched on, and the address"
            ) from error
        link.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        link.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
        self._socket: socket.socket | None = link

    def send(self, data: bytes) -> None:
        link = self._open()
        try:
            link.sendall(data, _QUIETLY)
        except OSError as error:
            raise self._lost(error) from error

    def receive(self, timeout: float) -> bytes:
        link = self._open()
        try:
            # the timeout of the socket is that of sending, possibly in another thread
            if not _readable(link, timeout):
                raise NoAnswerError(f"no data from {self.name} in {timeout:g} s")
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
            with contextlib.suppress(OSError):  # the link may be lost already
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


#: Default rate of a port [bit/s].
DEFAULT_BAUD = 115200


class SerialLink(Transport):
    """A serial port with a controller: 8 bits, no parity, 1 stop bit, no handshake.

    `baud` is its rate [bit/s]; a command that is not sent within 5 s is an error.
    """

    def __init__(self, port: str, *, baud: int = DEFAULT_BAUD) -> None:
        require_extra("serial", "serial", "a serial port", NotConnectedError)
        import serial

        self.name = port
        try:
            port_object = serial.serial_for_url(port, baudrate=baud, timeout=0.0, write_timeout=5.0)
        except (OSError, ValueError) as error:
            raise NotConnectedError(
                f"cannot open the serial port {port} at {baud} bit/s: {error}; check the cable, "
                "and your permission to use the port"
            ) from error
        port_object.reset_input_buffer()
        self._serial: serial.Serial | None = port_object

    def send(self, data: bytes) -> None:
        port = self._open()
        try:
            port.write(data)
        except OSError as error:
            raise self._lost(error) from error

    def receive(self, timeout: float) -> bytes:
        port = self._open()
        try:
            port.timeout = timeout
            data = port.read(1)
            if data:
                data += port.read(port.in_waiting)
        except (OSError, TypeError) as error:
            # pyserial fails with a TypeError where another thread has closed the port
            raise self._lost(error) from error
        if not data:
            raise NoAnswerError(f"no data from {self.name} in {timeout:g} s")
        return data

    def close(self) -> None:
        port, self._serial = self._serial, None
        if port is not None:
            with contextlib.suppress(OSError):
                port.close()

    def _open(self) -> "serial.Serial":
        port = self._serial
        if port is None:
            raise NotConnectedError(f"the serial port {self.name} is closed: connect again")
        return port

    def _lost(self, error: Exception) -> NotConnectedError:
        return NotConnectedError(f"the serial port {self.name} is lost ({error})")


#: Polling interval of an object that returns immediately without data [s].
_PAUSE = 2e-3


def is_gateway(value: object) -> bool:
    """Return whether an object can be used as a link: it has the methods send and read."""
    return all(callable(getattr(value, name, None)) for name in ("send", "read"))


class GatewayLink(Transport):
    """A link through an object that sends and reads texts or bytes, such as one of another library.

    `flush`, `close` and `connected` are used where the object has them. If its `read` blocks, its
    own timeout applies; a `TimeoutError` means no data. Its `send` receives a text with a line feed
    at the end.
    """

    def __init__(
        self,
        gateway: object,
        *,
        clock: Callable[[], float] = time.monotonic,
        sleep: Callable[[float], object] = time.sleep,
    ) -> None:
        if not is_gateway(gateway):
            raise ModelError(
                f"a gateway needs the methods send(text) and read(), got a {type(gateway).__name__}"
            )
        self._gateway: Any = gateway
        self.name = f"gateway {type(gateway).__name__}"
        self._clock, self._sleep = clock, sleep
        self._closed = False
        flush = getattr(gateway, "flush", None)
        if callable(flush):
            flush()

    def send(self, data: bytes) -> None:
        self._check()
        try:
            self._gateway.send(data.decode("latin-1"))
        except Exception as error:
            raise self._lost(error) from error

    def receive(self, timeout: float) -> bytes:
        end = self._clock() + timeout
        while True:
            self._check()
            try:
                piece = self._gateway.read()
            except TimeoutError:
                piece = ""
            except Exception as error:
                raise self._lost(error) from error
            if isinstance(piece, bytes) and piece:
                return piece
            if piece:
                return str(piece).encode("latin-1", "replace")
            if self._clock() >= end:
                raise NoAnswerError(f"no data from {self.name} in {timeout:g} s")
            self._sleep(_PAUSE)

    def close(self) -> None:
        if not self._closed:
            self._closed = True
            close = getattr(self._gateway, "close", None)
            if callable(close):
                close()

    def _check(self) -> None:
        if self._closed or getattr(self._gateway, "connected", True) is False:
            raise NotConnectedError(f"the {self.name} is not connected: connect it again")

    def _lost(self, error: Exception) -> NotConnectedError:
        return NotConnectedError(f"the link of the {self.name} is lost ({error})")
