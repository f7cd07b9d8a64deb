"""What the workshop makes of a stage: histograms of its figures, and what spreads them."""

import math
from typing import TYPE_CHECKING

import numpy as np

from flexstage.explore.deviations import LABELS
from flexstage.explore.figures import Requirement
from flexstage.explore.spread import Spread
from flexstage.explore.tolerance import ToleranceStudy
from flexstage.report.figures.style import (
    CYCLE,
    GRID,
    INK,
    MUTED,
    add_legend,
    dress,
    entitle,
    new_figure,
    one_panel,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_WIDTH = 9.6  # [inch]


def draw_spreads(study: ToleranceStudy) -> "Figure":
    """Draw a histogram of every figure: the stage as drawn, 95 % of the lot, and the limits.

    What varies by rounding alone is left out, unless there is nothing else.
    """
    spreads = [s for s in study.spreads if not s.still] or list(study.spreads)
    columns = _columns(len(spreads))
    rows = math.ceil(len(spreads) / columns)
    figure = new_figure(min(3.4 * columns, _WIDTH + 0.6), 1.8 * rows + 0.5)
    cells = figure.subplots(rows, columns, squeeze=False)
    required = {r.figure: r for r in study.requirements}
    for axes, spread in zip(cells.flat, spreads, strict=False):
        _histogram(axes, spread, required.get(spread.figure))
        # labels of a narrow spread are long
        axes.locator_params(axis="x", nbins=4 if columns < 4 else 3)
    for axes in cells.flat[len(spreads) :]:
        axes.set_axis_off()
    for axes in cells[:, 0]:
        axes.set_ylabel("stages in a bin [%]", fontsize=7.5)
    handles = {}
    for axes in cells.flat:
        for handle, label in zip(*axes.get_legend_handles_labels(), strict=True):
            handles.setdefault(label, handle)
    add_legend(
        figure,
        handles.values(),
        handles.keys(),
        loc="outside lower center",
        ncols=len(handles),
        size=8,
    )
    return figure


def _histogram(axes: "Axes", spread: Spread, requirement: Requirement | None) -> None:
    dress(axes, grid=False)
    shown = spread.figure.shown.fitting(float(np.abs(spread.edges).max()))
    edges, low_high = spread.edges * shown.factor, np.array(spread.middle) * shown.factor
    share = 100.0 * spread.counts / max(spread.count, 1)
    if np.isfinite(low_high).all():
        axes.axvspan(*low_high, color=GRID, alpha=0.55, linewidth=0.0, label="95 % of the stages")
    axes.stairs(share, edges, fill=True, color=CYCLE[5], alpha=0.75, label="stages")
    axes.axvline(
        spread.nominal * shown.factor, color=INK, linewidth=1.1, linestyle="--", label="as drawn"
    )
    ends = [edges[0], edges[-1]]
    width = ends[1] - ends[0]
    bounds = () if requirement is None else (requirement.low, requirement.high)
    for bound in bounds:
        if bound is None:
            continue
        at = bound * shown.factor
        # a limit that is far off leaves the histogram its room, and is told in the corner
        if ends[0] - 0.8 * width <= at <= ends[1] + 0.8 * width:
            ends = [min(ends[0], at - 0.05 * width), max(ends[1], at + 0.05 * width)]
    for bound, beyond in zip(bounds, (0, 1), strict=False):
        if bound is None:
            continue
        at = bound * shown.factor
        if ends[0] <= at <= ends[1]:
            axes.axvline(at, color=CYCLE[1], linewidth=1.5, label="limit")
            axes.axvspan(at, ends[beyond], color=CYCLE[1], alpha=0.13, linewidth=0.0)
        else:
            side = "right" if at > ends[1] else "left"
            axes.text(
                0.99 if side == "right" else 0.01, 0.96, f"limit {at:.4g}", ha=side, va="top",
                transform=axes.transAxes, fontsize=7, color=CYCLE[1],
            )  # fmt: skip
    axes.set_xlim(*ends)
    axes.set_ylim(0.0, 1.12 * float(share.max() or 1.0))
    axes.locator_params(axis="y", nbins=4)
    axes.ticklabel_format(axis="x", useOffset=False, style="plain")
    entitle(axes, spread.figure.heading_in(shown), 8.5)


def _columns(count: int) -> int:
    """Return how many stand beside each other: pairs of axes in a row, few places left empty."""
    if count <= 3:
        return count
    return min((4, 3, 2), key=lambda columns: (-count % columns, count != 4 and columns == 2))


def draw_shares(study: ToleranceStudy) -> "Figure":
    """Draw what the variance of every figure consists of, a bar each."""
    least = 0.005  # share that is worth a colour [1]
    # kinds of deviations that have a colour of their own; the others are one
    own_colours = 5
    shares = study.shares
    total: dict[str, float] = {}
    for of in shares:
        for part in of.contributions:
            total[part.kind] = max(total.get(part.kind, 0.0), part.share)
    ranked = [k for k in sorted(total, key=lambda k: -total[k]) if total[k] >= least]
    named = ranked[:own_colours]
    figure, axes = one_panel(_WIDTH, 1.3 + 0.34 * len(shares), grid=False)
    at = np.arange(len(shares))[::-1]
    left = np.zeros(len(shares))
    by_kind = [{c.kind: c.share for c in of.contributions} for of in shares]
    bars = [(LABELS[kind], CYCLE[i], [b[kind] for b in by_kind]) for i, kind in enumerate(named)]
    others = [sum(v for kind, v in b.items() if kind not in named) for b in by_kind]
    if max(others, default=0.0) >= least:
        bars.append(("other deviations", CYCLE[own_colours], others))
    rest = [of.rest for of in shares]
    if max(rest, default=0.0) >= least:
        bars.append(("joint or bent effects", MUTED, rest))
    for label, colour, values in bars:
        percent = 100.0 * np.array(values)
        axes.barh(at, percent, left=left, height=0.66, color=colour, label=label)
        for y, start, size in zip(at, left, percent, strict=True):
            if size >= 6.0:
                axes.text(
                    start + 0.5 * size, y, f"{size:.0f}", ha="center", va="center", fontsize=7.5,
                    color="white",
                )  # fmt: skip
        left += percent
    axes.set_yticks(at, [of.figure.label for of in shares], fontsize=8, parse_math=False)
    axes.tick_params(axis="y", length=0)
    axes.set_xlim(0.0, 100.0)
    axes.set_ylim(-0.6, len(shares) - 0.4)
    axes.set_xlabel("share of the variance [%]")
    add_legend(figure, loc="outside lower center", ncols=min(len(bars), 4), size=8)
    return figure
