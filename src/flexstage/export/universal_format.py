"""Data sets of universal files as text: heading, units, points, lines, shapes, functions."""

import re
import unicodedata
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from flexstage.arrays import Array

#: Numbers of kinds of quantities.
DISPLACEMENT, FORCE = 8, 13
_FREQUENCY = 18
_FRF = 4  # a function that is a response over a reference
_NAMES = {DISPLACEMENT: ("displacement", "m"), FORCE: ("force", "N")}
# of every file, so that the same stage gives the same bytes
_TIME = "01-JAN-70 00:00:00"
_LONGEST = 250  # points of a line


def _set(number: int, lines: Sequence[str]) -> str:
    return "\n".join(("    -1", f"{number:6d}", *lines, "    -1", ""))


def _text(words: str) -> str:
    """Write a line of text: 80 characters of ASCII, never one that would end the data set."""
    known = unicodedata.normalize("NFKD", words.replace("µ", "u"))
    plain = "".join(c if c.isascii() and c.isprintable() else "" for c in known).strip()
    return (re.sub(r"^-1\b", "- 1", plain) or "NONE")[:80]


def _plain(words: str, width: int) -> str:
    return f"{_text(words)[:width]:<{width}}"


def _reals(values: Sequence[float], width: int, digits: int, in_line: int) -> list[str]:
    """Write numbers in columns."""
    words = [f"{v:{width}.{digits}E}" for v in values]
    return ["".join(words[i : i + in_line]) for i in range(0, len(words), in_line)]


def heading(name: str, description: str, program: str) -> str:
    """Write data set 151, the heading of the file."""
    lines = (
        _text(name),
        _text(description),
        _text(program),
        f"{_TIME}  {0:10d}{0:10d}{0:10d}",
        _TIME,
        _text(program),
        _TIME,
    )
    return _set(151, [line.rstrip() for line in lines])


def si_units() -> str:
    """Write data set 164: metre and newton."""
    one = f"{1.0:25.17E}".replace("E", "D")
    none = f"{273.15:25.17E}".replace("E", "D")
    return _set(164, (f"{1:10d}{'SI: metre, newton':<20}{2:10d}", 3 * one, none))


def point_list(numbers: Sequence[int], positions: Array) -> str:
    """Write data set 2411, points [m] in double precision."""
    lines = []
    for number, position in zip(numbers, positions.tolist(), strict=True):
        lines.append(f"{number:10d}{1:10d}{1:10d}{11:10d}")
        lines.append("".join(f"{x:25.16E}" for x in position).replace("E", "D"))
    return _set(2411, lines)


def trace_lines(first: int, name: str, points: Sequence[int]) -> str:
    """Write data sets 82: a line through points, in parts of 250 at most, numbered from `first`."""
    written = []
    # each part begins where the one before it ends
    for k, start in enumerate(range(0, max(len(points) - 1, 1), _LONGEST - 1)):
        part = points[start : start + _LONGEST]
        lines = [f"{first + k:10d}{len(part):10d}{7:10d}", _text(name)]
        for i in range(0, len(part), 8):
            lines.append("".join(f"{number:10d}" for number in part[i : i + 8]))
        written.append(_set(82, lines))
    return "".join(written)


def mode_shape(
    titles: Sequence[str],
    number: int,
    frequency_hz: float,
    damping_ratio: float,
    points: Sequence[int],
    shape: Array,
) -> str:
    """Write data set 55: a normal mode of unit modal mass at points, in six directions.

    Its shape is displacement along x, y, z [m] and rotation about them [rad] for one unit of the
    mode [kg^0.5 m], shape (n, 6); titles are five lines at most.
    """
    lines = [_text(title) for title in (*titles, "", "", "", "", "")[:5]]
    # structural, normal mode, six directions, displacement, real numbers, six of them
    lines.append("".join(f"{code:10d}" for code in (1, 2, 3, DISPLACEMENT, 2, 6)))
    lines.append("".join(f"{code:10d}" for code in (2, 4, 0, number)))
    lines += _reals((frequency_hz, 1.0, damping_ratio, 0.0), 13, 5, 6)
    for point, row in zip(points, shape.tolist(), strict=True):
        lines.append(f"{point:10d}")
        lines += _reals(row, 13, 5, 6)
    return _set(55, lines)


def frequency_function(
    titles: Sequence[str],
    number: int,
    response: tuple[str, int, int],
    unit: str,
    reference: tuple[str, int, int],
    denominator: int,
    frequency_hz: Array,
    value: NDArray[np.complex128],
) -> str:
    """Write data set 58: a frequency response function, complex, in double precision.

    Response and reference are name, number of the point and direction: 1 to 3 along x, y, z, 4 to 6
    about them, negative the other way, 0 for another one. The unit is that of the response, m or
    rad. The denominator is the kind of the reference, `FORCE` or `DISPLACEMENT`; of frequencies six
    digits are written.
    """
    lines = [_text(title) for title in (*titles, "", "", "", "", "")[:5]]
    places = "".join(
        f" {_plain(name, 10)}{point:10d}{direction:4d}"
        for name, point, direction in (response, reference)
    )
    lines.append(f"{_FRF:5d}{number:10d}{0:5d}{0:10d}{places}")
    start, step = _even(frequency_hz)
    spacing = 1 if step else 0
    stored = (6, frequency_hz.size, spacing)
    lines.append(
        "".join(f"{code:10d}" for code in stored) + "".join(_reals((start, step, 0.0), 13, 5, 3))
    )
    lines.append(f"{_FREQUENCY:10d}{0:5d}{0:5d}{0:5d} {'frequency':<20} {'Hz':<20}")
    above = (DISPLACEMENT, "rotation" if unit == "rad" else "displacement", unit)
    for kind, label, of in (above, (denominator, *_NAMES[denominator])):
        lines.append(f"{kind:10d}{0:5d}{0:5d}{0:5d} {label:<20} {of:<20}")
    lines.append(f"{0:10d}{0:5d}{0:5d}{0:5d} {'NONE':<20} {'NONE':<20}")
    pairs = np.column_stack((value.real, value.imag))
    if spacing:
        lines += _reals(pairs.ravel().tolist(), 20, 12, 4)
    else:
        for f, (real, imaginary) in zip(frequency_hz.tolist(), pairs.tolist(), strict=True):
            lines.append(f"{f:13.5E}{real:20.12E}{imaginary:20.12E}")
    return _set(58, lines)


def _even(frequency_hz: Array) -> tuple[float, float]:
    """Return start and step of frequencies that six digits of both give back; else a step of 0."""
    if frequency_hz.size < 2:
        return 0.0, 0.0
    start, step = (float(f"{v:.5e}") for v in (frequency_hz[0], frequency_hz[1] - frequency_hz[0]))
    again = start + step * np.arange(frequency_hz.size)
    near = np.allclose(again, frequency_hz, rtol=1e-12, atol=1e-12 * abs(float(frequency_hz[-1])))
    return (start, step) if near else (0.0, 0.0)
