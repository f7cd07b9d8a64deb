"""Names in a sentence: several, and one that is none of those there are, with what was meant.

Names of any case are compared. `cutoff` is how alike two must be, 0 to 1, as `difflib` counts it.
"""

from collections.abc import Iterable
from difflib import SequenceMatcher

_LONGEST = 100  # what is compared of a name
_SHOWN = 60  # what is shown of it
_PLURAL = {"axis": "axes"}


def nearest(name: str, among: Iterable[str], cutoff: float = 0.6) -> str | None:
    """Return the name that a wrong one is most like, if any is like enough.

    Examples
    --------
    >>> nearest("MM", ["m", "mm", "um"]), nearest("volt", ["m", "mm", "um"])
    ('mm', None)
    """
    given = name[:_LONGEST]
    found = max(
        ((_likeness(given.casefold(), n.casefold()), _likeness(given, n), n) for n in among),
        default=(0.0, 0.0, ""),
    )
    return found[2] if found[0] >= cutoff else None


def _likeness(given: str, other: str) -> float:
    return SequenceMatcher(None, other, given).ratio()


def did_you_mean(name: str, among: Iterable[str], cutoff: float = 0.6) -> str:
    """Return the end of a sentence that names what was probably meant; nothing if that is open.

    Examples
    --------
    >>> did_you_mean("leef", ["circular", "leaf"])
    "; did you mean 'leaf'?"
    """
    near = nearest(name, among, cutoff)
    return f"; did you mean '{near}'?" if near is not None else ""


def listed(words: Iterable[str]) -> str:
    """Write words with commas between, and "and" before the last.

    Examples
    --------
    >>> listed(["x"]), listed(["x", "y", "z"])
    ('x', 'x, y and z')
    """
    items = list(words)
    return f"{', '.join(items[:-1])} and {items[-1]}" if len(items) > 1 else "".join(items)


def unknown(what: str, name: str, among: Iterable[str], cutoff: float = 0.6) -> str:
    """Return the sentence that refuses a name: what it is of, those there are, which was meant.

    Examples
    --------
    >>> unknown("profile", "leef", ["circular", "leaf"])
    "unknown profile 'leef': expected one of circular, leaf; did you mean 'leaf'?"
    """
    names = list(among)
    hint = did_you_mean(name, names, cutoff)
    return f"unknown {what} '{name[:_SHOWN]}': expected one of {', '.join(names)}{hint}"


def has_no(owner: str, what: str, name: str, among: Iterable[str]) -> str:
    """Return the sentence that refuses a name of what an owner has, and says what there is.

    Examples
    --------
    >>> has_no("the stage", "axis", "X", ["x", "y"])
    "the stage has no axis 'X': its axes are x, y; did you mean 'x'?"
    """
    names = list(among)
    return (
        f"{owner} has no {what} '{name[:_SHOWN]}': its {_PLURAL.get(what, what + 's')} are "
        f"{', '.join(names) or 'none'}{did_you_mean(name, names)}"
    )
