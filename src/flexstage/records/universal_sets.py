"""Data sets of a universal file: their boundaries, and the headings of functions."""

import re
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from flexstage.base.errors import RecordError

_CLOSING = re.compile(rb"\r?\n? {4}-1[ \t]*\r?(?:\n|\Z)")
_TEXT_OF_NUMBERS = re.compile(rb"[-+.0-9EeNnAaIiFf\s]*")
_TO_E = bytes.maketrans(b"Dd", b"EE")


@dataclass(frozen=True, slots=True, kw_only=True)
class ValueLayout:
    """Storage of the numbers of a function."""

    count: int
    """Number of samples."""
    double: bool
    """Double precision, else single."""
    is_complex: bool
    """Whether each value has a real and an imaginary part."""
    uneven: bool
    """Whether each value has its abscissa before it."""
    binary: bool = False
    """Binary numbers, else text."""
    order: str = "<"
    """Byte order of binary numbers, ``<`` or ``>``."""

    @property
    def width(self) -> int:
        """Numbers per sample."""
        return int(self.uneven) + 1 + int(self.is_complex)

    @property
    def fields(self) -> tuple[int, ...]:
        """Widths of the numbers in a line of text."""
        if not self.double:
            return (13,) * 6
        if not self.uneven:
            return (20,) * 4
        return (13, 20, 20) if self.is_complex else (13, 20, 13, 20)


def binary_end(data: bytes, start: int, layout: ValueLayout) -> tuple[int, int]:
    """Return the end of binary numbers, and of their data set.

    The abscissa of uneven samples is single in the original format even if values are double, but
    double in files of some programs: the closing line of the data set shows which.
    """
    sizes = [layout.count * kind.itemsize for kind in _binary_types(layout)]
    for size in sizes:
        closing = _CLOSING.match(data, start + size)
        if closing is not None:
            return start + size, closing.end()
    raise RecordError(
        f"its {layout.count} values have {' or '.join(map(str, sizes))} bytes, but no line "
        "'    -1' closes it there: the file is truncated or its heading is wrong; export it again"
    )


def _binary_types(layout: ValueLayout) -> list[np.dtype]:
    """Return the possible types of one sample."""
    value = f"{layout.order}f{8 if layout.double else 4}"
    values = [("re", value), ("im", value)][: 1 + int(layout.is_complex)]
    if not layout.uneven:
        return [np.dtype(values)]
    sizes = (4, 8) if layout.double else (4,)
    return [np.dtype([("x", f"{layout.order}f{size}"), *values]) for size in sizes]


def decoded_values(content: bytes, layout: ValueLayout) -> NDArray[np.float64]:
    """Return the numbers of a function, shape (n, width), one row for each sample.

    A row has the abscissa of uneven samples, the real part, and the imaginary part if any.
    """
    if not layout.binary:
        return _text_values(content, layout).reshape(layout.count, layout.width)
    kind = next(k for k in _binary_types(layout) if layout.count * k.itemsize == len(content))
    table = np.frombuffer(content, dtype=kind)
    names = kind.names or ()
    with np.errstate(invalid="ignore"):
        return np.column_stack([table[name].astype(np.float64) for name in names])


def _text_values(content: bytes, layout: ValueLayout) -> NDArray[np.float64]:
    if not _TEXT_OF_NUMBERS.fullmatch(text := content.translate(_TO_E)):
        raise RecordError("its values contain letters of no number: export the file again")
    expected = layout.count * layout.width
    words = text.split()
    if len(content) < expected:
        raise RecordError(_miscounted(expected, len(words), layout))
    lines = [line.rstrip() for line in text.split(b"\n")]
    lines = [line for line in lines if line]
    full_lines, in_last = divmod(expected, len(layout.fields))
    edges = np.cumsum(layout.fields)
    ends = [int(edges[-1])] * full_lines + ([int(edges[in_last - 1])] if in_last else [])
    try:
        if [len(line) for line in lines] == ends:
            return _fixed_values(b"".join(lines), layout.fields, full_lines, in_last)
        # some programs write spaces between numbers in place of columns of fixed width
        if len(words) == expected:
            return np.array([float(word) for word in words], dtype=np.float64)
    except ValueError:
        raise RecordError(
            "its values are not in columns of the width of the format: export the file again"
        ) from None
    raise RecordError(_miscounted(expected, len(words), layout))


def _miscounted(expected: int, count: int, layout: ValueLayout) -> str:
    return (
        f"its heading announces {expected} numbers in lines of {len(layout.fields)}, but the data "
        f"set has {count}: the file is truncated or damaged; export it again"
    )


def _fixed_values(
    content: bytes, fields: tuple[int, ...], full_lines: int, in_last: int
) -> NDArray[np.float64]:
    kind = np.dtype([(f"f{j}", f"S{width}") for j, width in enumerate(fields)])
    end = full_lines * kind.itemsize
    table = np.frombuffer(content[:end], dtype=kind)
    values = np.empty((full_lines, len(fields)))
    for j in range(len(fields)):
        values[:, j] = table[f"f{j}"].astype(np.float64)
    last, at = [], end
    for width in fields[:in_last]:
        last.append(float(content[at : at + width]))
        at += width
    return np.concatenate([values.ravel(), last])


#: Kinds of functions, by number.
KINDS = (
    "general function",
    "time response",
    "auto spectrum",
    "cross spectrum",
    "frequency response function",
    "transmissibility",
    "coherence",
    "auto correlation",
    "cross correlation",
    "power spectral density",
    "energy spectral density",
    "probability density",
    "spectrum",
)

_TAG = re.compile(rb"^ {4}-1[ \t]*\r?$", re.MULTILINE)
_FIRST = re.compile(rb"\s*^ {4}-1[ \t]*\r?\n {0,5}\d{1,6}[bB]?(?![\d.])", re.MULTILINE)
_DIRECTIONS = ("", "x", "y", "z", "rx", "ry", "rz")
# lines of a function between its number and its values
_HEADING = 11


@dataclass(frozen=True, slots=True, kw_only=True)
class FunctionAxis:
    """Quantity and unit of an axis of a function."""

    quantity: int
    """Number of the kind of quantity: 8 displacement, 12 acceleration, 13 force, 17 time..."""
    label: str = ""
    """Unit in the file; empty if there is none."""
    rotational: bool = False
    """Whether it is of a rotation."""


@dataclass(frozen=True, slots=True, kw_only=True)
class UnitSystem:
    """Units of data set 164, as numbers of units per SI unit."""

    length: float
    """Units of the file in a metre."""
    force: float
    """Units of the file in a newton."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Function:
    """Function at a point, data set 58, with its values as stored in the file."""

    title: str
    """First line of text."""
    date: str
    """Third line of text, by convention the date of measurement."""
    kind: int
    """Kind of function, as numbered by `KINDS`."""
    response: str
    """Point and direction of the response, ``12:+z``; empty if there is none."""
    reference: str
    """Point and direction of the reference; empty if there is none."""
    abscissa: FunctionAxis
    """Quantity of the abscissa."""
    ordinate: FunctionAxis
    """Quantity of the ordinate."""
    denominator: FunctionAxis
    """Quantity of the denominator of the ordinate."""
    start: float
    """First abscissa of even samples."""
    step: float
    """Step of the abscissa of even samples."""
    layout: ValueLayout
    """Storage of the values."""
    content: bytes
    """Stored values."""
    system: UnitSystem | None = None
    """Units of the file."""

    def table(self) -> NDArray[np.float64]:
        """Return the abscissa, the real part, and the imaginary part if any."""
        values = decoded_values(self.content, self.layout)
        if self.layout.uneven:
            return values
        even = self.start + self.step * np.arange(self.layout.count, dtype=np.float64)
        return np.concatenate([even[:, None], values], axis=1)


def is_universal(head: bytes) -> bool:
    r"""Return whether a file begins like a universal file.

    Examples
    --------
    >>> is_universal(b"    -1\n    58\n"), is_universal(b"    -1\n 0.5 2.5\n")
    (True, False)
    """
    return _FIRST.match(head) is not None


def read_sets(data: bytes) -> list[Function]:
    """Return the functions of a universal file, data sets 58 in their order."""
    functions: list[Function] = []
    system: UnitSystem | None = None
    at, number = 0, 0
    while (opening := _TAG.search(data, at)) is not None:
        _require_blank(data[at : opening.start()])
        number += 1
        where = f"data set {number}"
        line, body = _line(data, opening.end() + 1)
        kind = line[:6].strip()
        if not kind.isdigit():
            raise RecordError(
                f"{where} must begin with its number in the line below '    -1', got "
                f"'{_plain(line)[:30]}': the file is damaged; export it again"
            )
        try:
            if kind == b"58":
                function, at = _function(data, line, body, system)
                functions.append(function)
                continue
            end, at = _closed(data, body)
            if kind == b"164":
                system = _unit_system(data[body:end])
        except RecordError as error:
            raise RecordError(f"{where} ({_plain(line[:7])}): {error}") from None
    if number == 0:
        raise RecordError(
            "no line '    -1' opens a data set: it is not a universal file; give its format by the "
            "option format"
        )
    _require_blank(data[at:])
    return functions


def _require_blank(between: bytes) -> None:
    """Refuse text outside of the data sets, as of one without its first line."""
    if outside := between.strip(b" \t\r\n\0\x1a"):
        raise RecordError(
            f"'{_plain(outside[:30])}' is outside of all data sets, and an opening line '    -1' "
            "is missing: the file is damaged; export it again"
        )


def _line(data: bytes, start: int) -> tuple[bytes, int]:
    """Return a line, and the start of the next."""
    end = data.find(b"\n", start)
    end = len(data) if end < 0 else end
    return data[start:end].rstrip(b"\r"), end + 1


def _plain(text: bytes) -> str:
    return "".join(c if c.isprintable() else "?" for c in text.decode("latin-1")).strip()


def _closed(data: bytes, start: int) -> tuple[int, int]:
    """Return the end of a data set of text, and the possible start of the next."""
    closing = _TAG.search(data, start)
    if closing is None:
        raise RecordError(
            "no line '    -1' closes it: the file is truncated; copy or export it again"
        )
    return closing.start(), closing.end()


def _function(
    data: bytes, identity: bytes, start: int, system: UnitSystem | None
) -> tuple[Function, int]:
    """Return a function, and the possible start of the next data set."""
    lines, at = [], start
    # lines have 80 characters
    longest = 160
    for _ in range(_HEADING):
        if at >= len(data):
            raise RecordError("its heading is truncated: copy or export the file again")
        line, at = _line(data, at)
        line = line[:longest]
        lines.append(_plain(line) if len(lines) < 5 else line.decode("latin-1"))
    load = _fields(lines[5], (5, 10, 5, 10, 11, 10, 4, 11, 10, 4))
    load = load if _are_integers(load) else (*lines[5].split(),)
    if not _are_integers(load):
        raise RecordError(f"its points and directions are invalid: '{lines[5].strip()}'")
    layout, abscissa_start, step = _layout(identity, lines[6])
    if layout.binary:
        end, after = binary_end(data, at, layout)
    else:
        end, after = _closed(data, at)
    axes = [_axis(line) for line in lines[7:10]]
    response, reference = (_direction(load[j]) for j in (6, 9))
    return Function(
        title=_text(lines[0]),
        date=_text(lines[2]),
        kind=_integer(load[0]),
        response=_point(load[5], response),
        reference=_point(load[8], reference),
        abscissa=axes[0],
        ordinate=_turned(axes[1], response),
        denominator=_turned(axes[2], reference),
        start=abscissa_start,
        step=step,
        layout=layout,
        content=data[at:end],
        system=system,
    ), after


def _fields(line: str, widths: Sequence[int]) -> tuple[str, ...]:
    ends = np.cumsum(widths).tolist()
    return tuple(line[end - w : end].strip() for end, w in zip(ends, widths, strict=True))


def _are_integers(load: Sequence[str]) -> bool:
    """Return whether the numeric fields of the load are integers."""
    return len(load) == 10 and all(
        re.fullmatch(r"[+-]?[0-9]*", load[j]) is not None for j in (0, 1, 2, 3, 5, 6, 8, 9)
    )


def _is_count(text: str) -> bool:
    # a superscript is a digit for Python, but not a number
    return text.isascii() and text.isdigit()


def _integer(text: str) -> int:
    return int(text) if text.strip("+-") else 0


def _real(text: str) -> float:
    try:
        return float(text.upper().replace("D", "E")) if text else 0.0
    except ValueError:
        return np.nan


def _text(line: str) -> str:
    return "" if line.upper() == "NONE" else line


def _layout(identity: bytes, line: str) -> tuple[ValueLayout, float, float]:
    """Return the storage of the values, the first abscissa, and its step."""
    words = _fields(line, (10, 10, 10, 13, 13, 13))
    if not all(_is_count(word) for word in words[:3]):
        raise RecordError(f"its storage of values is invalid: '{line.strip()[:60]}'")
    kind, count, spacing = (int(word) for word in words[:3])
    start, step = _real(words[3]), _real(words[4])
    if kind not in (2, 4, 5, 6) or spacing not in (0, 1) or not 2 <= count < 2**31:
        raise RecordError(
            f"it has {count} values of type {kind} and spacing {spacing}: at least two values of "
            "type 2, 4, 5 or 6 and spacing 0 or 1 are allowed"
        )
    if spacing == 1 and not (np.isfinite(start) and np.isfinite(step) and step > 0.0):
        raise RecordError(
            f"its even abscissa must have a positive step, got '{words[3]}' and '{words[4]}'"
        )
    binary = identity[6:7].lower() == b"b"
    order = "<"
    if binary:
        method = _fields(identity.decode("latin-1"), (6, 1, 6, 6, 12, 12))[2:5]
        if method[0] not in ("1", "2") or method[1] != "2" or method[2] != str(_HEADING):
            raise RecordError(
                "its binary numbers must be IEEE 754 (2) in byte order 1 or 2 below 11 lines, got "
                f"'{_plain(identity)}': export the file as text"
            )
        order = "<" if method[0] == "1" else ">"
    return (
        ValueLayout(
            count=count,
            double=kind in (4, 6),
            is_complex=kind in (5, 6),
            uneven=spacing == 0,
            binary=binary,
            order=order,
        ),
        start,
        step,
    )


def _axis(line: str) -> FunctionAxis:
    words = _fields(line, (10, 5, 5, 5, 21, 21))
    if not _is_count(words[0]):
        raise RecordError(f"the line of an axis is invalid: '{_plain(line.encode())[:60]}'")
    return FunctionAxis(quantity=int(words[0]), label=_text(words[5]))


def _turned(axis: FunctionAxis, direction: int) -> FunctionAxis:
    rotational = abs(direction) > 3
    return FunctionAxis(quantity=axis.quantity, label=axis.label, rotational=rotational)


def _direction(text: str) -> int:
    number = _integer(text)
    if abs(number) > 6:
        raise RecordError(f"a direction must be -6 to 6, got {number}")
    return number


def _point(node: str, direction: int) -> str:
    name = _DIRECTIONS[abs(direction)]
    sign = "" if direction == 0 else "+" if direction > 0 else "-"
    if not name:
        return str(_integer(node)) if _integer(node) else ""
    return f"{_integer(node)}:{sign}{name}"


def _unit_system(body: bytes) -> UnitSystem:
    """Return the units of data set 164."""
    words = body.split(b"\n", 1)[-1].decode("latin-1").split()
    factors = [_real(word) for word in words[:2]]
    if len(factors) < 2 or not all(np.isfinite(f) and f > 0.0 for f in factors):
        raise RecordError("the units of the file are invalid: export it again")
    return UnitSystem(length=factors[0], force=factors[1])
