"""SVG drawings: elements, text and its width, and the complete file."""

from collections.abc import Iterable
from html import escape
from typing import Any

# Widths of letters over their size, for wide sans-serif fonts.
_NARROW, _WIDE = frozenset("iljtfrI.,:;'|!()[]/ -"), frozenset("mwMW%@Σ×→")
_OF_NARROW, _OF_WIDE, _OF_DIGIT, _OF_OTHER = 0.42, 1.0, 0.65, 0.72


def number(value: float, digits: int = 4) -> str:
    """Return a number to some decimals, without trailing zeros.

    Examples
    --------
    >>> number(1.50), number(-0.00001), number(1189.12345)
    ('1.5', '0', '1189.1235')
    """
    text = f"{value:.{digits}f}".rstrip("0").rstrip(".")
    return "0" if text == "-0" else text


def element(tag: str, content: str = "", **attributes: Any) -> str:
    """Return an element; underscores in names become hyphens, None is omitted.

    Examples
    --------
    >>> element("line", x1=1.50, stroke_width=2, fill=None)
    '<line x1="1.5" stroke-width="2"/>'
    """
    text = "".join(
        f' {name.replace("_", "-")}="{escape(_attribute_text(value))}"'
        for name, value in attributes.items()
        if value is not None
    )
    return f"<{tag}{text}>{content}</{tag}>" if content else f"<{tag}{text}/>"


def _attribute_text(value: object) -> str:
    return number(value) if isinstance(value, float) else str(value)


def moved(content: str, x: float, y: float) -> str:
    """Return elements with their origin at (x, y)."""
    return element("g", content, transform=f"translate({number(x)} {number(y)})")


def path(points: Iterable[tuple[float, float]], *, closed: bool = False, **attributes: Any) -> str:
    """Return a line through points."""
    d = "M" + "L".join(f"{number(x)} {number(y)}" for x, y in points)
    return element("path", d=d + ("Z" if closed else ""), **attributes)


def text_width(text: str, size: float) -> float:
    """Return an upper estimate of the width of a line of text, in the unit of its size.

    Examples
    --------
    >>> round(text_width("R1.5", 2.8), 2)
    6.83
    """
    return size * sum(map(_width, text))


def _width(letter: str) -> float:
    if letter in _NARROW:
        return _OF_NARROW
    if letter in _WIDE:
        return _OF_WIDE
    return _OF_DIGIT if letter.isdigit() else _OF_OTHER


def wrapped(text: str, width: float, size: float, *, break_words: bool = False) -> list[str]:
    """Break a text into lines; a word wider than a line is alone on it, or is broken.

    Examples
    --------
    >>> wrapped("one two three", 2.5, 1.0)
    ['one', 'two', 'three']
    >>> wrapped("one two three", 2.5, 1.0, break_words=True)
    ['one', 'two', 'thre', 'e']
    """
    lines: list[str] = []
    line = ""
    for word in text.split():
        remaining = word
        while remaining:
            trial = f"{line} {remaining}".strip()
            if text_width(trial, size) <= width or not (line or break_words):
                line, remaining = trial, ""
            elif line:
                lines.append(line)
                line = ""
            else:
                keep = len(remaining)
                while keep > 1 and text_width(remaining[:keep], size) > width:
                    keep -= 1
                lines.append(remaining[:keep])
                remaining = remaining[keep:]
    return [*lines, line] if line else lines


def document(
    width: float,
    height: float,
    parts: Iterable[str],
    *,
    title: str,
    description: str = "",
    unit: str = "",
    **attributes: Any,
) -> bytes:
    """Return a drawing on a white background; the unit is that of its lengths on paper.

    It needs no external fonts or scripts.
    """
    w, h = number(width), number(height)
    body = [
        element("title", escape(title)),
        *([element("desc", escape(description))] if description else []),
        element("rect", width=w, height=h, fill="#fff"),
        *parts,
    ]
    root = element(
        "svg",
        "\n" + "\n".join(body) + "\n",
        xmlns="http://www.w3.org/2000/svg",
        width=w + unit,
        height=h + unit,
        viewBox=f"0 0 {w} {h}",
        font_family="Liberation Sans, Arial, Helvetica, sans-serif",
        **attributes,
    )
    return f'<?xml version="1.0" encoding="UTF-8"?>\n{root}\n'.encode()
