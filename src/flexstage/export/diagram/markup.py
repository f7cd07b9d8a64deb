"""Words of a diagram: what follows an underscore is lowered."""

from html import escape

from flexstage.export.svg import element, number

#: Sizes of letters [px].
BASE = 12.0
SMALL = 10.0
_LEAST = 9.0


def plain(text: str) -> str:
    """Return a text as it is read, without the marks of subscripts: ``kin`` for ``k_in``."""
    return text.replace("_", "")


def text(
    words: str, x: float, y: float, *, size: float = BASE, anchor: str = "start", **given: object
) -> str:
    """Return a line of text on a base line; an underscore lowers what follows, up to a blank.

    The anchor (``start``, ``middle``, ``end``) says what of it is at (x, y) [px].
    """
    return element(
        "text",
        " ".join(_lowered(word, size) for word in words.split(" ")),
        x=x,
        y=y,
        font_size=size,
        text_anchor=None if anchor == "start" else anchor,
        **given,
    )


def _lowered(word: str, size: float) -> str:
    head, _, low = word.partition("_")
    if not head or not low:
        return escape(word)
    down, small = number(0.22 * size), max(_LEAST, 0.78 * size)
    return (
        escape(head)
        + element("tspan", escape(low), dy=down, font_size=small)
        + element("tspan", "&#8203;", dy=f"-{down}")
    )
