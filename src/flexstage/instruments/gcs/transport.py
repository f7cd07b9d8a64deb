"""What carries bytes to a controller and back, whatever it is made of."""

from typing import Protocol, cast, runtime_checkable

from flexstage.errors import ControllerError, NotConnectedError


class NoAnswerError(ControllerError, TimeoutError):
    """An instrument did not answer in time; the link itself may be whole."""


@runtime_checkable
class Transport(Protocol):
    """Carries bytes, in order.

    One thread receives at a time; `send` may be called while another thread receives.
    """

    @property
    def name(self) -> str:
        """Where it leads, for sentences."""
        ...

    def send(self, data: bytes) -> None:
        """Send all of it; `NotConnectedError` where the link is gone."""
        ...

    def receive(self, timeout: float) -> bytes:
        """Return what has come, one byte at least, within a time [s].

        `NoAnswerError` where nothing came in the time, `NotConnectedError` where the link is gone.
        """
        ...

    def close(self) -> None:
        """End the link; calling it again changes nothing."""
        ...


@runtime_checkable
class OpensAnother(Protocol):
    """A transport that can make a second link to the same place."""

    def another(self) -> Transport:
        """Open it; `NotConnectedError` where it cannot be had."""
        ...


class InProcessSession(Protocol):
    """A conversation with a simulated controller in the same process, which answers at once."""

    def send(self, data: bytes) -> None:
        """Take bytes from the client."""
        ...

    def receive(self, timeout: float) -> bytes:
        """Return bytes for the client; empty or a time-out where there are none."""
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
        self._name = name

    @property
    def name(self) -> str:
        return self._name

    def send(self, data: bytes) -> None:
        self._open().send(data)

    def receive(self, timeout: float) -> bytes:
        try:
            data = self._open().receive(timeout)
        except TimeoutError:
            data = b""
        if not data:
            # what it has to say it says while it takes the question
            raise NoAnswerError(f"nothing came from {self._name}")
        return data

    def another(self) -> "InProcess":
        """Open a second conversation with the same controller."""
        another = getattr(self._first, "another", None)
        if not callable(another):
            raise NotConnectedError(f"there can be no second conversation with {self._name}")
        return InProcess(cast("InProcessSession", another()), name=self._name)

    def close(self) -> None:
        session, self._session = self._session, None
        close = getattr(session, "close", None)
        if callable(close):
            close()

    def _open(self) -> InProcessSession:
        session = self._session
        if session is None:
            raise NotConnectedError(f"the link to {self._name} is closed: connect again")
        return session
