"""A PI controller with a stage, as an instrument."""

import time
from collections.abc import Callable, Mapping
from typing import Self

from flexstage.errors import ControllerError, ModelError, NotConnectedError
from flexstage.instruments.description import ChannelMap
from flexstage.instruments.gcs.axis import PiAxis
from flexstage.instruments.gcs.client import GcsClient
from flexstage.instruments.gcs.core import Core
from flexstage.instruments.gcs.profile import Profile, Wire, read_profile
from flexstage.instruments.gcs.recorder import PiRecorder
from flexstage.instruments.gcs.survey import survey
from flexstage.instruments.gcs.transport import Transport
from flexstage.instruments.gcs.waves import PiWaves
from flexstage.instruments.protocol import Capability, Identity
from flexstage.stage import Stage


class PiController:
    """A controller that speaks the General Command Set 2, and the stage at it.

    What it can do follows from the commands and parameters that the controller lists, never from
    its name. Made by `PiController.open`.

    Notes
    -----
    Validity: written by the published command set and tested against simulated controllers only,
    never against hardware. Axes that need a reference move are not referenced from here.
    """

    def __init__(
        self,
        core: Core,
        axes: Mapping[str, PiAxis],
        *,
        recorder: PiRecorder | None,
        waves: PiWaves | None,
        channels: ChannelMap,
        factors: Mapping[int, float],
    ) -> None:
        self._core, self._axes = core, dict(axes)
        self._recorder, self._waves = recorder, waves
        self._channels, self._factors = channels, dict(factors)

    @classmethod
    def open(
        cls,
        transport: Transport,
        stage: Stage,
        *,
        axes: Mapping[str, str] | None = None,
        wire: Wire | None = None,
        timeout: float = 2.0,
        clock: Callable[[], float] = time.monotonic,
        sleep: Callable[[float], object] = time.sleep,
    ) -> Self:
        """Ask a controller what it is and what it can do; nothing moves, nothing is switched."""
        client = GcsClient(transport, timeout=timeout, clock=clock)
        try:
            core = Core(
                client,
                read_profile(client),
                Wire() if wire is None else wire,
                clock=clock,
                sleep=sleep,
            )
            found = survey(core, stage, axes)
            made = {facts.name: PiAxis(core, facts) for facts in found.axes}
            numbers = {c.number: c for c in found.channels}
            recorder = waves = None
            if found.recorder is not None:
                recorder = PiRecorder(
                    core,
                    made,
                    numbers,
                    base_rate_hz=found.base_rate_hz,
                    capacity=found.recorder.capacity,
                    tables=found.recorder.tables,
                )
            if found.waves is not None:
                waves = PiWaves(
                    core,
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
            core,
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
    def identity(self) -> Identity:
        """What it is."""
        return self._core.profile.identity

    @property
    def profile(self) -> Profile:
        """What it says of itself."""
        return self._core.profile

    @property
    def client(self) -> GcsClient:
        """The conversation, for what is not offered here."""
        return self._core.client

    @property
    def capabilities(self) -> frozenset[Capability]:
        """What it can do."""
        found: set[Capability] = set()
        for axis in self._axes.values():
            found |= axis.capabilities
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
        """Its axes by the names of the stage's axes."""
        return self._axes

    @property
    def channels(self) -> ChannelMap:
        """Its sensors by what they read, where the controller says so, else by their numbers."""
        return self._channels

    @property
    def recorder(self) -> PiRecorder:
        """Its recorder."""
        if self._recorder is None:
            raise ModelError("this controller lists no commands of a data recorder")
        return self._recorder

    @property
    def waves(self) -> PiWaves:
        """Its wave generator."""
        if self._waves is None:
            raise ModelError("this controller lists no commands of a wave generator")
        return self._waves

    def channel(self, number: int) -> float:
        """Return what a sensor reads now."""
        if number not in self._factors or not self.profile.knows("TSP?"):
            raise ModelError(
                f"there is no sensor {number}: they are "
                f"{', '.join(map(str, self._factors)) or 'none'}"
            )
        value = self._core.client.ask_values("TSP?", [str(number)])[0]
        if not abs(value) < float("inf"):
            raise ControllerError(
                f"sensor {number} gives {value} instead of a reading: look at it and its cable"
            )
        return value * self._factors[number]

    def strike(self, axis: str) -> None:
        """Strike a simulated stage along an axis with a hammer.

        Its drives are taken out for it, and put back before the next motion.
        """
        if not self._can_strike():
            raise ModelError(
                "this controller cannot strike the stage: strike it by hand, and record it"
            )
        if axis not in self._axes:
            raise ModelError(
                f"there is no axis '{axis}': they are {', '.join(map(repr, self._axes))}"
            )
        self._core.drives_away()
        self._core.tell(f"IMP {self._axes[axis].facts.identifier}")
        if self._recorder is not None:
            self._recorder.triggered()

    def pause(self, seconds: float) -> None:
        """Let time pass."""
        self._core.pause(seconds)

    def stop(self) -> None:
        """Stop all motion, from any thread; never raises."""
        self._core.client.stop()

    def check_state(self) -> None:
        """See that the controller still has what was set here."""
        self._core.check_state()

    def reconnect(self) -> None:
        """Open a lost link again, where there is still the same controller in the same state."""
        self._core.client.reconnect()
        self._core.check_state()

    def settings(self) -> Mapping[str, str]:
        """Return what was set, as text for the record; nothing is asked for it."""
        names = {a.facts.identifier: name for name, a in self._axes.items()}
        return {
            "controller": self._core.client.identity.strip(),
            "link": self._core.client.name,
            "axes": ", ".join(f"{name}={identifier}" for identifier, name in names.items()),
            **self._core.settings(),
        }

    def close(self) -> None:
        """End the link; nothing moves by it."""
        try:
            if self._core.client.connected:
                self._core.drives_back()
        except (NotConnectedError, ControllerError):
            pass  # the drives are those of a simulation, and the link is ended anyway
        finally:
            self._core.client.close()

    def __enter__(self) -> Self:
        """Return itself."""
        return self

    def __exit__(self, *_: object) -> None:
        """End the link."""
        self.close()

    def _can_strike(self) -> bool:
        return self.profile.knows("IMP") and self._core.has_drives
