"""Motion before a record, which sets the memory of its hysteresis."""

from dataclasses import replace
from typing import Any

import numpy as np

from flexstage.hysteresis.identification.cycles import RecordSection, memories

#: Periods before a record of one, after which also a memory that only fades repeats.
_REPEATS = 4


def with_history(section: RecordSection) -> RecordSection:
    """Return a section that begins with the motion that set its memory.

    Before one period that is the turning points of several.
    """
    moves = section.cycles
    before = memories(moves.range, section.u[0])[section.memory]
    if section.periodic:
        before = np.tile(section.u[moves.turning], _REPEATS)
    n = before.size

    def longer(values: Any, first: Any) -> Any:
        if values is None:
            return None
        return np.concatenate((np.full((n, *values.shape[1:]), first), values))

    return replace(
        _later(section, n),
        u=np.concatenate((before, section.u)),
        y=longer(section.y, section.y[0]),
        nuisance=longer(section.nuisance, section.nuisance[0]),
        measured=longer(section.measured, first=False),
        straight=longer(section.straight, first=True),
        history=n,
    )


def without_history(section: RecordSection) -> RecordSection:
    """Return the measured samples of a section."""
    n = section.history
    names = "u", "y", "nuisance", "measured", "straight"
    arrays = {name: getattr(section, name) for name in names}
    shorter = {name: None if a is None else a[n:] for name, a in arrays.items()}
    return replace(_later(section, -n), **shorter, history=0)


def _later(section: RecordSection, samples: int) -> RecordSection:
    """Section whose cycles and warm-up are later by a number of samples."""
    moves = section.cycles
    moves = replace(moves, bounds=moves.bounds + samples, turning=moves.turning + samples)
    return replace(section, cycles=moves, warm_up=section.warm_up + samples)
