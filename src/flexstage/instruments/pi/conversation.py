"""Communication with a GCS controller: commands, questions, errors and stops."""

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

#: The single character that stops all axes, without a line feed.
STOP_ALL = b"\x18"
#: Longest wait of a stop for a command that is being sent; then it uses a second link [s].
_STOP_PATIENCE = 0.1
#: Largest size of a reply [bytes].
_LARGEST = 64 * 2**20


class Conversation:
    """Questions and answers of one thread at a time; other threads may call `send_stop` only."""

    def __init__(self, transport: Transport, timeout: float, clock: Callable[[], float]) -> None:
        self._transport = transport
        #: Name of the remote end; longest time without an answer [s].
        self.name, self.timeout = transport.name, timeout
        self._clock = clock
        self._sending = threading.Lock()
        self._buffer = bytearray()
        self._lines: list[str] = []
        #: Reason why the link was abandoned; None while it is intact.
        self.broken: str | None = None
        #: Numbers of stops that were sent, and whose error was cleared.
        self._stops_sent = self._stops_settled = 0
        #: A question whose answer is pending.
        self._waiting: str | None = None
        #: Questions with a constant answer.
        self._known: dict[str, str] = {}
        #: Answer to ``*IDN?``.
        self.identity = ""

    def send_stop(self) -> None:
        """Stop all motion, over a second link if the first one is blocked; never raises."""
        try:
            self._send_stop()
        finally:
            self._stops_sent += 1

    def _send_stop(self) -> None:
        # no error of a link may prevent a stop
        if self._sending.acquire(timeout=_STOP_PATIENCE):
            try:
                with contextlib.suppress(Exception):
                    self._transport.send(STOP_ALL)  # an abandoned link is closed, and raises
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
        """Disconnect."""
        self.broken = self.broken or "it was closed"
        self._transport.close()

    def greet(self) -> None:
        """Read the identity, and clear errors of earlier sessions."""
        identity = self.ask("*IDN?", self.timeout)
        if len(identity) != 1 or not identity[0].strip().isprintable() or not identity[0].strip():
            raise ControllerError(
                f"{self.name} answers {excerpt(' | '.join(identity))} to '*IDN?', so it is not a "
                "GCS controller: check the address, or the rate of the serial port"
            )
        self.identity = identity[0]
        self._known = {"*IDN?": self.identity}
        syntax = self.ask("CSV?", self.timeout)
        if not 2.0 <= number(syntax[0], "CSV?") < 3.0:
            raise ControllerError(
                f"{self.name} has version {excerpt(syntax[0])} of the command set, but version 2 "
                "is required"
            )
        self._known["CSV?"] = syntax[0]
        self.query_error("ERR?")

    def settle(self) -> None:
        """Clear the error of a stop, so that it is not attributed to a later command."""
        self._require_link()
        if self._waiting is not None or self._lines or self._buffer:
            # an exchange was interrupted, as by Ctrl-C: its answer may still arrive
            self.put_in_step(self._waiting or "")
        if self._stops_settled != self._stops_sent:
            self._stops_settled = self._stops_sent
            self.query_error("ERR?")

    def ask(self, command: str, timeout: float) -> list[str]:
        """Ask a question; the timeout is the longest silence [s]."""
        data = command.encode("ascii")
        self._send(data if len(command) == 1 else data + b"\n", command)
        try:
            return self._reply(timeout)
        except NoAnswerError:
            self.put_in_step(command)
        # a controller does not answer a question that it refuses
        code = self.query_error(command)
        if code:
            raise ControllerError(
                f"the controller refused '{printable(command)}': {error_sentence(code)}", code
            )
        raise NoAnswerError(
            f"{self.name} did not answer '{printable(command)}' within {timeout:g} s; other "
            "questions are answered"
        )

    def tell(self, command: str) -> int:
        """Send a command; return the number of its error, 0 for none."""
        self._send(command.encode("ascii") + b"\nERR?\n", "ERR?")
        return self._error_code(command)

    def query_error(self, command: str) -> int:
        """Read the latest error, 0 for none; messages attribute it to the command."""
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
        """Return the lines of one reply; the timeout is the longest silence within it."""
        reply: list[str] = []
        size = 0
        while True:
            while self._lines:
                line = self._lines.pop(0)
                size += 1 + len(line)
                if size > _LARGEST:
                    raise self._break(f"{self.name} sends an endless answer")
                if not line.endswith(" "):
                    self._waiting = None
                    return [*reply, line]
                reply.append(line[:-1])
            self._receive(timeout)
            if size + len(self._buffer) > _LARGEST:
                raise self._break(f"{self.name} sends an endless answer")

    def _receive(self, timeout: float) -> None:
        try:
            data = self._transport.receive(timeout)
        except NotConnectedError as error:
            self._break(str(error))
            raise
        if not data:
            raise NoAnswerError(f"no data from {self.name}")
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
        """Synchronise by a question with a constant answer, or abandon the link."""
        known = {q: a for q, a in self._known.items() if q != command}
        if not known:
            raise self._break(f"{self.name} does not answer '{printable(command)}'")
        question, answer = next(iter(known.items()))
        self._send(question.encode("ascii") + b"\n", question)
        end = self._clock() + self.timeout
        try:
            while True:
                while self._lines:
                    # the rest of an interrupted line may precede it
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
        return NotConnectedError(f"the connection was closed, since {why}: connect again")

    def _require_link(self) -> None:
        if self.broken is not None:
            raise NotConnectedError(
                f"the connection to {self.name} is closed, since {self.broken}: connect again"
            )


def printable(command: str) -> str:
    r"""Return a command for a message: truncated, or as the number of a character.

    Examples
    --------
    >>> printable("\x18")
    '#24'
    """
    if len(command) == 1 and not command.isprintable():
        return f"#{ord(command)}"
    return command if len(command) <= 60 else f"{command[:57]}..."


class GcsClient:
    """Client of a controller with the General Command Set, version 2.

    A late answer is never taken for that to a later question: after a timeout the link is
    synchronised by a question with a known answer, and closed if that fails. Any thread may ask;
    there is one exchange at a time.

    `timeout` is the longest time without an answer [s]. Connecting sends only ``*IDN?``, ``CSV?``
    and ``ERR?``.
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
        #: Number of calls of `stop`.
        self.stops = 0
        try:
            self._conversation.greet()
        except BaseException:
            transport.close()
            raise
        #: Name of the remote end, and its answer to ``*IDN?``.
        self.name, self.identity = transport.name, self._conversation.identity

    @property
    def connected(self) -> bool:
        """Whether the link is intact, as far as is known."""
        return self._conversation.broken is None

    def ask(self, command: str, *, timeout: float | None = None) -> list[str]:
        """Ask a question; return the lines of its answer, at least one.

        The question has no line feed, and the lines of the answer no trailing spaces. After a
        `NoAnswerError` the link is synchronised again.
        """
        with self._lock:
            self._conversation.settle()
            return self._conversation.ask(
                command, self._conversation.timeout if timeout is None else timeout
            )

    def ask_values(self, command: str, names: Sequence[str]) -> list[float]:
        """Ask for one number for each name, in their order; NaN where a sensor has none.

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
        """Ask for one integer; `base` is 16 for hexadecimal digits without a prefix."""
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
        """Send a command, and check its error.

        After a `NoAnswerError` or `NotConnectedError` the command may have been carried out. If the
        link was lost, a stop is sent over a second link where possible.
        """
        with self._lock:
            self._conversation.settle()
            try:
                code = self._conversation.tell(command)
            except NotConnectedError:
                # the command may have been carried out, and its effect cannot be observed
                self.stop()
                raise
            if code == STOPPED:
                # the stage was stopped, and this command may have arrived after the stop
                self.stop()
                raise ControllerError(
                    f"'{printable(command)}' was interrupted by a stop: {error_sentence(code)}, "
                    "possibly from another program; all axes were stopped again for safety",
                    code,
                )
            if code:
                raise ControllerError(
                    f"the controller refused '{printable(command)}': {error_sentence(code)}", code
                )

    def stop(self) -> None:
        """Stop all motion immediately, from any thread; never raises.

        The character is sent even while another thread waits for an answer. If the link is blocked
        or lost, a second connection is tried where possible.
        """
        self.stops += 1
        self._conversation.send_stop()

    def close(self) -> None:
        """End the link; nothing moves by it."""
        self._conversation.close()
