"""Bode diagram of one axis: magnitude and phase, with the resonances marked."""

from collections.abc import Collection
from typing import TYPE_CHECKING

import numpy as np

from flexstage.errors import ModelError
from flexstage.quantities import number
from flexstage.report.figures.style import CYCLE, INK, MUTED, PAPER, dress, entitle, new_figure
from flexstage.stage import Stage
from flexstage.system import Analysis, FrequencyResponse

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_PUBLISHED = {
    "published-analytic": (CYCLE[1], (0, (5, 2)), "analytic"),
    "published-fem": (CYCLE[2], (0, (2, 1.5)), "FEM"),
    "published-measured": (CYCLE[3], (0, (6, 2, 1, 2)), "measured"),
}
# width and height of a label, in parts of the diagram
_LABEL = (0.13, 0.07)
_UNITS = {"m/N": ("µm/N", 1e6), "m/m": ("µm/µm", 1.0), "rad/N": ("µrad/N", 1e6)}


def draw_bode(
    analysis: Analysis,
    axis: str,
    *,
    conditions: Collection[str] | None = None,
    size: tuple[float, float] = (5.1, 5.0),
) -> "Figure":
    """Draw the response of an axis to its drive: a column for each condition of the drives.

    Published natural frequencies are dashed lines where the drives are removed, which is what they
    belong to. All conditions are drawn where None; `size` is that of a column [inch].
    """
    port = next((a for a in analysis.axes if a.axis == axis), None)
    shown = [
        r
        for r in analysis.responses
        if port is not None
        and (r.drive, r.probe) == (port.drive, port.probe)
        and (conditions is None or r.drives in conditions)
    ]
    if not shown:
        raise ModelError(f"the analysis has no frequency response of an axis '{axis}'")
    figure = new_figure(size[0] * len(shown), size[1])
    grid = figure.subplots(2, len(shown), sharex="col", height_ratios=(1.7, 1.0), squeeze=False)
    for column, response in enumerate(shown):
        _column(grid[0, column], grid[1, column], analysis, response, axis)
    return figure


def _column(
    upper: "Axes", lower: "Axes", analysis: Analysis, response: FrequencyResponse, axis: str
) -> None:
    from matplotlib.ticker import MultipleLocator

    unit, factor = _UNITS.get(response.unit, (response.unit, 1.0))
    f = response.frequency_hz
    magnitude = factor * np.abs(response.value)
    phase = np.degrees(np.unwrap(np.angle(response.value)))
    phase -= 360.0 * np.round(phase[0] / 360.0)
    for axes in (upper, lower):
        dress(axes)
        axes.set_xscale("log")
        axes.set_xlim(f[0], f[-1])
    upper.set_yscale("log")
    upper.plot(f, magnitude, color=CYCLE[0], linewidth=1.4)
    lower.plot(f, phase, color=CYCLE[0], linewidth=1.4)
    span = float(np.ptp(phase))
    if span < 1.0:
        lower.set_ylim(phase.mean() - 95.0, phase.mean() + 95.0)
    lower.yaxis.set_major_locator(MultipleLocator(90.0 if span < 400.0 else 180.0))
    entitle(
        upper,
        f"{axis}, {analysis.system.model} model: {response.input_kind} of drive "
        f"'{response.drive}', drives {response.drives}",
    )
    upper.set_ylabel(f"{response.probe} / {response.input_kind} [{unit}]", parse_math=False)
    lower.set_ylabel("phase [°]")
    lower.set_xlabel("frequency [Hz]")
    top, bottom = magnitude.max(), magnitude.min()
    # a rigid drive may leave nothing to see but its own length: show that as a level line
    spare = max(10.0 / np.sqrt(top / bottom), 1.0)
    top, bottom = top * spare, bottom / spare
    upper.set_ylim(bottom / 1.6, top * (top / bottom) ** 0.16)
    _resonances(upper, analysis, response, magnitude)
    if response.drives == "removed":
        _published(upper, lower, analysis.stage, axis)


def _resonances(
    axes: "Axes", analysis: Analysis, response: FrequencyResponse, magnitude: np.ndarray
) -> None:
    """Mark the natural frequencies at which the response has a peak."""
    f = response.frequency_hz
    peaks = np.flatnonzero((magnitude[1:-1] >= magnitude[:-2]) & (magnitude[1:-1] > magnitude[2:]))
    placed: list[tuple[float, float]] = []
    low, top = axes.get_ylim()
    wide, high = np.log(f[-1] / f[0]), np.log(top / low)
    found = analysis.modes[response.drives].frequency_hz
    for at in sorted(peaks + 1, key=lambda i: -magnitude[i]):
        nearest = float(found[np.argmin(np.abs(found - f[at]))])
        near = np.abs(np.log(f / f[at])) < 0.1
        if magnitude[at] < 1.02 * magnitude[near].min():
            continue
        where = (np.log(f[at]) / wide, np.log(magnitude[at]) / high)
        apart = all(
            abs(where[0] - x) > _LABEL[0] or abs(where[1] - y) > _LABEL[1] for x, y in placed
        )
        if abs(nearest / f[at] - 1.0) > 0.03:
            continue
        axes.plot(f[at], magnitude[at], "o", color=CYCLE[0], markersize=3.5)
        if apart and len(placed) < 8:
            placed.append(where)
            axes.annotate(
                f"{number(nearest)} Hz", (f[at], magnitude[at]), xytext=(0, 5),
                textcoords="offset points", ha="center", fontsize=7.5, color=INK,
                bbox={"facecolor": PAPER, "edgecolor": "none", "pad": 0.6, "alpha": 0.85},
            )  # fmt: skip


def _published(upper: "Axes", lower: "Axes", stage: Stage, axis: str) -> None:
    rows = [
        row
        for row in stage.published
        if row.quantity == "natural_frequency_hz" and row.axis == axis and row.origin in _PUBLISHED
    ]
    for row in rows:
        colour, dashes, word = _PUBLISHED[row.origin]
        label = f"published, {word}: {row.value:.10g} Hz"
        for axes in (upper, lower):
            axes.axvline(row.value, color=colour, linestyle=dashes, linewidth=0.9, label=label)
    if rows:
        upper.legend(loc="lower left", fontsize=7, frameon=False, labelcolor=MUTED)
