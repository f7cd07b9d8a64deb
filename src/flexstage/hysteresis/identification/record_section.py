"""One record, as identification looks at it."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from flexstage.base.arrays import Array
from flexstage.hysteresis.drive_model import Start
from flexstage.hysteresis.identification.cycles import Cycles


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RecordSection:
    """One record's input and output."""

    u: Array
    """Input, shape (n,)."""
    y: Array
    """Output, counted so that it rises with the input, shape (n,)."""
    dt: float
    """Time from one sample to the next [s]."""
    cycles: Cycles
    """How the input moves."""
    warm_up: int
    """Number of first samples that still know what was before the record."""
    nuisance: Array
    """Columns that are fitted beside every model and belong to none: the offset, shape (n, 1)."""
    noise: float
    """Estimated standard deviation of the noise of the output, in its unit."""
    input_noise: float = 0.0
    """That of the noise that was taken out of the input, in its unit; 0 for a command."""
    first: int = 0
    """Sample of the record that the first measured one is: a rest before it is left out."""
    begin: float = 0.0
    """When that is in the record [s]."""
    history: int = 0
    """Number of first samples that stand for what was before the record, and were not measured:
    both ends of the range, after which the memory is that of cycles over all of it.
    """
    start: Start = "rested"
    """What the drive did before, for its creep."""
    measured: NDArray[np.bool_] | None = None
    """Whether the output was measured, shape (n,); where not, it lies on a line between the
    neighbours. None where all of it was.
    """
    straight: NDArray[np.bool_] | None = None
    """Of means of neighbouring samples those that stand for them, shape (n,); all where None."""
