"""Segments of a wave table as the command ``WAV`` describes them.

A segment has a length, and in it a curve that begins at a start point and has a length of its own.
Before the curve is the offset; behind it the offset too, for a line the offset and the amplitude.
A curve that reaches over the end of the segment goes on at its start, so that the start point of a
sine as long as its segment is a phase. Sample i of a curve is its value at i over its length: the
end of a curve is the start of what follows, and a sine that is repeated has no sample twice.
"""

from collections.abc import Sequence

import numpy as np

from flexstage.arrays import Array
from flexstage.instruments.twin import errors_gcs as code
from flexstage.instruments.twin.command import number, unsigned
from flexstage.instruments.twin.errors_gcs import GcsError

#: Words behind the kind of a segment.
_WORDS = {"SIN_P": 6, "RAMP": 7, "LIN": 6}


def segment(kind: str, words: Sequence[str], *, held: int, room: int) -> Array:
    """Return the samples of a segment, in the unit of the command.

    It is appended to the samples that are `held` in the table; `room` is the most that it can have.

    Examples
    --------
    >>> segment("SIN_P", "4 10 5 4 0 2".split(), held=0, room=100)
    array([ 5., 10., 15., 10.])
    """
    if kind == "PNT":
        return _points(words, held, room)
    if kind not in _WORDS:
        raise GcsError(code.UNKNOWN_WAVE_TYPE)
    if len(words) != _WORDS[kind]:
        raise GcsError(code.NUMBER_OF_WAVE_PARAMETERS)
    size = unsigned(words[0])
    amplitude, offset = number(words[1]), number(words[2])
    curve, start, *rest = (unsigned(word) for word in words[3:])
    if not (1 <= curve <= size and start < size):
        raise GcsError(code.WAVE_OUT_OF_RANGE)
    if size > room:
        raise GcsError(code.WAVE_TOO_LONG)
    if kind == "SIN_P":
        shape = _sine(curve, rest[0])
    elif kind == "RAMP":
        shape = _ramp(curve, rest[0], rest[1])
    else:
        shape = _line(curve, rest[0])
    values = np.zeros(size)
    values[(start + np.arange(curve)) % size] = shape
    if kind == "LIN" and start + curve < size:
        values[start + curve :] = 1.0
    return offset + amplitude * values


def _points(words: Sequence[str], held: int, room: int) -> Array:
    if len(words) < 3:
        raise GcsError(code.NUMBER_OF_WAVE_PARAMETERS)
    start, size = unsigned(words[0]), unsigned(words[1])
    if size != len(words) - 2:
        raise GcsError(code.NUMBER_OF_WAVE_PARAMETERS)
    # counted in what is appended, or in the whole table: clients do either
    if start not in (1, held + 1):
        raise GcsError(code.WAVE_OUT_OF_RANGE)
    if size > room:
        raise GcsError(code.WAVE_TOO_LONG)
    return np.array([number(word) for word in words[2:]])


def _sine(curve: int, centre: int) -> Array:
    """Return half a cosine up to the centre, and another half down, 0 to 1."""
    if not 1 <= centre < curve:
        raise GcsError(code.WAVE_OUT_OF_RANGE)
    i = np.arange(curve)
    turn = np.where(i < centre, i / centre, 1.0 + (i - centre) / (curve - centre))
    return 0.5 - 0.5 * np.cos(np.pi * turn)


def _ramp(curve: int, rounded: int, centre: int) -> Array:
    """Return a line up to the centre, and another one down, 0 to 1."""
    if not 1 <= centre < curve:
        raise GcsError(code.WAVE_OUT_OF_RANGE)
    return np.concatenate((_line(centre, rounded), 1.0 - _line(curve - centre, rounded)))


def _line(curve: int, rounded: int) -> Array:
    """Return a line from 0 to 1 whose speed grows and falls evenly over its first and last part."""
    if 2 * rounded > curve:
        raise GcsError(code.WAVE_OUT_OF_RANGE)
    i = np.arange(curve, dtype=np.float64)
    if rounded == 0:
        return i / curve
    speed = 1.0 / (curve - rounded)
    up = 0.5 * speed * i * i / rounded
    down = 1.0 - 0.5 * speed * (curve - i) ** 2 / rounded
    even = speed * (i - 0.5 * rounded)
    return np.where(i < rounded, up, np.where(i > curve - rounded, down, even))
