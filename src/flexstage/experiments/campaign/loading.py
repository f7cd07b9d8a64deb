"""Records of a test, with the necessary columns in the necessary units."""

from collections.abc import Sequence
from dataclasses import fields
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from flexstage.base.arrays import Array
from flexstage.base.errors import RecordError
from flexstage.experiments.campaign.plan import KINDS, Columns, Test
from flexstage.quantities.units import DIMENSIONS
from flexstage.records import Channel, Record, read_record, saturation
from flexstage.records.quality import require_live, require_unclipped

#: Allowed units by role; a role that is not listed may have any unit.
_UNITS: dict[str, tuple[str, ...]] = {
    **dict.fromkeys(("along", "across", "vertical", "x", "y", "upward", "downward"), ("m",)),
    **dict.fromkeys(("radial", "radial_90", "axial"), ("m",)),
    **dict.fromkeys(("roll", "pitch", "yaw", "angle", "tilt"), ("rad",)),
    "command": ("V", "m", "1", "rad", "count"),
}
#: Roles of sensors, which must not be clipped.
_SENSORS = frozenset(("along", "across", "vertical", "roll", "pitch", "yaw"))


def load_records(test: Test, folder: Path) -> list[Record]:
    """Read the records of a test."""
    units: dict[str, str] = {}
    for f in fields(Columns):
        at, unit = getattr(test.columns, f.name), getattr(test.units, f.name)
        if isinstance(at, str) and isinstance(unit, str):
            units[at] = unit
        elif isinstance(at, tuple) and unit:
            units |= _unit_of_each(f.name, at, unit, test)
    columns = columns_of(test)
    records = [
        read_record(
            folder / name,
            how,
            units=units,
            columns=columns or None,
            over="point" if KINDS[test.test].points else "time",
            labels=test.columns.direction,
        )
        for name, how in zip(test.records, test.reading.of_each(len(test.records)), strict=True)
    ]
    for record in records:
        _require_kind(test, record)
    return records


def _require_kind(test: Test, record: Record) -> None:
    """Refuse a record whose independent variable the test does not support."""
    allowed = KINDS[test.test].over
    if record.over not in allowed:
        such = {"time": "samples with times or a rate", "point": "rows of points"}
        such["frequency"] = "responses over frequency"
        raise RecordError(
            f"test '{test.name}' of kind {test.test}: '{record.source}' is over {record.over}, "
            f"and it needs {' or '.join(such[kind] for kind in allowed)}"
        )


def columns_of(test: Test) -> list[str]:
    """Return the columns that a test uses, by name or number."""
    roles = test.columns
    listed = [*roles.named().values(), *roles.output, *roles.upward, *roles.downward]
    if test.test == "spheres":
        listed += [name for sphere in test.columns.spheres for name in sphere_columns(sphere)]
    return list(dict.fromkeys(listed))


def sphere_columns(sphere: str) -> tuple[str, str, str]:
    """Return the columns of a sphere's centre.

    Examples
    --------
    >>> sphere_columns("SPH2")
    ('SPH2.X', 'SPH2.Y', 'SPH2.Z')
    >>> sphere_columns("SPH2 mm")
    ('SPH2.X mm', 'SPH2.Y mm', 'SPH2.Z mm')
    """
    name, space, unit = sphere.rpartition(" ")
    if unit not in DIMENSIONS["length"].units:
        name, space, unit = sphere, "", ""
    return (f"{name}.X{space}{unit}", f"{name}.Y{space}{unit}", f"{name}.Z{space}{unit}")


def _unit_of_each(role: str, at: Sequence[str], unit: Sequence[str], test: Test) -> dict[str, str]:
    if len(unit) not in (1, len(at)):
        raise RecordError(
            f"test '{test.name}': {role} has {len(at)} columns and {len(unit)} units: give one, "
            "or one for each"
        )
    each = list(unit) * (len(at) if len(unit) == 1 else 1)
    if role == "spheres":
        return {c: u for s, u in zip(at, each, strict=True) for c in sphere_columns(s)}
    return dict(zip(at, each, strict=True))


def column(test: Test, record: Record, role: str) -> Array:
    """Return the values of the column that has a role, in SI units.

    `role` is a field of `Columns`. A column that never changes or is cut off is refused, and one
    whose unit is not said or not one that the role can have.
    """
    named = getattr(test.columns, role)
    if not isinstance(named, str):
        raise RecordError(
            f"test '{test.name}' of kind {test.test} needs the column of '{role}': name it"
        )
    channel = _in_unit(test, record, role, named)
    require_live(record, [channel.name])
    if role in _SENSORS and not KINDS[test.test].points:
        _require_whole(test, record, channel)
    return channel.values


def runs_of(test: Test, record: Record, role: str) -> Array:
    """Return the columns that have a role together, in SI units, shape (n, columns).

    `role` is a field of `Columns` that names several.
    """
    columns = getattr(test.columns, role)
    if not columns:
        raise RecordError(
            f"test '{test.name}' of kind {test.test} needs the columns of '{role}', one for each "
            "run: name them"
        )
    return np.stack([_in_unit(test, record, role, name).values for name in columns], axis=1)


def _in_unit(test: Test, record: Record, role: str, column: str) -> Channel:
    """Return a column; refuse a unit that its role cannot have."""
    channel = record.channel(column)
    allowed = _UNITS.get(role)
    if test.test == "positioning" and role != "command" and test.columns.command is not None:
        # readings at the targets of a rotary axis are angles too
        allowed = ("rad",) if record.channel(test.columns.command).unit == "rad" else ("m",)
    if allowed is not None and channel.unit not in allowed:
        got = f"is in {channel.unit}" if channel.unit else "does not give its unit"
        expected = "a unit of length" if allowed == ("m",) else f"one of {', '.join(allowed)}"
        expected = "a unit of angle" if allowed == ("rad",) else expected
        raise RecordError(
            f"test '{test.name}': column '{channel.name}' {got}, and '{role}' needs {expected}: "
            f'add it to the column, such as {role}="{channel.name} '
            f'{"mrad" if allowed == ("rad",) else "um"}", or choose another column'
        )
    return channel


def _require_whole(test: Test, record: Record, channel: Channel) -> None:
    """Refuse a column that stays at one of its ends while the command continues.

    A stage at rest because of its command is not clipped.
    """
    # with fewer distinct values a reading stays at its ends because of its coarse resolution
    fewest_levels = 16
    x = channel.values
    clipping = saturation(x)
    for clipped, end in (
        (clipping.clipped_low, clipping.low),
        (clipping.clipped_high, clipping.high),
    ):
        if not clipped or np.unique(x).size < fewest_levels:
            continue
        if test.columns.command is not None:
            u = record.channel(test.columns.command).values
            a, b = _longest_rest(x == end)
            steps = np.abs(np.diff(u[a:b]))
            if np.count_nonzero(steps > 1e-6 * np.ptp(u)) <= 0.5 * steps.size:
                continue
        require_unclipped(record, [channel.name])


def _longest_rest(where: NDArray[np.bool_]) -> tuple[int, int]:
    edges = np.flatnonzero(np.diff(np.concatenate(([False], where, [False]))))
    starts, stops = edges[::2], edges[1::2]
    k = int(np.argmax(stops - starts))
    return int(starts[k]), int(stops[k])


def optional_column(test: Test, record: Record, role: str) -> Array | None:
    """Return the values of the column that has a role, where one is named."""
    if getattr(test.columns, role) is None:
        return None
    return column(test, record, role)


def only(test: Test, records: list[Record]) -> Record:
    """Return the record of a test that has one."""
    if len(records) != 1:
        raise RecordError(
            f"test '{test.name}' of kind {test.test} is evaluated from one file, got "
            f"{len(records)}: describe a test for each"
        )
    return records[0]
