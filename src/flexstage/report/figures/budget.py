"""The distribution of a result, and what its uncertainty comes from."""

from typing import TYPE_CHECKING

import numpy as np

from flexstage.measure.uncertainty.monte_carlo import MonteCarlo
from flexstage.measure.uncertainty.propagate import Propagated
from flexstage.report.figures.style import (
    CYCLE,
    GRID,
    INK,
    MUTED,
    add_legend,
    dress,
    entitle,
    new_figure,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

#: Lines of the budget that are drawn, at most; what is left is one bar.
_LINES = 12


def draw_budget(
    propagated: Propagated,
    drawn: MonteCarlo,
    *,
    quantity: str = "result",
    unit: str = "",
    factor: float = 1.0,
) -> "Figure":
    """Draw the Monte Carlo trials with both intervals, and the shares of the influences.

    The density of the first order, normal or Student, stands over the histogram. `factor` is how
    many of the drawn unit one of the result's is.
    """
    count = min(len(propagated.lines), _LINES + 1)
    figure = new_figure(9.6, max(3.4, 1.3 + 0.28 * count))
    left, right = figure.subplots(1, 2, width_ratios=(1.35, 1.0))
    _distribution(left, propagated, drawn, quantity, unit, factor)
    _shares(right, propagated)
    return figure


def _distribution(
    axes: "Axes",
    propagated: Propagated,
    drawn: MonteCarlo,
    quantity: str,
    unit: str,
    factor: float,
) -> None:
    bins = 80
    dress(axes)
    tails = 0.5e-3
    ends = np.quantile(drawn.values, (tails, 1.0 - tails))
    # where nothing is uncertain one bar stands in a unit about the value
    span = max(float(np.ptp(ends)), 1e-12 * abs(drawn.value)) or factor
    edges = np.linspace(ends[0] - 0.06 * span, ends[1] + 0.06 * span, bins + 1)
    counts = np.diff(np.searchsorted(drawn.values, edges))
    density = counts / (drawn.trials * np.diff(edges)) * factor
    shown = edges / factor
    axes.stairs(density, shown, fill=True, color=CYCLE[5], alpha=0.55, label="Monte Carlo trials")
    peak = float(density.max())
    if propagated.uncertainty > 0.0:
        x = np.linspace(edges[0], edges[-1], 400)
        first = _density(propagated, x) * factor
        peak = max(peak, float(first.max()))
        axes.plot(x / factor, first, color=CYCLE[1], linewidth=1.2, label="first order (GUM)")
    top = 1.32 * peak
    percent = f"{100.0 * drawn.confidence:g} %"
    bars = (
        (drawn.symmetric, CYCLE[0], f"Monte Carlo, {percent}", 0.80),
        (drawn.shortest, CYCLE[2], f"Monte Carlo, shortest {percent}", 0.86),
        (propagated.interval(drawn.confidence), CYCLE[1], f"first order, {percent}", 0.92),
    )
    for (low, high), colour, label, height in bars:
        axes.plot(
            (low / factor, high / factor), (height * top,) * 2, color=colour, linewidth=2.0,
            marker="|", markersize=8, label=label,
        )  # fmt: skip
    axes.set_xlim(shown[0], shown[-1])
    low, high = propagated.interval(drawn.confidence)
    axes.set_xlim(
        min(shown[0], (low - 0.03 * span) / factor), max(shown[-1], (high + 0.03 * span) / factor)
    )
    axes.set_ylim(0.0, top)
    shown_unit = "" if unit == "1" else unit.replace("um", "µm").replace("urad", "µrad")
    bracket = f" [{shown_unit}]" if shown_unit else ""
    per = f" [1/{shown_unit}]" if shown_unit else ""
    axes.set(xlabel=f"{quantity}{bracket}", ylabel=f"probability density{per}")
    axes.ticklabel_format(axis="x", useOffset=False)
    axes.locator_params(axis="x", nbins=6)
    add_legend(axes, loc="upper center", bbox_to_anchor=(0.5, -0.16), ncols=3)
    entitle(axes, f"{quantity}: {drawn.trials} trials")


def _density(propagated: Propagated, x: np.ndarray) -> np.ndarray:
    """Density of the t distribution that the first order stands for."""
    from scipy.special import gammaln

    u, v = propagated.uncertainty, propagated.degrees_of_freedom
    z = (x - propagated.value) / u
    if v > 1e4:
        return np.exp(-0.5 * z**2) / (u * np.sqrt(2.0 * np.pi))
    log = gammaln(0.5 * (v + 1.0)) - gammaln(0.5 * v) - 0.5 * np.log(v * np.pi)
    return np.exp(log - 0.5 * (v + 1.0) * np.log1p(z**2 / v)) / u


def _shares(axes: "Axes", propagated: Propagated) -> None:
    dress(axes, grid=False)
    ranked = sorted(propagated.lines, key=lambda line: -abs(line.share))
    bars = [(line.name, 100.0 * line.share, line.kind) for line in ranked[:_LINES]]
    if len(ranked) > _LINES:
        rest = 100.0 * sum(line.share for line in ranked[_LINES:])
        bars.append((f"{len(ranked) - _LINES} more", rest, ""))
    at = np.arange(len(bars))[::-1]
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
    names = [name if len(name) <= 24 else name[:23] + "…" for name, _, _ in bars]
    axes.set_yticks(at, names, fontsize=8, parse_math=False)
    axes.set_ylim(-0.6, len(bars) - 0.4)
    axes.tick_params(axis="y", length=0)
    axes.grid(visible=True, axis="x", color=GRID, linewidth=0.6)
    axes.set_axisbelow(True)
    axes.set_xlabel("share of the variance [%]")
    kinds = {kind for _, _, kind in bars}
    said = {"A": "blue: kind A", "B": "orange: kind B"}
    entitle(axes, f"budget ({', '.join(said[k] for k in 'AB' if k in kinds)})")
