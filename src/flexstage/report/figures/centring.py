"""Error of a scale over the turn, before and after centring, and its harmonics."""

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from flexstage.base.arrays import Array
from flexstage.base.errors import ModelError
from flexstage.centring import ARCSEC
from flexstage.centring.error_budget import COVERAGE
from flexstage.centring.harmonic_fit import HarmonicFit
from flexstage.report.figures.style import (
    CYCLE,
    GRID,
    INK,
    MUTED,
    PAPER,
    add_legend,
    new_figure,
    set_title,
    style_axes,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from flexstage.centring.calibrate import Calibration
    from flexstage.centring.calibration import HeadArrangement
    from flexstage.centring.from_records import CentredRecords
    from flexstage.studies.scale import ScaleStudy


def draw_centred(centred: "CentredRecords") -> "Figure":
    """Draw the successive setups of a scale, as read by their first heads."""
    fits, angles = zip(*((s.fits[0], s.heads[0].angle) for s in centred.setups), strict=True)
    return draw_polar(fits, angles)


def draw_calibration(calibration: "Calibration") -> "Figure":
    """Draw the errors of each circle with their 95 % intervals, and its harmonics."""
    divisions = calibration.divisions
    figure = new_figure(9.6, 3.3 * len(divisions))
    axes = figure.subplots(len(divisions), 2, width_ratios=(1.4, 1.0), squeeze=False)
    for (left, right), division in zip(axes, divisions, strict=True):
        size = division.error.size
        rows = [division.estimate(i % size) for i in range(size + 1)]
        angle = 360.0 * np.arange(size + 1) / size
        value = np.array([row.value for row in rows]) / ARCSEC
        half = np.array([row.expanded for row in rows]) / ARCSEC
        style_axes(left)
        # nothing is known between two faces
        if calibration.method in ("closure", "rosette"):
            left.errorbar(
                angle, value, yerr=half, fmt="o", color=CYCLE[0], markersize=4.0,
                ecolor=INK, elinewidth=0.9, capsize=2.4,
            )  # fmt: skip
        else:
            left.fill_between(angle, value - half, value + half, color=CYCLE[0], alpha=0.3)
            left.plot(angle, value, color=CYCLE[0], linewidth=1.0)
        left.set(xlabel="angle [deg]", ylabel="error [arcsec]", xlim=(-6.0, 366.0))
        left.set_xticks(range(0, 361, 60))
        set_title(left, f"{division.name}, with 95 % intervals")
        style_axes(right)
        amplitudes = [division.harmonic(n)[2] for n in division.orders]
        sizes = [a.value / ARCSEC for a in amplitudes]
        expanded = [a.expanded / ARCSEC for a in amplitudes]
        right.bar(
            division.orders, sizes, color=CYCLE[0], yerr=expanded,
            error_kw={"ecolor": INK, "elinewidth": 0.7, "capsize": 1.6},
        )  # fmt: skip
        right.set(xlabel="order [per turn]", ylabel="amplitude [arcsec]")
        right.set_ylim(bottom=0.0)
        set_title(right, "harmonics with 95 % intervals")
    return figure


def draw_gains(arrangement: "HeadArrangement") -> "Figure":
    """Draw the gain of noise of each order by heads at given angles, and its bound."""
    figure = new_figure(6.4, 3.4)
    axes = figure.add_subplot()
    style_axes(axes)
    axes.bar(arrangement.orders, arrangement.gain, color=CYCLE[0], label="gain")
    bound = 1.0 / math.sqrt(arrangement.heads.size)
    axes.axhline(bound, color=INK, linewidth=0.8, linestyle=(0, (5, 3)), label="bound")
    axes.set(xlabel="order [per turn]", ylabel="uncertainty over that of a reading [1]")
    add_legend(axes, loc="upper right")
    angles = ", ".join(f"{a:g}" for a in np.degrees(arrangement.heads).round(6))
    set_title(axes, f"heads at {angles} deg")
    return figure


def draw_polar(
    fits: Sequence[HarmonicFit],
    angles: Sequence[Array],
    labels: Sequence[str] | None = None,
) -> "Figure":
    """Draw errors over the turn in polar coordinates, and the amplitudes of their harmonics.

    One record, or several successive ones, all in rad or all in m; angles of the samples [rad]. A
    dashed circle marks zero error; errors are outwards where the scale reads more. Harmonics have
    95 % intervals. Default labels are before and after, or before and numbers.
    """
    # the last error is drawn again below this share of the largest error
    enlarged_below = 0.25
    if not fits or len(fits) != len(angles) or len({f.unit for f in fits}) > 1:
        raise ModelError("a polar plot needs one fit or more, of one unit, each with its angles")
    names = _labels(len(fits)) if labels is None else list(labels)
    unit, factor = ("arcsec", 1.0 / ARCSEC) if fits[0].unit == "rad" else ("µm", 1e6)
    # a much smaller error is drawn again on a scale of its own
    enlarged = len(fits) > 1 and _reach(fits[-1:]) < enlarged_below * _reach(fits)
    figure = new_figure(12.6 if enlarged else 9.6, 4.3)
    grid = figure.add_gridspec(1, 3 if enlarged else 2, width_ratios=(1.0, *[1.0] * enlarged, 1.15))
    polar = figure.add_subplot(grid[0, 0], projection="polar")
    colours = [CYCLE[i % len(CYCLE)] for i in range(len(fits))]
    _polar(polar, fits, angles, names, colours, (unit, factor))
    if enlarged:
        own_scale = figure.add_subplot(grid[0, 1], projection="polar")
        _polar(own_scale, fits[-1:], angles[-1:], names[-1:], colours[-1:], (unit, factor))
    bars = figure.add_subplot(grid[0, -1])
    _bars(bars, fits, names, unit, factor)
    return figure


def draw_error_budget(study: "ScaleStudy") -> "Figure":
    """Draw what each cause adds to the uncertainty of a reading, as mounted and centred."""
    reading = study.table.tolerance.reading
    # causes that reach this reading
    sets = [
        (label, [row for row in rows if (row.mean if reading == "mean" else row.each) > 0.0])
        for label, rows in (("as mounted", study.mounted), ("centred", study.centred))
    ]
    names = [
        row.cause if row.order is None else f"{row.cause}, order {row.order}" for row in sets[0][1]
    ]
    figure = new_figure(8.6, 1.6 + 0.36 * len(names))
    axes = figure.add_subplot()
    least = 1e-4 * study.table.tolerance.error / ARCSEC
    for k, (label, rows) in enumerate(sets):
        sizes = [max(COVERAGE * row.uncertainty(reading) / ARCSEC, least) for row in rows]
        at = np.arange(len(names)) + (0.2 if k else -0.2)
        axes.barh(at, sizes, height=0.36, left=0.0, color=CYCLE[k], label=label, zorder=2)
    allowed = study.table.tolerance.error / ARCSEC
    axes.axvline(
        allowed, color=INK, linewidth=1.0, linestyle="--", label="allowed in all", zorder=3
    )
    axes.set_xscale("log")
    axes.set_xlim(left=least)
    axes.set_yticks(range(len(names)), names)
    axes.invert_yaxis()
    style_axes(axes)
    what = "the mean of all heads" if reading == "mean" else "one head"
    axes.set_xlabel(f"expanded uncertainty (95 %) of {what} by each cause [arcsec]")
    set_title(axes, f"Error budget of {study.table.name}")
    add_legend(axes)
    return figure


def _labels(count: int) -> list[str]:
    if count <= 2:
        return ["before", "after"] if count == 2 else [""]
    return ["before", *(f"after move {i}" for i in range(1, count))]


def _polar(
    axes: "Axes",
    fits: Sequence[HarmonicFit],
    angles: Sequence[Array],
    names: Sequence[str],
    colours: Sequence[str],
    scale: tuple[str, float],
) -> None:
    # most samples of a curve
    points = 3000
    unit, factor = scale
    turn = np.linspace(0.0, 2.0 * math.pi, 721)
    curves = [factor * (f.evaluate(turn) - f.offset.value) for f in fits]
    reach = factor * _reach(fits) or 1.0
    step = _round_step(reach)
    top = step * math.ceil(reach / step * 1.02)
    axes.set_facecolor(PAPER)
    for i, (f, theta, curve, name) in enumerate(zip(fits, angles, curves, names, strict=True)):
        colour = colours[i]
        thin = slice(None, None, max(1, theta.size // points))
        dots = factor * (f.residual + f.evaluate(theta) - f.offset.value)
        inliers = np.ones(theta.size, dtype=bool)
        inliers[[o.index for o in f.outliers]] = False
        at = np.flatnonzero(inliers)[thin]
        axes.plot(theta[at], dots[at], ".", color=colour, markersize=1.6, alpha=0.45)
        axes.plot(turn, curve, color=colour, linewidth=1.3, label=name or None)
        out = [o for o in f.outliers if abs(factor * o.residual) < 1.9 * top]
        if out:
            index = [o.index for o in out]
            axes.plot(
                theta[index], dots[index], "x", color=INK, markersize=4.5,
                label="outlier" if i == 0 else None,
            )  # fmt: skip
    axes.plot(turn, np.zeros_like(turn), color=INK, linewidth=0.8, linestyle=(0, (5, 3)))
    axes.set_ylim(-2.0 * top, 1.15 * top)
    ticks = [-top, 0.0, top]
    axes.set_yticks(ticks, [f"{t:g}".replace("-", "\N{MINUS SIGN}") for t in ticks])
    polar: Any = axes  # polar axes, which the type does not show
    polar.set_rlabel_position(112.0)
    axes.tick_params(labelsize=8, labelcolor=INK, pad=1)
    axes.grid(color=GRID, linewidth=0.6)
    axes.spines["polar"].set_color(MUTED)
    axes.spines["polar"].set_linewidth(0.6)
    title = f"error {names[0]}".rstrip() if len(fits) == 1 else "error"
    set_title(axes, f"{title} [{unit}]; dashed circle: zero")
    if axes.get_legend_handles_labels()[0]:
        add_legend(axes, loc="upper left", bbox_to_anchor=(-0.22, 0.08))


def _reach(fits: Sequence[HarmonicFit]) -> float:
    """Return the maximum of the curves and of the noise about them."""
    turn = np.linspace(0.0, 2.0 * math.pi, 721)
    curves = [float(np.abs(f.evaluate(turn) - f.offset.value).max()) for f in fits]
    return max(*curves, *(3.0 * f.residual_rms for f in fits))


def _bars(
    axes: "Axes", fits: Sequence[HarmonicFit], names: Sequence[str], unit: str, factor: float
) -> None:
    style_axes(axes)
    orders = sorted({n for f in fits for n in f.orders})
    place = {n: i for i, n in enumerate(orders)}
    width = 0.8 / len(fits)
    least = math.inf
    for i, (f, name) in enumerate(zip(fits, names, strict=True)):
        colour = CYCLE[i % len(CYCLE)]
        at = np.array([place[n] for n in f.orders]) + (i - 0.5 * (len(fits) - 1)) * width
        value = np.array([factor * h.amplitude.value for h in f.harmonics])
        ends = factor * np.array([h.amplitude.interval() for h in f.harmonics])
        half_widths = np.abs(np.column_stack((value - ends[:, 0], ends[:, 1] - value)).T)
        axes.bar(at, value, 0.86 * width, color=colour, label=name)
        axes.errorbar(
            at,
            value,
            yerr=half_widths,
            fmt="none",
            ecolor=INK,
            elinewidth=0.7,
            capsize=1.6,
            capthick=0.7,
        )
        positive = np.concatenate((value, ends[:, 0]))
        positive = positive[positive > 0.0]
        least = min(least, float(positive.min()) if positive.size else least)
    most = max(factor * h.amplitude.interval()[1] for f in fits for h in f.harmonics)
    if math.isfinite(least) and most > 0.0:
        axes.set_yscale("log")
        axes.set_ylim(max(0.6 * least, 1e-5 * most), 1.7 * most)
    step = max(1, math.ceil(len(orders) / 13))
    axes.set_xticks(range(0, len(orders), step), [str(n) for n in orders[::step]])
    axes.set(xlabel="order [per turn]", ylabel=f"amplitude [{unit}]")
    if len(fits) > 1:
        add_legend(axes, loc="upper right")
    set_title(axes, "harmonics with 95 % intervals")


def _round_step(value: float) -> float:
    """Return 1, 2 or 5 times a power of ten that divides a value into one to five steps."""
    power = 10.0 ** math.floor(math.log10(value))
    return next(s * power for s in (0.5, 1.0, 2.0) if value <= 5.0 * s * power)
