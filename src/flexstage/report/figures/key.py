"""The key beside a drawing: numbers and colours with the names that they stand for."""

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal

from flexstage.report.figures.style import INK, MUTED, PAPER

if TYPE_CHECKING:
    from matplotlib.axes import Axes

#: Width of one column of the key [inch].
COLUMN_WIDTH = 1.45
_ROW = 0.155  # height of a row [inch]
_LONGEST_NAME = 15
_MOST_COLUMNS = 4


@dataclass(frozen=True, slots=True, kw_only=True)
class Entry:
    """A row of the key."""

    kind: Literal["heading", "disc", "number", "arrow", "swatch", "gap"]
    """``heading``, ``disc`` (a number in a disc), ``number``, ``arrow``, ``swatch`` or ``gap``."""
    text: str = ""
    """The name."""
    mark: str = ""
    """The number that stands in the drawing."""
    detail: str = ""
    """What stands at the right end of the row."""
    colour: str = INK
    """Colour of the mark."""


def arrange(entries: list[Entry], height: float) -> list[list[Entry]]:
    """Break a key into columns of so many inches; the last row says how many were left out."""
    fit = max(int(height / _ROW), 8)
    columns = min(math.ceil(len(entries) / fit), _MOST_COLUMNS)
    if len(entries) > columns * fit:
        left_out = len(entries) - columns * fit + 1
        entries = [*entries[: columns * fit - 1], Entry(kind="gap", text=f"… and {left_out} more")]
    out: list[list[Entry]] = [[]]
    for entry in entries:
        alone = entry.kind == "heading" and len(out[-1]) == fit - 1
        if len(out[-1]) == fit or (alone and len(out) < columns):
            out.append([])
        if out[-1] or entry.kind != "gap" or entry.text:
            out[-1].append(entry)
    return out


def draw_key(axes: "Axes", columns: list[list[Entry]], height: float) -> None:
    """Write the key on axes of its own, so many inches high, whose frame is taken off."""
    axes.set_axis_off()
    axes.set(xlim=(0.0, len(columns) * COLUMN_WIDTH), ylim=(-height, 0.0))
    for number, column in enumerate(columns):
        left = number * COLUMN_WIDTH
        for row, entry in enumerate(column):
            _row(axes, entry, left, -(row + 0.6) * _ROW)


def _row(axes: "Axes", entry: Entry, left: float, y: float) -> None:
    from matplotlib.patches import Rectangle

    def write(x: float, text: str, **style: Any) -> None:
        usual = {"va": "center_baseline", "fontsize": 7, "color": INK, "parse_math": False}
        # no row leaves its column, and measuring it takes long
        axes.text(x, y, text, None, in_layout=False, **(usual | style))

    at = left + 0.14
    if entry.detail:
        write(left + COLUMN_WIDTH - 0.18, entry.detail, ha="right", color=MUTED)
    if entry.kind == "heading":
        write(left, entry.text, fontsize=7.5, fontweight="bold")
        return
    if entry.kind == "gap":
        write(left + 0.3, entry.text, color=MUTED)
        return
    if entry.kind == "disc":
        box = {"boxstyle": "round,pad=0.16", "facecolor": INK, "edgecolor": "none"}
        write(at, entry.mark, ha="center", fontsize=5.5, color=PAPER, bbox=box)
    elif entry.kind == "number":
        write(at, entry.mark, ha="center", fontsize=6.5, color=entry.colour, fontweight="bold")
    elif entry.kind == "arrow":
        arrow = {"arrowstyle": "-|>", "color": entry.colour, "linewidth": 1.2}
        axes.annotate("", xy=(at + 0.13, y), xytext=(at - 0.13, y), arrowprops=arrow)
    else:
        corner = (at - 0.11, y - 0.045)
        look = {"facecolor": entry.colour, "edgecolor": INK, "linewidth": 0.4}
        axes.add_patch(Rectangle(corner, 0.22, 0.09, **look))
    longest = _LONGEST_NAME - 3 if entry.detail else _LONGEST_NAME
    name = entry.text if len(entry.text) <= longest else f"{entry.text[: longest - 1]}…"
    write(left + 0.34, name)
