"""How many derivatives of an exponential a whole step takes into account."""

from flexstage.hysteresis.compiled import compiled
from flexstage.hysteresis.model import Array

#: Most derivatives that a step takes into account.
ORDERS = 12

#: Largest rate of an exponential [per sample] for which they suffice to rounding.
LARGEST_RATE = 0.5


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
