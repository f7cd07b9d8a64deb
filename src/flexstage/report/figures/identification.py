"""A measured loop beside the model that was identified from it."""

from typing import TYPE_CHECKING

import numpy as np

from flexstage.hysteresis.identification import Identification
from flexstage.report.figures.style import CYCLE, INK, dress, entitle, new_figure

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

__all__ = ["draw_identification"]

#: Points that a curve over time is drawn with, at most.
_POINTS = 4000
#: Cycles of which the loop is drawn.
_CYCLES = 7
_SCALES = {"m": ("µm", 1e6), "rad": ("µrad", 1e6)}


def draw_identification(found: Identification, section: int = 0) -> "Figure":
    """Draw measured and modelled loop, and what the model leaves over time.

    Parameters
    ----------
    found : Identification
        The identification.
    section : int
        Number of the record, counted from 0.

    Returns
    -------
    matplotlib.figure.Figure
        The loop over the input; beside it output less model over time, with the noise of the output
        as a band.
    """
    figure = new_figure(9.6, 3.6)
    left, right = figure.subplots(1, 2, width_ratios=(1.0, 1.25))
    _loop(left, found, section)
    _residual(right, found, section)
    return figure


def scale(unit: str) -> tuple[str, float]:
    """Return the unit that a quantity is drawn in, and how many of it one SI unit is.

    Parameters
    ----------
    unit : str
        Its SI unit; empty where nobody has said.

    Returns
    -------
    tuple of str and float
        Unit in brackets, with a space before it, and factor.
    """
    name, factor = _SCALES.get(unit, (unit, 1.0))
    return (f" [{name}]" if name else "", factor)


def _loop(axes: "Axes", found: Identification, section: int) -> None:
    s = found.measurement.sections[section]
    sign = found.measurement.sign
    within = _shown(found, section)
    unit, factor = scale(found.model.output_unit)
    dress(axes)
    axes.plot(
        s.u[within], factor * sign * s.y[within], ".", color=CYCLE[1], markersize=2.2,
        label="measured",
    )  # fmt: skip
    axes.plot(
        s.u[within], factor * found.predicted[section][within], color=CYCLE[0], linewidth=1.0,
        label=f"model, {found.kind}",
    )  # fmt: skip
    axes.set_xlabel(f"input{scale(found.model.input_unit)[0]}", color=INK)
    axes.set_ylabel(f"output{unit}", color=INK)
    axes.legend(loc="upper left", fontsize=7.5, frameon=False, labelcolor=INK, markerscale=2.5)
    entitle(axes, "loop")


def _residual(axes: "Axes", found: Identification, section: int) -> None:
    s = found.measurement.sections[section]
    at = _thin(np.arange(s.warm_up, s.u.size))
    percent = 100.0 / found.stroke
    left = (found.measurement.sign * s.y - found.predicted[section]) * percent
    t = at * s.dt
    dress(axes)
    axes.plot(t, left[at], color=CYCLE[0], linewidth=0.5)
    for end in (-found.noise_percent, found.noise_percent):
        axes.axhline(end, color=INK, linewidth=0.8, linestyle=(0, (5, 3)))
    axes.set_xlim(t[0], t[-1])
    top = 1.15 * float(np.abs(left[at]).max())
    axes.set_ylim(-top, top)
    axes.set_xlabel("time [s]", color=INK)
    axes.set_ylabel("output less model [% of stroke]", color=INK)
    held = (
        "" if found.heldout_rms_percent is None else f", held out {found.heldout_rms_percent:.2f}"
    )
    entitle(
        axes,
        f"{found.rms_percent:.2f} % rms{held}; largest {found.max_percent:.2f}; noise "
        f"{found.noise_percent:.2f} (dashed)",
    )


def _shown(found: Identification, section: int) -> np.ndarray:
    """Samples of the last cycles, so many that one can tell their curves apart."""
    s = found.measurement.sections[section]
    bounds = s.cycles.bounds
    minor = np.flatnonzero(s.cycles.swing < 0.9)
    # from the last major loop before the last minor ones, or a few cycles of the end
    last = int(minor[-1]) if minor.size else s.cycles.swing.size - 1
    first = max(last - _CYCLES, int(np.searchsorted(bounds, s.warm_up)))
    stop = min(last + 2, bounds.size - 1)
    return np.arange(bounds[min(first, stop - 1)], bounds[stop] + 1)


def _thin(at: np.ndarray) -> np.ndarray:
    return at[:: max(1, at.size // _POINTS)]
