"""A client's end of a conversation in the same process."""

import threading
from typing import Final

from flexstage.errors import NotConnectedError
from flexstage.instruments.twin.interpreter import Interpreter
from flexstage.instruments.twin.session import Session

_STOP: Final = b"\x18"


class Loopback:
    """Takes what a client sends, and has the answer ready at once.

    Any thread may send; a stop (character 24) does not wait for what another thread does.
    """

    def __init__(self, interpreter: Interpreter) -> None:
        self._interpreter = interpreter
        self._session = Session(interpreter)
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

    def _open(self) -> None:
        if self._closed:
            raise NotConnectedError("the conversation with the simulated controller was closed")


def open_session(interpreter: Interpreter) -> Loopback:
    """Open a conversation with a controller in the same process."""
    return Loopback(interpreter)
