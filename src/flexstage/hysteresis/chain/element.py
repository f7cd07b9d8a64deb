"""What the elements of a linear chain share: step, state, frequency response, terms of a series."""

from abc import ABC, abstractmethod

import numpy as np
from numpy.typing import ArrayLike

from flexstage.base.arrays import Complex
from flexstage.base.errors import ModelError
from flexstage.hysteresis.compiled import compiled
from flexstage.hysteresis.model import Array, Response, checked

#: Most derivatives that a step takes into account.
ORDERS = 12

#: Largest rate of an exponential [per sample] for which they suffice to rounding.
LARGEST_RATE = 0.5


#: What times of an element are between, other than none at all [s]; 1e9 s are 30 years.
SHORTEST, LONGEST = 1e-12, 1e9


class ChainElement(ABC):
    """A linear relation from a sampled input x to a sampled output y.

    The samples are a constant step dt apart and the input is a straight line between them; for such
    an input the output is exact at the samples.

    A state is an array that belongs to the last sample, and its first element is the last input:
    a jump of the input is made by writing its new value there. The next sample is one step later.
    Where no state is given the element has settled at the first sample: it has long had that input.
    """

    __slots__ = ()

    @abstractmethod
    def settled(self, x: float, dt: float) -> Array:
        """Return the state after a constant input for a long time.

        The step dt [s] matters only where a delay is kept as past samples.
        """

    @abstractmethod
    def simulate(self, x: ArrayLike, dt: float, state: ArrayLike | None = None) -> Response:
        """Return the output for a sequence of inputs."""

    def _started(self, first: float, dt: float, state: ArrayLike | None, what: str) -> Array:
        """Return a private copy of a state after checking its size, or the settled one."""
        rest = self.settled(first, dt)
        return rest if state is None else checked_state(state, rest.size, what)

    @abstractmethod
    def frequency_response(self, frequency_hz: ArrayLike) -> Complex:
        """Return the ratio of output to input for a steady sine."""


def positive_step(dt: float) -> float:
    """Return a step between samples after checking it."""
    return checked(dt, "step between samples", "positive and finite", "s")


def checked_state(state: ArrayLike, size: int, what: str) -> Array:
    """Return a private copy of a state after checking its size."""
    given = np.array(state, dtype=np.float64)
    if given.shape != (size,) or not np.all(np.isfinite(given)):
        raise ModelError(
            f"a state of {what} is {size} finite numbers at this step, got shape {given.shape}"
        )
    return given


@compiled
def terms_needed(amplitude: Array, rate: Array) -> int:
    """Return how many derivatives whole steps need for the fastest exponential in reach.

    Rates are per sample; exponentials above `LARGEST_RATE` go another way. From 2 to `ORDERS`.
    """
    fastest = 0.0
    for i in range(rate.size):
        if amplitude[i] != 0.0 and abs(rate[i]) <= LARGEST_RATE:
            fastest = max(fastest, abs(rate[i]))
    terms, size = 2, 1.0
    while terms < ORDERS and size > 1e-18:
        size *= fastest / (terms + 2.0)
        terms += 1
    return terms
