"""State of a drive at the end of earlier records, for the record or reference that follows."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from flexstage.base.errors import RecordError
from flexstage.hysteresis.drive_model import DriveModel, DriveState
from flexstage.hysteresis.model import Array
from flexstage.quantities.units import readable
from flexstage.records import Record
from flexstage.records.sampling import require_uniform

#: Largest excess of the commands of the same drive over the range of its model, over that range.
_SAME_DRIVE = 0.1


def part_before(record: Record, following: Record) -> Record:
    """Return the rows of a record before another part of the same file; other records unchanged."""
    if not record.source_hash or record.source_hash != following.source_hash:
        return record
    rows = np.arange(record.size) if record.numbers is None else record.numbers
    first = 0.0 if following.numbers is None else float(following.numbers[0])
    count = int(np.sum(rows < first))
    if count < 2:
        raise RecordError(
            f"{_name(record)} has no rows before those of the record after it, which is the same "
            "file: select later rows of that by --rows, or give another file"
        )
    return replace(
        record,
        channels=tuple(replace(c, values=c.values[:count]) for c in record.channels),
        time=record.time[:count],
        numbers=rows[:count].astype(np.float64),
    )


def state_after(
    model: DriveModel,
    earlier: Sequence[tuple[Record, Array]],
    following: Record,
    before: DriveState,
) -> tuple[DriveState, tuple[str, ...]]:
    """Return the state of a drive one step before a record that follows others, and notes.

    Times decide on a pause between two records, during which the last command is constant. Records
    that begin at the time zero have a clock of their own, and follow at once.

    Parameters
    ----------
    model : DriveModel
        The drive.
    earlier : sequence of (Record, numpy.ndarray)
        The records before, in order, with their commands [`input_unit`].
    following : Record
        The record.
    before : DriveState
        State before the first of the earlier records.

    Raises
    ------
    RecordError
        Two records overlap in time, or the commands are not those of the drive.
    """
    state, notes = before, []
    later = (*(record for record, _ in earlier[1:]), following)
    for (record, commands), after in zip(earlier, later, strict=True):
        require_uniform(record)
        if model.beyond(commands) > _SAME_DRIVE:
            raise RecordError(
                f"{_name(record)} is of another drive or unit: "
                f"{model.outside(commands).partition(': ')[0]}; give a record of the same drive, "
                f"within {100.0 * _SAME_DRIVE:.0f} % of the range"
            )
        pause, why = _pause(record, after)
        state = model.response(commands, 1.0 / record.sample_rate_hz, state)[1]
        if pause:
            # creep is exact for steps of any length; more than the record has would only be slow
            steps = min(round(pause * after.sample_rate_hz), commands.size)
            constant = np.full(steps, state.hysteresis[0])
            state = model.response(constant, pause / steps, state)[1]
        ends = readable(model.input_unit, commands.min(), commands.max(), digits=4)
        length = f"a pause of {readable('s', pause)}" if pause else "no pause"
        notes.append(f"state at the end of {_name(record)}, {ends}; {length} after it, {why}")
    return state, tuple(notes)


def _pause(record: Record, after: Record) -> tuple[float, str]:
    """Return the time at the last command of a record before another begins, and its origin."""
    begin, end, step = float(after.time[0]), float(record.time[-1]), 1.0 / after.sample_rate_hz
    if begin > end:
        pause = begin - end - step
        return (pause if pause > 0.5 * step else 0.0), "by the times of both"
    if abs(begin) < step:
        return 0.0, "as the next times begin at zero"
    raise RecordError(
        f"{_name(after)} begins at {begin:.6g} s and {_name(record)} before it ends at {end:.6g} s:"
        " give records in the order of their times, or write the times of the later one from zero"
    )


def _name(record: Record) -> str:
    return f"'{Path(record.source).name}'" if record.source else "the record"
