"""A conversation with a GCS controller: lines, errors and interruptions; commands and questions."""

import contextlib
import threading
import time
from collections.abc import Callable, Sequence

from flexstage.base.errors import ControllerError, NotConnectedError
from flexstage.instruments.pi.replies import (
    STOPPED,
    assignments,
    error_sentence,
    excerpt,
    number,
    take_lines,
    whole_number,
)
from flexstage.instruments.transport import NoAnswerError, OpensAnother, Transport

#: The single character that stops everything; it needs no line feed.
STOP_ALL = b"\x18"
#: How long a stop waits for a command that is being sent before it takes another way [s].
_STOP_PATIENCE = 0.1
#: Most bytes of one reply; more is not an answer.
_LARGEST = 64 * 2**20


class Conversation:
    """Questions and answers of one thread at a time; only `send_stop` may be called by others."""

    def __init__(self, transport: Transport, timeout: float, clock: Callable[[], float]) -> None:
        self._transport = transport
        #: Where the link leads; longest silence before an answer is given up [s].
        self.name, self.timeout = transport.name, timeout
        self._clock = clock
        self._sending = threading.Lock()
        self._buffer = bytearray()
        self._lines: list[str] = []
        #: Why the link is given up; None where it is whole, as far as is known.
        self.broken: str | None = None
        #: Stops that have gone out, and those whose error was taken away.
        self._stops_sent = self._stops_settled = 0
        #: A question whose answer is still on its way.
        self._waiting: str | None = None
        #: Questions that have one answer only.
        self._known: dict[str, str] = {}
        #: What the controller answers to ``*IDN?``.
        self.identity = ""

    def send_stop(self) -> None:
        """Stop all motion, over a second link if the first one takes nothing; never raises."""
        try:
            self._send_stop()
        finally:
            self._stops_sent += 1

    def _send_stop(self) -> None:
        # whatever a link raises, a stop must not fail because of it
        if self._sending.acquire(timeout=_STOP_PATIENCE):
            try:
                with contextlib.suppress(Exception):
                    self._transport.send(STOP_ALL)  # a link that was given up is closed, and raises
                    return
            finally:
                self._sending.release()
        if isinstance(self._transport, OpensAnother):
            with contextlib.suppress(Exception):
                second = self._transport.another()
                try:
                    second.send(STOP_ALL)
                finally:
                    second.close()

    def close(self) -> None:
        """End the link."""
        self.broken = self.broken or "it was closed"
        self._transport.close()

    def greet(self) -> None:
        """Ask who is there, and forget errors of earlier conversations."""
        identity = self.ask("*IDN?", self.timeout)
        if len(identity) != 1 or not identity[0].strip().isprintable() or not identity[0].strip():
            raise ControllerError(
                f"{self.name} answers {excerpt(' | '.join(identity))} to '*IDN?', as no GCS "
                "controller does: is it the right address, or the right rate of the serial port?"
            )
        self.identity = identity[0]
        self._known = {"*IDN?": self.identity}
        syntax = self.ask("CSV?", self.timeout)
        if not 2.0 <= number(syntax[0], "CSV?") < 3.0:
            raise ControllerError(
                f"{self.name} speaks version {excerpt(syntax[0])} of the command set, and version "
                "2 is needed"
            )
        self._known["CSV?"] = syntax[0]
        self.query_error("ERR?")

    def settle(self) -> None:
        """Take away the error that a stop leaves behind, so that no later command is blamed."""
        self._require_link()
        if self._waiting is not None or self._lines or self._buffer:
            # an exchange was broken off, as by a key: its answer may come yet
            self.put_in_step(self._waiting or "")
        if self._stops_settled != self._stops_sent:
            self._stops_settled = self._stops_sent
            self.query_error("ERR?")

    def ask(self, command: str, timeout: float) -> list[str]:
        """Ask a question; the time-out is that of silence [s]."""
        data = command.encode("ascii")
        self._send(data if len(command) == 1 else data + b"\n", command)
        try:
            return self._reply(timeout)
        except NoAnswerError:
            self.put_in_step(command)
        # a controller says nothing to a question that it refuses
        code = self.query_error(command)
        if code:
            raise ControllerError(
                f"the controller refused '{printable(command)}': {error_sentence(code)}", code
            )
        raise NoAnswerError(
            f"{self.name} did not answer '{printable(command)}' within {timeout:g} s, and answers "
            "again now"
        )

    def tell(self, command: str) -> int:
        """Give a command; return the number of the error that it led to, 0 for none."""
        self._send(command.encode("ascii") + b"\nERR?\n", "ERR?")
        return self._error_code(command)

    def query_error(self, command: str) -> int:
        """Ask for the latest error, 0 for none; sentences say that it is about the command."""
        self._send(b"ERR?\n", "ERR?")
        return self._error_code(command)

    def _error_code(self, command: str) -> int:
        try:
            lines = self._reply(self.timeout)
        except NoAnswerError:
            self.put_in_step("ERR?")
            raise NoAnswerError(
                f"{self.name} did not confirm '{printable(command)}' within {self.timeout:g} s: "
                "check the position of the stage"
            ) from None
        try:
            return whole_number(lines[0] if len(lines) == 1 else " | ".join(lines), "ERR?")
        except ControllerError:
            self.put_in_step("ERR?")
            raise

    def _reply(self, timeout: float) -> list[str]:
        """Return the lines of one reply; the time is that of silence, not of the whole."""
        reply: list[str] = []
        size = 0
        while True:
            while self._lines:
                line = self._lines.pop(0)
                size += 1 + len(line)
                if size > _LARGEST:
                    raise self._break(f"{self.name} sends without end")
                if not line.endswith(" "):
                    self._waiting = None
                    return [*reply, line]
                reply.append(line[:-1])
            self._receive(timeout)
            if size + len(self._buffer) > _LARGEST:
                raise self._break(f"{self.name} sends without end")

    def _receive(self, timeout: float) -> None:
        try:
            data = self._transport.receive(timeout)
        except NotConnectedError as error:
            self._break(str(error))
            raise
        if not data:
            raise NoAnswerError(f"nothing came from {self.name}")
        self._buffer += data
        self._lines += take_lines(self._buffer)

    def _send(self, data: bytes, question: str) -> None:
        self._require_link()
        self._waiting = question
        try:
            with self._sending:
                self._transport.send(data)
        except NotConnectedError as error:
            self._break(str(error))
            raise

    def put_in_step(self, command: str) -> None:
        """Drop all up to the answer to a question that has only one, or give the link up."""
        known = {q: a for q, a in self._known.items() if q != command}
        if not known:
            raise self._break(f"{self.name} does not answer '{printable(command)}'")
        question, answer = next(iter(known.items()))
        self._send(question.encode("ascii") + b"\n", question)
        end = self._clock() + self.timeout
        try:
            while True:
                while self._lines:
                    # the rest of a line that was lost may stand before it
                    if self._lines.pop(0).endswith(answer):
                        self._waiting = None
                        return
                left = end - self._clock()
                if left <= 0.0:
                    raise NoAnswerError("silence")
                self._receive(left)
        except NoAnswerError:
            raise self._break(
                f"{self.name} answers neither '{printable(command)}' nor '{question}'"
            ) from None

    def _forget(self) -> None:
        self._buffer.clear()
        self._lines.clear()
        self._waiting = None

    def _break(self, why: str) -> NotConnectedError:
        self.broken = why
        self._forget()
        self._transport.close()
        return NotConnectedError(f"the link is given up, since {why}: connect again")

    def _require_link(self) -> None:
        if self.broken is not None:
            raise NotConnectedError(
                f"there is no link to {self.name} any more, since {self.broken}: connect again"
            )


def printable(command: str) -> str:
    r"""Return a command as a sentence can show it: cut, or as the number of a character.

    Examples
    --------
    >>> printable("\x18")
    '#24'
    """
    if len(command) == 1 and not command.isprintable():
        return f"#{ord(command)}"
    return command if len(command) <= 60 else f"{command[:57]}..."


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
        #: How often `stop` was called.
        self.stops = 0
        try:
            self._conversation.greet()
        except BaseException:
            transport.close()
            raise
        #: Where the link leads, and what the controller answers to ``*IDN?``.
        self.name, self.identity = transport.name, self._conversation.identity

    @property
    def connected(self) -> bool:
        """Whether the link is whole, as far as is known."""
        return self._conversation.broken is None

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
                return whole_number(text, printable(command))
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
                    f"'{printable(command)}' met a stop: {error_sentence(code)}, perhaps by "
                    "somebody else, and to be sure everything was stopped once more",
                    code,
                )
            if code:
                raise ControllerError(
                    f"the controller refused '{printable(command)}': {error_sentence(code)}", code
                )

    def stop(self) -> None:
        """Stop all motion at once, from any thread; never raises.

        The character goes out on the link even while another thread waits for an answer. Where the
        link takes nothing, or is gone, a second connection is tried if there can be one.
        """
        self.stops += 1
        self._conversation.send_stop()

    def close(self) -> None:
        """End the link; nothing moves by it."""
        self._conversation.close()
