"""Error numbers of a GCS controller, and which of them a refusal of the device becomes."""

from types import MappingProxyType

from flexstage.instruments.pi.simulated.device import Refusal

# What the numbers stand for is fixed by the command set; the names are this project's.
NO_ERROR = 0
SYNTAX = 1
UNKNOWN_COMMAND = 2
TOO_LONG = 3
SERVO_IS_OFF = 5
OUT_OF_LIMITS = 7
SPEED_OUT_OF_LIMITS = 8
STOPPED = 10
UNKNOWN_CHANNEL = 14
UNKNOWN_AXIS = 15
OUT_OF_RANGE = 17
BAD_MACRO_NAME = 18
UNKNOWN_MACRO = 20
AXIS_TWICE = 22
BAD_AXIS_NAME = 23
NUMBER_OF_PARAMETERS = 24
BAD_NUMBER = 25
SOFT_LIMIT_OUT_OF_RANGE = 27
NO_REFERENCE_SENSOR = 31
NO_LIMIT_SWITCH = 32
NOT_POSSIBLE = 34
UNKNOWN_PARAMETER = 54
WRONG_PASSWORD = 56
UNKNOWN_RECORD_TABLE = 57
UNKNOWN_RECORD_OPTION = 58
UNKNOWN_RECORD_SOURCE = 59
READ_ONLY = 64
WAVE_RUNNING = 73
NO_WAVE_CHOSEN = 75
NOT_RECORDED = 77
SWITCHED_OFF = 84
VOLTAGE_OUT_OF_LIMITS = 302
SERVO_IS_ON = 303
NO_ROOM_FOR_MACRO = 309
HARDWARE = 333
UNKNOWN_WAVE_TABLE = 400
WAVE_NOT_DEFINED = 401
UNKNOWN_WAVE_TYPE = 402
WAVE_TOO_LONG = 403
NUMBER_OF_WAVE_PARAMETERS = 404
WAVE_OUT_OF_RANGE = 405
UNKNOWN_START_MODE = 406
MACROS_TOO_DEEP = 1000
MACRO_IS_WRITTEN = 1001
NO_MACRO_IS_WRITTEN = 1002
UNKNOWN_MACRO_FUNCTION = 1003
#: Busy: another client holds control. 51 would be closer, but clients read a joystick into it.
BUSY = 1005

#: The number that a client reads after a refusal of the device.
CODES = MappingProxyType(
    {
        Refusal.OUT_OF_LIMITS: OUT_OF_LIMITS,
        Refusal.SERVO_OFF: SERVO_IS_OFF,
        Refusal.SERVO_ON: SERVO_IS_ON,
        Refusal.SPEED_OUT_OF_LIMITS: SPEED_OUT_OF_LIMITS,
        Refusal.WAVE_RUNNING: WAVE_RUNNING,
        Refusal.NO_WAVE: NO_WAVE_CHOSEN,
        Refusal.TABLE_FULL: WAVE_TOO_LONG,
        Refusal.BAD_VALUE: OUT_OF_RANGE,
        Refusal.UNKNOWN: UNKNOWN_AXIS,
        Refusal.NOT_ABLE: NOT_POSSIBLE,
        Refusal.STOPPED: STOPPED,
    }
)


class GcsError(Exception):
    """A command that is not carried out; nothing has changed."""

    def __init__(self, code: int) -> None:
        super().__init__(f"error {code} of the command set")
        self.code = code
