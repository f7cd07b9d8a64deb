"""Lines and words of a diagram as SVG, and how much room words take."""

from xml.sax.saxutils import escape

from flexstage.export.svg_elements import LetterWidths, attributes, in_lines

#: Sizes of letters [px].
BASE = 12.0
SMALL = 10.0

_WIDTHS = LetterWidths(
    narrow_letters=frozenset("iljtfrI.,:;'|!()[]/ "),
    wide_letters=frozenset("mwMWΣ×→"),
    narrow=0.36,
    wide=0.95,
    digit=0.64,
    other=0.64,
)


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
    return _WIDTHS.of(text, size)


def wrapped(text: str, width: float, size: float = BASE) -> list[str]:
    """Break a text into lines; a word that is wider than a line stands alone."""
    return in_lines(text, lambda line: text_width(line, size) <= width)


def path(points: list[tuple[float, float]], *, closed: bool = False, **given: object) -> str:
    """Return a line through points [px]."""
    d = "M" + "L".join(f"{round(x, 2):g} {round(y, 2):g}" for x, y in points)
    return f"<path{attributes(d=d + ('Z' if closed else ''), **given)}/>"


def text(
    words: str, x: float, y: float, *, size: float = BASE, anchor: str = "start", **given: object
) -> str:
    """Return a line of text on a base line; what follows an underscore is lowered, up to a blank.

    The anchor (``start``, ``middle``, ``end``) says what of it is at (x, y) [px].
    """
    shown = attributes(
        x=round(x, 2),
        y=round(y, 2),
        font_size=size,
        text_anchor=None if anchor == "start" else anchor,
        **given,
    )
    return f"<text{shown}>{_rich(words, size)}</text>"


def _rich(words: str, size: float) -> str:
    out = []
    small = max(9.0, 0.78 * size)
    for k, word in enumerate(words.split(" ")):
        head, mark, low = word.partition("_")
        lead = " " if k else ""
        if not mark or not head or not low:
            out.append(escape(lead + word))
            continue
        out.append(
            f'{escape(lead + head)}<tspan dy="{0.22 * size:.3g}" font-size="{small:.3g}">'
            f'{escape(low)}</tspan><tspan dy="-{0.22 * size:.3g}">&#8203;</tspan>'
        )
    return "".join(out)
