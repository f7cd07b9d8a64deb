"""Chunks of samples: whether they can be added to a run, and whether they follow one another."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from flexstage.arrays import Array
from flexstage.errors import RecordError


@dataclass(frozen=True, slots=True, kw_only=True)
class Irregularity:
    """Samples that do not follow the ones before."""

    kind: str
    """Whether samples are missing, or come again."""
    first: int
    """Number of the first sample that is missing, or that comes again."""
    count: int
    """How many."""

    def __str__(self) -> str:
        last = self.first + self.count - 1
        if self.kind == "gap":
            return f"samples {self.first} to {last} were never given"
        return f"samples {self.first} to {last} were given twice; the first ones count"


def checked_chunk(
    names: Sequence[str], first: int, columns: Mapping[str, ArrayLike]
) -> list[Array]:
    """Return the samples of a chunk, if they can be added to a run."""
    whole = isinstance(first, (int, np.integer)) and not isinstance(first, bool)
    # times are doubles, which count no further
    if not whole or not 0 <= first < 2**53:
        raise RecordError(f"the first sample must be a whole number from 0, got {first!r}")
    if set(columns) != set(names) or len(columns) != len(names):
        raise RecordError(
            f"a chunk must have the channels {', '.join(names)}, got "
            f"{', '.join(map(str, columns)) or 'none'}"
        )
    values: list[Array] = []
    for name in names:
        v = np.asarray(columns[name])
        if v.dtype.kind not in "buif" or v.ndim != 1:
            raise RecordError(
                f"channel '{name}' must be a row of numbers, got {v.dtype} of shape {v.shape}"
            )
        # a copy, as a chunk may wait in memory while the caller fills the array anew
        values.append(np.array(v, dtype="<f8", order="C"))
    sizes = {v.size for v in values}
    if len(sizes) > 1:
        raise RecordError(
            "the channels of a chunk must have equally many samples, got "
            + ", ".join(f"{n}: {v.size}" for n, v in zip(names, values, strict=True))
        )
    return values
