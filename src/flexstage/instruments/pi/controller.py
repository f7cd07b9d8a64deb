"""A PI controller with a stage, as an instrument."""

import time
from collections.abc import Callable, Mapping
from typing import Self
from urllib.parse import urlsplit

from flexstage.base.errors import ControllerError, ModelError, NotConnectedError
from flexstage.instruments.connect import longest_silence, options_of
from flexstage.instruments.pi.axis import PiAxis
from flexstage.instruments.pi.connection import (
    Connection,
    TransferLimits,
    read_profile,
)
from flexstage.instruments.pi.conversation import GcsClient
from flexstage.instruments.pi.discovery import discover
from flexstage.instruments.pi.recorder import PiRecorder
from flexstage.instruments.pi.waves import PiWaves
from flexstage.instruments.protocol import Capability, ChannelMap, Instrument
from flexstage.instruments.transport import (
    DEFAULT_BAUD,
    DEFAULT_PORT,
    GatewayLink,
    SerialLink,
    TcpLink,
    Transport,
)
from flexstage.stage import Stage


class PiController(Instrument):
    """A controller that speaks the General Command Set 2, and the stage at it.

    What it can do follows from the commands and parameters that the controller lists, never from
    its name. Made by `PiController.open`. Only a simulated stage can be struck: its drives are
    taken out for it, and put back before the next motion.

    Validity: written by the published command set and tested against simulated controllers only,
    never against hardware. Axes are referenced by `MotionAxis.reference` only.
    """

    concurrent = True

    def __init__(
        self,
        connection: Connection,
        axes: Mapping[str, PiAxis],
        *,
        recorder: PiRecorder | None,
        waves: PiWaves | None,
        channels: ChannelMap,
        factors: Mapping[int, float],
    ) -> None:
        self._connection, self._axes = connection, dict(axes)
        #: What it says of itself, and the conversation, for what is not offered here.
        self.profile, self.client = connection.profile, connection.client
        self.identity = connection.profile.identity
        self._recorder, self._waves = recorder, waves
        #: Its sensors by what they read, where the controller says so, else by their numbers.
        self.channels = channels
        self._factors = dict(factors)

    @classmethod
    def open(
        cls,
        transport: Transport,
        stage: Stage,
        *,
        axes: Mapping[str, str] | None = None,
        transfer: TransferLimits | None = None,
        timeout: float = 2.0,
        clock: Callable[[], float] = time.monotonic,
        sleep: Callable[[float], object] = time.sleep,
    ) -> Self:
        """Ask a controller what it is and what it can do; nothing moves, nothing is switched.

        `axes` names the controller's axis by the name of the stage's; they are taken in their order
        where not given. The transport is closed when this fails. `timeout` is the longest silence
        before an answer is given up [s].
        """
        client = GcsClient(transport, timeout=timeout, clock=clock)
        try:
            connection = Connection(
                client,
                read_profile(client),
                TransferLimits() if transfer is None else transfer,
                clock=clock,
                sleep=sleep,
            )
            found = discover(connection, stage, axes)
            made = {facts.name: PiAxis(connection, facts) for facts in found.axes}
            numbers = {c.number: c for c in found.channels}
            recorder = waves = None
            if found.recorder is not None:
                recorder = PiRecorder(
                    connection,
                    made,
                    numbers,
                    base_rate_hz=found.base_rate_hz,
                    capacity=found.recorder.capacity,
                    tables=found.recorder.tables,
                )
            if found.waves is not None:
                waves = PiWaves(
                    connection,
                    made,
                    base_rate_hz=found.base_rate_hz,
                    capacity=found.waves.capacity,
                    tables=found.waves.tables,
                    on_start=(lambda: None) if recorder is None else recorder.triggered,
                )
        except BaseException:
            client.close()
            raise
        return cls(
            connection,
            made,
            recorder=recorder,
            waves=waves,
            channels=ChannelMap(
                numbers={c.name: c.number for c in found.channels},
                units={c.name: c.unit for c in found.channels},
            ),
            factors={c.number: c.factor for c in found.channels},
        )

    @property
    def capabilities(self) -> frozenset[Capability]:
        found = set(super().capabilities)
        if self._recorder is not None:
            found.add(Capability.DATA_RECORDER)
        if self._waves is not None:
            found.add(Capability.WAVE_GENERATOR)
        if self._factors and self.profile.knows("TSP?"):
            found.add(Capability.CHANNELS)
        if self._can_strike():
            found.add(Capability.IMPACT)
        return frozenset(found)

    @property
    def axes(self) -> Mapping[str, PiAxis]:
        return self._axes

    @property
    def recorder(self) -> PiRecorder:
        if self._recorder is None:
            raise ModelError("this controller lists no commands of a data recorder")
        return self._recorder

    @property
    def waves(self) -> PiWaves:
        if self._waves is None:
            raise ModelError("this controller lists no commands of a wave generator")
        return self._waves

    def channel(self, number: int) -> float:
        if number not in self._factors or not self.profile.knows("TSP?"):
            raise ModelError(
                f"there is no sensor {number}: they are "
                f"{', '.join(map(str, self._factors)) or 'none'}"
            )
        value = self.client.ask_values("TSP?", [str(number)])[0]
        if not abs(value) < float("inf"):
            raise ControllerError(
                f"sensor {number} gives {value} instead of a reading: look at it and its cable"
            )
        return value * self._factors[number]

    def strike(self, axis: str) -> None:
        if not self._can_strike():
            super().strike(axis)
        if axis not in self._axes:
            raise ModelError(
                f"there is no axis '{axis}': they are {', '.join(map(repr, self._axes))}"
            )
        self._connection.drives_away()
        self._connection.tell(f"IMP {self._axes[axis].facts.identifier}")
        if self._recorder is not None:
            self._recorder.triggered()

    def pause(self, seconds: float) -> None:
        self._connection.pause(seconds)

    def stop(self) -> None:
        self.client.stop()

    def settings(self) -> Mapping[str, str]:
        names = {a.facts.identifier: name for name, a in self._axes.items()}
        return {
            "controller": self.client.identity.strip(),
            "link": self.client.name,
            "axes": ", ".join(f"{name}={identifier}" for identifier, name in names.items()),
            **self._connection.settings(),
        }

    def close(self) -> None:
        try:
            if self.client.connected:
                self._connection.drives_back()
        except (NotConnectedError, ControllerError):
            pass  # the drives are those of a simulation, and the link is ended anyway
        finally:
            self.client.close()

    def __enter__(self) -> Self:
        """Return itself."""
        return self

    def __exit__(self, *_: object) -> None:
        """End the link."""
        self.close()

    def _can_strike(self) -> bool:
        return self.profile.knows("IMP") and self._connection.has_drives


def open_network(
    address: str, stage: Stage, *, axes: Mapping[str, str] | None, timeout: float | None
) -> PiController:
    """Connect to a controller in the network: ``gcs://HOST:PORT``."""
    parts = urlsplit(address.strip())
    options_of(address, parts, ())
    try:
        port = parts.port
    except ValueError as error:
        raise ModelError(
            f"the port of '{address}' must be a number from 1 to 65535, as in gcs://192.168.0.10:"
            f"{DEFAULT_PORT}"
        ) from error
    if not parts.hostname or parts.path.strip("/"):
        raise ModelError(
            f"'{address}' names no host: write gcs://HOST:PORT, as in gcs://127.0.0.1:50000"
        )
    link = TcpLink(parts.hostname, DEFAULT_PORT if port is None else port)
    return PiController.open(link, stage, axes=axes, timeout=longest_silence(timeout))


def open_serial(
    address: str, stage: Stage, *, axes: Mapping[str, str] | None, timeout: float | None
) -> PiController:
    """Connect to a controller at a serial port: ``serial:///dev/ttyUSB0?baud=115200``."""
    parts = urlsplit(address.strip())
    options = options_of(address, parts, ("baud",))
    baud = options.get("baud", str(DEFAULT_BAUD))
    port = parts.netloc or parts.path
    if not port.strip("/") or (parts.netloc and parts.path.strip("/")):
        raise ModelError(f"'{address}' names no port: write serial:///dev/ttyUSB0 or serial://COM3")
    if not baud.isdecimal() or not 300 <= int(baud) <= 12_000_000:
        raise ModelError(f"the baud rate of '{address}' must be 300 to 12000000, got '{baud}'")
    link = SerialLink(port, baud=int(baud))
    return PiController.open(link, stage, axes=axes, timeout=longest_silence(timeout))


def open_gateway(
    gateway: object, stage: Stage, *, axes: Mapping[str, str] | None, timeout: float | None
) -> PiController:
    """Connect to a controller through an object of the user's own."""
    return PiController.open(
        GatewayLink(gateway), stage, axes=axes, timeout=longest_silence(timeout)
    )
