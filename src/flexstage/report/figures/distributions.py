"""Distributions of a result, of manufactured stages and of an ensemble, and their variance."""

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from flexstage.base.arrays import Array, Integers
from flexstage.measure.uncertainty.monte_carlo import MonteCarlo
from flexstage.measure.uncertainty.propagate import Propagated
from flexstage.report.figures.style import (
    CYCLE,
    GRID,
    INK,
    MUTED,
    add_legend,
    add_shared_legend,
    one_panel,
    panels,
    set_title,
    shortened,
)
from flexstage.studies.explore.deviations import LABELS
from flexstage.studies.explore.ensemble import Ensemble
from flexstage.studies.explore.figures import Requirement
from flexstage.studies.explore.spread import Spread
from flexstage.studies.explore.tolerance import ToleranceStudy

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_WIDTH = 9.6  # [inch]
#: Most lines of a budget; one bar shows the others.
_BARS = 12


def draw_budget(
    propagated: Propagated,
    monte_carlo: MonteCarlo,
    *,
    quantity: str = "result",
    unit: str = "",
    factor: float = 1.0,
) -> "Figure":
    """Draw the Monte Carlo trials with both intervals, and the shares of the influences.

    The density of the first order, normal or Student, is drawn over the histogram. `factor` is the
    drawn unit in the unit of the result.
    """
    count = min(len(propagated.lines), _BARS + 1)
    high = max(3.4, 1.3 + 0.28 * count)
    figure, (left, right) = panels(_WIDTH, high, 2, 2, width_ratios=(1.35, 1.0))
    _distribution(left, propagated, monte_carlo, quantity, unit, factor)
    _budget(right, propagated)
    return figure


def _distribution(
    axes: "Axes",
    propagated: Propagated,
    monte_carlo: MonteCarlo,
    quantity: str,
    unit: str,
    factor: float,
) -> None:
    bins = 80
    tails = 0.5e-3
    ends = np.quantile(monte_carlo.values, (tails, 1.0 - tails))
    # without uncertainty one bar of unit width is drawn at the value
    span = max(float(np.ptp(ends)), 1e-12 * abs(monte_carlo.value)) or factor
    edges = np.linspace(ends[0] - 0.06 * span, ends[1] + 0.06 * span, bins + 1)
    counts = np.diff(np.searchsorted(monte_carlo.values, edges))
    density = counts / (monte_carlo.trials * np.diff(edges)) * factor
    scaled_edges = edges / factor
    axes.stairs(
        density, scaled_edges, fill=True, color=CYCLE[5], alpha=0.55, label="Monte Carlo trials"
    )
    peak = float(density.max())
    if propagated.uncertainty > 0.0:
        x = np.linspace(edges[0], edges[-1], 400)
        first = _density(propagated, x) * factor
        peak = max(peak, float(first.max()))
        axes.plot(x / factor, first, color=CYCLE[1], linewidth=1.2, label="first order (GUM)")
    top = 1.32 * peak
    percent = f"{100.0 * monte_carlo.confidence:g} %"
    bars = (
        (monte_carlo.symmetric, CYCLE[0], f"Monte Carlo, {percent}", 0.80),
        (monte_carlo.shortest, CYCLE[2], f"Monte Carlo, shortest {percent}", 0.86),
        (propagated.interval(monte_carlo.confidence), CYCLE[1], f"first order, {percent}", 0.92),
    )
    for (low, high), colour, label, height in bars:
        axes.plot(
            (low / factor, high / factor), (height * top,) * 2, color=colour, linewidth=2.0,
            marker="|", markersize=8, label=label,
        )  # fmt: skip
    axes.set_xlim(scaled_edges[0], scaled_edges[-1])
    low, high = propagated.interval(monte_carlo.confidence)
    axes.set_xlim(
        min(scaled_edges[0], (low - 0.03 * span) / factor),
        max(scaled_edges[-1], (high + 0.03 * span) / factor),
    )
    axes.set_ylim(0.0, top)
    unit_text = "" if unit == "1" else unit.replace("um", "µm").replace("urad", "µrad")
    bracket = f" [{unit_text}]" if unit_text else ""
    per = f" [1/{unit_text}]" if unit_text else ""
    axes.set(xlabel=f"{quantity}{bracket}", ylabel=f"probability density{per}")
    axes.ticklabel_format(axis="x", useOffset=False)
    axes.locator_params(axis="x", nbins=6)
    add_legend(axes, loc="upper center", bbox_to_anchor=(0.5, -0.16), ncols=3)
    set_title(axes, f"{quantity}: {monte_carlo.trials} trials")


def _density(propagated: Propagated, x: Array) -> Array:
    """Return the density of the t distribution of the first order."""
    from scipy.stats import norm, t

    z = (x - propagated.value) / propagated.uncertainty
    freedom = propagated.degrees_of_freedom
    return (norm.pdf(z) if freedom > 1e4 else t.pdf(z, freedom)) / propagated.uncertainty


def _budget(axes: "Axes", propagated: Propagated) -> None:
    ranked = sorted(propagated.lines, key=lambda line: -abs(line.share))
    bars: list[tuple[str, float, str]]
    bars = [(line.name, 100.0 * line.share, line.kind) for line in ranked[:_BARS]]
    if len(ranked) > _BARS:
        others = 100.0 * sum(line.share for line in ranked[_BARS:])
        bars.append((f"{len(ranked) - _BARS} more", others, ""))
    at = _rows(axes, [shortened(name, 24) for name, _, _ in bars])
    values = np.array([share for _, share, _ in bars])
    colours = [{"A": CYCLE[0], "B": CYCLE[4]}.get(kind, MUTED) for _, _, kind in bars]
    axes.barh(at, values, height=0.62, color=colours)
    axes.axvline(0.0, color=MUTED, linewidth=0.6)
    width = max(float(values.max()), 1.0) - min(float(values.min()), 0.0)
    for y, share in zip(at, values, strict=True):
        text = f"{share:.1f} %" if abs(share) >= 0.05 or share == 0.0 else "< 0.1 %"
        axes.text(max(share, 0.0) + 0.02 * width, y, text, va="center", fontsize=7.5, color=INK)
    axes.set_xlim(
        min(float(values.min()), 0.0) - 0.02 * width, max(values.max(), 1.0) + 0.2 * width
    )
    axes.grid(visible=False, axis="y")
    kinds = {kind for _, _, kind in bars}
    types = {"A": "blue: type A", "B": "orange: type B"}
    set_title(axes, f"budget ({', '.join(types[k] for k in 'AB' if k in kinds)})")


def draw_spreads(study: ToleranceStudy) -> "Figure":
    """Draw a histogram of every figure with the nominal value, the 95 % range and the limits.

    Figures that vary only by rounding are omitted, unless there are no others.
    """
    spreads = [s for s in study.spreads if not s.constant] or list(study.spreads)
    columns = _columns(len(spreads))
    rows = math.ceil(len(spreads) / columns)
    wide, high = min(3.4 * columns, _WIDTH + 0.6), 1.8 * rows + 0.5
    figure, cells = panels(wide, high, len(spreads), columns, grid=False)
    required = {r.figure: r for r in study.requirements}
    for axes, spread in zip(cells, spreads, strict=True):
        _histogram(axes, spread, required.get(spread.figure))
        # labels of a narrow distribution are long
        axes.locator_params(axis="x", nbins=4 if columns < 4 else 3)
    for axes in cells[::columns]:
        axes.set_ylabel("parts per bin [%]", fontsize=7.5)
    add_shared_legend(figure, size=8)
    return figure


def _histogram(axes: "Axes", spread: Spread, requirement: Requirement | None) -> None:
    quantity = spread.figure.display.fitting(float(np.abs(spread.edges).max()))
    edges, low_high = spread.edges * quantity.factor, np.array(spread.middle) * quantity.factor
    share = 100.0 * spread.counts / max(spread.count, 1)
    if np.isfinite(low_high).all():
        axes.axvspan(*low_high, color=GRID, alpha=0.55, linewidth=0.0, label="95 % of the parts")
    axes.stairs(share, edges, fill=True, color=CYCLE[5], alpha=0.75, label="parts")
    axes.axvline(
        spread.nominal * quantity.factor, color=INK, linewidth=1.1, linestyle="--", label="nominal"
    )
    ends = [edges[0], edges[-1]]
    width = ends[1] - ends[0]
    bounds = () if requirement is None else (requirement.low, requirement.high)
    for bound in bounds:
        if bound is None:
            continue
        at = bound * quantity.factor
        # a distant limit is only printed in the corner
        if ends[0] - 0.8 * width <= at <= ends[1] + 0.8 * width:
            ends = [min(ends[0], at - 0.05 * width), max(ends[1], at + 0.05 * width)]
    for bound, beyond in zip(bounds, (0, 1), strict=False):
        if bound is None:
            continue
        at = bound * quantity.factor
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
    set_title(axes, spread.figure.heading_in(quantity), 8.5)


def draw_ranges(ensemble: Ensemble) -> "Figure":
    """Draw the 95 % range of every figure, and its members, in per cent of the described stage."""
    rows = [row for row in ensemble.figure_rows() if row.described and not row.zero]
    rows.sort(key=lambda row: row.kind == "predicted")
    figure, axes = one_panel(_WIDTH, 1.2 + 0.24 * len(rows), grid=False)
    at = np.arange(len(rows))[::-1]
    axes.set_yticks(at, [row.figure.label for row in rows], fontsize=8, parse_math=False)
    axes.tick_params(axis="y", length=0)
    axes.axvline(100.0, color=MUTED, linewidth=0.8, linestyle="--", label="described stage")
    colours = {"given": CYCLE[2], "predicted": CYCLE[0]}
    for y, row in zip(at, rows, strict=True):
        percent, colour = 100.0 / row.described, colours[row.kind]
        members = ensemble.values[:, ensemble.figures.index(row.figure)] * percent
        axes.plot(members, np.full(len(members), y), "|", color=MUTED, markersize=5, label="member")
        label = f"{row.kind}, 95 % range"
        axes.plot(
            (row.low * percent, row.high * percent),
            (y, y),
            color=colour,
            linewidth=4.5,
            alpha=0.45,
            label=label,
        )
        axes.plot(row.median * percent, y, "o", color=colour, markersize=4.5, label="median")
    # a range many times the value, as of a rotation that is rounding, runs off the picture
    ends = [100.0 * end / row.described for row in rows for end in (row.low, row.high)]
    within = [end for end in ends if abs(end - 100.0) < 200.0]
    margin = 0.05 * (max(within, default=100.0) - min(within, default=100.0)) or 1.0
    axes.set_xlim(min(within, default=100.0) - margin, max(within, default=100.0) + margin)
    axes.set_ylim(-0.7, len(rows) - 0.3)
    axes.set_xlabel("part of the value of the described stage [%]")
    set_title(axes, f"{ensemble.template.source}: {len(ensemble.points)} members")
    add_shared_legend(figure, size=8)
    return figure


def _columns(count: int) -> int:
    """Return the number of columns: pairs of axes in a row, few empty places."""
    if count <= 3:
        return count
    return min((4, 3, 2), key=lambda columns: (-count % columns, count != 4 and columns == 2))


def draw_shares(study: ToleranceStudy) -> "Figure":
    """Draw the contributions to the variance of every figure, a bar each."""
    least = 0.005  # smallest share with a colour [1]
    # most kinds of deviations with a colour of their own; the others share one
    own_colours = 5
    shares = study.shares
    total: dict[str, float] = {}
    for of in shares:
        for part in of.contributions:
            total[part.kind] = max(total.get(part.kind, 0.0), part.share)
    ranked = [k for k in sorted(total, key=lambda k: -total[k]) if total[k] >= least]
    kinds = ranked[:own_colours]
    figure, axes = one_panel(_WIDTH, 1.3 + 0.34 * len(shares), grid=False)
    at = _rows(axes, [of.figure.label for of in shares])
    left = np.zeros(len(shares))
    by_kind = [{c.kind: c.share for c in of.contributions} for of in shares]
    bars = [(LABELS[kind], CYCLE[i], [b[kind] for b in by_kind]) for i, kind in enumerate(kinds)]
    others = [sum(v for kind, v in b.items() if kind not in kinds) for b in by_kind]
    if max(others, default=0.0) >= least:
        bars.append(("other deviations", CYCLE[own_colours], others))
    unexplained = [of.unexplained for of in shares]
    if max(unexplained, default=0.0) >= least:
        bars.append(("interactions, nonlinearity", MUTED, unexplained))
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
    axes.set_xlim(0.0, 100.0)
    add_shared_legend(figure, size=8)
    return figure


def _rows(axes: "Axes", names: Sequence[str]) -> Integers:
    """Label the rows of bars of shares, the first on top; return their positions."""
    at = np.arange(len(names))[::-1]
    axes.set_yticks(at, names, fontsize=8, parse_math=False)
    axes.tick_params(axis="y", length=0)
    axes.set_ylim(-0.6, len(names) - 0.4)
    axes.set_xlabel("share of the variance [%]")
    return at
