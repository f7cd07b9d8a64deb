"""How a commanded value goes from one place to another: at a constant rate, sample by sample."""

import math
from dataclasses import dataclass

import numpy as np

from flexstage.arrays import Array


@dataclass(frozen=True, slots=True, kw_only=True)
class Ramp:
    """A straight line from a value to another, then the other for ever.

    Every sample has a closed form in its number, so that it does not matter in which portions they
    are computed.

    Examples
    --------
    >>> Ramp(first=10, start=2.0, end=-1.0, step=1.25).values(9, 5)
    array([ 2.  ,  0.75, -0.5 , -1.  , -1.  ])
    """

    first: int
    """Number of the sample with which it begins; that sample has made the first step already."""
    start: float
    """Both values [m, or V]."""
    end: float
    """Both values [m, or V]."""
    step: float
    """Largest change from one sample to the next [m, or V]."""

    @classmethod
    def hold(cls, value: float) -> "Ramp":
        """Return a ramp that has ended long ago."""
        return cls(first=0, start=value, end=value, step=math.inf)

    @property
    def last(self) -> int:
        """Number of the first sample at the end."""
        steps = abs(self.end - self.start) / self.step
        count = math.ceil(steps)
        # the quotient is rounded: go by what the samples say
        while count and (count - 1) * self.step >= abs(self.end - self.start):
            count -= 1
        while count * self.step < abs(self.end - self.start):
            count += 1
        return self.first + max(count, 1) - 1

    def values(self, first: int, count: int) -> Array:
        """Return samples."""
        distance = abs(self.end - self.start)
        if distance == 0.0:
            return np.full(count, self.end)
        steps = np.arange(first - self.first + 1, first - self.first + 1 + count, dtype=np.float64)
        way = np.maximum(steps, 0.0) * self.step
        return np.where(
            way >= distance, self.end, self.start + math.copysign(1.0, self._rise) * way
        )

    @property
    def _rise(self) -> float:
        return self.end - self.start
