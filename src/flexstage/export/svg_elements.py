"""SVG as text: elements with their attributes, and how much room text takes in a drawing."""

from collections.abc import Callable
from typing import NamedTuple
from xml.sax.saxutils import escape


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


class LetterWidths(NamedTuple):
    """Widths of letters over their size, for the wider of the usual sans-serif fonts [1]."""

    narrow_letters: frozenset[str]
    """The narrow ones."""
    wide_letters: frozenset[str]
    """The wide ones."""
    narrow: float
    """Width of a narrow letter."""
    wide: float
    """Width of a wide one."""
    digit: float
    """Width of a digit that is neither."""
    other: float
    """Width of any other letter."""

    def of(self, text: str, size: float) -> float:
        """Return about how wide a line of text is, in the unit of the size, rather too much."""
        return size * sum(self._of_letter(c) for c in text)

    def _of_letter(self, c: str) -> float:
        if c in self.narrow_letters:
            return self.narrow
        if c in self.wide_letters:
            return self.wide
        return self.digit if c.isdigit() else self.other


def in_lines(text: str, fits: Callable[[str], bool], *, break_words: bool = False) -> list[str]:
    """Break a text into lines that fit; a word that does not stands alone, or is broken.

    Examples
    --------
    >>> in_lines("one two three", lambda line: len(line) <= 4)
    ['one', 'two', 'three']
    >>> in_lines("one two three", lambda line: len(line) <= 4, break_words=True)
    ['one', 'two', 'thre', 'e']
    """
    lines: list[str] = []
    line = ""
    for word in text.split():
        rest = word
        while rest:
            trial = f"{line} {rest}".strip()
            if fits(trial) or not (line or break_words):
                line, rest = trial, ""
            elif line:
                lines.append(line)
                line = ""
            else:
                keep = len(rest)
                while keep > 1 and not fits(rest[:keep]):
                    keep -= 1
                lines.append(rest[:keep])
                rest = rest[keep:]
    return [*lines, line] if line else lines
