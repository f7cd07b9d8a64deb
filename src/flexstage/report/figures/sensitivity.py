"""Which parameter of a stage moves which figure: a map of numbers on colours."""

from typing import TYPE_CHECKING

import numpy as np

from flexstage.characteristic import WHOLE_STAGE
from flexstage.explore.sensitivity import Sensitivities
from flexstage.report.figures.style import CYCLE, INK, MUTED, PAPER, dress, entitle, new_figure
from flexstage.report.sensitivity import (
    change_text,
    moving,
    parameter_label,
    short_label,
    shown_changes,
    step_words,
)

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from matplotlib.patches import Patch

# parameters that are drawn at most; the others move less
_ROWS = 40
# width of a column, height of a row and of a letter [inch]
_COLUMN, _ROW, _LETTER = 0.62, 0.19, 0.075


def draw_sensitivities(found: Sensitivities, length: float | None = None) -> "Figure":
    """Draw the change of each figure in per cent of it, by the parameters that move one most.

    Colour goes with the root of the change, so that small ones are seen beside large ones.
    """
    from matplotlib.colors import LinearSegmentedColormap

    shown = shown_changes(found, length)
    order, _ = moving(found, length)
    kept = [i for i in range(len(found.figures)) if not found.vanishing[i]]
    order = [k for k in order if shown[kept][:, k].any()]
    drawn = order[:_ROWS]
    cells = np.nan_to_num(shown[np.ix_(kept, drawn)].T)
    names = [parameter_label(found, k) for k in drawn]
    wide = _LETTER * max((len(name) for name in names), default=0)
    if not drawn:
        return _empty(found)
    figure = new_figure(wide + _COLUMN * max(len(kept), 4) + 0.3, _ROW * max(len(drawn), 3) + 1.0)
    axes = figure.subplots()
    dress(axes, grid=False)
    for spine in axes.spines.values():
        spine.set_visible(False)
    largest = float(np.abs(cells).max(initial=0.0)) or 1.0
    colour = LinearSegmentedColormap.from_list("change", (CYCLE[0], PAPER, CYCLE[1]))
    part = np.sign(cells) * np.sqrt(np.abs(cells) / largest)
    for (row, column), value in np.ndenumerate(cells):
        if value == 0.0:
            axes.text(column, row, "·", ha="center", va="center", fontsize=7, color=MUTED)
            continue
        strength = float(part[row, column])
        axes.add_patch(_cell(column, row, colour(0.5 + 0.42 * strength)))
        text = change_text(float(value)).replace("-", "−")
        axes.text(
            column, row, text, ha="center", va="center", fontsize=7,
            color=PAPER if abs(strength) > 0.8 else INK,
        )  # fmt: skip
    axes.set_xlim(-0.5, len(kept) - 0.5)
    axes.set_ylim(len(drawn) - 0.5, -0.5)
    axes.set_yticks(range(len(drawn)), names, fontsize=7.5, parse_math=False)
    heads = []
    for i in kept:
        axis = found.figures[i].axis
        label = short_label(found.figures[i])
        heads.append(f"{label}\n{'' if axis == WHOLE_STAGE else axis}")
    axes.set_xticks(range(len(kept)), heads, fontsize=7.5, parse_math=False)
    axes.xaxis.tick_top()
    axes.tick_params(length=0)
    entitle(axes, f"{found.stage}, {found.model}")
    told = f"change of each figure [%] for {step_words(found, length)}"
    if more := len(order) - len(drawn):
        told += f"\n{more} more parameters move a figure, and less than these"
    axes.set_xlabel(told, fontsize=7.5, color=MUTED, loc="left", parse_math=False)
    return figure


def _empty(found: Sensitivities) -> "Figure":
    figure = new_figure(4.2, 1.0)
    axes = figure.subplots()
    axes.set_axis_off()
    told = f"{found.stage}, {found.model}: none of these parameters moves these figures"
    axes.text(0.5, 0.5, told, ha="center", va="center", fontsize=8, color=INK, parse_math=False)
    return figure


def _cell(column: int, row: int, colour: tuple[float, float, float, float]) -> "Patch":
    from matplotlib.patches import Rectangle

    return Rectangle((column - 0.47, row - 0.45), 0.94, 0.9, facecolor=colour, linewidth=0.0)
