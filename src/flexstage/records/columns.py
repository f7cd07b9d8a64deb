"""What a reader of one format finds: named columns, and what the file itself says about them."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from flexstage.errors import RecordError, UnitError
from flexstage.units import si_unit

__all__ = ["Column", "Columns", "as_float", "labelled"]

# the last integer up to which every integer is a float
_LAST_EXACT = 2**53


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Column:
    """One column as the file has it.

    Parameters
    ----------
    name : str
        Its heading, without the unit.
    values : numpy.ndarray
        Its numbers, in the unit of the file, shape (n,).
    unit : str
        The unit that the file says; empty where it says none that is known.
    """

    name: str
    values: NDArray[np.float64]
    unit: str = ""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Columns:
    """Equally long columns of one file.

    Parameters
    ----------
    columns : tuple of Column
        The columns, in the order of the file.
    sample_rate_hz : float, optional
        The sample rate that the file says [Hz].
    start : float
        The time of the first sample that the file says [s]; read with `sample_rate_hz`.
    rate_source : str
        Where in the file the sample rate stands.
    hint : str
        What a user who gives no time should be told.
    notes : tuple of str
        What was understood and left out.
    attributes : Mapping
        Further text of the file.
    """

    columns: tuple[Column, ...]
    sample_rate_hz: float | None = None
    start: float = 0.0
    rate_source: str = ""
    hint: str = ""
    notes: tuple[str, ...] = ()
    attributes: Mapping[str, str] = field(default_factory=dict)

    def renamed(self, names: Sequence[str]) -> "Columns":
        """Return the same columns with other names.

        Parameters
        ----------
        names : sequence of str
            One name for each.

        Returns
        -------
        Columns
            The same numbers and units.

        Raises
        ------
        RecordError
            There are more or fewer names than columns.
        """
        if len(names) != len(self.columns):
            raise RecordError(
                f"there are {len(self.columns)} columns in the file, got {len(names)} names: give "
                "one for each"
            )
        named = (
            labelled(label, c.values, c.unit) for label, c in zip(names, self.columns, strict=True)
        )
        return replace(self, columns=tuple(named))


def labelled(label: str, values: NDArray[np.float64], unit: str = "") -> Column:
    """Return a column by its heading, which may hold a unit in brackets.

    ``Voltage (V)``, ``pos [um]`` and ``U / V`` are understood. What stands in brackets and is no
    unit stays a part of the name.

    Parameters
    ----------
    label : str
        The heading.
    values : numpy.ndarray
        The numbers, shape (n,).
    unit : str
        The unit, where the file says it elsewhere.

    Returns
    -------
    Column
        The column.

    Examples
    --------
    >>> labelled("pos [um]", np.zeros(2)).unit
    'um'
    """
    label = " ".join(label.split())
    if unit:
        return Column(name=label, values=values, unit=unit)
    name, found = _split(label)
    if not found:
        # empty brackets say that there is no unit, and are no part of the name
        return Column(name=name or label, values=values)
    try:
        si_unit(found)
    except UnitError:
        return Column(name=label, values=values)
    return Column(name=name or label, values=values, unit=found)


def _split(label: str) -> tuple[str, str]:
    """Split a heading into a name and what may be its unit."""
    for opening, closing in ("()", "[]"):
        if label.endswith(closing) and opening in label:
            name, _, inside = label[:-1].rpartition(opening)
            return name.rstrip(), inside.strip()
    name, _, inside = label.rpartition(" / ")
    return (name.strip(), inside.strip()) if name else (label, "")


def as_float(values: NDArray, what: str) -> NDArray[np.float64]:
    """Return an array of a file as floats, or say why that would not be the same numbers.

    Parameters
    ----------
    values : numpy.ndarray
        Any array.
    what : str
        What it is, for the message.

    Returns
    -------
    numpy.ndarray
        The same numbers in the same shape; dates become seconds after the first.

    Raises
    ------
    RecordError
        The numbers are complex, are integers that a float would round, or are no numbers.
    """
    kind = values.dtype.kind
    if kind == "c":
        raise RecordError(f"{what} is complex: save its real part, or its magnitude, as a column")
    if kind in "Mm":
        return _seconds(values, what)
    if kind not in "biuf":
        raise RecordError(f"{what} holds {values.dtype.name}, no numbers: choose another column")
    if kind in "iu" and values.size and _is_rounded(values):
        raise RecordError(
            f"{what} holds integers beyond 2^53, which a float would round: subtract an offset "
            "before saving it"
        )
    with np.errstate(over="ignore"):
        return np.ascontiguousarray(values, dtype=np.float64)


def _is_rounded(values: NDArray) -> bool:
    return int(values.max()) > _LAST_EXACT or int(values.min()) < -_LAST_EXACT


def _seconds(values: NDArray, what: str) -> NDArray[np.float64]:
    flat = values.reshape(-1)
    if np.isnat(flat).any():
        raise RecordError(f"{what} holds a date that is none, at sample {np.isnat(flat).argmax()}")
    origin = flat[0] if flat.dtype.kind == "M" and flat.size else flat.dtype.type(0, "ns")
    steps = (flat - origin).astype("timedelta64[ns]").astype(np.int64)
    return (steps * 1e-9).reshape(values.shape)
