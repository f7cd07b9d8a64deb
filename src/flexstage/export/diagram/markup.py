"""Pieces of SVG."""

from xml.sax.saxutils import escape

from flexstage.export.diagram.text import BASE


def attributes(**given: object) -> str:
    """Return attributes, each behind a blank, with hyphens for underscores, without those of None.

    Examples
    --------
    >>> attributes(x=1.50, stroke_width=2)
    ' x="1.5" stroke-width="2"'
    """
    out = []
    for name, value in given.items():
        if value is None:
            continue
        shown = f"{value:.6g}" if isinstance(value, float) else str(value)
        quoted = escape(shown, {'"': "&quot;"})
        out.append(f' {name.replace("_", "-")}="{quoted}"')
    return "".join(out)


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
