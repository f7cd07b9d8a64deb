"""Names in messages: lists of names, and unknown names with a suggestion.

Upper and lower case are compared as well. `cutoff` is the least similarity of two names, from 0 to
1, as `difflib` defines it.
"""

from collections.abc import Iterable
from difflib import SequenceMatcher

_COMPARED = 100  # characters of a name
_PRINTED = 60  # characters of a name
_PLURAL = {"axis": "axes"}


def nearest(name: str, among: Iterable[str], cutoff: float = 0.6) -> str | None:
    """Return the name most similar to an unknown one, if any is similar enough.

    Examples
    --------
    >>> nearest("MM", ["m", "mm", "um"]), nearest("volt", ["m", "mm", "um"])
    ('mm', None)
    """
    text = name[:_COMPARED]
    best = max(
        ((_similarity(text.casefold(), n.casefold()), _similarity(text, n), n) for n in among),
        default=(0.0, 0.0, ""),
    )
    return best[2] if best[0] >= cutoff else None


def _similarity(name: str, other: str) -> float:
    return SequenceMatcher(None, other, name).ratio()


def did_you_mean(name: str, among: Iterable[str], cutoff: float = 0.6) -> str:
    """Return the end of a message that suggests a name; empty if none is similar.

    Examples
    --------
    >>> did_you_mean("leef", ["circular", "leaf"])
    "; did you mean 'leaf'?"
    """
    near = nearest(name, among, cutoff)
    return f"; did you mean '{near}'?" if near is not None else ""


def listed(words: Iterable[str]) -> str:
    """Join words by commas, the last one by "and".

    Examples
    --------
    >>> listed(["x"]), listed(["x", "y", "z"])
    ('x', 'x, y and z')
    """
    items = list(words)
    return f"{', '.join(items[:-1])} and {items[-1]}" if len(items) > 1 else "".join(items)


def unknown(what: str, name: str, among: Iterable[str], cutoff: float = 0.6) -> str:
    """Return the message for an unknown name: the known names and a suggestion.

    Examples
    --------
    >>> unknown("profile", "leef", ["circular", "leaf"])
    "unknown profile 'leef': expected one of circular, leaf; did you mean 'leaf'?"
    """
    names = list(among)
    hint = did_you_mean(name, names, cutoff)
    return f"unknown {what} '{name[:_PRINTED]}': expected one of {', '.join(names)}{hint}"


def has_no(owner: str, what: str, name: str, among: Iterable[str]) -> str:
    """Return the message for an unknown name of a part of something: the parts and a suggestion.

    Examples
    --------
    >>> has_no("the stage", "axis", "X", ["x", "y"])
    "the stage has no axis 'X': its axes are x, y; did you mean 'x'?"
    """
    names = list(among)
    return (
        f"{owner} has no {what} '{name[:_PRINTED]}': its {_PLURAL.get(what, what + 's')} are "
        f"{', '.join(names) or 'none'}{did_you_mean(name, names)}"
    )
