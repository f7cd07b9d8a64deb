"""A measured frequency response: magnitude, phase and coherence, with what is uncertain in them."""

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from flexstage.arrays import Array, Complex
from flexstage.experiment.spectra.response import MeasuredResponse
from flexstage.report.figures.style import CYCLE, INK, dress, entitle, new_figure

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

#: Lines that a curve is drawn with, about and at most.
_POINTS = 3000
#: Responses that are drawn in one figure, at most.
_CURVES = 6
# of a complex normal error, its real or imaginary part is within this share of sqrt(variance / 2)
# with a probability of 95 %
_BAND = 1.959964


def draw_response(response: MeasuredResponse, *, fit: MeasuredResponse | None = None) -> "Figure":
    """Draw magnitude, phase and coherence of a measured response.

    The first six curves, with 95 % bands where the variance is known; `fit` is drawn as a line.
    """
    coherent = response.coherence is not None
    figure = new_figure(8.6, 5.6 if coherent else 4.6)
    rows = 3 if coherent else 2
    panels = figure.subplots(rows, 1, sharex=True, height_ratios=(2.2, 1.3, 0.8)[:rows])
    magnitude, phase = panels[0], panels[1]
    for axes in panels:
        dress(axes)
    pairs = [(o, i) for o in range(len(response.outputs)) for i in range(len(response.inputs))]
    for number, (o, i) in enumerate(pairs[:_CURVES]):
        colour = CYCLE[number % len(CYCLE)]
        label = f"{response.outputs[o]} / {response.inputs[i]}"
        plot_magnitude(magnitude, response, o, i, colour=colour, label=label)
        plot_phase(phase, response, o, i, colour=colour)
        if fit is not None:
            f, h = fit.frequency_hz, fit.response[:, o, i]
            magnitude.plot(f, np.abs(h), color=INK, linewidth=0.8, linestyle=(0, (4, 2)))
            phase.plot(f, *_wrapped(h), color=INK, linewidth=0.8, linestyle=(0, (4, 2)))
    if response.coherence is not None:
        for o in range(min(len(response.outputs), _CURVES)):
            colour = CYCLE[o * len(response.inputs) % len(CYCLE)]
            at = shown_lines(response.coherence[:, o])
            panels[2].plot(
                response.frequency_hz[at], response.coherence[at, o], color=colour, linewidth=0.8
            )
        panels[2].set_ylim(-0.03, 1.06)
        panels[2].set_ylabel("coherence", color=INK)
    magnitude.set_yscale("log")
    magnitude.set_ylabel(f"magnitude{_unit(response)}", color=INK)
    phase.set_ylabel("phase [deg]", color=INK)
    phase.set_ylim(-190.0, 190.0)
    phase.set_yticks((-180, -90, 0, 90, 180))
    panels[-1].set_xlabel("frequency [Hz]", color=INK)
    panels[-1].set_xlim(response.frequency_hz[0], response.frequency_hz[-1])
    figure.align_ylabels(panels)
    if len(pairs) > 1 or fit is not None:
        _legend(magnitude, fit is not None)
    entitle(magnitude, _title(response, pairs))
    return figure


def shown_lines(values: Array) -> NDArray[np.intp]:
    """The lines that a curve of many is drawn with: the ends of its range, piece by piece.

    Numbers that rise; all of them where there are few.
    """
    count = values.size
    if count <= _POINTS:
        return np.arange(count)
    edges = np.linspace(0, count, _POINTS // 2 + 1).astype(np.intp)
    kept = [0, count - 1]
    for a, b in zip(edges[:-1].tolist(), edges[1:].tolist(), strict=True):
        kept += [a + int(np.argmin(values[a:b])), a + int(np.argmax(values[a:b]))]
    return np.unique(kept)


def plot_magnitude(
    axes: "Axes", response: MeasuredResponse, output: int, given: int, *, colour: str, label: str
) -> None:
    """Plot the magnitude of one response, with its 95 % band."""
    size = np.abs(response.response[:, output, given])
    at = shown_lines(size)
    f, size = response.frequency_hz[at], size[at]
    if response.variance is not None:
        half = _BAND * np.sqrt(0.5 * response.variance[at, output, given])
        # a logarithm has no room for a band that reaches zero
        low = np.maximum(size - half, 0.1 * size)
        axes.fill_between(f, low, size + half, color=colour, alpha=0.25, linewidth=0.0)
    axes.plot(f, size, color=colour, linewidth=0.9, label=label)


def plot_phase(
    axes: "Axes", response: MeasuredResponse, output: int, given: int, *, colour: str
) -> None:
    """Plot the phase of one response, with its 95 % band."""
    h = response.response[:, output, given]
    at = shown_lines(np.angle(h))
    f = response.frequency_hz[at]
    angle = np.degrees(np.angle(h[at]))
    if response.variance is not None:
        half = _BAND * np.sqrt(0.5 * response.variance[at, output, given])
        share = np.divide(half, np.abs(h[at]), out=np.ones(at.size), where=h[at] != 0.0)
        turn = np.degrees(np.arcsin(np.minimum(share, 1.0)))
        axes.fill_between(f, angle - turn, angle + turn, color=colour, alpha=0.25, linewidth=0.0)
    axes.plot(f, *_wrapped(h[at]), color=colour, linewidth=0.9)


def _wrapped(h: Complex) -> tuple[Array]:
    """The angle in degrees, with a break where it jumps by a turn."""
    angle = np.degrees(np.angle(h))
    jumps = np.flatnonzero(np.abs(np.diff(angle)) > 180.0)
    angle[jumps] = np.nan
    return (angle,)


def _unit(response: MeasuredResponse) -> str:
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
        handles.append(Line2D([], [], color=INK, linewidth=0.8, linestyle=(0, (4, 2))))
        labels.append("model")
    made = axes.legend(
        handles, labels, loc="best", fontsize=7.5, frameon=False, labelcolor=INK, ncols=2
    )
    for text in made.get_texts():
        text.set_parse_math(False)


def _title(response: MeasuredResponse, pairs: list[tuple[int, int]]) -> str:
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
