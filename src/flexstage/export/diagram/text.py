"""How much room text takes in a drawing, estimated on the safe side."""

#: Sizes of letters [px].
BASE = 12.0
SMALL = 10.0

# Widths over the size of letters, for the wider of the usual sans-serif fonts.
_NARROW = frozenset("iljtfrI.,:;'|!()[]/ ")
_WIDE = frozenset("mwMWΣ×→")


def plain(text: str) -> str:
    """Return a text as it is read, without the marks of subscripts: ``kin`` for ``k_in``."""
    return text.replace("_", "")


def text_width(text: str, size: float = BASE) -> float:
    """Return a width that a text does not exceed [px].

    Examples
    --------
    >>> text_width("mass") > text_width("mile")
    True
    """
    units = sum(0.36 if c in _NARROW else 0.95 if c in _WIDE else 0.64 for c in text)
    return units * size


def wrapped(text: str, width: float, size: float = BASE) -> list[str]:
    """Break a text into lines; a word that is wider than a line stands alone."""
    lines: list[str] = []
    for word in text.split():
        if lines and text_width(f"{lines[-1]} {word}", size) <= width:
            lines[-1] += f" {word}"
        else:
            lines.append(word)
    return lines
