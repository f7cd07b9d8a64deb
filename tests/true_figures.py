"""The figures that a virtual stage truly has, which measuring it should bring back."""

import math

import numpy as np

from flexstage.system import modes
from flexstage.virtual.as_built import AsBuilt, AsBuiltAxis
from flexstage.virtual.imperfections import straight_line
from flexstage.virtual.laboratory import Laboratory

_SAMPLES = 2000
#: Share of a level that is averaged: what is left when it has settled, of which one half counts.
_AVERAGED = 0.5 * (1.0 - 0.3)
_CONFIDENCE = 0.95


def true_figures(
    built: AsBuilt, laboratory: Laboratory | None = None
) -> dict[tuple[str, str], float]:
    """Return the figures of a virtual stage, by quantity and axis.

    They are in the units of `flexstage.quantities.quantity.QUANTITIES`, computed from what the
    stage does and from no record; the laboratory gives those that are of the sensor: noise, and the
    resolution of a drive without steps.
    """
    lab = laboratory or Laboratory()
    figures: dict[tuple[str, str], float] = {}
    found = modes(built.system, drives="removed")
    for axis in built.axes:
        guide = axis.guide
        figures |= {
            ("output_displacement", axis.name): axis.stroke,
            ("straightness", axis.name): guide.straightness("across"),
            ("straightness_out_of_plane", axis.name): guide.straightness("vertical"),
            ("cross_coupling", axis.name): guide.slope("across"),
            ("parasitic_rotation", axis.name): guide.range("yaw"),
            ("pitch", axis.name): guide.range("pitch"),
            ("roll", axis.name): guide.range("roll"),
            ("repeatability", axis.name): axis.repeatability,
            ("linearity", axis.name): _linearity(axis),
            ("noise", axis.name): lab.position.noise_rms,
            ("drift", axis.name): 0.0,
            ("resolution", axis.name): _resolution(axis, lab),
            ("natural_frequency_hz", axis.name): float(found.frequency_hz[axis.mode]),
            ("damping_ratio", axis.name): float(found.damping_ratio[axis.mode]),
        }
        figures["hysteresis_loop_width", axis.name] = (
            abs(axis.reversal) if axis.hysteresis is None else axis.loop_width()
        )
    if len(built.axes) == 2:
        first, second = built.axes
        # of the corners, which is that of the chords of both paths
        a, b = (float(g.at(g.stroke, "across")) / g.stroke for g in (first.guide, second.guide))
        figures["squareness", f"{first.name}{second.name}"] = -(math.atan(a) + math.atan(b))
        figures["workspace_area", f"{first.name}{second.name}"] = _area(built)
    return figures


def _area(built: AsBuilt) -> float:
    """Area between the four corners that two full strokes lead to."""
    first, second = built.axes[:2]
    up = float(first.guide.at(first.stroke, "across"))
    aside = float(second.guide.at(second.stroke, "across"))
    return first.stroke * second.stroke - up * aside


def _linearity(axis: AsBuiltAxis) -> float:
    """Range about the least-squares line of the mean of both directions."""
    up = axis.cycle(2 * _SAMPLES)[: _SAMPLES + 1]
    whole = np.concatenate((up, up[-2::-1]))
    position = axis.position(whole)
    mean = 0.5 * (position[: _SAMPLES + 1] + position[_SAMPLES:][::-1])
    return float(np.ptp(mean - straight_line(up, mean)(up)))


def _resolution(axis: AsBuiltAxis, laboratory: Laboratory) -> float:
    """Mean step of the staircase, or the step that two averages of white noise tell apart."""
    from scipy.special import ndtri

    if axis.smallest_step is None:
        samples = int(_AVERAGED * laboratory.per_level)
        factor = 2.0 * math.sqrt(2.0) * float(ndtri(_CONFIDENCE))
        return factor * laboratory.position.noise_rms / math.sqrt(samples)
    low, high = axis.command_range
    middle, steps = 0.5 * (low + high), laboratory.levels - 1
    rise = axis.smallest_step / axis.stroke * (high - low)
    first, last = axis.position(np.array([low, middle, middle + steps * rise]))[1:]
    return float(last - first) / steps
