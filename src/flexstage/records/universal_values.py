"""The numbers of a function in a universal file: columns of fixed width, or binary."""

import re
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from flexstage.errors import RecordError

_CLOSING = re.compile(rb"\r?\n? {4}-1[ \t]*\r?(?:\n|\Z)")
_TEXT_OF_NUMBERS = re.compile(rb"[-+.0-9EeNnAaIiFf\s]*")
_TO_E = bytes.maketrans(b"Dd", b"EE")


@dataclass(frozen=True, slots=True, kw_only=True)
class ValueLayout:
    """How the numbers of a function are stored."""

    count: int
    """Number of samples."""
    double: bool
    """Double precision, else single."""
    is_complex: bool
    """Whether each value has a real and an imaginary part."""
    uneven: bool
    """Whether the abscissa of each value stands before it."""
    binary: bool = False
    """Binary numbers, else text."""
    order: str = "<"
    """Byte order of binary numbers, ``<`` or ``>``."""

    @property
    def width(self) -> int:
        """Numbers that belong to one sample."""
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
    """Return where binary numbers end, and where the data set does that they are in.

    The abscissa of uneven samples is single in the original format even where values are double,
    and double in what some programs write: the line that closes the data set tells which.
    """
    sizes = [layout.count * kind.itemsize for kind in _binary_types(layout)]
    for size in sizes:
        closing = _CLOSING.match(data, start + size)
        if closing is not None:
            return start + size, closing.end()
    raise RecordError(
        f"its {layout.count} values are {' or '.join(map(str, sizes))} bytes, after which no line "
        "'    -1' closes it: the file is cut short or its heading is wrong; export it again"
    )


def _binary_types(layout: ValueLayout) -> list[np.dtype]:
    """Return what one sample may be."""
    value = f"{layout.order}f{8 if layout.double else 4}"
    values = [("re", value), ("im", value)][: 1 + int(layout.is_complex)]
    if not layout.uneven:
        return [np.dtype(values)]
    sizes = (4, 8) if layout.double else (4,)
    return [np.dtype([("x", f"{layout.order}f{size}"), *values]) for size in sizes]


def decoded_values(content: bytes, layout: ValueLayout) -> NDArray[np.float64]:
    """Return the numbers of a function, shape (n, width), one row for each sample.

    A row is the abscissa where samples are uneven, the real part, and the imaginary part if any.
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
        raise RecordError("its values hold letters that no number has: export the file again")
    wanted = layout.count * layout.width
    words = text.split()
    if len(content) < wanted:
        raise RecordError(_miscounted(wanted, len(words), layout))
    lines = [line.rstrip() for line in text.split(b"\n")]
    lines = [line for line in lines if line]
    whole, rest = divmod(wanted, len(layout.fields))
    edges = np.cumsum(layout.fields)
    ends = [int(edges[-1])] * whole + ([int(edges[rest - 1])] if rest else [])
    try:
        if [len(line) for line in lines] == ends:
            return _fixed_values(b"".join(lines), layout.fields, whole, rest)
        # some programs write spaces between numbers in place of columns of fixed width
        if len(words) == wanted:
            return np.array([float(word) for word in words], dtype=np.float64)
    except ValueError:
        raise RecordError(
            "its values are not in columns of the width that the format has: export the file again"
        ) from None
    raise RecordError(_miscounted(wanted, len(words), layout))


def _miscounted(wanted: int, found: int, layout: ValueLayout) -> str:
    return (
        f"its heading says {wanted} numbers in lines of {len(layout.fields)}, the data set has "
        f"{found}: the file is cut short or damaged; export it again"
    )


def _fixed_values(
    content: bytes, fields: tuple[int, ...], whole: int, rest: int
) -> NDArray[np.float64]:
    kind = np.dtype([(f"f{j}", f"S{width}") for j, width in enumerate(fields)])
    end = whole * kind.itemsize
    table = np.frombuffer(content[:end], dtype=kind)
    values = np.empty((whole, len(fields)))
    for j in range(len(fields)):
        values[:, j] = table[f"f{j}"].astype(np.float64)
    last, at = [], end
    for width in fields[:rest]:
        last.append(float(content[at : at + width]))
        at += width
    return np.concatenate([values.ravel(), last])
