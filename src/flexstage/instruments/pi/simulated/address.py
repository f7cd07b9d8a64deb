"""A simulated controller by its address, in this process."""

import threading
from collections.abc import Mapping
from urllib.parse import urlsplit

from flexstage.designs import design
from flexstage.errors import ModelError, NotConnectedError
from flexstage.instruments.connect import (
    flag,
    longest_silence,
    number,
    one_of,
    options_of,
    whole_number,
)
from flexstage.instruments.pi.connection import TransferLimits
from flexstage.instruments.pi.controller import PiController
from flexstage.instruments.pi.simulated.interpreter import Interpreter
from flexstage.instruments.pi.simulated.request import TwinRequest
from flexstage.instruments.pi.simulated.server import STOP, ServerSession
from flexstage.instruments.pi.simulated.twin import simulated_controller
from flexstage.instruments.transport import InProcess
from flexstage.stage import Stage

_OPTIONS = ("seed", "model", "servo_rate", "amplifier", "fast", "scatter", "quiet", "serial_number")
#: Lines that a simulation takes are longer than those of a controller.
_LONG_LINES = 16384
_LONGEST_WAIT = 60.0


def open_twin(
    address: str, stage: Stage | None, *, axes: Mapping[str, str] | None, timeout: float | None
) -> PiController:
    """Connect to a controller that is simulated here: ``twin://NAME?seed=3&model=lumped``."""
    parts = urlsplit(address.strip())
    options = options_of(address, parts, _OPTIONS)
    name = parts.netloc + parts.path
    if stage is None:
        if not name:
            raise ModelError(
                f"'{address}' names no stage: write twin://vgtu-piezo, or give the stage"
            )
        stage = design(name)
    elif name not in ("", stage.name):
        raise ModelError(
            f"'{address}' is a twin of '{name}', and the stage is '{stage.name}': leave the name "
            "out, as in twin://?seed=3"
        )
    silence = longest_silence(timeout, _LONGEST_WAIT)
    request = TwinRequest(
        seed=whole_number(options, "seed", 0, address),
        model=one_of(options, "model", ("lumped", "superelement"), address),  # pyright: ignore[reportArgumentType]
        servo_rate=number(options, "servo_rate", 10e3, address),
        amplifier=one_of(options, "amplifier", ("voltage", "charge"), address),  # pyright: ignore[reportArgumentType]
        fast=flag(options, "fast", True, address),
        identity="flexstage",
        serial_number=options.get("serial_number", ""),
    )
    controller = simulated_controller(
        stage,
        request,
        quiet=flag(options, "quiet", False, address),
        scatter=flag(options, "scatter", True, address),
    )
    controller.pace.start()
    conversation = Loopback(controller, ends_time=True)
    link = InProcess(conversation, name=f"twin of {stage.name}")
    transfer = TransferLimits(line_limit=_LONG_LINES)
    return PiController.open(link, stage, axes=axes, timeout=silence, transfer=transfer)


class Loopback:
    """Takes what a client sends, and has the answer ready at once.

    Any thread may send; a stop (character 24) does not wait for what another thread does. With
    `ends_time` the clock of the controller ends with the conversation.
    """

    def __init__(self, interpreter: Interpreter, *, ends_time: bool = False) -> None:
        self._interpreter, self._ends_time = interpreter, ends_time
        self._session = ServerSession(interpreter)
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
        if STOP in data:
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
            if self._ends_time:
                self._interpreter.pace.close()

    def _open(self) -> None:
        if self._closed:
            raise NotConnectedError("the conversation with the simulated controller was closed")
