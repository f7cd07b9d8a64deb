"""How much a packed file of measured data may unpack to."""

from flexstage.errors import RecordError

#: Every file may unpack to `_ALWAYS`, a large one to `_RATIO` times its size, none to more than
#: `_NEVER` [bytes]. Measured data with noise pack to a half or a tenth.
_ALWAYS, _RATIO, _NEVER = 2**28, 100, 2**32


def most_unpacked(packed: int) -> int:
    """Return how much a file may unpack to.

    Examples
    --------
    >>> most_unpacked(1_000_000), most_unpacked(10_000_000)
    (268435456, 1000000000)
    """
    return min(max(_ALWAYS, _RATIO * packed), _NEVER)


def require_unpacked(unpacked: int, packed: int, what: str) -> None:
    """Refuse what unpacks to more than measured data do, before memory is taken for it."""
    if unpacked > most_unpacked(packed):
        raise RecordError(
            f"{what} is too large to read: {unpacked / 1e6:,.0f} MB from a file of "
            f"{packed / 1e6:.3g} MB; save a part of it, or save it without compression"
        )
