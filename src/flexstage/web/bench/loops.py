"""The loop of a run at the bench: what followed over the command, or over what was wanted."""

import numpy as np

from flexstage.hysteresis import Tracking, cycles, loop_width, tracking
from flexstage.records import Record

#: Columns of a command that was made to follow a reference.
COMMAND, REFERENCE = "command", "reference"


def loop_of(record: Record, axis: str) -> tuple[str, str] | None:
    """Return which columns are a loop: over what was wanted, else over what was commanded."""
    known = [channel.name for channel in record.channels]
    over = next((n for n in (REFERENCE, f"voltage {axis}", COMMAND) if n in known), None)
    return (over, axis) if over is not None and axis in known else None


def loop_figures(record: Record, loop: tuple[str, str]) -> tuple[Tracking, int] | None:
    """Return the width of a loop [m], the error of a reference [m], and the number of cycles.

    The errors are NaN where nothing was wanted; None where there is no whole cycle.
    """
    over, along = (record.channel(name) for name in loop)
    bounds = cycles(over.values, 1.0 / record.sample_rate_hz).bounds
    if bounds.size < 2:
        return None
    count = bounds.size - 1
    if over.name == REFERENCE:
        return tracking(over.values, along.values, bounds), count
    width = loop_width(over.values, along.values, bounds)
    return Tracking(loop_width=width, rms=np.nan, largest=np.nan), count
