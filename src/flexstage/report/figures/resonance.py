"""The resonance of an axis in a measured response, with the published value marked."""

from typing import TYPE_CHECKING

import numpy as np

from flexstage.estimate import Estimate
from flexstage.experiment.modal.result import ModalFit
from flexstage.quantities import beside
from flexstage.report.figures.style import CYCLE, INK, MUTED, dress, entitle, new_figure

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def draw_resonance(
    fit: ModalFit,
    *,
    axis: str,
    label: str,
    frequency_hz: Estimate | None = None,
    published_hz: float | None = None,
) -> "Figure":
    """Draw the magnitude of a response with its strongest mode.

    The output that the first input moves most, its fit, and the natural frequency with all that is
    uncertain in it [Hz]; a published one is an upright line. `label` is what the points are.
    """
    output = strongest_output(fit)
    one = fit.fitted[0].measured
    f, measured = one.frequency_hz, np.abs(one.response[:, output, 0])
    figure = new_figure(5.0, 2.9)
    axes = figure.subplots()
    dress(axes)
    fine = np.linspace(f[0], f[-1], 1500)
    axes.semilogy(f, measured, ".", color=CYCLE[1], markersize=2.2, label=label)
    axes.semilogy(fine, np.abs(fit.response(fine, 0)[:, output, 0]), color=CYCLE[0], linewidth=1.0,
                  label="fit")  # fmt: skip
    if published_hz is not None:
        axes.axvline(published_hz, color=INK, linewidth=0.9, linestyle=(0, (5, 2)),
                     label=f"published, measured: {published_hz:.10g} Hz")  # fmt: skip
    axes.set_xlim(f[0], f[-1])
    axes.set_xlabel("frequency [Hz]", color=INK)
    axes.set_ylabel(f"{one.outputs[output]} / {one.inputs[0]}", color=INK, parse_math=False)
    axes.legend(loc="upper right", fontsize=7.0, frameon=False, labelcolor=MUTED)
    title = f"{axis}, {label}"
    if frequency_hz is not None:
        value, spread = beside(frequency_hz.value, frequency_hz.expanded)
        title += f": {value} ± {spread} Hz"
    entitle(axes, title)
    return figure


def strongest_output(fit: ModalFit) -> int:
    """Return the number of the output that the first input moves most."""
    measured = fit.fitted[0].measured.response[:, :, 0]
    return int(np.argmax(np.abs(measured).max(axis=0)))
