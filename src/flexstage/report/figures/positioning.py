"""The diagram of ISO 230-2: deviations at targets, from both sides, and what is read off them."""

from typing import TYPE_CHECKING

import numpy as np

from flexstage.arrays import Array
from flexstage.experiment.motion.positioning import Positioning
from flexstage.quantities import number, prefixed
from flexstage.report.figures.style import CYCLE, INK, MUTED, PAPER, dress, entitle, new_figure

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_UP, _DOWN, _MEAN = CYCLE[0], CYCLE[1], CYCLE[2]
#: Of the range of the targets: from the last one to the first dimension, and between two of them.
_GAP, _PITCH = 0.05, 0.085


def draw_positioning(found: Positioning, *, title: str = "") -> "Figure":
    """Draw deviations over the targets, with the figures of the axis as dimensions.

    Mean deviation upward, downward and of both, two standard deviations about each of the former;
    A, E and M beside them, R and B at the targets where they are. The title is the accuracy where
    not given.
    """
    figure = new_figure(7.2, 4.0)
    axes = figure.subplots()
    dress(axes)
    across, of_target = prefixed(float(np.abs(found.target).max()))
    factor, prefix = prefixed(abs(found.accuracy.value))
    x = across * found.target
    up, down, mean = (
        factor * v for v in (found.mean_upward, found.mean_downward, found.mean_bidirectional)
    )
    wide_up, wide_down = 2.0 * factor * found.spread_upward, 2.0 * factor * found.spread_downward
    small = 3.5 if x.size <= 15 else 2.0
    for y, wide, colour, mark, name in (
        (up, wide_up, _UP, "^", "mean upward x̄↑"),
        (down, wide_down, _DOWN, "v", "mean downward x̄↓"),
    ):
        axes.fill_between(x, y - wide, y + wide, color=colour, alpha=0.15, linewidth=0.0)
        for edge in (y - wide, y + wide):
            axes.plot(x, edge, color=colour, linewidth=0.6, linestyle=(0, (2, 2)))
        axes.plot(x, y, color=colour, linewidth=1.3, marker=mark, markersize=small, label=name)
    axes.plot(x, mean, color=_MEAN, linewidth=1.0, linestyle=(0, (6, 2)), label="mean of both x̄")
    tops, feet = (np.stack((up + wide_up, down + wide_down)),
                  np.stack((up - wide_up, down - wide_down)))  # fmt: skip
    span = float(np.ptp(x))
    unit = f"{prefix}m"
    for k, (symbol, estimate, ends) in enumerate(
        (
            ("A", found.accuracy.value, (_lowest(x, feet), _highest(x, tops))),
            ("E", found.systematic.value,
             (_lowest(x, np.stack((up, down))), _highest(x, np.stack((up, down))))),
            ("M", found.mean_deviation.value, (_lowest(x, mean[None]), _highest(x, mean[None]))),
        )
    ):  # fmt: skip
        at = float(x[-1]) + span * (_GAP + _PITCH * (2 - k))
        _beside(axes, at, ends, f"{symbol} = {number(factor * estimate)} {unit}")
    _at_targets(axes, found, x, factor, unit, (tops, feet), (up, down))
    axes.margins(y=0.13)
    axes.set_xlim(x[0] - 0.09 * span, x[-1] + span * (_GAP + 2.6 * _PITCH))
    axes.set_xlabel(f"target [{of_target}m]", fontsize=8.5, parse_math=False)
    axes.set_ylabel(f"deviation [{unit}]", fontsize=8.5, parse_math=False)
    axes.legend(
        loc="upper center", bbox_to_anchor=(0.5, -0.14), ncols=3, fontsize=7.5, frameon=False,
        labelcolor=INK, title=f"bands of ±2 s, {found.runs} runs",
        title_fontproperties={"size": 7.5},
    ).get_title().set_color(MUTED)  # fmt: skip
    entitle(axes, title or f"A = {number(factor * found.accuracy.value)} {unit}")
    return figure


def _highest(x: Array, rows: Array) -> tuple[float, float]:
    i, j = np.unravel_index(int(np.argmax(rows)), rows.shape)
    return float(x[j]), float(rows[i, j])


def _lowest(x: Array, rows: Array) -> tuple[float, float]:
    i, j = np.unravel_index(int(np.argmin(rows)), rows.shape)
    return float(x[j]), float(rows[i, j])


def _beside(
    axes: "Axes", at: float, ends: tuple[tuple[float, float], tuple[float, float]], text: str
) -> None:
    """Draw a dimension between two heights, with lines to where they are."""
    (x_low, low), (x_high, high) = ends
    for x, y in ((x_low, low), (x_high, high)):
        axes.plot((x, at), (y, y), color=MUTED, linewidth=0.5)
    _arrow(axes, at, low, high, INK)
    axes.annotate(
        text, (at, 0.5 * (low + high)), xytext=(3, 0), textcoords="offset points", ha="left",
        va="center", rotation=90, fontsize=7.5, color=INK,
    )  # fmt: skip


def _at_targets(
    axes: "Axes",
    found: Positioning,
    x: Array,
    factor: float,
    unit: str,
    bands: tuple[Array, Array],
    means: tuple[Array, Array],
) -> None:
    """Draw R and B at the targets where they are largest."""
    tops, feet = bands
    up, down = means
    i = int(np.argmax(found.repeatability_at_targets))
    high, low = float(tops[:, i].max()), float(feet[:, i].min())
    _arrow(axes, float(x[i]), low, high, INK)
    _text(axes, float(x[i]), high, f"R = {number(factor * found.repeatability.value)} {unit}", 1)
    j = int(np.argmax(np.abs(found.reversal_at_targets)))
    aside = 0.012 * float(np.ptp(x)) if i == j else 0.0
    _arrow(axes, float(x[j]) + aside, float(up[j]), float(down[j]), CYCLE[3])
    # below, where R is above
    _text(
        axes, float(x[j]), float(feet[:, j].min()),
        f"B = {number(factor * found.reversal.value)} {unit}", -1,
    )  # fmt: skip


def _arrow(axes: "Axes", x: float, low: float, high: float, colour: str) -> None:
    axes.annotate(
        "", (x, high), (x, low),
        arrowprops={"arrowstyle": "<->", "color": colour, "linewidth": 0.9, "shrinkA": 0.0,
                    "shrinkB": 0.0, "mutation_scale": 7.0},
    )  # fmt: skip


def _text(axes: "Axes", x: float, y: float, text: str, side: int) -> None:
    axes.annotate(
        text, (x, y), xytext=(0, 4 * side), textcoords="offset points", ha="center",
        va="bottom" if side > 0 else "top", fontsize=7.5, color=INK,
        bbox={"boxstyle": "round,pad=0.1", "facecolor": PAPER, "edgecolor": "none", "alpha": 0.8},
    )  # fmt: skip
