"""Questions and commands for a GCS controller, one at a time, each with its own answer."""

import threading
import time
from collections.abc import Callable, Sequence

from flexstage.errors import ControllerError, NotConnectedError
from flexstage.instruments.pi.conversation import Conversation, shown
from flexstage.instruments.pi.replies import (
    STOPPED,
    assignments,
    error_sentence,
    number,
    whole_number,
)
from flexstage.instruments.transport import Transport


class GcsClient:
    """Questions and commands to a controller that speaks the General Command Set, version 2.

    An answer that comes too late is never taken for that to a later question: after a time-out the
    link is brought into step again by a question whose answer is known, and if that fails it is
    given up. Any thread may ask; one exchange goes on at a time.

    `timeout` is the longest silence before an answer is given up [s]. Connecting sends ``*IDN?``,
    ``CSV?`` and ``ERR?`` and nothing else.
    """

    def __init__(
        self,
        transport: Transport,
        *,
        timeout: float = 2.0,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._lock = threading.RLock()
        self._conversation = Conversation(transport, timeout, clock)
        self._stops = 0
        try:
            self._conversation.greet()
        except BaseException:
            transport.close()
            raise

    @property
    def name(self) -> str:
        """Where the link leads."""
        return self._conversation.name

    @property
    def identity(self) -> str:
        """What the controller answers to ``*IDN?``."""
        return self._conversation.identity

    @property
    def connected(self) -> bool:
        """Whether the link is whole, as far as is known."""
        return self._conversation.connected

    @property
    def stops(self) -> int:
        """How often `stop` was called."""
        return self._stops

    def ask(self, command: str, *, timeout: float | None = None) -> list[str]:
        """Ask a question; return the lines of its answer, one at least.

        The line feed of the question, and the spaces that end lines of the answer, are left out.
        After a `NoAnswerError` the link is in step again.
        """
        with self._lock:
            self._conversation.settle()
            return self._conversation.ask(
                command, self._conversation.timeout if timeout is None else timeout
            )

    def ask_values(self, command: str, names: Sequence[str]) -> list[float]:
        """Ask for one number for each name, in their order; ``nan`` where a sensor gives that.

        Names are axes, channels, tables, or pairs of item and parameter.
        """
        return [number(text, command) for text in self.ask_texts(command, names)]

    def ask_texts(self, command: str, names: Sequence[str]) -> list[str]:
        """Ask for one text for each name, in their order."""
        question = " ".join([command, *names])
        with self._lock:
            lines = self.ask(question)
            try:
                return assignments(lines, names, question)
            except ControllerError:
                self._conversation.put_in_step(question)
                raise

    def ask_whole(self, command: str, *, base: int = 10) -> int:
        """Ask for one whole number; `base` is 16 for hexadecimal digits that do not say so."""
        with self._lock:
            lines = self.ask(command)
            try:
                text = " ".join(lines).rpartition("=")[2].strip()
                if base == 16 and not text.lower().startswith("0x"):
                    text = f"0x{text}"
                return whole_number(text, shown(command))
            except ControllerError:
                self._conversation.put_in_step(command)
                raise

    def tell(self, command: str) -> None:
        """Give a command, and ask whether it was carried out.

        After a `NoAnswerError` or `NotConnectedError` it may have been. Where the link was lost
        with it, a stop is sent by another link if there can be one.
        """
        with self._lock:
            self._conversation.settle()
            try:
                code = self._conversation.tell(command)
            except NotConnectedError:
                # it may have been carried out, and nobody could see what comes of it
                self.stop()
                raise
            if code == STOPPED:
                # somebody stopped the stage, and this command may have come after it
                self.stop()
                raise ControllerError(
                    f"'{shown(command)}' met a stop: {error_sentence(code)}, perhaps by somebody "
                    "else, and to be sure everything was stopped once more",
                    code,
                )
            if code:
                raise ControllerError(
                    f"the controller refused '{shown(command)}': {error_sentence(code)}", code
                )

    def stop(self) -> None:
        """Stop all motion at once, from any thread; never raises.

        The character goes out on the link even while another thread waits for an answer. Where the
        link takes nothing, or is gone, a second connection is tried if there can be one.
        """
        self._stops += 1
        self._conversation.send_stop()

    def reconnect(self) -> None:
        """Open the link anew, where it can be, and see that the same controller is there."""
        with self._lock:
            self._conversation.reopen()

    def close(self) -> None:
        """End the link; nothing moves by it."""
        self._conversation.close()
