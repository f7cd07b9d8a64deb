r"""Parser of the replies of GCS controllers, with error numbers and units of axes.

Each line of a reply but the last ends with a space and a line feed, the last with a line feed
only. An array is a heading of keys, then rows of numbers.
"""

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from flexstage.base.errors import ControllerError

_KEY = re.compile(r"#\s*([A-Z_]+[0-9]*)\s*=\s*(.*)")
# "nan" as different firmware prints it
_NO_NUMBER = re.compile(r"[+-]?(?:nan(?:\([^)]*\))?|\d*\.?#(?:QNAN|IND|SNAN)\w*)", re.IGNORECASE)
_INFINITE = re.compile(r"([+-]?)(?:inf(?:inity)?|\d*\.?#INF\w*)", re.IGNORECASE)
_NUMBER = re.compile(r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d{1,4})?", re.ASCII)
_EXCERPT = 60


def take_lines(buffer: bytearray) -> list[str]:
    r"""Remove complete lines from the start of a buffer; return them without line feeds.

    Examples
    --------
    >>> buffer = bytearray(b"1=0.5 \n2=0.25\n3=")
    >>> take_lines(buffer), bytes(buffer)
    (['1=0.5 ', '2=0.25'], b'3=')
    """
    end = buffer.rfind(b"\n") + 1
    lines = bytes(buffer[:end]).decode("latin-1").split("\n")[:-1]
    del buffer[:end]
    return [line.rstrip("\r") for line in lines]


def number(text: str, what: str) -> float:
    """Return a number; texts such as ``nan`` are NaN.

    Here and below, `what` is the question, for messages.

    Examples
    --------
    >>> number(" 1.25e1", "POS?"), number("-1.#IND", "POS?")
    (12.5, nan)
    """
    word = text.strip()
    if len(word) <= _EXCERPT and _NUMBER.fullmatch(word):
        return float(word)
    if _NO_NUMBER.fullmatch(word):
        return math.nan
    infinite = _INFINITE.fullmatch(word)
    if infinite:
        return -math.inf if infinite[1] == "-" else math.inf
    raise ControllerError(f"the answer to '{what}' should be a number, got {excerpt(text)}")


def whole_number(text: str, what: str) -> int:
    """Return an integer, decimal or with the prefix ``0x``.

    Examples
    --------
    >>> whole_number("0x10", "#5"), whole_number("8.0", "RTR?")
    (16, 8)
    """
    word = text.strip()
    if re.fullmatch(r"0[xX][0-9a-fA-F]{1,16}", word):
        return int(word, 16)
    if re.fullmatch(r"[+-]?\d{1,15}(?:\.0*)?", word, re.ASCII):
        return int(float(word))
    raise ControllerError(f"the answer to '{what}' should be an integer, got {excerpt(text)}")


def assignments(lines: Sequence[str], names: Sequence[str], what: str) -> list[str]:
    """Return the values of lines ``name=value`` in any order, in the order of the names.

    Examples
    --------
    >>> assignments(["1=0.5 ", "2=0.25"], ["2", "1"], "POS?")
    ['0.25', '0.5']
    """
    values: dict[str, str] = {}
    for line in lines:
        name, equals, value = line.rpartition("=")
        if not equals or name.strip() in values:
            raise ControllerError(_not_an_answer(lines, names, what))
        values[name.strip()] = value.strip()
    if set(values) != set(names):
        raise ControllerError(_not_an_answer(lines, names, what))
    return [values[name] for name in names]


def parse_array(
    lines: Sequence[str], width: int, rows: int, what: str
) -> tuple[NDArray[np.float64], float | None]:
    """Return an array with the rows and columns (`width`) that `what` requested.

    Returns the numbers, shape (columns, rows), NaN where a sensor has none, and the interval
    between rows [s], None where the heading has none.

    Examples
    --------
    >>> text = "# DIM = 2|# SAMPLE_TIME = 0.002|# NDATA = 1|# END_HEADER|0.5 -1.25"
    >>> columns, interval = parse_array(text.split("|"), 2, 1, "DRR?")
    >>> columns.tolist(), interval
    ([[0.5], [-1.25]], 0.002)
    """
    keys: dict[str, str] = {}
    body = 0
    while body < len(lines) and lines[body].startswith("#"):
        match = _KEY.match(lines[body].strip())
        if match:
            keys[match[1]] = match[2].strip()
        body += 1
    interval = number(keys["SAMPLE_TIME"], what) if "SAMPLE_TIME" in keys else None
    values = _columns(lines[body:], keys.get("SEPARATOR", "32"), what)
    if values.shape != (rows, width):
        raise ControllerError(
            f"'{what}' requested {rows} rows of {width} columns, and the answer has "
            f"{values.shape[0]} rows of {values.shape[1]}: it is incomplete, or belongs to another "
            "question"
        )
    return np.ascontiguousarray(values.T), interval


def _columns(lines: Sequence[str], separator: str, what: str) -> NDArray[np.float64]:
    separators = {"32": None, "9": "\t", "44": ",", "59": ";"}
    if separator not in separators:
        raise ControllerError(
            f"the separator of the answer to '{what}' is character {excerpt(separator)}, but must "
            "be space, tab, comma or semicolon"
        )
    words = [line.split(separators[separator]) for line in lines]
    if len({len(row) for row in words}) > 1:
        raise ControllerError(
            f"the rows of the answer to '{what}' differ in length: the answer is incomplete"
        )
    try:
        # "1_000" and digits of other scripts are numbers to Python
        plain = not any("_" in line or not line.isascii() for line in lines)
        rows = [[float(word) if plain else number(word, what) for word in row] for row in words]
    except ValueError:
        rows = [[number(word, what) for word in row] for row in words]
    return np.array(rows, dtype=np.float64).reshape(len(rows), len(rows[0]) if rows else 0)


def excerpt(text: str) -> str:
    """Return a text for a message, truncated if it is long.

    Examples
    --------
    >>> excerpt("a" * 70)[-8:]
    "aaaa'..."
    """
    return ascii(text[:_EXCERPT]) + ("..." if len(text) > _EXCERPT else "")


def _not_an_answer(lines: Sequence[str], names: Sequence[str], what: str) -> str:
    return (
        f"the answer to '{what}' should have one value for each of {', '.join(names)}, got "
        f"{excerpt(' | '.join(lines))}: another program may be using this link"
    )


#: Motion was stopped by a command.
STOPPED = 10
#: Descriptions of error numbers; the numbers are those of the command set, the words our own.
SENTENCES = MappingProxyType(
    {
        1: "it cannot parse the command",
        2: "unknown command: its firmware may be too old",
        3: "the command is too long: use a shorter line limit",
        4: "it failed to read its sensors",
        5: "the axis is not referenced, or its position control is off: reference it or switch the "
        "control on first",
        6: "it does not have the requested gain",
        7: "the position is outside the limits of the axis",
        8: "the speed is outside the limits of the axis",
        9: "the pivot cannot be set while the rotary axes are not at 0",
        10: "motion was stopped by a command",
        14: "there is no such analogue input",
        15: "there is no such axis: compare with the axes of the controller",
        16: "unknown stage",
        17: "a value is out of range",
        18: "there is no macro of that name",
        20: "there is no macro of that name",
        22: "an axis was named twice",
        23: "the axis cannot be used in this command",
        24: "the number of values in the command is wrong",
        25: "a value is not a valid number",
        26: "a value is missing",
        27: "a soft limit is outside the range of the axis",
        29: "the axis has no motor, or it is not connected",
        31: "the axis has no reference sensor",
        32: "the axis has no limit switch",
        34: "this command is not allowed for the connected stage",
        45: "the reference move failed: check that the stage is free to move",
        46: "the memory of the stage is missing: check its cable",
        47: "the memory of the stage is empty",
        49: "the move to a limit switch failed",
        50: "referencing is switched off",
        51: "the axis is under control of a joystick or another program",
        52: "its internal communication failed",
        53: "a motion is still in progress: wait for its end",
        54: "it has no such parameter",
        56: "the password for protected settings is wrong",
        57: "there is no such table of the recorder",
        58: "the recorder cannot record that quantity",
        59: "the recorder has no such source for that quantity",
        60: "the parameter is protected: raise the command level first",
        61: "automatic zeroing is in progress: wait for its end",
        62: "the parameter belongs to a linear axis",
        63: "it is still starting: wait a few seconds",
        64: "the parameter can only be read",
        66: "the voltage is outside the limits of the drive",
        67: "the wave table does not fit into its memory",
        69: "the delay of its learning control is too large",
        70: "related arrays have different lengths",
        71: "a single-run waveform cannot be restarted before its end",
        72: "an analogue input is the target of the axis: disconnect it first",
        73: "a waveform is running on the axis: stop it first",
        74: "automatic zeroing is switched off",
        75: "no wave table is selected for the axis",
        76: "commands arrived faster than it can process them",
        77: "not enough samples are recorded yet",
        78: "a table of the recorder is switched off",
        79: "a voltage was commanded while position control is on: switch it off first",
        80: "its memory has failed",
        83: "a joystick is active",
        84: "the motor is off",
        89: "the command is not allowed in the present motion mode",
        93: "the command is not allowed while the axis moves",
        95: "the parameter cannot be changed in the present state of position control",
        200: "the axis has no connected stage",
        214: "the position of the axis is unknown: reference it",
        215: "the connection to a sensor or a drive may be broken: check its cable",
        216: "the axis is at a limit switch",
        301: "its buffer for answers is full",
        302: "the voltage is outside the limits of the drive",
        303: "a voltage was commanded while position control is on: switch it off first",
        304: "its command buffer is full: too much was sent at once",
        307: "timeout while it received a command",
        308: "timeout of an operation",
        309: "its memory for macros is full",
        333: "hardware failure: read its messages, and switch it off and on",
        400: "there is no such wave table",
        401: "the wave table is empty",
        402: "unknown kind of waveform",
        403: "the waveform is longer than its memory",
        404: "the number of values of the waveform is wrong",
        405: "a value of the waveform is out of range",
        406: "unknown start mode of a waveform",
        500: "the emergency stop is pressed: release it when it is safe to do so",
        501: "the emergency stop was pressed: acknowledge it at the controller",
        502: "two sensors of one axis differ too much",
        503: "a switch reports a collision of the stage",
        504: "the axis lags too far behind its target",
        555: "unspecified failure",
        601: "its memory is full",
        602: "an internal voltage is wrong",
        603: "it is too hot: switch it off and let it cool down",
        604: "the axis is too far from its target",
        606: "an input is out of range",
        1000: "macros are nested too deeply",
        1001: "a macro of that name exists, or another one is being written",
        1002: "no macro is being written",
        1003: "unknown function of macros",
        1005: "it is busy, or another program has control: wait for its end",
        1008: "a macro is running: stop it first",
    }
)


def error_sentence(code: int) -> str:
    """Return the description of an error number.

    Examples
    --------
    >>> error_sentence(7)
    'the position is outside the limits of the axis (error 7)'
    >>> error_sentence(9876)
    'error 9876: see the manual of the controller'
    """
    words = SENTENCES.get(code)
    if words is None:
        return f"error {code}: see the manual of the controller"
    return f"{words} (error {code})"


Range = tuple[float, float]

#: Metres per unit of length of controllers.
METRES = MappingProxyType(
    {
        "m": 1.0,
        "mm": 1e-3,
        "um": 1e-6,
        "\N{MICRO SIGN}m": 1e-6,
        "\N{GREEK SMALL LETTER MU}m": 1e-6,
        "micron": 1e-6,
        "microns": 1e-6,
        "micrometer": 1e-6,
        "nm": 1e-9,
    }
)
_TURNS = ("deg", "degree", "degrees", "\N{DEGREE SIGN}", "rad", "mrad", "urad", "arcsec")


@dataclass(frozen=True, slots=True, kw_only=True)
class WireUnit:
    """A unit of a controller.

    Examples
    --------
    >>> um = WireUnit(factor=1e-6, decimals=6)
    >>> um.text(12.5e-6), um.text(99.9999996e-6, (0.0, 99.9999996e-6))
    ('12.5', '99.999999')
    """

    factor: float
    """SI value of one unit."""
    decimals: int
    """Number of transmitted decimals."""

    def text(self, value: float, bounds: Range | None = None) -> str:
        """Return a value [SI] as text for the controller; rounding stays within the bounds."""
        return self.texts(np.array([value]), bounds)[0]

    def texts(self, values: NDArray[np.float64], bounds: Range | None = None) -> list[str]:
        """Return values [SI], shape (n,), as text: no exponents, no trailing zeros."""
        scale = 10.0**self.decimals
        steps = np.round(np.asarray(values, dtype=np.float64) / self.factor * scale)
        if bounds is not None:
            # bounds within a rounding error of a transmitted step are on it
            low = math.ceil(bounds[0] / self.factor * scale - 1e-3)
            high = math.floor(bounds[1] / self.factor * scale + 1e-3)
            steps = np.clip(steps, low, high) if low <= high else steps
        pattern = f"%.{self.decimals}f"
        texts = [(pattern % v).rstrip("0").rstrip(".") for v in (steps / scale).tolist()]
        return ["0" if text in ("-0", "") else text for text in texts]


#: Voltages, to a microvolt.
VOLTS = WireUnit(factor=1.0, decimals=6)


def axis_unit(text: str, axis: str, name: str) -> WireUnit:
    """Return the unit of an axis from its answer to ``PUN?``, with a resolution of a picometre.

    Examples
    --------
    >>> axis_unit("UM", "1", "x").factor
    1e-06
    """
    word = text.strip().lower()
    # a micro sign arrives as one byte, or as two bytes of UTF-8 read as latin-1
    factor = METRES.get(word.replace("\N{LATIN SMALL LETTER A WITH CIRCUMFLEX}", ""))
    if factor is None:
        reason = "it is a rotary axis" if word in _TURNS else "this is not a known unit of length"
        raise ControllerError(
            f"the unit of axis '{axis}' of the controller is {excerpt(text)}: {reason}, but axis "
            f"'{name}' of the stage is linear; name the correct one with axes={{...}}"
        )
    return WireUnit(factor=factor, decimals=round(12.0 + math.log10(factor)))
