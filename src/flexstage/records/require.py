"""Refusing what no figure should be made of: clipped columns, dead sensors, wrong units."""

from collections.abc import Sequence

from flexstage.errors import RecordError
from flexstage.records.quality import saturation
from flexstage.records.record import Channel, Record
from flexstage.units import DIMENSIONS


def require_unclipped(record: Record, columns: Sequence[str | int]) -> None:
    """Refuse columns that are cut off at an end, as by the range of a converter.

    Validity
    --------
    That of `saturation`: a motion that holds its end looks the same, if it is free of noise.

    Examples
    --------
    >>> import numpy as np
    >>> t = np.arange(400) / 200.0
    >>> y = np.minimum(np.sin(7.0 * t), 0.83)
    >>> record = Record(channels=(Channel(name="pos", values=y, unit="m"),), time=t)
    >>> try:
    ...     require_unclipped(record, ["pos"])
    ... except RecordError as error:
    ...     print(str(error).partition(":")[0])
    column 'pos' is cut off at 0.83 m (80 of 400 samples)
    """
    for selector in columns:
        channel = record.channel(selector)
        if channel.values.size < 3:
            continue
        found = saturation(channel.values)
        ends = [
            f"{value:.6g}{' ' + channel.unit if channel.unit else ''} ({count} of "
            f"{channel.values.size} samples)"
            for clipped, value, count in (
                (found.clipped_low, found.low, found.at_low),
                (found.clipped_high, found.high, found.at_high),
            )
            if clipped
        ]
        if ends:
            raise RecordError(
                f"column '{channel.name}' is cut off at {' and at '.join(ends)}: widen the range "
                "of its sensor or converter and record it again, or read rows without it by the "
                "option rows"
            )


def require_live(record: Record, columns: Sequence[str | int]) -> None:
    """Refuse columns that never change, as those of a sensor that is dead or not connected.

    Validity
    --------
    An open input that picks up noise is not found.

    Examples
    --------
    >>> import numpy as np
    >>> t = np.arange(3.0)
    >>> record = Record(channels=(Channel(name="y", values=np.full(3, 0.7), unit="m"),), time=t)
    >>> try:
    ...     require_live(record, ["y"])
    ... except RecordError as error:
    ...     print(str(error).partition(":")[0])
    column 'y' is 0.7 m at all of its 3 samples
    """
    for selector in columns:
        channel = record.channel(selector)
        if (channel.values == channel.values[0]).all():
            unit = f" {channel.unit}" if channel.unit else ""
            raise RecordError(
                f"column '{channel.name}' is {channel.values[0]:.6g}{unit} at all of its "
                f"{channel.values.size} samples: its sensor is dead or not connected; choose "
                "another column, or record it again"
            )


def require_unit(record: Record, column: str | int, unit: str) -> Channel:
    """Return a column, and refuse one that is in another unit or in none.

    `unit` is an SI unit, such as ``m``.

    Examples
    --------
    >>> import numpy as np
    >>> t = np.arange(3.0)
    >>> record = Record(channels=(Channel(name="y", values=t, unit="V"),), time=t)
    >>> try:
    ...     _ = require_unit(record, "y", "m")
    ... except RecordError as error:
    ...     print(str(error).partition(":")[0])
    column 'y' is in V, and a length (m) is needed
    """
    channel = record.channel(column)
    if channel.unit == unit:
        return channel
    known = next((d for d in DIMENSIONS.values() if d.si == unit), None)
    needed = f"{known.noun} ({unit})" if known is not None else f"the unit {unit}"
    example = known.units[0] if known is not None else unit
    if not channel.unit:
        raise RecordError(
            f"column '{channel.name}' has no unit, and {needed} is needed: give its unit, such as "
            f"{example}, by the option of the column's unit"
        )
    raise RecordError(
        f"column '{channel.name}' is in {channel.unit}, and {needed} is needed: choose another "
        "column, or give the unit that its numbers have"
    )
