"""Columns of a file, as the reader of a format returns them, with their units and rate."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from flexstage.base.errors import RecordError, UnitError
from flexstage.quantities.units import si_unit

#: Symbols of the standard acceleration of gravity (3rd CGPM, 1901) [m/s^2], and its fractions.
GRAVITY = {
    **dict.fromkeys(("g", "G", "gn", "g_n", "gee"), 9.80665),
    "mg": 9.80665e-3,
    **dict.fromkeys(("ug", "µg"), 9.80665e-6),
}
_ACCELERATION = re.compile(
    r"(?<![a-z])(acc[a-z]{0,2}|accel[a-z]*|beschl[a-z]*|a[xyz])(?![a-z])", re.IGNORECASE
)

# the largest integer up to which every integer is a float
_LAST_EXACT = 2**53


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FileColumn:
    """One column of a file."""

    name: str
    """Heading, without the unit."""
    values: NDArray[np.float64]
    """Numbers, in the unit of the file, shape (n,)."""
    unit: str = ""
    """Unit in the file; empty if there is none or it is unknown."""
    si: tuple[float, str] | None = None
    """Factor and SI unit of `unit`, if the format defines them: ``g`` of an acceleration is no
    gram.
    """
    words: NDArray[np.str_] | None = None
    """Text in place of numbers, shape (n,); empty for numbers."""
    texts: tuple[str, ...] = ()
    """Texts that the values number, of a column with labels of rows."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FileColumns:
    """Equally long columns of one file."""

    columns: tuple[FileColumn, ...]
    """The columns, in the order of the file."""
    sample_rate_hz: float | None = None
    """Sample rate in the file [Hz]."""
    start: float = 0.0
    """Time of the first sample in the file [s]; read with `sample_rate_hz`."""
    rate_source: str = ""
    """Place of the sample rate in the file."""
    hint: str = ""
    """Advice for a user who gives no time."""
    notes: tuple[str, ...] = ()
    """Remarks on the parsed and the skipped parts of the file."""
    attributes: Mapping[str, str] = field(default_factory=dict)
    """Further text of the file."""
    over: Literal["time", "frequency", "point"] = "time"
    """Independent variable of the samples."""
    axis: NDArray[np.float64] | None = None
    """Frequency of each sample, if they are over frequency [Hz], shape (n,)."""
    groups: Mapping[str, tuple[int, ...]] = field(default_factory=dict)
    """Names of groups of columns, with the numbers of the columns."""
    lines: NDArray[np.intp] | None = None
    """Line number of each row, from 1, for a file with text among its numbers, shape (n,)."""

    def renamed(self, names: Sequence[str]) -> "FileColumns":
        """Return the same columns with other names."""
        if len(names) != len(self.columns):
            raise RecordError(
                f"the file has {len(self.columns)} columns, got {len(names)} names: give one for "
                "each column"
            )
        columns = (
            replace(labelled(label, c.values, c.unit), si=c.si, words=c.words)
            for label, c in zip(names, self.columns, strict=True)
        )
        return replace(self, columns=tuple(columns))

    def part(self, rows: slice) -> "FileColumns":
        """Return some of the rows."""
        first = rows.indices(self.columns[0].values.size)[0]
        return replace(
            self,
            columns=tuple(
                replace(
                    c,
                    values=c.values[rows].copy(),
                    words=None if c.words is None else c.words[rows],
                )
                for c in self.columns
            ),
            start=self.start + (first / self.sample_rate_hz if self.sample_rate_hz else 0.0),
            axis=None if self.axis is None else self.axis[rows].copy(),
            lines=None if self.lines is None else self.lines[rows],
        )

    def numbered(self, number: int) -> "FileColumns":
        """Return the same columns, with the texts of one column numbered by first appearance."""
        column = self.columns[number]
        if column.words is None or not (column.words != "").any():
            return self
        texts = [w or f"{v:.17g}" for w, v in zip(column.words, column.values, strict=True)]
        order = {text: float(i) for i, text in enumerate(dict.fromkeys(texts))}
        values = np.array([order[text] for text in texts])
        labels = replace(column, values=values, unit="", words=None, texts=tuple(order))
        note = f"texts of '{column.name}' are numbered by first appearance"
        columns = (*self.columns[:number], labels, *self.columns[number + 1 :])
        return replace(self, columns=columns, notes=(*self.notes, note))

    def require_numbers(self, number: int) -> None:
        """Refuse a column with text among its numbers."""
        column = self.columns[number]
        if column.words is None or self.lines is None:
            return
        rows = np.flatnonzero(column.words != "")
        if rows.size:
            raise RecordError(
                f"line {self.lines[rows[0]]}, column {number}: '{column.words[rows[0]]}' is not a "
                f"number, and {rows.size} of {column.words.size} rows of column '{column.name}' "
                "contain text: correct them, select rows without them by the option rows, skip "
                f"lines by --text skip=N, or choose another column{self.hint}"
            )


@lru_cache(maxsize=256)
def measured_unit(text: str) -> tuple[float, str]:
    """Return the factor and SI unit of a unit, of a quantity or of a quotient of quantities.

    Examples
    --------
    >>> measured_unit("(mm/s^2)/N")
    (0.001, 'm/s^2/N')
    """
    try:
        return si_unit(text)
    except UnitError as error:
        unknown = error
    for above, below in _quotients(text):
        try:
            (factor, unit), (divisor, per) = si_unit(above), si_unit(below)
        except UnitError:
            continue
        if unit == per:
            return factor / divisor, "1"
        return factor / divisor, f"{unit}/({per})" if "/" in per else f"{unit}/{per}"
    raise unknown


def _quotients(text: str) -> list[tuple[str, str]]:
    """Return the ways to read a unit as a quotient, the last slash first."""
    quotients, depth = [], 0
    for at in range(len(text) - 1, 0, -1):
        depth += (text[at] == ")") - (text[at] == "(")
        if text[at] == "/" and depth == 0:
            quotients.append((_unwrapped(text[:at]), _unwrapped(text[at + 1 :])))
    return quotients


def _unwrapped(text: str) -> str:
    text = text.strip()
    bracketed = text.startswith("(") and text.endswith(")") and text.count("(") == 1
    return text[1:-1].strip() if bracketed else text


def labelled(label: str, values: NDArray[np.float64], unit: str = "") -> FileColumn:
    """Return a column with the name and the unit of its heading.

    Accepted forms are ``Voltage (V)``, ``pos [um]`` and ``U / V``. Text in brackets that is no unit
    remains a part of the name.

    Examples
    --------
    >>> labelled("pos [um]", np.zeros(2)).unit
    'um'
    """
    label = " ".join(label.split())
    if unit:
        return FileColumn(name=label, values=values, unit=unit)
    name, unit = _split(label)
    if not unit:
        # empty brackets mean that there is no unit, and are no part of the name
        return FileColumn(name=name or label, values=values)
    try:
        measured_unit(unit)
    except UnitError:
        if gravity_unit(unit, name) is None:
            return FileColumn(name=label, values=values)
    return FileColumn(name=name or label, values=values, unit=unit)


def _split(label: str) -> tuple[str, str]:
    """Split a heading into a name and a possible unit."""
    for opening, closing in ("()", "[]"):
        if label.endswith(closing) and opening in label:
            name, _, inside = label[:-1].rpartition(opening)
            return name.rstrip(), inside.strip()
    name, _, inside = label.rpartition(" / ")
    return (name.strip(), inside.strip()) if name else (label, "")


def is_acceleration(name: str) -> bool:
    """Return whether a name is that of an acceleration.

    Examples
    --------
    >>> is_acceleration("Acceleration_2"), is_acceleration("acc_x"), is_acceleration("accuracy")
    (True, True, False)
    """
    return _ACCELERATION.search(name) is not None


def gravity_unit(unit: str, name: str) -> tuple[float, str] | None:
    """Return the factor and SI unit of a unit that is the acceleration of gravity, not a gram.

    In a column whose name is not that of an acceleration, ``g_n`` and a unit over a force are
    accepted, ``g`` alone is not.

    Examples
    --------
    >>> gravity_unit("g", "ax"), gravity_unit("g", "load"), gravity_unit("g/N", "H")
    ((9.80665, 'm/s^2'), None, (9.80665, 'm/s^2/N'))
    """
    above, stroke, below = unit.partition("/")
    factor = GRAVITY.get(_unwrapped(above))
    if factor is None:
        return None
    sure = "n" in above or is_acceleration(name)
    if not stroke:
        return (factor, "m/s^2") if sure else None
    try:
        divisor, per = si_unit(_unwrapped(below))
    except UnitError:
        return None
    if per != "N" and not sure:
        return None
    return factor / divisor, f"m/s^2/({per})" if "/" in per else f"m/s^2/{per}"


def complex_parts(
    column: FileColumn, imaginary: NDArray[np.float64]
) -> tuple[FileColumn, FileColumn]:
    """Return a column of complex values as two, ``NAME real`` and ``NAME imaginary``."""
    return (
        replace(column, name=f"{column.name} real"),
        replace(column, name=f"{column.name} imaginary", values=imaginary),
    )


def as_float(values: NDArray, what: str) -> NDArray[np.float64]:
    """Return an array of a file as floats.

    Dates become seconds after the first. Integers that a float would round are refused.
    """
    kind = values.dtype.kind
    if kind in "Mm":
        return _seconds(values, what)
    if kind not in "biuf":
        raise RecordError(
            f"{what} contains {values.dtype.name}, not numbers: choose another column"
        )
    if kind in "iu" and values.size and _is_rounded(values):
        raise RecordError(
            f"{what} contains integers beyond 2^53, which a float would round: subtract an offset "
            "before you save it"
        )
    with np.errstate(over="ignore"):
        return np.ascontiguousarray(values, dtype=np.float64)


def _is_rounded(values: NDArray) -> bool:
    return int(values.max()) > _LAST_EXACT or int(values.min()) < -_LAST_EXACT


def _seconds(values: NDArray, what: str) -> NDArray[np.float64]:
    flat = values.reshape(-1)
    if np.isnat(flat).any():
        raise RecordError(f"{what} has an invalid date at sample {np.isnat(flat).argmax()}")
    origin = flat[0] if flat.dtype.kind == "M" and flat.size else flat.dtype.type(0, "ns")
    steps = (flat - origin).astype("timedelta64[ns]").astype(np.int64)
    return (steps * 1e-9).reshape(values.shape)
