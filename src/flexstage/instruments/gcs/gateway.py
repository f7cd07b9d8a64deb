"""A link by an object of the user's own, such as the connection of another library."""

import time
from collections.abc import Callable
from typing import Any, Protocol

from flexstage.errors import ModelError, NotConnectedError
from flexstage.instruments.gcs.transport import NoAnswerError, Transport

#: Pause between two looks at an object that returns at once when nothing has come [s].
_PAUSE = 2e-3


class Gateway(Protocol):
    """What an object must have at least; texts or bytes, ending with a line feed."""

    def send(self, msg: Any, /) -> object:
        """Send a text."""
        ...

    def read(self) -> Any:
        """Return what has come, in pieces or whole; empty where nothing has."""
        ...


def is_gateway(value: object) -> bool:
    """Say whether an object can be used as a link."""
    return all(callable(getattr(value, name, None)) for name in ("send", "read"))


class GatewayLink(Transport):
    """A link by an object that sends and reads texts.

    `flush`, `close` and `connected` are used where the object has them. An object that waits in
    `read` waits as long as it has been told elsewhere; what it raises on a time-out is taken for
    nothing. Its `send` gets a text with the line feed at its end.
    """

    def __init__(
        self,
        gateway: Gateway,
        *,
        clock: Callable[[], float] = time.monotonic,
        sleep: Callable[[float], object] = time.sleep,
    ) -> None:
        if not is_gateway(gateway):
            raise ModelError(
                f"a gateway needs the methods send(text) and read(), got a {type(gateway).__name__}"
            )
        self._gateway: Any = gateway
        self._clock, self._sleep = clock, sleep
        self._closed = False
        flush = getattr(gateway, "flush", None)
        if callable(flush):
            flush()

    @property
    def name(self) -> str:
        return f"gateway {type(self._gateway).__name__}"

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
                raise NoAnswerError(f"nothing came from {self.name} in {timeout:g} s")
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
