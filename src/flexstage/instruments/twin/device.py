"""What a server of commands needs of a simulated controller, whatever protocol it speaks.

Everything is SI and in simulated time. A refusal is a `RefusedError` with its reason; the server
turns the reason into a number of its protocol. Nothing else is raised for what a client says.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import Enum, auto
from typing import Literal, Protocol

from flexstage.errors import FlexstageError
from flexstage.instruments.limits import AxisLimits
from flexstage.instruments.protocol import Capability, Identity
from flexstage.instruments.twin.device_motion import MotionDevice
from flexstage.instruments.twin.device_recorder import RecordDevice
from flexstage.instruments.twin.device_waves import WaveDevice


class Refusal(Enum):
    """Why a device does not do what it is told."""

    OUT_OF_LIMITS = auto()
    SERVO_OFF = auto()  # a position is asked for, and there is no position control on
    SERVO_ON = auto()  # a voltage is asked for under position control
    SPEED_OUT_OF_LIMITS = auto()
    WAVE_RUNNING = auto()
    NO_WAVE = auto()  # no table chosen, or an empty one
    TABLE_FULL = auto()
    BAD_VALUE = auto()  # a parameter outside its range
    UNKNOWN = auto()  # no such axis, channel, table or signal
    NOT_ABLE = auto()  # the axis cannot do this at all
    STOPPED = auto()  # motion was stopped by a command


class RefusedError(FlexstageError, RuntimeError):
    """A device refuses a command; nothing has changed."""

    def __init__(self, reason: Refusal, message: str) -> None:
        super().__init__(message)
        self.reason = reason


@dataclass(frozen=True, slots=True, kw_only=True)
class AxisDescription:
    """What an axis of the device is."""

    name: str
    """Its identifier at the controller: ``1``, ``2``."""
    stage_axis: str
    """The axis of the stage that it moves: ``x``, ``y``."""
    kind: Literal["piezo", "screw"]
    """A piezo axis is controlled by its platform's sensor and has a voltage; a screw axis by the
    turns of its screw, and its position is the advance of the screw.
    """
    limits: AxisLimits
    """What it accepts."""
    capabilities: frozenset[Capability]
    """What it can do."""
    window: float = 0.0
    """Largest distance from a target at which it counts as reached [m]."""
    settle: float = 0.0
    """How long it must be within it [s]."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ChannelDescription:
    """A sensor of the device."""

    number: int
    """Its number, from 1; the first ones are the sensors of the axes, in their order."""
    name: str
    """What it reads: ``x``, ``y``, then ``across``, ``vertical``, ``roll``, ``pitch``, ``yaw`` of
    each axis as ``x.across`` and so on.
    """
    unit: str
    """``m`` or ``rad``."""


class Device(MotionDevice, WaveDevice, RecordDevice, Protocol):
    """A controller with a stage, in simulated time."""

    @property
    def identity(self) -> Identity:
        """What it is."""
        ...

    @property
    def axes(self) -> Mapping[str, AxisDescription]:
        """Its axes by identifier."""
        ...

    @property
    def channels(self) -> Sequence[ChannelDescription]:
        """Its sensors, in the order of their numbers."""
        ...

    @property
    def sample_rate_hz(self) -> float:
        """Rate of its loop [Hz]."""
        ...

    @property
    def now(self) -> float:
        """Simulated time since it was switched on [s]."""
        ...

    def advance(self, seconds: float) -> None:
        """Let simulated time pass, rounded to whole samples; the rest is kept."""
        ...

    def reboot(self) -> None:
        """Switch off and on: control off, tables and settings as delivered, the stage relaxed."""
        ...

    def drives_removed(self) -> bool:
        """Say whether the drives are taken out, so that the stage can be struck."""
        ...

    def remove_drives(self, removed: bool) -> None:
        """Take the drives out, or put them back; the stage must be at rest and control off."""
        ...

    def strike(self, axis: str) -> None:
        """Strike the stage with a hammer; an armed recorder starts a little before the blow."""
        ...
