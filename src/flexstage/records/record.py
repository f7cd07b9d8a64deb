"""A record: labelled columns of measured or simulated data, with units and sampling."""

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Literal

import numpy as np

from flexstage.base.arrays import Array
from flexstage.base.errors import RecordError, UnitError
from flexstage.base.lazy import data_frame
from flexstage.base.short_repr import short_repr
from flexstage.quantities.units import si_unit

if TYPE_CHECKING:
    import pandas

#: Attribute of a record that was simulated: what simulated it.
SIMULATED = "simulated"


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Channel:
    """One column of a record."""

    name: str
    """Name of the column."""
    values: Array
    """Samples, shape (n,): in SI if `unit` is an SI unit, else as in the file."""
    unit: str = ""
    """Unit of `values`: ``V``, ``m``, ``N``...; empty if unknown."""
    texts: tuple[str, ...] = ()
    """Texts that `values` number, from 0, of a column with labels of rows."""

    __repr__ = short_repr


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Record:
    """Columns sampled together."""

    channels: tuple[Channel, ...]
    """The columns, each with n samples."""
    time: Array
    """Time of each sample, rising [s], shape (n,); by `over`, instead the frequency [Hz] or the
    number of the point from 0.
    """
    source: str = ""
    """Source: a file, an instrument, a simulation."""
    source_hash: str = ""
    """SHA-256 of the file; empty without a file."""
    notes: tuple[str, ...] = ()
    """Remarks on the record."""
    attributes: Mapping[str, str] = field(default_factory=dict)
    """Further text from the file."""
    over: Literal["time", "frequency", "point"] = "time"
    """Independent variable of the samples: time, frequency as in a spectrum, or only their number,
    as for points of a measuring machine.
    """
    numbers: Array | None = None
    """Number of each sample in the file, from 0, if it differs from that in the record: of a part,
    fractional if resampled; NaN for samples that were not measured. Shape (n,).
    """

    __repr__ = short_repr

    def __post_init__(self) -> None:
        t = self.time
        if t.ndim != 1 or t.size < 2 or not np.all(np.diff(t) > 0.0):
            raise RecordError("a record needs at least two times, in rising order")
        for channel in self.channels:
            if channel.values.shape != t.shape:
                raise RecordError(
                    f"column '{channel.name}' must have {t.size} samples, like the time, got shape "
                    f"{channel.values.shape}"
                )
        if self.numbers is not None and self.numbers.shape != t.shape:
            raise RecordError(
                f"each of the {t.size} samples of a record needs a number, got shape "
                f"{self.numbers.shape}"
            )

    @property
    def size(self) -> int:
        """Number of samples."""
        return self.time.size

    @property
    def sample_rate_hz(self) -> float:
        """Mean sample rate [Hz]."""
        return (self.time.size - 1) / float(self.time[-1] - self.time[0])

    @property
    def uniform(self) -> bool:
        """Whether all steps of time are equal, within a thousandth of a step."""
        steps = np.diff(self.time)
        return bool(np.ptp(steps) <= 1e-3 * steps.mean())

    def channel(self, name: str | int) -> Channel:
        """Return a column.

        Parameters
        ----------
        name : str or int
            Name, or number from 0, also as text; the unit by which it was read may follow.

        Returns
        -------
        Channel
            The column.

        Raises
        ------
        RecordError
            There is no such column.
        """
        names = [c.name for c in self.channels]
        number, unit = column_and_unit(names, name)
        if unit and not _is_unit(unit):
            column_number(names, name)  # this raises the error of a missing column
        return self.channels[number]

    def to_frame(self) -> "pandas.DataFrame":
        """Return time and channels as a data frame, named with their units; needs pandas."""
        over = {"time": "time [s]", "frequency": "frequency [Hz]"}.get(self.over, self.over)
        frame = {over: self.time}
        for k, channel in enumerate(self.channels):
            name = f"{channel.name} [{channel.unit}]" if channel.unit else channel.name
            twice = sum(other.name == channel.name for other in self.channels) > 1
            frame[f"{k}: {name}" if twice else name] = channel.values
        return data_frame(frame)


def _is_unit(text: str) -> bool:
    with suppress(UnitError):
        return bool(si_unit(text))
    return False


def column_number(names: Sequence[str], selector: str | int) -> int:
    """Return the number of a column, given by name or number.

    A selector is a name, or a number from 0, also as text; a name takes precedence.

    Examples
    --------
    >>> column_number(["drive", "position"], "position"), column_number(["drive", "y"], "1")
    (1, 1)
    """
    listed = ", ".join(f"{i}: {n}" for i, n in enumerate(names[:40]))
    if len(names) > 40:
        listed += f" and {len(names) - 40} more"
    if isinstance(selector, str):
        text = selector.strip()
        exact = [i for i, n in enumerate(names) if n == text]
        same = exact or [i for i, n in enumerate(names) if n.lower() == text.lower()]
        if len(same) > 1:
            raise RecordError(
                f"there are {len(same)} columns '{text}': select one by its number, of {listed}"
            )
        if same:
            return same[0]
        number = int(text) if text.isascii() and text.isdigit() and len(text) < 9 else -1
    else:
        number = -1 if isinstance(selector, bool) else int(selector)
    if 0 <= number < len(names):
        return number
    raise RecordError(f"there is no column {selector!r}: the record has {listed}")


def column_and_unit(names: Sequence[str], selector: str | int) -> tuple[int, str]:
    """Return the number of a selected column, and the unit after it.

    The unit is empty if there is none; a complete name has no unit after it.

    Examples
    --------
    >>> column_and_unit(["drive", "position 2"], "1 um")
    (1, 'um')
    >>> column_and_unit(["drive", "position 2"], "position 2")
    (1, '')
    """
    try:
        return column_number(names, selector), ""
    except RecordError:
        words = str(selector).split()
        for end in range(len(words) - 1, 0, -1):
            unit = " ".join(words[end:])
            with suppress(RecordError):
                if not unit.isdecimal():
                    return column_number(names, " ".join(words[:end])), unit
        raise
