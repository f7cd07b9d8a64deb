"""Description of the axes of a simulated controller, and reasons of its refusals."""

from dataclasses import dataclass
from enum import IntEnum
from typing import Literal

from flexstage.base.errors import FlexstageError
from flexstage.instruments.protocol import Capability
from flexstage.stage.limits import AxisLimits


class Refusal(IntEnum):
    """Reason why a command is refused.

    The numbers are those of the command set; the names are our own.
    """

    SYNTAX = 1
    UNKNOWN_COMMAND = 2
    TOO_LONG = 3
    SERVO_OFF = 5  # a position was commanded while position control is off
    OUT_OF_LIMITS = 7
    SPEED_OUT_OF_LIMITS = 8
    STOPPED = 10  # motion was stopped by a command
    UNKNOWN_CHANNEL = 14
    UNKNOWN = 15  # no such axis, table or signal
    BAD_VALUE = 17  # a parameter outside its range
    BAD_MACRO_NAME = 18
    UNKNOWN_MACRO = 20
    AXIS_TWICE = 22
    NUMBER_OF_PARAMETERS = 24
    BAD_NUMBER = 25
    SOFT_LIMIT_OUT_OF_RANGE = 27
    NO_REFERENCE_SENSOR = 31
    NO_LIMIT_SWITCH = 32
    NOT_ABLE = 34  # the axis does not support this
    UNKNOWN_PARAMETER = 54
    WRONG_PASSWORD = 56
    UNKNOWN_RECORD_TABLE = 57
    UNKNOWN_RECORD_OPTION = 58
    UNKNOWN_RECORD_SOURCE = 59
    READ_ONLY = 64
    WAVE_RUNNING = 73
    NO_WAVE = 75  # no table selected, or an empty one
    NOT_RECORDED = 77
    SWITCHED_OFF = 84
    VOLTAGE_OUT_OF_LIMITS = 302
    SERVO_ON = 303  # a voltage was commanded under position control
    NO_ROOM_FOR_MACRO = 309
    HARDWARE = 333
    UNKNOWN_WAVE_TABLE = 400
    WAVE_NOT_DEFINED = 401
    UNKNOWN_WAVE_TYPE = 402
    TABLE_FULL = 403
    NUMBER_OF_WAVE_PARAMETERS = 404
    WAVE_OUT_OF_RANGE = 405
    UNKNOWN_START_MODE = 406
    MACROS_TOO_DEEP = 1000
    MACRO_IS_WRITTEN = 1001
    NO_MACRO_IS_WRITTEN = 1002
    UNKNOWN_MACRO_FUNCTION = 1003


class RefusedError(FlexstageError, RuntimeError):
    """A refused command, which has changed nothing."""

    def __init__(self, reason: Refusal) -> None:
        # clients receive the number only
        super().__init__(f"error {reason.value} of the command set: {reason.name}")
        self.reason = reason


def require(holds: object, reason: Refusal) -> None:
    """Refuse a command for a reason, unless a condition is true."""
    if not holds:
        raise RefusedError(reason)


@dataclass(frozen=True, slots=True, kw_only=True)
class AxisDescription:
    """Description of an axis of the device."""

    name: str
    """Its identifier at the controller: ``1``, ``2``."""
    stage_axis: str
    """Its axis of the stage: ``x``, ``y``."""
    kind: Literal["piezo", "screw"]
    """Kind of drive. A piezo axis has a voltage, and is controlled by the sensor of its platform. A
    screw axis is controlled by the turns of its screw; its position is the advance of the screw.
    """
    limits: AxisLimits
    """Limits of its commands."""
    capabilities: frozenset[Capability]
    """Its capabilities."""
    window: float = 0.0
    """On-target window, the largest distance from a target [m]."""
    settle: float = 0.0
    """Settling time within the window [s]."""
