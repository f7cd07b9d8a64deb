"""Noise at a constant command, staircases of small steps, and loops that reject disturbances."""

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from flexstage.base.arrays import Array
from flexstage.base.errors import ModelError
from flexstage.control.dynamic_budget import DynamicBudget
from flexstage.control.measured_response import ResponseDesign
from flexstage.control.tuning import AxesDesign
from flexstage.measure.noise.hold import AllanDeviation, HoldNoise
from flexstage.measure.noise.staircase import Staircase
from flexstage.measure.uncertainty.propagate import Propagated
from flexstage.quantities.quantity import prefixed
from flexstage.report.figures.style import (
    CYCLE,
    DASHED,
    INK,
    MUTED,
    add_legend,
    add_words,
    label_axes,
    panels,
    set_title,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


def draw_hold(values: ArrayLike, noise: HoldNoise, allan: AllanDeviation) -> "Figure":
    """Draw a reading at a constant command, its spectral density, and its Allan deviation.

    With drift, mains lines and 95 % intervals.
    """
    y = _readings(values)
    figure, grid = panels(10.2, 3.1, 3, 3, width_ratios=(1.15, 1.0, 1.0))
    _trace(grid[0], y, noise)
    _density(grid[1], noise)
    _deviation(grid[2], allan)
    return figure


def draw_staircase(
    values: ArrayLike, sample_rate_hz: float, staircase: Staircase, *, unit: str = "m"
) -> "Figure":
    """Draw a staircase with its levels, and its steps against the resolution.

    The averaged part of each level is highlighted; each step has its 95 % interval, compared with
    the smallest detectable step.
    """
    y = _readings(values)
    figure, (trace, steps) = panels(10.2, 3.3, 2, 2, width_ratios=(1.5, 1.0))
    start = float(y[0])
    factor, label = _scale(float(np.ptp(y)), unit)
    _line(trace, np.arange(y.size) / sample_rate_hz, factor * (y - start))
    for level, (a, b) in zip(staircase.levels, staircase.bounds.tolist(), strict=True):
        middle = 0.5 * (staircase.bounds.min() + staircase.bounds.max())
        at = np.array([a, b])
        drift = staircase.drift.value * (at - middle) / sample_rate_hz
        trace.plot(at / sample_rate_hz, factor * (level + drift - start), color=CYCLE[1], lw=2.0)
    label_axes(trace, "time [s]", f"reading [{label}]")
    trace.set_xlim(0.0, y.size / sample_rate_hz)
    set_title(trace, "Readings, and the averaged part of each level")
    _steps(steps, staircase, unit)
    return figure


def draw_cumulative(result: DynamicBudget, *, loop: str = "", point: str = "") -> "Figure":
    """Draw density and cumulative amplitude by source, of a loop at a point of interest.

    By default of the last loop at the first point; the total of the first loop is drawn dashed.
    """
    last = result.budget(loop, point)
    first = result.budget(result.budgets[0].loop, last.point)
    columns = 2 if last.tree is None else 3
    figure, (density, amplitude, *bars) = panels(5.1 * columns, 3.9, columns, columns)
    factor, label = _scale(max(first.total, last.total), last.unit)
    for k, source in enumerate(last.sources):
        look = {"color": CYCLE[k % len(CYCLE)], "linewidth": 1.0}
        variance = last.cumulative(source)
        if variance[-1] > 0.0:
            positive = np.where(source.density > 0.0, source.density, np.nan)
            density.loglog(last.frequency_hz, factor * np.sqrt(positive), **look)
            amplitude.semilogx(
                last.frequency_hz, factor * np.sqrt(variance), label=source.name, **look
            )
    lines = {"total": (last, "-"), f"total, {first.loop}": (first, DASHED)}
    for name, (budget, dashes) in lines.items() if first is not last else [("total", (last, "-"))]:
        variance = sum(budget.cumulative(source) for source in budget.sources)
        amplitude.semilogx(
            budget.frequency_hz, factor * np.sqrt(variance), color=INK, linewidth=1.4,
            linestyle=dashes, label=name,
        )  # fmt: skip
    highest = factor * np.sqrt(max(float(s.density.max()) for s in last.sources))
    if highest > 0.0:  # lines alone have no density
        density.set_ylim(1e-6 * highest, 3.0 * highest)
    density.set(xscale="log", xlim=amplitude.get_xlim())
    label_axes(density, "frequency [Hz]", f"density [{label}/√Hz]")
    label_axes(amplitude, "frequency [Hz]", f"rms from the lowest frequency [{label}]")
    add_legend(amplitude, loc="upper left")
    set_title(density, f"{result.stage}, {last.point}: density by source, loop {last.loop}")
    set_title(amplitude, f"Cumulative amplitude: {factor * last.total:.3g} {label} in all")
    if last.tree is not None:
        _shares(bars[0], last.tree)
    return figure


def _shares(axes: "Axes", tree: Propagated) -> None:
    """Draw the shares of errors in the variance, the largest on top."""
    lines = sorted(tree.lines, key=lambda line: line.share)
    names, shares = [line.name for line in lines], [100.0 * line.share for line in lines]
    axes.barh(names, shares, color=CYCLE[0])
    for k, (line, share) in enumerate(zip(lines, shares, strict=True)):
        factor, unit = _scale(line.uncertainty, line.unit)
        axes.text(
            share + 1.0, k, f"{factor * line.uncertainty:.3g} {unit}", va="center", fontsize=8
        )
    axes.set(xlim=(0.0, 130.0), xticks=[0, 50, 100])
    factor, unit = _scale(tree.uncertainty, tree.estimate.unit)
    label_axes(axes, "share of the variance [%]", "")
    set_title(axes, f"Errors: {factor * tree.uncertainty:.3g} {unit} combined")


def draw_loops(design: ResponseDesign) -> "Figure":
    """Draw open loop and sensitivity of each response of a set, the measured ones in colour."""
    figure, (size, nyquist, sensitivity) = panels(12.4, 3.9, 3, 3)
    for member in sorted(design.members, key=lambda m: m.measured):
        f, loop = member.frequency_hz, design.loop_gain(member)
        look: dict[str, Any] = {"color": CYCLE[0] if member.measured else MUTED, "linewidth": 1.2}
        look |= {} if member.measured else {"linewidth": 0.4, "alpha": 0.5}
        size.loglog(f, np.abs(loop), **look)
        nyquist.plot(loop.real, loop.imag, **look)
        sensitivity.loglog(f, 1.0 / np.abs(1.0 + loop), **look)
    highest = design.worst.sensitivity_peak
    around = np.exp(1j * np.linspace(0.0, 2.0 * np.pi, 200)) / highest
    nyquist.plot(around.real - 1.0, around.imag, color=INK, linewidth=0.9, linestyle=DASHED)
    nyquist.plot([-1.0], [0.0], "+", color=INK)
    nyquist.set(xlim=(-2.0, 1.0), ylim=(-1.5, 1.5), aspect="equal")
    size.axhline(1.0, color=INK, linewidth=0.8)
    sensitivity.axhline(highest, color=INK, linewidth=0.9, linestyle=DASHED)
    label_axes(size, "frequency [Hz]", "open loop")
    label_axes(nyquist, "real part of the open loop", "imaginary part")
    label_axes(sensitivity, "frequency [Hz]", "sensitivity")
    set_title(size, f"{design.loop.name} at {design.loop.sample_rate:g} Hz")
    set_title(nyquist, f"measured (blue) and {len(design.members)} in all")
    set_title(sensitivity, f"at most {highest:.3g}")
    return figure


def draw_axes(design: AxesDesign) -> "Figure":
    """Draw cross-talk before (dashed) and after decoupling, and the sensitivity of all axes."""
    figure, (talk, sensitivity) = panels(10.2, 3.9, 2, 2)
    decoupling = design.decoupling
    for k, name in enumerate(decoupling.outputs):
        look = {"color": CYCLE[k % len(CYCLE)], "linewidth": 1.0}
        talk.loglog(decoupling.lines_hz, decoupling.before[:, k], linestyle=DASHED, **look)
        talk.loglog(decoupling.lines_hz, decoupling.after[:, k], label=name, **look)
    for one in design.all_axes:
        sensitivity.semilogx(one.frequency_hz, one.sensitivity, color=CYCLE[0], linewidth=0.8)
    highest = max(one.sensitivity_peak for one in design.all_axes)
    sensitivity.axhline(highest, color=INK, linewidth=0.9, linestyle=DASHED)
    label_axes(talk, "frequency [Hz]", "motion by others over own motion")
    label_axes(sensitivity, "frequency [Hz]", "largest singular value of the sensitivity")
    add_legend(talk, loc="upper left")
    set_title(talk, "Cross-talk before (dashed) and after")
    set_title(sensitivity, f"All axes together: at most {highest:.3g}")
    return figure


def _readings(values: ArrayLike) -> Array:
    y = np.asarray(values, dtype=np.float64)
    if y.ndim != 1 or y.size < 2:
        raise ModelError(f"a trace needs two readings or more, got an array of shape {y.shape}")
    return y


def _scale(largest: float, unit: str) -> tuple[float, str]:
    if unit not in {"m", "rad", "V", "N"}:
        return 1.0, unit or "1"
    factor, prefix = prefixed(largest, 1.0)
    return factor, f"{prefix}{unit}"


def _line(axes: "Axes", t: np.ndarray, y: np.ndarray) -> None:
    # most points of a trace; more are drawn as the band between their extremes
    points = 4000
    if y.size <= points:
        axes.plot(t, y, color=CYCLE[0], linewidth=0.7)
        return
    # every sample counts in the band of its column, none is skipped
    starts = np.linspace(0, y.size, points // 4, endpoint=False).astype(np.intp)
    low, high = np.minimum.reduceat(y, starts), np.maximum.reduceat(y, starts)
    axes.fill_between(t[starts], low, high, color=CYCLE[0], linewidth=0.5)


def _trace(axes: "Axes", y: np.ndarray, noise: HoldNoise) -> None:
    deviation = y - y.mean()
    factor, label = _scale(float(np.ptp(deviation)), noise.unit)
    t = np.arange(y.size) / noise.sample_rate_hz
    _line(axes, t, factor * deviation)
    slope = noise.drift.value * (t[[0, -1]] - t.mean())
    axes.plot(t[[0, -1]], factor * slope, color=CYCLE[1], linewidth=1.6, label="drift")
    label_axes(axes, "time [s]", f"reading − mean [{label}]")
    axes.set_xlim(0.0, t[-1])
    set_title(
        axes,
        f"rms {factor * noise.rms.value:.3g} {label}, peak to peak "
        f"{factor * noise.peak_to_peak.value:.3g} {label}",
        8.5,
    )
    # above the highest reading, where no trace runs
    low, high = axes.get_ylim()
    axes.set_ylim(low, high + 0.12 * (high - low))
    drift_factor, drift_label = _scale(abs(noise.drift.value), noise.unit)
    axes.text(
        0.02, 0.985, f"drift {drift_factor * noise.drift.value:.3g} ± "
        f"{drift_factor * noise.drift.expanded:.2g} {drift_label}/s (statistical)",
        transform=axes.transAxes, va="top", fontsize=8, color=CYCLE[1], parse_math=False,
    )  # fmt: skip


def _density(axes: "Axes", noise: HoldNoise) -> None:
    spectrum = noise.spectrum
    inner = slice(1, -1)
    f, density = spectrum.frequency_hz[inner], np.sqrt(spectrum.density[inner])
    factor, label = _scale(float(density.max()), noise.unit)
    low, high = (np.sqrt(end[inner]) for end in spectrum.bounds())
    axes.fill_between(f, factor * low, factor * high, color=CYCLE[0], alpha=0.25, linewidth=0)
    axes.loglog(f, factor * density, color=CYCLE[0], linewidth=1.0)
    for line in noise.mains:
        axes.axvline(line.frequency_hz, color=CYCLE[1], linewidth=0.8, linestyle=":", zorder=0)
    label_axes(axes, "frequency [Hz]", f"density [{label}/√Hz]")
    axes.set_xlim(f[0], f[-1])
    title, lines = "Spectral density", len(noise.mains)
    if lines:
        title += f"; {lines} line{'s' if lines > 1 else ''} of {noise.mains[0].mains_hz} Hz mains"
    set_title(axes, title, 8.5)


def _deviation(axes: "Axes", allan: AllanDeviation) -> None:
    factor, label = _scale(float(allan.deviation.max()), allan.unit)
    tau, value = allan.tau, factor * allan.deviation
    high = np.where(np.isfinite(allan.high), allan.high, allan.deviation)
    axes.fill_between(
        tau, factor * allan.low, factor * high, color=CYCLE[0], alpha=0.25, linewidth=0
    )
    axes.loglog(tau, value, color=CYCLE[0], marker="o", markersize=2.5, linewidth=1.0)
    white = value[0] * np.sqrt(tau[0] / tau)
    axes.loglog(tau, white, color=MUTED, linewidth=0.8, linestyle="--")
    middle = tau.size // 2
    add_words(
        axes,
        "white noise",
        (tau[middle], white[middle]),
        (-4, -4),
        7.5,
        MUTED,
        ha="right",
        va="top",
    )
    label_axes(axes, "averaging time [s]", f"Allan deviation [{label}]")
    best = int(np.argmin(value))
    set_title(axes, f"Minimum {value[best]:.3g} {label} at {tau[best]:.3g} s", 8.5)


def _steps(axes: "Axes", staircase: Staircase, unit: str) -> None:
    size = np.abs([step.size.value for step in staircase.steps])
    half = np.array([step.size.expanded for step in staircase.steps])
    low, high = staircase.resolution.interval()
    factor, label = _scale(float(size.max()), unit)
    axes.axhspan(factor * low, factor * high, color=CYCLE[1], alpha=0.22, linewidth=0)
    axes.axhline(factor * staircase.resolution.value, color=CYCLE[1], linewidth=1.2)
    at = np.arange(1, size.size + 1)
    looks = {"yes": (CYCLE[2], "o"), "undecided": (CYCLE[4], "D"), "no": (CYCLE[3], "x")}
    for answer, (colour, marker) in looks.items():
        here = np.array([step.resolved == answer for step in staircase.steps])
        if here.any():
            axes.errorbar(
                at[here], factor * size[here], factor * half[here], color=colour, linestyle="none",
                marker=marker, markersize=4, linewidth=1.0, capsize=2,
                label=f"step resolved: {answer}",
            )  # fmt: skip
    label_axes(axes, "step", f"step size [{label}]")
    if size.max() > 5.0 * max(float(size.min()), 1e-3 * size.max()):
        axes.set_yscale("log")
        least = 0.4 * min(low, max(float(size.min()), 0.01 * size.max()))
        axes.set_ylim(factor * least, 2.2 * factor * float((size + half).max()))
    else:
        axes.set_ylim(0.0, 1.22 * factor * max(float((size + half).max()), high))
    add_legend(axes, ncols=3, loc="upper right")
    set_title(
        axes,
        f"Resolution {factor * staircase.resolution.value:.3g} {label} at "
        f"{100 * staircase.probability:g} %, {staircase.bandwidth_hz:.3g} Hz bandwidth",
        8.5,
    )
