"""How many derivatives of an exponential a whole step takes into account."""

from flexstage.hysteresis.compiled import compiled
from flexstage.hysteresis.model import Array

__all__ = ["LARGEST_RATE", "ORDERS", "terms_needed"]

#: Most derivatives that a step takes into account.
ORDERS = 12

#: Largest rate of an exponential [per sample] for which they suffice to rounding.
LARGEST_RATE = 0.5


@compiled
def terms_needed(amplitude: Array, rate: Array) -> int:
    """Return the number of derivatives that whole steps need for the fastest exponential in reach.

    Parameters
    ----------
    amplitude : numpy.ndarray
        Amplitudes of the exponentials, shape (m,).
    rate : numpy.ndarray
        Their rates [per sample], shape (m,); those above `LARGEST_RATE` go another way.

    Returns
    -------
    int
        The number, from 2 to `ORDERS`.
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
