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


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Channel:
    """One column of a record."""

    name: str
    """What it is called."""
    values: Array
    """Its samples, shape (n,): SI where `unit` is an SI unit, else as in the file."""
    unit: str = ""
    """Unit of `values`: ``V``, ``m``, ``N``...; empty where nobody has said."""
    texts: tuple[str, ...] = ()
    """The texts that `values` number, from 0, of a column that labels rows."""

    __repr__ = short_repr


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Record:
    """Columns that were sampled together."""

    channels: tuple[Channel, ...]
    """The columns, each with n samples."""
    time: Array
    """Time of each sample, rising [s], shape (n,); the frequency [Hz], or the number of the point
    from 0, where `over` says so.
    """
    source: str = ""
    """Where it comes from: a file, an instrument, a simulation."""
    source_hash: str = ""
    """SHA-256 of the file; empty where there is none."""
    notes: tuple[str, ...] = ()
    """What a reader should know."""
    attributes: Mapping[str, str] = field(default_factory=dict)
    """Further text from the file."""
    over: Literal["time", "frequency", "point"] = "time"
    """What the samples follow one another by: time, frequency as in a spectrum, or no more than
    their number, as points of a measuring machine.
    """
    numbers: Array | None = None
    """Number that each sample has in the file, from 0, where it is not the one that it has here: of
    a part, and between two where it was resampled; NaN where nothing was measured. Shape (n,).
    """

    __repr__ = short_repr

    def __post_init__(self) -> None:
        t = self.time
        if t.ndim != 1 or t.size < 2 or not np.all(np.diff(t) > 0.0):
            raise RecordError("the times of a record must be at least two and rise")
        for channel in self.channels:
            if channel.values.shape != t.shape:
                raise RecordError(
                    f"column '{channel.name}' must have {t.size} samples as the time has, got "
                    f"shape {channel.values.shape}"
                )
        if self.numbers is not None and self.numbers.shape != t.shape:
            raise RecordError(
                f"the {t.size} samples of a record must have a number each, got shape "
                f"{self.numbers.shape}"
            )

    @property
    def size(self) -> int:
        """Number of samples."""
        return self.time.size

    @property
    def sample_rate_hz(self) -> float:
        """Mean number of samples in a second [Hz]."""
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
            Its name, or its number from 0, which may be a text; a unit by which it was read may
            stand behind.

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
        found = self.channels[number]
        if unit and not _is_unit(unit):
            column_number(names, name)  # which says that there is no such column
        return found

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
    """Return the number of a column that is asked for by name or by number.

    A selector is a name, or a number from 0, also as text; a name goes before a number.

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
                f"there are {len(same)} columns '{text}': choose one by its number, of {listed}"
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
    """Return the number of a column that is asked for, and the unit that stands behind it.

    The unit is empty where there is none; what is a name as a whole has none behind it.

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
