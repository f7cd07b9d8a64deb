"""Modal fits with the measurements: stabilisation, response, resonance, and free decay."""

from typing import TYPE_CHECKING

import numpy as np

from flexstage.base.arrays import Array
from flexstage.base.errors import ModelError
from flexstage.measure.frf import FrfResult
from flexstage.measure.modal.result import ModalFit
from flexstage.measure.modal.ring_down import RingDown
from flexstage.quantities.estimate import Estimate
from flexstage.quantities.quantity import value_and_uncertainty
from flexstage.records import Record
from flexstage.report.figures.responses import draw_response, shown_lines
from flexstage.report.figures.style import (
    CYCLE,
    DASHED,
    INK,
    LONG_DASHED,
    MUTED,
    add_legend,
    one_panel,
    panels,
    scale,
    set_title,
    style_axes,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


def draw_frf(result: FrfResult) -> "Figure":
    """Draw response and fit of the first output; without a fit, the response alone."""
    return draw_response(result.response) if result.fit is None else draw_modal_fit(result.fit)


def draw_stabilisation(fit: ModalFit | None) -> "Figure":
    """Draw the poles of each order over the magnitude of the response.

    Marks show the stable poles; the magnitude is the root mean square of all outputs and inputs,
    vertical lines are the modes of the fit. Of several responses that were fitted together the
    first is drawn.
    """
    # largest distance of a mode from its poles, relative to its frequency
    pole_distance = 0.02
    diagram = None if fit is None else fit.stabilisation
    if fit is None or diagram is None:
        raise ModelError("the fit has no stabilisation diagram")
    measured = fit.fitted[0].measured
    figure, axes = one_panel(9.6, 4.0)
    size = np.sqrt(np.mean(np.abs(measured.response) ** 2, axis=(1, 2)))
    units = set(measured.output_units) or {""}
    axes.semilogy(
        measured.frequency_hz, np.maximum(size, 1e-300), color=MUTED, linewidth=0.8, zorder=1
    )
    axes.set_ylabel(f"magnitude{_unit(measured.output_units, measured.input_units)}"
                    if len(units) == 1 else "magnitude, rms of all")  # fmt: skip
    _band(axes, fit)
    over = axes.twinx()
    style_axes(over, grid=False)
    over.spines["right"].set_visible(True)
    over.spines["left"].set_visible(False)
    kinds = (
        ("not stable", ".", MUTED, 3.0, lambda o: ~o.stable_frequency),
        ("frequency stable", "+", CYCLE[4], 4.5, lambda o: o.stable_frequency & ~o.stable_damping),
        ("damping stable", "o", CYCLE[0], 3.4, lambda o: o.stable_damping),
    )
    for label, marker, colour, points, selects in kinds:
        f = [o.frequency_hz[selects(o)] for o in diagram.orders]
        order = [np.full(x.size, o.order) for x, o in zip(f, diagram.orders, strict=True)]
        over.plot(np.concatenate(f), np.concatenate(order), marker, color=colour, label=label,
                  markersize=points, markeredgewidth=0.9, fillstyle="none", zorder=3)  # fmt: skip
    # a mode of other responses need not have poles here
    poles = np.concatenate([o.frequency_hz for o in diagram.orders])
    visible_modes = [
        mode
        for mode in fit.modes
        if np.any(np.abs(poles / mode.frequency_hz.value - 1.0) < pole_distance)
    ]
    for n, mode in enumerate(visible_modes):
        over.axvline(mode.frequency_hz.value, color=CYCLE[1], linewidth=0.9,
                     label="mode of the fit" if n == 0 else None, zorder=2)  # fmt: skip
    orders = [o.order for o in diagram.orders]
    over.set_ylim(min(orders) - 1, max(orders) + 1)
    over.set_ylabel("order")
    add_legend(figure, *over.get_legend_handles_labels(), loc="outside upper right", ncols=4)
    tolerances = 100.0 * np.array([diagram.frequency_tolerance, diagram.damping_tolerance])
    set_title(axes, "stable: frequency within {:g} %, damping within {:g} %".format(*tolerances))
    return figure


def draw_modal_fit(fit: ModalFit, *, output: int | None = 0) -> "Figure":
    """Draw a measured response, its fit with the 95 % band, and the residual.

    The response is to the first input, the first of the responses that were fitted together.
    `output` is the index of its output; None selects the one with the largest response.
    """
    # points of a fitted curve, in addition to the measured lines
    fitted_points = 1500
    # half width of a 95 % interval of a normal distribution
    normal = 1.959964
    output = strongest_output(fit) if output is None else output
    first = fit.fitted[0]
    measured = first.measured
    if not 0 <= output < len(measured.outputs):
        raise ModelError(f"the response has no output {output}")
    at = (slice(None), output, 0)
    f = measured.frequency_hz
    fine = np.union1d(f, np.linspace(f[0], f[-1], fitted_points))
    for mode in fit.modes:
        centre, half = mode.frequency_hz.value, 8.0 * mode.damping_ratio.value
        near = centre * np.linspace(1.0 - half, 1.0 + half, 161)
        fine = np.union1d(fine, near[(near > f[0]) & (near < f[-1])])
    value, spread = fit.response(fine, 0)[at], fit.response_uncertainty(fine, 0)[at]
    residual = np.abs(measured.response[at] - fit.response(f, 0)[at])
    from matplotlib.ticker import MultipleLocator

    figure, (upper, lower) = panels(9.6, 4.6, 2, sharex=True, height_ratios=(2.6, 1.0))
    tiny = 1e-300
    upper.semilogy(f, np.maximum(np.abs(measured.response[at]), tiny), ".", color=CYCLE[1],
                   markersize=2.2, label="measured")  # fmt: skip
    upper.fill_between(fine, np.maximum(np.abs(value) - normal * spread, 0.05 * np.abs(value)),
                       np.abs(value) + normal * spread, color=CYCLE[5], alpha=0.5, linewidth=0,
                       label="95 % band of the fit")  # fmt: skip
    upper.semilogy(fine, np.abs(value), color=CYCLE[0], linewidth=1.0, label="fit")
    upper.semilogy(f, np.maximum(residual, tiny), color=MUTED, linewidth=0.4, label="residual")
    upper.semilogy(f, first.deviation[at], color=INK, linewidth=0.8, linestyle=LONG_DASHED,
                   label="noise, rms")  # fmt: skip
    magnitudes = np.concatenate([np.abs(measured.response[at]), np.quantile(residual, [0.02, 1.0])])
    magnitudes = magnitudes[magnitudes > 0.0]
    upper.set_ylim(0.5 * magnitudes.min(), 2.5 * magnitudes.max())
    units = (measured.output_units[output : output + 1], measured.input_units[:1])
    upper.set_ylabel(f"magnitude{_unit(*units)}")
    set_title(upper, f"{measured.outputs[output]} over {measured.inputs[0]}")
    add_legend(
        figure,
        *upper.get_legend_handles_labels(),
        loc="outside upper right",
        ncols=5,
        markerscale=2.5,
    )
    cut = _emptiest(np.degrees(np.angle(value)))
    points = _from(cut, np.degrees(np.angle(measured.response[at])))
    lower.plot(f, points, ".", color=CYCLE[1], markersize=2.2)
    phase = _from(cut, np.degrees(np.angle(value)))
    # a phase jumps at the cut: interrupt the line there
    phase[1:][np.abs(np.diff(phase)) > 180.0] = np.nan
    lower.plot(fine, phase, color=CYCLE[0], linewidth=1.0)
    lower.set_ylim(cut - 10.0, cut + 370.0)
    lower.yaxis.set_major_locator(MultipleLocator(90.0))
    lower.set_ylabel("phase [deg]")
    _band(lower, fit)
    return figure


def _emptiest(phase: Array) -> float:
    """Return the start of a scale of 360 degrees whose ends the phase does not cross."""
    phases = np.sort(phase)
    gaps = np.diff(phases, append=phases[0] + 360.0)
    widest = int(np.argmax(gaps))
    return float((phases[widest] + 0.5 * gaps[widest]) % 360.0 - 360.0)


def _from(cut: float, phase: Array) -> Array:
    return cut + np.mod(phase - cut, 360.0)


def _band(axes: "Axes", fit: ModalFit) -> None:
    axes.set_xlim(*fit.band)
    axes.set_xlabel("frequency [Hz]")


def _unit(outputs: tuple[str, ...], inputs: tuple[str, ...]) -> str:
    if not outputs or not outputs[0] or not inputs or not inputs[0]:
        return ""
    output = outputs[0].replace("^2", "²")
    return f" [({output})/{inputs[0]}]" if "/" in output else f" [{output}/{inputs[0]}]"


def draw_resonance(
    fit: ModalFit,
    *,
    axis: str,
    label: str,
    frequency_hz: Estimate | None = None,
    published_hz: float | None = None,
) -> "Figure":
    """Draw the magnitude of a response with its strongest mode.

    The output with the largest response to the first input, its fit, and the natural frequency with
    its total uncertainty [Hz]; a vertical line is a published one. `label` is that of the points.
    """
    output = strongest_output(fit)
    response = fit.fitted[0].measured
    f, measured = response.frequency_hz, np.abs(response.response[:, output, 0])
    figure, axes = one_panel(5.0, 2.9)
    fine = np.linspace(f[0], f[-1], 1500)
    axes.semilogy(f, measured, ".", color=CYCLE[1], markersize=2.2, label=label)
    axes.semilogy(fine, np.abs(fit.response(fine, 0)[:, output, 0]), color=CYCLE[0], linewidth=1.0,
                  label="fit")  # fmt: skip
    if published_hz is not None:
        axes.axvline(published_hz, color=INK, linewidth=0.9, linestyle=(0, (5, 2)),
                     label=f"published, measured: {published_hz:.10g} Hz")  # fmt: skip
    axes.set_xlim(f[0], f[-1])
    axes.set_xlabel("frequency [Hz]")
    axes.set_ylabel(f"{response.outputs[output]} / {response.inputs[0]}", parse_math=False)
    axes.legend(loc="upper right", fontsize=7.0, frameon=False, labelcolor=MUTED)
    title = f"{axis}, {label}"
    if frequency_hz is not None:
        value, spread = value_and_uncertainty(frequency_hz.value, frequency_hz.expanded)
        title += f": {value} ± {spread} Hz"
    set_title(axes, title)
    return figure


def strongest_output(fit: ModalFit) -> int:
    """Return the index of the output with the largest response to the first input."""
    measured = fit.fitted[0].measured.response[:, :, 0]
    return int(np.argmax(np.abs(measured).max(axis=0)))


def draw_ring_down(fit: RingDown, record: Record) -> "Figure":
    """Draw a free decay, the fitted damped sines, and the residual.

    At most four channels are drawn; the record gives their units.
    """
    # most channels
    channels = 4
    names = fit.channels[:channels]
    count, ratios = len(names), (2.2, 1.0) * len(names)
    figure, grid = panels(8.6, 1.2 + 2.6 * count, 2 * count, sharex=True, height_ratios=ratios)
    for k, name in enumerate(names):
        unit, factor = scale(record.channel(name).unit)
        measured, fitted = factor * fit.measured[:, k], factor * fit.fitted[:, k]
        upper, lower = grid[2 * k : 2 * k + 2]
        colour = CYCLE[k % len(CYCLE)]
        at = shown_lines(measured)
        upper.plot(fit.time[at], measured[at], color=colour, linewidth=0.9, label="measured")
        look = {"color": INK, "linewidth": 0.8, "linestyle": DASHED, "label": "fit"}
        upper.plot(fit.time[at], fitted[at], **look)
        upper.set_ylabel(f"{name}{unit}")
        residual = measured - fitted
        at = shown_lines(residual)
        lower.plot(fit.time[at], residual[at], color=colour, linewidth=0.7)
        lower.set_ylabel("residual")
        if k == 0:
            add_legend(upper, loc="upper right", ncols=2)
    grid[-1].set_xlabel("time [s]")
    grid[-1].set_xlim(float(fit.time[0]), float(np.max(fit.time)))
    figure.align_ylabels(grid)
    frequencies = ", ".join(f"{mode.frequency_hz.value:.2f} Hz" for mode in fit.modes[:5])
    set_title(
        grid[0], f"free decay: {frequencies}" if frequencies else "free decay: no dominant mode"
    )
    return figure
