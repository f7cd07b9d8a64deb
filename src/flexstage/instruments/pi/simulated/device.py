"""What a simulated controller says of its axes, and why it refuses a command.

A server of commands turns the reason of a refusal into a number of its protocol.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from enum import Enum, auto
from typing import Literal, TypeVar

from flexstage.errors import FlexstageError
from flexstage.instruments.protocol import Capability
from flexstage.stage.limits import AxisLimits

T = TypeVar("T")


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


def renamed(held: Mapping[str, T], names: Mapping[str, str]) -> dict[str, T]:
    """Return what is held of axes under their new names; those that get none keep theirs."""
    return {names.get(name, name): value for name, value in held.items()}
