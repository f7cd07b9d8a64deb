"""What the error numbers of a GCS controller mean, and how to mend what they are about."""

from types import MappingProxyType

#: Motion was stopped by a command.
STOPPED = 10

#: A clause for each number; the numbers belong to the command set, the words are this project's.
SENTENCES = MappingProxyType(
    {
        1: "it cannot read the command as it is written",
        2: "it does not know the command: its firmware may be older than this one needs",
        3: "the command is too long for it: give a shorter line limit",
        4: "it failed while reading its sensors",
        5: "the axis is not referenced, or its position control is off: switch it on first",
        6: "the gain that was asked for is not one of its gains",
        7: "the position is outside the limits of the axis",
        8: "the speed is outside the limits of the axis",
        9: "the pivot cannot be set while the axes that turn are not at 0",
        10: "motion was stopped by a command",
        14: "there is no such analogue input",
        15: "there is no such axis: compare with those that the controller lists",
        16: "it does not know the stage that was named",
        17: "a value is out of range",
        18: "there is no macro of that name",
        20: "there is no macro of that name",
        22: "an axis was named twice",
        23: "the axis cannot be used in this command",
        24: "the number of values in the command is wrong",
        25: "a value is not a number that it can read",
        26: "a value is missing",
        27: "a soft limit is outside the range of the axis",
        29: "the axis has no motor, or it is not connected",
        31: "the axis has no reference sensor",
        32: "the axis has no limit switch",
        34: "this command is not allowed for the stage that is connected",
        45: "the reference move failed: look whether the stage is free to move",
        46: "the stage's own memory is missing: look at its cable",
        47: "the memory of the stage is empty",
        49: "the move to a limit switch failed",
        50: "it does not reference while referencing is switched off",
        51: "the axis is under control of somebody else, such as a joystick or another program",
        52: "its own parts cannot reach one another",
        53: "a motion is still going on: wait until it has ended",
        54: "it has no such parameter",
        56: "the password for protected settings is wrong",
        57: "there is no such table of the recorder",
        58: "the recorder cannot record that quantity",
        59: "the recorder has no such source for that quantity",
        60: "the parameter is protected: its level of command must be raised first",
        61: "it is setting its zero: wait until that has ended",
        62: "the parameter belongs to an axis that moves along a line",
        63: "it is still starting: wait some seconds",
        64: "the parameter can only be read",
        66: "the voltage is outside the limits of the drive",
        67: "the wave table does not fit its memory",
        69: "the delay of its learning control is too large",
        70: "arrays that belong together have different lengths",
        71: "a waveform of one run cannot be started again before it has ended",
        72: "an analogue input gives the target of the axis: take it away first",
        73: "a waveform is running on the axis: stop it first",
        74: "setting its zero is switched off",
        75: "no wave table was chosen for the axis",
        76: "commands came faster than it could take them",
        77: "not so many samples are recorded yet",
        78: "a table of the recorder is switched off",
        79: "a voltage was asked for while position control is on: switch it off first",
        80: "its memory has failed",
        83: "a joystick is active",
        84: "the motor is off",
        89: "the command is not allowed in the present kind of motion",
        93: "the command is not allowed while the axis moves",
        95: "the parameter cannot be changed in the present state of position control",
        200: "no stage is connected to the axis",
        214: "the position of the axis is not known: reference it",
        215: "the connection to a sensor or a drive may be broken: look at its cable",
        216: "the axis is at a limit switch",
        301: "its buffer for answers is full",
        302: "the voltage is outside the limits of the drive",
        303: "a voltage was asked for while position control is on: switch it off first",
        304: "its buffer for commands is full: it was sent too much at once",
        307: "it waited too long for the rest of a command",
        308: "it ran out of time with what it was doing",
        309: "its memory for macros is full",
        333: "its hardware has failed: read its own messages, and switch it off and on",
        400: "there is no such wave table",
        401: "the wave table has nothing in it",
        402: "it does not know that kind of waveform",
        403: "the waveform is longer than its memory",
        404: "the number of values of the waveform is wrong",
        405: "a value of the waveform is out of range",
        406: "it does not know that way of starting a waveform",
        500: "the emergency stop is pressed: release it when all is safe",
        501: "the emergency stop was pressed: acknowledge it at the controller",
        502: "two sensors of one axis differ too much",
        503: "a switch reports a collision of the stage",
        504: "the axis lags too far behind its target",
        555: "it failed without saying why",
        601: "its memory is full",
        602: "a voltage of its own is wrong",
        603: "it is too hot: switch it off and let it cool",
        604: "the axis is too far from its target",
        606: "an input is out of range",
        1000: "macros start each other too deep",
        1001: "a macro of that name is there already, or another one is being written",
        1002: "no macro is being written",
        1003: "it does not know that function of macros",
        1005: "it is busy, or another program controls it: wait until that ends",
        1008: "a macro is running: stop it first",
    }
)


def error_sentence(code: int) -> str:
    """Return what an error number means.

    Examples
    --------
    >>> error_sentence(7)
    'the position is outside the limits of the axis (error 7)'
    >>> error_sentence(9876)
    'error 9876, which its manual explains'
    """
    words = SENTENCES.get(code)
    if words is None:
        return f"error {code}, which its manual explains"
    return f"{words} (error {code})"
