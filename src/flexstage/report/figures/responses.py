"""Responses: Bode diagrams of models and measurements, and thermal drift in time."""

import math
from collections.abc import Collection, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from flexstage.base.arrays import Array, Complex
from flexstage.base.errors import ModelError
from flexstage.quantities.quantity import number
from flexstage.report.figures.style import (
    CYCLE,
    DASHED,
    INK,
    MUTED,
    UM,
    add_legend,
    add_words,
    label_axes,
    on_paper,
    panels,
    set_title,
)
from flexstage.stage import Stage
from flexstage.system import Analysis, FrequencyResponse, ThermalTransient

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from flexstage.measure.spectra.response import MeasuredResponse


_PUBLISHED = {
    "published-analytic": (CYCLE[1], (0, (5, 2)), "analytic"),
    "published-fem": (CYCLE[2], (0, (2, 1.5)), "FEM"),
    "published-measured": (CYCLE[3], (0, (6, 2, 1, 2)), "measured"),
}
# width and height of a label [inch], and size of the magnitude diagram relative to its column
_LABEL, _DIAGRAM = (0.62, 0.2), (0.8, 0.45)
_UNITS = {
    "m/N": ("µm/N", 1e6),
    "m/m": ("µm/µm", 1.0),
    "rad/N": ("µrad/N", 1e6),
    "rad/m": ("µrad/µm", 1.0),
}


def draw_bode(
    analysis: Analysis,
    axis: str,
    *,
    conditions: Collection[str] | None = None,
    size: tuple[float, float] = (5.1, 5.0),
) -> "Figure":
    """Draw the response of an axis to its drives: a column for each condition of the drives.

    Published natural frequencies are dashed lines; they apply to the stage without drives. None
    selects all conditions; `size` is that of a column [inch].
    """
    port = next((a for a in analysis.axes if a.axis == axis), None)
    selected = [
        r
        for r in analysis.responses
        if port is not None
        and r.drive in port.drives
        and r.probe == port.probe
        and (conditions is None or r.drives in conditions)
    ]
    if not selected:
        raise ModelError(f"the analysis has no frequency response of an axis '{axis}'")
    columns = [
        [r for r in selected if r.drives == c] for c in dict.fromkeys(r.drives for r in selected)
    ]
    count = len(columns)
    layout: dict[str, Any] = {"sharex": "col", "height_ratios": (1.7, 1.0)}
    figure, grid = panels(size[0] * count, size[1], 2 * count, count, **layout)
    for upper, lower, responses in zip(grid[:count], grid[count:], columns, strict=True):
        _column(upper, lower, analysis, responses, axis)
    return figure


def bode_curves(response: FrequencyResponse) -> tuple[str, Array, Array]:
    """Return the unit of the magnitude of a response, its magnitude, and its phase [deg].

    The phase is unwrapped, and begins within half a turn of 0.
    """
    unit, factor = _UNITS.get(response.unit, (response.unit, 1.0))
    phase = np.degrees(np.unwrap(np.angle(response.value)))
    return unit, factor * np.abs(response.value), phase - 360.0 * np.round(phase[0] / 360.0)


def _column(
    upper: "Axes",
    lower: "Axes",
    analysis: Analysis,
    responses: Sequence[FrequencyResponse],
    axis: str,
) -> None:
    from matplotlib.ticker import MultipleLocator

    first = responses[0]
    unit = bode_curves(first)[0]
    for axes in (upper, lower):
        axes.set_xscale("log")
        axes.set_xlim(first.frequency_hz[0], first.frequency_hz[-1])
    upper.set_yscale("log")
    sizes, phases = [], []
    for k, response in enumerate(responses):
        _, size, phase = bode_curves(response)
        sizes.append(size)
        phases.append(phase)
        line: dict[str, Any] = {"color": CYCLE[k % len(CYCLE)], "linewidth": 1.4}
        if len(responses) > 1:
            line["label"] = f"'{response.drive}'"
        upper.plot(response.frequency_hz, sizes[-1], **line)
        lower.plot(response.frequency_hz, phases[-1], **line)
    span = float(np.ptp(phases))
    if span < 1.0:
        middle = float(np.mean(phases))
        lower.set_ylim(middle - 95.0, middle + 95.0)
    lower.yaxis.set_major_locator(MultipleLocator(90.0 if span < 400.0 else 180.0))
    # the legend names several drives
    of = f" of drive '{first.drive}'" if len(responses) == 1 else ""
    set_title(
        upper,
        f"{axis}, {analysis.system.model} model, drives {first.drives}\n{first.input_kind}{of}",
    )
    upper.set_ylabel(f"{first.probe} / {first.input_kind} [{unit}]", parse_math=False)
    lower.set(ylabel="phase [°]", xlabel="frequency [Hz]")
    top, bottom = float(np.max(sizes)), float(np.min(sizes))
    # the response to a rigid drive may be constant: show it as a horizontal line
    spare = max(10.0 / math.sqrt(top / bottom), 1.0)
    top, bottom = top * spare, bottom / spare
    upper.set_ylim(bottom / 1.6, top * (top / bottom) ** 0.16)
    if len(responses) > 1:
        upper.legend(loc="lower left", fontsize=7, frameon=False, labelcolor=MUTED)
    _resonances(upper, analysis, first, sizes[0])
    if first.drives == "removed":
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
    natural_hz = analysis.modes[response.drives].frequency_hz
    figure, grid = axes.get_figure(root=True), axes.get_subplotspec()
    assert figure is not None
    assert grid is not None
    room = figure.get_size_inches() * _DIAGRAM / (grid.get_gridspec().ncols, 1.0)
    label = np.divide(_LABEL, room)
    for at in sorted(peaks + 1, key=lambda i: -magnitude[i]):
        nearest = float(natural_hz[np.argmin(np.abs(natural_hz - f[at]))])
        near = np.abs(np.log(f / f[at])) < 0.1
        if magnitude[at] < 1.02 * magnitude[near].min():
            continue
        where = (np.log(f[at]) / wide, np.log(magnitude[at]) / high)
        free = all(np.any(np.abs(np.subtract(where, other)) > label) for other in placed)
        if abs(nearest / f[at] - 1.0) > 0.03:
            continue
        axes.plot(f[at], magnitude[at], "o", color=CYCLE[0], markersize=3.5)
        if free and len(placed) < 8:
            placed.append(where)
            add_words(
                axes,
                f"{number(nearest)} Hz",
                (f[at], magnitude[at]),
                (0, 5),
                ha="center",
                bbox=on_paper(0.6, 0.85),
            )


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


#: Most responses of a figure.
_CURVES = 6
# half width of the 95 % interval of the real or imaginary part of a complex normal error, in
# units of sqrt(variance / 2)
_BAND = 1.959964


def draw_response(
    response: "MeasuredResponse", *, fit: "MeasuredResponse | None" = None
) -> "Figure":
    """Draw magnitude, phase and coherence of a measured response.

    The first six curves, with 95 % bands where the variance is known; `fit` is drawn as a line.
    """
    rows, high = (3, 5.6) if response.coherence is not None else (2, 4.6)
    figure, grid = panels(8.6, high, rows, sharex=True, height_ratios=(2.2, 1.3, 0.8)[:rows])
    magnitude, phase = grid[:2]
    pairs = [(o, i) for o in range(len(response.outputs)) for i in range(len(response.inputs))]
    for k, (o, i) in enumerate(pairs[:_CURVES]):
        colour = CYCLE[k % len(CYCLE)]
        label = f"{response.outputs[o]} / {response.inputs[i]}"
        _plot_magnitude(magnitude, response, o, i, colour=colour, label=label)
        _plot_phase(phase, response, o, i, colour=colour)
        if fit is not None:
            f, h = fit.frequency_hz, fit.response[:, o, i]
            for axes, values in ((magnitude, np.abs(h)), (phase, _wrapped(h))):
                axes.plot(f, values, color=INK, linewidth=0.8, linestyle=DASHED)
    if response.coherence is not None:
        for o in range(min(len(response.outputs), _CURVES)):
            colour = CYCLE[o * len(response.inputs) % len(CYCLE)]
            at = shown_lines(response.coherence[:, o])
            coherence = response.coherence[at, o]
            grid[2].plot(response.frequency_hz[at], coherence, color=colour, linewidth=0.8)
        grid[2].set_ylim(-0.03, 1.06)
        grid[2].set_ylabel("coherence")
    magnitude.set_yscale("log")
    magnitude.set_ylabel(f"magnitude{_unit(response)}")
    phase.set_ylabel("phase [deg]")
    phase.set_ylim(-190.0, 190.0)
    phase.set_yticks((-180, -90, 0, 90, 180))
    grid[-1].set_xlabel("frequency [Hz]")
    grid[-1].set_xlim(response.frequency_hz[0], response.frequency_hz[-1])
    figure.align_ylabels(grid)
    if len(pairs) > 1 or fit is not None:
        _legend(magnitude, fit is not None)
    set_title(magnitude, _title(response, pairs))
    return figure


def shown_lines(values: Array) -> NDArray[np.intp]:
    """Return the indices of the drawn samples of a long curve: the extremes of each interval.

    The indices are increasing; a short curve has all of them.
    """
    # most samples of a drawn curve
    points = 3000
    count = values.size
    if count <= points:
        return np.arange(count)
    edges = np.linspace(0, count, points // 2 + 1).astype(np.intp)
    indices = [0, count - 1]
    for a, b in zip(edges[:-1].tolist(), edges[1:].tolist(), strict=True):
        indices += [a + int(np.argmin(values[a:b])), a + int(np.argmax(values[a:b]))]
    return np.unique(indices)


def thinned(start: int, stop: int, most: int = 3000) -> NDArray[np.intp]:
    """Return indices of the drawn samples of a long loop, evenly spaced."""
    return np.arange(start, stop, max(1, (stop - start) // most))


def _plot_magnitude(
    axes: "Axes",
    response: "MeasuredResponse",
    output: int,
    input_index: int,
    *,
    colour: str,
    label: str,
) -> None:
    """Plot the magnitude of one response, with its 95 % band."""
    size = np.abs(response.response[:, output, input_index])
    at = shown_lines(size)
    f, size = response.frequency_hz[at], size[at]
    if response.variance is not None:
        half = _BAND * np.sqrt(0.5 * response.variance[at, output, input_index])
        # a logarithmic scale cannot show a band down to zero
        low = np.maximum(size - half, 0.1 * size)
        axes.fill_between(f, low, size + half, color=colour, alpha=0.25, linewidth=0.0)
    axes.plot(f, size, color=colour, linewidth=0.9, label=label)


def _plot_phase(
    axes: "Axes", response: "MeasuredResponse", output: int, input_index: int, *, colour: str
) -> None:
    """Plot the phase of one response, with its 95 % band."""
    h = response.response[:, output, input_index]
    at = shown_lines(np.angle(h))
    f = response.frequency_hz[at]
    angle = np.degrees(np.angle(h[at]))
    if response.variance is not None:
        half = _BAND * np.sqrt(0.5 * response.variance[at, output, input_index])
        share = np.divide(half, np.abs(h[at]), out=np.ones(at.size), where=h[at] != 0.0)
        turn = np.degrees(np.arcsin(np.minimum(share, 1.0)))
        axes.fill_between(f, angle - turn, angle + turn, color=colour, alpha=0.25, linewidth=0.0)
    axes.plot(f, _wrapped(h[at]), color=colour, linewidth=0.9)


def _wrapped(h: Complex) -> Array:
    """Return the angle in degrees, interrupted where it jumps by a turn."""
    angle = np.degrees(np.angle(h))
    jumps = np.flatnonzero(np.abs(np.diff(angle)) > 180.0)
    angle[jumps] = np.nan
    return angle


def _unit(response: "MeasuredResponse") -> str:
    units = {
        f"{out}/{into}"
        for out in response.output_units
        for into in response.input_units
        if out and into
    }
    return f" [{units.pop()}]" if len(units) == 1 else ""


def _legend(axes: "Axes", fitted: bool) -> None:
    from matplotlib.lines import Line2D

    handles, labels = axes.get_legend_handles_labels()
    if fitted:
        handles.append(Line2D([], [], color=INK, linewidth=0.8, linestyle=DASHED))
        labels.append("model")
    add_legend(axes, handles, labels, loc="best", ncols=2)


def _title(response: "MeasuredResponse", pairs: list[tuple[int, int]]) -> str:
    words = []
    if len(pairs) == 1:
        words.append(f"{response.outputs[0]} / {response.inputs[0]}")
    elif len(pairs) > _CURVES:
        words.append(f"{_CURVES} of {len(pairs)} responses")
    if response.estimator:
        words.append(response.estimator)
    if response.averages > 0.0:
        words.append(f"{response.averages:.4g} average{'s' * (response.averages != 1.0)}")
    if response.variance is not None:
        words.append("band: 95 %")
    return ", ".join(words)


def draw_thermal_transient(result: ThermalTransient) -> "Figure":
    """Draw the readings of the probes in time, and below the temperatures of bodies and drives."""
    figure, (upper, lower) = panels(6.4, 5.0, 2)
    minutes = result.time / 60.0
    for i, (probe, reading) in enumerate(result.readings.items()):
        upper.plot(minutes, UM * reading, color=CYCLE[i % len(CYCLE)], linewidth=1.6, label=probe)
    for change in result.bodies.values():
        lower.plot(minutes, change, color=MUTED, linewidth=0.8)
    for i, (drive, change) in enumerate(result.drives.items()):
        lower.plot(minutes, change, color=CYCLE[i % len(CYCLE)], label=f"drive {drive}")
    lower.plot([], [], color=MUTED, linewidth=0.8, label="bodies")
    set_title(upper, "Thermal drift, drives in place")
    label_axes(upper, "", "reading [µm, or µrad]")
    label_axes(lower, "time [min]", "change of temperature [K]")
    for axes in (upper, lower):
        add_legend(axes)
    return figure
