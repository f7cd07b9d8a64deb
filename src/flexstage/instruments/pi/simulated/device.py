"""What a simulated controller says of its axes, and why it refuses a command."""

from dataclasses import dataclass
from enum import IntEnum
from typing import Literal

from flexstage.base.errors import FlexstageError
from flexstage.instruments.protocol import Capability
from flexstage.stage.limits import AxisLimits


class Refusal(IntEnum):
    """Why a command is not carried out.

    What the numbers stand for is fixed by the command set; the names are this project's.
    """

    SYNTAX = 1
    UNKNOWN_COMMAND = 2
    TOO_LONG = 3
    SERVO_OFF = 5  # a position is asked for, and there is no position control on
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
    NOT_ABLE = 34  # the axis cannot do this at all
    UNKNOWN_PARAMETER = 54
    WRONG_PASSWORD = 56
    UNKNOWN_RECORD_TABLE = 57
    UNKNOWN_RECORD_OPTION = 58
    UNKNOWN_RECORD_SOURCE = 59
    READ_ONLY = 64
    WAVE_RUNNING = 73
    NO_WAVE = 75  # no table chosen, or an empty one
    NOT_RECORDED = 77
    SWITCHED_OFF = 84
    VOLTAGE_OUT_OF_LIMITS = 302
    SERVO_ON = 303  # a voltage is asked for under position control
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
    #: Another client holds control. 51 would be closer, but clients read a joystick into it.
    BUSY = 1005


class RefusedError(FlexstageError, RuntimeError):
    """A command is refused; nothing has changed."""

    def __init__(self, reason: Refusal) -> None:
        # clients are told the number alone
        super().__init__(f"error {reason.value} of the command set: {reason.name}")
        self.reason = reason


def require(holds: object, reason: Refusal) -> None:
    """Refuse a command for a reason, unless something holds."""
    if not holds:
        raise RefusedError(reason)


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
