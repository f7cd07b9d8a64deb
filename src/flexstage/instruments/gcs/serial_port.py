"""A link over a serial port, or USB that looks like one."""

import contextlib
from typing import TYPE_CHECKING

from flexstage.errors import NotConnectedError
from flexstage.instruments.gcs.transport import NoAnswerError, Transport

if TYPE_CHECKING:
    import serial

#: The rate of a port that nobody has set otherwise [bit/s].
DEFAULT_BAUD = 115200


class SerialLink(Transport):
    """A serial port with a controller at it: 8 bits, no parity, 1 stop bit, no handshake.

    `baud` is its rate [bit/s], `timeout` the longest time for handing a command to it [s].
    """

    def __init__(self, port: str, *, baud: int = DEFAULT_BAUD, timeout: float = 5.0) -> None:
        import serial

        self._port, self._baud = port, baud
        try:
            made = serial.serial_for_url(port, baudrate=baud, timeout=0.0, write_timeout=timeout)
        except (OSError, ValueError) as error:
            raise NotConnectedError(
                f"cannot open the serial port {port} at {baud} bit/s: {error}; is the cable in, "
                "and may you use the port?"
            ) from error
        made.reset_input_buffer()
        self._serial: serial.Serial | None = made

    @property
    def name(self) -> str:
        return self._port

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
            raise NoAnswerError(f"nothing came from {self.name} in {timeout:g} s")
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
